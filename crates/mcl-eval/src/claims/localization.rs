//! Section V-B: the localization error, by equation 7's weighted error, and divergence of the filter. How
//! errors are compared: [`crate::claims::cells`].

use mcl_core::math;
use mcl_core::text::{list, number, numbers, p_value};
use mcl_metrics::{Blocked, BlockedRate, Interval, one_sample, paired};
use mcl_study::study::views::{INITIALIZATIONS, TestKind};

use crate::claims::cells::{Cell, Sampled, SampledTest, Sizes, log_ratios};
use crate::claims::claim::{
    EffectKind, Evidence, Finding, Outcome, Test, Tested, Untestable, significant,
};

pub(super) const CLAIMS: [SampledTest; 7] = [
    Test {
        id: "localization-improved",
        short: "f-km lowers the localization error",
        section: "V-B",
        statement: "The localization error is in general smaller on improved maps",
        test: "paired t test over draws of ln error, all sizes: improved below initial, p: the \
                   larger of both initializations; and the mean error is lower in more than half of \
                   the cells",
        decide: improved,
    },
    Test {
        id: "localization-most-on-small",
        short: "f-km helps small maps most",
        section: "V-B",
        statement: "Improved maps gain most where maps are small",
        test: "paired t test over draws of ln(improved error / initial error): below 1 % lower \
                   than from 1 % on; p: the larger of both initializations",
        decide: most_on_small,
    },
    Test {
        id: "localization-gbs-over-rnd",
        short: "small gbs better than small rnd",
        section: "V-B",
        statement: "Small grid-based maps are better to localize on than random ones of the same size",
        test: "paired t test over draws of ln error, sizes below 1 %: gbs below rnd",
        decide: gbs_over_rnd,
    },
    Test {
        id: "localization-no-gain",
        short: "beyond 1 % more points may not help",
        section: "V-B",
        statement: "Beyond 1 % more points do not always lower the error",
        test: "paired t test over draws of ln error, per kind of map and step from 1 % or more to \
                   the next size: above 95 % of the error before; p: the smallest times the number of \
                   steps (Bonferroni)",
        decide: no_gain,
    },
    Test {
        id: "localization-slightly-worse",
        short: "beyond 1 % more may be slightly worse",
        section: "V-B",
        statement: "Beyond 1 % more points in some cases make localization slightly worse",
        test: "paired t test over draws of ln error, per kind of map and step from 1 % or more to \
                   the next size: above the error before, p: the smallest times the number of steps \
                   (Bonferroni); and after that step the mean error is higher, too",
        decide: slightly_worse,
    },
    Test {
        id: "localization-recovers",
        short: "from 0.25 % on no run is lost for good",
        section: "V-B",
        statement: "From 0.25 % of the points on, the filter is never lost for good",
        test: "no test: holds if no run diverged (ended more than 1 m off)",
        decide: recovers,
    },
    Test {
        id: "localization-diverges-below",
        short: "below 0.25 % some runs diverge",
        section: "V-B",
        statement: "Below 0.25 % of the points the filter diverges in some runs",
        test: "holds if a run diverged; p: paired t test over draws of the share of diverged \
                   runs, higher below 0.25 % than from there on",
        decide: diverges_below,
    },
];

const COLUMN: &str = "weighted";

const ERROR_RATIO: EffectKind = EffectKind::Ratio("error ratio");

/// A reduction of the error by less than this share is not a gain: it is 2 or 3 mm of the 5 cm error of a
/// tracked robot.
const SAME_ERROR: f64 = 0.05;

fn improved(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    let mut cells = Vec::new();
    let mut lower = 0;
    for [kind, improved] in INITIALIZATIONS {
        let pairs = data.pairs(improved, kind, &Sizes::ALL)?;
        tests.push(pooled(&pairs, format!("{improved} over {kind}"))?);
        for [after, before] in &pairs {
            lower += usize::from(mean_error(after)? < mean_error(before)?);
            cells.push(compare(after, before)?.effect);
        }
    }
    let measured = format!(
        "ratio of geometric mean errors: {}; the mean is lower in {lower} of {} cells; cell by cell, \
         {} significantly lower, {} higher",
        tests.iter().map(ratio).collect::<Vec<String>>().join(", "),
        cells.len(),
        significant(cells.iter().map(|effect| effect.p_less)),
        significant(cells.iter().map(|effect| effect.p_greater))
    );
    let (is_lower, evidence) = Tested::all(&tests, ERROR_RATIO);
    Ok(Finding { holds: is_lower && 2 * lower > cells.len(), measured, evidence })
}

fn most_on_small(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    let mut shown = Vec::new();
    for [kind, improved] in INITIALIZATIONS {
        let gain = |sizes: &Sizes| -> Result<Blocked, Untestable> {
            log_ratios(&data.pairs(improved, kind, sizes)?, COLUMN)
        };
        let (small, large) = (gain(&Sizes::SMALL)?, gain(&Sizes::NOT_SMALL)?);
        let effect = paired(&small, &large)?;
        let of = format!("{improved} over {kind}, below 1 % over from 1 % on");
        tests.push(Tested { p: effect.p_less, effect, of });
        let [small, large] = [small, large].map(|gain| number(math::exp(gain.mean_of_blocks())));
        shown.push(format!("{improved} over {kind} {small} below 1 %, {large} from 1 % on"));
    }
    let measured = format!("ratio of geometric mean errors: {}", shown.join("; "));
    let (holds, evidence) = Tested::all(&tests, EffectKind::Ratio("ratio of error ratios"));
    Ok(Finding { holds, measured, evidence })
}

fn gbs_over_rnd(data: &Sampled) -> Outcome {
    let [[grid, grid_improved], [random, random_improved]] = INITIALIZATIONS;
    let tested =
        |a, b| pooled(&data.pairs(a, b, &Sizes::SMALL)?, format!("{a} over {b}, below 1 %"));
    let (test, after) = (tested(grid, random)?, tested(grid_improved, random_improved)?);
    let diverged = |kind| -> Result<String, Untestable> {
        Ok(hits(&rate(&data.cells(kind, &Sizes::SMALL)?)?))
    };
    let measured = format!(
        "ratio of geometric mean errors: {}; {} ({}); runs diverged: {grid} {}, {random} {}, \
         {grid_improved} {}, {random_improved} {}",
        ratio(&test),
        ratio(&after),
        p_value(after.p),
        diverged(grid)?,
        diverged(random)?,
        diverged(grid_improved)?,
        diverged(random_improved)?
    );
    let (holds, evidence) = Tested::all(&[test], ERROR_RATIO);
    Ok(Finding { holds, measured, evidence })
}

fn no_gain(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    let limit = math::ln(1.0 - SAME_ERROR);
    for step in steps_up(data)? {
        let above = log_ratios(std::slice::from_ref(&step), COLUMN)?.map(|log| log - limit)?;
        let p = one_sample(&above)?.p_greater;
        tests.push(Tested { p, ..compare(&step[0], &step[1])? });
    }
    tests.sort_by(|a, b| a.effect.mean_difference.total_cmp(&b.effect.mean_difference));
    let without = tests.iter().filter(|test| test.effect.mean_difference > limit).count();
    let [least, most] = [tests.first(), tests.last()].map(|t| t.map(ratio).unwrap_or_default());
    let measured = format!(
        "{without} of {} steps gain less than 5 %; ratios of geometric mean errors from {least} to \
         {most}",
        tests.len()
    );
    let (holds, evidence) = Tested::any(&tests, ERROR_RATIO);
    Ok(Finding { holds, measured, evidence })
}

fn slightly_worse(data: &Sampled) -> Outcome {
    let steps = steps_up(data)?;
    let mut tests = Vec::new();
    let mut rises = Vec::new();
    for [larger, smaller] in &steps {
        let test = compare(larger, smaller)?;
        tests.push(Tested { p: test.effect.p_greater, ..test });
        rises.push((mean_error(smaller)?, mean_error(larger)?));
    }
    let higher = rises.iter().filter(|(before, error)| error > before).count();
    let surest = Tested::strongest(&tests).unwrap_or_default();
    let (before, error) = rises[surest];
    let measured = format!(
        "the mean error is higher after {higher} of {} steps; the surest is {} with {}",
        tests.len(),
        tests[surest].of,
        numbers(&[error, before]).join(" against ")
    );
    let (is_worse, evidence) = Tested::any(&tests, ERROR_RATIO);
    Ok(Finding { holds: is_worse && error > before, measured, evidence })
}

fn recovers(data: &Sampled) -> Outcome {
    let cells = data.all_cells(&Sizes::NOT_TINY)?.concat();
    let diverged = rate(&cells)?;
    let (runs, interval) = (diverged.of_units(), diverged.interval(0.95)?);
    let smallest = cells.iter().map(|cell| cell.percent).fold(f64::INFINITY, f64::min);
    let (mut lost, mut on_smallest) = (Vec::new(), Vec::new());
    for cell in &cells {
        let diverged = rate(std::slice::from_ref(cell))?;
        let hits = hits(&diverged);
        if diverged.of_units().hits() > 0 {
            lost.push(format!("{hits} on {}", cell.name()));
        }
        if cell.percent == smallest {
            let Interval { low, high } = diverged.interval(0.95)?;
            let share = format!("{} {hits} ({} to {})", cell.kind, number(low), number(high));
            on_smallest.push(share);
        }
    }
    let mut measured = format!("{} runs diverged", hits(&diverged));
    if !lost.is_empty() {
        measured += &format!(" ({})", list(&lost));
    }
    measured += &format!("; on {smallest} %: {}", on_smallest.join(", "));
    let evidence = Evidence {
        p: None,
        effect: Some(runs.hits() as f64 / runs.trials() as f64),
        low: Some(interval.low),
        high: Some(interval.high),
        blocks: Some(diverged.of_blocks().trials() as usize),
        effect_of: Some("share of diverged runs".to_owned()),
    };
    Ok(Finding { holds: runs.hits() == 0, measured, evidence })
}

fn diverges_below(data: &Sampled) -> Outcome {
    let below = data.all_cells(&Sizes::TINY)?.concat();
    let runs = rate(&below)?;
    let mut measured = format!("{} runs diverged", hits(&runs));
    // Without larger maps there is nothing to compare with, but whether runs diverged is still known.
    let mut evidence = Evidence::default();
    if let Ok(above) = data.all_cells(&Sizes::NOT_TINY) {
        let above = above.concat();
        let effect = paired(&diverged(&below)?, &diverged(&above)?)?;
        let of = "below 0.25 % less that from there on".to_owned();
        let test = Tested { p: effect.p_greater, effect, of };
        evidence = Tested::all(&[test], EffectKind::Difference("share of diverged runs")).1;
        measured += &format!(", from 0.25 % on {}", hits(&rate(&above)?));
    }
    Ok(Finding { holds: runs.of_units().hits() > 0, measured, evidence })
}

/// Tests whether errors in the first cell of each pair are below those in the second, all sizes together.
fn pooled(pairs: &[[Cell; 2]], of: String) -> Result<Tested, Untestable> {
    let effect = one_sample(&log_ratios(pairs, COLUMN)?)?;
    Ok(Tested { p: effect.p_less, effect, of })
}

/// Compares the errors in two cells; p is two-sided.
fn compare(a: &Cell, b: &Cell) -> Result<Tested, Untestable> {
    let effect = a.against(b, COLUMN, TestKind::Paired, true)?;
    Ok(Tested { p: effect.p_two_sided, effect, of: format!("{} over {}", a.name(), b.name()) })
}

/// Steps from 1 % or more to the next size: the cells of one kind of map after and before, for all four
/// kinds.
fn steps_up<'a>(data: &Sampled<'a>) -> Result<Vec<[Cell<'a>; 2]>, Untestable> {
    data.all_cells(&Sizes::ABOVE_SMALL)?;
    let mut steps = Vec::new();
    for cells in data.all_cells(&Sizes::NOT_SMALL)? {
        steps.extend(cells.windows(2).map(|pair| [pair[1].clone(), pair[0].clone()]));
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

/// For every run on these maps 1 if it diverged and 0 if not, by draw.
fn diverged(cells: &[Cell]) -> Result<Blocked, Untestable> {
    let of_cells = cells.iter().map(|cell| cell.values("diverged"));
    let of_cells = of_cells.collect::<Result<Vec<Blocked>, Untestable>>()?;
    Ok(Blocked::new(of_cells.iter().flat_map(Blocked::values))?)
}

/// How often runs on these maps diverged.
fn rate(cells: &[Cell]) -> Result<BlockedRate, Untestable> {
    Ok(BlockedRate::new(diverged(cells)?.values().map(|(draw, hit)| (draw, hit > 0.0)))?)
}

/// "3 of 20"
fn hits(rate: &BlockedRate) -> String {
    format!("{} of {}", rate.of_units().hits(), rate.of_units().trials())
}

/// "gbs+f-km over gbs 0.87"
fn ratio(test: &Tested) -> String {
    format!("{} {}", test.of, number(math::exp(test.effect.mean_difference)))
}

#[cfg(test)]
mod tests {
    use mcl_study::store::results::Results;

    use super::*;
    use crate::claims::claim::Claim;
    use crate::claims::claim::Verdict::*;
    use crate::claims::planted;

    const SIZES: [f64; 5] = [0.1, 0.5, 1.0, 2.0, 5.0];

    fn is_improved(kind: &str) -> bool {
        kind.ends_with("+f-km")
    }

    fn is_random(kind: &str) -> bool {
        kind.starts_with("rnd")
    }

    /// Data as in the paper.
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

    fn claims(results: &Results) -> Vec<Claim> {
        Sampled::of(results, COLUMN, true).unwrap()[0].claims(&CLAIMS)
    }

    fn find(results: &Results, id: &str) -> Claim {
        let id = format!("localization-{id}");
        claims(results).into_iter().find(|claim| claim.id == id).unwrap()
    }

    #[test]
    fn the_papers_picture_is_reproduced() {
        let results = as_in_the_paper();
        for claim in claims(&results) {
            assert_eq!(claim.verdict, Reproduced, "{claim:?}");
        }
        let claim = find(&results, "slightly-worse");
        assert!(claim.measured.contains(" 2 % with 0.0297 against 0.0270"), "{}", claim.measured);
        let claim = find(&results, "diverges-below");
        assert_eq!(claim.measured, "4 of 32 runs diverged, from 0.25 % on 0 of 128");
        // Shares of 0, 0, ½ and 0 on four draws: t = 1 with three degrees of freedom.
        let angle = std::f64::consts::FRAC_PI_6;
        let p = 0.5 - (angle + angle.sin() * angle.cos()) / std::f64::consts::PI;
        assert!((claim.evidence.p.unwrap() - p).abs() < 1e-12, "{claim:?}");
        assert!((claim.evidence.effect.unwrap() - 0.125).abs() < 1e-12, "{claim:?}");
        assert_eq!(claim.evidence.blocks, Some(4));
    }

    #[test]
    fn the_opposite_is_not_reproduced() {
        // Refined maps are worse, most of all small ones; random beats grid-based; more points are always
        // better; the filter is lost on large maps only.
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
        for claim in claims(&results) {
            assert_eq!(claim.verdict, NotReproduced, "{claim:?}");
        }
        let claim = find(&results, "recovers");
        let none = "0 of 8 (0 to 0.602)";
        let expected = format!(
            "4 of 128 runs diverged (4 of 8 on gbs 1 %); on 0.5 %: gbs {none}, gbs+f-km {none}, rnd \
             {none}, rnd+f-km {none}"
        );
        assert_eq!(claim.measured, expected);
        assert_eq!((claim.evidence.effect, claim.evidence.blocks), (Some(4.0 / 128.0), Some(4)));
        // The uncertainty is that of four trials, not of 128.
        assert!(claim.evidence.high.unwrap() > 0.5, "{claim:?}");
    }

    #[test]
    fn chance_is_no_difference() {
        let results = planted::localization(&SIZES, |_, _, _, scatter| 0.03 * scatter);
        for id in ["improved", "most-on-small", "gbs-over-rnd", "slightly-worse"] {
            assert_eq!(find(&results, id).verdict, NotReproduced);
        }
        // The same error at all sizes is not a gain of 5 %.
        assert_eq!(find(&results, "no-gain").verdict, Reproduced);
    }

    #[test]
    fn what_is_missing_is_named() {
        let reason = |results: &Results, id: &str| {
            let claim = find(results, id);
            assert_eq!((claim.verdict, claim.evidence.p), (NotTestable, None), "{claim:?}");
            claim.measured
        };
        let large = planted::localization(&[1.0, 2.0], |_, _, _, scatter| 0.03 * scatter);
        assert_eq!(reason(&large, "most-on-small"), "there are no maps below 1 %, only of 1, 2 %");
        assert_eq!(reason(&large, "gbs-over-rnd"), "there are no maps below 1 %, only of 1, 2 %");
        assert_eq!(
            reason(&large, "diverges-below"),
            "there are no maps below 0.25 %, only of 1, 2 %"
        );
        assert_eq!(find(&large, "recovers").verdict, Reproduced);
        let small = planted::localization(&[0.1], |_, _, _, scatter| 2.0 * scatter);
        assert_eq!(reason(&small, "recovers"), "there are no maps from 0.25 % on, only of 0.1 %");
        assert_eq!(reason(&small, "no-gain"), "there are no maps above 1 %, only of 0.1 %");
        assert_eq!(reason(&small, "slightly-worse"), "there are no maps above 1 %, only of 0.1 %");
        let below = find(&small, "diverges-below");
        assert_eq!((below.verdict, below.evidence.p), (Reproduced, None));
    }
}
