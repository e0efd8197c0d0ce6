use std::f64::consts::SQRT_2;

use mcl_core::{Bounds, CoreError, Point, math};

use super::obstacle_grid::{FreeSpace, ObstacleGrid};
use super::transform::squared_distances;
use crate::FilterError;
use crate::check::check_length;

/// The likelihood field of an occupancy grid: one distance per cell, from its centre to the centre of the
/// nearest occupied cell on which [beams end](ObstacleGrid), used for every point in the cell (*Probabilistic
/// Robotics*, table 6.3, as commonly implemented: ROS's amcl and Nav2). Outside the grid, and for larger distances, it
/// is `max_distance`.
pub struct CellDistances {
    /// Position of the map origin in the grid (m), sine and cosine of the map orientation in it.
    origin: Point<2>,
    sin: f64,
    cos: f64,
    per_metre: f64,
    width: usize,
    height: usize,
    /// min(d², max_distance²) in m², per cell.
    squared: Vec<f64>,
    bounds: Bounds<2>,
    pub(super) free: Option<FreeSpace>,
    max_distance: f64,
}

impl CellDistances {
    /// Computes the distances in a grid, truncated at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` or resolution out of range,
    /// [`FilterError::NonFinitePose`] for a grid pose that is not finite, [`FilterError::GridShape`] if the number of
    /// cells is not a multiple of the width, and [`FilterError::Map`] if no cell is occupied.
    pub fn build(grid: &ObstacleGrid, max_distance: f64) -> Result<Self, FilterError> {
        check_length("max_distance", max_distance)?;
        let free = FreeSpace::of(grid)?;
        let ObstacleGrid { width, resolution, map_from_grid, .. } = *grid;
        let surface = grid.surface();
        let bounds = Bounds::of(&grid.centres(&surface)).ok_or(CoreError::NoPoints)?;
        let cut = max_distance * max_distance;
        let in_cells = squared_distances(width, &surface);
        let grid_from_map = map_from_grid.inverse();
        let (sin, cos) = math::sin_cos(grid_from_map.theta);
        Ok(CellDistances {
            origin: [grid_from_map.x, grid_from_map.y],
            sin,
            cos,
            per_metre: 1.0 / resolution,
            width,
            height: surface.len() / width,
            squared: in_cells.iter().map(|d| (d * resolution * resolution).min(cut)).collect(),
            bounds,
            free,
            max_distance,
        })
    }

    /// Converts a point (m) to cells, relative to the corner of the grid.
    #[inline]
    fn in_cells(&self, [x, y]: Point<2>) -> Point<2> {
        let CellDistances { origin, sin, cos, .. } = self;
        [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y]
            .map(|metres| metres * self.per_metre)
    }

    /// Distance at which distances are truncated (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// Edge length of a cell (m).
    pub fn resolution(&self) -> f64 {
        1.0 / self.per_metre
    }

    /// Bounding box of the centres of the occupied cells.
    pub fn bounds(&self) -> Bounds<2> {
        self.bounds
    }

    /// A lower bound (m): from no position within w of a point is the distance less than this − w. It is the distance
    /// of the cell minus a diagonal, since a cell has one distance for all points in it.
    pub(super) fn floor(&self, point: Point<2>) -> f64 {
        let [x, y] = self.in_cells(point);
        let cell = |place: f64, cells: usize| (place.max(0.0) as usize).min(cells - 1);
        let cell = cell(y, self.height) * self.width + cell(x, self.width);
        self.squared[cell].sqrt() - SQRT_2 / self.per_metre
    }

    /// min(d², max_distance²) in m², with d the distance of the cell that contains a finite point.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        let [x, y] = self.in_cells(point);
        if x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64 {
            self.squared[y as usize * self.width + x as usize]
        } else {
            self.max_distance * self.max_distance
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Pose2;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn places_have_the_distance_of_their_cell() {
        // 3 columns and 2 rows of 0.5 m, rotated by 90° to the left about (10, 20): the first cell is
        // x from 9.5 to 10, y from 20 to 20.5. It is occupied.
        let mut occupied = vec![false; 6];
        occupied[0] = true;
        let map_from_grid = Pose2::new(10.0, 20.0, FRAC_PI_2);
        let free = Vec::new();
        let grid = ObstacleGrid { width: 3, resolution: 0.5, map_from_grid, occupied, free };
        let distances = CellDistances::build(&grid, 0.8).unwrap();
        for (point, expected) in [
            ([9.99, 20.01], 0.0),
            ([9.51, 20.49], 0.0),
            ([9.75, 20.75], 0.25),
            ([9.25, 20.25], 0.25),
            ([9.25, 20.75], 0.5),
            // √(0.25 + 1) is truncated, and so is everything outside.
            ([9.25, 21.25], 0.64),
            ([10.01, 20.25], 0.64),
            ([1e300, -1e300], 0.64),
        ] {
            let found = distances.distance_squared(point);
            assert!((found - expected).abs() < 1e-12, "{point:?}: {found}");
        }
        let bounds = distances.bounds();
        assert!((bounds.min[0] - 9.75).abs() < 1e-12 && (bounds.max[1] - 20.25).abs() < 1e-12);
    }

    #[test]
    fn invalid_grids_are_refused() {
        let grid = |width, resolution, x, occupied: &[bool]| {
            let (map_from_grid, occupied, free) =
                (Pose2::new(x, 0.0, 0.0), occupied.to_vec(), Vec::new());
            let grid = ObstacleGrid { width, resolution, map_from_grid, occupied, free };
            CellDistances::build(&grid, 2.0)
        };
        assert!(grid(2, 0.5, 0.0, &[true, false]).is_ok());
        assert!(matches!(grid(2, 0.0, 0.0, &[true; 2]), Err(FilterError::Setting { .. })));
        assert!(matches!(
            grid(2, 0.5, f64::NAN, &[true; 2]),
            Err(FilterError::NonFinitePose { .. })
        ));
        assert!(matches!(grid(2, 0.5, 0.0, &[true; 3]), Err(FilterError::GridShape { .. })));
        assert!(matches!(grid(0, 0.5, 0.0, &[]), Err(FilterError::GridShape { .. })));
        assert!(matches!(grid(2, 0.5, 0.0, &[false; 2]), Err(FilterError::Map(_))));
    }
}
