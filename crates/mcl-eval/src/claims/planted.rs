//! Studies with planted rows, for tests.

use std::path::PathBuf;

use mcl_core::Seed;
use mcl_study::data::facts::DataFacts;
use mcl_study::store::results::Results;
use mcl_study::study::definition::Study;
use mcl_study::table::{Cells, Row, Table, Value};
use rand::RngExt;

const FOUR_KINDS: &str = r#"["gbs", "gbs+f-km", "rnd", "rnd+f-km"]"#;

/// A row that a test fills or edits.
#[derive(Clone, Default)]
pub(crate) struct PlantedRow(Cells);

impl PlantedRow {
    pub fn text(&self, column: &str) -> &str {
        self.get(column).and_then(Value::text).unwrap_or_default()
    }

    pub fn number(&self, column: &str) -> f64 {
        self.get(column).and_then(Value::number).unwrap_or(f64::NAN)
    }

    pub fn set(&mut self, column: &str, value: impl Into<Value>) {
        match self.0.iter_mut().find(|(name, _)| name == column) {
            Some((_, old)) => *old = value.into(),
            None => self.0.push((column.to_owned(), value.into())),
        }
    }

    fn get(&self, column: &str) -> Option<&Value> {
        self.0.iter().find(|(name, _)| name == column).map(|(_, value)| value)
    }
}

/// A complete study of this text on the office, each row filled by a function.
pub(crate) fn study(name: &str, text: &str, fill: impl FnMut(&mut PlantedRow)) -> Results {
    let study = Study::parse(&format!("seed = 1\n{text}")).unwrap();
    let plan = study.plan("office").unwrap();
    let columns = plan.columns(&study.measures).unwrap();
    let mut rows = rows(&plan.recipes().unwrap(), &columns);
    rows.iter_mut().for_each(fill);
    let asked = plan.trials.len();
    Results {
        folder: PathBuf::new(),
        name: name.into(),
        study,
        plan,
        facts: office_facts(),
        table: Table::of_cells(rows.into_iter().map(|row| row.0)),
        done: asked,
        asked,
        without_rows: Vec::new(),
        pictured: Vec::new(),
        damage: Vec::new(),
    }
}

/// Facts about the data of planted studies.
pub(crate) fn office_facts() -> DataFacts {
    DataFacts {
        name: "office".into(),
        title: "Simulated office".into(),
        sha256: "00".into(),
        dimensions: 2,
        scans: 50,
        max_range: Some(10.0),
        points: 10_000,
        skipped_records: 0,
    }
}

/// Five maps of each kind and size, with likelihoods (initial, refined) from the planted truth: a function of
/// whether the map is a random one, size, and a scatter of about ±1 that sums to 0.
pub(crate) fn likelihood(sizes: &[f64], truth: impl Fn(bool, f64, f64) -> (f64, f64)) -> Results {
    let scatter = [-1.0, 0.6, 0.1, -0.5, 0.8];
    let text = format!(
        "measures = [\"likelihood\"]\n[[trials]]\nmap = {FOUR_KINDS}\nsize = {sizes:?}\ndraws = 5\n\
         [[views.pictures]]\nname = \"figure2-sampling\"\nmaps = [{{ map = \"rnd\", size = 1 }}, \
         {{ map = \"gbs\", size = 1 }}]\n"
    );
    study("likelihood", &text, |row| {
        let size = row.number("size_percent");
        let is_random = row.text("map").starts_with("rnd");
        let (initial, improved) = truth(is_random, size, scatter[row.number("draw") as usize]);
        let likelihood = if row.text("map").ends_with("+f-km") { improved } else { initial };
        row.set("log_likelihood", likelihood);
        row.set("requested_points", (100.0 * size) as usize);
        row.set("map_points", (100.0 * size) as usize);
    })
}

/// Eight runs on four maps of every kind and size, with errors from the planted truth: a function of kind,
/// size, run, and a random scatter of up to 1 % about 1. Errors above 1 are divergences.
pub(crate) fn localization(sizes: &[f64], truth: impl Fn(&str, f64, u32, f64) -> f64) -> Results {
    let mut rng = Seed::new(1).derive("scatter").rng();
    let text = format!("[[trials]]\nmap = {FOUR_KINDS}\nsize = {sizes:?}\ndraws = 4\nruns = 2\n");
    study("localization", &text, |row| {
        let (size, run) = (row.number("size_percent"), row.number("run") as u32);
        let weighted = truth(row.text("map"), size, run, rng.random_range(0.99..1.01));
        row.set("weighted", weighted);
        row.set("diverged", weighted > 1.0);
    })
}

/// Edits the rows of a study, and removes those for which the function returns false.
pub(crate) fn edit(results: &mut Results, keep: impl Fn(&mut PlantedRow) -> bool) {
    let mut rows = rows(&results.table, results.table.columns());
    rows.retain_mut(keep);
    results.table = Table::of_cells(rows.into_iter().map(|row| row.0));
}

/// The study with every run repeated this many times, with different run numbers.
pub(crate) fn with_repeated_runs(results: &Results, times: u32) -> Results {
    let rows = rows(&results.table, results.table.columns());
    let repeated = (0..times).flat_map(|time| {
        rows.iter().cloned().map(move |mut row| {
            row.set("run", row.number("run") as u32 + 1000 * time);
            row.0
        })
    });
    Results { table: Table::of_cells(repeated), ..results.clone() }
}

/// The rows of a table in these columns.
fn rows(table: &Table, columns: &[String]) -> Vec<PlantedRow> {
    let cells = |row: Row| {
        PlantedRow(columns.iter().map(|name| (name.clone(), row.get(name).clone())).collect())
    };
    table.rows().map(cells).collect()
}
