use std::io;
use std::path::PathBuf;

use mcl_core::text::printable;

use crate::planar::quoted;
use crate::tum::TumError;

/// An error in reading a trajectory file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrajectoryFileError {
    /// An error in a file in the TUM format.
    #[error(transparent)]
    Tum(#[from] TumError),
    /// The file could not be opened, or its start could not be read.
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
        line: u64,
        /// The reason.
        source: io::Error,
    },
    /// A line has a different number of fields than the others.
    #[error("{}, line {line}: {found} fields, expected {expected}", .file.display())]
    FieldCount {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: u64,
        /// Number of fields found.
        found: usize,
        /// Number and meaning of those expected.
        expected: String,
    },
    /// A field has an invalid value.
    #[error(
        "{}, line {line}, field {}: found {found}, expected {expected}", .file.display(), printable(.field)
    )]
    Field {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: u64,
        /// Name of the field, or fields.
        field: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// Columns are missing or ambiguous.
    #[error("{}, line {line}: {problem}; the columns are {columns}", .file.display())]
    Columns {
        /// The file.
        file: PathBuf,
        /// The line of the column names, from 1.
        line: usize,
        /// What is missing or ambiguous.
        problem: String,
        /// The columns found.
        columns: String,
    },
    /// The columns have no names.
    #[error(
        "{}, line {line}: found {}, expected a line before it with the names of the columns (t,x,y,theta), or \
         a file in the TUM format: t x y z qx qy qz qw, separated by blanks", .file.display(), quoted(.found)
    )]
    NoNames {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The line.
        found: String,
    },
    /// The file has no pose.
    #[error("{}: no pose found below the names of the columns", .file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
}
