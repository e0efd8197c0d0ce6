//! Facts about the data of a study.

use anyhow::Result;
use mcl_core::text::thousands;
use serde::{Deserialize, Serialize};

use crate::data::source::{DataSource, digest};

/// Facts about the data of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataFacts {
    /// Name in the registry, or of the file; part of the seed of random draws.
    pub name: String,
    /// Title for figures.
    pub title: String,
    /// SHA-256 of the content, independent of the file it was read from.
    pub sha256: String,
    /// Dimensions of its points.
    pub dimensions: usize,
    /// Number of scans or clouds.
    pub scans: usize,
    /// Largest reading that counted, in metres; `None` for a point cloud without limit.
    pub max_range: Option<f64>,
    /// Number of points.
    pub points: usize,
    /// Malformed records that were skipped.
    pub skipped_records: usize,
}

impl DataFacts {
    /// The facts of an open log or point cloud.
    ///
    /// # Errors
    /// When a log has no points.
    pub fn of(source: &DataSource) -> Result<Self> {
        Ok(match source {
            DataSource::Log(log) => DataFacts {
                name: log.name.clone(),
                title: log.title.clone(),
                sha256: digest(&log.recording),
                dimensions: 2,
                scans: log.recording.scans.len(),
                max_range: Some(log.max_range),
                points: log.points()?.len(),
                skipped_records: log.report.skipped,
            },
            DataSource::Cloud(cloud) => DataFacts {
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
