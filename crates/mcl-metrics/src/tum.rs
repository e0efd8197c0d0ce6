//! Trajectory files in the TUM format: one pose per line, `t x y z qx qy qz qw`, in seconds and metres
//! and as a quaternion. Fields are separated by blanks; lines that begin with `#` are comments (TUM RGB-D
//! benchmark, *File Formats*).
//!
//! Poses must be planar: |z| at most [`MAX_Z`], and the vertical axis tilted
//! by at most [`MAX_TILT`]. Other poses can be projected onto the plane
//! ([`NonPlanar::Project`], as evo's `--project_to_plane xy`). Stamps, including negative ones, are read and written
//! to the nanosecond; poses are in file order, sorted or not.
//!
//! # Example
//! ```
//! use mcl_metrics::tum::{self, NonPlanar};
//!
//! let text = "# t x y z qx qy qz qw\n1071078718.462310123 1.5 -2 0 0 0 1 0\n";
//! let file = tum::read(text.as_bytes(), "example.tum", NonPlanar::Refuse)?;
//! assert_eq!(file.trajectory.poses()[0].theta, std::f64::consts::PI);
//! assert_eq!(file.trajectory.stamps()[0].nanoseconds(), 1_071_078_718_462_310_123);
//! # Ok::<(), tum::TumError>(())
//! ```

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use mcl_core::{Pose2, Stamp, Trajectory, files, math, wrap_angle};

use crate::planar::{self, Refused, quoted};
pub use crate::planar::{MAX_TILT, MAX_Z, NonPlanar, QuaternionOrder, ReadSettings};

/// The trajectory of a TUM file, and the number of backward stamps.
#[derive(Debug, Clone, PartialEq)]
pub struct TumTrajectory {
    /// Stamped poses in file order; headings within (−π, π].
    pub trajectory: Trajectory,
    /// Number of stamps that are earlier than the one before.
    pub backward_stamps: usize,
}

/// An error in reading or writing a TUM file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TumError {
    /// The file could not be opened or written.
    #[error("{}: {source}", .file.display())]
    Open {
        /// The file.
        file: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A line could not be read, or is not UTF-8 text.
    #[error("{}, line {line}: cannot read: {source}", .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The system's error.
        source: io::Error,
    },
    /// A line does not have exactly eight fields.
    #[error(
        "{}, line {line}: {found} fields, expected 8 separated by blanks: t x y z qx qy qz qw",
        .file.display()
    )]
    FieldCount {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Number of fields found.
        found: usize,
    },
    /// A field has an invalid value.
    #[error("{}, line {line}, field {field}: found {found}, expected {expected}", .file.display())]
    Field {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Name of the field, or fields.
        field: &'static str,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The file has no pose.
    #[error("{}: no pose found, expected lines of t x y z qx qy qz qw", .file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// A pose to write is NaN or infinite.
    #[error("cannot write pose {index}, {pose:?} at {stamp} s: expected finite numbers")]
    Pose {
        /// Index of the pose, from 0.
        index: usize,
        /// Its stamp.
        stamp: Stamp,
        /// The pose.
        pose: Pose2,
    },
    /// Writing failed.
    #[error("cannot write the trajectory: {0}")]
    Write(#[from] io::Error),
}

/// Reads the file at `path`; see [`read`].
///
/// # Errors
/// As [`read`], and if the file cannot be opened.
pub fn read_file(path: impl AsRef<Path>, non_planar: NonPlanar) -> Result<TumTrajectory, TumError> {
    let path = path.as_ref();
    let open = |source| TumError::Open { file: path.to_owned(), source };
    read(BufReader::new(File::open(path).map_err(open)?), path, non_planar)
}

/// Reads a trajectory line by line; `name` is the name of the file in errors. Quaternions need not be
/// normalized.
///
/// # Errors
/// If a line is not a comment, empty, or a planar pose (unless poses are projected),
/// or there is no pose.
pub fn read(
    reader: impl BufRead,
    name: impl AsRef<Path>,
    non_planar: NonPlanar,
) -> Result<TumTrajectory, TumError> {
    let settings = ReadSettings { non_planar, ..ReadSettings::default() };
    let read = Lines::read(reader, name.as_ref(), &settings)?;
    match read.first_without_rotation {
        Some(line) => Err(line.without_rotation()),
        None => Ok(read.found),
    }
}

/// Reads with other settings. If all quaternions are `0 0 0 0`, the file contains positions only and the headings are
/// 0; also returns whether it has headings.
pub(crate) fn read_with(
    reader: impl BufRead,
    name: &Path,
    settings: &ReadSettings,
) -> Result<(TumTrajectory, bool), TumError> {
    let read = Lines::read(reader, name, settings)?;
    match read.first_without_rotation {
        Some(line) if read.any_rotation => Err(line.without_rotation()),
        without => Ok((read.found, without.is_none())),
    }
}

/// The content of the lines of a file.
struct Lines<'a> {
    found: TumTrajectory,
    /// The first line whose quaternion is 0 0 0 0.
    first_without_rotation: Option<Line<'a>>,
    any_rotation: bool,
}

impl<'a> Lines<'a> {
    fn read(
        reader: impl BufRead,
        file: &'a Path,
        settings: &ReadSettings,
    ) -> Result<Self, TumError> {
        let (mut stamps, mut poses) = (Vec::new(), Vec::new());
        let (mut first_without_rotation, mut any_rotation) = (None, false);
        for (index, text) in reader.lines().enumerate() {
            let line = index + 1;
            let text =
                text.map_err(|source| TumError::Read { file: file.to_owned(), line, source })?;
            // Some editors write a byte order mark at the start of a file.
            let text = if index == 0 { text.trim_start_matches('\u{feff}') } else { &text }.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let line = Line { file, line };
            let (stamp, [x, y], heading) = line.parse(text, settings)?;
            any_rotation |= heading.is_some();
            if heading.is_none() {
                first_without_rotation.get_or_insert(line);
            }
            stamps.push(stamp);
            poses.push(Pose2::new(x, y, heading.unwrap_or(0.0)));
        }
        if stamps.is_empty() {
            return Err(TumError::Empty { file: file.to_owned() });
        }
        let backward_stamps = stamps.windows(2).filter(|pair| pair[1] < pair[0]).count();
        let trajectory = stamps.into_iter().zip(poses).collect();
        let found = TumTrajectory { trajectory, backward_stamps };
        Ok(Lines { found, first_without_rotation, any_rotation })
    }
}

/// The position of a line, for errors.
struct Line<'a> {
    file: &'a Path,
    line: usize,
}

impl Line<'_> {
    /// Parses stamp, position and, unless the quaternion is 0 0 0 0, heading.
    fn parse(
        &self,
        text: &str,
        settings: &ReadSettings,
    ) -> Result<(Stamp, [f64; 2], Option<f64>), TumError> {
        let fields: Vec<&str> = text.split_whitespace().collect();
        let [t, x, y, z, qx, qy, qz, qw] = fields[..] else {
            let (file, line, found) = (self.file.to_owned(), self.line, fields.len());
            return Err(TumError::FieldCount { file, line, found });
        };
        let stamp = Stamp::parse_seconds(t)
            .map_err(|error| self.error("t", quoted(t), format!("seconds; this is {error}")))?;
        let [x, y, z] = [self.number("x", x)?, self.number("y", y)?, self.number("z", z)?];
        let quaternion = [
            self.number("qx", qx)?,
            self.number("qy", qy)?,
            self.number("qz", qz)?,
            self.number("qw", qw)?,
        ];
        planar::check_height(z, settings.non_planar).map_err(|refused| self.refused(refused))?;
        if quaternion == [0.0; 4] {
            return Ok((stamp, [x, y], None));
        }
        let heading =
            planar::heading(quaternion, settings).map_err(|refused| self.refused(refused))?;
        Ok((stamp, [x, y], Some(heading)))
    }

    fn number(&self, field: &'static str, text: &str) -> Result<f64, TumError> {
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.error(field, quoted(text), "a finite number".into())),
        }
    }

    fn without_rotation(&self) -> TumError {
        let expected = "a quaternion that can be normalized".into();
        self.error(QUATERNION, "0 0 0 0".into(), expected)
    }

    fn refused(&self, Refused { is_height, found, expected }: Refused) -> TumError {
        self.error(if is_height { "z" } else { QUATERNION }, found, expected)
    }

    fn error(&self, field: &'static str, found: String, expected: String) -> TumError {
        TumError::Field { file: self.file.to_owned(), line: self.line, field, found, expected }
    }
}

const QUATERNION: &str = "qx qy qz qw";

/// Writes a trajectory to the file at `path` atomically, replacing an existing file; see [`write()`].
///
/// # Errors
/// As [`write()`], and if the file cannot be written ([`files::write_with`]).
pub fn write_file(path: impl AsRef<Path>, trajectory: &Trajectory) -> Result<(), TumError> {
    let path = path.as_ref();
    files::write_with(path, |file| write(file, trajectory)).map_err(|error| match error {
        TumError::Write(source) => TumError::Open { file: path.to_owned(), source },
        error => error,
    })
}

/// Writes a trajectory, one line per pose in its order: stamps with nine digits after the point,
/// numbers with enough digits to read back exactly. A heading reads back wrapped to
/// (−π, π] and within 10⁻¹⁵ rad, because the file contains the sine and cosine of half the heading.
///
/// # Errors
/// If a pose is not finite, or writing fails.
pub fn write(mut writer: impl Write, trajectory: &Trajectory) -> Result<(), TumError> {
    for (index, (stamp, pose)) in trajectory.iter().enumerate() {
        if !pose.is_finite() {
            return Err(TumError::Pose { index, stamp, pose });
        }
        let (qz, qw) = math::sin_cos(0.5 * wrap_angle(pose.theta));
        writeln!(writer, "{stamp} {} {} 0 0 0 {qz} {qw}", pose.x, pose.y)?;
    }
    Ok(writer.flush()?)
}
