//! The content of a bag: its topics, and the messages of the usable ones.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use super::cdr::{Encoding, View};
use super::error::BagError;
use super::layout::{SchemaError, plain_name};
use super::lists::{self, ScanLists};
use super::messages::{MessageError, OdometryMessage, ScanMessage, malformed};
use super::schema::MessageSchema;
use super::types;
use crate::container::chunk::{Compression, inflate};
use crate::container::item::{Channel, Damaged, Input, Item, Message, SchemaText, Wanted};
use crate::container::position::Position;
use crate::container::problem::StreamProblem;
use crate::container::read;
use crate::log::report::{ReadReport, RecordPlace, SkippedRecord};
use crate::packed::ZSTD_MAGIC;
use crate::room::{HEAP_BYTES, Room};
use mcl_core::{LaserScan, memory};

/// Limit on the memory of the messages kept of a bag, in bytes: some 700,000 scans of 720 beams.
pub const MAX_KEPT_BYTES: u64 = 4 << 30;

/// Largest message decoded, in bytes. A scan of 720 beams takes 6 kB; decoded, the worst case takes some
/// fifty times its encoded size.
pub const MAX_MESSAGE_BYTES: usize = 4 << 20;
/// Largest point cloud decoded, in bytes: two million points of 32 bytes. Decoding takes another 24 bytes per
/// point; a message of nothing but field names takes some fifteen times its size.
pub const MAX_CLOUD_BYTES: usize = 64 << 20;

/// Bytes kept of a topic's first message: enough for its header.
const HEAD_BYTES: usize = 512;
/// Topics listed in an error message; a file may have 65,535.
const LISTED_TOPICS: usize = 100;
/// Number of topics up to which all messages are decoded while reading; beyond, only those of the topics
/// used.
const DECODED_TOPICS: usize = 64;

const SCAN: &str = "sensor_msgs/LaserScan";
const ODOMETRY: &str = "nav_msgs/Odometry";
const POSE: &str = "geometry_msgs/PoseStamped";
const POSE_WITH_COVARIANCE: &str = "geometry_msgs/PoseWithCovarianceStamped";
const TRANSFORMS: &str = "tf2_msgs/TFMessage";
const CLOUD: &str = "sensor_msgs/PointCloud2";
const MULTI_ECHO: &str = "sensor_msgs/MultiEchoLaserScan";
const TRANSFORM: &str = "geometry_msgs/TransformStamped";
const PATH: &str = "nav_msgs/Path";
const STRING: &str = "std_msgs/String";
/// The kinds of messages that hold a pose, and their type names.
pub(super) const POSE_KINDS: [MessageKind; 5] = [
    MessageKind::Pose,
    MessageKind::PoseWithCovariance,
    MessageKind::Odometry,
    MessageKind::Transform,
    MessageKind::Path,
];

/// What messages of a type are used as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MessageKind {
    Scan,
    Odometry,
    Pose,
    PoseWithCovariance,
    Transforms,
    Cloud,
    MultiEcho,
    Transform,
    Path,
    /// The scan lists that this suite's writer adds to a bag.
    Lists,
}

impl MessageKind {
    fn of(type_name: &str) -> Option<Self> {
        Some(match type_name {
            SCAN => MessageKind::Scan,
            ODOMETRY => MessageKind::Odometry,
            POSE => MessageKind::Pose,
            POSE_WITH_COVARIANCE => MessageKind::PoseWithCovariance,
            TRANSFORMS | "tf/tfMessage" => MessageKind::Transforms,
            CLOUD => MessageKind::Cloud,
            MULTI_ECHO => MessageKind::MultiEcho,
            TRANSFORM => MessageKind::Transform,
            PATH => MessageKind::Path,
            _ => return None,
        })
    }

    /// Whether it is a scan, or a scan can be made of it.
    pub fn is_scan(self) -> bool {
        matches!(self, MessageKind::Scan | MessageKind::MultiEcho | MessageKind::Cloud)
    }

    pub fn is_pose(self) -> bool {
        POSE_KINDS.contains(&self)
    }
}

/// A topic with one message type and one description of it.
#[derive(Debug)]
pub(super) struct Topic {
    pub name: String,
    pub encoding: String,
    pub description: Option<Arc<SchemaText>>,
    /// What its messages are used as, if at all.
    pub kind: Option<MessageKind>,
    pub messages: usize,
    /// Log times of its first and last message, in nanoseconds.
    pub logged: Option<(u64, u64)>,
    /// The first bytes of its first message.
    pub head: Vec<u8>,
    layout: OnceCell<Result<Layout, NoLayout>>,
}

/// How the messages of a topic are laid out.
#[derive(Debug)]
pub(super) struct Layout {
    encoding: Encoding,
    pub schema: MessageSchema,
    /// Whether the bag lacks a description of the type, so that the standard one is used.
    pub is_standard: bool,
}

/// Why no message of a topic can be decoded.
#[derive(Debug)]
enum NoLayout {
    Encoding,
    Schema(SchemaError),
}

impl Topic {
    fn count(&mut self, count: usize, (first, last): (u64, u64)) {
        self.messages += count;
        let (known_first, known_last) = self.logged.unwrap_or((first, last));
        self.logged = Some((known_first.min(first), known_last.max(last)));
    }

    pub fn type_name(&self) -> &str {
        self.description.as_ref().map_or("no type", |schema| &schema.name)
    }

    pub fn is_cloud(&self) -> bool {
        MessageKind::of(&plain_name(self.type_name())) == Some(MessageKind::Cloud)
    }

    /// The layout of its messages.
    pub fn layout(&self) -> Result<&Layout, BagError> {
        let layout = self.layout.get_or_init(|| self.parsed()).as_ref();
        layout.map_err(|error| match error {
            NoLayout::Encoding => {
                BagError::Encoding { topic: self.name.clone(), encoding: self.encoding.clone() }
            }
            NoLayout::Schema(error) => self.schema_error(error.clone()),
        })
    }

    pub fn schema_error(&self, error: SchemaError) -> BagError {
        BagError::Schema {
            topic: self.name.clone(),
            schema: self.type_name().to_owned(),
            error: Box::new(error),
        }
    }

    fn parsed(&self) -> Result<Layout, NoLayout> {
        let encoding = Encoding::named(&self.encoding).ok_or(NoLayout::Encoding)?;
        let (schema, is_standard) = self.schema();
        Ok(Layout { encoding, schema: schema.map_err(NoLayout::Schema)?, is_standard })
    }

    /// The schema in the bag, or else the standard one for this type; and whether it is the standard one.
    pub fn schema(&self) -> (Result<MessageSchema, SchemaError>, bool) {
        let Some(text) = &self.description else {
            return (Err(SchemaError::NoRoot(String::new())), false);
        };
        let standard = || types::named(&plain_name(&text.name));
        if let Some(kind) = text.data.is_empty().then(standard).flatten() {
            let (language, text) = match self.encoding.as_str() {
                "ros1" => ("ros1msg", kind.description_of_ros1()),
                _ => ("ros2msg", kind.description()),
            };
            return (MessageSchema::parse(kind.name, language, text.as_bytes()), true);
        }
        (MessageSchema::parse(&text.name, &text.encoding, &text.data), false)
    }

    /// Decodes a message where its value takes no more memory than its bytes. A message that cannot be
    /// decoded is kept encoded, and its error is reported later.
    fn body(&self, data: &[u8]) -> Option<Body> {
        let layout = self.layout().ok()?;
        let scan = |value: fn(&View<'_>) -> Result<ScanMessage, MessageError>| {
            let scan = layout.decode(MAX_MESSAGE_BYTES, data, value);
            scan.map(|scan| Body::Scan(Box::new(scan)))
        };
        match self.kind? {
            MessageKind::Scan => scan(ScanMessage::new),
            MessageKind::MultiEcho => scan(ScanMessage::multi_echo),
            MessageKind::Odometry => layout
                .decode(MAX_MESSAGE_BYTES, data, OdometryMessage::new)
                .map(|moved| Body::Odometry(Box::new(moved))),
            _ => return None,
        }
        .ok()
    }
}

impl Layout {
    /// Applies `value` to an encoded message of at most `limit` bytes.
    pub fn decode<T>(
        &self,
        limit: usize,
        data: &[u8],
        value: impl FnOnce(&View<'_>) -> Result<T, MessageError>,
    ) -> Result<T, MessageError> {
        if data.len() > limit {
            let found = format!("{} bytes long", data.len());
            return Err(malformed("the message", found, format!("at most {limit}")));
        }
        let decoded = self.encoding.decode(&self.schema, data)?;
        value(&View::new(&self.schema, &decoded))
    }
}

/// A message of a usable topic.
#[derive(Debug)]
pub(super) struct KeptMessage {
    /// Index of its topic.
    pub topic: usize,
    /// Its index among the messages of its topic.
    pub number: u32,
    pub log_time: u64,
    pub position: Position,
    pub body: Body,
}

/// The content of a message, decoded or not.
#[derive(Debug)]
pub(super) enum Body {
    Encoded(Vec<u8>),
    Scan(Box<ScanMessage>),
    Odometry(Box<OdometryMessage>),
}

impl KeptMessage {
    /// Memory used, in bytes; empty ones count, too.
    fn bytes(&self) -> usize {
        let of_body = match &self.body {
            Body::Encoded(data) => data.len(),
            Body::Scan(scan) => size_of::<ScanMessage>() + size_of_val(&*scan.ranges),
            Body::Odometry(_) => size_of::<OdometryMessage>(),
        };
        of_body + size_of::<KeptMessage>() + 2 * HEAP_BYTES
    }
}

/// What a bag is read for; messages of other kinds are counted, but not kept in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Purpose {
    /// Laser scans and poses.
    #[default]
    Scans,
    /// Point clouds to be sliced into scans, and poses.
    Slices,
    /// Point clouds, and poses to place them.
    Clouds,
    /// Only the list of topics.
    Topics,
}

impl Purpose {
    fn keeps(self, kind: MessageKind) -> bool {
        match self {
            Purpose::Scans | Purpose::Topics => kind != MessageKind::Cloud,
            Purpose::Slices => !matches!(kind, MessageKind::Scan | MessageKind::MultiEcho),
            Purpose::Clouds => {
                matches!(kind, MessageKind::Cloud | MessageKind::Odometry | MessageKind::Transforms)
            }
        }
    }
}

/// The content of a bag of one or several files.
#[derive(Debug, Default)]
pub(crate) struct Content {
    purpose: Purpose,
    /// The requested topic of scans or clouds; messages of other topics of that kind are only counted.
    asked: Option<String>,
    pub(super) topics: Vec<Topic>,
    pub(super) messages: Vec<KeptMessage>,
    /// Message types by topic, where they are stated outside of the bag's files.
    pub types: BTreeMap<String, String>,
    /// Why the bag ends early, if it does.
    pub truncated: Option<String>,
    /// Remarks on how it was read, where that is unusual.
    pub(super) notes: Vec<String>,
    /// Malformed rows that were skipped.
    pub(super) damaged: ReadReport,
    /// The scan lists of bags written by this suite.
    pub(super) lists: Option<ScanLists>,
    /// Indices of topics by name, encoding and description: the files of a split bag repeat them, and one
    /// file may have 65,535.
    by_description: HashMap<(String, String, Option<Arc<SchemaText>>), usize>,
    room: Room,
}

impl Content {
    /// Empty content.
    pub fn new(purpose: Purpose, asked: Option<&str>) -> Self {
        Content { purpose, asked: asked.map(str::to_owned), ..Content::default() }
    }

    /// Reads one more file; `name` is the file's name where a bag is split into several.
    pub fn add(&mut self, input: Input<'_>, name: Option<&str>) -> Result<(), BagError> {
        let mut by_id: BTreeMap<u32, usize> = BTreeMap::new();
        let truncated = read(input, &mut |item| match item {
            Item::Channel(channel) => {
                let topic = self.topic_of(channel);
                by_id.insert(channel.id, topic);
                Ok(self.wanted(topic))
            }
            Item::Message(message) => {
                let Some(&topic) = by_id.get(&message.channel.id) else {
                    return Ok(Wanted::Counted);
                };
                self.topics[topic].count(1, (message.log_time, message.log_time));
                self.keep(topic, &message)?;
                Ok(self.wanted(topic))
            }
            Item::Passed(passed) => {
                if let Some(&topic) = by_id.get(&passed.channel.id) {
                    self.topics[topic].count(passed.count, passed.log_times);
                }
                Ok(Wanted::Counted)
            }
            Item::Metadata(lists::NAME, entries) => {
                self.lists.get_or_insert_default().add(entries.iter().copied());
                Ok(Wanted::Shown)
            }
            Item::Damaged(damaged) => {
                let Damaged { table, position, field, found, expected } = damaged;
                self.damaged.skip(SkippedRecord {
                    place: RecordPlace::At(position),
                    record: table.to_owned(),
                    field: field.to_owned(),
                    found: found.to_owned(),
                    expected: expected.to_owned(),
                });
                Ok(Wanted::Shown)
            }
            Item::Note(note) => {
                self.notes.push(note.to_owned());
                Ok(Wanted::Shown)
            }
            Item::Metadata(..) => Ok(Wanted::Shown),
        })?;
        let with_name = |reason| match name {
            Some(name) => format!("{name}: {reason}"),
            None => reason,
        };
        self.truncated = self.truncated.take().or(truncated.map(with_name));
        Ok(())
    }

    /// Index of a channel's topic.
    fn topic_of(&mut self, channel: &Channel) -> usize {
        let typed = |name: &String| {
            let (encoding, data) = (String::new(), Vec::new());
            Arc::new(SchemaText { name: name.clone(), encoding, data })
        };
        let description = channel.schema.clone();
        let description = description.or_else(|| self.types.get(&channel.topic).map(typed));
        let (name, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
        let key = (name.clone(), encoding.clone(), description.clone());
        *self.by_description.entry(key).or_insert_with(|| {
            let kind = description.as_ref().and_then(|text| match &*plain_name(&text.name) {
                STRING => (name == lists::TOPIC).then_some(MessageKind::Lists),
                type_name => MessageKind::of(type_name),
            });
            self.topics.push(Topic {
                name,
                encoding,
                description,
                kind: kind.filter(|&kind| self.purpose.keeps(kind)),
                messages: 0,
                logged: None,
                head: Vec::new(),
                layout: OnceCell::new(),
            });
            self.topics.len() - 1
        })
    }

    fn is_kept(&self, topic: &Topic) -> bool {
        let is_other = |kind: MessageKind| {
            kind.is_scan() && self.asked.as_ref().is_some_and(|asked| *asked != topic.name)
        };
        self.purpose != Purpose::Topics && topic.kind.is_some_and(|kind| !is_other(kind))
    }

    /// Keeps the head of each topic's first message, and all messages of usable topics.
    fn wanted(&self, topic: usize) -> Wanted {
        let topic = &self.topics[topic];
        match topic.messages == 0 || self.is_kept(topic) {
            true => Wanted::Shown,
            false => Wanted::Counted,
        }
    }

    fn keep(&mut self, topic: usize, message: &Message<'_>) -> Result<(), StreamProblem> {
        let found = &self.topics[topic];
        let (is_first, is_kept) = (found.messages == 1, self.is_kept(found));
        let number = found.messages.saturating_sub(1) as u32;
        if !is_first && !is_kept {
            return Ok(());
        }
        let data = unpacked(message);
        if is_first {
            self.topics[topic].head = data[..data.len().min(HEAD_BYTES)].to_vec();
        }
        if self.topics[topic].kind == Some(MessageKind::Lists) {
            let text = self.topics[topic].layout().ok().and_then(|layout| {
                let text = |view: &View<'_>| Ok(view.text("data")?.to_owned());
                layout.decode(MAX_CLOUD_BYTES, &data, text).ok()
            });
            if let Some(text) = text {
                self.lists.get_or_insert_default().add_text(&text);
            }
            return Ok(());
        }
        if !is_kept {
            return Ok(());
        }
        let decoded = (topic < DECODED_TOPICS).then(|| self.topics[topic].body(&data)).flatten();
        let kept = KeptMessage {
            topic,
            number,
            log_time: message.log_time,
            position: message.position,
            body: decoded.unwrap_or_else(|| Body::Encoded(data.into_owned())),
        };
        // Values are converted to those of a log one by one, but both are in memory meanwhile.
        let values = self.messages.len() * (size_of::<ScanMessage>() + size_of::<LaserScan>());
        self.room.take(kept.bytes(), 2 * values)?;
        if self.room.kept() > MAX_KEPT_BYTES {
            return Err(StreamProblem::TooMuch(MAX_KEPT_BYTES));
        }
        memory::reserve(&mut self.messages, 1, "messages")?;
        self.messages.push(kept);
        Ok(())
    }

    /// Whether no message was found.
    pub fn is_empty(&self) -> bool {
        self.topics.iter().all(|topic| topic.messages == 0)
    }

    /// Lists every topic with its type and number of messages.
    pub fn list(&self) -> String {
        list(self.topics.iter())
    }

    /// Messages of kinds that are not read, by topic.
    pub fn ignored(&self) -> BTreeMap<String, usize> {
        let is_ignored = |topic: &&Topic| topic.kind.is_none() && topic.messages > 0;
        let mut ignored = BTreeMap::new();
        for topic in self.topics.iter().filter(is_ignored) {
            *ignored.entry(topic.name.clone()).or_default() += topic.messages;
        }
        ignored
    }

    /// Names of the topics with messages of one of these kinds.
    pub(super) fn names(&self, kinds: &[MessageKind]) -> Vec<&str> {
        let of_kind = |topic: &&Topic| topic.kind.is_some_and(|kind| kinds.contains(&kind));
        let used = self.topics.iter().filter(of_kind).filter(|topic| topic.messages > 0);
        let names: BTreeSet<&str> = used.map(|topic| topic.name.as_str()).collect();
        names.into_iter().collect()
    }
}

/// The bytes of a message, which rosbag2 may have compressed one by one. CDR begins with a NUL, so the first
/// bytes show whether it is compressed. What does not decompress is kept, and fails to decode later.
fn unpacked<'a>(message: &Message<'a>) -> Cow<'a, [u8]> {
    if message.channel.message_encoding == "cdr" && message.data.starts_with(ZSTD_MAGIC) {
        let (data, outcome) = inflate(Compression::Zstd, message.data, MAX_CLOUD_BYTES as u64 + 1);
        if outcome.is_ok() {
            return data;
        }
    }
    Cow::Borrowed(message.data)
}

/// Topics with their types and numbers of messages.
pub(super) fn list<'a>(topics: impl Iterator<Item = &'a Topic>) -> String {
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
