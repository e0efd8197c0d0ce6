//! The TOML files: data sets and studies.

use std::collections::HashSet;
use std::path::Path;

use mcl_datasets::registry::{Dataset, Origin};
use mcl_study::study::definition::Study;

use crate::memory::{ANY_INPUT, bounded};

/// toml keeps a document as a tree of values with their places.
const PER_BYTE: usize = 1_000;
/// Trials of the largest study that a short text may ask for, in bytes.
const TRIALS: usize = 2 << 30;

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
    if let Origin::File(file) = &dataset.source {
        // Names are joined to folders that are written to.
        let folder = Path::new("folder");
        for name in std::iter::once(&file.name).chain(&file.other_names) {
            assert_eq!(folder.join(name).parent(), Some(folder), "{name:?}");
        }
        assert!(file.urls.is_empty() || !file.copies.is_empty());
    }
}

/// The TOML of a study: it is that of its own text, and its trials can be listed, each with rows of its own.
pub fn study(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let parsed = bounded(bytes.len(), TRIALS, PER_BYTE, || Study::parse(text));
    let study = match parsed {
        Ok(study) => study,
        Err(error) => {
            let message = format!("{error:#}");
            return assert!(!message.is_empty() && message.len() < 10_000);
        }
    };
    assert_eq!(study.text, text);
    let names = study.dataset_names().map(str::to_owned);
    for name in names.chain(["elsewhere".to_owned()]).take(3) {
        let plan = study.plan(&name).expect("it was planned when it was read");
        // To look at each would take longer than the rest.
        if plan.rows() > 500 {
            continue;
        }
        let of_trial =
            |place| plan.identities_of(place, &study.measures).expect("JSON holds recipes");
        let identities: Vec<(String, String)> = (0..plan.trials.len()).flat_map(of_trial).collect();
        assert_eq!(identities.len(), plan.rows());
        let distinct: HashSet<&String> = identities.iter().map(|(identity, _)| identity).collect();
        assert_eq!(distinct.len(), identities.len(), "two rows of one identity");
        plan.columns(&study.measures).expect("JSON holds recipes");
        for picture in &study.views.pictures {
            for map in &picture.maps {
                study.pictured(&name, map, picture.run).expect("it was seen when it was read");
            }
        }
    }
}
