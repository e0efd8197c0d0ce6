//! What a study measured on the paper's four kinds of map, by kind and size.
//!
//! Maps of one draw number with all runs on them are one block; only blocks are independent of each
//! other. Run r has the same noise whatever the map, so runs are paired, and logarithms of their errors
//! are subtracted: a ratio of errors, on which a lost run does not drown all others as it does in a
//! difference.

use std::collections::BTreeMap;

use anyhow::Result;
use mcl_core::text::counted;
use mcl_metrics::{Blocked, Effect, paired};
use mcl_study::recipe::map::{MapRecipe, Size};
use mcl_study::recipe::split::Split;
use mcl_study::store::results::Results;
use mcl_study::table::{Row, Value};
use mcl_study::trial::run::Trial;

use crate::claims::claim::{Place, Untestable};

/// The paper's kinds of map by initialization: the initial map, and what fuzzy k-means makes of it.
pub(super) const INITIALIZATIONS: [[&str; 2]; 2] = [["gbs", "gbs+f-km"], ["rnd", "rnd+f-km"]];
/// Columns by which the rows of a cell differ, and those that tell cells apart.
const OF_CELLS: [&str; 6] = ["split", "map", "size_percent", "draw", "map_seed", "run"];

/// The paper's four kinds of map.
pub(super) fn kinds() -> impl Iterator<Item = &'static str> {
    INITIALIZATIONS.into_iter().flatten()
}

/// What was measured on the maps of one kind and size.
#[derive(Debug, Clone)]
pub(super) struct Cell<'a> {
    pub kind: &'static str,
    pub percent: f64,
    /// At least one.
    rows: Vec<Row<'a>>,
}

impl Cell<'_> {
    /// "gbs 0.25 %"
    pub fn name(&self) -> String {
        format!("{} {} %", self.kind, self.percent)
    }

    /// A column by draw and run.
    pub fn values(&self, column: &str) -> Result<Blocked, Untestable> {
        let count = |row: &Row, column| match row.get(column) {
            Value::Count(count) => *count,
            _ => 0,
        };
        let value = |row: &Row| {
            let (draw, run) = (count(row, "draw"), count(row, "run"));
            let unknown =
                || self.because(format!("{column} of draw {draw}, run {run} is not known"));
            Ok((draw, run, row.number(column).ok_or_else(unknown)?))
        };
        let values = self.rows.iter().map(value).collect::<Result<Vec<_>, Untestable>>()?;
        Blocked::with_units(values).map_err(|error| self.because(error))
    }

    /// The logarithm of a column by draw and run.
    pub fn logs(&self, column: &str) -> Result<Blocked, Untestable> {
        self.values(column)?.map(f64::ln).map_err(|error| self.because(error))
    }

    /// A reason, with the cell's name.
    pub fn because(&self, reason: impl ToString) -> Untestable {
        Untestable(format!("{}: {}", self.name(), reason.to_string()))
    }
}

/// Which sizes a claim is about.
pub(super) struct Sizes {
    /// "below 1 %"
    pub name: &'static str,
    /// Whether a size in percent is one of them.
    pub among: fn(f64) -> bool,
}

impl Sizes {
    pub const ALL: Sizes = Sizes { name: "of any size", among: |_| true };
    /// Small maps: figure 5's lower plot.
    pub const SMALL: Sizes = Sizes { name: "below 1 %", among: |percent| percent < 1.0 };
    pub const NOT_SMALL: Sizes = Sizes { name: "from 1 % on", among: |percent| percent >= 1.0 };
    pub const ABOVE_SMALL: Sizes = Sizes { name: "above 1 %", among: |percent| percent > 1.0 };
    /// On these the paper's filter diverged in some runs.
    pub const TINY: Sizes = Sizes { name: "below 0.25 %", among: |percent| percent < 0.25 };
    pub const NOT_TINY: Sizes = Sizes { name: "from 0.25 % on", among: |percent| percent >= 0.25 };
    /// Above this size it is said not to matter how points are chosen.
    pub const LARGE: Sizes = Sizes { name: "above 10 %", among: |percent| percent > 10.0 };
}

/// What a study measured on the paper's four kinds of map, one split.
pub(super) struct Sampled<'a> {
    pub place: Place,
    pub results: &'a Results,
    /// Of the plan, ascending, in percent.
    sizes: Vec<f64>,
    cells: Vec<Cell<'a>>,
}

impl<'a> Sampled<'a> {
    /// The splits of a study that has a column and all four kinds of map; none of another study.
    /// `with_runs`: only maps on which robots are localized.
    ///
    /// # Errors
    /// When the study varies something else too, about which the paper says nothing.
    pub fn of(results: &'a Results, column: &str, with_runs: bool) -> Result<Vec<Self>> {
        if results.table.column(column).is_none() {
            return Ok(Vec::new());
        }
        let plan = results.study.plan(&results.facts.name)?;
        let mut splits: BTreeMap<Option<Split>, Vec<&Trial>> = BTreeMap::new();
        for trial in &plan.trials {
            if percent(&trial.map).is_some() && !(with_runs && trial.runs.is_empty()) {
                splits.entry(trial.map.split).or_default().push(trial);
            }
        }
        splits.retain(|_, trials| kinds().all(|kind| trials.iter().any(|t| kind_of(t) == kind)));
        let of_split = |(split, trials): (Option<Split>, Vec<&Trial>)| {
            check_nothing_else_varies(&trials)?;
            Ok(Self::of_split(results, split, &trials))
        };
        splits.into_iter().map(of_split).collect()
    }

    fn of_split(results: &'a Results, split: Option<Split>, trials: &[&Trial]) -> Self {
        let mut sizes: Vec<f64> = trials.iter().filter_map(|trial| percent(&trial.map)).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        sizes.dedup();
        let split_name = split.map(Split::name).unwrap_or_default();
        let mut cells: Vec<Cell> = kinds()
            .flat_map(|kind| sizes.iter().map(move |&percent| (kind, percent)))
            .map(|(kind, percent)| Cell { kind, percent, rows: Vec::new() })
            .collect();
        for row in results.table.rows().filter(|row| row.text("split") == split_name) {
            let (kind, percent) = (row.text("map"), row.number("size_percent"));
            let is_of = |cell: &&mut Cell| cell.kind == kind && Some(cell.percent) == percent;
            if let Some(cell) = cells.iter_mut().find(is_of) {
                cell.rows.push(row);
            }
        }
        let place = Place {
            dataset: results.facts.name.clone(),
            experiment: Some(results.name.clone()),
            split,
        };
        Sampled { place, results, sizes, cells }
    }

    /// Whether all trials have their rows: nothing is decided on half a study.
    pub fn complete(&self) -> Result<(), Untestable> {
        let Results { done, asked, .. } = self.results;
        match done == asked {
            true => Ok(()),
            false => Err(Untestable(format!("{done} of {} are there", counted(*asked, "trial")))),
        }
    }

    /// The cells of a kind of map at these sizes, at least one, sizes ascending.
    pub fn cells(&self, kind: &str, of: &Sizes) -> Result<Vec<Cell<'a>>, Untestable> {
        let cells: Vec<Cell> = self
            .cells
            .iter()
            .filter(|cell| cell.kind == kind && (of.among)(cell.percent))
            .cloned()
            .collect();
        if cells.is_empty() {
            let sizes: Vec<String> = self.sizes.iter().map(f64::to_string).collect();
            let reason = format!("there are no maps {}, only of {} %", of.name, sizes.join(", "));
            return Err(Untestable(reason));
        }
        match cells.iter().find(|cell| cell.rows.is_empty()) {
            Some(cell) => Err(Untestable(format!("there is no row of {}", cell.name()))),
            None => Ok(cells),
        }
    }

    /// The cells of all four kinds at these sizes, by kind.
    pub fn all_cells(&self, of: &Sizes) -> Result<Vec<Vec<Cell<'a>>>, Untestable> {
        kinds().map(|kind| self.cells(kind, of)).collect()
    }
}

fn kind_of<'a>(trial: &'a Trial) -> &'a str {
    &trial.map.kind.name
}

/// The size of a map of one of the four kinds, where it is in percent.
fn percent(map: &MapRecipe) -> Option<f64> {
    match map.size {
        Some(Size::Percent(percent)) if kinds().any(|kind| kind == map.kind.name) => Some(percent),
        _ => None,
    }
}

/// The paper's statements are about one setting of everything but kind, size and split.
fn check_nothing_else_varies(trials: &[&Trial]) -> Result<()> {
    let mut values: BTreeMap<String, Value> = BTreeMap::new();
    let mut varied: Vec<String> = Vec::new();
    for trial in trials {
        let mut cells = trial.map.cells();
        for run in &trial.runs {
            cells.extend(run.cells()?);
        }
        for (column, value) in cells {
            if value.is_empty() || OF_CELLS.contains(&column.as_str()) || varied.contains(&column) {
                continue;
            }
            if *values.entry(column.clone()).or_insert_with(|| value.clone()) != value {
                varied.push(column);
            }
        }
    }
    if !varied.is_empty() {
        anyhow::bail!("it varies {}", mcl_core::text::list(&varied));
    }
    Ok(())
}

/// ln(a / b) of a column, of the same runs in each two cells, by block.
pub(super) fn log_ratios(a: &[Cell], b: &[Cell], column: &str) -> Result<Blocked, Untestable> {
    let ratio = |(a, b): (&Cell, &Cell)| {
        a.logs(column)?.minus(&b.logs(column)?).map_err(|error| a.because(error))
    };
    let ratios = a.iter().zip(b).map(ratio).collect::<Result<Vec<Blocked>, Untestable>>()?;
    match ratios.as_slice() {
        // As in tests.csv to the last bit.
        [only] => Ok(only.clone()),
        all => Ok(Blocked::new(all.iter().flat_map(Blocked::values))?),
    }
}

/// Tests ln of a column in one cell against that in another times a factor, paired by draw and run.
pub(super) fn compare(a: &Cell, b: &Cell, column: &str, factor: f64) -> Result<Effect, Untestable> {
    let limits = b.logs(column)?.map(|log| log + factor.ln())?;
    paired(&a.logs(column)?, &limits).map_err(|error| a.because(error))
}

#[cfg(test)]
mod tests {
    use mcl_metrics::one_sample;

    use super::*;
    use crate::claims::planted;

    const WEIGHTED: &str = "weighted";

    fn reason<T>(result: Result<T, Untestable>) -> String {
        result.err().expect("not testable").0
    }

    fn first(results: &Results) -> Sampled<'_> {
        Sampled::of(results, WEIGHTED, true).unwrap().remove(0)
    }

    #[test]
    fn runs_on_a_map_are_one_sample() {
        // Eight runs on four maps: map by map the improved error is e^-1, e^-2, e^-3, e^-4 of the
        // other.
        let mut results = planted::localization(&[1.0], |_, _, _, _| 1.0);
        planted::edit(&mut results, |row| {
            if row.text("map") == "gbs+f-km" {
                row.set(WEIGHTED, (-1.0 - row.number("draw")).exp());
            }
            true
        });
        let data = first(&results);
        let cells = |kind| data.cells(kind, &Sizes::ALL).unwrap();
        let (improved, initial) = (cells("gbs+f-km"), cells("gbs"));
        let test = one_sample(&log_ratios(&improved, &initial, WEIGHTED).unwrap()).unwrap();
        assert!((test.mean_difference + 2.5).abs() < 1e-12);
        assert_eq!((test.degrees_of_freedom, test.blocks), (3.0, [4, 4]));
        // Mean −2.5 with a standard error of √(5/3)/2.
        assert!((test.t + 2.5 / ((5.0f64 / 3.0).sqrt() / 2.0)).abs() < 1e-12);
        assert_eq!(compare(&improved[0], &initial[0], WEIGHTED, 1.0).unwrap().t, test.t);
    }

    #[test]
    fn runs_that_are_not_everywhere_do_not_count() {
        let mut results = planted::localization(&[1.0], |kind, _, run, _| match (kind, run) {
            ("gbs", 7) => 1000.0,
            _ => 1.0,
        });
        planted::edit(&mut results, |row| row.text("map") != "rnd" || row.number("run") != 7.0);
        let data = first(&results);
        let cell = |kind| data.cells(kind, &Sizes::ALL).unwrap().remove(0);
        let test = compare(&cell("gbs"), &cell("rnd"), WEIGHTED, 1.0).unwrap();
        assert_eq!(test.mean_difference, 0.0);
    }

    #[test]
    fn what_cannot_be_compared_says_why() {
        let mut results = planted::localization(&[1.0], |_, _, _, _| 1.0);
        planted::edit(&mut results, |row| {
            match (row.text("map"), row.number("run") as u32) {
                ("rnd", run) => row.set("run", run + 8),
                ("rnd+f-km", 3) => row.set(WEIGHTED, 0.0),
                ("gbs+f-km", 3) => row.set(WEIGHTED, f64::NAN),
                _ => {}
            }
            true
        });
        let data = first(&results);
        let cell = |kind| data.cells(kind, &Sizes::ALL).unwrap().remove(0);
        let against_gbs = |kind| reason(compare(&cell("gbs"), &cell(kind), WEIGHTED, 1.0));
        assert_eq!(
            against_gbs("rnd"),
            "gbs 1 %: too few to tell: 0 independent blocks, at least 2 needed"
        );
        let zero = against_gbs("rnd+f-km");
        assert!(zero.starts_with("rnd+f-km 1 %: block 3, unit 3: the value 0"), "{zero}");
        assert_eq!(against_gbs("gbs+f-km"), "gbs+f-km 1 %: weighted of draw 3, run 3 is not known");
        assert!(reason(log_ratios(&[], &[], WEIGHTED)).contains("0 independent blocks"));
        planted::edit(&mut results, |row| row.number("draw") == 0.0);
        let data = first(&results);
        let one = data.cells("gbs", &Sizes::ALL).unwrap().remove(0);
        assert!(reason(compare(&one, &one, WEIGHTED, 1.0)).contains("1 independent block,"));
    }

    /// A size that was listed twice once made two samples of one.
    #[test]
    fn a_run_that_is_there_twice_is_no_second_sample() {
        let mut results = planted::localization(&[1.0], |_, _, _, scatter| scatter);
        planted::edit(&mut results, |row| {
            row.set("run", row.number("draw") as u32);
            true
        });
        let cell = first(&results).cells("gbs", &Sizes::ALL).unwrap().remove(0);
        assert_eq!(
            reason(cell.values(WEIGHTED)),
            "gbs 1 %: block 0 holds unit 0 more than once, expected each unit once, so that no value \
             counts twice"
        );
    }
}
