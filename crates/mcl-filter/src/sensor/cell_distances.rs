use std::f64::consts::SQRT_2;

use mcl_core::{Bounds, CoreError, Point, Pose2, math};

use crate::FilterError;
use crate::check::check_length;

/// Which cells of a grid are occupied: what a likelihood field needs to know of an occupancy grid.
#[derive(Debug, Clone, Copy)]
pub struct ObstacleGrid<'a> {
    /// Columns.
    pub width: usize,
    /// Edge length of a cell (m).
    pub resolution: f64,
    /// Pose of the lower left corner, from where columns run along x and rows along y.
    pub map_from_grid: Pose2,
    /// Whether each cell is occupied: row by row from the bottom, each from the left.
    pub occupied: &'a [bool],
}

/// The likelihood field of an occupancy grid: one distance per cell, from its centre to the centre of the
/// nearest occupied cell, and so for every place in the cell (*Probabilistic Robotics*, table 6.3, as
/// commonly implemented: ROS's amcl and Nav2). Outside of the grid, and beyond the cut, it is the cut.
pub struct CellDistances {
    grid_from_map: Pose2,
    per_metre: f64,
    width: usize,
    height: usize,
    /// min(d², max_distance²) in m², per cell.
    squared: Vec<f64>,
    bounds: Bounds<2>,
    max_distance: f64,
}

impl CellDistances {
    /// Measures the distances in a grid, cut at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` or a resolution that is no length,
    /// [`FilterError::NonFinitePose`] for a grid that is nowhere, [`FilterError::GridShape`] for cells
    /// that are no whole number of rows, and [`FilterError::Map`] when no cell is occupied.
    pub fn build(grid: &ObstacleGrid<'_>, max_distance: f64) -> Result<Self, FilterError> {
        let ObstacleGrid { width, resolution, map_from_grid, occupied } = *grid;
        check_length("max_distance", max_distance)?;
        check_length("resolution", resolution)?;
        if !map_from_grid.is_finite() {
            let what = "the pose of the grid";
            return Err(FilterError::NonFinitePose { what, pose: map_from_grid });
        }
        if width == 0 || occupied.is_empty() || !occupied.len().is_multiple_of(width) {
            return Err(FilterError::GridShape { cells: occupied.len(), width });
        }
        let centre = |index: usize| (index as f64 + 0.5) * resolution;
        let centres: Vec<Point<2>> = (0..occupied.len())
            .filter(|&cell| occupied[cell])
            .map(|cell| map_from_grid.transform_point([centre(cell % width), centre(cell / width)]))
            .collect();
        let bounds = Bounds::of(&centres).ok_or(CoreError::NoPoints)?;
        let cut = max_distance * max_distance;
        let in_cells = squared_distances(width, occupied);
        Ok(CellDistances {
            grid_from_map: map_from_grid.inverse(),
            per_metre: 1.0 / resolution,
            width,
            height: occupied.len() / width,
            squared: in_cells.iter().map(|d| (d * resolution * resolution).min(cut)).collect(),
            bounds,
            max_distance,
        })
    }

    /// Where distances are cut (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// Edge length of a cell (m).
    pub fn resolution(&self) -> f64 {
        1.0 / self.per_metre
    }

    /// The smallest box around the centres of the occupied cells.
    pub fn bounds(&self) -> Bounds<2> {
        self.bounds
    }

    /// A distance (m) so small that from no place within w of a point is it less than this − w: that of the
    /// nearest cell less its diagonal, since a cell has one distance for all places in it.
    pub(super) fn floor(&self, point: Point<2>) -> f64 {
        let [x, y] = self.grid_from_map.transform_point(point).map(|value| value * self.per_metre);
        let cell = |place: f64, cells: usize| (place.max(0.0) as usize).min(cells - 1);
        let cell = cell(y, self.height) * self.width + cell(x, self.width);
        self.squared[cell].sqrt() - SQRT_2 / self.per_metre
    }

    /// min(d², max_distance²) in m², d the distance of the cell that a finite point lies in.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        let [x, y] = self.grid_from_map.transform_point(point).map(|value| value * self.per_metre);
        if x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64 {
            self.squared[y as usize * self.width + x as usize]
        } else {
            self.max_distance * self.max_distance
        }
    }
}

/// Squared distances, in cells, from each cell's centre to that of the nearest occupied cell; infinite
/// when there is none. First along columns, then the lower envelope of a parabola per column along each
/// row: P. Felzenszwalb and D. Huttenlocher, *Distance Transforms of Sampled Functions*, Theory of
/// Computing 8 (2012). Exact: all numbers that are compared are integers, or quotients of integers.
fn squared_distances(width: usize, occupied: &[bool]) -> Vec<f64> {
    let height = occupied.len() / width;
    let mut squared = vec![f64::INFINITY; occupied.len()];
    for column in 0..width {
        // Upwards, then downwards: how many cells ago the last occupied one was.
        let mut since = f64::INFINITY;
        for row in (0..height).chain((0..height).rev()) {
            let cell = row * width + column;
            since = if occupied[cell] { 0.0 } else { since + 1.0 };
            squared[cell] = squared[cell].min(since * since);
        }
    }
    let mut envelope: Vec<Parabola> = Vec::with_capacity(width);
    for row in squared.chunks_mut(width) {
        envelope.clear();
        for (column, &height) in row.iter().enumerate().filter(|(_, height)| height.is_finite()) {
            let mut parabola = Parabola { vertex: column as f64, height, from: f64::NEG_INFINITY };
            while let Some(last) = envelope.last() {
                parabola.from = last.meets(&parabola);
                if parabola.from > last.from {
                    break;
                }
                envelope.pop();
                parabola.from = f64::NEG_INFINITY;
            }
            envelope.push(parabola);
        }
        let mut lowest = 0;
        for (column, value) in row.iter_mut().enumerate() {
            let x = column as f64;
            while envelope.get(lowest + 1).is_some_and(|next| next.from <= x) {
                lowest += 1;
            }
            if let Some(parabola) = envelope.get(lowest) {
                *value = math::square(x - parabola.vertex) + parabola.height;
            }
        }
    }
    squared
}

/// (x − vertex)² + height, the lowest one from `from` on.
struct Parabola {
    vertex: f64,
    height: f64,
    from: f64,
}

impl Parabola {
    /// Where one with a vertex farther right becomes the lower of the two.
    fn meets(&self, right: &Parabola) -> f64 {
        let sum = |parabola: &Parabola| parabola.height + parabola.vertex * parabola.vertex;
        (sum(right) - sum(self)) / (2.0 * (right.vertex - self.vertex))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    proptest! {
        #[test]
        fn the_transform_is_that_of_brute_force(
            width in 1..12usize,
            height in 1..12usize,
            dense in any::<bool>(),
            seed in prop::collection::vec(0..10u8, 144),
        ) {
            let limit = if dense { 4 } else { 1 };
            let occupied: Vec<bool> = seed[..width * height].iter().map(|&n| n < limit).collect();
            let place = |cell: usize| ((cell % width) as f64, (cell / width) as f64);
            for (cell, &found) in squared_distances(width, &occupied).iter().enumerate() {
                let (x, y) = place(cell);
                let distances = (0..occupied.len()).filter(|&other| occupied[other]).map(|other| {
                    (place(other).0 - x).powi(2) + (place(other).1 - y).powi(2)
                });
                prop_assert_eq!(found, distances.fold(f64::INFINITY, f64::min));
            }
        }
    }

    #[test]
    fn places_have_the_distance_of_their_cell() {
        // 3 columns and 2 rows of 0.5 m, turned a quarter to the left about (10, 20): the first cell is
        // x from 9.5 to 10, y from 20 to 20.5. It is occupied.
        let mut occupied = [false; 6];
        occupied[0] = true;
        let map_from_grid = Pose2::new(10.0, 20.0, FRAC_PI_2);
        let grid = ObstacleGrid { width: 3, resolution: 0.5, map_from_grid, occupied: &occupied };
        let distances = CellDistances::build(&grid, 0.8).unwrap();
        for (point, expected) in [
            ([9.99, 20.01], 0.0),
            ([9.51, 20.49], 0.0),
            ([9.75, 20.75], 0.25),
            ([9.25, 20.25], 0.25),
            ([9.25, 20.75], 0.5),
            // √(0.25 + 1) is cut, and so is everything outside.
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
    fn what_is_no_grid_is_refused() {
        let grid = |width, resolution, x, occupied| {
            let map_from_grid = Pose2::new(x, 0.0, 0.0);
            CellDistances::build(&ObstacleGrid { width, resolution, map_from_grid, occupied }, 2.0)
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
