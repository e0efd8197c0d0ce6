use std::fmt;
use std::io;
use std::path::PathBuf;

use mcl_core::CoreError;

use crate::occupancy::GridError;

/// An error in reading or writing a map file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapFileError {
    /// The extension is not that of a map format.
    #[error(
        "{}: {} is not a map format, expected one of .csv, .ply, .pcd, .yaml", path.display(),
        if ending.is_empty() { "a file without ending".into() } else { format!("\".{ending}\"") }
    )]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// Its extension in lower case, without the dot.
        ending: String,
    },
    /// The path names the image of a grid map, not its description.
    #[error(
        "{}: an image alone has no scale or position; name the .yaml file that describes it",
        path.display()
    )]
    BareImage {
        /// The file.
        path: PathBuf,
    },
    /// A grid map was given where a 3-D map is expected.
    #[error("{}: a grid map is planar, expected one of .csv, .ply, .pcd for a map in 3-D", path.display())]
    PlanarFormat {
        /// The file.
        path: PathBuf,
    },
    /// A grid map was given where a point cloud is expected.
    #[error("{}: a grid map, expected a point cloud: .ply, .pcd or .csv", path.display())]
    NoCloud {
        /// The file.
        path: PathBuf,
    },
    /// The file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file could not be written; an existing file is unchanged.
    #[error("cannot write {}: {source}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file was read, but its content is not a valid map.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: MapProblem,
    },
}

/// A position in a map file, for error messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilePosition {
    /// A line of a text file, from 1.
    Line(u64),
    /// A point of a binary file, from 0.
    Point(u64),
}

impl fmt::Display for FilePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FilePosition::Line(line) => write!(f, "line {line}"),
            FilePosition::Point(index) => write!(f, "point {index}"),
        }
    }
}

/// A problem with the content of a map file.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapProblem {
    /// The header (or, in CSV, the quoting) cannot be parsed.
    #[error("{reason}")]
    Syntax {
        /// The position, where known, and what was found and expected.
        reason: String,
    },
    /// A required field is missing.
    #[error("no field \"{field}\", found {found}; expected {expected}")]
    MissingField {
        /// The field.
        field: &'static str,
        /// The fields of the file.
        found: String,
        /// What is expected of the field.
        expected: &'static str,
    },
    /// A field has an invalid value.
    #[error("field \"{field}\": found {found}, expected {expected}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A coordinate has no column.
    #[error("no column \"{column}\", found {found}")]
    MissingColumn {
        /// The column looked for.
        column: &'static str,
        /// The columns of the file.
        found: String,
    },
    /// A coordinate has more than one column.
    #[error("column \"{column}\" occurs more than once in {found}")]
    DoubleColumn {
        /// The column.
        column: &'static str,
        /// The columns of the file.
        found: String,
    },
    /// A row is too short or too long.
    #[error("{place}: found {found} values, expected {expected}")]
    RowLength {
        /// The row.
        place: FilePosition,
        /// Number of values found.
        found: u64,
        /// Number of values the header announces.
        expected: u64,
    },
    /// A value is not a valid coordinate.
    #[error("{place}, column \"{column}\": found {found}, expected {expected}")]
    Value {
        /// The row.
        place: FilePosition,
        /// The column.
        column: &'static str,
        /// The value as written in the file.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The number of points in the header is not that of the file.
    #[error(
        "the header announces {announced} {what}, the file holds {found}: it is damaged or cut short"
    )]
    Count {
        /// What is counted: "points", or other elements of a PLY file.
        what: String,
        /// The number in the header.
        announced: u64,
        /// The number in the file, in words.
        found: String,
    },
    /// There are no points, or coordinates are too large for a map.
    #[error("{0}")]
    Points(CoreError),
    /// A point cloud has no finite point.
    #[error(
        "no point in it{}",
        if *not_finite == 0 { String::new() } else { format!(": the coordinates of all {not_finite} points are not finite") }
    )]
    NoMeasurement {
        /// Number of points left out.
        not_finite: usize,
    },
    /// The size or resolution of a grid is invalid.
    #[error("{0}")]
    Grid(GridError),
    /// A grid has no occupied cell.
    #[error(
        "no cell of {width} × {height} is occupied (p > occupied_thresh), so the map has no point"
    )]
    NothingOccupied {
        /// Columns of the grid.
        width: usize,
        /// Rows of the grid.
        height: usize,
    },
}

impl MapProblem {
    pub(super) fn syntax(reason: impl Into<String>) -> Self {
        MapProblem::Syntax { reason: reason.into() }
    }

    pub(super) fn field(
        field: &'static str,
        found: impl Into<String>,
        expected: &'static str,
    ) -> Self {
        MapProblem::Field { field, found: found.into(), expected }
    }

    pub(super) fn count(
        what: impl Into<String>,
        announced: u64,
        found: impl Into<String>,
    ) -> MapProblem {
        MapProblem::Count { what: what.into(), announced, found: found.into() }
    }
}
