//! Errors of estimated trajectories, and statistical tests of differences between map builders.
//!
//! Typical use: read two trajectories with [`trajectory_file::read_file`]; [`associate`] them by stamp or
//! [`interpolate`] the denser one (after [`find_offset`], if their clocks differ); compute [`pose_errors`],
//! [`ate()`] or [`rpe()`] of the matched poses; and summarize the samples with [`Summary::of`]. [`coverage()`] reports
//! how much of the reference the pairs cover. Over several runs, the samples are pooled ([`Summary::pooled`]), and
//! averages are never averaged.
//!
//! Tests and intervals are over blocks ([`Blocked`]): the maps of one draw number, with all runs on them,
//! are independent of other draws, but runs and scans in a block are not independent of each other.
//! [`Blocked::mean_interval`] and [`Blocked::bootstrap_interval`] give confidence intervals of a mean, [`paired`] and
//! [`two_sample`] the size and significance of a difference ([`Effect`]), or the error [`TooFew`];
//! [`BlockedRate`] gives an interval of a rate of runs. [`holm`] adjusts the p values of a family of tests, and
//! [`nees`] compares an error with the covariance of the estimate.
//!
//! All units are metres and radians. Samples that are not finite are errors that contain the index of the sample.
//!
//! # Example
//! ```
//! use mcl_core::{Pose2, Stamp, Trajectory};
//! use mcl_metrics::{Alignment, DEFAULT_TOLERANCE_S, Summary, associate, ate};
//!
//! let track = |offset: f64| -> Trajectory {
//!     (0..10)
//!         .map(|i| (Stamp::from_nanoseconds(i * 100_000_000), Pose2::new(i as f64, offset, 0.0)))
//!         .collect()
//! };
//! let matched = associate(&track(0.0), &track(0.5), DEFAULT_TOLERANCE_S)?;
//! let errors = ate(matched.reference.poses(), matched.estimate.poses(), Alignment::None)?;
//! assert_eq!(Summary::of(&errors.translation)?.rmse, 0.5);
//! # Ok::<(), mcl_metrics::MetricsError>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod association;
mod ate;
mod beta;
mod blocked;
mod blocked_rate;
mod comparison;
mod consistency;
mod coverage;
mod error;
mod hypothesis;
mod interval;
mod odometry;
mod offset;
mod outcome;
mod planar;
mod pose_error;
mod rate;
mod rpe;
mod student_t;
mod summary;
mod timeline;
pub mod trajectory_file;
pub mod tum;

pub use association::{DEFAULT_TOLERANCE_S, Matched, Side, TimeDifference, associate, interpolate};
pub use ate::{Alignment, Ate, ate};
pub use blocked::Blocked;
pub use blocked_rate::{BlockedRate, IntervalBasis};
pub use comparison::{holm, one_sample, paired, two_sample};
pub use consistency::{inside_ellipsoid_95, nees};
pub use coverage::{Coverage, coverage};
pub use error::{MetricsError, TooFew};
pub use hypothesis::{Effect, paired_t_test, welch_equivalence_p, welch_t_test};
pub use interval::{Interval, MeanInterval, bootstrap_mean, mean_interval, standard_deviation};
pub use odometry::OdometryError;
pub use offset::{OffsetFound, find_offset, shifted};
pub use outcome::{
    DivergenceSettings, LossSettings, LostEpisode, diverged, found_for_good, lost_episodes,
};
pub use pose_error::{DEFAULT_XI, PoseError, WeightedPoseError, pose_errors};
pub use rate::{Rate, fisher_exact, fisher_exact_greater, rate_difference};
pub use rpe::{Delta, PairsFrom, Rpe, RpeSettings, rpe};
pub use summary::Summary;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
