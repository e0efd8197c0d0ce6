use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Serialize;

use super::{RunOptions, SUMMARY, TESTS, TRIALS, Trials, draw_figures, prepare};
use crate::experiment::{
    DatasetFacts, Kind, LocalizationData, Manifest, RankedSetting, SensitivityExperiment,
    SensitivityRow, SensitivityTrial, Split, TrialOutcome, TrialStore, compare_strategies,
    rank_settings, read_rows, sensitivity_trials, summarize_sensitivity, write_rows,
};
use mcl_study::data::source::LogSource;

/// The ranking of the settings over all data sets, beside their folders.
const RANKING: &str = "ranking.csv";

/// Runs a sensitivity study on one log; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &SensitivityExperiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let limit = experiment.of_dataset(&source.name).and_then(|dataset| dataset.scans);
    let part = limit.map(|scans| source.first_scans(scans));
    let source = part.as_ref().unwrap_or(source);
    let points = source.points()?.len();
    let facts = DatasetFacts::of(source, points);
    let manifest = Manifest::new(name, Kind::Sensitivity, experiment, facts)?;
    let _prepared = prepare(folder, &manifest, options.fresh)?;
    let data =
        LocalizationData::new(Split::Same, &source.name, &source.recording, source.max_range)?;

    let mut store: TrialStore<SensitivityRow> = TrialStore::open(&folder.join(TRIALS))?;
    let trials = Trials::divide(
        &source.name,
        folder,
        sensitivity_trials(experiment, &source.name),
        &mut store,
        SensitivityRow::key,
        SensitivityTrial::keys,
    )?;
    let outcome = trials.run(&mut store, options, |trial, watch| {
        experiment.run_trial(&data, source.max_range, trial, watch)
    })?;
    let rows = store.finish(SensitivityRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize_sensitivity(&rows)?)?;
    write_rows(&folder.join(TESTS), &compare_strategies(&rows)?)?;
    draw_figures(folder)?;
    Ok(outcome)
}

/// Where a ranking was written, and what came first.
pub struct Ranking {
    /// `ranking.csv`: a row per sweep, setting and data set.
    pub path: PathBuf,
    /// The data sets it rests on: those that have a say and results.
    pub datasets: Vec<String>,
    /// The best setting of each sweep, by the sweep's name.
    pub best: Vec<(String, RankedSetting)>,
}

/// Ranks the settings of every sweep over the data sets that have a say, from their saved rows below
/// `folder`, and writes `ranking.csv` there. `None` when none of those data sets has results.
///
/// # Errors
/// When rows cannot be read or the file cannot be written.
pub fn write_ranking(experiment: &SensitivityExperiment, folder: &Path) -> Result<Option<Ranking>> {
    let mut names = Vec::new();
    let mut cells = Vec::new();
    for dataset in experiment.datasets.iter().filter(|dataset| !dataset.reported_only) {
        let path = folder.join(&dataset.name).join(TRIALS);
        if path.exists() {
            let rows: Vec<SensitivityRow> = read_rows(&path)?;
            names.push(dataset.name.as_str());
            cells.push(summarize_sensitivity(&rows)?);
        }
    }
    if names.is_empty() {
        return Ok(None);
    }
    /// What stands before the settings' columns, and what after.
    #[derive(Serialize)]
    struct Place<'a> {
        sweep: &'a str,
        rank: usize,
    }
    #[derive(Serialize)]
    struct Merit<'a> {
        runs: usize,
        diverged: usize,
        score: f64,
        dataset: &'a str,
        error: f64,
    }
    let mut rows = Vec::new();
    let mut best = Vec::new();
    for sweep in &experiment.sweeps {
        let ranked = rank_settings(experiment, sweep, &cells);
        for (index, ranked) in ranked.iter().enumerate() {
            let RankedSetting { setting, score, runs, diverged, .. } = *ranked;
            for (&dataset, &error) in names.iter().zip(&ranked.errors) {
                let place = Place { sweep: &sweep.name, rank: index + 1 };
                rows.push((place, setting, Merit { runs, diverged, score, dataset, error }));
            }
        }
        best.extend(ranked.into_iter().next().map(|ranked| (sweep.name.clone(), ranked)));
    }
    let path = folder.join(RANKING);
    write_rows(&path, &rows)?;
    let datasets = names.into_iter().map(str::to_owned).collect();
    Ok(Some(Ranking { path, datasets, best }))
}
