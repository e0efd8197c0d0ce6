use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use crate::memory::check_room;
use crate::{CoreError, OutOfMemory, Point, check_finite};

/// Distances within this of the smallest (m) count as ties, and the point with the lowest index wins.
/// Without it, rounding in the last bit would decide between the two points of a grid cell.
pub const TIE_DISTANCE: f64 = 1e-9;

/// Memory that the library uses per 2-D point while it builds its tree, as measured.
const BYTES_PER_POINT: usize = 64;

/// The result of a nearest-neighbour query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Index of the point in the slice the index was built from.
    pub index: usize,
    /// Squared Euclidean distance to the query in m².
    pub distance_squared: f64,
}

/// Exact nearest-neighbour search over a fixed set of points. Wraps the crate kiddo.
///
/// kiddo accepts NaN silently and gives wrong results on an empty tree, so both are refused here.
/// Equal and collinear points are allowed.
pub struct NearestNeighbors<const D: usize> {
    tree: ImmutableKdTree<f64, D>,
}

impl<const D: usize> NearestNeighbors<D> {
    /// Builds the index; queries return indices into this slice.
    ///
    /// # Errors
    /// [`CoreError::NoPoints`] for an empty slice, [`CoreError::NonFinite`] or [`CoreError::TooLarge`] for unusable
    /// coordinates, [`CoreError::Index`] if the library fails, [`CoreError::Memory`].
    pub fn new(points: &[Point<D>]) -> Result<Self, CoreError> {
        if points.is_empty() {
            return Err(CoreError::NoPoints);
        }
        check_finite(points)?;
        Self::check_room(points.len())?;
        let tree = ImmutableKdTree::new_from_slice(points)
            .map_err(|e| CoreError::Index { points: points.len(), reason: format!("{e:?}") })?;
        Ok(NearestNeighbors { tree })
    }

    /// Checks that there is enough memory to index this many points.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn check_room(points: usize) -> Result<(), OutOfMemory> {
        check_room(points, BYTES_PER_POINT * D / 2, "points in an index of neighbours")
    }

    /// Returns the point nearest to a finite query; ties are broken arbitrarily.
    #[inline]
    pub fn nearest(&self, query: &Point<D>) -> Neighbor {
        let found = self.tree.query(query).nearest_one::<SquaredEuclidean<f64>>().execute();
        Neighbor { index: found.item as usize, distance_squared: found.distance }
    }

    /// Squared distance (m²) from an indexed point to its nearest other point: 0 for duplicates, infinite if there is
    /// no other point.
    pub fn nearest_other(&self, point: &Point<D>) -> f64 {
        const TWO: NonZero<usize> = NonZero::new(2).unwrap();
        let found = self.tree.query(point).nearest_n::<SquaredEuclidean<f64>>(TWO).execute();
        found.get(1).map_or(f64::INFINITY, |neighbor| neighbor.distance)
    }

    /// Returns the point nearest to a finite query; of all points within [`TIE_DISTANCE`] of the smallest distance,
    /// the one with the lowest index.
    pub fn nearest_earliest(&self, query: &Point<D>) -> Neighbor {
        let nearest = self.nearest(query);
        let radius = nearest.distance_squared.sqrt() + TIE_DISTANCE;
        let mut earliest = nearest;
        self.for_each_within(query, radius, |neighbor| {
            if neighbor.index < earliest.index {
                earliest = neighbor;
            }
        });
        earliest
    }

    /// Calls `visit` for every point within `radius` (m, inclusive) of a finite query, in unspecified order.
    pub fn for_each_within(&self, query: &Point<D>, radius: f64, mut visit: impl FnMut(Neighbor)) {
        let found = self
            .tree
            .query(query)
            .within::<SquaredEuclidean<f64>>(radius * radius)
            .unsorted()
            .execute();
        for item in found {
            visit(Neighbor { index: item.item as usize, distance_squared: item.distance });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute_force(points: &[Point<2>], query: &Point<2>) -> Vec<f64> {
        points.iter().map(|p| (p[0] - query[0]).powi(2) + (p[1] - query[1]).powi(2)).collect()
    }

    proptest! {
        /// Coarse coordinates, so that duplicates, collinear points and ties are common.
        #[test]
        fn agrees_with_brute_force(
            points in prop::collection::vec((-20..20i32, -20..20i32), 1..300),
            query in (-25.0..25.0f64, -25.0..25.0f64),
            on_grid in any::<bool>(),
            radius in 0.0..10.0f64,
        ) {
            let points: Vec<Point<2>> =
                points.iter().map(|&(x, y)| [f64::from(x) / 4.0, f64::from(y) / 4.0]).collect();
            let query = if on_grid { [query.0.round(), query.1.round()] } else { [query.0, query.1] };
            let index = NearestNeighbors::new(&points).unwrap();
            let distances = brute_force(&points, &query);
            let smallest = distances.iter().copied().fold(f64::INFINITY, f64::min);
            prop_assert_eq!(index.nearest(&query).distance_squared, smallest);
            let limit = (smallest.sqrt() + TIE_DISTANCE).powi(2);
            let earliest = distances.iter().position(|&d| d <= limit).unwrap();
            prop_assert_eq!(index.nearest_earliest(&query).index, earliest);
            let mut within = Vec::new();
            index.for_each_within(&query, radius, |n| within.push(n.index));
            within.sort_unstable();
            let expected: Vec<usize> =
                (0..points.len()).filter(|&i| distances[i] <= radius * radius).collect();
            prop_assert_eq!(within, expected);
        }
    }

    #[test]
    fn thousands_of_equal_points_are_handled() {
        let points = vec![[1.0, 2.0]; 5000];
        let index = NearestNeighbors::new(&points).unwrap();
        let found = index.nearest_earliest(&[1.0, 2.5]);
        assert_eq!((found.index, found.distance_squared), (0, 0.25));
    }

    #[test]
    fn bad_input_is_refused_with_its_index() {
        assert!(matches!(NearestNeighbors::<2>::new(&[]), Err(CoreError::NoPoints)));
        let points = [[0.0, 0.0], [1.0, f64::NAN]];
        let Err(error) = NearestNeighbors::new(&points) else { panic!("NaN was accepted") };
        assert!(matches!(error, CoreError::NonFinite { index: 1, axis: 1, .. }));
    }
}
