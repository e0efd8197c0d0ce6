use std::path::Path;

use anyhow::Result;

use super::{RunOptions, SUMMARY, TRIALS, Trials, draw_figures, prepare};
use crate::experiment::{
    DatasetFacts, Kind, LocalizationData, Manifest, RepresentationRow, RepresentationTrial,
    RepresentationsExperiment, TrialOutcome, TrialStore, summarize_representations, write_rows,
};
use mcl_study::data::source::LogSource;

/// Runs an experiment on kinds of maps on one log; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &RepresentationsExperiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let facts = DatasetFacts::of(source, source.points()?.len());
    let manifest = Manifest::new(name, Kind::Representations, experiment, facts)?;
    let _prepared = prepare(folder, &manifest, options.fresh)?;
    let settings = experiment.filter.with_max_range(source.max_range)?;
    let splits = LocalizationData::of_splits(&experiment.splits, source)?;

    let mut store: TrialStore<RepresentationRow> = TrialStore::open(&folder.join(TRIALS))?;
    let trials = Trials::divide(
        &source.name,
        folder,
        experiment.trials(&source.name),
        &mut store,
        RepresentationRow::key,
        RepresentationTrial::keys,
    )?;
    let outcome = trials.run(&mut store, options, |trial, watch| {
        let data = splits.iter().find(|data| data.split == trial.split);
        experiment.run_trial(data.expect("every split has its data"), &settings, trial, watch)
    })?;
    let rows = store.finish(RepresentationRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize_representations(&rows)?)?;
    draw_figures(folder)?;
    Ok(outcome)
}
