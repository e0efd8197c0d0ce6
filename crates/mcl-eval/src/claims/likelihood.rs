//! Section V-A: what fuzzy k-means makes of the likelihood.

use mcl_metrics::{spearman, welch_equivalence_p, welch_t_test};

use super::claim::{Claim, Finding, Section, Statement, Untestable};
use super::saved::LikelihoodResults;
use super::{ALPHA, mean};
use crate::experiment::{Builder, LikelihoodRow};
use mcl_core::text::{list, number};

pub(super) const CLAIMS: [fn(&LikelihoodResults) -> Claim; 4] =
    [improvement, improvement_shrinks, strategy_above_10, rnd_fkm_below_gbs];

/// Above this size (percent) it is said not to matter how points are chosen.
const LARGE_ABOVE: f64 = 10.0;

/// What counts as equally likely, as a share of the range of figure 4: about the width of a line in
/// a figure of 100 line widths' height, in which the paper sees no difference.
const LINE_WIDTH: f64 = 0.01;

/// That range is of sizes from here on (percent), the smallest that the paper names as selected:
/// still smaller random maps are so unlikely that beside them nothing else would matter.
const FIGURE_FROM: f64 = 0.25;

/// The maps of one initialization and size: log-likelihoods in nats per point, before and after
/// fuzzy k-means.
struct Cell {
    builder: Builder,
    size_percent: f64,
    initial: Vec<f64>,
    improved: Vec<f64>,
}

impl Cell {
    fn values(&self, improved: bool) -> &[f64] {
        if improved { &self.improved } else { &self.initial }
    }

    /// Gain of each map.
    fn gains(&self) -> impl Iterator<Item = f64> {
        self.improved.iter().zip(&self.initial).map(|(improved, initial)| improved - initial)
    }

    fn mean_gain(&self) -> f64 {
        mean(&self.improved) - mean(&self.initial)
    }

    /// "gbs 0.25 %"
    fn name(&self) -> String {
        format!("{} {} %", self.builder.label(false), self.size_percent)
    }
}

/// The cells of all sizes and both initializations, sizes ascending; each has maps enough to be
/// tested.
fn cells(data: &LikelihoodResults) -> Result<[Vec<Cell>; 2], Untestable> {
    let rows = data.rows()?;
    let measured = rows.iter().map(|row| row.size_percent);
    let mut sizes: Vec<f64> = data.planned_sizes.iter().copied().chain(measured).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    sizes.dedup();
    let of_builder = |builder| -> Result<Vec<Cell>, Untestable> {
        let cell = |&size_percent: &f64| {
            let of_cell =
                |row: &&LikelihoodRow| row.builder == builder && row.size_percent == size_percent;
            let rows = || rows.iter().filter(of_cell);
            let cell = Cell {
                builder,
                size_percent,
                initial: rows().map(|row| row.initial_log_likelihood).collect(),
                improved: rows().map(|row| row.improved_log_likelihood).collect(),
            };
            match cell.initial.len() {
                0 => Err(Untestable(format!("there is no map {}", cell.name()))),
                1 => Err(Untestable(format!("there is only one map {}", cell.name()))),
                _ => Ok(cell),
            }
        };
        sizes.iter().map(cell).collect()
    };
    let [grid, random] = Builder::ALL.map(of_builder);
    Ok([grid?, random?])
}

fn improvement(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "improvement",
        section: Section::Likelihood,
        text: "Fuzzy k-means raises the likelihood significantly, for both initializations at \
               every size",
        test: "Welch's t test per initialization and size: improved above initial; p: the largest",
    };
    statement.decide(&data.place, || {
        let cells: Vec<Cell> = cells(data)?.into_iter().flatten().collect();
        let mut largest_p: f64 = 0.0;
        let mut failing = Vec::new();
        for cell in &cells {
            let p = welch_t_test(&cell.improved, &cell.initial)?.p_greater;
            if p >= ALPHA {
                failing.push(format!("{} ({})", cell.name(), number(cell.mean_gain())));
            }
            largest_p = largest_p.max(p);
        }
        let by_gain = |a: &&Cell, b: &&Cell| a.mean_gain().total_cmp(&b.mean_gain());
        let told = |cell: Option<&Cell>| {
            cell.map_or(String::new(), |cell| {
                format!("{} ({})", number(cell.mean_gain()), cell.name())
            })
        };
        let mut measured = format!(
            "{} of {} cells gain significantly; mean gains from {} to {} nats per point",
            cells.len() - failing.len(),
            cells.len(),
            told(cells.iter().min_by(by_gain)),
            told(cells.iter().max_by(by_gain)),
        );
        if !failing.is_empty() {
            measured += &format!("; not: {}", list(&failing));
        }
        Ok(Finding { holds: failing.is_empty(), p: Some(largest_p), measured })
    })
}

fn improvement_shrinks(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "improvement-shrinks",
        section: Section::Likelihood,
        text: "The larger the map, the smaller the improvement",
        test: "Spearman's rank correlation of the maps' gains with their size is negative (t \
               approximation), p: the larger of both initializations; and the mean gain falls from \
               each size to the next",
    };
    statement.decide(&data.place, || {
        let mut largest_p: f64 = 0.0;
        let mut told = Vec::new();
        let mut rising = Vec::new();
        for cells in cells(data)? {
            let (first, last) = match cells.as_slice() {
                [first, .., last] => (first, last),
                _ => return Err(Untestable("all maps have the same size".to_owned())),
            };
            let sizes = cells.iter().flat_map(|cell| vec![cell.size_percent; cell.initial.len()]);
            let gains: Vec<f64> = cells.iter().flat_map(Cell::gains).collect();
            let correlation = spearman(&sizes.collect::<Vec<f64>>(), &gains)?;
            largest_p = largest_p.max(correlation.p_less);
            told.push(format!(
                "{}: ρ = {:.3}, mean gain from {} nats per point at {} % to {} at {} %",
                first.builder.label(false),
                correlation.rho,
                number(first.mean_gain()),
                first.size_percent,
                number(last.mean_gain()),
                last.size_percent
            ));
            for step in cells.windows(2) {
                if step[1].mean_gain() >= step[0].mean_gain() {
                    let (from, to) = (step[0].name(), step[1].size_percent);
                    rising.push(format!("{} to {to} %", from.trim_end_matches(" %")));
                }
            }
        }
        let steps = match rising.is_empty() {
            true => "falls at every step".to_owned(),
            false => format!("does not fall from {}", list(&rising)),
        };
        Ok(Finding {
            holds: largest_p < ALPHA && rising.is_empty(),
            p: Some(largest_p),
            measured: format!("{}; {steps}", told.join("; ").replace("= -", "= −")),
        })
    })
}

fn strategy_above_10(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "strategy-above-10",
        section: Section::Likelihood,
        text: "Above 10 % of the points it hardly matters how they were chosen",
        test: "equivalence (two one-sided Welch tests) of each two of the four strategies at each \
               size above 10 %, within 1 % of the range of mean likelihoods from 0.25 % on; p: the \
               largest",
    };
    statement.decide(&data.place, || {
        let [grid, random] = cells(data)?;
        let means: Vec<f64> = grid
            .iter()
            .chain(&random)
            .filter(|cell| cell.size_percent >= FIGURE_FROM)
            .flat_map(|cell| [mean(&cell.initial), mean(&cell.improved)])
            .collect();
        let lowest = means.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = means.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let margin = LINE_WIDTH * (highest - lowest);
        let (mut largest_p, mut largest_difference): (f64, f64) = (0.0, -1.0);
        let (mut pairs, mut significant) = (0, 0);
        let mut furthest = String::new();
        for (grid, random) in grid.iter().zip(&random) {
            if grid.size_percent <= LARGE_ABOVE {
                continue;
            }
            let strategies = [(grid, false), (grid, true), (random, false), (random, true)];
            for (index, &(cell_a, improved_a)) in strategies.iter().enumerate() {
                for &(cell_b, improved_b) in &strategies[index + 1..] {
                    let (a, b) = (cell_a.values(improved_a), cell_b.values(improved_b));
                    let test = welch_t_test(a, b)?;
                    pairs += 1;
                    significant += usize::from(test.p_two_sided < ALPHA);
                    largest_p = largest_p.max(welch_equivalence_p(a, b, margin)?);
                    if test.mean_difference.abs() > largest_difference {
                        largest_difference = test.mean_difference.abs();
                        let (a, b) =
                            (cell_a.builder.label(improved_a), cell_b.builder.label(improved_b));
                        furthest = format!("{a} and {b} at {} %", grid.size_percent);
                    }
                }
            }
        }
        if pairs == 0 {
            return Err(Untestable("there is no map above 10 %".to_owned()));
        }
        Ok(Finding {
            holds: largest_p < ALPHA,
            p: Some(largest_p),
            measured: format!(
                "largest difference {} nats per point ({furthest}), margin {}; nevertheless \
                 {significant} of {pairs} pairs differ significantly",
                number(largest_difference),
                number(margin)
            ),
        })
    })
}

fn rnd_fkm_below_gbs(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "rnd-fkm-below-gbs",
        section: Section::Likelihood,
        text: "Improved random maps are sometimes less likely than grid-based maps of the same \
               size that were not improved",
        test: "Welch's t test per size: rnd+f-km below gbs; p: the smallest times the number of \
               sizes (Bonferroni)",
    };
    statement.decide(&data.place, || {
        let [grid, random] = cells(data)?;
        let mut smallest_p: f64 = 1.0;
        let mut below = Vec::new();
        let (mut pairs, mut pairs_below) = (0, 0);
        for (grid, random) in grid.iter().zip(&random) {
            let test = welch_t_test(&random.improved, &grid.initial)?;
            smallest_p = smallest_p.min(test.p_less);
            if test.mean_difference < 0.0 {
                let difference = number(-test.mean_difference);
                below.push(format!("{} % (by {difference})", grid.size_percent));
            }
            pairs += random.improved.len() * grid.initial.len();
            pairs_below += random
                .improved
                .iter()
                .map(|random| grid.initial.iter().filter(|grid| random < grid).count())
                .sum::<usize>();
        }
        let p = (smallest_p * grid.len() as f64).min(1.0);
        let sizes = match below.is_empty() {
            true => String::new(),
            false => format!(": {}, nats per point", list(&below)),
        };
        Ok(Finding {
            holds: p < ALPHA,
            p: Some(p),
            measured: format!(
                "the mean is lower at {} of {} sizes{sizes}; of all pairs of one map each, the \
                 random one is less likely in {:.1} %",
                below.len(),
                grid.len(),
                100.0 * pairs_below as f64 / pairs as f64
            ),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::Verdict::{self, *};
    use super::super::planted;
    use super::*;

    const SIZES: [f64; 4] = [1.0, 5.0, 20.0, 50.0];

    /// What the paper sees: gains that fall with the size, random maps far below, no difference in
    /// the end.
    fn as_in_the_paper() -> LikelihoodResults {
        planted::likelihood(&SIZES, |builder, size, scatter| {
            let random = if builder == Builder::Random { 100.0 / (size * size) } else { 0.0 };
            let initial = -4.0 - 20.0 / size - 2.0 * random + 0.01 * scatter;
            (initial, initial + 1.0 / size + 0.9 * random)
        })
    }

    fn verdicts(data: &LikelihoodResults) -> [Verdict; 4] {
        CLAIMS.map(|claim| claim(data).verdict)
    }

    #[test]
    fn the_papers_picture_is_reproduced() {
        let data = as_in_the_paper();
        assert_eq!(verdicts(&data), [Reproduced; 4]);
        for claim in CLAIMS.map(|claim| claim(&data)) {
            assert!(claim.p.is_some_and(|p| p < ALPHA), "{claim:?}");
        }
    }

    #[test]
    fn its_opposite_is_not() {
        // Gains that grow, strategies that part at large sizes, random maps above grid-based ones.
        let data = planted::likelihood(&SIZES, |builder, size, scatter| {
            let random = if builder == Builder::Random { 1.0 } else { 0.0 };
            let initial = -10.0 + random + 0.01 * scatter;
            (initial, initial + 0.05 * size)
        });
        assert_eq!(verdicts(&data)[1..], [NotReproduced; 3]);
        assert_eq!(improvement(&data).verdict, Reproduced);
    }

    #[test]
    fn tiny_maps_do_not_widen_the_margin() {
        // At 20 % strategies differ by 0.3: more than 1 % of the range above 0.25 %, less than that
        // of all.
        let data = planted::likelihood(&[0.1, 1.0, 20.0], |builder, size, scatter| {
            let random = if builder == Builder::Random && size == 20.0 { 0.3 } else { 0.0 };
            let initial = -4.0 - 20.0 / (size * size) + random + 0.01 * scatter;
            (initial, initial)
        });
        let claim = strategy_above_10(&data);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.measured.contains("difference 0.300"), "{}", claim.measured);
        assert!(claim.measured.contains("margin 0.203"), "{}", claim.measured);
    }

    #[test]
    fn one_cell_without_a_gain_is_enough() {
        let mut data = as_in_the_paper();
        for row in data.rows.as_mut().unwrap() {
            if row.builder == Builder::Random && row.size_percent == 50.0 {
                row.improved_log_likelihood = row.initial_log_likelihood - 0.001;
            }
        }
        let claim = improvement(&data);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.p.unwrap() > 0.5);
        assert!(claim.measured.contains("7 of 8"), "{}", claim.measured);
        assert!(claim.measured.contains("not: rnd 50 % (−0.00100)"), "{}", claim.measured);
    }

    #[test]
    fn a_gain_that_falls_only_mostly_is_told() {
        let mut data = as_in_the_paper();
        for row in data.rows.as_mut().unwrap() {
            if row.builder == Builder::Grid && row.size_percent == 20.0 {
                row.improved_log_likelihood += 0.3;
            }
        }
        let claim = improvement_shrinks(&data);
        assert_eq!(claim.verdict, NotReproduced);
        assert!(claim.measured.contains("does not fall from gbs 5 to 20 %"), "{}", claim.measured);
    }

    #[test]
    fn what_is_missing_is_named() {
        let reason = |data: &LikelihoodResults| {
            assert_eq!(verdicts(data), [NotTestable; 4]);
            improvement(data).measured
        };
        let mut data = as_in_the_paper();
        data.rows
            .as_mut()
            .unwrap()
            .retain(|row| row.builder == Builder::Grid || row.size_percent != 5.0);
        assert_eq!(reason(&data), "there is no map rnd 5 %");
        let mut data = as_in_the_paper();
        data.rows.as_mut().unwrap().retain(|row| row.size_percent != 1.0 || row.repeat == 0);
        assert_eq!(reason(&data), "there is only one map gbs 1 %");
        data.rows = Err(Untestable("no trials".into()));
        assert_eq!(reason(&data), "no trials");
        let small = planted::likelihood(&[1.0], |_, _, scatter| {
            (-5.0 + 0.1 * scatter, -4.0 + 0.1 * scatter)
        });
        assert_eq!(improvement(&small).verdict, Reproduced);
        assert_eq!(verdicts(&small)[1..], [NotTestable, NotTestable, NotReproduced]);
    }
}
