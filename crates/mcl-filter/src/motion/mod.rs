//! Motion models, odometry noise, and fitting them to a log (*Probabilistic Robotics*, chapter 5).

mod fit;
mod gaussian_model;
mod model;
mod noise;
mod odometry_model;

pub use fit::{Fitted, MotionFit, MotionStep};
pub use gaussian_model::{GaussianModel, GaussianMotion};
pub use model::{Motion, MotionModel};
pub use noise::{OdometryNoise, noisy_increments};
pub use odometry_model::{NoisyMotion, OdometryModel};
