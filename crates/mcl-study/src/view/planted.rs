//! Results with planted rows, for tests.

use std::path::PathBuf;

use crate::data::facts::DataFacts;
use crate::store::results::Results;
use crate::study::definition::Study;
use crate::table::{Row, Table, Value};

/// The measurements for a recipe.
pub type Measured = Vec<(&'static str, Value)>;

/// Results of a study on a data set: a row per map and run, with the measurements that `measure` returns for
/// its recipe.
pub fn planted(text: &str, dataset: &str, measure: impl Fn(&Row<'_>) -> Measured) -> Results {
    let study = Study::parse(text).unwrap();
    let plan = study.plan(dataset).unwrap();
    let columns = plan.columns(&study.measures).unwrap();
    let mut table = Table::new(columns.clone());
    for recipe in plan.recipes().unwrap().rows() {
        let measured = measure(&recipe);
        let value = |column: &String| {
            let found = measured.iter().find(|(name, _)| name == column);
            found.map_or_else(|| recipe.get(column).clone(), |(_, value)| value.clone())
        };
        table.push(columns.iter().map(value).collect());
    }
    table.sort();
    let facts = DataFacts {
        name: dataset.to_owned(),
        title: "Planted".to_owned(),
        sha256: String::new(),
        dimensions: 2,
        scans: 910,
        max_range: Some(10.0),
        points: 10_000,
        skipped_records: 0,
    };
    let asked = plan.trials.len();
    Results {
        folder: PathBuf::from("nowhere"),
        name: "planted".to_owned(),
        study,
        plan,
        facts,
        table,
        done: asked,
        asked,
        without_rows: Vec::new(),
        pictured: Vec::new(),
        damage: Vec::new(),
    }
}

impl Results {
    /// The same without some rows, as if these trials were not done.
    pub fn without(mut self, trials: usize, is_missing: impl Fn(&Row<'_>) -> bool) -> Self {
        let mut table = Table::new(self.table.columns().to_vec());
        for row in self.table.rows().filter(|row| !is_missing(row)) {
            table.push(self.table.columns().iter().map(|column| row.get(column).clone()).collect());
        }
        self.table = table;
        self.done -= trials;
        self
    }
}
