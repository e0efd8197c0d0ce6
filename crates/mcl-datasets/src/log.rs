//! Reading a laser log of any supported format: opening the file, telling its format by its first
//! bytes, and what a reader reports beside the recording.
//!
//! # Example
//! ```no_run
//! use mcl_datasets::log::read_log;
//!
//! let log = read_log("intel.gfs.log".as_ref())?;
//! println!("{} scans, {}", log.recording.scans.len(), log.kind);
//! if !log.report.is_complete() {
//!     eprintln!("{}", log.report);
//! }
//! # Ok::<(), mcl_datasets::log::LogError>(())
//! ```

use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use flate2::bufread::MultiGzDecoder;
use mcl_core::Recording;
use serde::{Deserialize, Serialize};

use crate::bag::{self, BagCloud, BagError, CloudOptions, PoseRole, PoseTopic};
use crate::carmen::{self, CarmenError};

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
/// Bytes looked at to tell the format, and to refuse binary files before parsing them as text.
const SNIFFED_BYTES: usize = 1 << 16;
/// Skipped records described in full in a [`ReadReport`]; further ones are only counted.
const SKIPPED_DETAILS: usize = 20;

/// A log as read: the recording, and what is known about how it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Scans with their stamps, reference poses and odometry increments.
    pub recording: Recording,
    /// Where the reference and the odometry come from.
    pub kind: LogKind,
    /// What was ignored, skipped or unusable.
    pub report: ReadReport,
    /// How far ahead of the robot's centre the log says the front laser is mounted (metres;
    /// `PARAM robot_frontlaser_offset` of CARMEN), if it says so. The mount in `recording` follows
    /// it where the poses of the log leave the mount open.
    pub front_laser_offset: Option<f64>,
    /// How a bag was read, a line each: its topics, the mount of the laser.
    pub notes: Vec<String>,
    /// What a bag left open and how that was settled, a line each: no mount, no stamps, scans outside
    /// of the odometry.
    pub assumptions: Vec<String>,
}

/// Where the reference poses and the odometry of a log come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogKind {
    /// Laser poses are corrected (the reference), and so are the odometry fields beside them; raw
    /// odometry, where the log has any, stands in odometry records between the scans.
    GfsCorrected,
    /// Laser poses are corrected (the reference); the odometry fields beside them are raw.
    CorrectedWithOdometry,
    /// Laser poses are raw odometry, at a fixed mount on the robot; there is no reference.
    Raw,
    /// A ROS 2 bag: odometry and, where it has them, reference poses from topics of their own.
    Bag,
}

impl fmt::Display for LogKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LogKind::GfsCorrected => "corrected log, raw odometry between the scans",
            LogKind::CorrectedWithOdometry => "corrected log, raw odometry beside each laser pose",
            LogKind::Raw => "raw log, no reference poses",
            LogKind::Bag => "ROS 2 bag",
        })
    }
}

/// Whether the laser poses written in a log are taken as ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferencePoses {
    /// As the content of the log tells.
    #[default]
    Auto,
    /// They are ground truth, even when the log does not look corrected.
    Recorded,
    /// They are not: the recording gets no reference poses.
    None,
}

impl ReferencePoses {
    /// The name used in settings files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            ReferencePoses::Auto => "auto",
            ReferencePoses::Recorded => "recorded",
            ReferencePoses::None => "none",
        }
    }
}

impl fmt::Display for ReferencePoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A text that names none of [`ReferencePoses`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no choice of reference poses, expected auto, recorded or none")]
pub struct ParseReferencePosesError(String);

impl FromStr for ReferencePoses {
    type Err = ParseReferencePosesError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        [ReferencePoses::Auto, ReferencePoses::Recorded, ReferencePoses::None]
            .into_iter()
            .find(|choice| choice.name() == text)
            .ok_or_else(|| ParseReferencePosesError(text.to_owned()))
    }
}

/// Topics to read of a bag, where their types do not tell which are meant.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicChoice {
    /// Topic of the scans (`sensor_msgs/LaserScan`).
    pub scan: Option<String>,
    /// Topic of the odometry (`nav_msgs/Odometry`).
    pub odometry: Option<String>,
    /// Topic of the reference poses (`geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped` or
    /// `nav_msgs/Odometry`).
    pub reference: Option<String>,
}

impl TopicChoice {
    /// The first topic asked for, if any is.
    fn any(&self) -> Option<&str> {
        [&self.scan, &self.odometry, &self.reference]
            .into_iter()
            .flatten()
            .next()
            .map(|t| t.as_str())
    }
}

/// How to read a log, where its content leaves that open.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Whether the poses in the log are ground truth. For a bag: whether to use reference poses if it
    /// has them, to insist on them, or not to use them.
    pub reference: ReferencePoses,
    /// Topics of a bag.
    pub topics: TopicChoice,
}

impl From<ReferencePoses> for ReadOptions {
    fn from(reference: ReferencePoses) -> Self {
        ReadOptions { reference, topics: TopicChoice::default() }
    }
}

/// What a reader did not use of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadReport {
    /// Records of kinds that are not read (CARMEN: `NEFF`, `SYNC`, `RLASER`, …; bags: messages of
    /// other types); nothing is lost.
    pub ignored: usize,
    /// Malformed records of kinds that are read; what they said is lost.
    pub skipped: usize,
    /// The first 20 skipped records.
    pub skipped_details: Vec<SkippedRecord>,
    /// Scans whose stamp is a number but no time (uninitialised, negative); they are kept without.
    pub unusable_stamps: usize,
    /// Why the log ends early, when a bag or compressed data is cut off or damaged; what came before
    /// is kept.
    pub truncated: Option<String>,
}

impl ReadReport {
    /// Whether every record of a known kind was read: nothing skipped, nothing cut off.
    pub fn is_complete(&self) -> bool {
        self.skipped == 0 && self.truncated.is_none()
    }

    pub(crate) fn skip(&mut self, record: SkippedRecord) {
        self.skipped += 1;
        if self.skipped_details.len() < SKIPPED_DETAILS {
            self.skipped_details.push(record);
        }
    }
}

/// One line on the totals, then one per described skipped record, then why the log ends early.
impl fmt::Display for ReadReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "ignored records: {}, skipped records: {}, unusable stamps: {}",
            self.ignored, self.skipped, self.unusable_stamps
        )?;
        for record in &self.skipped_details {
            write!(f, "\n{record}")?;
        }
        let more = self.skipped.saturating_sub(self.skipped_details.len());
        if more > 0 {
            write!(f, "\n… and {more} more")?;
        }
        if let Some(reason) = &self.truncated {
            write!(f, "\nthe log ends early: {reason}")?;
        }
        Ok(())
    }
}

/// Where a record stands in its log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// Line of a text, from 1.
    Line(usize),
    /// Message of a bag.
    Message {
        /// Its topic.
        topic: String,
        /// When it was logged, in nanoseconds.
        log_time: u64,
        /// Offset in its file of its record, or of the chunk that holds it.
        offset: u64,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Message { topic, log_time, offset } => {
                let (seconds, rest) = (log_time / 1_000_000_000, log_time % 1_000_000_000);
                write!(f, "{topic} at {seconds}.{rest:09} s (byte {offset})")
            }
        }
    }
}

/// A malformed record: where it is, and what is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedRecord {
    /// Where it stands.
    pub place: Place,
    /// Kind of the record (`FLASER`), or type of the message.
    pub record: String,
    /// Name of the field at fault.
    pub field: String,
    /// What stands there.
    pub found: String,
    /// What should.
    pub expected: String,
}

impl fmt::Display for SkippedRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SkippedRecord { place, record, field, found, expected } = self;
        write!(f, "{place}: {record} skipped: {field} is {found}, expected {expected}")
    }
}

/// Why no log could be read from a file.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// There is no such file.
    #[error("{}: no such file; check the path, or fetch the data set first", path.display())]
    NotFound {
        /// The file asked for.
        path: PathBuf,
    },
    /// The path is a directory.
    #[error("{}: a directory, expected a log file, or the folder of a ROS 2 bag with its metadata.yaml", path.display())]
    Directory {
        /// The path asked for.
        path: PathBuf,
    },
    /// The operating system could not open or read the file.
    #[error("{}: cannot be read: {error}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The file, or what it decompresses to, has no bytes.
    #[error("{}: the file is empty, expected a CARMEN log (.log, .clf, or either as .gz) or a ROS 2 bag (.mcap)", path.display())]
    Empty {
        /// The file asked for.
        path: PathBuf,
    },
    /// The file, or what it decompresses to, is not text.
    #[error(
        "{}: a binary file (byte {offset} is NUL), expected a CARMEN log (.log, .clf, or either as .gz) or a ROS 2 bag (.mcap)",
        path.display()
    )]
    Binary {
        /// The file asked for.
        path: PathBuf,
        /// Offset of the first NUL byte, from 0, after decompression.
        offset: usize,
    },
    /// No recording could be read from a ROS 2 bag.
    #[error("{}: {error}", path.display())]
    Bag {
        /// The file or folder asked for, or the file of a split bag.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<BagError>,
    },
    /// Topics were asked for, but the log is no bag.
    #[error("{}: a CARMEN log has no topics, and so no {topic:?}; leave out --scan-topic, --odom-topic and --reference-topic", path.display())]
    NoTopics {
        /// The file asked for.
        path: PathBuf,
        /// The first topic asked for.
        topic: String,
    },
    /// The file begins like gzip, but nothing of it can be decompressed.
    #[error("{}: {reason}; fetch the file again", path.display())]
    Compressed {
        /// The file asked for.
        path: PathBuf,
        /// What is wrong with the compressed data.
        reason: String,
    },
    /// The text is no CARMEN log that could be read.
    #[error("{}: {error}", path.display())]
    Carmen {
        /// The file asked for.
        path: PathBuf,
        /// What is wrong with it.
        error: CarmenError,
    },
}

/// Reads a log, plain or compressed with gzip, or the folder of a split bag; the first bytes decide,
/// not the name.
///
/// # Errors
/// [`LogError`] when the file cannot be opened or holds no scan. Malformed records and a damaged end
/// of the compressed data are no errors: the rest is read, and [`ReadReport`] says what was lost.
pub fn read_log(path: &Path) -> Result<Log, LogError> {
    read_log_as(path, &ReadOptions::default())
}

/// [`read_log`], told what the content of the log leaves open.
///
/// # Errors
/// As [`read_log`].
pub fn read_log_as(path: &Path, options: &ReadOptions) -> Result<Log, LogError> {
    // Opening a directory succeeds on Unix; reading it fails with a less helpful message.
    if path.is_dir() {
        return match bag::files::is_bag(path) {
            true => bag::read_folder(path, options, open),
            false => Err(LogError::Directory { path: path.to_owned() }),
        };
    }
    read_opened(open(path)?, path, options)
}

/// Reads a log from its bytes, plain or compressed with gzip; they decide on the format. `path` stands
/// for the file in errors, and its name settles what the content leaves open.
///
/// # Errors
/// As [`read_log`].
pub fn read_log_from(
    input: impl Read,
    path: &Path,
    options: &ReadOptions,
) -> Result<Log, LogError> {
    let input = unpacked(input).map_err(|error| LogError::Io { path: path.to_owned(), error })?;
    read_opened(input, path, options)
}

fn read_opened(
    mut input: impl BufRead,
    path: &Path,
    options: &ReadOptions,
) -> Result<Log, LogError> {
    let head = match input.fill_buf() {
        Ok(head) => head,
        Err(error) => {
            let path = path.to_owned();
            return Err(match damaged_gzip(&error) {
                Some(reason) => LogError::Compressed { path, reason },
                None => LogError::Io { path, error },
            });
        }
    };
    if head.is_empty() {
        return Err(LogError::Empty { path: path.to_owned() });
    }
    let is_named_bag = path.extension().is_some_and(|ending| ending == "mcap");
    if is_named_bag || head.starts_with(mcap::MAGIC) {
        return bag::read(input, options)
            .map_err(|error| LogError::Bag { path: path.to_owned(), error: Box::new(error) });
    }
    if let Some(offset) = head.iter().position(|&byte| byte == 0) {
        return Err(LogError::Binary { path: path.to_owned(), offset });
    }
    if let Some(topic) = options.topics.any() {
        return Err(LogError::NoTopics { path: path.to_owned(), topic: topic.to_owned() });
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    carmen::read(input, &name, options.reference).map_err(|error| match error {
        CarmenError::Io(error) => LogError::Io { path: path.to_owned(), error },
        error => LogError::Carmen { path: path.to_owned(), error },
    })
}

/// Whether a path is that of a bag: the folder of one, or a file, plain or compressed with gzip, that
/// begins like one or is named `.mcap`.
///
/// # Errors
/// [`LogError`] when the file cannot be opened.
pub fn is_bag(path: &Path) -> Result<bool, LogError> {
    if path.is_dir() {
        return Ok(bag::files::is_bag(path));
    }
    if path.extension().is_some_and(|ending| ending == "mcap") {
        return Ok(true);
    }
    let mut head = Vec::new();
    // A damaged end of a short file says nothing about its beginning.
    let read = open(path)?.take(mcap::MAGIC.len() as u64).read_to_end(&mut head);
    Ok(read.is_ok() && head == mcap::MAGIC)
}

/// Reads the poses of one topic of a bag, a file or a folder: the topic asked for, or the one that its
/// type and name tell.
///
/// # Errors
/// [`LogError`] when it cannot be opened, is damaged, or no topic, or several, could be meant.
pub fn read_poses(path: &Path, topic: Option<&str>, role: PoseRole) -> Result<PoseTopic, LogError> {
    if path.is_dir() {
        return bag::read_poses_of_folder(path, topic, role, open);
    }
    bag::read_poses(open(path)?, topic, role)
        .map_err(|error| LogError::Bag { path: path.to_owned(), error: Box::new(error) })
}

/// Reads the point clouds of one topic of a bag, a file or a folder.
///
/// # Errors
/// [`LogError`] when it cannot be opened or is no bag, and as [`bag::read_clouds`].
pub fn read_clouds(path: &Path, options: &CloudOptions) -> Result<BagCloud, LogError> {
    if path.is_dir() {
        return bag::read_clouds_of_folder(path, options, open);
    }
    bag::read_clouds(open(path)?, options)
        .map_err(|error| LogError::Bag { path: path.to_owned(), error: Box::new(error) })
}

/// Whether a folder holds a bag: a `metadata.yaml`, or files that end with `.mcap`.
pub fn is_bag_folder(path: &Path) -> bool {
    path.is_dir() && bag::files::is_bag(path)
}

/// Opens a file, and unpacks it if it is compressed.
fn open(path: &Path) -> Result<Box<dyn BufRead>, LogError> {
    let io_error = |error| LogError::Io { path: path.to_owned(), error };
    let file = File::open(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => LogError::NotFound { path: path.to_owned() },
        _ => io_error(error),
    })?;
    unpacked(file).map_err(io_error)
}

/// The content of a file, unpacked if it is compressed.
fn unpacked<'a>(file: impl Read + 'a) -> io::Result<Box<dyn BufRead + 'a>> {
    let mut input = BufReader::with_capacity(SNIFFED_BYTES, file);
    Ok(match input.fill_buf()?.starts_with(GZIP_MAGIC) {
        true => Box::new(BufReader::with_capacity(SNIFFED_BYTES, MultiGzDecoder::new(input))),
        false => Box::new(input),
    })
}

/// What an error says about compressed data; `None` for errors of the system. Reading a plain file
/// gives none of these kinds.
pub(crate) fn damaged_gzip(error: &io::Error) -> Option<String> {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Some("the compressed data is cut off".to_owned()),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
            Some(format!("the compressed data is damaged ({error})"))
        }
        _ => None,
    }
}
