//! The topics of a bag, the messages of those that could be of use, and which of them are meant.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use super::error::BagError;
use super::layout::plain_name;
use super::writer::{METADATA_NAME, UNSTAMPED_KEY};
use crate::container::chunk::{Compression, inflate};
use crate::container::item::{Input, Item, Message, SchemaText};
use crate::container::position::Position;
use crate::container::problem::StreamProblem;
use crate::container::read;
use crate::log::options::{ReadOptions, ReferencePoses};
use crate::packed::ZSTD_MAGIC;

/// Bytes of messages kept in memory, at most: some 300,000 scans of 720 beams.
pub const MAX_KEPT_BYTES: u64 = 2 << 30;

/// Largest message decoded, in bytes. A scan of 720 beams takes 6 kB; decoded, a message of the worst
/// kind takes some fifty times its bytes.
pub const MAX_MESSAGE_BYTES: usize = 4 << 20;
/// Largest point cloud decoded, in bytes: two million points of 32 bytes. Decoded, it takes as much again and
/// 24 bytes per point, and a message of nothing but names of fields some fifteen times its bytes.
pub const MAX_CLOUD_BYTES: usize = 64 << 20;

/// Bytes of a topic's first message that are looked at: those of its header.
const HEAD_BYTES: usize = 512;
/// Topics named in a message; a file may have 65,535.
const LISTED_TOPICS: usize = 100;

const SCAN: &str = "sensor_msgs/LaserScan";
const ODOMETRY: &str = "nav_msgs/Odometry";
const POSE: &str = "geometry_msgs/PoseStamped";
const POSE_WITH_COVARIANCE: &str = "geometry_msgs/PoseWithCovarianceStamped";
const TRANSFORMS: &str = "tf2_msgs/TFMessage";
const CLOUD: &str = "sensor_msgs/PointCloud2";
const MULTI_ECHO: &str = "sensor_msgs/MultiEchoLaserScan";
const TRANSFORM: &str = "geometry_msgs/TransformStamped";
const PATH: &str = "nav_msgs/Path";
const SCAN_TYPES: &str = "sensor_msgs/msg/LaserScan or sensor_msgs/msg/MultiEchoLaserScan";
/// Last part of the names of pose topics that say where the robot should be, or was told it is.
const GOALS: [&str; 6] =
    ["goal_pose", "goal", "current_goal", "initialpose", "clicked_pose", "target_pose"];
/// Last part of the names of pose topics that hold what another program takes to be the robot's pose.
const ESTIMATES: [&str; 9] = [
    "amcl_pose",
    "mcl_pose",
    "slam_toolbox/pose",
    "slam_out_pose",
    "tracked_pose",
    "estimated_pose",
    "pose_estimate",
    "localization_pose",
    "poseupdate",
];
/// Last part of the names of topics that hold ground truth.
const REFERENCE: [&str; 8] = [
    "reference",
    "ground_truth",
    "groundtruth",
    "ground_truth_pose",
    "ground_truth/pose",
    "ground_truth_odom",
    "base_pose_ground_truth",
    "gt_pose",
];

/// Kinds of messages with a pose, and their names.
const POSE_KINDS: [Kind; 5] =
    [Kind::Pose, Kind::PoseWithCovariance, Kind::Odometry, Kind::Transform, Kind::Path];
const POSE_TYPES: &str = "geometry_msgs/msg/PoseStamped, PoseWithCovarianceStamped or TransformStamped, nav_msgs/msg/Odometry or Path, or two frames of transforms (/tf:map.base_link)";

/// What messages of a type are used as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scan,
    Odometry,
    Pose,
    PoseWithCovariance,
    Transforms,
    Cloud,
    MultiEcho,
    Transform,
    Path,
}

impl Kind {
    fn of(type_name: &str) -> Option<Self> {
        Some(match type_name {
            SCAN => Kind::Scan,
            ODOMETRY => Kind::Odometry,
            POSE => Kind::Pose,
            POSE_WITH_COVARIANCE => Kind::PoseWithCovariance,
            TRANSFORMS | "tf/tfMessage" => Kind::Transforms,
            CLOUD => Kind::Cloud,
            MULTI_ECHO => Kind::MultiEcho,
            TRANSFORM => Kind::Transform,
            PATH => Kind::Path,
            _ => return None,
        })
    }
}

impl Kind {
    /// Whether a scan is in it, or can be made of it.
    pub fn is_scan(self) -> bool {
        matches!(self, Kind::Scan | Kind::MultiEcho | Kind::Cloud)
    }

    pub fn is_pose(self) -> bool {
        POSE_KINDS.contains(&self)
    }
}

/// A topic with one type and description of its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Topic {
    pub name: String,
    pub encoding: String,
    pub schema: Option<Arc<SchemaText>>,
    /// What its messages are used as, if at all.
    pub kind: Option<Kind>,
    pub messages: usize,
    /// When the first and the last of them were logged, in nanoseconds.
    pub logged: Option<(u64, u64)>,
    /// The first bytes of the first of them.
    pub head: Vec<u8>,
}

impl Topic {
    pub fn type_name(&self) -> &str {
        self.schema.as_ref().map_or("no type", |schema| &schema.name)
    }

    pub fn is_cloud(&self) -> bool {
        Kind::of(&plain_name(self.type_name())) == Some(Kind::Cloud)
    }
}

/// A message of a topic that could be of use.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    /// Index of its topic.
    pub topic: usize,
    pub sequence: u32,
    pub log_time: u64,
    pub position: Position,
    pub data: Vec<u8>,
}

/// What a bag is read for: messages of other kinds are counted, but not kept in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Purpose {
    /// Laser scans and poses.
    #[default]
    Scans,
    /// Point clouds, of which scans are made, and poses.
    Slices,
    /// Point clouds, and where they were taken.
    Clouds,
    /// Nothing: to see what is there.
    Topics,
}

impl Purpose {
    fn keeps(self, kind: Kind) -> bool {
        match self {
            Purpose::Scans | Purpose::Topics => kind != Kind::Cloud,
            Purpose::Slices => !matches!(kind, Kind::Scan | Kind::MultiEcho),
            Purpose::Clouds => matches!(kind, Kind::Cloud | Kind::Odometry | Kind::Transforms),
        }
    }
}

/// The content of a bag, of one file or several.
#[derive(Debug, Default)]
pub(crate) struct Content {
    purpose: Purpose,
    pub(super) topics: Vec<Topic>,
    pub(super) messages: Vec<Kept>,
    /// Types of messages by topic, where something beside the bag's files says them.
    pub types: BTreeMap<String, String>,
    /// Why the bag ends early, if it does.
    pub truncated: Option<String>,
    /// Sequence numbers of the scans that have no stamp, in bags of this suite's writer, whose
    /// stamps of 0 are times otherwise.
    pub unstamped: Option<BTreeSet<u32>>,
    /// Indices of topics by name, encoding and description: files of a split bag repeat them, and one
    /// file may have 65,535.
    by_description: HashMap<(String, String, Option<Arc<SchemaText>>), usize>,
    kept_bytes: u64,
}

impl Content {
    /// Nothing yet.
    pub fn new(purpose: Purpose) -> Self {
        Content { purpose, ..Content::default() }
    }

    /// Reads one more file; `name` tells it from the others of a split bag.
    pub fn add(&mut self, input: Input<'_>, name: Option<&str>) -> Result<(), BagError> {
        let mut by_id: BTreeMap<u32, usize> = BTreeMap::new();
        let truncated = read(input, &mut |item| {
            match item {
                Item::Channel(channel) => {
                    let typed = |name: &String| {
                        let (encoding, data) = (String::new(), Vec::new());
                        Arc::new(SchemaText { name: name.clone(), encoding, data })
                    };
                    let schema = channel.schema.clone();
                    let schema = schema.or_else(|| self.types.get(&channel.topic).map(typed));
                    let kind = schema
                        .as_ref()
                        .and_then(|schema| Kind::of(&plain_name(&schema.name)))
                        .filter(|&kind| self.purpose.keeps(kind));
                    let topic = Topic {
                        name: channel.topic.clone(),
                        encoding: channel.message_encoding.clone(),
                        schema,
                        kind,
                        messages: 0,
                        logged: None,
                        head: Vec::new(),
                    };
                    let key = (topic.name.clone(), topic.encoding.clone(), topic.schema.clone());
                    let index = *self.by_description.entry(key).or_insert_with(|| {
                        self.topics.push(topic);
                        self.topics.len() - 1
                    });
                    by_id.insert(channel.id, index);
                }
                Item::Message(message) => {
                    let Some(&topic) = by_id.get(&message.channel.id) else { return Ok(()) };
                    let found = &mut self.topics[topic];
                    found.messages += 1;
                    let at = message.log_time;
                    let (first, last) = found.logged.unwrap_or((at, at));
                    found.logged = Some((first.min(at), last.max(at)));
                    if found.messages == 1 {
                        let data = unpacked(&message);
                        found.head = data[..data.len().min(HEAD_BYTES)].to_vec();
                    }
                    if found.kind.is_some() && self.purpose != Purpose::Topics {
                        let data = unpacked(&message);
                        // What a message takes beside its bytes, so that empty ones count, too.
                        self.kept_bytes += data.len() as u64 + size_of::<Kept>() as u64;
                        if self.kept_bytes > MAX_KEPT_BYTES {
                            return Err(StreamProblem::TooMuch(MAX_KEPT_BYTES));
                        }
                        self.messages.push(Kept {
                            topic,
                            sequence: message.sequence,
                            log_time: message.log_time,
                            position: message.position,
                            data,
                        });
                    }
                }
                Item::Metadata(METADATA_NAME, entries) => {
                    let unstamped = entries.iter().find(|(key, _)| *key == UNSTAMPED_KEY);
                    let list = unstamped.map_or("", |(_, list)| list);
                    let numbers =
                        list.split_ascii_whitespace().filter_map(|n| n.parse::<u32>().ok());
                    self.unstamped.get_or_insert_default().extend(numbers);
                }
                Item::Metadata(..) => {}
            }
            Ok(())
        })?;
        let told = |reason| match name {
            Some(name) => format!("{name}: {reason}"),
            None => reason,
        };
        self.truncated = self.truncated.take().or(truncated.map(told));
        Ok(())
    }

    /// Every topic with its type and number of messages.
    pub fn list(&self) -> String {
        list(self.topics.iter())
    }

    /// Messages of kinds that are not read.
    pub fn ignored(&self) -> usize {
        self.topics.iter().filter(|topic| topic.kind.is_none()).map(|topic| topic.messages).sum()
    }

    /// Names of the topics with messages of one of these kinds.
    pub(super) fn names(&self, kinds: &[Kind]) -> Vec<&str> {
        let of_kind = |topic: &&Topic| topic.kind.is_some_and(|kind| kinds.contains(&kind));
        let used = self.topics.iter().filter(of_kind).filter(|topic| topic.messages > 0);
        let names: BTreeSet<&str> = used.map(|topic| topic.name.as_str()).collect();
        names.into_iter().collect()
    }

    /// The topic asked for, if its messages are of one of these kinds.
    fn asked<'a>(
        &self,
        topic: &'a str,
        kinds: &[Kind],
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

    /// The topic of poses asked for, or the pair of frames.
    fn asked_poses<'a>(&self, topic: &'a str, option: &'static str) -> Result<&'a str, BagError> {
        match Pair::of(topic).filter(|_| !self.topics.iter().any(|found| found.name == topic)) {
            Some(pair) => self
                .asked(pair.topic, &[Kind::Transforms], option, "tf2_msgs/msg/TFMessage")
                .map(|_| topic),
            None => self.asked(topic, &POSE_KINDS, option, POSE_TYPES),
        }
    }

    /// The error for several `names` (sorted, as [`Content::names`] gives them) that could be meant.
    fn ambiguous(&self, what: &'static str, names: &[&str], option: &'static str) -> BagError {
        let is_named = |topic: &&Topic| names.binary_search(&&*topic.name).is_ok();
        let candidates = list(self.topics.iter().filter(is_named));
        BagError::Ambiguous { what, candidates, option }
    }
}

/// The bytes of a message, which rosbag2 may have compressed on its own. CDR begins with a NUL, so these
/// first bytes tell. What does not unpack stays as it is, and is no message of its type.
fn unpacked(message: &Message<'_>) -> Vec<u8> {
    if message.channel.message_encoding == "cdr" && message.data.starts_with(ZSTD_MAGIC) {
        let (data, outcome) = inflate(Compression::Zstd, message.data, MAX_CLOUD_BYTES as u64 + 1);
        if outcome.is_ok() {
            return data;
        }
    }
    message.data.to_vec()
}

fn list<'a>(topics: impl Iterator<Item = &'a Topic>) -> String {
    let mut topics: Vec<String> = topics
        .map(|topic| {
            let s = if topic.messages == 1 { "" } else { "s" };
            format!("{} ({}, {} message{s})", topic.name, topic.type_name(), topic.messages)
        })
        .collect();
    topics.sort();
    let more = topics.len().saturating_sub(LISTED_TOPICS);
    if more > 0 {
        topics.truncate(LISTED_TOPICS);
        topics.push(format!("… and {more} more"));
    }
    if topics.is_empty() { "none".to_owned() } else { topics.join(", ") }
}

/// The topics that a recording is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Chosen<'a> {
    pub scan: &'a str,
    pub odometry: Option<&'a str>,
    /// A topic of poses, or a pair of frames ([`Pair`]).
    pub reference: Option<&'a str>,
    /// What could be meant by several topics, and was left out.
    pub doubts: Vec<String>,
}

/// Chooses the topics. A topic that is asked for must be there with messages of the right type. Else:
///
/// * scans: the only topic of its type, or among several the one named `/scan`;
/// * odometry: the only topic of its type, or among several the one named `/odom`; topics with the
///   name of a ground truth do not count;
/// * reference: the only topic of poses, or among several the one with the name of a ground truth;
///   goals, initial poses and what has the name of an estimate do not count. Without any such topic, one
///   of odometry, transforms or paths with the name of a ground truth.
///
/// Where several could be the odometry or the reference, none is.
pub(super) fn choose<'a>(
    content: &'a Content,
    options: &'a ReadOptions,
) -> Result<Chosen<'a>, BagError> {
    let asked = &options.topics;
    let (kinds, types): (&[Kind], _) = match options.slice {
        Some(_) => (&[Kind::Cloud], "sensor_msgs/msg/PointCloud2 (with --slice)"),
        None => (&[Kind::Scan, Kind::MultiEcho], SCAN_TYPES),
    };
    let no_scan =
        || BagError::NoScan { topics: content.list(), because: content.truncated.clone() };
    let scan = match &asked.scan {
        Some(topic) => content.asked(topic, kinds, "--scan-topic", types)?,
        None => only_or_named(&content.names(kinds), "/scan")
            .map_err(|names| content.ambiguous(types, &names, "--scan-topic"))?
            .ok_or_else(no_scan)?,
    };
    let mut doubts = Vec::new();
    let mut left_open = |error: BagError, what: &str| match error {
        BagError::Ambiguous { .. } => {
            doubts.push(format!("{what}: {error}; none is taken"));
            Ok(None)
        }
        error => Err(error),
    };
    let odometry_topics: Vec<&str> = content
        .names(&[Kind::Odometry])
        .into_iter()
        .filter(|name| asked.reference.as_deref() != Some(*name))
        .collect();
    let raw: Vec<&str> =
        odometry_topics.iter().copied().filter(|name| !is_named(name, &REFERENCE)).collect();
    const ODOMETRY_TYPE: &str = "nav_msgs/msg/Odometry";
    let odometry = match &asked.odometry {
        Some(topic) => {
            Some(content.asked(topic, &[Kind::Odometry], "--odom-topic", ODOMETRY_TYPE)?)
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
        ReferencePoses::Recorded => {
            let found = reference_topic(content, asked.reference.as_deref())?;
            Some(found.ok_or_else(|| BagError::NoReference { topics: content.list() })?)
        }
    };
    Ok(Chosen { scan, odometry, reference: found, doubts })
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

    /// Parent and child, both named in the tree: names of frames may have dots, too.
    pub fn frames(self, knows: impl Fn(&str) -> bool) -> Option<(&'a str, &'a str)> {
        let dots = self.frames.match_indices('.');
        let mut pairs = dots.map(|(dot, _)| (&self.frames[..dot], &self.frames[dot + 1..]));
        pairs.find(|(parent, child)| knows(parent) && knows(child))
    }
}

/// The topics of transforms that go with a topic: of the namespace that is the longest beginning of its
/// name, for those on `/tf_static` and others alike; all, where none is a beginning.
pub(super) fn transform_topics<'a>(content: &'a Content, of: Option<&str>) -> Vec<&'a str> {
    let names = content.names(&[Kind::Transforms]);
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

/// The topic of the point clouds: the one asked for, else the only one of its type, or among several
/// the one named `/points`.
pub(super) fn cloud_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<&'a str, BagError> {
    const OPTION: &str = "--cloud-topic";
    const TYPE: &str = "sensor_msgs/msg/PointCloud2";
    if let Some(topic) = asked {
        return content.asked(topic, &[Kind::Cloud], OPTION, TYPE);
    }
    only_or_named(&content.names(&[Kind::Cloud]), "/points")
        .map_err(|names| content.ambiguous(TYPE, &names, OPTION))?
        .ok_or_else(|| BagError::NoCloud {
            topics: content.list(),
            because: content.truncated.clone(),
        })
}

/// The topic of the robot's odometry among those of its type, where there is one: the one asked for, the
/// only one, or `/odom`.
pub(super) fn odometry_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<Option<&'a str>, BagError> {
    const OPTION: &str = "--odom-topic";
    const TYPE: &str = "nav_msgs/msg/Odometry";
    match asked {
        Some(topic) => content.asked(topic, &[Kind::Odometry], OPTION, TYPE).map(Some),
        None => only_or_named(&content.names(&[Kind::Odometry]), "/odom")
            .map_err(|names| content.ambiguous(TYPE, &names, OPTION)),
    }
}

/// The topic of the reference poses, as [`choose`] says; `None` if there is none.
fn reference_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
) -> Result<Option<&'a str>, BagError> {
    const OPTION: &str = "--reference-topic";
    if let Some(topic) = asked {
        return content.asked_poses(topic, OPTION).map(Some);
    }
    let mut poses = content.names(&[Kind::Pose, Kind::PoseWithCovariance]);
    poses.retain(|name| !is_named(name, &GOALS) && !is_estimate(name));
    let truths = |names: &[&'a str]| -> Vec<&'a str> {
        names.iter().copied().filter(|name| is_named(name, &REFERENCE)).collect()
    };
    let candidates = match (poses.as_slice(), truths(&poses)) {
        ([], _) => truths(&content.names(&[Kind::Odometry, Kind::Transform, Kind::Path])),
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

/// Whether a topic has the name of poses that another program estimated.
fn is_estimate(name: &str) -> bool {
    name == "/pose" || is_named(name, &ESTIMATES)
}

/// Topics of poses that could serve as a reference if asked for, but the odometry.
pub(super) fn possible_references(content: &Content, odometry: Option<&str>) -> Vec<String> {
    let names = content.names(&POSE_KINDS).into_iter();
    let possible = names.filter(|name| Some(*name) != odometry && !is_named(name, &GOALS));
    let told = |name: &str| match is_estimate(name) {
        true => format!("{name} (an estimate)"),
        false => name.to_owned(),
    };
    possible.map(told).collect()
}

/// What the poses of a topic are wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseRole {
    /// Ground truth.
    Reference,
    /// Poses to be held against it.
    Estimate,
}

/// The topic of poses that is asked for; else, for a reference, the one that a recording would take,
/// and for an estimate the only one that is neither ground truth, goal nor initial pose.
pub(super) fn pose_topic<'a>(
    content: &'a Content,
    asked: Option<&'a str>,
    role: PoseRole,
) -> Result<&'a str, BagError> {
    let none = || BagError::NoPoses { topics: content.list() };
    if role == PoseRole::Reference {
        return reference_topic(content, asked)?.ok_or_else(none);
    }
    const OPTION: &str = "--topic";
    if let Some(topic) = asked {
        return content.asked_poses(topic, OPTION);
    }
    let mut candidates = content.names(&[Kind::Pose, Kind::PoseWithCovariance, Kind::Odometry]);
    candidates.retain(|name| !is_named(name, &GOALS) && !is_named(name, &REFERENCE));
    match candidates.as_slice() {
        [] => Err(none()),
        &[only] => Ok(only),
        several => Err(content.ambiguous("poses", several, OPTION)),
    }
}

/// The only name, or among several `obvious`; all of them, when that decides nothing.
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
