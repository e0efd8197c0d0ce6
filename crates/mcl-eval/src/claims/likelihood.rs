//! Section V-A: the effect of fuzzy k-means on the likelihood, in nats per point.

use std::collections::BTreeMap;

use mcl_core::math;
use mcl_core::text::{list, number};
use mcl_metrics::{Blocked, one_sample};
use mcl_study::study::views::{INITIALIZATIONS, TestKind};

use crate::claims::cells::{Cell, Sampled, SampledTest, Sizes, kinds};
use crate::claims::claim::{
    ALPHA, EffectKind, Finding, Outcome, Test, Tested, Untestable, significant,
};

pub(super) const CLAIMS: [SampledTest; 4] = [
    Test {
        id: "improvement",
        short: "f-km makes every map likelier",
        section: "V-A",
        statement: "Fuzzy k-means raises the likelihood significantly, for both initializations at \
                   every size",
        test: "Welch's t test over maps per initialization and size: improved above initial; p: \
                   the largest",
        decide: improvement,
    },
    Test {
        id: "improvement-shrinks",
        short: "f-km gains less on larger maps",
        section: "V-A",
        statement: "The larger the map, the smaller the improvement",
        test: "t test over draws: the slope of the gain over the logarithm of the size is \
                   negative, p: the larger of both initializations; and the mean gain falls from \
                   each size to the next",
        decide: improvement_shrinks,
    },
    Test {
        id: "strategy-above-10",
        short: "above 10 % the sampling hardly matters",
        section: "V-A",
        statement: "Above 10 % of the points it hardly matters how they were chosen",
        test: "equivalence (two one-sided Welch tests) of each two of the four kinds of map at \
                   each size above 10 %, within 1 % of the range of mean likelihoods from 0.25 % on; \
                   p: the largest",
        decide: strategy_above_10,
    },
    Test {
        id: "rnd-fkm-below-gbs",
        short: "some rnd+f-km less likely than gbs",
        section: "V-A",
        statement: "Improved random maps are sometimes less likely than grid-based maps of the same \
                   size that were not improved",
        test: "Welch's t test over maps per size: rnd+f-km below gbs; p: the smallest times the \
                   number of sizes (Bonferroni)",
        decide: rnd_fkm_below_gbs,
    },
];

const COLUMN: &str = "log_likelihood";

/// What counts as equally likely, as a share of the range of figure 4: about the width of a line in
/// a figure of 100 line widths' height, in which the paper sees no difference.
const LINE_WIDTH: f64 = 0.01;

fn improvement(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    for [kind, improved] in INITIALIZATIONS {
        for [improved, initial] in data.pairs(improved, kind, &Sizes::ALL)? {
            let test = welch(&improved, &initial)?;
            tests.push(Tested { p: test.effect.p_greater, of: initial.name(), ..test });
        }
    }
    tests.sort_by(|a, b| a.effect.mean_difference.total_cmp(&b.effect.mean_difference));
    let gain = |test: &Tested| format!("{} ({})", test.of, number(test.effect.mean_difference));
    let failing: Vec<String> = tests.iter().filter(|test| test.p >= ALPHA).map(gain).collect();
    let [least, most] = [tests.first(), tests.last()].map(|t| t.map(gain).unwrap_or_default());
    let mut measured = format!(
        "{} of {} cells gain significantly; mean gains (nats per point) from {least} to {most}",
        tests.len() - failing.len(),
        tests.len()
    );
    if !failing.is_empty() {
        measured += &format!("; not: {}", list(&failing));
    }
    let (holds, evidence) = Tested::all(&tests, EffectKind::Difference("nats per point gained on"));
    Ok(Finding { holds, measured, evidence })
}

fn improvement_shrinks(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    let mut shown = Vec::new();
    let mut rising = Vec::new();
    for [kind, improved] in INITIALIZATIONS {
        let pairs = data.pairs(improved, kind, &Sizes::ALL)?;
        let gain = |[improved, initial]: &[Cell; 2]| -> Result<_, Untestable> {
            let gain = improved.values(COLUMN)?.minus(&initial.values(COLUMN)?);
            Ok((initial.percent, gain.map_err(|error| initial.because(error))?))
        };
        let gains = pairs.iter().map(gain).collect::<Result<Vec<(f64, Blocked)>, _>>()?;
        let [(smallest, first), .., (largest, last)] = gains.as_slice() else {
            return Err(Untestable("all maps have the same size".to_owned()));
        };
        let effect = one_sample(&slopes(&gains)?)?;
        tests.push(Tested { p: effect.p_less, effect, of: kind.to_owned() });
        let [first, last] = [first, last].map(|gain| number(gain.mean()));
        shown.push(format!("{kind} from {first} at {smallest} % to {last} at {largest} %"));
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
    let measured = format!("the mean gain (nats per point) of {} {steps}", shown.join(", of "));
    let unit = "nats per point gained more per tenfold size, on";
    let (falls, evidence) = Tested::all(&tests, EffectKind::Difference(unit));
    Ok(Finding { holds: falls && rising.is_empty(), measured, evidence })
}

/// The least-squares slope of a value over lg size, for every block with at least two sizes.
fn slopes(values: &[(f64, Blocked)]) -> Result<Blocked, Untestable> {
    let mut blocks: BTreeMap<u64, Vec<(f64, f64)>> = BTreeMap::new();
    for (size, values) in values {
        for &(block, value) in values.block_means() {
            blocks.entry(block).or_default().push((math::log10(*size), value));
        }
    }
    let slope = |(block, points): (u64, Vec<(f64, f64)>)| {
        let mean = points.iter().map(|point| point.0).sum::<f64>() / points.len() as f64;
        let products = points.iter().map(|(x, y)| (x - mean) * y).sum::<f64>();
        let squares = points.iter().map(|(x, _)| math::square(x - mean)).sum::<f64>();
        (points.len() > 1).then_some((block, products / squares))
    };
    Ok(Blocked::new(blocks.into_iter().filter_map(slope))?)
}

fn strategy_above_10(data: &Sampled) -> Outcome {
    // Even smaller random maps are so unlikely that they would dominate everything else.
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for cell in data.all_cells(&Sizes::NOT_TINY)?.concat() {
        let mean = cell.values(COLUMN)?.mean();
        (lowest, highest) = (lowest.min(mean), highest.max(mean));
    }
    let margin = LINE_WIDTH * (highest - lowest);
    let mut tests = Vec::new();
    for (index, kind) in kinds().enumerate() {
        for other in kinds().skip(index + 1) {
            for [a, b] in data.pairs(kind, other, &Sizes::LARGE)? {
                let test = welch(&a, &b)?;
                tests.push(Tested { p: test.effect.equivalence_p(margin)?, ..test });
            }
        }
    }
    let size = |test: &Tested| test.effect.mean_difference.abs();
    let furthest = tests.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
    let furthest = furthest.map_or(String::new(), |t| format!("{} ({})", number(size(t)), t.of));
    let measured = format!(
        "largest difference {furthest}, margin {} nats per point; nevertheless {} of {} pairs differ \
         significantly",
        number(margin),
        significant(tests.iter().map(|test| test.effect.p_two_sided)),
        tests.len()
    );
    let (holds, evidence) = Tested::all(&tests, EffectKind::Difference("nats per point of"));
    Ok(Finding { holds, measured, evidence })
}

fn rnd_fkm_below_gbs(data: &Sampled) -> Outcome {
    let mut tests = Vec::new();
    let mut below = Vec::new();
    for [random, grid] in data.pairs("rnd+f-km", "gbs", &Sizes::ALL)? {
        let test = welch(&random, &grid)?;
        let difference = test.effect.mean_difference;
        if difference < 0.0 {
            below.push(format!("{} % (by {})", grid.percent, number(-difference)));
        }
        tests.push(Tested { p: test.effect.p_less, ..test });
    }
    let mut measured = format!("the mean is lower at {} of {} sizes", below.len(), tests.len());
    if !below.is_empty() {
        measured += &format!(": {}, nats per point", list(&below));
    }
    let (holds, evidence) = Tested::any(&tests, EffectKind::Difference("nats per point of"));
    Ok(Finding { holds, measured, evidence })
}

/// The paper's two-sample t test, with a map as a sample; p is two-sided.
fn welch(a: &Cell, b: &Cell) -> Result<Tested, Untestable> {
    let effect = a.against(b, COLUMN, TestKind::Welch, false)?;
    let of = format!("{} over {} at {} %", a.kind, b.kind, a.percent);
    Ok(Tested { p: effect.p_two_sided, effect, of })
}

#[cfg(test)]
mod tests {
    use mcl_study::store::results::Results;

    use super::*;
    use crate::claims::claim::Claim;
    use crate::claims::claim::Verdict::{self, *};
    use crate::claims::planted;

    const SIZES: [f64; 4] = [1.0, 5.0, 20.0, 50.0];

    /// Data as in the paper: gains that fall with the size, random maps far below, no difference in the end.
    fn as_in_the_paper() -> Results {
        planted::likelihood(&SIZES, |is_random, size, scatter| {
            let random = if is_random { 100.0 / (size * size) } else { 0.0 };
            let initial = -4.0 - 20.0 / size - 2.0 * random + 0.01 * scatter;
            (initial, initial + 1.0 / size + 0.9 * random)
        })
    }

    fn claims(results: &Results) -> Vec<Claim> {
        Sampled::of(results, COLUMN, false).unwrap()[0].claims(&CLAIMS)
    }

    fn find(results: &Results, id: &str) -> Claim {
        claims(results).into_iter().find(|claim| claim.id == id).unwrap()
    }

    fn verdicts(results: &Results) -> Vec<Verdict> {
        claims(results).iter().map(|claim| claim.verdict).collect()
    }

    #[test]
    fn the_papers_picture_is_reproduced() {
        let results = as_in_the_paper();
        assert_eq!(verdicts(&results), [Reproduced; 4]);
        for claim in claims(&results) {
            assert!(claim.evidence.p.is_some_and(|p| p < ALPHA), "{claim:?}");
        }
    }

    #[test]
    fn the_opposite_is_not_reproduced() {
        // Gains that grow, kinds that part at large sizes, random maps above grid-based ones.
        let results = planted::likelihood(&SIZES, |is_random, size, scatter| {
            let random = if is_random { 1.0 } else { 0.0 };
            let initial = -10.0 + random + 0.01 * scatter;
            (initial, initial + 0.05 * size)
        });
        let expected = [Reproduced, NotReproduced, NotReproduced, NotReproduced];
        assert_eq!(verdicts(&results), expected);
    }

    #[test]
    fn tiny_maps_do_not_widen_the_margin() {
        // At 20 % kinds differ by 0.3: more than 1 % of the range above 0.25 %, less than that of all.
        let results = planted::likelihood(&[0.1, 1.0, 20.0], |is_random, size, scatter| {
            let random = if is_random && size == 20.0 { 0.3 } else { 0.0 };
            let initial = -4.0 - 20.0 / (size * size) + random + 0.01 * scatter;
            (initial, initial)
        });
        let claim = find(&results, "strategy-above-10");
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
        let claim = find(&results, "improvement");
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
        let claim = find(&results, "improvement-shrinks");
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
        assert_eq!(slopes(&values).unwrap().block_means(), [(0, -2.0), (1, -3.0)]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let mut results = as_in_the_paper();
        planted::edit(&mut results, |row| row.number("draw") == 0.0);
        assert_eq!(verdicts(&results), [NotTestable; 4]);
        assert_eq!(
            find(&results, "improvement").measured,
            "gbs+f-km 1 %: against gbs 1 %: too few to tell: 1 independent block, at least 2 needed"
        );
        let small = planted::likelihood(&[1.0], |_, _, scatter| {
            (-5.0 + 0.1 * scatter, -4.0 + 0.1 * scatter)
        });
        let expected = [Reproduced, NotTestable, NotTestable, NotReproduced];
        assert_eq!(verdicts(&small), expected);
    }
}
