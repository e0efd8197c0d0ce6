//! An external reference for a log.

use std::collections::BTreeMap;

use mcl_core::text::counted;
use mcl_core::{Pose2, Stamp, Trajectory};

use crate::bag::moment::Moment;
use crate::bag::pairing::{Track, TrackRemarks, goes_over_again, occurrences, stretches_of_file};
use crate::bag::track::{Occurrence, Placed, PoseTrack};
use crate::log::content::Log;
use crate::log::options::{ReadOptions, ReferenceTrack};

const NANOSECONDS: f64 = 1e9;
/// A mount closer to the identity than this (m, rad) does not matter.
const NO_MOUNT: f64 = 1e-9;
const REFERENCE: &str = "reference";
const LASER: &str = "laser";
/// Names of the robot, and the usual names of its frame.
const ROBOT: [&str; 3] = ["robot", "base_link", "base_footprint"];

/// The pose of a trajectory at each stamp: that of the same stamp, of several the last; else interpolated
/// between the two neighbours (positions linearly, headings along the shorter arc). Nothing is extrapolated,
/// nor interpolated over more than five usual intervals of the trajectory (and 0.2 s).
pub fn poses_at(trajectory: &Trajectory, stamps: &[Stamp]) -> Vec<Option<Pose2>> {
    let last: BTreeMap<Moment, Pose2> =
        trajectory.iter().map(|(stamp, pose)| (Moment::only(stamp), pose)).collect();
    let track = PoseTrack::new(last.into_iter().collect(), None);
    let pose = |&stamp: &Stamp| match track.as_ref()?.at(Moment::only(stamp), Occurrence::ONLY) {
        Placed::At(pose) => Some(pose),
        Placed::Outside | Placed::InGap(_) | Placed::Unclear => None,
    };
    stamps.iter().map(pose).collect()
}

/// The doubt about a track when neither it nor the options say whose poses it has, where the laser is mounted away from
/// the robot's origin.
pub(crate) fn of_unknown_frame(options: &ReadOptions, robot_from_laser: Pose2) -> Option<String> {
    let track = options.reference_track.as_ref()?;
    let is_known = options.reference_frame.is_some() || track.frame.is_some();
    let Pose2 { x, y, theta } = robot_from_laser;
    let matters = !is_known && [x, y, theta].iter().any(|part| part.abs() > NO_MOUNT);
    matters.then(|| {
        format!(
            "reference: {} does not say whose poses it has; they are taken to be the robot's, on which the \
             laser is mounted at {x:.3} m, {y:.3} m, {theta:.3} rad (--reference-frame robot or laser states it)",
            track.name
        )
    })
}

/// Sets the reference poses of a log's scans from a track, at their stamps.
pub(crate) fn replace(log: &mut Log, track: &ReferenceTrack, options: &ReadOptions) {
    let frame = options.reference_frame.as_deref().or(track.frame.as_deref()).unwrap_or(ROBOT[0]);
    let (mount, whose) = match frame {
        LASER => (Pose2::IDENTITY, LASER),
        frame => (log.recording.robot_from_laser, frame),
    };
    log.report.doubts.extend(of_unknown_frame(options, log.recording.robot_from_laser));
    if frame != LASER && !ROBOT.contains(&frame) {
        log.report.doubts.push(format!(
            "reference: its poses are of frame {frame:?}, but the log names no frames; they are taken as poses of the robot (--reference-frame robot or laser changes this)"
        ));
    }
    let longest = options.longest_gap.map(|seconds| (seconds * NANOSECONDS) as i64);
    let name = &track.name;
    log.report
        .doubts
        .extend(track.doubt.as_ref().map(|doubt| format!("reference: {name}: {doubt}")));
    let times: Vec<i64> = track.trajectory.stamps().iter().map(|at| at.nanoseconds()).collect();
    let stretches = stretches_of_file(&times).last().map_or(0, |last| last + 1);
    let samples =
        track.trajectory.iter().map(|(stamp, pose)| (Moment::only(stamp), pose)).collect();
    let stamps = log.recording.scans.iter().filter_map(|scan| scan.stamp);
    let moments: Vec<Moment> = stamps.map(Moment::only).collect();
    let mut numbered = occurrences(&moments).into_iter();
    let poses = match stretches {
        0 | 1 => PoseTrack::new(samples, longest),
        _ => {
            log.report.doubts.push(goes_over_again(name, stretches, 1));
            None
        }
    };
    let mut poses =
        poses.map(|poses| Track::new(poses, REFERENCE, &moments, &occurrences(&moments)));
    let scans = &mut log.recording.scans;
    let unstamped = scans.len() - moments.len();
    for scan in scans {
        scan.map_from_laser = scan.stamp.and_then(|at| {
            let occurrence = numbered.next()?;
            Some(poses.as_mut()?.at(Moment::only(at), occurrence)?.compose(&mount))
        });
    }
    if let Some(poses) = &poses {
        let TrackRemarks { doubts, assumptions } = poses.remarks(&moments);
        log.report.doubts.extend(doubts);
        log.assumptions.extend(assumptions);
    }
    if unstamped > 0 {
        log.report.doubts.push(format!(
            "reference: {} without a stamp, so that no pose of {name} is theirs",
            counted(unstamped, "scan")
        ));
    }
    if log.recording.scans.iter().all(|scan| scan.map_from_laser.is_none()) {
        log.reference = None;
        return;
    }
    let count = counted(track.trajectory.len(), "pose");
    log.reference = Some(format!("{name}, {count} of {whose:?}"));
}
