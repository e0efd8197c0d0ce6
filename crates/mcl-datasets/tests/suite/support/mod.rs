//! Logs built in code, line by line.

use std::fmt::Display;

use mcl_core::{Pose2, wrap_angle};
use mcl_datasets::carmen;
use mcl_datasets::log::{Log, ReferencePoses};

pub const ORIGIN: Pose2 = Pose2::IDENTITY;

pub fn pose(x: f64, y: f64, theta: f64) -> Pose2 {
    Pose2::new(x, y, theta)
}

/// A `FLASER` line of `ranges.len()` readings.
pub fn flaser(ranges: &[f64], laser: Pose2, robot: Pose2, stamp: impl Display) -> String {
    let ranges: String = ranges.iter().map(|range| format!(" {range}")).collect();
    let beams = ranges.split_ascii_whitespace().count();
    format!("FLASER {beams}{ranges}{}{} {stamp} pippo {stamp}\n", text(laser), text(robot))
}

/// A `FLASER` line of 180 readings of 1 m whose two poses are equal.
pub fn scan(pose: Pose2, stamp: impl Display) -> String {
    flaser(&[1.0; 180], pose, pose, stamp)
}

/// A `ROBOTLASER1` line of three beams at −60°, 0° and 60°, in radians of the usual six digits.
pub fn robot_laser(laser: Pose2, robot: Pose2, stamp: impl Display) -> String {
    format!(
        "ROBOTLASER1 0 -1.047198 2.094395 1.047198 80.0 0.01 0 3 1.5 2.5 81.91 0{}{} 0 0 0 0 0 {stamp} pippo {stamp}\n",
        text(laser),
        text(robot)
    )
}

pub fn odom(pose: Pose2) -> String {
    format!("ODOM{} 0 0 0 1.5 pippo 1.5\n", text(pose))
}

/// An `ODOM` line with the stamp of uninitialised memory.
pub fn restart(pose: Pose2) -> String {
    format!("ODOM{} 0 0 0 6.9e-310 pippo 6.9e-310\n", text(pose))
}

fn text(pose: Pose2) -> String {
    format!(" {} {} {}", pose.x, pose.y, pose.theta)
}

pub fn read(text: &str) -> Log {
    read_as(text, ReferencePoses::Auto)
}

pub fn read_as(text: &str, reference: ReferencePoses) -> Log {
    carmen::read(text.as_bytes(), "test.log", reference).unwrap()
}

/// Odometry increments of all scans.
pub fn increments(log: &Log) -> Vec<Option<Pose2>> {
    log.recording.scans.iter().map(|scan| scan.odometry).collect()
}

#[track_caller]
pub fn assert_close(found: Option<Pose2>, expected: Pose2, tolerance: f64) {
    let found = found.expect("a pose");
    assert!(
        found.distance(&expected) <= tolerance
            && wrap_angle(found.theta - expected.theta).abs() <= tolerance,
        "{found:?}, expected {expected:?}"
    );
}

/// A corrected log of four scans: corrected poses, and the raw increments between them.
pub struct Corrected {
    pub poses: [Pose2; 4],
    pub raw: [Pose2; 3],
}

pub fn corrected() -> Corrected {
    Corrected {
        poses: [
            pose(0.5, -0.25, 0.1),
            pose(1.5, 0.0, 0.3),
            pose(2.25, 0.5, -0.2),
            pose(3.0, 0.25, 3.1),
        ],
        raw: [pose(1.0, 0.125, 0.25), pose(0.75, 0.5, -0.5), pose(0.5, -0.25, -2.9)],
    }
}

impl Corrected {
    /// Lines of the gap after scan `k`: the restart, a line half way, and the last line.
    pub fn gap(&self, k: usize) -> String {
        let step = self.raw[k];
        let half = pose(0.5 * step.x, 0.5 * step.y, 0.5 * step.theta);
        restart(self.poses[k])
            + &odom(self.poses[k].compose(&half))
            + &odom(self.poses[k].compose(&step))
    }

    pub fn scan(&self, k: usize) -> String {
        scan(self.poses[k], 10 + k)
    }

    pub fn text(&self) -> String {
        let mut text = odom(ORIGIN) + &odom(pose(0.25, 0.0, 0.0)) + &self.scan(0);
        for k in 0..3 {
            text += &self.gap(k);
            text += &self.scan(k + 1);
        }
        text
    }
}
