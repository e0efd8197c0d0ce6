//! Trajectory files in several formats, recognized by their content:
//!
//! | format | a line | recognized by |
//! |---|---|---|
//! | [TUM](crate::tum) | `t x y z qx qy qz qw`, separated by blanks | all other files |
//! | KITTI | the upper three rows of the pose matrix, row by row | 12 numbers separated by blanks |
//! | EuRoC | `#timestamp [ns], p_RS_R_x [m], …, q_RS_w [], …` | its column names |
//! | CSV | named columns, separated by commas, semicolons or tabs | a line of names before the numbers |
//!
//! These columns of a CSV file are read: time (`t`, `time`, `stamp`, `timestamp`, or `sec` and `nsec`), `x` and
//! `y`, and if present `z`, a heading in radians (`theta`, `yaw`, `heading`) or a quaternion (`qx`
//! `qy` `qz` `qw`, in any order). Names may have prefixes, as in exported ROS topics (`pose.position.x`,
//! `field.header.stamp`, `p_x`, `orientation.w`), and units (`time_ms`, `timestamp [ns]`, `yaw (deg)`).
//! Unless the name contains a unit, times above 10¹⁷ are nanoseconds and all others seconds. Ambiguous
//! names are an error that lists the columns.
//!
//! Not all files have headings: CSV files without such a column, and TUM files whose quaternions are all
//! `0 0 0 0`, contain positions only.
//!
//! # Example
//! ```
//! use mcl_metrics::trajectory_file::{ReadSettings, TrajectoryFormat, read};
//!
//! let text = "time_ms;x;y\n1500;1.0;2.0\n1600;1.1;2.0\n";
//! let file = read(text.as_bytes(), "example.csv", &ReadSettings::default())?;
//! assert_eq!((file.format, file.has_headings), (TrajectoryFormat::Csv, false));
//! assert_eq!(file.trajectory.stamps()[0].nanoseconds(), 1_500_000_000);
//! # Ok::<(), mcl_metrics::trajectory_file::TrajectoryFileError>(())
//! ```

mod columns;
mod error;
mod kitti;
mod table;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use mcl_core::{Pose2, Trajectory, wrap_angle};
use serde::Serialize;

use crate::tum;
use columns::is_number;

/// Number of bytes in which the first line that is not a comment is searched.
const SNIFFED_BYTES: u64 = 1 << 16;
/// The separators of table columns.
const SEPARATORS: [char; 3] = [',', ';', '\t'];

pub use crate::planar::{NonPlanar, QuaternionOrder, ReadSettings};
pub use error::TrajectoryFileError;

/// The format of a trajectory file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum TrajectoryFormat {
    /// TUM: `t x y z qx qy qz qw`.
    Tum,
    /// KITTI: 12 numbers of a matrix, no stamps.
    Kitti,
    /// EuRoC: CSV with the column names of EuRoC.
    Euroc,
    /// CSV with column names.
    Csv,
}

/// The content of a trajectory file, with notes and warnings.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TrajectoryFile {
    /// Stamped poses in file order, at least one; headings within (−π, π], 0 if the file has none.
    pub trajectory: Trajectory,
    /// The recognized format.
    pub format: TrajectoryFormat,
    /// Whether the file has headings; otherwise it contains positions only.
    pub has_headings: bool,
    /// Number of stamps that are earlier than the one before.
    pub backward_stamps: usize,
    /// Number of stamps that equal the one before.
    pub repeated_stamps: usize,
    /// Notes for the user, one sentence each.
    pub notes: Vec<String>,
    /// Reasons to doubt the content of the file, one sentence each.
    pub doubts: Vec<String>,
}

/// Whether a file is a trajectory file, judged by its first line that is not a comment: it begins with a number or has
/// column names with separators, while a log begins with the type of a record.
///
/// # Errors
/// If the file cannot be read.
pub fn is_trajectory_file(path: impl AsRef<Path>) -> io::Result<bool> {
    let file = File::open(path)?.take(SNIFFED_BYTES);
    let head = FileHead::read(&mut BufReader::new(file))?;
    let text = head.first_line();
    let first = text.split(SEPARATORS).next().unwrap_or_default();
    let first = first.split_whitespace().next().unwrap_or_default();
    Ok(text.is_empty() || is_number(first) || text.contains(SEPARATORS))
}

/// Reads the file at `path`; see [`read`].
///
/// # Errors
/// As [`read`], and if the file cannot be opened.
pub fn read_file(
    path: impl AsRef<Path>,
    settings: &ReadSettings,
) -> Result<TrajectoryFile, TrajectoryFileError> {
    let path = path.as_ref();
    let open = |source| TrajectoryFileError::Open { file: path.to_owned(), source };
    read(BufReader::new(File::open(path).map_err(open)?), path, settings)
}

/// Reads a trajectory; `name` is the name of the file in errors. Memory use is proportional to the input.
///
/// # Errors
/// If no format is recognized, columns are missing or ambiguous, a line is not a planar pose
/// (unless poses are projected), or there is no pose.
pub fn read(
    mut reader: impl BufRead,
    name: impl AsRef<Path>,
    settings: &ReadSettings,
) -> Result<TrajectoryFile, TrajectoryFileError> {
    let name = name.as_ref();
    let head = FileHead::read(&mut reader)
        .map_err(|source| TrajectoryFileError::Open { file: name.to_owned(), source })?;
    let whole = io::Cursor::new(&head.bytes).chain(reader);
    let found = match head.kind() {
        FileKind::Tum => {
            let (file, has_headings) = tum::read_with(whole, name, settings)?;
            ParsedFile {
                trajectory: file.trajectory,
                format: TrajectoryFormat::Tum,
                has_headings,
                notes: vec![],
            }
        }
        FileKind::Kitti => kitti::read(whole, name, settings.non_planar)?,
        FileKind::Table { names, line } => {
            table::read(whole, name, &names, line, settings.non_planar)?
        }
        FileKind::NoNames { line } => {
            let found = head.first_line();
            return Err(TrajectoryFileError::NoNames { file: name.to_owned(), line, found });
        }
    };
    Ok(found.finish())
}

/// The result of the reader of a format.
struct ParsedFile {
    trajectory: Trajectory,
    format: TrajectoryFormat,
    has_headings: bool,
    notes: Vec<String>,
}

impl ParsedFile {
    fn finish(self) -> TrajectoryFile {
        let ParsedFile { trajectory, format, has_headings, notes } = self;
        let mut doubts = Vec::new();
        let count = |is: fn(&[mcl_core::Stamp]) -> bool| {
            trajectory.stamps().windows(2).filter(|pair| is(pair)).count()
        };
        if has_headings && is_fixed_on_a_turning_path(trajectory.poses()) {
            doubts.push(
                "all headings are the same on a path that turns: the file may hold positions only (evaluate \
                 --positions)"
                    .to_owned(),
            );
        }
        TrajectoryFile {
            format,
            has_headings,
            backward_stamps: count(|pair| pair[1] < pair[0]),
            repeated_stamps: count(|pair| pair[1] == pair[0]),
            notes,
            doubts,
            trajectory,
        }
    }
}

/// Whether all headings are equal although the robot moves more than a metre and not in a straight line: steps of
/// at least 0.1 m have directions that differ by more than 0.5 rad.
fn is_fixed_on_a_turning_path(poses: &[Pose2]) -> bool {
    const LENGTH_M: f64 = 1.0;
    const STEP_M: f64 = 0.1;
    const TURN_RAD: f64 = 0.5;
    let Some(first) = poses.first() else { return false };
    if poses.iter().any(|pose| pose.theta != first.theta) {
        return false;
    }
    let (mut from, mut length) = (first, 0.0);
    let (mut direction, mut turns) = (None, false);
    for to in poses {
        let step = from.distance(to);
        if step < STEP_M {
            continue;
        }
        let along = mcl_core::math::atan2(to.y - from.y, to.x - from.x);
        let straight = *direction.get_or_insert(along);
        turns |= wrap_angle(along - straight).abs() > TURN_RAD;
        length += step;
        from = to;
    }
    turns && length > LENGTH_M
}

/// The start of a file, up to its first line of numbers or names.
struct FileHead {
    /// The bytes read, including comments.
    bytes: Vec<u8>,
    /// Start of the last line that is not empty, and of the last comment before it.
    last: Option<LineStart>,
    comment: Option<LineStart>,
}

/// A line: the byte at which it starts, and its number, from 1.
#[derive(Clone, Copy)]
struct LineStart {
    begin: usize,
    line: usize,
}

enum FileKind {
    Tum,
    Kitti,
    /// Columns with names in a line.
    Table {
        names: String,
        line: usize,
    },
    /// Columns without names.
    NoNames {
        line: usize,
    },
}

impl FileHead {
    fn read(reader: &mut impl BufRead) -> io::Result<Self> {
        let mut head = FileHead { bytes: Vec::new(), last: None, comment: None };
        for line in 1.. {
            let begin = head.bytes.len();
            if reader.read_until(b'\n', &mut head.bytes)? == 0 {
                break;
            }
            let place = LineStart { begin, line };
            match head.text(place).bytes().next() {
                None => {}
                Some(b'#' | b'%') => head.comment = Some(place),
                Some(_) => {
                    head.last = Some(place);
                    break;
                }
            }
        }
        Ok(head)
    }

    /// The text of a line, without surrounding blanks.
    fn text(&self, place: LineStart) -> String {
        let line =
            self.bytes[place.begin..].split(|&byte| byte == b'\n').next().unwrap_or_default();
        let text = String::from_utf8_lossy(line);
        text.trim_start_matches('\u{feff}').trim().to_owned()
    }

    fn first_line(&self) -> String {
        self.last.map(|place| self.text(place)).unwrap_or_default()
    }

    fn kind(&self) -> FileKind {
        // A file without any pose gives the error of TUM files.
        let Some(place) = self.last else { return FileKind::Tum };
        let text = self.text(place);
        let fields: Vec<&str> = text.split_whitespace().collect();
        let separated = |text: &str| text.contains(SEPARATORS);
        match fields[..] {
            [..] if fields.len() == 12 && fields.iter().all(|field| is_number(field)) => {
                FileKind::Kitti
            }
            [first, ..] if !is_number(first.split([',', ';']).next().unwrap_or_default()) => {
                // Column names if there is more than one, otherwise an invalid line.
                match separated(&text) {
                    true => FileKind::Table { names: text, line: place.line },
                    false => FileKind::Tum,
                }
            }
            // Numbers. TUM files may have tabs, and column names in a comment.
            _ if !text.contains([',', ';']) && fields.len() == 8 => FileKind::Tum,
            _ if separated(&text) => match self.comment {
                Some(comment) if separated(&self.text(comment)) => {
                    let names = self.text(comment);
                    let names = names.trim_start_matches(['#', '%']).trim_start().to_owned();
                    FileKind::Table { names, line: comment.line }
                }
                _ => FileKind::NoNames { line: place.line },
            },
            _ => FileKind::Tum,
        }
    }
}
