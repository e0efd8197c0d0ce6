//! Errors of the same runs on different maps, compared in pairs.
//!
//! Run r has the same noise whatever the map, and is on map r mod `maps` of every strategy and
//! size. So runs are paired, and logarithms of their errors are subtracted: a ratio of errors, on
//! which a lost run does not drown all others as it does in a difference. Runs on the same map
//! share that map's luck. What is independent is a map with its runs, and only that: errors are
//! averaged over the runs on a map before they are tested, and a test has as many pairs as there
//! are maps.

use std::collections::{BTreeMap, BTreeSet};

use mcl_metrics::{TTest, paired_t_test};

use super::claim::Untestable;
use crate::experiment::{LocalizationRow, MapStrategy};

/// The runs on the maps of one strategy and size.
#[derive(Clone)]
pub(super) struct Cell<'a> {
    pub strategy: MapStrategy,
    pub size_percent: f64,
    /// At least one.
    pub runs: Vec<&'a LocalizationRow>,
}

impl Cell<'_> {
    /// "gbs 0.25 %"
    pub fn name(&self) -> String {
        format!("{} {} %", self.strategy.label(), self.size_percent)
    }

    /// Mean over all runs of the weighted error, as in figure 5.
    pub fn mean_error(&self) -> f64 {
        self.runs.iter().map(|row| row.weighted).sum::<f64>() / self.runs.len() as f64
    }

    pub fn diverged(&self) -> usize {
        self.runs.iter().filter(|row| row.diverged).count()
    }
}

/// Which map sizes a claim is about.
pub(super) struct Sizes {
    /// "below 1 %"
    pub name: &'static str,
    /// Whether a size in percent is one of them.
    pub among: fn(f64) -> bool,
}

impl Sizes {
    pub const ALL: Sizes = Sizes { name: "of any kind", among: |_| true };
    /// Small maps: figure 5's lower plot.
    pub const SMALL: Sizes = Sizes { name: "below 1 %", among: |percent| percent < 1.0 };
    pub const NOT_SMALL: Sizes = Sizes { name: "from 1 % on", among: |percent| percent >= 1.0 };
    pub const ABOVE_SMALL: Sizes = Sizes { name: "above 1 %", among: |percent| percent > 1.0 };
    /// On these the paper's filter diverged in some runs.
    pub const TINY: Sizes = Sizes { name: "below 0.25 %", among: |percent| percent < 0.25 };
    pub const NOT_TINY: Sizes = Sizes { name: "from 0.25 % on", among: |percent| percent >= 0.25 };
}

/// The runs of one split on maps of the paper's four strategies.
pub(super) struct Sampled<'a> {
    rows: Vec<&'a LocalizationRow>,
    /// Ascending, in percent.
    sizes: Vec<f64>,
}

impl<'a> Sampled<'a> {
    /// Of a split's rows; sizes are those of the rows and those that are planned.
    pub fn new(rows: &'a [LocalizationRow], planned_sizes: &[f64]) -> Self {
        let rows: Vec<_> = rows.iter().filter(|row| row.strategy != MapStrategy::All).collect();
        let measured = rows.iter().map(|row| row.size_percent);
        let mut sizes: Vec<f64> = planned_sizes.iter().copied().chain(measured).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        sizes.dedup();
        Sampled { rows, sizes }
    }

    /// The runs on the maps of a strategy and size.
    pub fn cell(&self, strategy: MapStrategy, size_percent: f64) -> Result<Cell<'a>, Untestable> {
        let of_cell =
            |row: &&LocalizationRow| row.strategy == strategy && row.size_percent == size_percent;
        let runs = self.rows.iter().copied().filter(of_cell).collect();
        let cell = Cell { strategy, size_percent, runs };
        match cell.runs.is_empty() {
            true => Err(Untestable(format!("there is no run on {}", cell.name()))),
            false => Ok(cell),
        }
    }

    /// The cells of a strategy at these sizes, at least one, sizes ascending.
    pub fn cells(&self, strategy: MapStrategy, of: &Sizes) -> Result<Vec<Cell<'a>>, Untestable> {
        let sizes: Vec<f64> = self.sizes.iter().copied().filter(|&size| (of.among)(size)).collect();
        if sizes.is_empty() {
            let found: Vec<String> = self.sizes.iter().map(f64::to_string).collect();
            let reason = format!("there are no maps {}, only of {} %", of.name, found.join(", "));
            return Err(Untestable(reason));
        }
        sizes.into_iter().map(|size| self.cell(strategy, size)).collect()
    }

    /// The cells of all four strategies at these sizes.
    pub fn all_cells(&self, of: &Sizes) -> Result<Vec<Cell<'a>>, Untestable> {
        let of_strategies: Result<Vec<_>, _> =
            MapStrategy::SAMPLED.iter().map(|&strategy| self.cells(strategy, of)).collect();
        Ok(of_strategies?.concat())
    }
}

/// For each group of cells the mean of ln error per map number, over the group's cells and the runs
/// on the maps of that number. Only runs that are in every cell of every group count.
pub(super) fn log_errors<const N: usize>(
    groups: [&[Cell]; N],
) -> Result<[Vec<f64>; N], Untestable> {
    let cells = || groups.iter().flat_map(|cells| cells.iter());
    let first = cells().next().ok_or_else(|| Untestable("there are no such maps".to_owned()))?;
    let mut common: BTreeMap<u32, u32> = first.runs.iter().map(|row| (row.run, row.map)).collect();
    for cell in cells() {
        let runs: BTreeSet<u32> = cell.runs.iter().map(|row| row.run).collect();
        common.retain(|run, _| runs.contains(run));
        if let Some(row) = cell.runs.iter().find(|row| row.weighted <= 0.0) {
            let (run, cell) = (row.run, cell.name());
            return Err(Untestable(format!("run {run} on {cell} has no error to take a ratio of")));
        }
    }
    let maps: BTreeSet<u32> = common.values().copied().collect();
    match maps.len() {
        0 => return Err(Untestable("no run is on all maps that are compared".to_owned())),
        1 => {
            let reason = "all runs are on one map of each kind: nothing says what another would do";
            return Err(Untestable(reason.to_owned()));
        }
        _ => {}
    }
    let on_map = |cells: &[Cell], map: u32| {
        let errors: Vec<f64> = cells
            .iter()
            .flat_map(|cell| &cell.runs)
            .filter(|row| common.get(&row.run) == Some(&map))
            .map(|row| row.weighted.ln())
            .collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    Ok(groups.map(|cells| maps.iter().map(|&map| on_map(cells, map)).collect()))
}

/// Tests ln error in cells `a` against `b`, paired by map; the mean difference is the logarithm of
/// the ratio of geometric means.
pub(super) fn compare(a: &[Cell], b: &[Cell]) -> Result<TTest, Untestable> {
    let [a, b] = log_errors([a, b])?;
    Ok(paired_t_test(&a, &b)?)
}

#[cfg(test)]
mod tests {
    use super::super::planted;
    use super::*;

    fn reason<T>(result: Result<T, Untestable>) -> String {
        result.err().expect("not testable").0
    }

    #[test]
    fn runs_on_a_map_are_one_sample() {
        // Eight runs on four maps: map by map the improved error is e^-1, e^-2, e^-3, e^-4 of the
        // other.
        let mut data = planted::localization(&[1.0], |_, _, _, _| 1.0);
        for row in data.rows.as_mut().unwrap() {
            if row.strategy == MapStrategy::GridImproved {
                row.weighted = (-f64::from(row.map + 1)).exp();
            }
        }
        let runs = data.sampled().unwrap();
        let cell = |strategy| vec![runs.cell(strategy, 1.0).unwrap()];
        let (improved, initial) = (cell(MapStrategy::GridImproved), cell(MapStrategy::Grid));
        let test = compare(&improved, &initial).unwrap();
        assert!((test.mean_difference + 2.5).abs() < 1e-12);
        assert_eq!(test.degrees_of_freedom, 3.0);
        // Mean −2.5 with a standard error of √(5/3)/2.
        assert!((test.t + 2.5 / ((5.0f64 / 3.0).sqrt() / 2.0)).abs() < 1e-12);
    }

    #[test]
    fn runs_that_are_not_everywhere_do_not_count() {
        let mut data = planted::localization(&[1.0], |strategy, _, run, _| match (strategy, run) {
            (MapStrategy::Grid, 7) => 1000.0,
            _ => 1.0,
        });
        let rows = data.rows.as_mut().unwrap();
        rows.retain(|row| row.strategy != MapStrategy::Random || row.run != 7);
        let runs = data.sampled().unwrap();
        let cell = |strategy| vec![runs.cell(strategy, 1.0).unwrap()];
        let test = compare(&cell(MapStrategy::Grid), &cell(MapStrategy::Random)).unwrap();
        assert_eq!(test.mean_difference, 0.0);
    }

    #[test]
    fn what_cannot_be_compared_says_why() {
        let mut data = planted::localization(&[1.0], |_, _, _, _| 1.0);
        for row in data.rows.as_mut().unwrap() {
            if row.strategy == MapStrategy::Random {
                row.run += 8;
            }
            if row.strategy == MapStrategy::RandomImproved && row.run == 3 {
                row.weighted = 0.0;
            }
        }
        let runs = data.sampled().unwrap();
        let cell = |strategy| vec![runs.cell(strategy, 1.0).unwrap()];
        let (grid, random) = (cell(MapStrategy::Grid), cell(MapStrategy::Random));
        assert_eq!(reason(compare(&grid, &random)), "no run is on all maps that are compared");
        assert!(reason(compare(&grid, &cell(MapStrategy::RandomImproved))).starts_with("run 3 on"));
        assert_eq!(reason(runs.cell(MapStrategy::Grid, 2.0)), "there is no run on gbs 2 %");
        assert!(reason(compare(&[], &[])).contains("no such maps"));
        let on_one = |cell: &[Cell<'_>]| -> String {
            let runs = cell[0].runs.iter().copied().filter(|row| row.map == 0).collect();
            let one = [Cell { runs, ..cell[0].clone() }];
            reason(compare(&one, &one))
        };
        assert!(on_one(&grid).starts_with("all runs are on one map"));
    }
}
