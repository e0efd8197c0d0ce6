use mcl_core::{Bounds, NearestNeighbors, Point, PointMap};

use super::grid::{Cell, Grid};
use crate::FilterError;
use crate::settings::check_length;

/// Distances from any place to the nearest point of a map, cut at a largest distance: what every
/// sensor model here knows of a map. Both kinds are exact; build one per map and share it.
pub enum MapDistances {
    /// The fast path.
    Grid(DistanceField),
    /// The reference path.
    Reference(ExactDistances),
}

impl MapDistances {
    /// Indexes a map for the fast path, with distances cut at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`DistanceField::build`].
    pub fn grid(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        DistanceField::build(map, max_distance).map(MapDistances::Grid)
    }

    /// Indexes a map for the reference path, with distances cut at `max_distance` (m).
    ///
    /// # Errors
    /// Those of [`ExactDistances::build`].
    pub fn reference(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        ExactDistances::build(map, max_distance).map(MapDistances::Reference)
    }

    /// Where distances are cut (m).
    pub fn max_distance(&self) -> f64 {
        self.exact().max_distance
    }

    /// The smallest box around the map's points.
    pub fn bounds(&self) -> Bounds<2> {
        self.exact().bounds
    }

    fn exact(&self) -> &ExactDistances {
        match self {
            MapDistances::Grid(field) => &field.exact,
            MapDistances::Reference(exact) => exact,
        }
    }
}

/// Exact distances from a nearest-neighbour tree.
pub struct ExactDistances {
    tree: NearestNeighbors<2>,
    bounds: Bounds<2>,
    max_distance: f64,
    max_distance_squared: f64,
}

impl ExactDistances {
    /// Indexes a map, with distances cut at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` that is no length, [`FilterError::Map`] when the
    /// points cannot be indexed.
    pub fn build(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        check_length("max_distance", max_distance)?;
        Ok(ExactDistances {
            tree: NearestNeighbors::new(map.points())?,
            bounds: map.bounds(),
            max_distance,
            max_distance_squared: max_distance * max_distance,
        })
    }

    /// min(d², max_distance²) in m², d the distance from a finite point to the nearest map point.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        self.tree.nearest(&point).distance_squared.min(self.max_distance_squared)
    }
}

/// Exact distances from a uniform grid in which each cell lists the few map points that can be the
/// nearest to some place in the cell: the Voronoi diagram of the map, clipped to cells and cut at
/// the largest distance. A query is one cell and on most maps one to three points, whatever the
/// size of the map.
///
/// Nothing is rounded: the answer is the minimum of the same squared differences, in `f64`, that a
/// search through all points would take. Memory is bounded for any map: there are at most about
/// three million cells, and the few that would list too many points (an outlier far away makes cells
/// huge; at the centre of a circle all its points are equally near) are answered by the tree of
/// [`ExactDistances`].
pub struct DistanceField {
    grid: Grid,
    exact: ExactDistances,
}

impl DistanceField {
    /// Indexes a map, with distances cut at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` that is no length, [`FilterError::Map`] when the
    /// points cannot be indexed.
    pub fn build(map: &PointMap<2>, max_distance: f64) -> Result<Self, FilterError> {
        let exact = ExactDistances::build(map, max_distance)?;
        Ok(DistanceField { grid: Grid::build(map, max_distance), exact })
    }

    /// min(d², max_distance²) in m², d the distance from a finite point to the nearest map point.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        match self.grid.cell_at(point) {
            Cell::Listed(candidates) => {
                let mut smallest = self.exact.max_distance_squared;
                for candidate in candidates {
                    let (dx, dy) = (candidate[0] - point[0], candidate[1] - point[1]);
                    smallest = smallest.min(dx * dx + dy * dy);
                }
                smallest
            }
            Cell::Crowded => self.exact.distance_squared(point),
        }
    }
}
