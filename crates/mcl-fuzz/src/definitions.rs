//! The TOML files: data sets and experiments.

use std::path::Path;

use mcl_datasets::registry::{Dataset, Source};
use mcl_eval::experiment::{
    DatasetFacts, Definition, Experiment, Kind, Manifest, localization_trials, refinement_trials,
    sensitivity_trials, trials,
};
use serde::Serialize;

use crate::memory::{ANY_INPUT, bounded};

/// toml keeps a document as a tree of values with their places.
const PER_BYTE: usize = 1_000;
/// Trials of the largest experiment that a short text may ask for, in bytes.
const TRIALS: usize = 1 << 30;

/// A `dataset.toml`.
pub fn dataset(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let parsed = bounded(bytes.len(), ANY_INPUT, PER_BYTE, || Dataset::parse("lab", text));
    let dataset = match parsed {
        Ok(dataset) => dataset,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    assert_eq!(dataset.name, "lab");
    assert!(dataset.max_range.is_finite() && dataset.max_range > 0.0);
    assert!(dataset.robot_from_laser.is_finite());
    if let Source::File(file) = &dataset.source {
        // Names are joined to folders that are written to.
        let folder = Path::new("folder");
        for name in std::iter::once(&file.name).chain(&file.other_names) {
            assert_eq!(folder.join(name).parent(), Some(folder), "{name:?}");
        }
        assert!(file.urls.is_empty() || !file.copies.is_empty());
    }
}

/// The TOML of an experiment: it survives the way through a manifest, which a stopped run goes on by,
/// and its trials can be listed.
pub fn experiment(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let parsed = bounded(bytes.len(), ANY_INPUT, PER_BYTE, || Experiment::parse(text));
    let experiment = match parsed {
        Ok(experiment) => experiment,
        Err(error) => return assert!(!format!("{error:#}").is_empty()),
    };
    let names = experiment.dataset_names().into_iter().map(str::to_owned);
    for name in names.chain(["elsewhere".to_owned()]).take(3) {
        bounded(bytes.len(), TRIALS, PER_BYTE, || match &experiment {
            Experiment::Likelihood(e) => drop(trials(e, &name, e.sizes_for(&name), 1_000)),
            Experiment::Localization(e) => drop(localization_trials(e, &name)),
            Experiment::Sensitivity(e) => drop(sensitivity_trials(e, &name)),
            Experiment::Refinement(e) => drop(refinement_trials(e, &name)),
            Experiment::Representations(e) => drop(e.trials(&name)),
            Experiment::Choices(e) => drop(e.trials(1000)),
        });
    }
    match &experiment {
        Experiment::Likelihood(e) => through_a_manifest(Kind::Likelihood, e),
        Experiment::Localization(e) => through_a_manifest(Kind::Localization, e),
        Experiment::Sensitivity(e) => through_a_manifest(Kind::Sensitivity, e),
        Experiment::Refinement(e) => through_a_manifest(Kind::Refinement, e),
        Experiment::Choices(e) => through_a_manifest(Kind::Choices, e),
        Experiment::Representations(e) => through_a_manifest(Kind::Representations, e),
    }
}

fn through_a_manifest<D: Serialize + Definition + PartialEq + std::fmt::Debug>(
    kind: Kind,
    definition: &D,
) {
    let facts = DatasetFacts {
        name: "lab".to_owned(),
        title: "Lab".to_owned(),
        sha256: "00".to_owned(),
        scans: 1,
        max_range: Some(10.0),
        dimensions: 2,
        points: 1_000,
        skipped_records: 0,
    };
    let manifest = Manifest::new("fuzzed", kind, definition, facts).expect("JSON holds it");
    let text = serde_json::to_string_pretty(&manifest).expect("JSON holds it");
    let saved = Manifest::parse(&text).expect("what was written can be read");
    manifest.check_continues(&saved).expect("the same definition");
    assert_eq!(saved.definition::<D>().expect("the same kind"), *definition);
}
