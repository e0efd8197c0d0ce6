//! Trajectory files of others, whatever their format, recognized by what they hold:
//!
//! | format | a line | recognized by |
//! |---|---|---|
//! | [TUM](crate::tum) | `t x y z qx qy qz qw`, parted by blanks | the rest |
//! | KITTI | the upper three rows of the pose's matrix, row by row | 12 numbers parted by blanks |
//! | EuRoC | `#timestamp [ns], p_RS_R_x [m], …, q_RS_w [], …` | its names of columns |
//! | CSV | columns by name, parted by commas, semicolons or tabs | a line of names before the numbers |
//!
//! Of a CSV file with names are read: time (`t`, `time`, `stamp`, `timestamp`, or `sec` and `nsec`), `x` and
//! `y`, and where they are there `z`, a heading in radians (`theta`, `yaw`, `heading`) or a quaternion (`qx`
//! `qy` `qz` `qw`, in any order). Names may be longer, as topics are written by ROS (`pose.position.x`,
//! `field.header.stamp`, `p_x`, `orientation.w`), and have units (`time_ms`, `timestamp [ns]`, `yaw (deg)`).
//! Times above 10¹⁷ are nanoseconds, all others seconds, unless the name has the unit. Names of which two
//! would do are an error that lists the columns.
//!
//! Not all files have headings: those of CSV without such a column and of TUM whose quaternions are all
//! `0 0 0 0` hold positions only.
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

/// Bytes in which the first line that is no comment is looked for.
const SNIFFED_BYTES: u64 = 1 << 16;
/// What parts the columns of a table.
const SEPARATORS: [char; 3] = [',', ';', '\t'];

pub use crate::planar::{NonPlanar, QuaternionOrder, ReadSettings};
pub use error::TrajectoryFileError;

/// The format of a trajectory file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TrajectoryFormat {
    /// TUM: `t x y z qx qy qz qw`.
    Tum,
    /// KITTI: 12 numbers of a matrix, no stamps.
    Kitti,
    /// EuRoC: CSV with its names.
    Euroc,
    /// CSV with names of columns.
    Csv,
}

/// What a trajectory file holds, and what is worth knowing about it.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryFile {
    /// Stamped poses in file order, at least one; headings within (−π, π], 0 where there are none.
    pub trajectory: Trajectory,
    /// The format it was recognized as.
    pub format: TrajectoryFormat,
    /// Whether the file has headings; else it holds positions only.
    pub has_headings: bool,
    /// How many stamps are earlier than the one before.
    pub backward_stamps: usize,
    /// How many stamps equal the one before.
    pub repeated_stamps: usize,
    /// What a user should be told, a sentence each.
    pub notes: Vec<String>,
    /// What makes the file's content doubtful, a sentence each.
    pub doubts: Vec<String>,
}

/// Whether a file is one of trajectories by its first line that is no comment, which begins with a number or has names
/// of columns with separators; a log begins with the name of a record's kind.
///
/// # Errors
/// When the file cannot be read.
pub fn is_trajectory_file(path: impl AsRef<Path>) -> io::Result<bool> {
    let file = File::open(path)?.take(SNIFFED_BYTES);
    let head = Head::read(&mut BufReader::new(file))?;
    let text = head.first_line();
    let first = text.split(SEPARATORS).next().unwrap_or_default();
    let first = first.split_whitespace().next().unwrap_or_default();
    Ok(text.is_empty() || is_number(first) || text.contains(SEPARATORS))
}

/// Reads the file at `path`; see [`read`].
///
/// # Errors
/// As [`read`], and when the file cannot be opened.
pub fn read_file(
    path: impl AsRef<Path>,
    settings: &ReadSettings,
) -> Result<TrajectoryFile, TrajectoryFileError> {
    let path = path.as_ref();
    let open = |source| TrajectoryFileError::Open { file: path.to_owned(), source };
    read(BufReader::new(File::open(path).map_err(open)?), path, settings)
}

/// Reads a trajectory; `name` stands for the file in errors. What is held at most is proportional to what is
/// read.
///
/// # Errors
/// When no format is recognized, columns are missing or ambiguous, at the first line that is no planar pose
/// (unless poses are projected), and when there is no pose at all.
pub fn read(
    mut reader: impl BufRead,
    name: impl AsRef<Path>,
    settings: &ReadSettings,
) -> Result<TrajectoryFile, TrajectoryFileError> {
    let name = name.as_ref();
    let head = Head::read(&mut reader)
        .map_err(|source| TrajectoryFileError::Open { file: name.to_owned(), source })?;
    let whole = io::Cursor::new(&head.bytes).chain(reader);
    let found = match head.kind() {
        Kind::Tum => {
            let (file, has_headings) = tum::read_with(whole, name, settings)?;
            Found {
                trajectory: file.trajectory,
                format: TrajectoryFormat::Tum,
                has_headings,
                notes: vec![],
            }
        }
        Kind::Kitti => kitti::read(whole, name, settings.non_planar)?,
        Kind::Table { names, line } => table::read(whole, name, &names, line, settings.non_planar)?,
        Kind::NoNames { line } => {
            let found = head.first_line();
            return Err(TrajectoryFileError::NoNames { file: name.to_owned(), line, found });
        }
    };
    Ok(found.finish())
}

/// What the reader of a format found.
struct Found {
    trajectory: Trajectory,
    format: TrajectoryFormat,
    has_headings: bool,
    notes: Vec<String>,
}

impl Found {
    fn finish(self) -> TrajectoryFile {
        let Found { trajectory, format, has_headings, notes } = self;
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

/// Whether all headings are the same although the robot goes more than a metre, and not straight on: steps of
/// 0.1 m and more look in directions that differ by more than 0.5 rad.
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

/// The beginning of a file, up to its first line of numbers or names.
struct Head {
    /// As read, comments included.
    bytes: Vec<u8>,
    /// Where the last line of it that is not empty begins, and the last comment before.
    last: Option<Place>,
    comment: Option<Place>,
}

/// A line: where it begins in bytes, and its number, from 1.
#[derive(Clone, Copy)]
struct Place {
    begin: usize,
    line: usize,
}

enum Kind {
    Tum,
    Kitti,
    /// Columns, named in a line.
    Table {
        names: String,
        line: usize,
    },
    /// Columns without names.
    NoNames {
        line: usize,
    },
}

impl Head {
    fn read(reader: &mut impl BufRead) -> io::Result<Self> {
        let mut head = Head { bytes: Vec::new(), last: None, comment: None };
        for line in 1.. {
            let begin = head.bytes.len();
            if reader.read_until(b'\n', &mut head.bytes)? == 0 {
                break;
            }
            let place = Place { begin, line };
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

    /// The line at a place, without blanks around it.
    fn text(&self, place: Place) -> String {
        let line =
            self.bytes[place.begin..].split(|&byte| byte == b'\n').next().unwrap_or_default();
        let text = String::from_utf8_lossy(line);
        text.trim_start_matches('\u{feff}').trim().to_owned()
    }

    fn first_line(&self) -> String {
        self.last.map(|place| self.text(place)).unwrap_or_default()
    }

    fn kind(&self) -> Kind {
        // A file without any pose: its error is that of TUM files.
        let Some(place) = self.last else { return Kind::Tum };
        let text = self.text(place);
        let fields: Vec<&str> = text.split_whitespace().collect();
        let separated = |text: &str| text.contains(SEPARATORS);
        match fields[..] {
            [..] if fields.len() == 12 && fields.iter().all(|field| is_number(field)) => {
                Kind::Kitti
            }
            [first, ..] if !is_number(first.split([',', ';']).next().unwrap_or_default()) => {
                // Names, if there is more than one; else a broken line.
                match separated(&text) {
                    true => Kind::Table { names: text, line: place.line },
                    false => Kind::Tum,
                }
            }
            // Numbers. TUM files may have tabs, and names of columns in a comment.
            _ if !text.contains([',', ';']) && fields.len() == 8 => Kind::Tum,
            _ if separated(&text) => match self.comment {
                Some(comment) if separated(&self.text(comment)) => {
                    let names = self.text(comment);
                    let names = names.trim_start_matches(['#', '%']).trim_start().to_owned();
                    Kind::Table { names, line: comment.line }
                }
                _ => Kind::NoNames { line: place.line },
            },
            _ => Kind::Tum,
        }
    }
}
