use crate::{Bounds, CoreError, Point};

/// Largest magnitude of a coordinate (m). Far beyond any survey grid on Earth, and small enough that squared
/// distances neither overflow nor reach the sentinel values of the nearest-neighbour library.
pub const MAX_COORDINATE: f64 = 1e12;

/// Checks that every coordinate is finite and at most [`MAX_COORDINATE`].
///
/// # Errors
/// [`CoreError::NonFinite`] or [`CoreError::TooLarge`] with the index of the first invalid point.
pub fn check_finite<const D: usize>(points: &[Point<D>]) -> Result<(), CoreError> {
    for (index, point) in points.iter().enumerate() {
        for (axis, &value) in point.iter().enumerate() {
            if !value.is_finite() {
                return Err(CoreError::NonFinite { index, axis, value });
            }
            if value.abs() > MAX_COORDINATE {
                return Err(CoreError::TooLarge { index, axis, value, limit: MAX_COORDINATE });
            }
        }
    }
    Ok(())
}

/// A sample-based map: one or more finite points in metres. Duplicates are allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMap<const D: usize> {
    points: Vec<Point<D>>,
}

impl<const D: usize> PointMap<D> {
    /// Creates a map of the given points, in the given order.
    ///
    /// # Errors
    /// [`CoreError::NoPoints`] for an empty list, [`CoreError::NonFinite`] or [`CoreError::TooLarge`] for unusable
    /// coordinates.
    pub fn new(points: Vec<Point<D>>) -> Result<Self, CoreError> {
        if points.is_empty() {
            return Err(CoreError::NoPoints);
        }
        check_finite(&points)?;
        Ok(PointMap { points })
    }

    /// The points, in order.
    pub fn points(&self) -> &[Point<D>] {
        &self.points
    }

    /// Number of points, at least 1.
    #[allow(clippy::len_without_is_empty)] // A map is never empty.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Bounding box of the points.
    pub fn bounds(&self) -> Bounds<D> {
        Bounds::of(&self.points).expect("a map has at least one point")
    }

    /// Converts the map into its points.
    pub fn into_points(self) -> Vec<Point<D>> {
        self.points
    }
}
