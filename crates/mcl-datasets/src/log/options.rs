//! How to read a log, where its content leaves that open.

use std::fmt;
use std::str::FromStr;

use mcl_core::{Pose2, Trajectory};
use serde::{Deserialize, Serialize};

/// Whether the laser poses written in a log are taken as ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferencePoses {
    /// As the content of the log tells.
    #[default]
    Auto,
    /// They are ground truth, even when the log does not look corrected.
    Recorded,
    /// They are not: the recording gets no reference poses.
    None,
}

impl ReferencePoses {
    /// The name used in settings files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            ReferencePoses::Auto => "auto",
            ReferencePoses::Recorded => "recorded",
            ReferencePoses::None => "none",
        }
    }
}

impl fmt::Display for ReferencePoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A text that names none of [`ReferencePoses`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no choice of reference poses, expected auto, recorded or none")]
pub struct ParseReferencePosesError(String);

impl FromStr for ReferencePoses {
    type Err = ParseReferencePosesError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        [ReferencePoses::Auto, ReferencePoses::Recorded, ReferencePoses::None]
            .into_iter()
            .find(|choice| choice.name() == text)
            .ok_or_else(|| ParseReferencePosesError(text.to_owned()))
    }
}

/// Topics to read of a bag, where their types do not tell which are meant.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicChoice {
    /// Topic of the scans (`sensor_msgs/LaserScan` or `MultiEchoLaserScan`). Of a CARMEN log the kind of
    /// their records, `RLASER` and `ROBOTLASER2` among them.
    pub scan: Option<String>,
    /// Topic of the odometry (`nav_msgs/Odometry`).
    pub odometry: Option<String>,
    /// Topic of the reference poses (`geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped` or
    /// `TransformStamped`, `nav_msgs/Odometry` or `Path`), or two frames of transforms
    /// (`/tf:map.base_link`).
    pub reference: Option<String>,
}

/// How to read a log, where its content leaves that open. All but the two on the reference, and
/// `longest_gap` for a track from elsewhere, is of bags.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadOptions {
    /// Whether the poses in the log are ground truth. For a bag: whether to use reference poses if it
    /// has them, to insist on them, or not to use them.
    pub reference: ReferencePoses,
    /// Poses from elsewhere that are the reference, whatever the log itself has.
    pub reference_track: Option<ReferenceTrack>,
    /// Topics of a bag.
    pub topics: TopicChoice,
    /// Makes scans of point clouds: heights (m) in the robot's frame, from the first to the second.
    pub slice: Option<(f64, f64)>,
    /// The robot's frame.
    pub base_frame: Option<String>,
    /// The frame of the odometry, where `/tf` alone tells it.
    pub odometry_frame: Option<String>,
    /// Whose poses the reference has: `robot`, `laser` or the name of a frame.
    pub reference_frame: Option<String>,
    /// How the laser sits on the robot.
    pub laser_pose: Option<LaserPose>,
    /// The longest time (s) between two poses to be interpolated over; a few times the usual one, where
    /// this says nothing.
    pub longest_gap: Option<f64>,
    /// Takes the beams of a scan as measured at once, at its stamp, however long it took.
    pub no_deskew: bool,
}

/// Reference poses that are not in the log: of a file of its own, or of another bag.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceTrack {
    /// Where they are from, for messages.
    pub name: String,
    /// Stamped poses in the map's frame.
    pub trajectory: Trajectory,
    /// What of it is in doubt.
    pub doubt: Option<String>,
    /// The frame whose poses they are, where their file says so; else they are the robot's. `laser` is the
    /// laser.
    pub frame: Option<String>,
}

/// How the laser sits on the robot, where the log does not say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaserPose {
    /// Carries coordinates of the laser's frame into the robot's.
    pub robot_from_laser: Pose2,
    /// How far it is turned about its own x axis, in radians: π is upside down.
    pub roll: f64,
}

impl From<ReferencePoses> for ReadOptions {
    fn from(reference: ReferencePoses) -> Self {
        ReadOptions { reference, ..ReadOptions::default() }
    }
}
