//! The poses of one topic of a bag, as a trajectory.

use std::collections::BTreeMap;

use mcl_core::{Pose2, Stamp, Trajectory, math};

use super::content::{Content, MessageKind};
use super::decoder::{Decoder, Logged, time, tree};
use super::error::BagError;
use super::messages::{Covariance, PoseMessage, ScanMessage, planar};
use super::moment::{Moment, Stretches};
use super::motion::Motion;
use super::topics::{Pair, PoseRole, PosesAt, pose_topic, transform_topics};
use crate::log::plane::out_of_plane;
use crate::log::report::ReadReport;

/// A request for poses of a bag.
#[derive(Debug, Clone, Copy)]
pub struct PoseRequest<'a> {
    /// The topic, a pair of frames (`/tf:map.base_link`), or the topic of the transforms; `None` selects it
    /// by types and names.
    pub topic: Option<&'a str>,
    /// What the poses are wanted for.
    pub role: PoseRole,
    /// The frame to transform the poses into, if the bag's transforms lead there. Poses of a pair of frames
    /// stay in its first, and odometry in its own frame: transformed to the map, it would include a
    /// localizer's correction.
    pub into: Option<&'a str>,
}

impl PoseRequest<'_> {
    /// A request for the poses selected by types and names, in the frame of their messages.
    pub fn of(role: PoseRole) -> Self {
        PoseRequest { topic: None, role, into: None }
    }
}

/// A pose topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseTopic {
    /// Its name.
    pub name: String,
    /// Its poses in the frame of its messages or the requested one, seen from above, in the order of the bag;
    /// at the stamps of the headers, or the log times where a header's stamp is zero.
    pub trajectory: Trajectory,
    /// The covariance of each pose, along the axes of the frame that the poses are in (x and y in m, heading in
    /// rad); empty where no message has one.
    pub covariances: Vec<Option<Covariance>>,
    /// The frame that the poses are in; `None` where the messages leave it empty.
    pub parent: Option<String>,
    /// The frame of the messages, where the poses were transformed from there into `parent`.
    pub carried_from: Option<String>,
    /// The frame whose poses they are: of an Odometry topic its `child_frame_id`, else that of the
    /// bag's odometry, else the first of `base_link` and `base_footprint` that the laser is fixed to.
    pub frame: Option<String>,
    /// Mount of the bag's laser on that frame; `None` if the bag has no scans, scans on several topics,
    /// or no transforms that lead there.
    pub frame_from_laser: Option<Pose2>,
    /// Mounts of all frames that are fixed to `frame`, by name.
    pub mounts: BTreeMap<String, Pose2>,
    /// Remark on poses that do not lie in the plane; only for a topic of poses.
    pub out_of_plane: Option<String>,
    /// What was skipped.
    pub report: ReadReport,
}

/// A pose and its covariance.
struct Sample {
    stamp: i64,
    pose: Pose2,
    covariance: Option<Covariance>,
}

pub(crate) fn poses(
    mut content: Content,
    request: &PoseRequest<'_>,
) -> Result<PoseTopic, BagError> {
    let messages = std::mem::take(&mut content.messages);
    let content = &content;
    let place = pose_topic(content, request.topic, request.role)?;
    let mut decoder = Decoder::new(content, messages);
    let messages = match place {
        PosesAt::Topic(name) => decoder.poses(name)?,
        PosesAt::Pair(_) | PosesAt::Transforms => Vec::new(),
    };
    let named = |name: &str| (!name.is_empty()).then(|| name.to_owned());
    let sample = |Logged { value, log_time, .. }: &Logged<PoseMessage>| Sample {
        stamp: time(value.header.stamp, *log_time),
        pose: value.pose,
        covariance: value.covariance,
    };
    let mut samples: Vec<Sample> = messages.iter().map(sample).collect();
    let first = messages.first().map(|logged| &logged.value);
    let mut parent = first.and_then(|pose| named(&pose.header.frame));
    let mut child = first.and_then(|pose| named(pose.child.as_deref()?));
    let mut report = decoder.report.clone();
    // The rest only needs the mount of the laser; losses on scan topics do not concern this topic.
    let scan_topics = content.names(&[MessageKind::Scan, MessageKind::MultiEcho]);
    let laser = match scan_topics.as_slice() {
        &[only] => {
            let scans = decoder.scans(only, ScanMessage::new)?;
            scans.first().map(|scan| scan.value.header.frame.clone())
        }
        _ => None,
    };
    let of = match place {
        PosesAt::Pair(pair) => Some(pair.topic),
        PosesAt::Topic(_) | PosesAt::Transforms => scan_topics.first().copied(),
    };
    let transforms = decoder.transforms(&transform_topics(content, of))?;
    let mut tree = tree(&transforms, &Stretches::default());
    tree.sort(None);
    let name = match place {
        PosesAt::Topic(name) => name.to_owned(),
        PosesAt::Pair(_) | PosesAt::Transforms => {
            let (name, frames, poses) = of_transforms(place, request.topic, &tree)?;
            let sample = |(moment, pose): (Moment, Pose2)| Sample {
                stamp: moment.at,
                pose,
                covariance: None,
            };
            samples = poses.into_iter().map(sample).collect();
            [parent, child] = frames.map(Some);
            report = decoder.report.clone();
            name
        }
    };
    let mut carried_from = None;
    let is_odometry = |name: &str| content.names(&[MessageKind::Odometry]).contains(&name);
    // In a namespace of its own, the frame has the same name within it.
    let own = |into: &str| {
        let (namespace, _) = parent.as_deref()?.rsplit_once('/')?;
        Some(format!("{namespace}/{into}")).filter(|name| tree.knows(name))
    };
    let into = request.into.map(|into| match tree.knows(into) {
        true => into.to_owned(),
        false => own(into).unwrap_or_else(|| into.to_owned()),
    });
    if let (PosesAt::Topic(name), Some(into), Some(from)) =
        (place, into.as_deref(), parent.as_deref())
        && into != from
        && !is_odometry(name)
        && let Some(link) = tree.link(into, from)
    {
        let before = samples.len();
        samples.retain_mut(|sample| {
            let at = Moment { stretch: 0, at: sample.stamp };
            let Some(carry) = link.at(at).map(|transform| planar(&transform)) else { return false };
            sample.pose = carry.compose(&sample.pose);
            sample.covariance = sample.covariance.map(|known| turned(&known, carry.theta));
            true
        });
        if samples.len() < before {
            report.doubts.push(format!(
                "{name}: {} of {before} poses are left out: no transform from {into:?} to {from:?} is known at their times",
                before - samples.len()
            ));
        }
        let into = into.to_owned();
        carried_from = parent.replace(into);
    }
    let frame = match child {
        Some(child) => Some(child),
        None => {
            decoder.odometry_frame()?.or_else(|| Some(tree.base_of(laser.as_deref()?)?.to_owned()))
        }
    };
    let mounts = frame.as_deref().map(|frame| tree.mounts(frame)).unwrap_or_default();
    let frame_from_laser = match (&frame, &laser) {
        (Some(frame), Some(laser)) => tree.mount(frame, laser)?.map(|mount| mount.robot_from_laser),
        _ => None,
    };
    let has_covariances = samples.iter().any(|sample| sample.covariance.is_some());
    let covariances = samples.iter().map(|sample| sample.covariance);
    Ok(PoseTopic {
        name,
        covariances: if has_covariances { covariances.collect() } else { Vec::new() },
        trajectory: samples
            .iter()
            .map(|sample| (Stamp::from_nanoseconds(sample.stamp), sample.pose))
            .collect(),
        parent,
        carried_from,
        frame,
        frame_from_laser,
        mounts,
        out_of_plane: out_of_plane(messages.iter().map(|logged| logged.value.in_space)),
        report,
    })
}

/// A name for a pair of frames, the pair, and the poses of the second in the first.
type OfTransforms = (String, [String; 2], Vec<(Moment, Pose2)>);

/// The requested pair; by default the only pair of transforms in which a frame that no other moves in moves
/// in a fixed frame, other than that of the odometry.
fn of_transforms(
    place: PosesAt<'_>,
    asked: Option<&str>,
    tree: &Motion,
) -> Result<OfTransforms, BagError> {
    let name = match place {
        PosesAt::Pair(_) => asked.unwrap_or_default().to_owned(),
        _ => match tree.moving_pairs().as_slice() {
            [only] => only.clone(),
            several => {
                let topic = asked.unwrap_or("the transforms").to_owned();
                return Err(BagError::WhichPair {
                    topic,
                    pairs: several.join(", "),
                    frames: tree.frames(),
                });
            }
        },
    };
    let frames = Pair::of(&name).and_then(|pair| pair.frames(|frame| tree.knows(frame)));
    let found = frames.and_then(|(parent, child)| {
        Some(([parent.to_owned(), child.to_owned()], tree.poses(parent, child)?))
    });
    match found {
        Some((frames, poses)) => Ok((name, frames, poses)),
        None => Err(BagError::NoPair { topic: name, frames: tree.frames() }),
    }
}

/// The covariance of a pose that is transformed into another frame.
fn turned(covariance: &Covariance, angle: f64) -> Covariance {
    let (sin, cos) = math::sin_cos(angle);
    let carry = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
    let by = |of: &dyn Fn(usize, usize) -> f64| {
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| of(row, column)))
    };
    let half = by(&|row, column| (0..3).map(|k| carry[row][k] * covariance[k][column]).sum());
    by(&|row, column| (0..3).map(|k| half[row][k] * carry[column][k]).sum())
}
