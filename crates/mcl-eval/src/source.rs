//! Where scans come from: a log file, a data set of the registry, or the simulated office.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::{Recording, Seed};
use mcl_datasets::log::{
    Log, LogKind, ReadOptions, ReadReport, ReferencePoses, TopicChoice, is_bag_folder, read_log_as,
};
use mcl_datasets::registry::{Dataset, Registry, Source};
use mcl_datasets::simulator::{OfficeSettings, simulate};
use sha2::{Digest, Sha256};

/// Readings beyond this (m) are no measurements, unless a data set or the user says otherwise; the
/// paper's limit.
pub const DEFAULT_MAX_RANGE: f64 = 10.0;

/// A log, opened under a name.
#[derive(Debug, Clone)]
pub struct LogSource {
    /// Name of the data set, or the file's name without its ending: names the results.
    pub name: String,
    /// Title for figures and tables.
    pub title: String,
    /// The scans.
    pub recording: Recording,
    /// Where reference and odometry come from; `None` for the simulation, which knows both.
    pub kind: Option<LogKind>,
    /// What was ignored or skipped.
    pub report: ReadReport,
    /// How a bag was read, a line each.
    pub notes: Vec<String>,
    /// What a bag left open and how that was settled, a line each.
    pub assumptions: Vec<String>,
    /// Largest reading that counts as a measurement, in metres, inclusive.
    pub max_range: f64,
}

/// How to read a log, as far as the user says.
#[derive(Debug, Clone, Default)]
pub struct SourceOptions {
    /// Largest reading that counts, in metres.
    pub max_range: Option<f64>,
    /// Whether the recorded laser poses are ground truth.
    pub reference: Option<ReferencePoses>,
    /// Topics of a bag.
    pub topics: TopicChoice,
}

impl SourceOptions {
    /// How to read the log, where the user does not say whether there is a reference: `reference`.
    fn read_options(&self, reference: ReferencePoses) -> ReadOptions {
        ReadOptions { reference: self.reference.unwrap_or(reference), topics: self.topics.clone() }
    }
}

impl LogSource {
    /// Opens a log by path or a data set by name. A file of that path (or the folder of a bag) comes
    /// first, then the registry. Scans at either end of a bag that lie outside of its odometry or its
    /// reference are left out, and [`LogSource::assumptions`] says so: nothing could be done with them.
    ///
    /// # Errors
    /// When there is neither, or it cannot be read; the message says where it was looked for.
    pub fn open(name_or_path: &str, options: &SourceOptions) -> Result<Self> {
        Ok(Self::open_whole(name_or_path, options)?.covered())
    }

    /// [`LogSource::open`] with all scans.
    ///
    /// # Errors
    /// As [`LogSource::open`].
    pub fn open_whole(name_or_path: &str, options: &SourceOptions) -> Result<Self> {
        let path = Path::new(name_or_path);
        let looks_like_path = path.components().count() > 1 || path.extension().is_some();
        if !path.is_file() && !looks_like_path && !is_bag_folder(path) {
            let registry = Registry::from_environment()?;
            return match registry.get(name_or_path) {
                Ok(dataset) => Self::open_dataset(&registry, dataset, options),
                Err(error) => Err(error).with_context(|| {
                    format!("there is no file {name_or_path:?}, and no data set of that name")
                }),
            };
        }
        let log = read_log_as(path, &options.read_options(ReferencePoses::Auto))?;
        let name = stem(path);
        let max_range = options.max_range.unwrap_or(DEFAULT_MAX_RANGE);
        Ok(Self::from_log(name.clone(), name, log, max_range))
    }

    /// Opens a data set of a registry.
    ///
    /// # Errors
    /// When its file is not at hand or cannot be read.
    pub fn open_dataset(
        registry: &Registry,
        dataset: &Dataset,
        options: &SourceOptions,
    ) -> Result<Self> {
        let max_range = options.max_range.unwrap_or(dataset.max_range);
        match &dataset.source {
            Source::File(_) => {
                let path = registry.locate(dataset)?;
                let log = read_log_as(&path, &options.read_options(dataset.reference))?;
                Ok(Self::from_log(dataset.name.clone(), dataset.title.clone(), log, max_range))
            }
            Source::Simulated { seed } => {
                let recording = simulate(&OfficeSettings::default(), Seed::new(*seed))?;
                Ok(LogSource {
                    name: dataset.name.clone(),
                    title: dataset.title.clone(),
                    recording,
                    kind: None,
                    report: ReadReport::default(),
                    notes: Vec::new(),
                    assumptions: Vec::new(),
                    max_range,
                })
            }
        }
    }

    fn from_log(name: String, title: String, log: Log, max_range: f64) -> Self {
        let Log { recording, kind, report, notes, assumptions, .. } = log;
        LogSource {
            name,
            title,
            recording,
            kind: Some(kind),
            report,
            notes,
            assumptions,
            max_range,
        }
    }

    /// Without the scans at either end of a bag that lie outside of its odometry or its reference.
    pub fn covered(mut self) -> Self {
        if self.kind != Some(LogKind::Bag) {
            return self;
        }
        let scans = &self.recording.scans;
        let with_reference = span(scans.len(), |index| scans[index].map_from_laser.is_some());
        // A step connects its scan with the one before.
        let with_odometry = span(scans.len(), |index| {
            let next = scans.get(index + 1);
            (index > 0 && scans[index].odometry.is_some())
                || next.is_some_and(|next| next.odometry.is_some())
        });
        let start = with_reference.start.max(with_odometry.start);
        let end = with_reference.end.min(with_odometry.end);
        let left_out = scans.len() - end.saturating_sub(start);
        if left_out == 0 || start >= end {
            return self;
        }
        self.recording.scans.truncate(end);
        self.recording.scans.drain(..start);
        self.recording.scans[0].odometry = None;
        let s = if left_out == 1 { " is" } else { "s are" };
        self.assumptions.push(format!("{left_out} scan{s} left out for that"));
        self
    }

    /// The same log, cut off after this many scans.
    pub fn first_scans(&self, count: usize) -> Self {
        let scans = self.recording.scans.iter().take(count).cloned().collect();
        LogSource {
            name: self.name.clone(),
            title: self.title.clone(),
            recording: Recording { scans, robot_from_laser: self.recording.robot_from_laser },
            kind: self.kind,
            report: self.report.clone(),
            notes: self.notes.clone(),
            assumptions: self.assumptions.clone(),
            max_range: self.max_range,
        }
    }

    /// The point set D.
    ///
    /// # Errors
    /// When the log has no reference poses, or no usable reading.
    pub fn points(&self) -> Result<Vec<mcl_core::Point<2>>> {
        let points = self.recording.points(self.max_range).with_context(|| {
            format!(
                "{}: if its laser poses are ground truth all the same, say --reference recorded",
                self.name
            )
        })?;
        if points.is_empty() {
            bail!(
                "{}: no reading is usable: none of {} lies within 0 < r ≤ {} m",
                self.name,
                self.recording.readings(),
                self.max_range
            );
        }
        Ok(points)
    }
}

/// From the first to the last scan that has something; all of them where none has.
fn span(scans: usize, has: impl Fn(usize) -> bool) -> Range<usize> {
    let with = || (0..scans).filter(|&index| has(index));
    match (with().next(), with().next_back()) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..scans,
    }
}

/// The file's name up to its first dot: `intel.gfs.log.gz` is `intel`.
fn stem(path: &Path) -> String {
    // The folder of a bag may be given as `.` or `..`, which name nothing.
    let absolute = path.canonicalize();
    let path = match path.file_name() {
        Some(_) => path,
        None => absolute.as_deref().unwrap_or(path),
    };
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    match name.split('.').next() {
        Some(stem) if !stem.is_empty() => stem.to_owned(),
        _ => name.into_owned(),
    }
}

/// SHA-256 of what a recording holds (readings, directions, poses, odometry, stamps), whatever the
/// file it came from.
pub fn digest(recording: &Recording) -> String {
    let mut hash = Sha256::new();
    let mut number = |value: f64| hash.update(value.to_bits().to_le_bytes());
    for scan in &recording.scans {
        number(scan.ranges.len() as f64);
        scan.ranges.iter().for_each(|&range| number(range));
        number(scan.geometry.start_angle);
        number(scan.geometry.angle_step);
        for pose in [scan.map_from_laser, scan.odometry] {
            let parts = pose.map_or([f64::NAN; 3], |pose| [pose.x, pose.y, pose.theta]);
            parts.into_iter().for_each(&mut number);
        }
        // Nanoseconds since 1970 exceed a float's digits; seconds and the rest do not.
        let stamp = scan.stamp.map_or(-1, |stamp| stamp.nanoseconds());
        number((stamp / 1_000_000_000) as f64);
        number((stamp % 1_000_000_000) as f64);
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files() {
        assert_eq!(stem(Path::new("a/intel.gfs.log.gz")), "intel");
        assert_eq!(stem(Path::new("run7")), "run7");
        assert_eq!(stem(Path::new(".hidden")), ".hidden");
        for unnamed in [".", ".."] {
            let name = stem(Path::new(unnamed));
            assert!(!name.is_empty() && !name.starts_with('.'), "{name}");
        }
    }

    #[test]
    fn neither_file_nor_data_set() {
        let Err(error) = LogSource::open("intel-lob", &SourceOptions::default()) else {
            panic!("opened")
        };
        let message = format!("{error:#}");
        assert!(message.contains("intel-lob") && message.contains("intel-lab"), "{message}");
        let Err(error) = LogSource::open("no/such.log", &SourceOptions::default()) else {
            panic!("opened")
        };
        assert!(error.to_string().contains("no/such.log"));
    }
}
