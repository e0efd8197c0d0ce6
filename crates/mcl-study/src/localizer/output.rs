//! The output of a program.

use std::fs;
use std::path::{Path, PathBuf};

use mcl_core::{MAX_COORDINATE, Pose2, Stamp, Trajectory};
use mcl_datasets::bag::{LASER_FRAME, MAP_FRAME, PoseRequest, PoseRole};
use mcl_datasets::log::{is_bag, poses_at, read_poses};
use mcl_metrics::tum::{self, NonPlanar, TumError};

use crate::localizer::input::OUTPUT;
use crate::recipe::localizer::Whose;

/// Why there are no poses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Missing {
    /// Nothing was written.
    Nothing,
    /// The output cannot be used, for this reason.
    Malformed(String),
}

/// Poses written by a program, sorted by stamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The poses.
    pub trajectory: Trajectory,
    /// The frame whose poses they are.
    pub whose: Whose,
}

/// A stamp that differs from a scan's by at most this (ns) is the scan's: programs write times as floats.
const ROUNDING: i64 = 1_000_000;
/// No mapped place is farther away (m); sums of such coordinates lose millimetres.
const FARTHEST: f64 = 0.5 * MAX_COORDINATE;
/// Length limit of a reason, in characters.
const LONGEST: usize = 160;

/// Reads the output that a program wrote into a folder: a trajectory in the TUM format, or a bag. `is_whole`
/// says whether the program ended by itself: one that was stopped may have left an incomplete line, which is
/// ignored.
///
/// # Errors
/// Why there are no poses.
pub fn read(folder: &Path, poses: Whose, is_whole: bool) -> Result<Estimate, Missing> {
    let malformed =
        |why: &dyn std::fmt::Display| Missing::Malformed(shortened(&why.to_string(), folder));
    let path = written(folder).ok_or(Missing::Nothing)?;
    check_regular(&path).map_err(|why| malformed(&why))?;
    let (trajectory, whose) = if path.is_dir() || is_bag(&path).map_err(|e| malformed(&e))? {
        let request = PoseRequest { into: Some(MAP_FRAME), ..PoseRequest::of(PoseRole::Estimate) };
        let found = read_poses(&path, &request).map_err(|e| malformed(&e))?;
        let is_laser = found.frame.as_deref() == Some(LASER_FRAME);
        (found.trajectory, if is_laser { Whose::Laser } else { poses })
    } else {
        let mut bytes = fs::read(&path).map_err(|e| malformed(&e))?;
        if !is_whole {
            let end = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |last| last + 1);
            bytes.truncate(end);
        }
        let found = tum::read(&bytes[..], OUTPUT, NonPlanar::Project);
        match found {
            Ok(found) => (found.trajectory, poses),
            Err(TumError::Empty { .. }) => return Err(Missing::Nothing),
            Err(error) => return Err(malformed(&error)),
        }
    };
    if trajectory.is_empty() {
        return Err(Missing::Nothing);
    }
    let steps_back = trajectory.stamps().windows(2).position(|pair| pair[1] < pair[0]);
    if let Some(pose) = steps_back {
        let [before, after] = [trajectory.stamps()[pose], trajectory.stamps()[pose + 1]];
        return Err(malformed(&format!("pose {}: its stamp {after} is before {before}", pose + 2)));
    }
    let is_far = |pose: &Pose2| !pose.is_finite() || pose.x.abs().max(pose.y.abs()) > FARTHEST;
    if let Some(place) = trajectory.poses().iter().position(is_far) {
        let Pose2 { x, y, theta } = trajectory.poses()[place];
        let expected = format!("at most {FARTHEST:e} m from the origin");
        return Err(malformed(&format!(
            "pose {}: {x}, {y}, {theta}; expected {expected}",
            place + 1
        )));
    }
    Ok(Estimate { trajectory, whose })
}

/// The file or folder of the output; the one with an ending if there is one.
fn written(folder: &Path) -> Option<PathBuf> {
    let path = folder.join(OUTPUT);
    if path.exists() {
        return Some(path);
    }
    let is_named = |path: &PathBuf| path.file_stem().is_some_and(|stem| stem == OUTPUT);
    let mut found = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).filter(is_named);
    found.next().filter(|_| found.next().is_none())
}

/// Only files and folders are read: a pipe may never end, and limits do not hold for the target of a link.
fn check_regular(path: &Path) -> Result<(), String> {
    let kind = fs::symlink_metadata(path).map_err(|error| error.to_string())?.file_type();
    if kind.is_dir() {
        let entries = fs::read_dir(path).map_err(|error| error.to_string())?;
        return entries.flatten().try_for_each(|entry| check_regular(&entry.path()));
    }
    match kind.is_file() {
        true => Ok(()),
        false => Err(format!("{} is neither a file nor a folder", path.display())),
    }
}

/// The reason in one line, independent of the folder.
fn shortened(reason: &str, folder: &Path) -> String {
    let place = format!("{}/", folder.display());
    let reason = reason.replace(&place, "").split_whitespace().collect::<Vec<_>>().join(" ");
    match reason.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} …", &reason[..end]),
        None => reason,
    }
}

impl Estimate {
    /// The estimated pose of the laser at each of these increasing stamps: that of the same stamp, else
    /// interpolated between its neighbours ([`poses_at`]). Of several poses with the same stamp the last
    /// counts.
    pub fn lasers_at(&self, stamps: &[Stamp], robot_from_laser: Pose2) -> Vec<Option<Pose2>> {
        let intervals = stamps.windows(2).map(|pair| pair[1].nanoseconds() - pair[0].nanoseconds());
        let tolerance = (intervals.min().unwrap_or(ROUNDING) / 4).min(ROUNDING);
        let snapped = |at: Stamp| {
            let after = stamps.partition_point(|&stamp| stamp < at);
            let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
            let near = near.filter_map(|place| stamps.get(place));
            let off = |stamp: &Stamp| (stamp.nanoseconds() - at.nanoseconds()).abs();
            near.filter(|stamp| off(stamp) <= tolerance)
                .min_by_key(|stamp| off(stamp))
                .copied()
                .unwrap_or(at)
        };
        let poses = self.trajectory.iter().map(|(at, pose)| (snapped(at), pose)).collect();
        let carry = match self.whose {
            Whose::Robot => robot_from_laser,
            Whose::Laser => Pose2::IDENTITY,
        };
        let found = poses_at(&poses, stamps).into_iter();
        found.map(|pose| Some(pose?.compose(&carry))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(text: &str, is_whole: bool) -> Result<Estimate, Missing> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(OUTPUT), text).unwrap();
        read(folder.path(), Whose::Robot, is_whole)
    }

    #[test]
    fn incomplete_lines_are_ignored_only_of_stopped_programs() {
        let text = "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n3 1 0";
        assert_eq!(tried(text, false).unwrap().trajectory.len(), 2);
        let Err(Missing::Malformed(reason)) = tried(text, true) else { panic!("accepted") };
        assert!(reason.starts_with("estimate, line 3: 3 fields"), "{reason}");
        assert_eq!(tried("1 0 0", false), Err(Missing::Nothing));
        assert_eq!(tried("# nothing\n", true), Err(Missing::Nothing));
    }

    #[test]
    fn malformed_poses_are_named() {
        for (text, named) in [
            ("1 nan 0 0 0 0 0 1\n", "line 1, field x"),
            ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "pose 2: its stamp 1.000000000 is before 2.0"),
            ("\u{1}\u{2}", "line 1"),
            ("1 0 0 0 0 0 0 1\n2 1e200 0 0 0 0 0 1\n", "pose 2: 1"),
        ] {
            let Err(Missing::Malformed(reason)) = tried(text, true) else { panic!("{text}") };
            assert!(reason.contains(named), "{reason}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read(folder.path(), Whose::Robot, true), Err(Missing::Nothing));
    }

    #[test]
    fn poses_are_matched_by_stamp_or_lie_between_their_neighbours() {
        let text =
            "1.0000001 0 0 0 0 0 0 1\n1.2 2 0 0 0 0 0 1\n1.2 4 0 0 0 0 0 1\n1.5 5 0 0 0 0 0 1\n";
        let estimate = tried(text, true).unwrap();
        let stamps: Vec<Stamp> = [1.0, 1.1, 1.2, 1.6]
            .map(|at: f64| Stamp::from_nanoseconds((at * 1e9).round() as i64))
            .to_vec();
        let found = estimate.lasers_at(&stamps, Pose2::new(0.5, 0.0, 0.0));
        let x: Vec<Option<f64>> = found.iter().map(|pose| pose.map(|pose| pose.x)).collect();
        assert_eq!((x[0], x[2], x[3]), (Some(0.5), Some(4.5), None));
        assert!(x[1].is_some_and(|x| (1.5..=2.5).contains(&x)), "{x:?}");
    }
}
