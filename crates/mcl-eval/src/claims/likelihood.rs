//! Section V-A: what fuzzy k-means makes of the likelihood, in nats per point.

use std::collections::BTreeMap;

use mcl_core::text::{list, number};
use mcl_metrics::{Blocked, Effect, one_sample, two_sample};

use crate::claims::cells::{Cell, INITIALIZATIONS, Sampled, Sizes};
use crate::claims::claim::{
    ALPHA, Claim, Finding, Section, Statement, Tested, Untestable, significant,
};

pub(super) const CLAIMS: [fn(&Sampled) -> Claim; 4] =
    [improvement, improvement_shrinks, strategy_above_10, rnd_fkm_below_gbs];

const COLUMN: &str = "log_likelihood";

/// What counts as equally likely, as a share of the range of figure 4: about the width of a line in
/// a figure of 100 line widths' height, in which the paper sees no difference.
const LINE_WIDTH: f64 = 0.01;

fn improvement(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "improvement",
        section: Section::Likelihood,
        text: "Fuzzy k-means raises the likelihood significantly, for both initializations at \
               every size",
        test: "Welch's t test over maps per initialization and size: improved above initial; p: the \
               largest",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut gains = Vec::new();
        let mut failing = Vec::new();
        for [kind, improved] in INITIALIZATIONS {
            let cells = data.cells(improved, &Sizes::ALL)?.into_iter();
            for (improved, initial) in cells.zip(data.cells(kind, &Sizes::ALL)?) {
                let effect = welch(&improved, &initial)?;
                let (p, gain, name) = (effect.p_greater, effect.mean_difference, initial.name());
                if p >= ALPHA {
                    failing.push(format!("{name} ({})", number(gain)));
                }
                let of = format!("nats per point gained on {name}");
                tests.push(Tested { p, effect, of });
                gains.push((gain, name));
            }
        }
        gains.sort_by(|a, b| a.0.total_cmp(&b.0));
        let shown = |gain: Option<&(f64, String)>| {
            gain.map_or(String::new(), |(gain, name)| format!("{} ({name})", number(*gain)))
        };
        let mut measured = format!(
            "{} of {} cells gain significantly; mean gains from {} to {} nats per point",
            tests.len() - failing.len(),
            tests.len(),
            shown(gains.first()),
            shown(gains.last()),
        );
        if !failing.is_empty() {
            measured += &format!("; not: {}", list(&failing));
        }
        let evidence = Tested::weakest(tests).map(Tested::difference).unwrap_or_default();
        Ok(Finding { holds: failing.is_empty(), measured, evidence })
    })
}

fn improvement_shrinks(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "improvement-shrinks",
        section: Section::Likelihood,
        text: "The larger the map, the smaller the improvement",
        test: "t test over draws: the slope of the gain over the logarithm of the size is negative, \
               p: the larger of both initializations; and the mean gain falls from each size to the \
               next",
    };
    statement.decide(&data.place, || {
        let mut tests = Vec::new();
        let mut shown = Vec::new();
        let mut rising = Vec::new();
        for [kind, improved] in INITIALIZATIONS {
            let initial = data.cells(kind, &Sizes::ALL)?;
            let improved = data.cells(improved, &Sizes::ALL)?;
            let gain = |(improved, initial): (&Cell, &Cell)| -> Result<_, Untestable> {
                let gain = improved.values(COLUMN)?.minus(&initial.values(COLUMN)?);
                Ok((initial.percent, gain.map_err(|error| initial.because(error))?))
            };
            let gains: Vec<(f64, Blocked)> =
                improved.iter().zip(&initial).map(gain).collect::<Result<_, _>>()?;
            let (first, last) = match gains.as_slice() {
                [first, .., last] => (first, last),
                _ => return Err(Untestable("all maps have the same size".to_owned())),
            };
            let effect = one_sample(&slopes(&gains)?)?;
            let of = format!("nats per point gained more on {kind} per tenfold size");
            tests.push(Tested { p: effect.p_less, effect, of });
            shown.push(format!(
                "{kind}: mean gain from {} nats per point at {} % to {} at {} %",
                number(first.1.mean()),
                first.0,
                number(last.1.mean()),
                last.0
            ));
            for step in gains.windows(2) {
                if step[1].1.mean() >= step[0].1.mean() {
                    rising.push(format!("{kind} {} to {} %", step[0].0, step[1].0));
                }
            }
        }
        let steps = match rising.is_empty() {
            true => "falls at every step".to_owned(),
            false => format!("does not fall from {}", list(&rising)),
        };
        let holds = rising.is_empty() && tests.iter().all(|test| test.p < ALPHA);
        let evidence = Tested::weakest(tests).map(Tested::difference).unwrap_or_default();
        Ok(Finding { holds, measured: format!("{}; {steps}", shown.join("; ")), evidence })
    })
}

/// The slope of a value over lg size by least squares, of every block that has two sizes or more.
fn slopes(values: &[(f64, Blocked)]) -> Result<Blocked, Untestable> {
    let mut blocks: BTreeMap<u64, Vec<(f64, f64)>> = BTreeMap::new();
    for (size, values) in values {
        for &(block, value) in values.block_means() {
            blocks.entry(block).or_default().push((size.log10(), value));
        }
    }
    let slope = |(block, points): (u64, Vec<(f64, f64)>)| {
        let count = points.len() as f64;
        let mean_x = points.iter().map(|point| point.0).sum::<f64>() / count;
        let products = points.iter().map(|(x, y)| (x - mean_x) * y).sum::<f64>();
        let squares = points.iter().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>();
        (points.len() > 1).then_some((block, products / squares))
    };
    Ok(Blocked::new(blocks.into_iter().filter_map(slope))?)
}

fn strategy_above_10(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "strategy-above-10",
        section: Section::Likelihood,
        text: "Above 10 % of the points it hardly matters how they were chosen",
        test: "equivalence (two one-sided Welch tests) of each two of the four kinds of map at each \
               size above 10 %, within 1 % of the range of mean likelihoods from 0.25 % on; p: the \
               largest",
    };
    statement.decide(&data.place, || {
        let large = data.all_cells(&Sizes::LARGE)?;
        // Still smaller random maps are so unlikely that beside them nothing else would matter.
        let in_figure = data.all_cells(&Sizes::NOT_TINY)?.concat();
        let means: Vec<f64> = in_figure
            .iter()
            .map(|cell| Ok(cell.values(COLUMN)?.mean()))
            .collect::<Result<_, Untestable>>()?;
        let lowest = means.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = means.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let margin = LINE_WIDTH * (highest - lowest);
        let mut tests = Vec::new();
        for (index, kind) in large.iter().enumerate() {
            for other in &large[index + 1..] {
                for (a, b) in kind.iter().zip(other) {
                    let effect = welch(a, b)?;
                    let p = effect.equivalence_p(margin)?;
                    let of = format!("{} and {} at {} %", a.kind, b.kind, a.percent);
                    tests.push(Tested { p, effect, of });
                }
            }
        }
        let size = |test: &&Tested| test.effect.mean_difference.abs();
        let furthest = tests.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
        let furthest = furthest.map_or(String::new(), |test| {
            format!("{} nats per point ({})", number(size(&test)), test.of)
        });
        let differing: Vec<f64> = tests.iter().map(|test| test.effect.p_two_sided).collect();
        let measured = format!(
            "largest difference {furthest}, margin {}; nevertheless {} of {} pairs differ \
             significantly",
            number(margin),
            significant(&differing),
            tests.len()
        );
        let holds = tests.iter().all(|test| test.p < ALPHA);
        let in_nats =
            |test: Tested| Tested { of: format!("nats per point between {}", test.of), ..test };
        let evidence = Tested::weakest(tests).map(|test| in_nats(test).difference());
        Ok(Finding { holds, measured, evidence: evidence.unwrap_or_default() })
    })
}

fn rnd_fkm_below_gbs(data: &Sampled) -> Claim {
    let statement = Statement {
        id: "rnd-fkm-below-gbs",
        section: Section::Likelihood,
        text: "Improved random maps are sometimes less likely than grid-based maps of the same \
               size that were not improved",
        test: "Welch's t test over maps per size: rnd+f-km below gbs; p: the smallest times the \
               number of sizes (Bonferroni)",
    };
    statement.decide(&data.place, || {
        let random = data.cells("rnd+f-km", &Sizes::ALL)?;
        let mut tests = Vec::new();
        let mut below = Vec::new();
        let (mut pairs, mut pairs_below) = (0, 0);
        for (random, grid) in random.iter().zip(&data.cells("gbs", &Sizes::ALL)?) {
            let effect = welch(random, grid)?;
            let (size, difference) = (grid.percent, effect.mean_difference);
            if difference < 0.0 {
                below.push(format!("{size} % (by {})", number(-difference)));
            }
            let of = format!("nats per point from gbs to rnd+f-km at {size} %");
            tests.push(Tested { p: effect.p_less, effect, of });
            let (random, grid) = (random.values(COLUMN)?, grid.values(COLUMN)?);
            for (_, random) in random.block_means() {
                pairs += grid.blocks();
                pairs_below += grid.block_means().iter().filter(|(_, grid)| random < grid).count();
            }
        }
        let shown = match below.is_empty() {
            true => String::new(),
            false => format!(": {}, nats per point", list(&below)),
        };
        let measured = format!(
            "the mean is lower at {} of {} sizes{shown}; of all pairs of one map each, the random \
             one is less likely in {:.1} %",
            below.len(),
            tests.len(),
            100.0 * pairs_below as f64 / pairs as f64
        );
        let evidence = Tested::strongest(tests).map(Tested::difference).unwrap_or_default();
        Ok(Finding { holds: evidence.p.is_some_and(|p| p < ALPHA), measured, evidence })
    })
}

/// The paper's two-sample t test: a sample is a map.
fn welch(a: &Cell, b: &Cell) -> Result<Effect, Untestable> {
    two_sample(&a.values(COLUMN)?, &b.values(COLUMN)?).map_err(|error| a.because(error))
}

#[cfg(test)]
mod tests {
    use mcl_study::store::results::Results;

    use super::*;
    use crate::claims::claim::Verdict::{self, *};
    use crate::claims::planted;

    const SIZES: [f64; 4] = [1.0, 5.0, 20.0, 50.0];

    /// What the paper sees: gains that fall with the size, random maps far below, no difference in
    /// the end.
    fn as_in_the_paper() -> Results {
        planted::likelihood(&SIZES, |is_random, size, scatter| {
            let random = if is_random { 100.0 / (size * size) } else { 0.0 };
            let initial = -4.0 - 20.0 / size - 2.0 * random + 0.01 * scatter;
            (initial, initial + 1.0 / size + 0.9 * random)
        })
    }

    fn decide(claim: fn(&Sampled) -> Claim, results: &Results) -> Claim {
        claim(&Sampled::of(results, COLUMN, false).unwrap()[0])
    }

    fn verdicts(results: &Results) -> [Verdict; 4] {
        CLAIMS.map(|claim| decide(claim, results).verdict)
    }

    #[test]
    fn the_papers_picture_is_reproduced() {
        let results = as_in_the_paper();
        assert_eq!(verdicts(&results), [Reproduced; 4]);
        for claim in CLAIMS.map(|claim| decide(claim, &results)) {
            assert!(claim.evidence.p.is_some_and(|p| p < ALPHA), "{claim:?}");
        }
    }

    #[test]
    fn its_opposite_is_not() {
        // Gains that grow, kinds that part at large sizes, random maps above grid-based ones.
        let results = planted::likelihood(&SIZES, |is_random, size, scatter| {
            let random = if is_random { 1.0 } else { 0.0 };
            let initial = -10.0 + random + 0.01 * scatter;
            (initial, initial + 0.05 * size)
        });
        assert_eq!(verdicts(&results)[1..], [NotReproduced; 3]);
        assert_eq!(decide(improvement, &results).verdict, Reproduced);
    }

    #[test]
    fn tiny_maps_do_not_widen_the_margin() {
        // At 20 % kinds differ by 0.3: more than 1 % of the range above 0.25 %, less than that of all.
        let results = planted::likelihood(&[0.1, 1.0, 20.0], |is_random, size, scatter| {
            let random = if is_random && size == 20.0 { 0.3 } else { 0.0 };
            let initial = -4.0 - 20.0 / (size * size) + random + 0.01 * scatter;
            (initial, initial)
        });
        let claim = decide(strategy_above_10, &results);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.measured.contains("difference 0.300"), "{}", claim.measured);
        assert!(claim.measured.contains("margin 0.203"), "{}", claim.measured);
    }

    #[test]
    fn one_cell_without_a_gain_is_enough() {
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| {
            if row.text("map") == "rnd+f-km" && row.number("size_percent") == 50.0 {
                let improvement = 1.0 / 50.0 + 0.9 * 100.0 / 2500.0;
                row.set(COLUMN, row.number(COLUMN) - improvement - 0.001);
            }
            true
        });
        let claim = decide(improvement, &results);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.evidence.p.unwrap() > 0.5);
        assert!((claim.evidence.effect.unwrap() + 0.001).abs() < 1e-9, "{claim:?}");
        assert_eq!(claim.evidence.blocks, Some(5));
        assert!(claim.measured.contains("7 of 8"), "{}", claim.measured);
        assert!(claim.measured.contains("not: rnd 50 % (−0.00100)"), "{}", claim.measured);
    }

    #[test]
    fn a_gain_that_falls_only_mostly_is_reported() {
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| {
            if row.text("map") == "gbs+f-km" && row.number("size_percent") == 20.0 {
                row.set(COLUMN, row.number(COLUMN) + 0.3);
            }
            true
        });
        let claim = decide(improvement_shrinks, &results);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.measured.contains("does not fall from gbs 5 to 20 %"), "{}", claim.measured);
    }

    /// By hand: lg sizes 0, 1, 2 with values 5, 3, 1, and 0, 1 with 4, 1.
    #[test]
    fn slopes_are_per_tenfold_size_and_draw() {
        let values = [
            (1.0, Blocked::new([(0, 5.0), (1, 4.0), (2, 9.0)]).unwrap()),
            (10.0, Blocked::new([(0, 3.0), (1, 1.0)]).unwrap()),
            (100.0, Blocked::new([(0, 1.0)]).unwrap()),
        ];
        let found = slopes(&values).unwrap();
        assert_eq!(found.block_means(), [(0, -2.0), (1, -3.0)]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let reason = |results: &Results| {
            assert_eq!(verdicts(results), [NotTestable; 4]);
            decide(improvement, results).measured
        };
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| {
            !row.text("map").starts_with("rnd") || row.number("size_percent") != 20.0
        });
        assert_eq!(reason(&results), "there is no row of rnd+f-km 20 %");
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| {
            row.number("size_percent") != 20.0 || row.number("draw") == 0.0
        });
        assert!(verdicts(&results).contains(&NotTestable));
        assert_eq!(
            decide(improvement, &results).measured,
            "gbs+f-km 20 %: too few to tell: 1 independent block, at least 2 needed"
        );
        results.done = 3;
        assert_eq!(reason(&results), "3 of 80 trials are there");
        let small = planted::likelihood(&[1.0], |_, _, scatter| {
            (-5.0 + 0.1 * scatter, -4.0 + 0.1 * scatter)
        });
        assert_eq!(decide(improvement, &small).verdict, Reproduced);
        assert_eq!(verdicts(&small)[1..], [NotTestable, NotTestable, NotReproduced]);
    }
}
