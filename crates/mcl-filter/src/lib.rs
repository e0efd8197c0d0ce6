//! Monte Carlo localization of a robot on a sample-based map: a particle filter with the sampled
//! odometry motion model and the likelihood field of *Probabilistic Robotics* (Thrun, Burgard and
//! Fox, 2005).
//!
//! [`localize`] runs the filter over a recording; [`ParticleFilter`] does the same step by step. Its components are
//! in [`motion`] (motion models), [`sensor`] (likelihood field), [`Particles`], [`Resampling`] and [`Estimate`].
//!
//! Settings are plain values ([`FilterSettings`], with serde) that are checked once and become
//! [`CheckedSettings`]. There is no global random generator: every draw is derived from a
//! [`Seed`](mcl_core::Seed), its purpose, and the step.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod beams;
mod check;
mod error;
mod estimate;
mod filter;
mod kld;
mod localize;
pub mod motion;
mod number;
mod particles;
mod proposal;
mod recovery;
mod resampling;
pub mod sensor;
mod settings;
mod sigma_hit;
mod start;
mod words;

pub use beams::Beams;
pub use error::FilterError;
pub use estimate::Estimate;
pub use filter::{ParticleFilter, StepReport};
pub use kld::Kld;
pub use localize::{Bridge, Replay, Run, Step, localize, localize_with};
pub use motion::{OdometryNoise, noisy_increments};
pub use number::ParticleNumber;
pub use particles::{Particles, effective_sample_size};
pub use recovery::Recovery;
pub use sensor::MapDistances;
pub use settings::{
    CheckedSettings, FilterSettings, InitialPose, MotionKind, Preset, Proposal, Resampling,
};
pub use sigma_hit::SigmaHit;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
