use mcl_core::Pose2;
use serde::Deserialize;

use crate::log::options::ReferencePoses;

use super::{Content, Facts, Sha256Digest};

/// Name of the file that defines a data set, in the folder named after the data set.
pub const DEFINITION_FILE: &str = "dataset.toml";

/// A data set of the registry: where it comes from and what is known about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Name on the command line, and of the folder that holds definition and files.
    pub name: String,
    /// Title for tables and figures.
    pub title: String,
    /// What it is, in a sentence or two.
    pub description: String,
    /// Whether it has scans or points.
    pub kind: DatasetKind,
    /// Where its scans or points come from.
    pub source: Origin,
    /// Largest reading that counts as a measurement, in metres, inclusive; of a cloud, largest distance from
    /// the origin of its frame, where the scanner is.
    pub max_range: f64,
    /// Mount of the laser on the robot: maps coordinates of the laser's frame to the robot's.
    pub robot_from_laser: Pose2,
    /// Whether its scans are treated as measured at once, whatever the log states about the time between
    /// beams.
    pub no_deskew: bool,
    /// Whether the laser poses in its log are ground truth.
    pub reference: ReferencePoses,
    /// Facts that any copy must agree with; `None` when none are recorded.
    pub facts: Option<Facts>,
    /// Terms of use or licence.
    pub terms: String,
    /// How to cite it.
    pub citation: String,
}

/// What a data set holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DatasetKind {
    /// Laser scans along a path: maps can be built and robots localized.
    Scans,
    /// Points without scans, in two or three dimensions: maps can be built.
    Cloud,
}

/// Where the scans of a data set come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// A log on disk, CARMEN or MCAP (recognized by its first bytes), or a point cloud (recognized by its
    /// file ending).
    File(LogFile),
    /// The built-in simulation, generated in memory from this seed.
    Simulated {
        /// Seed of the simulation.
        seed: u64,
    },
}

/// The file of a data set: its names, where to get it, and the copies known to be good.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogFile {
    /// Name under which a fetched file is stored, decompressed.
    pub name: String,
    /// Other names that copies have. Any of the names may have the ending `.gz` or not.
    pub other_names: Vec<String>,
    /// HTTP(S) addresses, tried in this order.
    pub urls: Vec<String>,
    /// Path of the file within a tar archive, where the addresses lead to an archive.
    pub member: Option<String>,
    /// Copies known to be good. They differ in header lines only.
    pub copies: Vec<KnownCopy>,
}

/// A copy of a log that is known to be good.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownCopy {
    /// SHA-256 of the decompressed content.
    pub sha256: Sha256Digest,
    /// Size of the decompressed content, in bytes.
    pub bytes: u64,
    /// How this copy differs from others.
    pub note: Option<String>,
}

impl Dataset {
    /// The file of the data set; `None` when it is generated in memory.
    pub fn log_file(&self) -> Option<&LogFile> {
        match &self.source {
            Origin::File(file) => Some(file),
            Origin::Simulated { .. } => None,
        }
    }
}

impl LogFile {
    /// Every file name under which a copy is looked for, in order: the stored name first, each name plain
    /// before compressed.
    pub fn known_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for name in std::iter::once(&self.name).chain(&self.other_names) {
            let plain = name.strip_suffix(".gz").unwrap_or(name);
            for name in [plain.to_owned(), format!("{plain}.gz")] {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        names
    }

    /// Whether a file with this content is one of the known copies.
    pub fn accepts(&self, content: &Content) -> bool {
        self.copies.iter().any(|copy| copy.sha256 == content.sha256 && copy.bytes == content.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_looked_for_under_all_its_names_plain_and_packed() {
        let file = LogFile {
            name: "a.log".into(),
            other_names: vec!["b.log.gz".into(), "a.log.gz".into()],
            urls: vec![],
            member: None,
            copies: vec![],
        };
        assert_eq!(file.known_names(), ["a.log", "a.log.gz", "b.log", "b.log.gz"]);
    }
}
