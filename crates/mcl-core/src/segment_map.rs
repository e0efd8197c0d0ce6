use crate::math;
use crate::{CoreError, Point, check_finite};

/// A line segment between two points, such as a straight piece of wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineSegment {
    /// One end, in metres.
    pub start: Point<2>,
    /// The other end, in metres; it may equal `start`.
    pub end: Point<2>,
}

impl LineSegment {
    /// Distance between the ends in metres.
    pub fn length(&self) -> f64 {
        math::hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])
    }

    /// Squared distance (m²) from a point to the nearest point of the segment. The coordinates of `place` are at most
    /// [`MAX_COORDINATE`](crate::MAX_COORDINATE).
    #[inline]
    pub fn distance_squared(&self, place: &Point<2>) -> f64 {
        let [along_x, along_y] = [0, 1].map(|axis| self.end[axis] - self.start[axis]);
        let [x, y] = [0, 1].map(|axis| place[axis] - self.start[axis]);
        let length_squared = along_x * along_x + along_y * along_y;
        // Position of the foot of the perpendicular along the segment: 0 at the start, 1 at the end.
        let foot = if length_squared > 0.0 {
            ((along_x * x + along_y * y) / length_squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let (dx, dy) = (x - foot * along_x, y - foot * along_y);
        dx * dx + dy * dy
    }
}

/// A map of one or more line segments.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentMap {
    segments: Vec<LineSegment>,
}

impl SegmentMap {
    /// Creates a map of these segments, in the given order.
    ///
    /// # Errors
    /// [`CoreError::NoPoints`] without segments, [`CoreError::NonFinite`] or [`CoreError::TooLarge`] for unusable
    /// coordinates; the index counts the ends from 0, two per segment.
    pub fn new(segments: Vec<LineSegment>) -> Result<Self, CoreError> {
        if segments.is_empty() {
            return Err(CoreError::NoPoints);
        }
        let ends: Vec<Point<2>> = segments.iter().flat_map(|s| [s.start, s.end]).collect();
        check_finite(&ends)?;
        Ok(SegmentMap { segments })
    }

    /// The segments, in order.
    pub fn segments(&self) -> &[LineSegment] {
        &self.segments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_by_hand() {
        let wall = LineSegment { start: [1.0, 1.0], end: [4.0, 5.0] };
        assert_eq!(wall.length(), 5.0);
        // The midpoint is (2.5, 3); (4, −3) is normal to the segment, to its right.
        for (place, expected) in [
            ([2.5, 3.0], 0.0),
            ([2.5 + 4.0, 3.0 - 3.0], 25.0),
            ([1.0, 1.0], 0.0),
            ([-2.0, -3.0], 25.0),
            ([4.0, 7.0], 4.0),
        ] {
            let found = wall.distance_squared(&place);
            assert!((found - expected).abs() < 1e-12, "{place:?}: {found}");
            let turned = LineSegment { start: wall.end, end: wall.start };
            assert!((turned.distance_squared(&place) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_segment_without_length_is_a_point() {
        // The square of 10⁻¹⁷⁰ is 0 in floating point, that of 10⁻¹⁶⁰ subnormal.
        for length in [0.0, 1e-170, 1e-160] {
            let place = LineSegment { start: [length, 0.0], end: [0.0, 0.0] };
            assert_eq!(place.distance_squared(&[3.0, 4.0]), 25.0);
            assert!(place.distance_squared(&[0.0, 0.0]) < 1e-300);
        }
    }

    #[test]
    fn unusable_coordinates_are_refused() {
        let wall = LineSegment { start: [0.0, 0.0], end: [1.0, 0.0] };
        let nowhere = LineSegment { start: [0.0, 0.0], end: [1.0, f64::NAN] };
        assert_eq!(SegmentMap::new(Vec::new()), Err(CoreError::NoPoints));
        let refused = SegmentMap::new(vec![wall, nowhere]);
        assert!(matches!(refused, Err(CoreError::NonFinite { index: 3, axis: 1, .. })));
    }
}
