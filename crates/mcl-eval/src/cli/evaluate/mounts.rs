//! Whose poses a trajectory has, and the mounts that lead to others of the robot.

use std::collections::BTreeMap;

use mcl_core::Pose2;
use serde::Serialize;

use crate::cli::args::Whose;

/// Frames that are fixed to each other: the pose of each in one of them.
#[derive(Debug, Clone, Default)]
pub struct Mounts(BTreeMap<Whose, Pose2>);

impl Mounts {
    /// For a robot with a laser at this pose.
    pub fn of_laser(robot_from_laser: Pose2) -> Self {
        Mounts([(Whose::Robot, Pose2::IDENTITY), (Whose::Laser, robot_from_laser)].into())
    }

    pub fn insert(&mut self, whose: Whose, pose: Pose2) {
        self.0.insert(whose, pose);
    }

    pub fn get(&self, whose: &Whose) -> Option<Pose2> {
        self.0.get(whose).copied()
    }

    /// The poses of all frames.
    pub fn poses(&self) -> impl Iterator<Item = &Pose2> {
        self.0.values()
    }

    /// The pose of the second in the frame of the first.
    pub fn between(&self, from: &Whose, to: &Whose) -> Option<Pose2> {
        Some(self.get(from)?.between(&self.get(to)?))
    }
}

/// The frames of a side, for the report.
#[derive(Debug, Clone, Serialize)]
pub struct SideFrames {
    /// Whose poses the file has: `robot`, `laser` or the name of a frame; null if not known.
    pub of: Option<String>,
    /// The frame that they are in (`header.frame_id`), or into which the bag's transforms converted them.
    pub within: Option<String>,
    /// The frame that they were in before that.
    pub carried_from: Option<String>,
}

/// A name as in options and JSON.
pub fn name_of(whose: &Whose) -> String {
    match whose {
        Whose::Robot => "robot".to_owned(),
        Whose::Laser => "laser".to_owned(),
        Whose::Frame(name) => name.clone(),
    }
}
