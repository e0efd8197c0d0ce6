//! Sources of scans: a log file, a data set of the registry, or the simulated office.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::{Pose2, Recording, Seed};
use mcl_datasets::bag::{BagError, Survey};
use mcl_datasets::log::{
    Log, LogError, LogKind, ReadReport, ReferencePoses, is_bag, is_bag_folder, read_log_as,
};
use mcl_datasets::registry::{Dataset, DatasetKind, Origin, Registry};
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_maps::files::is_point_cloud;
use sha2::{Digest, Sha256};

use crate::data::cloud_source::{CloudSource, Points, refuse_cloud};
use crate::data::options::{SourceOptions, stem};

/// Readings beyond this (m) do not count as measurements, unless a data set or the user sets another limit;
/// the paper's limit.
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
    /// The reference, and the frame of its poses; `None` without one.
    pub reference: Option<String>,
    /// What was ignored or skipped.
    pub report: ReadReport,
    /// How a bag was read, a line each.
    pub notes: Vec<String>,
    /// The topics of a bag, and which of them were read.
    pub survey: Option<Survey>,
    /// What a bag leaves open, and what was assumed, a line each.
    pub assumptions: Vec<String>,
    /// Largest reading that counts as a measurement, in metres, inclusive.
    pub max_range: f64,
}

/// Data that maps can be built from.
#[derive(Debug, Clone)]
pub enum DataSource {
    /// Scans along a path.
    Log(LogSource),
    /// Points.
    Cloud(CloudSource),
}

impl DataSource {
    /// Opens a log, a point cloud (.ply, .pcd, .csv) or a data set of either kind. A bag is read for its
    /// point clouds when it has no scans, when a topic of clouds is given, or three dimensions are requested.
    /// A log is opened as by [`LogSource::open`], or, if `whole`, by [`LogSource::open_whole`].
    ///
    /// # Errors
    /// As [`LogSource::open`] and [`CloudSource::open`].
    pub fn open(name_or_path: &str, options: &SourceOptions, whole: bool) -> Result<Self> {
        let path = Path::new(name_or_path);
        let log = |log: LogSource| DataSource::Log(if whole { log } else { log.covered() });
        let cloud = options.cloud_topic.is_some() || options.dimensions == Some(3);
        if !is_path(path) {
            let registry = Registry::from_environment()?;
            if let Ok(dataset) = registry.get(name_or_path)
                && dataset.kind == DatasetKind::Cloud
            {
                return CloudSource::open_dataset(&registry, dataset, options)
                    .map(DataSource::Cloud);
            }
        } else if is_point_cloud(path) {
            return CloudSource::open(path, options).map(DataSource::Cloud);
        } else if cloud {
            if !is_bag(path)? {
                bail!(
                    "{name_or_path} is a laser log, which has neither point clouds nor three dimensions"
                );
            }
            return CloudSource::open(path, options).map(DataSource::Cloud);
        }
        if cloud {
            bail!(
                "{name_or_path} has planar scans; --cloud-topic and --dimensions 3 apply to point clouds only"
            );
        }
        match LogSource::open_whole(name_or_path, options) {
            Ok(found) => Ok(log(found)),
            Err(no_scan)
                if is_missing(&no_scan, |error| matches!(error, BagError::NoScan { .. })) =>
            {
                match CloudSource::open(path, options) {
                    Err(error) if is_missing(&error, |e| matches!(e, BagError::NoCloud { .. })) => {
                        Err(no_scan)
                    }
                    found => found.map(DataSource::Cloud),
                }
            }
            Err(error) => Err(error),
        }
    }

    /// Name of the data set, or the file's name without its ending.
    pub fn name(&self) -> &str {
        match self {
            DataSource::Log(log) => &log.name,
            DataSource::Cloud(cloud) => &cloud.name,
        }
    }

    /// The log.
    ///
    /// # Errors
    /// When it is a point cloud.
    pub fn log(&self) -> Result<&LogSource> {
        match self {
            DataSource::Log(log) => Ok(log),
            DataSource::Cloud(cloud) => refuse_cloud(&cloud.name),
        }
    }

    /// The point set D.
    ///
    /// # Errors
    /// As [`LogSource::points`].
    pub fn points(&self) -> Result<Points> {
        match self {
            DataSource::Log(log) => log.points().map(Points::Planar),
            DataSource::Cloud(cloud) => Ok(cloud.points.clone()),
        }
    }
}

/// The name that a log, point cloud or data set will have once it is open: see [`LogSource::name`].
pub fn name_of(name_or_path: &str) -> String {
    match Path::new(name_or_path) {
        path if is_path(path) => stem(path),
        _ => name_or_path.to_owned(),
    }
}

/// Whether a name refers to a file or folder, and not to a data set.
fn is_path(path: &Path) -> bool {
    let looks_like_path = path.components().count() > 1 || path.extension().is_some();
    path.is_file() || looks_like_path || is_bag_folder(path)
}

/// Whether the error is that a bag has no scans, or no point clouds.
fn is_missing(error: &anyhow::Error, what: fn(&BagError) -> bool) -> bool {
    match error.downcast_ref::<LogError>() {
        Some(LogError::Bag { error, .. }) => what(error),
        _ => false,
    }
}

impl LogSource {
    /// A source of scans in memory, with the name as title, and the paper's limit of readings.
    pub fn of_recording(name: &str, recording: Recording) -> Self {
        LogSource {
            name: name.to_owned(),
            title: name.to_owned(),
            recording,
            kind: None,
            reference: None,
            report: ReadReport::default(),
            notes: Vec::new(),
            survey: None,
            assumptions: Vec::new(),
            max_range: DEFAULT_MAX_RANGE,
        }
    }

    /// Opens a log by path or a data set by name. A file of that path (or the folder of a bag) comes first,
    /// then the registry. Scans at either end of a bag that lie outside of its odometry or its reference are
    /// left out, as they cannot be used, and listed in [`LogSource::assumptions`].
    ///
    /// # Errors
    /// When there is neither, or it cannot be read; the message lists where it was looked for.
    pub fn open(name_or_path: &str, options: &SourceOptions) -> Result<Self> {
        Ok(Self::open_whole(name_or_path, options)?.covered())
    }

    /// [`LogSource::open`] with all scans.
    ///
    /// # Errors
    /// As [`LogSource::open`].
    pub fn open_whole(name_or_path: &str, options: &SourceOptions) -> Result<Self> {
        let path = Path::new(name_or_path);
        if !is_path(path) {
            let registry = Registry::from_environment()?;
            return match registry.get(name_or_path) {
                Ok(dataset) => Self::open_dataset(&registry, dataset, options),
                Err(error) => Err(error).with_context(|| {
                    format!("there is no file {name_or_path:?}, and no data set of that name")
                }),
            };
        }
        if is_point_cloud(path) {
            return refuse_cloud(name_or_path);
        }
        let log = read_log_as(path, &options.read_options(ReferencePoses::Auto)?)?;
        let name = stem(path);
        let max_range = options.max_range.unwrap_or(DEFAULT_MAX_RANGE);
        Ok(Self::from_log(name.clone(), name, log, max_range))
    }

    /// Opens a data set of a registry.
    ///
    /// # Errors
    /// When its file is not available or cannot be read.
    pub fn open_dataset(
        registry: &Registry,
        dataset: &Dataset,
        options: &SourceOptions,
    ) -> Result<Self> {
        let max_range = options.max_range.unwrap_or(dataset.max_range);
        if dataset.kind == DatasetKind::Cloud {
            return refuse_cloud(&dataset.name);
        }
        match &dataset.source {
            Origin::File(_) => {
                let path = registry.locate(dataset)?;
                let mut read = options.read_options(dataset.reference)?;
                read.no_deskew |= dataset.no_deskew;
                let log = read_log_as(&path, &read)?;
                Ok(Self::from_log(dataset.name.clone(), dataset.title.clone(), log, max_range))
            }
            Origin::Simulated { seed } => {
                let recording = simulate(&OfficeSettings::default(), Seed::new(*seed))?;
                Ok(LogSource {
                    title: dataset.title.clone(),
                    reference: Some("exact poses of the simulation, of the laser".to_owned()),
                    max_range,
                    ..Self::of_recording(&dataset.name, recording)
                })
            }
        }
    }

    fn from_log(name: String, title: String, log: Log, max_range: f64) -> Self {
        let Log { recording, kind, reference, report, notes, survey, assumptions, .. } = log;
        LogSource {
            name,
            title,
            recording,
            kind: Some(kind),
            reference,
            report,
            notes,
            survey,
            assumptions,
            max_range,
        }
    }

    /// Without the scans at either end of a bag that lie outside of its odometry or its reference.
    pub fn covered(mut self) -> Self {
        let scans = &self.recording.scans;
        // Poses of CARMEN logs are in the records of the scans: only those of other sources may begin later.
        let has_reference_apart = scans.iter().any(|scan| scan.map_from_laser.is_some())
            && scans.iter().any(|scan| scan.map_from_laser.is_none());
        if self.kind != Some(LogKind::Bag) && !has_reference_apart {
            return self;
        }
        let scans = &self.recording.scans;
        let with_reference = span(scans.len(), |index| scans[index].map_from_laser.is_some());
        // A step connects its scan with the previous one.
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
        self.assumptions.push(format!(
            "{left_out} scan{s} left out at the ends of the log, where poses are missing"
        ));
        self
    }

    /// The reader's remarks on the odometry or the reference, to be appended to a sentence that there is
    /// none.
    pub fn reasons(&self, what: &str) -> String {
        let remarks = self.report.doubts.iter().chain(&self.assumptions);
        let reasons: Vec<&str> =
            remarks.filter(|text| text.contains(what)).map(String::as_str).take(5).collect();
        if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join("; ")) }
    }

    /// The log, truncated after this many scans.
    pub fn first_scans(mut self, count: usize) -> Self {
        self.recording.scans.truncate(count);
        self
    }

    /// The point set D. Scans in a gap of the reference, which the reader of the log has reported, contribute
    /// nothing.
    ///
    /// # Errors
    /// When the log has no reference poses, or no usable reading.
    pub fn points(&self) -> Result<Vec<mcl_core::Point<2>>> {
        let points = placed(&self.recording).points(self.max_range).with_context(|| {
            let name = &self.name;
            if self.recording.scans.iter().any(|scan| scan.map_from_laser.is_some()) {
                return name.clone();
            }
            let reasons = self.reasons("reference");
            let Some(survey) = &self.survey else {
                let what = match self.kind {
                    Some(LogKind::Raw) => "this looks like a raw log",
                    _ => "no scan has a reference pose",
                };
                return format!(
                    "{name}: {what}{reasons}; --reference recorded takes the log's laser poses as ground \
                     truth, and --reference FILE reads poses from another file"
                );
            };
            let of_reference = survey.choices.iter().find(|choice| choice.what == "reference");
            let (taken, others) = match of_reference {
                Some(choice) => (choice.taken.as_deref(), choice.others.join(", ")),
                None => (None, String::new()),
            };
            match (taken, others.is_empty()) {
                (Some(taken), _) => format!(
                    "{name}: no scan has a pose from {taken}{reasons}; --reference FILE reads poses from another file"
                ),
                (None, true) => format!(
                    "{name}: the bag has no poses that could be the reference{reasons}; --reference FILE \
                     reads them from another file"
                ),
                (None, false) => format!(
                    "{name}: nothing says which poses are ground truth{reasons}; --reference-topic could \
                     take {others}, and --reference FILE reads them from another file"
                ),
            }
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

/// The scans that have a reference pose; all of them where none has.
pub(crate) fn placed(recording: &Recording) -> Cow<'_, Recording> {
    let with = recording.scans.iter().filter(|scan| scan.map_from_laser.is_some()).count();
    if with == 0 || with == recording.scans.len() {
        return Cow::Borrowed(recording);
    }
    let mut placed = recording.clone();
    placed.scans.retain(|scan| scan.map_from_laser.is_some());
    Cow::Owned(placed)
}

/// The range from the first to the last scan for which `has` holds; all scans where there is none.
fn span(scans: usize, has: impl Fn(usize) -> bool) -> Range<usize> {
    let with = || (0..scans).filter(|&index| has(index));
    match (with().next(), with().next_back()) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..scans,
    }
}

/// SHA-256 of the content of a recording (mount of the laser, readings, directions, poses, odometry, stamps),
/// independent of the file it was read from.
pub fn digest(recording: &Recording) -> String {
    let mut hash = Sha256::new();
    let mut number = |value: f64| hash.update(value.to_bits().to_le_bytes());
    let Pose2 { x, y, theta } = recording.robot_from_laser;
    [x, y, theta].into_iter().for_each(&mut number);
    for scan in &recording.scans {
        number(scan.ranges.len() as f64);
        scan.ranges.iter().for_each(|&range| number(range));
        number(scan.geometry.start_angle);
        number(scan.geometry.angle_step);
        scan.sweep.directions.iter().flatten().for_each(|&direction| number(direction));
        for pose in [scan.map_from_laser, scan.odometry] {
            let parts = pose.map_or([f64::NAN; 3], |pose| [pose.x, pose.y, pose.theta]);
            parts.into_iter().for_each(&mut number);
        }
        // Nanoseconds since 1970 exceed the digits of a float; seconds and remainder do not.
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
