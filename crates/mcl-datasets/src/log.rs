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
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use flate2::bufread::MultiGzDecoder;
use mcl_core::Recording;
use serde::{Deserialize, Serialize};

use crate::carmen::{self, CarmenError};

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
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
}

impl fmt::Display for LogKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LogKind::GfsCorrected => "corrected log, raw odometry between the scans",
            LogKind::CorrectedWithOdometry => "corrected log, raw odometry beside each laser pose",
            LogKind::Raw => "raw log, no reference poses",
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

/// What a reader did not use of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadReport {
    /// Records of kinds that are not read (CARMEN: `NEFF`, `SYNC`, `RLASER`, …); nothing is lost.
    pub ignored: usize,
    /// Malformed records of kinds that are read; what they said is lost.
    pub skipped: usize,
    /// The first 20 skipped records.
    pub skipped_details: Vec<SkippedRecord>,
    /// Scans whose stamp is a number but no time (uninitialised, negative); they are kept without.
    pub unusable_stamps: usize,
    /// Why the log ends early, when its compressed data is cut off or damaged; what came before is
    /// kept.
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

/// A malformed record: where it is, and what is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedRecord {
    /// Line of the log, from 1.
    pub line: usize,
    /// Kind of the record (`FLASER`).
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
        let SkippedRecord { line, record, field, found, expected } = self;
        write!(f, "line {line}: {record} skipped: {field} is {found}, expected {expected}")
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
    #[error("{}: a directory, expected a log file", path.display())]
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
    #[error("{}: the file is empty, expected a CARMEN log (.log, .clf, or either as .gz)", path.display())]
    Empty {
        /// The file asked for.
        path: PathBuf,
    },
    /// The file, or what it decompresses to, is not text.
    #[error(
        "{}: a binary file (byte {offset} is NUL), expected a CARMEN log (.log, .clf, or either as .gz)",
        path.display()
    )]
    Binary {
        /// The file asked for.
        path: PathBuf,
        /// Offset of the first NUL byte, from 0, after decompression.
        offset: usize,
    },
    /// The file is an MCAP bag.
    #[error(
        "{}: an MCAP bag ({content}); bags are not read yet, expected a CARMEN log (.log, .clf, or either as .gz)",
        path.display()
    )]
    Mcap {
        /// The file asked for.
        path: PathBuf,
        /// The topics in it with the types of their messages, or why they cannot be told.
        content: String,
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

/// Reads a log, plain or compressed with gzip; the first bytes decide, not the name.
///
/// # Errors
/// [`LogError`] when the file cannot be opened or holds no scan. Malformed records and a damaged end
/// of the compressed data are no errors: the rest is read, and [`ReadReport`] says what was lost.
pub fn read_log(path: &Path) -> Result<Log, LogError> {
    read_log_as(path, ReferencePoses::Auto)
}

/// [`read_log`], told whether the laser poses in the log are ground truth.
///
/// # Errors
/// As [`read_log`].
pub fn read_log_as(path: &Path, reference: ReferencePoses) -> Result<Log, LogError> {
    let io_error = |error| LogError::Io { path: path.to_owned(), error };
    let file = File::open(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => LogError::NotFound { path: path.to_owned() },
        _ => io_error(error),
    })?;
    // Opening a directory succeeds on Unix; reading it fails with a less helpful message.
    if file.metadata().map_err(io_error)?.is_dir() {
        return Err(LogError::Directory { path: path.to_owned() });
    }
    let mut input = BufReader::with_capacity(SNIFFED_BYTES, file);
    if input.fill_buf().map_err(io_error)?.starts_with(GZIP_MAGIC) {
        let decoder = MultiGzDecoder::new(input);
        read_text(path, BufReader::with_capacity(SNIFFED_BYTES, decoder), reference)
    } else {
        read_text(path, input, reference)
    }
}

/// Checks that the (decompressed) bytes look like text and hands them to the CARMEN reader.
fn read_text(
    path: &Path,
    mut input: impl BufRead,
    reference: ReferencePoses,
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
    if head.starts_with(MCAP_MAGIC) {
        let mut bag = Vec::new();
        let content = match input.read_to_end(&mut bag) {
            Ok(_) => topics(&bag),
            Err(error) => error.to_string(),
        };
        return Err(LogError::Mcap { path: path.to_owned(), content });
    }
    if let Some(offset) = head.iter().position(|&byte| byte == 0) {
        return Err(LogError::Binary { path: path.to_owned(), offset });
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    carmen::read(input, &name, reference).map_err(|error| match error {
        CarmenError::Io(error) => LogError::Io { path: path.to_owned(), error },
        error => LogError::Carmen { path: path.to_owned(), error },
    })
}

/// The topics of an MCAP bag with their message types, from the summary at its end.
fn topics(bag: &[u8]) -> String {
    let summary = match mcap::Summary::read(bag) {
        Ok(Some(summary)) => summary,
        Ok(None) => return "without a summary of its topics".to_owned(),
        Err(error) => return format!("its summary cannot be read: {error}"),
    };
    let describe = |channel: &Arc<mcap::Channel<'_>>| match &channel.schema {
        Some(schema) => format!("{}: {}", channel.topic, schema.name),
        None => channel.topic.clone(),
    };
    let mut topics: Vec<String> = summary.channels.values().map(describe).collect();
    topics.sort();
    if topics.is_empty() { "without topics".to_owned() } else { topics.join(", ") }
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
