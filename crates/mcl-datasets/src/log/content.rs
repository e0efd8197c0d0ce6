//! A log as read, whatever its format.

use std::fmt;

use mcl_core::Recording;
use serde::{Deserialize, Serialize};

use crate::bag::survey::Survey;
use crate::log::report::ReadReport;

/// A log as read: the recording, and how it was read.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Log {
    /// Scans with their stamps, reference poses and odometry increments.
    pub recording: Recording,
    /// Where the reference and the odometry come from.
    pub kind: LogKind,
    /// What was ignored, skipped or unusable.
    pub report: ReadReport,
    /// Distance of the front laser ahead of the robot's centre according to the log (metres; `PARAM
    /// robot_frontlaser_offset` of CARMEN), where stated. The mount in `recording` follows it where the poses
    /// of the log leave the mount open.
    pub front_laser_offset: Option<f64>,
    /// The reference that was used, and the frame of its poses; `None` without one.
    pub reference: Option<String>,
    /// How a bag was read, a line each: its topics, the mount of the laser.
    pub notes: Vec<String>,
    /// The topics of a bag, and which of them were read.
    pub survey: Option<Survey>,
    /// What a bag leaves open, and what was assumed, a line each: no mount, no stamps, scans outside of the
    /// odometry.
    pub assumptions: Vec<String>,
}

/// Where the reference poses and the odometry of a log come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogKind {
    /// Laser poses are corrected (the reference), and so are the odometry fields beside them; raw odometry,
    /// where the log has any, is in odometry records between the scans.
    GfsCorrected,
    /// Laser poses are corrected (the reference); the odometry fields beside them are raw.
    CorrectedWithOdometry,
    /// Laser poses are raw odometry, at a fixed mount on the robot; there is no reference.
    Raw,
    /// As [`LogKind::Raw`], with the true poses of a simulator in records of their own.
    RawWithTruth,
    /// A bag: odometry and, where it has them, reference poses from topics of their own.
    Bag,
}

impl fmt::Display for LogKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LogKind::GfsCorrected => "corrected log, raw odometry between the scans",
            LogKind::CorrectedWithOdometry => "corrected log, raw odometry beside each laser pose",
            LogKind::Raw => "raw log, no reference poses",
            LogKind::RawWithTruth => "raw log, reference poses of TRUEPOS records",
            LogKind::Bag => "bag",
        })
    }
}
