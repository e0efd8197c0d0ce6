use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

use super::store::write_atomically;
use super::{LikelihoodExperiment, SizeGroup};
use crate::source::{LogSource, digest};

/// What a result directory was computed from and by: kept as `manifest.json` beside the rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the experiment: its file's name without the ending.
    pub experiment: String,
    /// Version of the program.
    pub version: String,
    /// The data.
    pub dataset: DatasetFacts,
    /// The definition, with the sizes that apply to this data set.
    pub definition: LikelihoodExperiment,
}

/// What an experiment's data was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DatasetFacts {
    /// Name in the registry, or of the file.
    pub name: String,
    /// Title for figures.
    pub title: String,
    /// SHA-256 of the recording's content, whatever the file it came from.
    pub sha256: String,
    /// Number of scans.
    pub scans: usize,
    /// Largest reading that counted, in metres.
    pub max_range: f64,
    /// Number of points.
    pub points: usize,
    /// Malformed records that were skipped.
    pub skipped_records: usize,
}

impl DatasetFacts {
    /// The facts of an open log with its number of points.
    pub fn of(source: &LogSource, points: usize) -> Self {
        DatasetFacts {
            name: source.name.clone(),
            title: source.title.clone(),
            sha256: digest(&source.recording),
            scans: source.recording.scans.len(),
            max_range: source.max_range,
            points,
            skipped_records: source.report.skipped,
        }
    }
}

impl Manifest {
    /// The manifest of an experiment on a data set.
    pub fn new(
        experiment: &str,
        definition: &LikelihoodExperiment,
        dataset: DatasetFacts,
        sizes: &[SizeGroup],
    ) -> Self {
        Manifest {
            experiment: experiment.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            definition: LikelihoodExperiment {
                sizes: sizes.to_vec(),
                datasets: Vec::new(),
                ..definition.clone()
            },
            dataset,
        }
    }

    /// Reads a manifest.
    ///
    /// # Errors
    /// When the file cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("in {}", path.display()))
    }

    /// Writes the manifest, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        write_atomically(path, text.as_bytes())
    }

    /// Whether rows of an earlier run may stand beside rows of this one: same data, same settings.
    /// More sizes and repeats may be added; figure sizes do not matter to rows.
    ///
    /// # Errors
    /// When they may not; the message names the first difference.
    pub fn check_continues(&self, earlier: &Manifest) -> Result<()> {
        let settings = |manifest: &Manifest| {
            let definition = &manifest.definition;
            [
                ("version", manifest.version.clone()),
                ("data (sha256)", manifest.dataset.sha256.clone()),
                ("max_range", manifest.dataset.max_range.to_string()),
                ("seed", definition.seed.to_string()),
                ("sigma", definition.sigma.to_string()),
                ("tolerance", definition.tolerance.to_string()),
                ("max_iterations", definition.max_iterations.to_string()),
            ]
        };
        for ((name, now), (_, before)) in settings(self).into_iter().zip(settings(earlier)) {
            if now != before {
                bail!(
                    "the rows there were computed with {name} {before}, this run has {now}; \
                     --fresh starts anew, -o writes elsewhere"
                );
            }
        }
        Ok(())
    }
}
