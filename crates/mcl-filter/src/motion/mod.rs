//! How a robot moves, and how its odometry errs (*Probabilistic Robotics*, chapter 5).

mod noise;
mod odometry_model;

pub use noise::{OdometryNoise, noisy_increments};
pub use odometry_model::{NoisyMotion, OdometryModel, TURNING_IN_PLACE};
