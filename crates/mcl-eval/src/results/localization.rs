use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::{PointMap, Pose2, Stamp, Trajectory};
use mcl_filter::{CheckedSettings, MapDistances};
use mcl_maps::files::{Encoding, write_map};
use mcl_metrics::tum;

use super::{RunOptions, SUMMARY, TESTS, TRIALS, Trials, draw_figures, prepare};
use crate::experiment::{
    Builder, DatasetFacts, Kind, LocalizationData, LocalizationExperiment, LocalizationRow,
    LocalizationTrial, Manifest, MapStrategy, TrialOutcome, TrialStore, localization_trials,
    summarize_localization, test_localization, write_rows,
};
use mcl_study::data::source::LogSource;

/// The run that the trajectory figure shows.
pub(super) const TRAJECTORY: &str = "trajectory";
pub(super) const MAP_FILE: &str = "map.ply";
pub(super) const REFERENCE_FILE: &str = "reference.tum";
pub(super) const ESTIMATE_FILE: &str = "estimate.tum";

/// Runs a localization experiment on one log; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &LocalizationExperiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let facts = DatasetFacts::of(source, source.points()?.len());
    let manifest = Manifest::new(name, Kind::Localization, experiment, facts)?;
    let prepared = prepare(folder, &manifest, options.fresh)?;
    let settings = experiment.filter.with_max_range(source.max_range)?;
    let splits = LocalizationData::of_splits(&experiment.splits, source)?;

    let mut store: TrialStore<LocalizationRow> = TrialStore::open(&folder.join(TRIALS))?;
    let data_of = |trial: &LocalizationTrial| {
        splits.iter().find(|data| data.split == trial.split).expect("every split has its data")
    };
    let trials = Trials::divide(
        &source.name,
        folder,
        localization_trials(experiment, &source.name),
        &mut store,
        LocalizationRow::key,
        LocalizationTrial::keys,
    )?;
    let outcome = trials.run(&mut store, options, |trial, watch| {
        experiment.run_trial(data_of(trial), &settings, trial, watch)
    })?;
    let rows = store.finish(LocalizationRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize_localization(&rows)?)?;
    write_rows(&folder.join(TESTS), &test_localization(&rows)?)?;

    let unchanged = prepared
        .earlier
        .as_ref()
        .map(|earlier| earlier.definition::<LocalizationExperiment>())
        .transpose()?
        .is_some_and(|earlier| earlier.figures == experiment.figures);
    let trajectory = folder.join(TRAJECTORY);
    if !unchanged || !trajectory.join(ESTIMATE_FILE).exists() {
        save_trajectory(experiment, &splits[0], &settings, &trajectory)?;
    }
    // Figures take memory, too, and are drawn from files.
    drop(splits);
    draw_figures(folder)?;
    Ok(outcome)
}

/// Saves run 0 on the first improved grid-based map of the figure's size: map and trajectories.
fn save_trajectory(
    experiment: &LocalizationExperiment,
    data: &LocalizationData<'_>,
    settings: &CheckedSettings,
    folder: &Path,
) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let of_figure = LocalizationExperiment {
        sizes: vec![experiment.figures.trajectory],
        datasets: Vec::new(),
        ..experiment.clone()
    };
    let trial = localization_trials(&of_figure, data.dataset)
        .into_iter()
        .find(|trial| trial.split == data.split && trial.builder == Some(Builder::Grid))
        .context("the experiment has no trial of grid-based maps")?;
    let maps = experiment.maps_of(data, &trial)?;
    let (_, map): &(MapStrategy, PointMap<2>) = maps.last().context("a trial has maps")?;
    let distances = MapDistances::grid(map, settings.values().max_distance)?;
    let tracked = experiment.track(data, &distances, settings, 0)?;
    write_map(folder.join(MAP_FILE), map, Encoding::Binary)?;

    let scans = &data.recording.scans;
    let save = |name: &str, poses: Vec<Pose2>| -> Result<()> {
        let stamped = data.scans.iter().zip(poses);
        // TUM files need a time for every pose; without stamps the scan's number serves.
        let trajectory: Trajectory = stamped
            .map(|(&scan, pose)| {
                let number = Stamp::from_nanoseconds(scan as i64 * 1_000_000_000);
                (scans[scan].stamp.unwrap_or(number), pose)
            })
            .collect();
        Ok(tum::write_file(folder.join(name), &trajectory)?)
    };
    save(REFERENCE_FILE, data.reference.clone())?;
    // Last: its presence says that the others are there.
    save(ESTIMATE_FILE, tracked.run.map_from_laser)
}
