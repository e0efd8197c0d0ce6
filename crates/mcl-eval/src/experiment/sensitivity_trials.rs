use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use anyhow::Result;
use mcl_filter::{OdometryNoise, Proposal};
use serde::{Deserialize, Serialize};

use super::localization::row as localization_row;
use super::scheduler::{Stopwatch, Trial};
use super::{
    LocalizationData, LocalizationRow, LocalizationTrial, MapStrategy, SensitivityExperiment,
    Setting, SettingKey, localization_trials,
};

/// A trial: a map before and after fuzzy k-means, and the run that belongs to it under each setting.
#[derive(Debug, Clone, PartialEq)]
pub struct SensitivityTrial {
    map: LocalizationTrial,
    cells: Vec<(Setting, MapStrategy)>,
}

impl Trial for SensitivityTrial {
    fn cost(&self) -> f64 {
        self.cells.len() as f64
    }
}

impl fmt::Display for SensitivityTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.map.fmt(f)
    }
}

impl SensitivityTrial {
    /// Keys of the rows of this trial.
    pub fn keys(&self) -> Vec<SensitivityKey> {
        let (percent, run) = (self.map.size_percent, self.map.map);
        let of =
            |(setting, strategy): &(Setting, MapStrategy)| key(setting, *strategy, percent, run);
        self.cells.iter().map(of).collect()
    }
}

/// What tells a row from the others on its data set; floats by their bits.
pub type SensitivityKey = (SettingKey, MapStrategy, u64, u32);

fn key(setting: &Setting, strategy: MapStrategy, percent: f64, run: u32) -> SensitivityKey {
    (setting.key(), strategy, percent.to_bits(), run)
}

/// All trials of a study on a data set. What several sweeps ask for is run once.
pub fn sensitivity_trials(
    experiment: &SensitivityExperiment,
    dataset: &str,
) -> Vec<SensitivityTrial> {
    // By builder, size and number of the map.
    let mut trials: BTreeMap<_, SensitivityTrial> = BTreeMap::new();
    let mut seen = BTreeSet::new();
    for sweep in experiment.sweeps.iter().filter(|sweep| sweep.covers(dataset)) {
        let runs = sweep.runs.unwrap_or(experiment.runs);
        for setting in sweep.settings(experiment) {
            for map in &sweep.maps {
                let maps = localization_trials(
                    &experiment.localization(&setting, runs, map.percent),
                    dataset,
                );
                let builder = map.strategy.builder();
                for trial in maps.into_iter().filter(|trial| trial.builder == builder) {
                    let (percent, number) = (trial.size_percent, trial.map);
                    if seen.insert(key(&setting, map.strategy, percent, number)) {
                        trials
                            .entry((builder, percent.to_bits(), number))
                            .or_insert(SensitivityTrial { map: trial, cells: Vec::new() })
                            .cells
                            .push((setting, map.strategy));
                    }
                }
            }
        }
    }
    trials.into_values().collect()
}

/// A run of the filter on a map under a setting; columns as in a localization experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/results.md.
pub struct SensitivityRow {
    pub dataset: String,
    pub sigma_hit: f64,
    pub z_rand: f64,
    pub alpha1: f64,
    pub alpha2: f64,
    pub alpha3: f64,
    pub alpha4: f64,
    pub likelihood_exponent: f64,
    pub proposal: Proposal,
    pub noise_xy: f64,
    pub noise_theta: f64,
    pub strategy: MapStrategy,
    pub size_percent: f64,
    pub run: u32,
    pub map_seed: u64,
    pub map_points: usize,
    pub scans: usize,
    pub weighted: f64,
    pub translation: f64,
    pub heading: f64,
    pub diverged: bool,
    pub mean_effective_sample_size: f64,
}

impl SensitivityRow {
    fn new(setting: &Setting, row: LocalizationRow) -> Self {
        SensitivityRow {
            dataset: row.dataset,
            sigma_hit: setting.sigma_hit,
            z_rand: setting.z_rand,
            alpha1: setting.alpha1,
            alpha2: setting.alpha2,
            alpha3: setting.alpha3,
            alpha4: setting.alpha4,
            likelihood_exponent: setting.likelihood_exponent,
            proposal: setting.proposal,
            noise_xy: setting.noise_xy,
            noise_theta: setting.noise_theta,
            strategy: row.strategy,
            size_percent: row.size_percent,
            run: row.run,
            map_seed: row.map_seed,
            map_points: row.map_points,
            scans: row.scans,
            weighted: row.weighted,
            translation: row.translation,
            heading: row.heading,
            diverged: row.diverged,
            mean_effective_sample_size: row.mean_effective_sample_size,
        }
    }

    /// The setting of the row.
    pub fn setting(&self) -> Setting {
        Setting::new(
            self.sigma_hit,
            self.z_rand,
            [self.alpha1, self.alpha2, self.alpha3, self.alpha4],
            self.likelihood_exponent,
            self.proposal,
            OdometryNoise { xy: self.noise_xy, theta: self.noise_theta },
        )
    }

    /// What tells this row from the others on its data set.
    pub fn key(&self) -> SensitivityKey {
        key(&self.setting(), self.strategy, self.size_percent, self.run)
    }
}

impl SensitivityExperiment {
    /// Runs one trial: a row per setting and strategy. `max_range` as of the data (m).
    ///
    /// # Errors
    /// When a map cannot be built or the filter cannot run.
    pub fn run_trial(
        &self,
        data: &LocalizationData<'_>,
        max_range: f64,
        trial: &SensitivityTrial,
        watch: &mut Stopwatch,
    ) -> Result<Vec<SensitivityRow>> {
        let map_trial = &trial.map;
        let under = |setting: &Setting| self.localization(setting, 1, map_trial.size_percent);
        let Some((any, _)) = trial.cells.first() else { return Ok(Vec::new()) };
        let mut rows = Vec::new();
        let maps = under(any).maps_of(data, map_trial)?;
        watch.lap("maps");
        for (strategy, map) in maps {
            let distances = data.distances(strategy, &map, self.filter.max_distance)?;
            watch.lap("distance fields");
            for (setting, _) in trial.cells.iter().filter(|(_, wanted)| *wanted == strategy) {
                let experiment = under(setting);
                let settings = experiment.filter.with_max_range(max_range)?;
                let tracked = experiment.track(data, &distances, &settings, map_trial.map)?;
                let row = localization_row(
                    data,
                    map_trial,
                    strategy,
                    map.len(),
                    map_trial.map,
                    &tracked,
                )?;
                rows.push(SensitivityRow::new(setting, row));
            }
            watch.lap("filter");
        }
        Ok(rows)
    }
}
