//! Section V-B: how well a robot localizes itself, by equation 7's weighted error, and when the filter
//! loses it for good. How errors are compared: [`super::cells`].

use mcl_core::text::{list, number, p_value};
use mcl_metrics::{Blocked, BlockedRate, one_sample, paired};

use crate::claims::cells::{Cell, INITIALIZATIONS, Sampled, Sizes, compare, log_ratios};
use crate::claims::claim::{
    ALPHA, Claim, Evidence, Finding, Section, Statement, Tested, Untestable, significant,
};

pub(super) const CLAIMS: [fn(&Sampled) -> Claim; 7] =
    [improved, most_on_small, gbs_over_rnd, no_gain, slightly_worse, recovers, diverges_below];

const COLUMN: &str = "weighted";

/// An error that is lower by less than this share is no gain: 2 or 3 mm of the 5 cm by which a
/// tracked robot is off.
const SAME_ERROR: f64 = 0.05;

fn improved(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-improved",
        section: Section::Localization,
        text: "The localization error is in general smaller on improved maps",
        test: "paired t test over draws of ln error, all sizes: improved below initial, p: the \
               larger of both initializations; and the mean error is lower in more than half of \
               the cells",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut lower = 0;
        let (mut p_less, mut p_greater) = (Vec::new(), Vec::new());
        for [kind, improved] in INITIALIZATIONS {
            let before = data.cells(kind, &Sizes::ALL)?;
            let after = data.cells(improved, &Sizes::ALL)?;
            let effect = one_sample(&log_ratios(&after, &before, COLUMN)?)?;
            let of = format!("error on {improved} over that on {kind}");
            tests.push(Tested { p: effect.p_less, effect, of });
            for (after, before) in after.iter().zip(&before) {
                let effect = compare(after, before, COLUMN, 1.0)?;
                lower += usize::from(mean_error(after)? < mean_error(before)?);
                p_less.push(effect.p_less);
                p_greater.push(effect.p_greater);
            }
        }
        let cells = p_less.len();
        let measured = format!(
            "ratio of geometric mean errors: {}; the mean is lower in {lower} of {cells} cells; cell \
             by cell, {} significantly lower, {} higher",
            ratios(&tests),
            significant(&p_less),
            significant(&p_greater)
        );
        let evidence = Tested::weakest(tests).map(Tested::ratio).unwrap_or_default();
        let holds = evidence.p.is_some_and(|p| p < ALPHA) && 2 * lower > cells;
        Ok(Finding { holds, measured, evidence })
    })
}

fn most_on_small(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-most-on-small",
        section: Section::Localization,
        text: "Improved maps gain most where maps are small",
        test: "paired t test over draws of ln(improved error / initial error): below 1 % lower than \
               from 1 % on; p: the larger of both initializations",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut shown = Vec::new();
        for [kind, improved] in INITIALIZATIONS {
            let gain = |sizes: &Sizes| -> Result<Blocked, Untestable> {
                log_ratios(&data.cells(improved, sizes)?, &data.cells(kind, sizes)?, COLUMN)
            };
            let (small, large) = (gain(&Sizes::SMALL)?, gain(&Sizes::NOT_SMALL)?);
            let effect = paired(&small, &large)?;
            let of = format!("error ratio {improved} over {kind} below 1 % over that from 1 % on");
            tests.push(Tested { p: effect.p_less, effect, of });
            let [small, large] = [small, large].map(|gain| number(gain.mean_of_blocks().exp()));
            shown.push(format!("{kind} {small} below 1 %, {large} from 1 % on"));
        }
        let evidence = Tested::weakest(tests).map(Tested::ratio).unwrap_or_default();
        Ok(Finding {
            holds: evidence.p.is_some_and(|p| p < ALPHA),
            measured: format!("ratio of geometric mean errors: {}", shown.join("; ")),
            evidence,
        })
    })
}

fn gbs_over_rnd(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-gbs-over-rnd",
        section: Section::Localization,
        text: "Small grid-based maps are better to localize on than random ones of the same size",
        test: "paired t test over draws of ln error, sizes below 1 %: gbs below rnd",
    };
    statement.decide(&data.place, || {
        let small = |kind| data.cells(kind, &Sizes::SMALL);
        let tested = |grid, random| -> Result<Tested, Untestable> {
            let effect = one_sample(&log_ratios(&small(grid)?, &small(random)?, COLUMN)?)?;
            let of = format!("error on {grid} over that on {random}, below 1 %");
            Ok(Tested { p: effect.p_less, effect, of })
        };
        let [[grid, grid_improved], [random, random_improved]] = INITIALIZATIONS;
        let test = tested(grid, random)?;
        let after = tested(grid_improved, random_improved)?;
        let diverged = |kind| -> Result<_, Untestable> { Ok(rate(&small(kind)?)?.of_units()) };
        let (of_grid, of_random) = (diverged(grid)?, diverged(random)?);
        let measured = format!(
            "ratio of geometric mean errors: {}, after fuzzy k-means {} ({}); diverged in {} against \
             {} of {} runs, after fuzzy k-means in {} against {}",
            ratio(&test),
            ratio(&after),
            p_value(after.p),
            of_grid.hits(),
            of_random.hits(),
            of_grid.trials(),
            diverged(grid_improved)?.hits(),
            diverged(random_improved)?.hits()
        );
        Ok(Finding { holds: test.p < ALPHA, measured, evidence: test.ratio() })
    })
}

fn no_gain(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-no-gain",
        section: Section::Localization,
        text: "Beyond 1 % more points do not always lower the error",
        test: "paired t test over draws of ln error, per kind of map and step from 1 % or more to the \
               next size: above 95 % of the error before; p: the smallest times the number of steps \
               (Bonferroni)",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut without_gain = 0;
        for Step { larger, smaller } in steps_up(data)? {
            let effect = compare(&larger, &smaller, COLUMN, 1.0)?;
            let limit = compare(&larger, &smaller, COLUMN, 1.0 - SAME_ERROR)?;
            without_gain += usize::from(limit.mean_difference > 0.0);
            let of = format!("error on {} over that at {} %", larger.name(), smaller.percent);
            tests.push(Tested { p: limit.p_greater, effect, of });
        }
        tests.sort_by(|a, b| a.effect.mean_difference.total_cmp(&b.effect.mean_difference));
        let ends = match tests.as_slice() {
            [first, .., last] => format!("from {} to {}", ratio(first), ratio(last)),
            ends => ends.iter().map(ratio).collect(),
        };
        let measured = format!(
            "{without_gain} of {} steps gain less than 5 %; ratio of geometric mean errors {ends}",
            tests.len()
        );
        let evidence = Tested::strongest(tests).map(Tested::ratio).unwrap_or_default();
        Ok(Finding { holds: evidence.p.is_some_and(|p| p < ALPHA), measured, evidence })
    })
}

fn slightly_worse(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-slightly-worse",
        section: Section::Localization,
        text: "Beyond 1 % more points in some cases make localization slightly worse",
        test: "paired t test over draws of ln error, per kind of map and step from 1 % or more to the \
               next size: above the error before, p: the smallest times the number of steps \
               (Bonferroni); and after that step the mean error is higher, too",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut higher = 0;
        // Of the step with the smallest p.
        let mut surest: Option<(f64, bool, String)> = None;
        for Step { larger, smaller } in steps_up(data)? {
            let effect = compare(&larger, &smaller, COLUMN, 1.0)?;
            let p = effect.p_greater;
            let (error, before) = (mean_error(&larger)?, mean_error(&smaller)?);
            higher += usize::from(error > before);
            if surest.as_ref().is_none_or(|(smallest, ..)| p < *smallest) {
                let change = format!("{:+.1} %", 100.0 * (error / before - 1.0)).replace('-', "−");
                let (error, before) = (number(error), number(before));
                let (name, size) = (larger.name(), smaller.percent);
                let shown = format!("{name} with {error} against {before} at {size} % ({change})");
                surest = Some((p, error > before, shown));
            }
            let of = format!("error on {} over that at {} %", larger.name(), smaller.percent);
            tests.push(Tested { p, effect, of });
        }
        let (_, is_higher, shown) = surest.unwrap_or_default();
        let measured = format!(
            "the mean error is higher after {higher} of {} steps; the surest is {shown}",
            tests.len()
        );
        let evidence = Tested::strongest(tests).map(Tested::ratio).unwrap_or_default();
        let holds = is_higher && evidence.p.is_some_and(|p| p < ALPHA);
        Ok(Finding { holds, measured, evidence })
    })
}

fn recovers(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-recovers",
        section: Section::Localization,
        text: "From 0.25 % of the points on, the filter is never lost for good",
        test: "no test: holds if no run diverged (ended more than 1 m off)",
    };
    statement.decide(&data.place, || {
        let cells = data.all_cells(&Sizes::NOT_TINY)?.concat();
        let diverged = rate(&cells)?;
        let (runs, interval) = (diverged.of_units(), diverged.interval(0.95)?);
        let mut shown = Vec::new();
        for cell in &cells {
            let runs = rate(std::slice::from_ref(cell))?.of_units();
            if runs.hits() > 0 {
                shown.push(format!("{} of {} on {}", runs.hits(), runs.trials(), cell.name()));
            }
        }
        let shown = if shown.is_empty() { String::new() } else { format!(" ({})", list(&shown)) };
        Ok(Finding {
            holds: runs.hits() == 0,
            measured: format!("{} of {} runs diverged{shown}", runs.hits(), runs.trials()),
            evidence: Evidence {
                p: None,
                effect: Some(runs.hits() as f64 / runs.trials() as f64),
                low: Some(interval.low),
                high: Some(interval.high),
                blocks: Some(diverged.of_blocks().trials() as usize),
                effect_of: Some("share of diverged runs".to_owned()),
            },
        })
    })
}

fn diverges_below(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "localization-diverges-below",
        section: Section::Localization,
        text: "Below 0.25 % of the points the filter diverges in some runs",
        test: "holds if a run diverged; p: paired t test over draws of the share of diverged runs, \
               higher below 0.25 % than from there on",
    };
    statement.decide(&data.place, || {
        let below = data.all_cells(&Sizes::TINY)?.concat();
        let runs = rate(&below)?.of_units();
        let mut measured = format!("{} of {} runs diverged", runs.hits(), runs.trials());
        // Without larger maps there is nothing to compare with, but runs have diverged or not.
        let mut evidence = Evidence::default();
        if let Ok(above) = data.all_cells(&Sizes::NOT_TINY) {
            let above = above.concat();
            let effect = paired(&diverged(&below)?, &diverged(&above)?)?;
            let of = "share of diverged runs below 0.25 % less that from there on".to_owned();
            evidence = Tested { p: effect.p_greater, effect, of }.difference();
            let runs = rate(&above)?.of_units();
            measured += &format!(", from 0.25 % on {} of {}", runs.hits(), runs.trials());
        }
        Ok(Finding { holds: runs.hits() > 0, measured, evidence })
    })
}

/// Two cells of one kind of map, neighbours in size.
struct Step<'a> {
    larger: Cell<'a>,
    smaller: Cell<'a>,
}

/// The steps of all four kinds from 1 % or more to the next size.
fn steps_up<'a>(data: &Sampled<'a>) -> Result<Vec<Step<'a>>, Untestable> {
    data.all_cells(&Sizes::ABOVE_SMALL)?;
    let mut steps = Vec::new();
    for cells in data.all_cells(&Sizes::NOT_SMALL)? {
        let pairs = cells.windows(2);
        steps.extend(pairs.map(|pair| Step { larger: pair[1].clone(), smaller: pair[0].clone() }));
    }
    match steps.is_empty() {
        true => Err(Untestable("there is only one size from 1 % on".to_owned())),
        false => Ok(steps),
    }
}

/// Mean of all runs, as in figure 5.
fn mean_error(cell: &Cell) -> Result<f64, Untestable> {
    Ok(cell.values(COLUMN)?.mean())
}

/// Of every run on these maps 1 if it diverged and 0 if not, by draw.
fn diverged(cells: &[Cell]) -> Result<Blocked, Untestable> {
    let of_cells: Vec<Blocked> =
        cells.iter().map(|cell| cell.values("diverged")).collect::<Result<_, _>>()?;
    Ok(Blocked::new(of_cells.iter().flat_map(Blocked::values))?)
}

/// How often runs on these maps diverged.
fn rate(cells: &[Cell]) -> Result<BlockedRate, Untestable> {
    Ok(BlockedRate::new(diverged(cells)?.values().map(|(draw, hit)| (draw, hit > 0.0)))?)
}

fn ratio(test: &Tested) -> String {
    number(test.effect.mean_difference.exp())
}

/// "gbs 0.87, rnd 0.42"
fn ratios(tests: &[Tested]) -> String {
    let names = INITIALIZATIONS.iter().map(|[kind, _]| kind);
    let named: Vec<String> =
        names.zip(tests).map(|(kind, test)| format!("{kind} {}", ratio(test))).collect();
    named.join(", ")
}

#[cfg(test)]
mod tests {
    use mcl_study::store::results::Results;

    use super::*;
    use crate::claims::claim::Verdict::*;
    use crate::claims::planted;

    const SIZES: [f64; 5] = [0.1, 0.5, 1.0, 2.0, 5.0];

    fn is_improved(kind: &str) -> bool {
        kind.ends_with("+f-km")
    }

    fn is_random(kind: &str) -> bool {
        kind.starts_with("rnd")
    }

    /// What the paper sees.
    fn as_in_the_paper() -> Results {
        planted::localization(&SIZES, |kind, size, run, scatter| {
            let small = size < 1.0;
            let mut error = 0.03 * scatter;
            if small {
                error *= if is_random(kind) { 6.0 } else { 3.0 };
            }
            if is_improved(kind) {
                error *= if small { 0.5 } else { 0.9 };
            }
            if size == 5.0 {
                error *= 1.1;
            }
            // Lost on all maps.
            if size == 0.1 && run == 2 {
                error *= 40.0;
            }
            error
        })
    }

    fn decide(claim: fn(&Sampled) -> Claim, results: &Results) -> Claim {
        claim(&Sampled::of(results, COLUMN, true).unwrap()[0])
    }

    #[test]
    fn the_papers_picture_is_reproduced() {
        let results = as_in_the_paper();
        for claim in CLAIMS.map(|claim| decide(claim, &results)) {
            assert_eq!(claim.verdict, Reproduced, "{claim:?}");
        }
        let claim = decide(slightly_worse, &results);
        assert!(claim.measured.contains(" 5 % with 0.03"), "{}", claim.measured);
        let claim = decide(diverges_below, &results);
        assert_eq!(claim.measured, "4 of 32 runs diverged, from 0.25 % on 0 of 128");
        // Shares of 0, 0, ½ and 0 on four draws: t = 1 with three degrees of freedom.
        let angle = std::f64::consts::FRAC_PI_6;
        let p = 0.5 - (angle + angle.sin() * angle.cos()) / std::f64::consts::PI;
        assert!((claim.evidence.p.unwrap() - p).abs() < 1e-12, "{claim:?}");
        assert!((claim.evidence.effect.unwrap() - 0.125).abs() < 1e-12, "{claim:?}");
        assert_eq!(claim.evidence.blocks, Some(4));
    }

    #[test]
    fn its_opposite_is_not() {
        // Improved maps are worse, most of all small ones; random beats grid-based; more points are
        // always better; the filter is lost on large maps only.
        let results = planted::localization(&SIZES, |kind, size, run, scatter| {
            let mut error = 0.3 / size.sqrt() * scatter;
            if is_improved(kind) {
                error *= if size < 1.0 { 2.0 } else { 1.2 };
            }
            if is_random(kind) {
                error *= 0.5;
            }
            if size == 1.0 && kind == "gbs" && run < 4 {
                error = 5.0;
            }
            error.min(if size < 1.0 { 0.99 } else { 9.0 })
        });
        for claim in CLAIMS.map(|claim| decide(claim, &results)) {
            assert_eq!(claim.verdict, NotReproduced, "{claim:?}");
        }
        let claim = decide(recovers, &results);
        assert_eq!(claim.measured, "4 of 128 runs diverged (4 of 8 on gbs 1 %)");
        assert_eq!((claim.evidence.effect, claim.evidence.blocks), (Some(4.0 / 128.0), Some(4)));
        // As sure as four trials are, not 128.
        assert!(claim.evidence.high.unwrap() > 0.5, "{claim:?}");
    }

    #[test]
    fn chance_is_no_difference() {
        let results = planted::localization(&SIZES, |_, _, _, scatter| 0.03 * scatter);
        for claim in [improved, most_on_small, gbs_over_rnd, slightly_worse] {
            assert_eq!(decide(claim, &results).verdict, NotReproduced);
        }
        // The same error at all sizes surely is no gain of 5 %.
        assert_eq!(decide(no_gain, &results).verdict, Reproduced);
    }

    #[test]
    fn what_is_missing_is_named() {
        let reason = |claim: fn(&Sampled) -> Claim, results: &Results| {
            let claim = decide(claim, results);
            assert_eq!((claim.verdict, claim.evidence.p), (NotTestable, None), "{claim:?}");
            claim.measured
        };
        let large = planted::localization(&[1.0, 2.0], |_, _, _, scatter| 0.03 * scatter);
        assert_eq!(reason(most_on_small, &large), "there are no maps below 1 %, only of 1, 2 %");
        assert_eq!(reason(gbs_over_rnd, &large), "there are no maps below 1 %, only of 1, 2 %");
        assert_eq!(
            reason(diverges_below, &large),
            "there are no maps below 0.25 %, only of 1, 2 %"
        );
        assert_eq!(decide(recovers, &large).verdict, Reproduced);
        let small = planted::localization(&[0.1], |_, _, _, scatter| 2.0 * scatter);
        assert_eq!(reason(recovers, &small), "there are no maps from 0.25 % on, only of 0.1 %");
        assert_eq!(reason(no_gain, &small), "there are no maps above 1 %, only of 0.1 %");
        assert_eq!(reason(slightly_worse, &small), "there are no maps above 1 %, only of 0.1 %");
        let below = decide(diverges_below, &small);
        assert_eq!((below.verdict, below.evidence.p), (Reproduced, None));

        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| row.text("map") != "rnd+f-km");
        assert_eq!(reason(improved, &results), "there is no row of rnd+f-km 0.1 %");
        assert_eq!(reason(recovers, &results), "there is no row of rnd+f-km 0.5 %");
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| row.number("size_percent") != 1.0);
        assert_eq!(reason(no_gain, &results), "there is no row of gbs 1 %");
        let mut results = as_in_the_paper();
        results.done = 0;
        for claim in CLAIMS {
            assert_eq!(reason(claim, &results), "0 of 80 trials are there");
        }
    }
}
