use mcl_core::{Pose2, wrap_angle};

use crate::proposal::Noise;

/// How the noise of one step grows: independent parts, whose variances add up.
///
/// The parts are those of MRPT's Gaussian motion model (`minStdXY`, `a1`, `a2` and `minStdPHI`, `a3`, `a4`),
/// which adds standard deviations instead.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spread([f64; 3]);

impl Spread {
    /// Standard deviation after a step of this length (m) and turn (rad).
    fn std(self, length: f64, turn: f64) -> f64 {
        let Spread([step, metre, radian]) = self;
        (step * step + (metre * length).powi(2) + (radian * turn).powi(2)).sqrt()
    }
}

/// A motion model without singularities: the increment in the robot's frame, with independent Gaussian noise on
/// x, y (the same for both) and the heading. Forward, backward, sideways and on the spot are the same to it,
/// and small steps keep the noise that every step has. A part that grows with the time between scans is not
/// needed: fitted to the seven logs of the experiments, it is 0 for positions and next to it for headings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianModel {
    position: Spread,
    heading: Spread,
}

impl GaussianModel {
    /// A model with [`FilterSettings::position_noise`](crate::FilterSettings::position_noise) and
    /// [`FilterSettings::heading_noise`](crate::FilterSettings::heading_noise), each part finite and at
    /// least 0.
    pub fn new(position: [f64; 3], heading: [f64; 3]) -> Self {
        GaussianModel { position: Spread(position), heading: Spread(heading) }
    }

    /// The motion that an odometry increment (the robot's pose in the frame of the robot before) stands for.
    pub fn motion(&self, increment: &Pose2) -> GaussianMotion {
        let length = increment.x.hypot(increment.y);
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
    /// The robot's pose in the frame of the robot before.
    pub increment: Pose2,
    /// Of the noise along each of x and y (m).
    pub position_std: f64,
    /// Of the noise of the heading (rad).
    pub heading_std: f64,
}

impl GaussianMotion {
    /// Moves every pose, given as slices of x, y (m) and heading (rad, wrapped on return), with the standard
    /// normal noise on x, y and heading that `noise` gives for one after the other.
    pub(crate) fn apply(
        &self,
        x: &mut [f64],
        y: &mut [f64],
        theta: &mut [f64],
        mut noise: impl FnMut() -> Noise,
    ) {
        let GaussianMotion { increment, position_std, heading_std } = self;
        for ((x, y), theta) in x.iter_mut().zip(y).zip(theta) {
            let [ahead, left, turn] = noise();
            let ahead = increment.x + position_std * ahead;
            let left = increment.y + position_std * left;
            let (sin, cos) = theta.sin_cos();
            *x += cos * ahead - sin * left;
            *y += sin * ahead + cos * left;
            *theta = wrap_angle(*theta + increment.theta + heading_std * turn);
        }
    }
}
