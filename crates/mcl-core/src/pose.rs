use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Vector2};
use serde::{Deserialize, Serialize};

use crate::Point;
use crate::math;

/// Wraps an angle (radians) to the half-open interval (−π, π].
pub fn wrap_angle(angle: f64) -> f64 {
    if angle > -PI && angle <= PI {
        return angle;
    }
    let wrapped = angle.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

/// A planar pose, or equally the rigid transform from the posed frame to the frame the pose is given in
/// (such as `map_from_laser`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose2 {
    /// x in metres.
    pub x: f64,
    /// y in metres.
    pub y: f64,
    /// Heading in radians, counter-clockwise; not necessarily wrapped.
    pub theta: f64,
}

impl Pose2 {
    /// The identity transform.
    pub const IDENTITY: Pose2 = Pose2 { x: 0.0, y: 0.0, theta: 0.0 };

    /// Creates a pose from metres and radians.
    pub const fn new(x: f64, y: f64, theta: f64) -> Self {
        Pose2 { x, y, theta }
    }

    /// `self ∘ other`: with `a_from_b.compose(b_from_c)` the result is `a_from_c`, heading wrapped.
    pub fn compose(&self, other: &Pose2) -> Pose2 {
        let [x, y] = self.transform_point([other.x, other.y]);
        Pose2::new(x, y, wrap_angle(self.theta + other.theta))
    }

    /// The inverse transform: `a_from_b` becomes `b_from_a`, heading wrapped.
    pub fn inverse(&self) -> Pose2 {
        let (sin, cos) = math::sin_cos(self.theta);
        Pose2::new(
            -(cos * self.x + sin * self.y),
            sin * self.x - cos * self.y,
            wrap_angle(-self.theta),
        )
    }

    /// `self⁻¹ ∘ other`: the pose of `other` in the frame of `self`, heading wrapped. Accurate for poses far from the
    /// origin, because the positions are subtracted before they are rotated.
    pub fn between(&self, other: &Pose2) -> Pose2 {
        let (sin, cos) = math::sin_cos(self.theta);
        let (dx, dy) = (other.x - self.x, other.y - self.y);
        Pose2::new(cos * dx + sin * dy, cos * dy - sin * dx, wrap_angle(other.theta - self.theta))
    }

    /// Transforms a point from the posed frame to the frame the pose is given in.
    pub fn transform_point(&self, [x, y]: Point<2>) -> Point<2> {
        let (sin, cos) = math::sin_cos(self.theta);
        [self.x + cos * x - sin * y, self.y + sin * x + cos * y]
    }

    /// Distance between the positions of two poses, in metres.
    pub fn distance(&self, other: &Pose2) -> f64 {
        math::hypot(self.x - other.x, self.y - other.y)
    }

    /// Interpolates from this pose to `to` by the fraction `part` (0 to 1): linearly between the positions, and along
    /// the shorter arc between the headings, wrapped.
    pub fn interpolate(&self, to: &Pose2, part: f64) -> Pose2 {
        Pose2::new(
            self.x + part * (to.x - self.x),
            self.y + part * (to.y - self.y),
            wrap_angle(self.theta + part * wrap_angle(to.theta - self.theta)),
        )
    }

    /// Whether all three components are finite.
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.theta.is_finite()
    }

    /// Converts to a nalgebra isometry.
    pub fn to_isometry(&self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x, self.y), self.theta)
    }
}

impl From<Isometry2<f64>> for Pose2 {
    fn from(isometry: Isometry2<f64>) -> Self {
        let translation = isometry.translation.vector;
        Pose2::new(translation.x, translation.y, isometry.rotation.angle())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-1e3..1e3, -1e3..1e3, -10.0..10.0).prop_map(|(x, y, t)| Pose2::new(x, y, t))
    }

    fn close(a: &Pose2, b: &Pose2) -> bool {
        a.distance(b) < 1e-9 && wrap_angle(a.theta - b.theta).abs() < 1e-12
    }

    proptest! {
        #[test]
        fn inverse_undoes_compose(a in pose(), b in pose()) {
            prop_assert!(close(&a.inverse().compose(&a.compose(&b)), &b));
            prop_assert!(close(&a.between(&a.compose(&b)), &b));
            prop_assert!(close(&a.compose(&a.inverse()), &Pose2::IDENTITY));
        }

        #[test]
        fn agrees_with_nalgebra(a in pose(), b in pose()) {
            prop_assert!(close(&Pose2::from(a.to_isometry() * b.to_isometry()), &a.compose(&b)));
            prop_assert!(close(&Pose2::from(a.to_isometry().inverse()), &a.inverse()));
        }

        #[test]
        fn wrapped_angles_lie_in_the_half_open_interval(angle in -1e4..1e4f64) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI);
            let turns = (angle - wrapped) / TAU;
            prop_assert!((turns - turns.round()).abs() < 1e-9);
        }
    }

    #[test]
    fn headings_are_interpolated_on_the_shorter_arc() {
        let (from, to) = (Pose2::new(1.0, 0.0, PI - 0.1), Pose2::new(2.0, -4.0, 0.3 - PI));
        let found = from.interpolate(&to, 0.75);
        assert_eq!((found.x, found.y), (1.75, -3.0));
        assert!((found.theta - (0.2 - PI)).abs() < 1e-15, "{found:?}");
        assert_eq!(from.interpolate(&to, 0.0), from);
        assert_eq!(from.interpolate(&from, 0.3), from);
    }

    #[test]
    fn pi_wraps_to_plus_pi() {
        assert_eq!(wrap_angle(PI), PI);
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(3.0 * PI), PI);
    }
}
