//! Measurements of a study on the paper's four kinds of map, by kind and size.
//!
//! Maps with the same draw number and all runs on them are one block; only blocks are independent of each
//! other. Run r has the same noise whatever the map, so runs are paired, and logarithms of their errors are
//! subtracted: this gives a ratio of errors, which a lost run does not dominate as it does a difference.

use anyhow::{Result, bail};
use mcl_core::{math, text::list};
use mcl_metrics::{Blocked, Effect};
use mcl_study::recipe::split::Split;
use mcl_study::store::results::Results;
use mcl_study::study::settings::PRESET;
use mcl_study::study::views::{INITIALIZATIONS, TestKind};
use mcl_study::table::Value;
use mcl_study::view::compare::{self, Comparison};
use mcl_study::view::groups::{Group, Groups, order};

use crate::claims::claim::{Claim, Conditions, Outcome, Test, Untestable};

/// The paper's four kinds of map.
pub(super) fn kinds() -> impl Iterator<Item = &'static str> {
    INITIALIZATIONS.into_iter().flatten()
}

/// A statement about the measurements of a study.
pub(super) type SampledTest = Test<fn(&Sampled) -> Outcome>;

/// The measurements on the maps of one kind and size.
#[derive(Debug, Clone)]
pub(super) struct Cell<'a> {
    pub kind: &'static str,
    pub percent: f64,
    group: Group<'a>,
}

impl Cell<'_> {
    /// "gbs 0.25 %"
    pub fn name(&self) -> String {
        format!("{} {} %", self.kind, self.percent)
    }

    /// A column by draw and run.
    pub fn values(&self, column: &str) -> Result<Blocked, Untestable> {
        let values =
            self.group.blocked(column).map_err(|error| self.because(format!("{error:#}")))?;
        values.ok_or_else(|| self.because(format!("not every row has {column}")))
    }

    /// Tests a column against that of another cell, as tests.csv does.
    pub fn against(
        &self,
        other: &Cell,
        column: &str,
        test: TestKind,
        ratio: bool,
    ) -> Result<Effect, Untestable> {
        let because = |why: String| self.because(format!("against {}: {why}", other.name()));
        match compare::compare(&self.group, &other.group, column, test, ratio) {
            Ok(Comparison::Tested(effect)) => Ok(effect),
            Ok(Comparison::Untested(why)) => Err(because(why)),
            Err(error) => Err(because(format!("{error:#}"))),
        }
    }

    /// A reason, with the cell's name.
    pub fn because(&self, reason: impl ToString) -> Untestable {
        Untestable(format!("{}: {}", self.name(), reason.to_string()))
    }
}

/// The sizes that a claim is about.
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
    /// Above this size the choice of points is said not to matter.
    pub const LARGE: Sizes = Sizes { name: "above 10 %", among: |percent| percent > 10.0 };
}

/// The measurements of a study on the paper's four kinds of map under the same settings.
pub(super) struct Sampled<'a> {
    pub place: Conditions,
    pub results: &'a Results,
    /// By kind and size, ascending; including those that have no rows yet.
    cells: Vec<Cell<'a>>,
}

impl<'a> Sampled<'a> {
    /// The splits of a study that has a column and all four kinds of map in percent of the points, each under
    /// every preset; none for another study. `with_runs`: only maps on which robots are localized; without,
    /// presets make no difference.
    ///
    /// # Errors
    /// When the study also varies something that the paper does not discuss.
    pub fn of(results: &'a Results, column: &str, with_runs: bool) -> Result<Vec<Self>> {
        if results.table.column(column).is_none() {
            return Ok(Vec::new());
        }
        let groups = Groups::of(results)?;
        let parts = Self::parts(&groups, None, &["split", PRESET], with_runs)?;
        let mut found: Vec<Self> = parts.into_iter().map(|(_, data)| data).collect();
        if !with_runs {
            found.iter_mut().for_each(|data| data.place.preset = None);
            found.dedup_by(|a, b| a.place == b.place);
        }
        Ok(found)
    }

    /// The measurements of an entry of a study, or of all of it, on the four kinds of map in percent of the
    /// points, split by the values of some settings; parts that lack a kind are left out.
    ///
    /// # Errors
    /// When something else varies within a part.
    pub fn parts(
        groups: &Groups<'a>,
        entry: Option<&str>,
        by: &[&str],
        with_runs: bool,
    ) -> Result<Vec<(Vec<Vec<Value>>, Self)>> {
        let places = ["map", "size_percent"].map(|setting| groups.place(setting));
        let [Some(map), Some(size)] = places else { return Ok(Vec::new()) };
        let by: Vec<usize> = by.iter().filter_map(|setting| groups.place(setting)).collect();
        let mut parts: Vec<(Vec<Vec<Value>>, Vec<Cell<'a>>)> = Vec::new();
        for group in &groups.all {
            let kind = kinds().find(|kind| *kind == group.text(map));
            let is_asked = entry.is_none_or(|entry| group.entries.contains(entry));
            let is_localized = group.rows.iter().all(|row| row.number("run").is_some());
            let (Some(kind), Some(percent)) = (kind, group.number(size)) else { continue };
            if !is_asked || (with_runs && !is_localized) {
                continue;
            }
            let cell = Cell { kind, percent, group: group.clone() };
            let values: Vec<_> = by.iter().map(|&place| group.values(place).to_vec()).collect();
            match parts.iter_mut().find(|(known, _)| order(known, &values).is_eq()) {
                Some((_, cells)) => cells.push(cell),
                None => parts.push((values, vec![cell])),
            }
        }
        parts.retain(|(_, cells)| kinds().all(|kind| cells.iter().any(|c| c.kind == kind)));
        let mut found = Vec::new();
        for (values, mut cells) in parts {
            cells.sort_by(|a, b| a.kind.cmp(b.kind).then(a.percent.total_cmp(&b.percent)));
            let of_part: Vec<&Group> = cells.iter().map(|cell| &cell.group).collect();
            let mut varied = groups.varying(&of_part);
            varied.retain(|place| ![map, size].contains(place));
            if !varied.is_empty() {
                let names = varied.iter().map(|place| groups.settings[*place].name.as_str());
                bail!("it varies {}", list(&names.collect::<Vec<_>>()));
            }
            let results = groups.results;
            let text = |setting: &str| groups.place(setting).map(|at| of_part[0].text(at));
            let split = text("split").unwrap_or_default();
            let place = Conditions {
                dataset: results.facts.name.clone(),
                experiment: Some(results.name.clone()),
                split: Split::ALL.into_iter().find(|known| known.name() == split),
                preset: text(PRESET).filter(|name| !name.is_empty()),
            };
            found.push((values, Sampled { place, results, cells }));
        }
        Ok(found)
    }

    /// Decides claims; none if the study is incomplete.
    pub fn claims(&self, tests: &[SampledTest]) -> Vec<Claim> {
        let decide = |test: &SampledTest| match self.results.missing() {
            Some(found) => Err(Untestable(format!("{found} are there"))),
            None => (test.decide)(self),
        };
        tests.iter().map(|test| test.claim(self.place.clone(), decide(test))).collect()
    }

    /// The cells of a kind of map at these sizes, at least one, sizes ascending.
    pub fn cells(&self, kind: &str, of: &Sizes) -> Result<Vec<Cell<'a>>, Untestable> {
        let of_kind = self.cells.iter().filter(|cell| cell.kind == kind);
        let cells: Vec<Cell> = of_kind.filter(|cell| (of.among)(cell.percent)).cloned().collect();
        if cells.is_empty() {
            let of_kind = self.cells.iter().filter(|cell| cell.kind == kind);
            let sizes: Vec<String> = of_kind.map(|cell| cell.percent.to_string()).collect();
            let reason = format!("there are no maps {}, only of {} %", of.name, sizes.join(", "));
            return Err(Untestable(reason));
        }
        Ok(cells)
    }

    /// The cells of two kinds of map at these sizes, in pairs of one size.
    pub fn pairs(&self, a: &str, b: &str, of: &Sizes) -> Result<Vec<[Cell<'a>; 2]>, Untestable> {
        let (a, b) = (self.cells(a, of)?, self.cells(b, of)?);
        let sizes = |cells: &[Cell]| cells.iter().map(|cell| cell.percent).collect::<Vec<_>>();
        if sizes(&a) != sizes(&b) {
            let [of_a, of_b] =
                [&a, &b].map(|cells| format!("{} of {:?} %", cells[0].kind, sizes(cells)));
            return Err(Untestable(format!("different sizes: {of_a}, {of_b}")));
        }
        Ok(a.into_iter().zip(b).map(|(a, b)| [a, b]).collect())
    }

    /// The cells of all four kinds at these sizes, by kind.
    pub fn all_cells(&self, of: &Sizes) -> Result<Vec<Vec<Cell<'a>>>, Untestable> {
        kinds().map(|kind| self.cells(kind, of)).collect()
    }
}

/// ln(a / b) of a column, for the same runs in the cells of each pair, by block.
pub(super) fn log_ratios(pairs: &[[Cell; 2]], column: &str) -> Result<Blocked, Untestable> {
    let mut ratios = Vec::new();
    for [a, b] in pairs {
        let logs =
            |cell: &Cell| cell.values(column)?.map(math::ln).map_err(|error| cell.because(error));
        ratios.push(logs(a)?.minus(&logs(b)?).map_err(|error| a.because(error))?);
    }
    match ratios.as_slice() {
        [only] => Ok(only.clone()),
        all => Ok(Blocked::new(all.iter().flat_map(Blocked::values))?),
    }
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

    /// The only cell of a kind.
    fn cell<'a>(results: &'a Results, kind: &str) -> Cell<'a> {
        let data = Sampled::of(results, WEIGHTED, true).unwrap().remove(0);
        data.cells(kind, &Sizes::ALL).unwrap().remove(0)
    }

    fn compare(results: &Results, a: &str, b: &str) -> Result<Effect, Untestable> {
        cell(results, a).against(&cell(results, b), WEIGHTED, TestKind::Paired, true)
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
        let test = compare(&results, "gbs+f-km", "gbs").unwrap();
        assert!((test.mean_difference + 2.5).abs() < 1e-12);
        assert_eq!((test.degrees_of_freedom, test.blocks), (3.0, [4, 4]));
        // Mean −2.5 with a standard error of √(5/3)/2.
        assert!((test.t + 2.5 / ((5.0f64 / 3.0).sqrt() / 2.0)).abs() < 1e-12);
        // With a single size, the pooled test is the same test.
        let pair = [[cell(&results, "gbs+f-km"), cell(&results, "gbs")]];
        assert_eq!(one_sample(&log_ratios(&pair, WEIGHTED).unwrap()).unwrap(), test);
    }

    #[test]
    fn runs_that_are_not_everywhere_do_not_count() {
        let mut results = planted::localization(&[1.0], |kind, _, run, _| match (kind, run) {
            ("gbs", 7) => 1000.0,
            _ => 1.0,
        });
        planted::edit(&mut results, |row| row.text("map") != "rnd" || row.number("run") != 7.0);
        assert_eq!(compare(&results, "gbs", "rnd").unwrap().mean_difference, 0.0);
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
        for (kind, why) in [
            ("rnd", "too few to tell: 0 independent blocks, at least 2 needed"),
            ("rnd+f-km", "no ratio: weighted is 0 in a run, expected above 0"),
            ("gbs+f-km", "not every row has weighted"),
        ] {
            let expected = format!("gbs 1 %: against {kind} 1 %: {why}");
            assert_eq!(reason(compare(&results, "gbs", kind)), expected);
        }
        assert!(reason(log_ratios(&[], WEIGHTED)).contains("0 independent blocks"));
        planted::edit(&mut results, |row| row.number("draw") == 0.0);
        assert!(reason(compare(&results, "gbs", "gbs")).contains("1 independent block,"));
        // Fault: a size that was listed twice made two samples of one.
        let mut results = planted::localization(&[1.0], |_, _, _, scatter| scatter);
        planted::edit(&mut results, |row| {
            row.set("run", row.number("draw") as u32);
            true
        });
        let twice = reason(cell(&results, "gbs").values(WEIGHTED));
        assert!(twice.contains("block 0 holds unit 0 more than once"), "{twice}");
    }

    #[test]
    fn sizes_of_two_kinds_are_the_same() {
        let mut results = planted::localization(&[0.5, 1.0], |_, _, _, scatter| scatter);
        planted::edit(&mut results, |row| {
            row.text("map") != "rnd" || row.number("size_percent") == 1.0
        });
        let data = &Sampled::of(&results, WEIGHTED, true).unwrap()[0];
        assert_eq!(
            reason(data.pairs("gbs", "rnd", &Sizes::ALL)),
            "different sizes: gbs of [0.5, 1.0] %, rnd of [1.0] %"
        );
    }
}
