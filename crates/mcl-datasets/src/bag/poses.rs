//! The poses of one topic of a bag, as a trajectory.

use mcl_core::{Pose2, Stamp, Trajectory};

use super::content::{Content, Kind};
use super::decoder::{Decoder, Logged, time, tree};
use super::error::BagError;
use super::messages::{PoseMessage, ScanMessage};
use super::moment::Stretches;
use super::topics::{Pair, PoseRole, pose_topic, transform_topics};
use crate::log::report::ReadReport;

/// A pose topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseTopic {
    /// Its name.
    pub name: String,
    /// Its poses in the frame of its messages, seen from above, in the order of the bag; at the stamps
    /// of the headers, or of logging where a header's is zero.
    pub trajectory: Trajectory,
    /// The frame whose poses they are: of an Odometry topic its `child_frame_id`, else that of the
    /// bag's odometry, else the first of `base_link` and `base_footprint` that the laser is fixed to.
    pub frame: Option<String>,
    /// Mount of the bag's laser on that frame; `None` if the bag has no scans, scans on several topics,
    /// or no transforms that lead there.
    pub frame_from_laser: Option<Pose2>,
    /// What was not used.
    pub report: ReadReport,
}

pub(crate) fn poses(
    mut content: Content,
    asked: Option<&str>,
    role: PoseRole,
) -> Result<PoseTopic, BagError> {
    let messages = std::mem::take(&mut content.messages);
    let content = &content;
    let name = pose_topic(content, asked, role)?;
    let pair = Pair::of(name).filter(|_| content.topics.iter().all(|topic| topic.name != name));
    let mut decoder = Decoder::new(content, messages);
    let messages = if pair.is_none() { decoder.poses(name)? } else { Vec::new() };
    let sample = |logged: &Logged<PoseMessage>| {
        let at = time(logged.value.header.stamp, logged.log_time);
        (Stamp::from_nanoseconds(at), logged.value.pose)
    };
    let mut trajectory: Trajectory = messages.iter().map(sample).collect();
    let mut child = messages.first().and_then(|logged| logged.value.child.clone());
    let mut report = decoder.report.clone();
    // What follows only asks where the laser is; what it loses is not of this topic.
    let scan_topics = content.names(&[Kind::Scan, Kind::MultiEcho]);
    let laser = match scan_topics.as_slice() {
        &[only] => {
            let scans = decoder.scans(only, ScanMessage::new)?;
            scans.first().map(|scan| scan.value.header.frame.clone())
        }
        _ => None,
    };
    let of = pair.map(|pair| pair.topic).or(scan_topics.first().copied());
    let transforms = decoder.transforms(&transform_topics(content, of))?;
    let mut tree = tree(&transforms, &Stretches::default());
    tree.sort(None);
    if let Some(pair) = pair {
        let poses = pair.frames(|frame| tree.knows(frame)).and_then(|(parent, frame)| {
            child = Some(frame.to_owned());
            tree.poses(parent, frame)
        });
        let Some(poses) = poses else {
            return Err(BagError::NoPair { topic: name.to_owned(), frames: tree.frames() });
        };
        let sample = |(moment, pose): (super::moment::Moment, Pose2)| {
            (Stamp::from_nanoseconds(moment.at), pose)
        };
        trajectory = poses.into_iter().map(sample).collect();
        report = decoder.report.clone();
    }
    let frame = match child.filter(|child| !child.is_empty()) {
        Some(child) => Some(child),
        None => {
            decoder.odometry_frame()?.or_else(|| Some(tree.base_of(laser.as_deref()?)?.to_owned()))
        }
    };
    let frame_from_laser = match (&frame, &laser) {
        (Some(frame), Some(laser)) => tree.mount(frame, laser)?.map(|mount| mount.robot_from_laser),
        _ => None,
    };
    Ok(PoseTopic { name: name.to_owned(), trajectory, frame, frame_from_laser, report })
}
