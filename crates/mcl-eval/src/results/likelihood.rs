use std::path::Path;

use anyhow::Result;
use mcl_core::Point;
use mcl_maps::PointSet;

use super::{MAPS, RunOptions, SUMMARY, TESTS, TRIALS, Trials, draw_figures, maps, prepare};
use crate::experiment::{
    DatasetFacts, Kind, LikelihoodExperiment, LikelihoodRow, Manifest, TrialOutcome, TrialStore,
    run_likelihood_trial, summarize, test_improvement, trials, write_rows,
};
use mcl_study::data::cloud_source::Points;
use mcl_study::data::source::DataSource;

/// Runs a likelihood experiment on one log or point cloud; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &LikelihoodExperiment,
    name: &str,
    source: &DataSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let manifest =
        Manifest::new(name, Kind::Likelihood, experiment, DatasetFacts::of_data(source)?)?;
    match source.points()? {
        Points::Planar(points) => run_on(points, experiment, &manifest, folder, options),
        Points::Spatial(points) => run_on(points, experiment, &manifest, folder, options),
    }
}

fn run_on<const D: usize>(
    points: Vec<Point<D>>,
    experiment: &LikelihoodExperiment,
    manifest: &Manifest,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let dataset = manifest.dataset.name.as_str();
    let prepared = prepare(folder, manifest, options.fresh)?;
    let data = PointSet::new(points)?;

    let mut store = TrialStore::open(&folder.join(TRIALS))?;
    let trials = Trials::divide(
        dataset,
        folder,
        trials(experiment, dataset, experiment.sizes_for(dataset), data.len()),
        &mut store,
        LikelihoodRow::key,
        |trial| vec![trial.key()],
    )?;
    let outcome = trials.run(&mut store, options, |trial, watch| {
        Ok(vec![run_likelihood_trial(experiment, dataset, &data, trial, watch)?])
    })?;
    let rows = store.finish(LikelihoodRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize(&rows)?)?;
    write_rows(&folder.join(TESTS), &test_improvement(&rows)?)?;

    let folder_of_maps = folder.join(MAPS);
    let unchanged = prepared
        .earlier
        .as_ref()
        .map(|earlier| earlier.definition::<LikelihoodExperiment>())
        .transpose()?
        .is_some_and(|earlier| earlier.figures == experiment.figures);
    if !unchanged || !maps::complete(&folder_of_maps) {
        maps::build(experiment, dataset, &data, &folder_of_maps)?;
    }
    draw_figures(folder)?;
    Ok(outcome)
}
