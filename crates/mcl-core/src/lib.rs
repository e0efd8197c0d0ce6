//! Data types that every crate of the suite shares: poses, points, laser scans, recordings, trajectories, point
//! maps, seeds, and nearest-neighbour search.
//!
//! Transforms are named by target and source frame: `map_from_laser` maps coordinates in the laser frame to the map
//! frame. Lengths are in metres, angles in radians (counter-clockwise positive), stamps in integer nanoseconds.
//!
//! # Example
//! ```
//! use mcl_core::Pose2;
//! use std::f64::consts::FRAC_PI_2;
//!
//! let map_from_laser = Pose2::new(1.0, 2.0, FRAC_PI_2);
//! let endpoint = map_from_laser.transform_point([3.0, 0.0]);
//! assert!((endpoint[0] - 1.0).abs() < 1e-12 && (endpoint[1] - 5.0).abs() < 1e-12);
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod error;
pub mod files;
pub mod math;
pub mod memory;
mod ndt_map;
mod neighbors;
mod normal;
mod point_map;
mod pose;
mod recording;
mod scan;
mod seed;
mod segment_map;
mod stamp;
pub mod text;
mod trajectory;

pub use error::CoreError;
pub use memory::OutOfMemory;
pub use ndt_map::{NdtCell, NdtMap};
pub use neighbors::{NearestNeighbors, Neighbor, TIE_DISTANCE};
pub use normal::StandardNormal;
pub use point_map::{MAX_COORDINATE, PointMap, check_finite};
pub use pose::{Pose2, wrap_angle};
pub use recording::{Bounds, Recording};
pub use scan::{LaserScan, ScanGeometry, Sweep, is_usable_range};
pub use seed::{Rng, Seed};
pub use segment_map::{LineSegment, SegmentMap};
pub use stamp::{ParseStampError, Stamp};
pub use trajectory::Trajectory;

/// A point in `D` dimensions, in metres.
pub type Point<const D: usize> = [f64; D];

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
