use crate::OutOfMemory;

/// An error in the data types of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CoreError {
    /// A set of points was empty where at least one is needed.
    #[error("no points: at least one is needed")]
    NoPoints,
    /// A coordinate was NaN or infinite.
    #[error("point {index}: coordinate {axis} is {value}, expected a finite number of metres")]
    NonFinite {
        /// Index of the point, from 0.
        index: usize,
        /// Axis of the coordinate, from 0.
        axis: usize,
        /// The coordinate found.
        value: f64,
    },
    /// A coordinate is so large that squared distances overflow or lose all precision.
    #[error("point {index}: coordinate {axis} is {value:e} m, expected at most {limit:e} m from 0")]
    TooLarge {
        /// Index of the point, from 0.
        index: usize,
        /// Axis of the coordinate, from 0.
        axis: usize,
        /// The coordinate found.
        value: f64,
        /// The largest magnitude accepted.
        limit: f64,
    },
    /// A scan has no reference pose, so its endpoints cannot be projected into the map's frame.
    #[error("scan {scan} has no reference pose: a map needs the pose of every scan")]
    NoReference {
        /// Index of the scan in log order, from 0.
        scan: usize,
    },
    /// A trajectory has different numbers of stamps and poses.
    #[error("a trajectory of {stamps} stamps has {poses} poses, expected one pose per stamp")]
    LengthMismatch {
        /// Number of stamps.
        stamps: usize,
        /// Number of poses.
        poses: usize,
    },
    /// The nearest-neighbour index could not be built.
    #[error("cannot index {points} points for nearest-neighbour search: {reason}")]
    Index {
        /// Number of points.
        points: usize,
        /// The reason the library gives.
        reason: String,
    },
    /// The maximum range is not a positive number.
    #[error("max range is {0} m, expected a positive number of metres")]
    MaxRange(f64),
    /// There was not enough memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// The edge length of a map's cells is not a positive number.
    #[error("the edge of a cell is {0} m, expected a positive number of metres")]
    CellSize(f64),
    /// A covariance is not positive definite.
    #[error(
        "cell {index}: the covariance (xx, xy, yy) is {covariance:?} m², expected a positive definite matrix"
    )]
    Covariance {
        /// Index of the cell, from 0.
        index: usize,
        /// The covariance found.
        covariance: [f64; 3],
    },
}
