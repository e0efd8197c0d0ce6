use mcl_core::{Pose2, Rng, StandardNormal, wrap_angle};
use rand_distr::Distribution;

use super::gaussian_model::{GaussianModel, GaussianMotion};
use super::odometry_model::{NoisyMotion, OdometryModel};
use crate::proposal::Noise;
use crate::settings::{FilterSettings, MotionKind};

/// The motion model selected by the settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotionModel {
    /// Gaussian noise in the robot frame.
    Gaussian(GaussianModel),
    /// Rotation, translation, rotation (*Probabilistic Robotics*, table 5.6).
    Book(OdometryModel),
}

impl MotionModel {
    /// Creates the model from checked settings.
    pub(crate) fn of(settings: &FilterSettings) -> Self {
        let FilterSettings { position_noise, heading_noise, alpha, turning_in_place, .. } =
            *settings;
        match settings.motion {
            MotionKind::Gaussian => {
                MotionModel::Gaussian(GaussianModel::new(position_noise, heading_noise))
            }
            MotionKind::Book => MotionModel::Book(OdometryModel::new(alpha, turning_in_place)),
        }
    }

    /// The motion for an odometry increment (the pose of the robot in its previous frame), which can be sampled for
    /// every particle.
    pub fn motion(&self, increment: &Pose2) -> Motion {
        match self {
            MotionModel::Gaussian(model) => Motion::Gaussian(model.motion(increment)),
            MotionModel::Book(model) => Motion::Book(model.motion(increment)),
        }
    }
}

/// An odometry increment with its noise distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Motion of [`MotionModel::Gaussian`].
    Gaussian(GaussianMotion),
    /// Motion of [`MotionModel::Book`].
    Book(NoisyMotion),
}

impl Motion {
    /// Moves every pose, given as slices of x, y (m) and heading (rad, wrapped on return), with independent
    /// noise.
    pub fn sample(&self, x: &mut [f64], y: &mut [f64], theta: &mut [f64], rng: &mut Rng) {
        self.apply(x, y, theta, || std::array::from_fn(|_| StandardNormal.sample(rng)));
    }

    /// Moves every pose like [`sample`](Self::sample), with the three standard normal numbers that `noise`
    /// returns for each in turn.
    pub(crate) fn apply(
        &self,
        x: &mut [f64],
        y: &mut [f64],
        theta: &mut [f64],
        noise: impl FnMut() -> Noise,
    ) {
        // Dispatches on the model once, not per pose.
        match self {
            Motion::Gaussian(motion) => move_all(x, y, theta, noise, motion.mover()),
            Motion::Book(motion) => move_all(x, y, theta, noise, motion.mover()),
        }
    }
}

fn move_all(
    x: &mut [f64],
    y: &mut [f64],
    theta: &mut [f64],
    mut noise: impl FnMut() -> Noise,
    moved: impl Fn([f64; 3], Noise) -> [f64; 3],
) {
    for ((x, y), theta) in x.iter_mut().zip(y).zip(theta) {
        [*x, *y, *theta] = moved([*x, *y, *theta], noise());
        *theta = wrap_angle(*theta);
    }
}
