use mcl_core::{CoreError, OutOfMemory};

/// An error in building or evaluating a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The points are unusable.
    #[error(transparent)]
    Points(#[from] CoreError),
    /// The size is zero, exceeds the number of points, or is a percentage outside (0, 100].
    #[error("map size {size} of {available} points: expected {expected}")]
    Size {
        /// The size requested.
        size: String,
        /// Number of points given to the builder.
        available: usize,
        /// What is accepted.
        expected: &'static str,
    },
    /// A setting is outside its range.
    #[error("{setting} is {value}, expected {expected}")]
    Setting {
        /// Name of the setting, with its unit.
        setting: &'static str,
        /// The value found.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// The cells are so small, or the points so far away, that cell indices overflow.
    #[error(
        "a cell of {cell} m is too small for a coordinate of {coordinate} m: \
         the cell index would exceed 2^52; use a larger cell"
    )]
    CellIndex {
        /// Edge length of a cell in metres.
        cell: f64,
        /// The coordinate that overflows, in metres, relative to the grid's offset.
        coordinate: f64,
    },
    /// There was not enough memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// No cell of an NDT map has enough points for a Gaussian.
    #[error(
        "no cell of {cell} m holds {min_points} points, which a Gaussian needs; use larger cells or \
         denser data"
    )]
    NoGaussian {
        /// Edge length of a cell in metres.
        cell: f64,
        /// Number of points that a cell needs.
        min_points: usize,
    },
    /// No line segment was found in the scans.
    #[error(
        "no line of at least {min_length} m and {min_points} points in the scans; allow shorter ones or a \
         larger tolerance"
    )]
    NoSegment {
        /// Smallest length of a segment in metres.
        min_length: f64,
        /// Number of points that a segment needs.
        min_points: usize,
    },
}
