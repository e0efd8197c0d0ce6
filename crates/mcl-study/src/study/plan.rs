//! The trials of a study on a data set.

use std::collections::{HashMap, HashSet};

use anyhow::Result;

use crate::measure::Measures;
use crate::recipe::identity;
use crate::table::Table;
use crate::trial::run::Trial;

/// The trials of a study on a data set, each map once.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    /// The trials.
    pub trials: Vec<Trial>,
    /// Place of a map's trial, by the map's identity, its name and draw.
    places: HashMap<(String, String, u32), usize>,
    /// The entries of `[[trials]]` that ask for a row, by place of trial and run: places of their names.
    entries: HashMap<(usize, Key), Vec<usize>>,
    names: Vec<String>,
}

/// The column of the names of the entries that ask for a row.
pub const ENTRIES: &str = "trials";

/// A digest of a run, which distinguishes it from the others on its map; `None` for the map's own row, where there is
/// no run.
type Key = Option<String>;

/// The keys of a trial's rows, of its runs in JSON.
fn keys(runs: &[serde_json::Value]) -> Result<Vec<Key>> {
    if runs.is_empty() {
        return Ok(vec![None]);
    }
    runs.iter().map(|run| identity(run).map(Some)).collect()
}

impl Plan {
    /// Adds a trial of an entry; runs on a map that is there join those on it.
    pub(crate) fn add(&mut self, trial: Trial, entry: Option<&str>) -> Result<()> {
        let key = (trial.map.identity()?, trial.map.kind.name.clone(), trial.map.draw);
        let runs = keys(&trial.runs_in_json()?)?;
        let place = match self.places.get(&key) {
            Some(&place) => {
                let known: HashSet<Key> =
                    keys(&self.trials[place].runs_in_json()?)?.into_iter().collect();
                let new =
                    trial.runs.into_iter().zip(&runs).filter(|(_, key)| !known.contains(*key));
                self.trials[place].runs.extend(new.map(|(run, _)| run));
                place
            }
            None => {
                self.trials.push(trial);
                self.places.insert(key, self.trials.len() - 1);
                self.trials.len() - 1
            }
        };
        if let Some(entry) = entry {
            let known = self.names.iter().position(|name| name == entry);
            let name = known.unwrap_or_else(|| {
                self.names.push(entry.to_owned());
                self.names.len() - 1
            });
            for run in runs {
                let asking = self.entries.entry((place, run)).or_default();
                if !asking.contains(&name) {
                    asking.push(name);
                }
            }
        }
        Ok(())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.trials.iter().map(|trial| trial.runs.len().max(1)).sum()
    }

    /// Names of the entries of `[[trials]]` that have one.
    pub fn entry_names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// The identities of the rows of a trial, given by its place in the plan, each with the names of the entries that
    /// ask for it, separated by spaces.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn identities_of(
        &self,
        number: usize,
        measures: &Measures,
    ) -> Result<Vec<(String, String)>> {
        let trial = &self.trials[number];
        let runs = trial.runs_in_json()?;
        let entries = keys(&runs)?.into_iter().map(|key| self.entries_of(number, key));
        Ok(trial.identities_of(&runs, measures)?.into_iter().zip(entries).collect())
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
            for (key, run) in keys(&trial.runs_in_json()?)?.into_iter().zip(runs) {
                let entries = (ENTRIES.to_owned(), self.entries_of(place, key).into());
                rows.push([&of_map[..], &run, &[entries]].concat());
            }
        }
        Ok(Table::of_cells(rows))
    }

    fn entries_of(&self, place: usize, key: Key) -> String {
        let asking = self.entries.get(&(place, key)).into_iter().flatten();
        asking.map(|&name| self.names[name].as_str()).collect::<Vec<_>>().join(" ")
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
