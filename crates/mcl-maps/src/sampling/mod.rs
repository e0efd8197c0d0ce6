//! Initial maps: subsets of the points, chosen at random or by a grid.

mod grid;
mod random;

pub use grid::{GridOffset, GridSample, sample_grid, sample_grid_of_size};
pub use random::sample_random;
