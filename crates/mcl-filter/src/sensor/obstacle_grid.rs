use mcl_core::{Point, PointMap, Pose2, Rng};
use rand::RngExt;

use super::transform::squared_distances;
use crate::FilterError;
use crate::check::check_length;

/// Distance from free cells, centre to centre, within which beams end on an obstacle (m), and its minimum in cells: the
/// scatter of measurements around walls.
const DEPTH: f64 = 0.12;
const DEPTH_CELLS: f64 = 2.0;
/// Tolerance of the comparison, in squared cells.
const ROUNDING: f64 = 1e-9;

/// An occupancy grid as input of the filter.
///
/// Beams end on the surfaces of obstacles. Of the occupied cells, the likelihood field therefore uses only those within
/// 0.12 m or two cells of a free cell, not the inside of thick walls, into which an estimate could drift without a
/// lower likelihood. The outermost cells alone would not be enough if a wall is as thick as the scatter of its
/// measurements: they are then the readings that were too short. In a grid without free cells near occupied ones, all
/// occupied cells are used.
#[derive(Debug, Clone, PartialEq)]
pub struct ObstacleGrid {
    /// Number of columns.
    pub width: usize,
    /// Edge length of a cell (m).
    pub resolution: f64,
    /// Pose of the lower left corner; the column index increases along x and the row index along y.
    pub map_from_grid: Pose2,
    /// Whether each cell is occupied, row by row from the bottom, each from left to right.
    pub occupied: Vec<bool>,
    /// Whether each cell is free; empty if the free space is unknown.
    pub free: Vec<bool>,
}

impl ObstacleGrid {
    /// Checks that the grid is valid.
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a resolution out of range, [`FilterError::NonFinitePose`] for a pose that is not
    /// finite, [`FilterError::GridShape`] if the number of cells is not a multiple of the width, or the lists of free
    /// and occupied cells differ in length.
    pub(super) fn check(&self) -> Result<(), FilterError> {
        let ObstacleGrid { width, resolution, map_from_grid, occupied, free } = self;
        check_length("resolution", *resolution)?;
        if !map_from_grid.is_finite() {
            let what = "the pose of the grid";
            return Err(FilterError::NonFinitePose { what, pose: *map_from_grid });
        }
        if *width == 0 || occupied.is_empty() || !occupied.len().is_multiple_of(*width) {
            return Err(FilterError::GridShape { cells: occupied.len(), width: *width });
        }
        if !free.is_empty() && free.len() != occupied.len() {
            return Err(FilterError::GridShape { cells: free.len(), width: *width });
        }
        Ok(())
    }

    /// Whether beams end on each cell.
    pub(super) fn surface(&self) -> Vec<bool> {
        let depth = DEPTH_CELLS.max(DEPTH / self.resolution);
        let from_free = match self.free.is_empty() {
            true => Vec::new(),
            false => squared_distances(self.width, &self.free),
        };
        let is_near = |squared: &f64| *squared <= depth * depth + ROUNDING;
        let cells = self.occupied.iter().zip(&from_free);
        let seen: Vec<bool> =
            cells.map(|(&is_occupied, squared)| is_occupied && is_near(squared)).collect();
        if seen.contains(&true) { seen } else { self.occupied.clone() }
    }

    /// The centres of the selected cells in the map frame (m).
    pub(super) fn centres(&self, cells: &[bool]) -> Vec<Point<2>> {
        let centre = |index: usize| (index as f64 + 0.5) * self.resolution;
        let chosen = (0..cells.len()).filter(|&cell| cells[cell]);
        chosen
            .map(|cell| {
                let place = [centre(cell % self.width), centre(cell / self.width)];
                self.map_from_grid.transform_point(place)
            })
            .collect()
    }

    /// Converts the cells on which beams end to a point map of their centres.
    ///
    /// # Errors
    /// [`FilterError::Setting`], [`FilterError::NonFinitePose`] and [`FilterError::GridShape`] for an invalid grid,
    /// [`FilterError::Map`] if no cell is occupied.
    pub fn surface_points(&self) -> Result<PointMap<2>, FilterError> {
        self.check()?;
        Ok(PointMap::new(self.centres(&self.surface()))?)
    }
}

/// The free cells of a grid, in which the robot may be.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    map_from_grid: Pose2,
    grid_from_map: Pose2,
    resolution: f64,
    width: usize,
    /// Indices of the free cells, increasing; at least one.
    cells: Vec<u32>,
}

impl FreeSpace {
    /// The free space of a grid; `None` if it has no free cell.
    ///
    /// # Errors
    /// [`FilterError::Setting`], [`FilterError::NonFinitePose`] and [`FilterError::GridShape`] for an invalid grid.
    pub fn of(grid: &ObstacleGrid) -> Result<Option<Self>, FilterError> {
        grid.check()?;
        let ObstacleGrid { width, resolution, map_from_grid, .. } = *grid;
        let Ok(number) = u32::try_from(grid.free.len()) else {
            return Err(FilterError::GridShape { cells: grid.free.len(), width });
        };
        let cells: Vec<u32> = (0..number).filter(|&cell| grid.free[cell as usize]).collect();
        let grid_from_map = map_from_grid.inverse();
        let free = FreeSpace { map_from_grid, grid_from_map, resolution, width, cells };
        Ok((!free.cells.is_empty()).then_some(free))
    }

    /// Draws a position (m) uniformly from the free cells.
    pub fn draw(&self, rng: &mut Rng) -> Point<2> {
        let cell = self.cells[rng.random_range(0..self.cells.len())];
        self.place(cell, [rng.random(), rng.random()])
    }

    /// Whether a point (m) lies in a free cell.
    pub fn holds(&self, point: Point<2>) -> bool {
        let [x, y] =
            self.grid_from_map.transform_point(point).map(|metres| metres / self.resolution);
        let is_cell = x >= 0.0 && y >= 0.0 && x < self.width as f64;
        // Indices beyond the last row are not in the list.
        let cell = (y as u64).saturating_mul(self.width as u64).saturating_add(x as u64);
        is_cell && u32::try_from(cell).is_ok_and(|cell| self.cells.binary_search(&cell).is_ok())
    }

    /// The centres of the cells (m).
    pub fn centres(&self) -> impl Iterator<Item = Point<2>> + '_ {
        self.cells.iter().map(|&cell| self.place(cell, [0.5; 2]))
    }

    /// A position in a cell, given as fractions of its edges.
    fn place(&self, cell: u32, [right, up]: [f64; 2]) -> Point<2> {
        let (column, row) = (cell as usize % self.width, cell as usize / self.width);
        let place = [column as f64 + right, row as f64 + up].map(|cells| cells * self.resolution);
        self.map_from_grid.transform_point(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{CoreError, Seed};
    use std::f64::consts::FRAC_PI_2;

    /// `#` occupied, `.` free, blank unknown; the top row first.
    fn drawn(rows: &[&str], map_from_grid: Pose2) -> ObstacleGrid {
        let cells = |kind: char| -> Vec<bool> {
            rows.iter().rev().flat_map(|row| row.chars().map(move |cell| cell == kind)).collect()
        };
        ObstacleGrid {
            width: rows[0].len(),
            resolution: 0.5,
            map_from_grid,
            occupied: cells('#'),
            free: cells('.'),
        }
    }

    #[test]
    fn only_the_surface_of_a_thick_wall_is_seen() {
        // Cells of 0.5 m: two cells, also around a corner.
        let wall = drawn(&["#####..", "#####..", "#####  ", "####   "], Pose2::IDENTITY);
        let seen = drawn(&["   ##  ", "   ##  ", "    #  ", "       "], Pose2::IDENTITY);
        assert_eq!(wall.surface(), seen.occupied);
        let points = wall.surface_points().unwrap();
        assert_eq!(points.points()[0], [2.25, 0.75]);
        // Cells of 2 cm: 0.12 m is six cells.
        let fine = drawn(&["########."], Pose2::IDENTITY);
        let fine = ObstacleGrid { resolution: 0.02, ..fine };
        assert_eq!(fine.surface(), [false, false, true, true, true, true, true, true, false]);
    }

    #[test]
    fn without_free_cells_all_occupied_ones_count() {
        let wall = drawn(&["### ", "### "], Pose2::IDENTITY);
        assert_eq!(wall.surface(), wall.occupied);
        let unknown = ObstacleGrid { free: Vec::new(), ..wall };
        assert_eq!(unknown.surface(), unknown.occupied);
        assert_eq!(FreeSpace::of(&unknown), Ok(None));
        let nothing = ObstacleGrid { occupied: vec![false; 8], ..unknown };
        assert!(matches!(nothing.surface_points(), Err(FilterError::Map(CoreError::NoPoints))));
    }

    /// Rotated by 90° to the left about (10, 20): the free cells are x from 9 to 9.5 and from 8.5 to 9, y from 20
    /// to 20.5 and from 20.5 to 21.
    #[test]
    fn places_are_drawn_in_free_cells() {
        let grid = drawn(&[" .", ". ", "##"], Pose2::new(10.0, 20.0, FRAC_PI_2));
        let free = FreeSpace::of(&grid).unwrap().unwrap();
        let mut rng = Seed::new(1).rng();
        let mut numbers = [0; 2];
        for _ in 0..2_000 {
            let [x, y] = free.draw(&mut rng);
            assert!(free.holds([x, y]));
            let first = (9.0..9.5).contains(&x) && (20.0..20.5).contains(&y);
            let second = (8.5..9.0).contains(&x) && (20.5..21.0).contains(&y);
            assert!(first || second, "{x}, {y}");
            numbers[usize::from(second)] += 1;
        }
        // 4.5 standard deviations of a fair coin.
        assert!((numbers[0] - 1_000_i32).abs() < 101, "{numbers:?}");
        for outside in [[9.25, 20.75], [9.75, 20.25], [1e300, 0.0], [9.25, -1e300], [8.25, 20.75]] {
            assert!(!free.holds(outside), "{outside:?}");
        }
        assert_eq!(free.centres().count(), 2);
    }

    #[test]
    fn a_grid_of_other_free_cells_is_refused() {
        let mut grid = drawn(&["#.", "#."], Pose2::IDENTITY);
        grid.free.pop();
        let error = FilterError::GridShape { cells: 3, width: 2 };
        assert_eq!(grid.surface_points().err(), Some(error.clone()));
        assert_eq!(FreeSpace::of(&grid), Err(error));
    }
}
