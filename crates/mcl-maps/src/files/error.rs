use std::fmt;
use std::io;
use std::path::PathBuf;

use mcl_core::CoreError;

use crate::occupancy::GridError;

/// Why a map file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    /// The ending names no map format.
    #[error(
        "{}: {} is no map format, expected one of .csv, .ply, .pcd, .yaml", path.display(),
        if ending.is_empty() { "a file without ending".into() } else { format!("\".{ending}\"") }
    )]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// Its ending in lower case, without the dot.
        ending: String,
    },
    /// The image of a grid map, without its description.
    #[error(
        "{}: an image alone has neither scale nor place; name the .yaml file that describes it",
        path.display()
    )]
    BareImage {
        /// The file.
        path: PathBuf,
    },
    /// A grid map where points in space are wanted.
    #[error("{}: a grid map is planar, expected one of .csv, .ply, .pcd for a map in 3-D", path.display())]
    PlanarFormat {
        /// The file.
        path: PathBuf,
    },
    /// A grid map was named where points are wanted.
    #[error("{}: a grid map, expected a point cloud: .ply, .pcd or .csv", path.display())]
    NoCloud {
        /// The file.
        path: PathBuf,
    },
    /// The file could not be read at all.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file could not be written; what was there before is untouched.
    #[error("cannot write {}: {source}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file was read, but does not hold a map.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: MapProblem,
    },
}

/// Where in a map file something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, from 1.
    Line(u64),
    /// A point of a binary file, from 0.
    Point(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Point(index) => write!(f, "point {index}"),
        }
    }
}

/// What is wrong with the content of a map file.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum MapProblem {
    /// The header (or, in CSV, the quoting) cannot be understood.
    #[error("{reason}")]
    Syntax {
        /// The place, where known, and what was found and expected.
        reason: String,
    },
    /// A field that is needed is not there.
    #[error("no field \"{field}\", found {found}; expected {expected}")]
    MissingField {
        /// The field.
        field: &'static str,
        /// The fields of the file.
        found: String,
        /// What the field should say.
        expected: &'static str,
    },
    /// A field with a value that cannot be used.
    #[error("field \"{field}\": found {found}, expected {expected}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// What would have been right.
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
        place: Place,
        /// Number of values found.
        found: u64,
        /// Number of values the header announces.
        expected: u64,
    },
    /// A value is no coordinate.
    #[error("{place}, column \"{column}\": found {found}, expected {expected}")]
    Value {
        /// The row.
        place: Place,
        /// The column.
        column: &'static str,
        /// The value as it stands in the file.
        found: String,
        /// What would have been right.
        expected: &'static str,
    },
    /// The header announces another number of points than the file holds.
    #[error(
        "the header announces {announced} {what}, the file holds {found}: it is damaged or cut short"
    )]
    Count {
        /// What is counted: "points", or other elements of a PLY file.
        what: String,
        /// The number announced.
        announced: u64,
        /// What the file holds.
        found: String,
    },
    /// No points, or coordinates too large for a map.
    #[error("{0}")]
    Points(CoreError),
    /// A cloud without a single measured point.
    #[error(
        "no point in it{}",
        if *not_finite == 0 { String::new() } else { format!(": the coordinates of all {not_finite} points are not finite") }
    )]
    NoMeasurement {
        /// Points left out.
        not_finite: usize,
    },
    /// No grid of this size and resolution.
    #[error("{0}")]
    Grid(GridError),
    /// A grid without points.
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
