//! Sensor model (*Probabilistic Robotics*, chapter 6): distances to the nearest point, cell, segment or Gaussian of a
//! map, and the likelihood field based on them.

mod cell_distances;
mod distance_field;
mod exp;
mod fetch;
mod grid;
mod grid_builder;
mod likelihood_field;
mod lookup;
mod ndt_distances;
mod obstacle_grid;
mod pass;
mod scan_endpoints;
mod segment_distances;
mod transform;

pub use cell_distances::CellDistances;
pub use distance_field::{DistanceField, ExactDistances, MapDistances};
pub use likelihood_field::LikelihoodField;
pub(crate) use likelihood_field::{Poses, Scratch};
pub use ndt_distances::{NdtDistances, NdtReading};
pub use obstacle_grid::{FreeSpace, ObstacleGrid};
pub use scan_endpoints::ScanEndpoints;
pub use segment_distances::SegmentDistances;
