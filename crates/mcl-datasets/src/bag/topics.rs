//! Selects the topics of a bag.

use super::content::{Content, MessageKind, POSE_KINDS, Topic, list};
use super::error::BagError;
use crate::log::options::{ReadOptions, ReferencePoses};

const SCAN_TYPES: &str = "sensor_msgs/msg/LaserScan or sensor_msgs/msg/MultiEchoLaserScan";
/// Last part of the names of pose topics that hold goals or initial poses.
const GOALS: [&str; 6] =
    ["goal_pose", "goal", "current_goal", "initialpose", "clicked_pose", "target_pose"];
/// Last part of the names of pose topics that hold another program's estimate.
const ESTIMATES: [&str; 7] =
    ["pose", "robot_pose", "current_pose", "global_pose", "mcl_pose", "tracked_pose", "poseupdate"];
/// Parts of the names of programs that estimate poses, and of their topics.
const ESTIMATORS: [&str; 13] = [
    "amcl",
    "mcl2",
    "slam",
    "ndt_",
    "ekf",
    "ukf",
    "localiz",
    "localis",
    "estimat",
    "inferred",
    "filtered",
    "rtabmap",
    "cartographer",
];
/// Parts of the names of ground truth in any spelling, and of systems that track a robot from outside.
const WATCHERS: [&str; 9] = [
    "groundtruth",
    "ground_truth",
    "mocap",
    "motion_capture",
    "vrpn",
    "vicon",
    "optitrack",
    "natnet",
    "qualisys",
];
/// Last part of the names of topics that hold ground truth.
const REFERENCE: [&str; 10] = [
    "reference",
    "ground_truth",
    "groundtruth",
    "ground_truth_pose",
    "ground_truth/pose",
    "ground_truth_odom",
    "base_pose_ground_truth",
    "gt_pose",
    "ground_truth/state",
    "gt",
];

const POSE_TYPES: &str = "geometry_msgs/msg/PoseStamped, PoseWithCovarianceStamped or TransformStamped, nav_msgs/msg/Odometry or Path, or two frames of transforms (/tf:map.base_link)";

impl Content {
    /// The requested topic, if its messages are of one of these kinds.
    fn asked<'a>(
        &self,
        topic: &'a str,
        kinds: &[MessageKind],
        option: &'static str,
        expected: &'static str,
    ) -> Result<&'a str, BagError> {
        let mut of_name = self.topics.iter().filter(|found| found.name == topic).peekable();
        let Some(&first) = of_name.peek() else {
            return Err(BagError::NoTopic { topic: topic.to_owned(), option, topics: self.list() });
        };
        if of_name.any(|found| found.kind.is_some_and(|kind| kinds.contains(&kind))) {
            return Ok(topic);
        }
        let found = first.type_name().to_owned();
        Err(BagError::WrongType { topic: topic.to_owned(), option, found, expected })
    }

    /// The requested topic of poses, or pair of frames.
    fn asked_poses<'a>(&self, topic: &'a str, option: &'static str) -> Result<&'a str, BagError> {
        match Pair::of(topic).filter(|_| !self.topics.iter().any(|found| found.name == topic)) {
            Some(pair) => self
                .asked(pair.topic, &[MessageKind::Transforms], option, "tf2_msgs/msg/TFMessage")
                .map(|_| topic),
            None => self.asked(topic, &POSE_KINDS, option, POSE_TYPES),
        }
    }

    /// The error for several candidate `names` (sorted, as returned by [`Content::names`]).
    fn ambiguous(&self, what: &'static str, names: &[&str], option: &'static str) -> BagError {
        let is_named = |topic: &&Topic| names.binary_search(&&*topic.name).is_ok();
        let candidates = list(self.topics.iter().filter(is_named));
        BagError::Ambiguous { what, candidates, option }
    }
}

/// The topics that a recording is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChosenTopics<'a> {
    pub scan: &'a str,
    pub odometry: Option<&'a str>,
    /// A topic of poses, or a pair of frames ([`Pair`]).
    pub reference: Option<&'a str>,
    /// Inputs with several candidate topics, which were left out.
    pub doubts: Vec<String>,
    /// Topics chosen although no name confirms the choice.
    pub assumptions: Vec<String>,
}

/// Chooses the topics. A requested topic must exist with messages of the right type. By default:
///
/// - scans: the only topic of its type, or among several the one named `/scan`;
/// - odometry: the only topic of its type, or among several the one named `/odom`; topics with the name of
///   ground truth do not count;
/// - reference: the only topic of poses, or among several the one with the name of ground truth; goals,
///   initial poses and estimates by name do not count. Without any such topic, one of odometry, transforms or
///   paths with the name of ground truth.
///
/// Where several could be the odometry or the reference, none is used.
pub(super) fn choose<'a>(
    content: &'a Content,
    options: &'a ReadOptions,
) -> Result<ChosenTopics<'a>, BagError> {
    let asked = &options.topics;
    let (kinds, types): (&[MessageKind], _) = match options.slice {
        Some(_) => (&[MessageKind::Cloud], "sensor_msgs/msg/PointCloud2 (with --slice)"),
        None => (&[MessageKind::Scan, MessageKind::MultiEcho], SCAN_TYPES),
    };
    let no_scan = || {
        let damaged = (content.damaged.skipped > 0).then(|| content.damaged.to_string());
        let because: Vec<String> = content.truncated.iter().cloned().chain(damaged).collect();
        let because = (!because.is_empty()).then(|| because.join("; "));
        BagError::NoScan { topics: content.list(), because }
    };
    let scan = match &asked.scan {
        Some(topic) => content.asked(topic, kinds, "--scan-topic", types)?,
        None => only_or_named(&content.names(kinds), "/scan")
            .map_err(|names| content.ambiguous(types, &names, "--scan-topic"))?
            .ok_or_else(no_scan)?,
    };
    let mut doubts = Vec::new();
    let mut left_open = |error: BagError, what: &str| match error {
        BagError::Ambiguous { .. } => {
            doubts.push(format!("{what}: {error}; none is used"));
            Ok(None)
        }
        error => Err(error),
    };
    let odometry_topics: Vec<&str> = content
        .names(&[MessageKind::Odometry])
        .into_iter()
        .filter(|name| asked.reference.as_deref() != Some(*name))
        .collect();
    let raw: Vec<&str> =
        odometry_topics.iter().copied().filter(|name| !is_named(name, &REFERENCE)).collect();
    const ODOMETRY_TYPE: &str = "nav_msgs/msg/Odometry";
    let odometry = match &asked.odometry {
        Some(topic) => {
            Some(content.asked(topic, &[MessageKind::Odometry], "--odom-topic", ODOMETRY_TYPE)?)
        }
        None => only_or_named(&raw, "/odom")
            .map_err(|names| content.ambiguous(ODOMETRY_TYPE, &names, "--odom-topic"))
            .or_else(|error| left_open(error, "odometry"))?,
    };
    let found = match options.reference {
        _ if options.reference_track.is_some() => None,
        ReferencePoses::None => None,
        ReferencePoses::Auto => reference_topic(content, asked.reference.as_deref())
            .or_else(|error| left_open(error, "reference"))?,
        ReferencePoses::Recorded => reference_topic(content, asked.reference.as_deref())?,
    };
    let mut assumptions = Vec::new();
    if let Some(topic) = found.filter(|topic| asked.reference.is_none() && !is_truth(topic)) {
        assumptions.push(format!(
            "reference: {topic} is the only topic of poses, and by its name neither a ground truth nor an estimate; it is used as the ground truth (--reference none, --reference-topic or --reference FILE changes this)"
        ));
    }
    Ok(ChosenTopics { scan, odometry, reference: found, doubts, assumptions })
}

/// A pair of frames as a topic of poses: `/tf:map.base_link`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair<'a> {
    /// The topic of the transforms.
    pub topic: &'a str,
    frames: &'a str,
}

impl<'a> Pair<'a> {
    pub fn of(name: &'a str) -> Option<Self> {
        let (topic, frames) = name.split_once(':')?;
        frames.contains('.').then_some(Pair { topic, frames })
    }

    /// Parent and child, both names in the tree: names of frames may contain dots, too.
    pub fn frames(self, knows: impl Fn(&str) -> bool) -> Option<(&'a str, &'a str)> {
        let dots = self.frames.match_indices('.');
        let plain = |frame: &'a str| frame.trim_start_matches('/');
        let pairs = dots.map(|(dot, _)| (&self.frames[..dot], &self.frames[dot + 1..]));
        let mut pairs = pairs.map(|(parent, child)| (plain(parent), plain(child)));
        pairs.find(|(parent, child)| knows(parent) && knows(child))
    }
}

/// The topics of transforms that belong to a topic: those in the namespace that is the longest prefix of its
/// name, for `/tf_static` and the others alike; all of them, where none is a prefix.
pub(super) fn transform_topics<'a>(content: &'a Content, of: Option<&str>) -> Vec<&'a str> {
    let names = content.names(&[MessageKind::Transforms]);
    let Some(of) = of else { return names };
    let namespace = |name: &str| name.rfind('/').map_or(0, |slash| slash + 1);
    let is_static = |name: &str| name.ends_with("tf_static");
    let is_chosen = |name: &&str| {
        let alike = || names.iter().filter(|other| is_static(other) == is_static(name));
        let is_above = |other: &&&str| of.starts_with(&other[..namespace(other)]);
        match alike().filter(is_above).map(|other| namespace(other)).max() {
            Some(longest) => is_above(&name) && namespace(name) == longest,
            None => true,
        }
    };
    names.iter().copied().filter(is_chosen).collect()
}

/// The topic of the point clouds: the requested one, else the only one of its type, or among several the one
/// named `/points`.
pub(super) fn cloud_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<&'a str, BagError> {
    const OPTION: &str = "--cloud-topic";
    const TYPE: &str = "sensor_msgs/msg/PointCloud2";
    if let Some(topic) = asked {
        return content.asked(topic, &[MessageKind::Cloud], OPTION, TYPE);
    }
    only_or_named(&content.names(&[MessageKind::Cloud]), "/points")
        .map_err(|names| content.ambiguous(TYPE, &names, OPTION))?
        .ok_or_else(|| BagError::NoCloud {
            topics: content.list(),
            because: content.truncated.clone(),
        })
}

/// The topic of the robot's odometry among those of its type, if any: the requested one, the only one, or
/// `/odom`.
pub(super) fn odometry_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<Option<&'a str>, BagError> {
    const OPTION: &str = "--odom-topic";
    const TYPE: &str = "nav_msgs/msg/Odometry";
    match asked {
        Some(topic) => content.asked(topic, &[MessageKind::Odometry], OPTION, TYPE).map(Some),
        None => only_or_named(&content.names(&[MessageKind::Odometry]), "/odom")
            .map_err(|names| content.ambiguous(TYPE, &names, OPTION)),
    }
}

/// The topic of the reference poses, by the rules of [`choose`]; `None` if there is none.
fn reference_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<Option<&'a str>, BagError> {
    const OPTION: &str = "--reference-topic";
    if let Some(topic) = asked {
        return content.asked_poses(topic, OPTION).map(Some);
    }
    let mut poses = content.names(&[MessageKind::Pose, MessageKind::PoseWithCovariance]);
    poses.retain(|name| !is_named(name, &GOALS) && !is_estimate(name));
    let truths = |names: &[&'a str]| -> Vec<&'a str> {
        names.iter().copied().filter(|name| is_named(name, &REFERENCE)).collect()
    };
    let candidates = match (poses.as_slice(), truths(&poses)) {
        ([], _) => truths(&content.names(&[
            MessageKind::Odometry,
            MessageKind::Transform,
            MessageKind::Path,
        ])),
        (&[only], _) => vec![only],
        (several, named) if named.is_empty() => several.to_vec(),
        (_, named) => named,
    };
    match candidates.as_slice() {
        [] => Ok(None),
        &[only] => Ok(Some(only)),
        several => Err(content.ambiguous("poses", several, OPTION)),
    }
}

/// Whether a topic has the name of ground truth, or of a system that tracks a robot from outside.
fn is_truth(name: &str) -> bool {
    is_named(name, &REFERENCE) || contains(name, &WATCHERS)
}

/// Whether a topic has the name of an estimate by another program.
fn is_estimate(name: &str) -> bool {
    !is_truth(name) && (is_named(name, &ESTIMATES) || contains(name, &ESTIMATORS))
}

fn contains(name: &str, parts: &[&str]) -> bool {
    let name = name.to_ascii_lowercase();
    parts.iter().any(|part| name.contains(part))
}

/// Topics of poses that could serve as a reference on request, except the odometry.
pub(super) fn possible_references(content: &Content, odometry: Option<&str>) -> Vec<String> {
    let names = content.names(&POSE_KINDS).into_iter();
    let possible = names.filter(|name| Some(*name) != odometry && !is_named(name, &GOALS));
    let described = |name: &str| match is_estimate(name) {
        true => format!("{name} (an estimate)"),
        false => name.to_owned(),
    };
    possible.map(described).collect()
}

/// What the poses of a topic are used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseRole {
    /// Ground truth.
    Reference,
    /// Poses to compare with the ground truth.
    Estimate,
}

/// Where poses are found in a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PosesAt<'a> {
    Topic(&'a str),
    Pair(Pair<'a>),
    /// In transforms; the frames have to be found in the tree.
    Transforms,
}

/// The requested topic of poses. By default, for a reference the one that a recording would use, and for an
/// estimate the only one that is neither ground truth, goal nor initial pose: of poses or odometry, else of
/// paths or single transforms, else the transforms.
pub(super) fn pose_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
    role: PoseRole,
) -> Result<PosesAt<'a>, BagError> {
    let option = match role {
        PoseRole::Reference => "--reference-topic",
        PoseRole::Estimate => "--topic",
    };
    let none = || BagError::NoPoses { topics: content.list() };
    if let Some(topic) = asked {
        let is_transforms = content.names(&[MessageKind::Transforms]).contains(&topic);
        if is_transforms {
            return Ok(PosesAt::Transforms);
        }
        let topic = content.asked_poses(topic, option)?;
        let is_topic = content.topics.iter().any(|found| found.name == topic);
        let pair = Pair::of(topic).filter(|_| !is_topic);
        return Ok(pair.map_or(PosesAt::Topic(topic), PosesAt::Pair));
    }
    let kinds: &[&[MessageKind]] = match role {
        PoseRole::Reference => match reference_topic(content, None)? {
            Some(topic) => return Ok(PosesAt::Topic(topic)),
            None => &[&[MessageKind::Path, MessageKind::Transform]],
        },
        PoseRole::Estimate => &[
            &[MessageKind::Pose, MessageKind::PoseWithCovariance, MessageKind::Odometry],
            &[MessageKind::Path, MessageKind::Transform],
        ],
    };
    for kinds in kinds {
        let mut candidates = content.names(kinds);
        candidates.retain(|name| !is_named(name, &GOALS) && !is_named(name, &REFERENCE));
        match candidates.as_slice() {
            [] => {}
            &[only] => return Ok(PosesAt::Topic(only)),
            several => return Err(content.ambiguous("poses", several, option)),
        }
    }
    let transforms = content.names(&[MessageKind::Transforms]);
    match transforms.iter().any(|name| !name.ends_with("tf_static")) {
        true => Ok(PosesAt::Transforms),
        false => Err(none()),
    }
}

/// The only name, or among several `obvious`; all of them when neither applies.
fn only_or_named<'a>(names: &[&'a str], obvious: &str) -> Result<Option<&'a str>, Vec<&'a str>> {
    match names {
        [] => Ok(None),
        &[only] => Ok(Some(only)),
        several => match several.iter().find(|name| **name == obvious) {
            Some(name) => Ok(Some(name)),
            None => Err(several.to_vec()),
        },
    }
}

fn is_named(topic: &str, endings: &[&str]) -> bool {
    endings.iter().any(|ending| {
        topic.strip_suffix(ending).is_some_and(|before| before.is_empty() || before.ends_with('/'))
    })
}
