//! The trials of a study on a data set.

use std::collections::HashMap;
use std::sync::Arc;

use anyhow::Result;

use crate::measure::Measures;
use crate::recipe::run::{RunRecipe, WrittenRun};
use crate::table::Table;
use crate::trial::run::Trial;

/// The trials of a study on a data set, each map once.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    /// The trials.
    pub trials: Vec<Trial>,
    /// The identities of the rows of each trial, and the entries that ask for them.
    asked: Vec<TrialRows>,
    /// Index of a map's trial, by the map's identity, its name and draw.
    places: HashMap<(String, String, u32), usize>,
    names: Vec<String>,
    /// The last run added of each number.
    last: HashMap<u32, (RunRecipe, Arc<WrittenRun>)>,
}

/// The rows of a trial.
#[derive(Debug, Clone, Default)]
struct TrialRows {
    /// The identity of the map.
    map: String,
    /// The trial's runs in their order, and the entries that ask for each.
    runs: Vec<(Arc<WrittenRun>, Vec<usize>)>,
    /// The entries that ask for the row of the map, which exists where there is no run.
    alone: Vec<usize>,
}

/// The column with the names of the entries that ask for a row.
pub const ENTRIES: &str = "trials";

impl Plan {
    /// Adds a trial of an entry; runs on an existing map are added to its trial.
    pub(crate) fn add(&mut self, trial: Trial, entry: Option<&str>) -> Result<()> {
        let map = trial.map.identity()?;
        let key = (map.clone(), trial.map.kind.name.clone(), trial.map.draw);
        let runs = self.written(&trial.runs)?;
        let is_alone = runs.is_empty();
        let place = match self.places.get(&key) {
            Some(&place) => place,
            None => {
                self.places.insert(key, self.trials.len());
                self.trials.push(Trial { map: trial.map, runs: Vec::new() });
                self.asked.push(TrialRows { map, ..TrialRows::default() });
                self.trials.len() - 1
            }
        };
        let name = entry.map(|entry| {
            self.names.iter().position(|name| name == entry).unwrap_or_else(|| {
                self.names.push(entry.to_owned());
                self.names.len() - 1
            })
        });
        let TrialRows { runs: known, alone, .. } = &mut self.asked[place];
        let ask = |asking: &mut Vec<usize>| {
            asking.extend(name.filter(|name| !asking.contains(name)));
        };
        if is_alone {
            ask(alone);
        }
        let before: HashMap<String, usize> =
            known.iter().enumerate().map(|(k, (run, _))| (run.key.clone(), k)).collect();
        for (run, written) in trial.runs.into_iter().zip(runs) {
            match before.get(&written.key) {
                Some(&k) => ask(&mut known[k].1),
                None => {
                    let mut asking = Vec::new();
                    ask(&mut asking);
                    known.push((written, asking));
                    self.trials[place].runs.push(run);
                }
            }
        }
        Ok(())
    }

    /// The runs as JSON. Runs with the same number are mostly the same on every map.
    fn written(&mut self, runs: &[RunRecipe]) -> Result<Vec<Arc<WrittenRun>>> {
        let written = |run: &RunRecipe| match self.last.get(&run.run) {
            Some((known, written)) if known == run => Ok(written.clone()),
            _ => {
                let written = Arc::new(WrittenRun::of(run)?);
                self.last.insert(run.run, (run.clone(), written.clone()));
                Ok(written)
            }
        };
        runs.iter().map(written).collect()
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.trials.iter().map(|trial| trial.runs.len().max(1)).sum()
    }

    /// Names of the entries of `[[trials]]` that have a name.
    pub fn entry_names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// The identities of the rows of a trial, given by its index in the plan, each with the names of the
    /// entries that ask for it, separated by spaces.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn identities_of(
        &self,
        number: usize,
        measures: &Measures,
    ) -> Result<Vec<(String, String)>> {
        let asked = &self.asked[number];
        let runs = asked.runs.iter().map(|(run, _)| &**run);
        let identities = self.trials[number].identities_of(&asked.map, runs, measures)?;
        Ok(identities.into_iter().zip(self.entries_of(number)).collect())
    }

    /// The recipe of every row, with the names of the entries that ask for it in the column [`ENTRIES`].
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn recipes(&self) -> Result<Table> {
        let mut rows = Vec::with_capacity(self.rows());
        for (place, trial) in self.trials.iter().enumerate() {
            let of_map = trial.map.cells();
            let runs = trial.runs.iter().map(|run| run.cells()).collect::<Result<Vec<_>>>()?;
            let runs = if runs.is_empty() { vec![Vec::new()] } else { runs };
            for (entries, run) in self.entries_of(place).zip(runs) {
                rows.push([&of_map[..], &run, &[(ENTRIES.to_owned(), entries.into())]].concat());
            }
        }
        Ok(Table::of_cells(rows))
    }

    /// The names of the entries that ask for each row of a trial.
    fn entries_of(&self, place: usize) -> impl Iterator<Item = String> {
        let TrialRows { runs, alone, .. } = &self.asked[place];
        let alone = runs.is_empty().then_some(alone);
        runs.iter().map(|(_, asking)| asking).chain(alone).map(|asking| {
            asking.iter().map(|&name| self.names[name].as_str()).collect::<Vec<_>>().join(" ")
        })
    }

    /// The columns that rows will have.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn columns(&self, measures: &Measures) -> Result<Vec<String>> {
        let mut columns: Vec<String> = Vec::new();
        if let Some(trial) = self.trials.first() {
            columns.extend(trial.map.cells().into_iter().map(|(name, _)| name));
        }
        columns.extend(measures.of_maps.iter().flat_map(|m| m.columns).map(|&c| c.to_owned()));
        if let Some(run) = self.trials.iter().find_map(|trial| trial.runs.first()) {
            columns.extend(run.cells()?.into_iter().map(|(name, _)| name));
            columns.extend(measures.of_runs.iter().flat_map(|m| m.columns).map(|&c| c.to_owned()));
        }
        if !self.names.is_empty() {
            columns.push(ENTRIES.to_owned());
        }
        Ok(columns)
    }
}
