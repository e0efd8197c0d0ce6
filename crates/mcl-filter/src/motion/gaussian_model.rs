use mcl_core::{Pose2, math};

use crate::proposal::Noise;

/// Noise of one step: independent components per step, per metre and per radian, whose variances add up.
///
/// The components are those of MRPT's Gaussian motion model (`minStdXY`, `a1`, `a2` and `minStdPHI`, `a3`, `a4`),
/// which adds standard deviations instead.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spread([f64; 3]);

impl Spread {
    /// Standard deviation after a step of this length (m) and rotation (rad).
    fn std(self, length: f64, turn: f64) -> f64 {
        let Spread([step, metre, radian]) = self;
        (step * step + math::square(metre * length) + math::square(radian * turn)).sqrt()
    }
}

/// A motion model without singularities: the increment in the robot frame, with independent Gaussian noise on
/// x, y (the same for both) and the heading. It treats forward, backward, sideways and in-place motion alike, and has
/// a minimum noise per step. A component that grows with the time between scans is not
/// needed: fitted to the seven logs of the experiments, it is 0 for positions and nearly 0 for headings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianModel {
    position: Spread,
    heading: Spread,
}

impl GaussianModel {
    /// Creates a model with [`FilterSettings::position_noise`](crate::FilterSettings::position_noise) and
    /// [`FilterSettings::heading_noise`](crate::FilterSettings::heading_noise), each part finite and at
    /// least 0.
    pub fn new(position: [f64; 3], heading: [f64; 3]) -> Self {
        GaussianModel { position: Spread(position), heading: Spread(heading) }
    }

    /// The motion for an odometry increment (the pose of the robot in its previous frame).
    pub fn motion(&self, increment: &Pose2) -> GaussianMotion {
        let length = math::hypot(increment.x, increment.y);
        GaussianMotion {
            increment: *increment,
            position_std: self.position.std(length, increment.theta),
            heading_std: self.heading.std(length, increment.theta),
        }
    }
}

/// An odometry increment with the standard deviations of its noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianMotion {
    /// The pose of the robot in its previous frame.
    pub increment: Pose2,
    /// Standard deviation along each of x and y (m).
    pub position_std: f64,
    /// Standard deviation of the heading (rad).
    pub heading_std: f64,
}

impl GaussianMotion {
    /// Returns a function that moves a pose, given as x, y (m) and heading (rad), by this motion with standard normal
    /// noise on x, y and heading.
    pub(super) fn mover(&self) -> impl Fn([f64; 3], Noise) -> [f64; 3] {
        let GaussianMotion { increment, position_std, heading_std } = *self;
        move |[x, y, theta], [ahead, left, turn]| {
            let ahead = increment.x + position_std * ahead;
            let left = increment.y + position_std * left;
            let (sin, cos) = math::sin_cos(theta);
            [
                x + (cos * ahead - sin * left),
                y + (sin * ahead + cos * left),
                theta + increment.theta + heading_std * turn,
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use mcl_core::{Seed, wrap_angle};
    use std::f64::consts::PI;

    const POSITION: [f64; 3] = [0.03, 0.1, 0.2];
    const HEADING: [f64; 3] = [0.05, 0.2, 0.3];

    fn motion(increment: Pose2) -> GaussianMotion {
        GaussianModel::new(POSITION, HEADING).motion(&increment)
    }

    #[test]
    fn the_spread_by_hand() {
        let GaussianMotion { position_std, heading_std, .. } = motion(Pose2::new(0.3, -0.4, 0.6));
        // 0.03² + (0.1·0.5)² + (0.2·0.6)², and likewise for the heading.
        assert!((position_std - 0.0178_f64.sqrt()).abs() < 1e-15);
        assert!((heading_std - 0.0449_f64.sqrt()).abs() < 1e-15);
    }

    /// Table 5.6 spreads the particles along a line for a rotation in place, and hardly at all for a very small motion.
    #[test]
    fn every_direction_has_the_same_noise_and_no_step_has_none() {
        let ahead = motion(Pose2::new(0.5, 0.0, 0.2));
        for (x, y) in [(-0.5, 0.0), (0.0, 0.5), (0.3, -0.4)] {
            let other = motion(Pose2::new(x, y, -0.2));
            assert_eq!(other.position_std.to_bits(), ahead.position_std.to_bits());
            assert_eq!(other.heading_std.to_bits(), ahead.heading_std.to_bits());
        }
        let still = motion(Pose2::IDENTITY);
        assert_eq!([still.position_std, still.heading_std], [0.03, 0.05]);
        // There is no threshold: a little more motion gives a little more noise.
        let (less, more) =
            (motion(Pose2::new(0.0099, 0.0, 1.0)), motion(Pose2::new(0.0101, 0.0, 1.0)));
        assert!((more.position_std - less.position_std).abs() < 1e-6);
    }

    #[test]
    fn moments_are_those_of_the_model() {
        const N: usize = 50_000;
        let increment = Pose2::new(-0.5, 0.1, 2.0);
        let start = Pose2::new(1.0, 2.0, 3.0);
        let (mut x, mut y, mut theta) = (vec![1.0; N], vec![2.0; N], vec![3.0; N]);
        let motion = motion(increment);
        Motion::Gaussian(motion).sample(&mut x, &mut y, &mut theta, &mut Seed::new(3).rng());
        let moved = |i: usize| start.between(&Pose2::new(x[i], y[i], theta[i]));
        type Off = fn(Pose2) -> f64;
        let axes: [(Off, f64); 3] = [
            (|p| p.x + 0.5, motion.position_std),
            (|p| p.y - 0.1, motion.position_std),
            (|p| wrap_angle(p.theta - 2.0), motion.heading_std),
        ];
        for (off, std) in axes {
            let values: Vec<f64> = (0..N).map(|i| off(moved(i))).collect();
            let mean = values.iter().sum::<f64>() / N as f64;
            let variance = values.iter().map(|v| v * v).sum::<f64>() / N as f64;
            // Standard errors are σ/√N and σ²·√(2/N); deviations beyond 4.5 of them occur once in 150,000 runs.
            assert!(mean.abs() < 4.5 * std / (N as f64).sqrt(), "{mean}");
            assert!((variance / (std * std) - 1.0).abs() < 4.5 * (2.0 / N as f64).sqrt());
        }
        assert!(theta.iter().all(|theta| theta.abs() <= PI));
    }
}
