//! A reference from elsewhere for a log whose own poses stand beside its scans.

use mcl_core::{Pose2, Stamp, Trajectory};

use crate::bag::moment::Moment;
use crate::bag::track::{Placed, PoseTrack};
use crate::log::content::Log;
use crate::log::options::{ReadOptions, ReferenceTrack};

const NANOSECONDS: f64 = 1e9;
const LASER: &str = "laser";
/// Names of the robot, and what its frame is usually called.
const ROBOT: [&str; 3] = ["robot", "base_link", "base_footprint"];

const fn moment(stamp: Stamp) -> Moment {
    Moment { stretch: 0, at: stamp.nanoseconds() }
}

/// The pose of a trajectory at each stamp: that of the same stamp, of several the last; else between the two neighbours,
/// on the line between the positions and on the shorter arc between the headings. Nothing is extrapolated, nor
/// interpolated over more than five usual intervals of the trajectory (and 0.2 s).
pub fn poses_at(trajectory: &Trajectory, stamps: &[Stamp]) -> Vec<Option<Pose2>> {
    const LAST: usize = u32::MAX as usize;
    let samples = trajectory.iter().map(|(stamp, pose)| (moment(stamp), pose)).collect();
    let track = PoseTrack::new(samples, None);
    let pose = |&stamp: &Stamp| match track.as_ref()?.at(moment(stamp), LAST) {
        Placed::At(pose) => Some(pose),
        Placed::Outside | Placed::InGap(_) => None,
    };
    stamps.iter().map(pose).collect()
}

/// Takes the reference poses of a log's scans from a track, at their stamps.
pub(crate) fn replace(log: &mut Log, track: &ReferenceTrack, options: &ReadOptions) {
    let frame = options.reference_frame.as_deref().or(track.frame.as_deref()).unwrap_or(ROBOT[0]);
    let (mount, whose) = match frame {
        LASER => (Pose2::IDENTITY, LASER),
        frame => (log.recording.robot_from_laser, frame),
    };
    if frame != LASER && !ROBOT.contains(&frame) {
        log.report.doubts.push(format!(
            "reference: its poses are of frame {frame:?}, and the log says nothing of frames; they are taken to be the robot's (--reference-frame robot or laser says otherwise)"
        ));
    }
    let longest = options.longest_gap.map(|seconds| (seconds * NANOSECONDS) as i64);
    let samples = track.trajectory.iter().map(|(stamp, pose)| (moment(stamp), pose)).collect();
    let poses = PoseTrack::new(samples, longest);
    let mut without = 0;
    for scan in &mut log.recording.scans {
        let placed = scan.stamp.zip(poses.as_ref()).map(|(at, poses)| poses.at(moment(at), 0));
        scan.map_from_laser = match placed {
            Some(Placed::At(pose)) => Some(pose.compose(&mount)),
            _ => None,
        };
        without += usize::from(scan.map_from_laser.is_none());
    }
    let scans = &log.recording.scans;
    if without == scans.len() {
        let span = |stamps: &mut dyn Iterator<Item = Stamp>| {
            let stamps: Vec<Stamp> = stamps.collect();
            match (stamps.iter().min(), stamps.iter().max()) {
                (Some(first), Some(last)) => format!("from {first} s to {last} s"),
                _ => "without stamps".to_owned(),
            }
        };
        log.report.doubts.push(format!(
            "reference: {} lasts {}, the scans {}, so no scan has any; were they stamped by different clocks?",
            track.name,
            span(&mut track.trajectory.stamps().iter().copied()),
            span(&mut scans.iter().filter_map(|scan| scan.stamp)),
        ));
    } else if without > 0 {
        log.assumptions.push(format!(
            "{without} of {} scans lie before or after the reference or in a gap of it: nothing is extrapolated, so they have none",
            scans.len()
        ));
    }
    let count = track.trajectory.len();
    log.reference = Some(format!("{}, {count} poses of {whose:?}", track.name));
}
