//! Occupancy grids: the plane in square cells that are occupied, free or unknown.
//!
//! Many programs use such maps (ROS's map_server, see [`crate::files`]). A grid is converted to a point map by taking
//! the centres of its occupied cells. A point map is converted to a grid by marking the cells that contain a point
//! as occupied and, with a log, those that its beams cross as [free](rasterize).
//!
//! # Example
//! ```
//! use mcl_core::PointMap;
//! use mcl_maps::occupancy::{Cell, rasterize};
//!
//! let wall = PointMap::new(vec![[0.52, 0.52], [0.53, 0.51], [0.68, 0.52]])?;
//! let grid = rasterize(&wall, 0.05, None)?;
//! assert_eq!(grid.count(Cell::Occupied), 2); // The first two points share a cell.
//! let centres = grid.occupied_points();
//! assert!((centres[0][0] - 0.525).abs() < 1e-12 && (centres[0][1] - 0.525).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod beam;
mod rasterize;

use mcl_core::{CoreError, OutOfMemory, Point, Pose2};

pub use rasterize::{FreeSpace, rasterize};

/// Largest number of cells of a grid: 500 m × 500 m at 5 cm.
pub const MAX_CELLS: usize = 100_000_000;

/// Default edge length of a cell in metres, as usual for indoor maps.
pub const DEFAULT_RESOLUTION: f64 = 0.05;

/// State of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cell {
    /// Contains an obstacle.
    Occupied,
    /// Contains no obstacle.
    Free,
    /// Not observed, or not certain.
    #[default]
    Unknown,
}

/// An error in creating a grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// The resolution is not a positive number.
    #[error("the resolution is {0} m, expected a positive number")]
    Resolution(f64),
    /// The grid would have more than [`MAX_CELLS`] cells.
    #[error(
        "{width} × {height} cells of {resolution} m are more than {MAX_CELLS}; use a larger resolution"
    )]
    TooLarge {
        /// Number of columns.
        width: f64,
        /// Number of rows.
        height: f64,
        /// Edge length of a cell in metres.
        resolution: f64,
    },
    /// The log for the free space has no reference poses, or settings are unusable.
    #[error("the free space cannot be found: {0}")]
    Log(#[from] CoreError),
    /// There was not enough memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

/// An occupancy grid of one or more square cells.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    width: usize,
    resolution: f64,
    map_from_grid: Pose2,
    cells: Vec<Cell>,
}

impl OccupancyGrid {
    /// Creates a grid from its cells: row by row from the bottom, each from left to right, `width` cells per row.
    /// `resolution` is the edge length of a cell in metres; `map_from_grid` is the pose of the lower left
    /// corner of the first cell, with the column index increasing along x and the row index along y.
    ///
    /// # Errors
    /// [`GridError::Resolution`] unless the resolution is positive, [`GridError::TooLarge`] for more than
    /// [`MAX_CELLS`] cells.
    ///
    /// # Panics
    /// If there are no cells, or their number is not a multiple of `width`.
    pub fn new(
        width: usize,
        resolution: f64,
        map_from_grid: Pose2,
        cells: Vec<Cell>,
    ) -> Result<Self, GridError> {
        assert!(
            width > 0 && !cells.is_empty() && cells.len().is_multiple_of(width),
            "{} cells in rows of {width}",
            cells.len()
        );
        check_resolution(resolution)?;
        check_size(width as f64, (cells.len() / width) as f64, resolution)?;
        Ok(OccupancyGrid { width, resolution, map_from_grid, cells })
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.cells.len() / self.width
    }

    /// Edge length of a cell in metres.
    pub fn resolution(&self) -> f64 {
        self.resolution
    }

    /// Pose of the lower left corner in the map frame.
    pub fn map_from_grid(&self) -> Pose2 {
        self.map_from_grid
    }

    /// The cells, row by row from the bottom, each from left to right.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Number of cells in this state.
    pub fn count(&self, kind: Cell) -> usize {
        self.cells.iter().filter(|&&cell| cell == kind).count()
    }

    /// The centres of the occupied cells in the map frame, in metres, in the order of the cells.
    pub fn occupied_points(&self) -> Vec<Point<2>> {
        let occupied = self.cells.iter().enumerate().filter(|(_, cell)| **cell == Cell::Occupied);
        let centre = |index: usize| (index as f64 + 0.5) * self.resolution;
        occupied
            .map(|(index, _)| {
                let (column, row) = (index % self.width, index / self.width);
                self.map_from_grid.transform_point([centre(column), centre(row)])
            })
            .collect()
    }
}

fn check_resolution(resolution: f64) -> Result<(), GridError> {
    match resolution.is_finite() && resolution > 0.0 {
        true => Ok(()),
        false => Err(GridError::Resolution(resolution)),
    }
}

fn check_size(width: f64, height: f64, resolution: f64) -> Result<(), GridError> {
    match width * height <= MAX_CELLS as f64 {
        true => Ok(()),
        false => Err(GridError::TooLarge { width, height, resolution }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn centres_of_a_rotated_grid() {
        // Occupied: lower right and upper left.
        let (o, f, u) = (Cell::Occupied, Cell::Free, Cell::Unknown);
        let origin = Pose2::new(10.0, 20.0, FRAC_PI_2);
        let grid = OccupancyGrid::new(3, 2.0, origin, vec![f, u, o, o, f, u]).unwrap();
        assert_eq!((grid.width(), grid.height()), (3, 2));
        assert_eq!([o, f, u].map(|kind| grid.count(kind)), [2, 2, 2]);
        let expected = [[10.0 - 1.0, 20.0 + 5.0], [10.0 - 3.0, 20.0 + 1.0]];
        for (found, expected) in grid.occupied_points().iter().zip(expected) {
            assert!((found[0] - expected[0]).abs() < 1e-12, "{found:?}");
            assert!((found[1] - expected[1]).abs() < 1e-12, "{found:?}");
        }
    }

    #[test]
    fn a_resolution_must_be_a_length() {
        for resolution in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let grid = OccupancyGrid::new(1, resolution, Pose2::IDENTITY, vec![Cell::Free]);
            assert!(matches!(grid, Err(GridError::Resolution(_))), "{resolution}");
        }
    }
}
