//! Options for reading a log, where its content is inconclusive.

use std::fmt;
use std::str::FromStr;

use mcl_core::{Pose2, Trajectory};
use serde::{Deserialize, Serialize};

/// Whether the laser poses written in a log are taken as ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReferencePoses {
    /// Decided from the content of the log.
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

/// A text that is not the name of one of [`ReferencePoses`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a choice of reference poses, expected auto, recorded or none")]
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

/// Topics to read from a bag, where their types leave open which are meant.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicChoice {
    /// Topic of the scans (`sensor_msgs/LaserScan` or `MultiEchoLaserScan`). For a CARMEN log the kind of
    /// scan records, including `RLASER` and `ROBOTLASER2`.
    pub scan: Option<String>,
    /// Topic of the odometry (`nav_msgs/Odometry`).
    pub odometry: Option<String>,
    /// Topic of the reference poses (`geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped` or
    /// `TransformStamped`, `nav_msgs/Odometry` or `Path`), or two frames of transforms
    /// (`/tf:map.base_link`).
    pub reference: Option<String>,
}

/// Options for reading a log, where its content is inconclusive. All but the two on the reference, and
/// `longest_gap` for an external track, apply to bags only.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadOptions {
    /// Whether the poses in the log are ground truth. For a bag: whether reference poses are used where
    /// available, required, or not used.
    pub reference: ReferencePoses,
    /// External poses that replace any reference of the log.
    pub reference_track: Option<ReferenceTrack>,
    /// Topics of a bag.
    pub topics: TopicChoice,
    /// Makes scans of point clouds: heights (m) in the robot's frame, from the first to the second.
    pub slice: Option<(f64, f64)>,
    /// The robot's frame.
    pub base_frame: Option<String>,
    /// The frame of the odometry, where it is in `/tf` only.
    pub odometry_frame: Option<String>,
    /// The child frame of the reference: `robot`, `laser` or the name of a frame.
    pub reference_frame: Option<String>,
    /// The mount of the laser on the robot.
    pub laser_pose: Option<LaserPose>,
    /// The longest time (s) between two poses to interpolate over; `None` for a few times the usual interval.
    pub longest_gap: Option<f64>,
    /// Treats the beams of a scan as measured at once, at its stamp.
    pub no_deskew: bool,
}

/// Reference poses that are not in the log: from a separate file, or from another bag.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceTrack {
    /// Their source, for messages.
    pub name: String,
    /// Stamped poses in the map's frame.
    pub trajectory: Trajectory,
    /// A doubt about them, if any.
    pub doubt: Option<String>,
    /// Their child frame, where the file states it; otherwise they are the robot's. `laser` stands for the
    /// laser.
    pub frame: Option<String>,
}

/// The mount of the laser on the robot, where the log does not have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaserPose {
    /// Maps coordinates of the laser's frame to the robot's.
    pub robot_from_laser: Pose2,
    /// Rotation about the laser's own x axis, in radians: π is upside down.
    pub roll: f64,
}

impl From<ReferencePoses> for ReadOptions {
    fn from(reference: ReferencePoses) -> Self {
        ReadOptions { reference, ..ReadOptions::default() }
    }
}
