//! The frames of two trajectories' poses, and their conversion to a common frame.

use std::borrow::Cow;

use anyhow::{Result, bail};
use mcl_core::{Pose2, Trajectory};

use super::mounts::{Mounts, name_of};
use super::source::TrajectoryInput;
use crate::cli::args::Whose;
use crate::progress::tell;

/// Mounts closer to the identity than this (m, rad) do not matter.
const NO_MOUNT: f64 = 1e-9;
/// The frame of odometry, which drifts against the map (REP 105).
const ODOMETRY: &str = "odom";

/// Whether a frame is that of odometry, in a namespace too: `robot1/odom`, `odom_combined`.
fn is_of_odometry(frame: &str) -> bool {
    frame.rsplit('/').next().is_some_and(|name| name.starts_with(ODOMETRY))
}

/// Both sides as poses of a common frame.
pub struct Compared<'a> {
    /// Whose poses they are; `None` where neither side states it.
    pub whose: Option<Whose>,
    pub reference: Cow<'a, Trajectory>,
    pub estimate: Cow<'a, Trajectory>,
    /// From the compared frame to the frame of the estimate's covariances.
    pub to_estimated: Pose2,
    /// Whether nothing was assumed.
    pub is_certain: bool,
}

/// Converts both sides to poses of a common frame: the requested one; else the one that both have; else the
/// laser, where one side has its poses, or the reference's. Where a side's frame is not known, its poses are
/// taken as the robot's; that is reported as doubtful where a laser is known to be mounted elsewhere on it.
///
/// # Errors
/// When a side would have to be converted, and the mount is not known.
pub fn compared<'a>(
    reference: &'a TrajectoryInput,
    estimate: &'a TrajectoryInput,
    asked: Option<&Whose>,
    given: &Mounts,
) -> Result<Compared<'a>> {
    let stars = [&estimate.mounts, &reference.mounts, given];
    let between = |from: &Whose, to: &Whose| match from == to {
        true => Some(Pose2::IDENTITY),
        false => stars.iter().find_map(|mounts| mounts.between(from, to)),
    };
    let is_known = reference.whose.is_some() || estimate.whose.is_some();
    let [of_reference, of_estimate] =
        [reference, estimate].map(|source| source.whose.as_ref().unwrap_or(&Whose::Robot));
    let target = match asked {
        Some(asked) => asked,
        None if of_reference != of_estimate && *of_estimate == Whose::Laser => of_estimate,
        None => of_reference,
    };
    let carry = |source: &TrajectoryInput, from: &Whose| -> Result<Pose2> {
        let Some(mount) = between(from, target) else {
            bail!(
                "{}: its poses are those of {from}, and where {target} is relative to {from} is unknown; \
                 compare it with a trajectory that has the transform (of `localize`, a log or a bag), \
                 give the laser's pose on the robot with --mount X,Y,THETA, say whose poses the files \
                 hold with --reference-frame and --estimate-frame, or compare poses of another frame with \
                 --frame",
                source.of.label(),
            );
        };
        if !is_none(mount) && !source.has_headings {
            bail!(
                "{}: its poses are those of {from}, and positions alone cannot be moved to {target}; choose --frame {}",
                source.of.label(),
                name_of(from)
            );
        }
        Ok(mount)
    };
    let (reference_carry, estimate_carry) =
        (carry(reference, of_reference)?, carry(estimate, of_estimate)?);
    // It matters where the robot has several frames that poses could be of.
    let matters = stars.iter().flat_map(|mounts| mounts.poses()).any(|mount| !is_none(*mount));
    let unknown = [(reference, "reference-frame"), (estimate, "estimate-frame")];
    let doubtful =
        unknown.iter().find(|(source, _)| source.whose.is_none()).filter(|_| matters && is_known);
    if let Some((source, option)) = doubtful {
        tell!(
            "warning: {}: the file does not say whose poses it has; they are taken to be the robot's \
             (state it with --{option} robot or laser)",
            source.of.label()
        );
    }
    Ok(Compared {
        whose: is_known.then(|| target.clone()),
        reference: moved(&reference.trajectory, reference_carry),
        estimate: moved(&estimate.trajectory, estimate_carry),
        to_estimated: estimate_carry.inverse(),
        is_certain: doubtful.is_none(),
    })
}

fn is_none(mount: Pose2) -> bool {
    [mount.x, mount.y, mount.theta].iter().all(|part| part.abs() < NO_MOUNT)
}

fn moved(trajectory: &Trajectory, carry: Pose2) -> Cow<'_, Trajectory> {
    if is_none(carry) {
        return Cow::Borrowed(trajectory);
    }
    Cow::Owned(trajectory.iter().map(|(stamp, pose)| (stamp, pose.compose(&carry))).collect())
}

/// Whether both sides are in the same world frame, as far as known; warns where they are not.
pub fn are_in_one_world(reference: &TrajectoryInput, estimate: &TrajectoryInput) -> bool {
    let [of_reference, of_estimate] = [&reference.within, &estimate.within].map(Option::as_deref);
    let label = estimate.of.label();
    match (of_reference, of_estimate) {
        (Some(a), Some(b)) if a != b => {
            tell!(
                "warning: {label}: its poses are in frame {b:?}, those of the reference in {a:?}, and no \
                 transforms lead from one to the other: the errors include the offset between the frames \
                 (--align removes it)"
            );
            false
        }
        (None, Some(frame)) if is_of_odometry(frame) => {
            tell!(
                "warning: {label}: its poses are in frame {frame:?}, which drifts against the map, and no \
                 transforms lead to it from \"map\": the errors include the offset between the frames \
                 (--align removes it)"
            );
            false
        }
        _ => true,
    }
}
