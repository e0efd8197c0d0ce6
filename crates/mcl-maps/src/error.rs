use mcl_core::{CoreError, OutOfMemory};

/// Why a map could not be built or evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MapError {
    /// The points themselves are unusable.
    #[error(transparent)]
    Points(#[from] CoreError),
    /// A size of zero, of more points than there are, or a percentage outside (0, 100].
    #[error("map size {size} of {available} points: expected {expected}")]
    Size {
        /// The size asked for.
        size: String,
        /// Points given to the builder.
        available: usize,
        /// What would be accepted.
        expected: &'static str,
    },
    /// A setting outside its range.
    #[error("{setting} is {value}, expected {expected}")]
    Setting {
        /// Name of the setting, with its unit.
        setting: &'static str,
        /// The value found.
        value: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// Cells so small, or points so far away, that cell indices lose their meaning.
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
    /// No cell of an NDT map has the points that a Gaussian needs.
    #[error(
        "no cell of {cell} m holds {min_points} points, which a Gaussian needs; use larger cells or \
         denser data"
    )]
    NoGaussian {
        /// Edge length of a cell in metres.
        cell: f64,
        /// Points that a cell needs.
        min_points: usize,
    },
    /// Nothing in the scans is a line segment.
    #[error(
        "no line of at least {min_length} m and {min_points} points in the scans; allow shorter ones or a \
         larger tolerance"
    )]
    NoSegment {
        /// Smallest length of a segment in metres.
        min_length: f64,
        /// Points that a segment needs.
        min_points: usize,
    },
}
