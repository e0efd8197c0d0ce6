//! Positions in a file.

use std::fmt;

/// A position in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Position {
    /// Offset of a record, or of the chunk that holds it.
    Byte(u64),
    /// Row of a table of a database.
    Row(i64),
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Position::Byte(offset) => write!(f, "byte {offset}"),
            Position::Row(row) => write!(f, "row {row}"),
        }
    }
}
