use mcl_core::{Pose2, math, wrap_angle};
use nalgebra::{Matrix3, Vector3};

/// Weighted mean and covariance of the particles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Weighted mean pose of the robot in the map frame; the heading is the direction of the
    /// weighted mean of the unit vectors (cos θ, sin θ), so that headings about ±π average to ±π.
    pub map_from_robot: Pose2,
    /// Weighted covariance of (x, y, θ) about the mean in m², m·rad and rad², heading differences
    /// wrapped to (−π, π].
    pub covariance: Matrix3<f64>,
}

impl Estimate {
    /// Computes the estimate from positions (m), headings (rad) with their sines and cosines, and weights that sum to
    /// one. If the headings cancel out, their mean direction is undefined and arbitrary.
    pub(crate) fn of(
        (x, y): (&[f64], &[f64]),
        theta: &[f64],
        (sin, cos): (&[f64], &[f64]),
        weights: &[f64],
    ) -> Self {
        let mean = |values: &[f64]| values.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>();
        let map_from_robot = Pose2::new(mean(x), mean(y), math::atan2(mean(sin), mean(cos)));
        let mut covariance = Matrix3::zeros();
        for (i, &weight) in weights.iter().enumerate() {
            let off = Vector3::new(
                x[i] - map_from_robot.x,
                y[i] - map_from_robot.y,
                wrap_angle(theta[i] - map_from_robot.theta),
            );
            covariance += weight * off * off.transpose();
        }
        Estimate { map_from_robot, covariance }
    }

    /// Covariance of the pose of a sensor on the robot, to first order: J·C·Jᵀ, with J the derivative of the
    /// sensor pose with respect to the robot pose. Same units, in the map frame.
    pub fn covariance_at(&self, robot_from_mounted: &Pose2) -> Matrix3<f64> {
        let turned = Pose2::new(0.0, 0.0, self.map_from_robot.theta);
        let [x, y] = turned.transform_point([robot_from_mounted.x, robot_from_mounted.y]);
        let derivative = Matrix3::new(1.0, 0.0, -y, 0.0, 1.0, x, 0.0, 0.0, 1.0);
        derivative * self.covariance * derivative.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn estimate(poses: &[(f64, f64, f64)], weights: &[f64]) -> Estimate {
        let column = |f: fn(&(f64, f64, f64)) -> f64| poses.iter().map(f).collect::<Vec<f64>>();
        Estimate::of(
            (&column(|p| p.0), &column(|p| p.1)),
            &column(|p| p.2),
            (&column(|p| p.2.sin()), &column(|p| p.2.cos())),
            weights,
        )
    }

    #[test]
    fn by_hand() {
        // x: 0.75·0 + 0.25·4 = 1, variance 0.75·1 + 0.25·9 = 3; y = x/2; θ is constant.
        let found = estimate(&[(0.0, 0.0, 0.5), (4.0, 2.0, 0.5)], &[0.75, 0.25]);
        assert!(found.map_from_robot.distance(&Pose2::new(1.0, 0.5, 0.0)) < 1e-15);
        assert!((found.map_from_robot.theta - 0.5).abs() < 1e-15);
        let expected = Matrix3::new(3.0, 1.5, 0.0, 1.5, 0.75, 0.0, 0.0, 0.0, 0.0);
        assert!((found.covariance - expected).amax() < 1e-14);
    }

    /// A laser 0.4 m ahead of a robot that faces +y: its x changes by −0.4 m per radian, its y does not change.
    #[test]
    fn the_covariance_of_a_laser_by_hand() {
        let estimate = Estimate {
            map_from_robot: Pose2::new(3.0, 2.0, FRAC_PI_2),
            covariance: Matrix3::new(0.01, 0.0, 0.002, 0.0, 0.04, 0.0, 0.002, 0.0, 0.25),
        };
        let found = estimate.covariance_at(&Pose2::new(0.4, 0.0, 1.0));
        let xx = 0.01 - 2.0 * 0.4 * 0.002 + 0.16 * 0.25;
        let xt = 0.002 - 0.4 * 0.25;
        let expected = Matrix3::new(xx, 0.0, xt, 0.0, 0.04, 0.0, xt, 0.0, 0.25);
        assert!((found - expected).amax() < 1e-14, "{found}");
        assert_eq!(estimate.covariance_at(&Pose2::IDENTITY), estimate.covariance);
    }

    /// For small heading differences, the formula gives the covariance of the individually composed poses.
    #[test]
    fn the_covariance_of_a_laser_is_that_of_its_poses() {
        let mount = Pose2::new(0.3, -0.2, 0.7);
        let poses = [(1.0, 2.0, 0.50), (1.1, 2.0, 0.505), (1.0, 2.2, 0.495), (0.9, 1.9, 0.501)];
        let of_laser = poses.map(|(x, y, theta)| {
            let Pose2 { x, y, theta } = Pose2::new(x, y, theta).compose(&mount);
            (x, y, theta)
        });
        let weights = [0.25; 4];
        let found = estimate(&poses, &weights).covariance_at(&mount);
        let expected = estimate(&of_laser, &weights).covariance;
        assert!((found - expected).amax() < 1e-6, "{found} {expected}");
    }

    #[test]
    fn headings_about_pi_average_to_pi() {
        let found = estimate(&[(0.0, 0.0, PI - 0.1), (0.0, 0.0, -PI + 0.1)], &[0.5, 0.5]);
        assert!(wrap_angle(found.map_from_robot.theta - PI).abs() < 1e-12);
        assert!((found.covariance[(2, 2)] - 0.01).abs() < 1e-12);
        let weighted = estimate(&[(0.0, 0.0, PI - 0.1), (0.0, 0.0, -PI + 0.1)], &[0.9, 0.1]);
        // The direction of 0.9·u(π − 0.1) + 0.1·u(π + 0.1): π − atan(0.8·tan 0.1).
        let expected = PI - (0.8 * 0.1f64.tan()).atan();
        assert!(wrap_angle(weighted.map_from_robot.theta - expected).abs() < 1e-12);
    }

    #[test]
    fn headings_that_cancel_out_give_some_finite_heading() {
        let poses =
            [(0.0, 0.0, 0.0), (0.0, 0.0, FRAC_PI_2), (0.0, 0.0, PI), (0.0, 0.0, -FRAC_PI_2)];
        let found = estimate(&poses, &[0.25; 4]);
        assert!(found.map_from_robot.is_finite());
        assert!(found.covariance.iter().all(|c| c.is_finite()));
    }
}
