use mcl_core::{Pose2, math, wrap_angle};
use serde::Serialize;

use crate::error::{MetricsError, check_poses};

/// Default ξ in equation 7 of the paper.
pub const DEFAULT_XI: f64 = 0.8;

/// Error of an estimated pose: estimate minus reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseError {
    /// δx along the x axis of the map, in metres.
    pub dx: f64,
    /// δy along the y axis of the map, in metres.
    pub dy: f64,
    /// δθ, wrapped to (−π, π], in radians.
    pub dtheta: f64,
    /// Position error along the reference heading, in metres: positive if the estimate is ahead.
    pub longitudinal: f64,
    /// Position error across the reference heading, in metres: positive if the estimate is to the left.
    pub lateral: f64,
}

impl PoseError {
    /// Computes the error of an estimated pose; both poses are in the map frame.
    pub fn between(reference: &Pose2, estimate: &Pose2) -> Self {
        let reference_from_estimate = reference.between(estimate);
        PoseError {
            dx: estimate.x - reference.x,
            dy: estimate.y - reference.y,
            dtheta: wrap_angle(estimate.theta - reference.theta),
            longitudinal: reference_from_estimate.x,
            lateral: reference_from_estimate.y,
        }
    }

    /// Distance between the positions, in metres.
    pub fn translation(&self) -> f64 {
        math::hypot(self.dx, self.dy)
    }

    /// |δθ| in radians, within [0, π].
    pub fn heading(&self) -> f64 {
        self.dtheta.abs()
    }
}

/// Computes the errors of estimated poses, one per pair in the given order.
///
/// # Errors
/// If the numbers of poses differ, there is none, or one is not finite or beyond
/// [`mcl_core::MAX_COORDINATE`].
pub fn pose_errors(
    reference: &[Pose2],
    estimate: &[Pose2],
) -> Result<Vec<PoseError>, MetricsError> {
    check_poses(reference, estimate)?;
    Ok(reference.iter().zip(estimate).map(|(r, e)| PoseError::between(r, e)).collect())
}

/// Distance of two poses that weights heading against position (equation 7):
/// `d = √(ξ·δθ² + (1 − ξ)·(δx² + δy²))`, in the paper's mixed unit of radians and metres.
///
/// # Example
/// ```
/// use mcl_core::Pose2;
/// use mcl_metrics::WeightedPoseError;
///
/// let metric = WeightedPoseError::default(); // ξ = 0.8
/// let reference = Pose2::new(1.0, 2.0, 3.1);
/// let estimate = Pose2::new(1.3, 1.6, 3.1 + 0.1 - std::f64::consts::TAU);
/// // √(0.8·0.1² + 0.2·(0.3² + 0.4²)) = √0.058
/// assert!((metric.distance(&reference, &estimate) - 0.058_f64.sqrt()).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedPoseError {
    xi: f64,
}

impl WeightedPoseError {
    /// Creates a metric with the given ξ: 0 uses positions only, 1 headings only.
    ///
    /// # Errors
    /// If ξ is outside [0, 1].
    pub fn new(xi: f64) -> Result<Self, MetricsError> {
        if !(0.0..=1.0).contains(&xi) {
            let expected = "a number from 0 (position only) to 1 (heading only)";
            return Err(MetricsError::Setting { name: "xi", found: xi, expected });
        }
        Ok(WeightedPoseError { xi })
    }

    /// The weight of the squared heading error.
    pub fn xi(&self) -> f64 {
        self.xi
    }

    /// The distance d for a pose error.
    pub fn of(&self, error: &PoseError) -> f64 {
        let squared_translation = error.dx * error.dx + error.dy * error.dy;
        (self.xi * error.dtheta * error.dtheta + (1.0 - self.xi) * squared_translation).sqrt()
    }

    /// The distance d(x, x′) of two poses in the same frame.
    pub fn distance(&self, a: &Pose2, b: &Pose2) -> f64 {
        self.of(&PoseError::between(a, b))
    }
}

/// The metric with ξ = [`DEFAULT_XI`].
impl Default for WeightedPoseError {
    fn default() -> Self {
        WeightedPoseError { xi: DEFAULT_XI }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0, -50.0..50.0, -7.0..7.0).prop_map(|(x, y, t)| Pose2::new(x, y, t))
    }

    #[test]
    fn xi_chooses_between_position_and_heading() {
        let (a, b) = (Pose2::new(0.0, 0.0, 0.2), Pose2::new(3.0, 4.0, -0.1));
        let distance = |xi| WeightedPoseError::new(xi).unwrap().distance(&a, &b);
        assert_eq!(distance(0.0), 5.0);
        assert!((distance(1.0) - 0.3).abs() < 1e-15);
        for xi in [-0.01, 1.01, f64::NAN, f64::INFINITY] {
            let error = WeightedPoseError::new(xi).unwrap_err();
            assert!(error.to_string().starts_with(&format!("xi is {xi}, expected")), "{error}");
        }
    }

    #[test]
    fn errors_along_and_across_the_heading() {
        let error =
            PoseError::between(&Pose2::new(1.0, 1.0, FRAC_PI_2), &Pose2::new(0.8, 1.5, -3.0));
        assert!((error.longitudinal - 0.5).abs() < 1e-15 && (error.lateral - 0.2).abs() < 1e-15);
        assert!((error.dx + 0.2).abs() < 1e-15 && (error.dy - 0.5).abs() < 1e-15);
        assert!((error.dtheta - (TAU - 3.0 - FRAC_PI_2)).abs() < 1e-15);
        let opposite = PoseError::between(&Pose2::new(0.0, 0.0, PI), &Pose2::IDENTITY);
        assert_eq!((opposite.dtheta, opposite.heading()), (PI, PI));
    }

    #[test]
    fn poses_that_cannot_be_compared_are_refused() {
        let poses = [Pose2::IDENTITY, Pose2::new(0.0, f64::NAN, 0.0)];
        let message = pose_errors(&poses[..1], &poses).unwrap_err().to_string();
        assert_eq!(
            message,
            "reference poses: 1 but estimated poses: 2, expected equal numbers, because they form pairs"
        );
        assert!(matches!(
            pose_errors(&[poses[0]; 2], &poses),
            Err(MetricsError::UnusablePose { trajectory: "estimate", index: 1, .. })
        ));
        assert!(matches!(pose_errors(&[], &[]), Err(MetricsError::TooFew { .. })));
    }

    proptest! {
        #[test]
        fn is_a_metric(a in pose(), b in pose(), c in pose(), xi in 0.01..0.99f64, turns in -3..=3) {
            let metric = WeightedPoseError::new(xi).unwrap();
            let same = Pose2::new(a.x, a.y, a.theta + f64::from(turns) * TAU);
            prop_assert!(metric.distance(&a, &same) < 1e-14);
            prop_assert!(a == b || metric.distance(&a, &b) > 0.0);
            prop_assert!((metric.distance(&a, &b) - metric.distance(&b, &a)).abs() < 1e-14);
            let detour = metric.distance(&a, &c) + metric.distance(&c, &b);
            prop_assert!(metric.distance(&a, &b) <= detour + 1e-12);
        }

        #[test]
        fn both_frames_see_the_same_translation(a in pose(), b in pose()) {
            let error = PoseError::between(&a, &b);
            let in_robot_frame = error.longitudinal.hypot(error.lateral);
            prop_assert!((error.translation() - in_robot_frame).abs() < 1e-12);
        }
    }
}
