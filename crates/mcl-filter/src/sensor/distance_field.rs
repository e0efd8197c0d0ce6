use mcl_core::{Bounds, NdtMap, NearestNeighbors, Point, PointMap, SegmentMap};

use super::fetch::{Fetch, PADDING, Task, dispatch};
use super::grid::{Candidates, Grid};
use super::grid_builder;
use super::lookup::{CHUNK, Lookup, Workspace};
use super::obstacle_grid::{FreeSpace, ObstacleGrid};
use super::{CellDistances, NdtDistances, NdtReading, SegmentDistances};
use crate::FilterError;
use crate::check::check_length;

/// Distances from any point to a map, truncated at a maximum distance. Sensor models access maps only through this
/// type. Build one per map and share it.
pub enum MapDistances {
    /// Exact distances to the nearest point of a point map: the fast path.
    Grid(DistanceField),
    /// Exact distances to the nearest point of a point map: the reference path.
    Reference(ExactDistances),
    /// Distances of an occupancy grid, one per cell.
    Cells(CellDistances),
    /// Mahalanobis distances of an NDT map.
    Ndt(NdtDistances),
    /// Exact distances to the nearest segment of a map of line segments.
    Segments(SegmentDistances),
}

impl MapDistances {
    /// Indexes a point map for the fast path, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`DistanceField::build`].
    pub fn grid(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        DistanceField::build(map, max_distance).map(MapDistances::Grid)
    }

    /// Indexes a point map for the reference path, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`ExactDistances::build`].
    pub fn reference(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        ExactDistances::build(map, max_distance).map(MapDistances::Reference)
    }

    /// Computes the likelihood field of an occupancy grid, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`CellDistances::build`].
    pub fn cells(grid: &ObstacleGrid, max_distance: f64) -> Result<Self, FilterError> {
        CellDistances::build(grid, max_distance).map(MapDistances::Cells)
    }

    /// Prepares the distances of an NDT map, truncated at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`NdtDistances::build`].
    pub fn ndt(map: &NdtMap, reading: NdtReading, max_distance: f64) -> Result<Self, FilterError> {
        NdtDistances::build(map, reading, max_distance).map(MapDistances::Ndt)
    }

    /// Indexes a map of line segments, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`SegmentDistances::build`].
    pub fn segments(map: &SegmentMap, max_distance: f64) -> Result<Self, FilterError> {
        SegmentDistances::build(map, max_distance).map(MapDistances::Segments)
    }

    /// Adds free space to a point map. Occupancy grids have their own; maps of segments and Gaussians stay without.
    pub fn with_free_space(mut self, free: Option<FreeSpace>) -> Self {
        match &mut self {
            MapDistances::Grid(field) => field.exact.free = free,
            MapDistances::Reference(exact) => exact.free = free,
            MapDistances::Cells(_) | MapDistances::Ndt(_) | MapDistances::Segments(_) => {}
        }
        self
    }

    /// The free space of the map, if known.
    pub fn free_space(&self) -> Option<&FreeSpace> {
        match self {
            MapDistances::Grid(field) => field.exact.free.as_ref(),
            MapDistances::Reference(exact) => exact.free.as_ref(),
            MapDistances::Cells(cells) => cells.free.as_ref(),
            MapDistances::Ndt(_) | MapDistances::Segments(_) => None,
        }
    }

    /// Distance at which distances are truncated (m).
    pub fn max_distance(&self) -> f64 {
        match self {
            MapDistances::Grid(field) => field.exact.max_distance,
            MapDistances::Reference(exact) => exact.max_distance,
            MapDistances::Cells(cells) => cells.max_distance(),
            MapDistances::Ndt(ndt) => ndt.max_distance(),
            MapDistances::Segments(segments) => segments.max_distance(),
        }
    }

    /// Bounding box of the points or segments of the map, of the centres of its occupied cells, or of the means of its
    /// Gaussians.
    pub fn bounds(&self) -> Bounds<2> {
        match self {
            MapDistances::Grid(field) => field.exact.bounds,
            MapDistances::Reference(exact) => exact.bounds,
            MapDistances::Cells(cells) => cells.bounds(),
            MapDistances::Ndt(ndt) => ndt.bounds(),
            MapDistances::Segments(segments) => segments.bounds(),
        }
    }

    /// Spacing of the map elements (m): for points the mean distance to the nearest other point, for an occupancy grid
    /// the edge length of a cell; 0 for segments and Gaussians, which represent whole walls.
    pub fn spacing(&self) -> f64 {
        match self {
            MapDistances::Grid(field) => field.exact.spacing,
            MapDistances::Reference(exact) => exact.spacing,
            MapDistances::Cells(cells) => cells.resolution(),
            MapDistances::Ndt(_) | MapDistances::Segments(_) => 0.0,
        }
    }

    /// Replaces `distances` by the truncated distance of each point from the map (m), and `floors` by a lower bound:
    /// from no position within w of a point is the distance less than the point's floor − w. Distances are
    /// continuous except those of cells and Gaussians; for the latter the only known bound is 0.
    pub(crate) fn with_floors(
        &self,
        points: &[Point<2>],
        distances: &mut Vec<f64>,
        floors: &mut Vec<f64>,
    ) {
        self.all_squared(points, distances);
        distances.iter_mut().for_each(|distance| *distance = distance.sqrt());
        floors.clear();
        match self {
            MapDistances::Cells(cells) => floors.extend(points.iter().map(|&p| cells.floor(p))),
            MapDistances::Ndt(_) => floors.resize(points.len(), 0.0),
            // The distances at both positions may be off by the largest error.
            _ => floors.extend(distances.iter().map(|distance| distance - 2.0 * LARGEST_ERROR)),
        }
    }

    /// [`MapDistances::distances_squared`] by the fastest method: for points, with an error in d of at most 10⁻⁵ m.
    pub(crate) fn all_squared(&self, points: &[Point<2>], squared: &mut Vec<f64>) {
        match self {
            MapDistances::Grid(field) => field.distances_squared(points, squared),
            other => other.distances_squared(points, squared),
        }
    }

    /// Replaces `squared` by the truncated squared distance of each point from the map (m²).
    pub(crate) fn distances_squared(&self, points: &[Point<2>], squared: &mut Vec<f64>) {
        squared.clear();
        let points = points.iter().copied();
        // Dispatches on the kind of map once, not per point.
        match self {
            MapDistances::Grid(field) => squared.extend(points.map(|p| field.distance_squared(p))),
            MapDistances::Reference(exact) => {
                squared.extend(points.map(|p| exact.distance_squared(p)));
            }
            MapDistances::Cells(cells) => squared.extend(points.map(|p| cells.distance_squared(p))),
            MapDistances::Ndt(ndt) => squared.extend(points.map(|p| ndt.distance_squared(p))),
            MapDistances::Segments(segments) => {
                squared.extend(points.map(|p| segments.distance_squared(p)));
            }
        }
    }
}

/// Number of points of a map used to compute its spacing.
const SPACED_POINTS: usize = 2000;

/// Exact distances from a nearest-neighbour tree.
pub struct ExactDistances {
    tree: NearestNeighbors<2>,
    bounds: Bounds<2>,
    spacing: f64,
    free: Option<FreeSpace>,
    max_distance: f64,
    max_distance_squared: f64,
}

impl ExactDistances {
    /// Indexes a map, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` out of range, [`FilterError::Map`] if the
    /// points cannot be indexed.
    pub fn build(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        check_length("max_distance", max_distance)?;
        let tree = NearestNeighbors::new(map.points())?;
        Ok(ExactDistances {
            spacing: spacing(map.points(), &tree),
            tree,
            bounds: map.bounds(),
            free: None,
            max_distance,
            max_distance_squared: max_distance * max_distance,
        })
    }

    /// Distance at which distances are truncated (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// min(d², max_distance²) in m², with d the distance from a finite point to the nearest map point.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        self.tree.nearest(&point).distance_squared.min(self.max_distance_squared)
    }
}

/// Mean distance from a point to the nearest other one (m), over an evenly spaced subset of long lists; 0 for a
/// single point.
fn spacing(points: &[Point<2>], tree: &NearestNeighbors<2>) -> f64 {
    let every = points.len().div_ceil(SPACED_POINTS);
    let distances = points.iter().step_by(every).map(|point| tree.nearest_other(point).sqrt());
    let count = points.len().div_ceil(every);
    let mean = distances.sum::<f64>() / count as f64;
    if mean.is_finite() { mean } else { 0.0 }
}

/// Exact distances from a grid in which each cell lists the few map points that can be the nearest
/// to some point in the cell: the Voronoi diagram of the map, clipped to cells and truncated at the maximum
/// distance. Where points are dense, cells are subdivided, so that a query examines one to
/// three points whatever the size of the map.
///
/// Distances are not rounded to cells: [`distance_squared`](Self::distance_squared) is the minimum of the
/// same squared differences, in `f64`, as in a search through all points, and
/// [`distances_squared`](Self::distances_squared), which the filter uses, is within 10⁻⁵ m of it.
/// Memory is bounded for any map: there are at most about eight million parts of cells, spread over the
/// whole map, so that those of maps with millions of points list a few more points each. The few parts that would
/// list too many (an outlier far away makes cells huge; at the centre of a circle all its points are equally
/// near) use the tree of [`ExactDistances`].
pub struct DistanceField {
    /// Boxed, because it is much larger than the other kinds of distances.
    pub(super) grid: Box<Grid>,
    pub(super) exact: ExactDistances,
}

impl DistanceField {
    /// Indexes a map, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` out of range, [`FilterError::Map`] if the
    /// points cannot be indexed, [`FilterError::Memory`].
    pub fn build(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        let exact = ExactDistances::build(map, max_distance)?;
        Ok(DistanceField { grid: Box::new(grid_builder::build(map, max_distance)?), exact })
    }

    /// min(d², max_distance²) in m², with d the distance from a finite point to the nearest map point.
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        match self.grid.candidates_at(point) {
            Candidates::Few(numbers) => {
                let mut smallest = self.exact.max_distance_squared;
                for &number in numbers {
                    let candidate = self.grid.points[number as usize];
                    let (dx, dy) = (candidate[0] - point[0], candidate[1] - point[1]);
                    smallest = smallest.min(dx * dx + dy * dy);
                }
                smallest
            }
            Candidates::Crowded => self.exact.distance_squared(point),
        }
    }

    /// Replaces `squared` by [`distance_squared`](Self::distance_squared) of each point (m²), many
    /// times faster and with an error in d of at most 10⁻⁵ m, because positions within a cell are `f32`.
    ///
    /// If `f32` is not accurate enough, which is the case if the cell size and the maximum distance together exceed
    /// about 30 m, it uses the slower path.
    pub fn distances_squared(&self, points: &[Point<2>], squared: &mut Vec<f64>) {
        squared.clear();
        if !self.is_single_precise() {
            squared.extend(points.iter().map(|&point| self.distance_squared(point)));
            return;
        }
        squared.resize(points.len(), 0.0);
        dispatch(Batch { lookup: Lookup::new(self), field: self, points, squared });
    }

    /// Whether distances from positions in `f32` are accurate to 10⁻⁵ m.
    pub(super) fn is_single_precise(&self) -> bool {
        self.single_precision_error() <= LARGEST_ERROR
    }

    /// Whether they are still accurate if the positions are also rotated and shifted in `f32`, from the centre of a
    /// cell and by up to `reach` (m).
    ///
    /// Sine, cosine and the coordinates to rotate are rounded, and so are two products, their sum and
    /// the sum with the position in the cell. With |s·x| + |c·y| ≤ r, likewise for the other axis, and up to
    /// √2·r for both together, the error is less than (3·√2 + 2)·ε·(r + s) < 6.5·ε·(r + s).
    pub(super) fn is_near(&self, reach: f64) -> bool {
        let error = 6.5 * EPSILON * (reach + self.grid.cell);
        self.single_precision_error() + error <= LARGEST_ERROR
            && reach <= MOST_CELLS * self.grid.cell
    }

    /// A bound on the error (m) of distances from positions in `f32`.
    ///
    /// With ε = 2⁻²⁴, a position in a cell is off by at most ε/4 cells per axis. A relevant candidate lies within the
    /// maximum distance c plus a cell s of the centre and is off by at most ε·(c + s). Their
    /// difference is rounded by the same amount again, and the squares and their sum add 1.5·ε·c. The total is
    /// less than (2·√2 + 1.5)·ε·(c + s) + 0.4·ε·s < 5·ε·(c + s).
    fn single_precision_error(&self) -> f64 {
        5.0 * EPSILON * (self.exact.max_distance + self.grid.cell)
    }
}

/// 2⁻²⁴, the largest relative error of rounding to `f32`.
const EPSILON: f64 = 1.0 / 16_777_216.0;
/// The largest error of a distance (m).
const LARGEST_ERROR: f64 = 1e-5;
/// Largest number of cells that `f32` counts exactly on the way to a position.
const MOST_CELLS: f64 = 1_048_576.0;

/// The fast path of [`DistanceField::distances_squared`].
struct Batch<'a> {
    lookup: Lookup<'a>,
    field: &'a DistanceField,
    points: &'a [Point<2>],
    squared: &'a mut [f64],
}

impl Task for Batch<'_> {
    #[inline(always)]
    fn run<F: Fetch>(self, fetch: F) {
        let grid = &self.field.grid;
        let square_metres = grid.cell * grid.cell;
        let mut workspace = Workspace::default();
        let mut places = [[0.0; CHUNK]; 2];
        for (points, squared) in self.points.chunks(CHUNK).zip(self.squared.chunks_mut(CHUNK)) {
            for (axis, places) in places.iter_mut().enumerate() {
                for (place, point) in places.iter_mut().zip(points) {
                    *place = grid.in_cells(axis, point[axis]);
                }
            }
            let [x, y] = &places;
            let number = points.len().next_multiple_of(PADDING);
            let (x, y) = (&x[..number], &y[..number]);
            workspace.place(number, |i| self.lookup.locate(x[i], y[i]));
            let found = self.lookup.squared_distances(fetch, number, &mut workspace);
            for (squared, &found) in squared.iter_mut().zip(found) {
                *squared = f64::from(found) * square_metres;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fetch::{dispatch_on, instruction_sets};
    use super::*;
    use mcl_core::Seed;
    use rand::RngExt;

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let mut rng = Seed::new(1).rng();
        let mut places = |number: usize| -> Vec<Point<2>> {
            (0..number).map(|_| [20.0 * rng.random::<f64>(), 10.0 * rng.random::<f64>()]).collect()
        };
        let map = PointMap::new(places(3_000)).unwrap();
        let field = DistanceField::build(&map, 1.0).unwrap();
        let points = places(10_001);
        let mut dispatched = Vec::new();
        field.distances_squared(&points, &mut dispatched);
        assert!(dispatched.iter().any(|&squared| squared < 1.0));
        for set in instruction_sets() {
            let lookup = Lookup::new(&field);
            let mut found = vec![0.0; points.len()];
            let squared = &mut found;
            dispatch_on(set, Batch { lookup, field: &field, points: &points, squared });
            assert!(found == dispatched, "{set:?}");
        }
    }
}
