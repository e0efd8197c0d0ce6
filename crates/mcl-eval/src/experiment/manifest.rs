use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::Kind;
use super::definition::Definition;
use super::store::write_atomically;
use mcl_core::text::thousands;
use mcl_study::data::source::{DataSource, LogSource, digest};

/// Keys of a definition that may differ between a run and the one it goes on from: they add trials or
/// concern figures, but change no row.
const GROWING: [&str; 11] = [
    "sizes",
    "plain_sizes",
    "points",
    "grids",
    "ndt",
    "segments",
    "runs",
    "splits",
    "sweep",
    "figures",
    "dataset",
];

/// What a result directory was computed from and by: kept as `manifest.json` beside the rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the experiment: its file's name without the ending.
    pub experiment: String,
    /// What it measures.
    pub kind: Kind,
    /// Version of the program.
    pub version: String,
    /// The data.
    pub dataset: DatasetFacts,
    /// The definition, as in its file.
    pub definition: Value,
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
    /// Dimensions of its points.
    #[serde(default = "planar", skip_serializing_if = "is_planar")]
    pub dimensions: usize,
    /// Number of scans or clouds.
    pub scans: usize,
    /// Largest reading that counted, in metres; of a point cloud without limit none.
    pub max_range: Option<f64>,
    /// Number of points.
    pub points: usize,
    /// Malformed records that were skipped.
    pub skipped_records: usize,
}

const fn planar() -> usize {
    2
}

fn is_planar(dimensions: &usize) -> bool {
    *dimensions == planar()
}

impl DatasetFacts {
    /// The facts of an open log or point cloud.
    ///
    /// # Errors
    /// When a log has no points.
    pub fn of_data(source: &DataSource) -> Result<Self> {
        Ok(match source {
            DataSource::Log(log) => Self::of(log, log.points()?.len()),
            DataSource::Cloud(cloud) => DatasetFacts {
                name: cloud.name.clone(),
                title: cloud.title.clone(),
                sha256: cloud.digest(),
                dimensions: cloud.points.dimensions(),
                scans: cloud.clouds,
                max_range: cloud.max_range,
                points: cloud.points.len(),
                skipped_records: cloud.report.skipped,
            },
        })
    }

    /// The facts of an open log with its number of points.
    pub fn of(source: &LogSource, points: usize) -> Self {
        DatasetFacts {
            name: source.name.clone(),
            title: source.title.clone(),
            sha256: digest(&source.recording),
            dimensions: 2,
            scans: source.recording.scans.len(),
            max_range: Some(source.max_range),
            points,
            skipped_records: source.report.skipped,
        }
    }
}

impl DatasetFacts {
    /// "Intel Research Lab: 910 scans, 155,648 points with 0 < r ≤ 10 m", for captions.
    pub fn describe(&self) -> String {
        let scans = match (self.dimensions, self.scans) {
            (3, _) => "three dimensions".to_owned(),
            (_, scans) => format!("{} scans", thousands(scans)),
        };
        let range = self.max_range.map_or(String::new(), |m| format!(" with 0 < r ≤ {m} m"));
        format!("{}: {scans}, {} points{range}", self.title, thousands(self.points))
    }
}

impl Manifest {
    /// The manifest of an experiment on a data set.
    ///
    /// # Errors
    /// When the definition cannot be written as JSON.
    pub fn new<D: Serialize>(
        experiment: &str,
        kind: Kind,
        definition: &D,
        dataset: DatasetFacts,
    ) -> Result<Self> {
        Ok(Manifest {
            experiment: experiment.to_owned(),
            kind,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            dataset,
            definition: serde_json::to_value(definition)?,
        })
    }

    /// The definition as the settings of its kind of experiment, checked like those of a file: results
    /// may come from anywhere, too.
    ///
    /// # Errors
    /// When it is none of them, or values are out of range.
    pub fn definition<D: Definition>(&self) -> Result<D> {
        let definition = D::deserialize(&self.definition).with_context(|| {
            format!("the manifest of {} has another definition", self.experiment)
        })?;
        definition.check().with_context(|| format!("in the manifest of {}", self.experiment))?;
        Ok(definition)
    }

    /// Reads a manifest.
    ///
    /// # Errors
    /// When the file cannot be read or is none.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        Self::parse(&text).with_context(|| format!("in {}", path.display()))
    }

    /// Reads the text of a manifest.
    ///
    /// # Errors
    /// When it is none.
    pub fn parse(text: &str) -> Result<Self> {
        Ok(serde_json::from_str(text)?)
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
    /// Sizes and repeats may be added.
    ///
    /// # Errors
    /// When they may not; the message names the first difference.
    pub fn check_continues(&self, earlier: &Manifest) -> Result<()> {
        let settings = |manifest: &Manifest| {
            let mut settings = vec![
                ("version".to_owned(), Value::from(manifest.version.clone())),
                ("data (sha256)".to_owned(), Value::from(manifest.dataset.sha256.clone())),
                ("max_range".to_owned(), Value::from(manifest.dataset.max_range)),
            ];
            let definition = manifest.definition.as_object().into_iter().flatten();
            let fixed = definition.filter(|(key, _)| !GROWING.contains(&key.as_str()));
            settings.extend(fixed.map(|(key, value)| (key.clone(), value.clone())));
            settings
        };
        let (now, before) = (settings(self), settings(earlier));
        for (name, value) in &now {
            let earlier = before.iter().find(|(key, _)| key == name).map(|(_, value)| value);
            if earlier != Some(value) {
                bail!(
                    "the rows there were computed with {name} {}, this run has {value}; \
                     --fresh starts anew, -o writes elsewhere",
                    earlier.unwrap_or(&Value::Null)
                );
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn manifest(definition: Value) -> Manifest {
        let dataset = DatasetFacts {
            name: "office".into(),
            title: "Office".into(),
            sha256: "00".into(),
            dimensions: 2,
            scans: 1,
            max_range: Some(10.0),
            points: 180,
            skipped_records: 0,
        };
        Manifest::new("likelihood", Kind::Likelihood, &definition, dataset).unwrap()
    }

    #[test]
    fn sizes_may_be_added_but_settings_may_not_change() {
        let earlier = manifest(json!({"sigma": 0.05, "sizes": [1]}));
        manifest(json!({"sigma": 0.05, "sizes": [1, 2]})).check_continues(&earlier).unwrap();
        let other = manifest(json!({"sigma": 0.1, "sizes": [1]}));
        let message = other.check_continues(&earlier).unwrap_err().to_string();
        assert!(message.contains("sigma 0.05") && message.contains("0.1"), "{message}");
        let mut other = earlier.clone();
        other.dataset.sha256 = "01".into();
        assert!(other.check_continues(&earlier).is_err());
    }
}
