//! From the messages of a bag to values, in the order of the bag.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use super::cdr::View;
use super::content::{
    Body, Content, KeptMessage, Layout, MAX_CLOUD_BYTES, MAX_MESSAGE_BYTES, MessageKind,
};
use super::error::BagError;
use super::messages::{
    MessageError, OdometryMessage, PoseMessage, ScanMessage, TransformMessage, malformed,
    path_poses,
};
use super::moment::Stretches;
use super::motion::Motion;
use crate::log::report::{ReadReport, RecordPlace, SkippedRecord};

/// A message's value, with its position and log time.
pub(super) struct Logged<T> {
    pub value: T,
    /// Its index among the messages of its topic.
    pub number: u32,
    pub log_time: i64,
    /// Its index among the messages of the bag.
    pub place: usize,
}

impl<T> Logged<T> {
    fn map<U>(&self, value: U) -> Logged<U> {
        let Logged { number, log_time, place, .. } = *self;
        Logged { value, number, log_time, place }
    }

    fn split(self) -> (Logged<()>, T) {
        (self.map(()), self.value)
    }
}

/// A transform, and the topic it was published on.
pub(super) struct PublishedTransform<'a> {
    pub transform: Logged<TransformMessage>,
    pub topic: &'a str,
    pub is_static: bool,
}

pub(super) struct Decoder<'a> {
    content: &'a Content,
    messages: Vec<KeptMessage>,
    /// Topics whose messages were decoded.
    decoded: BTreeSet<usize>,
    pub report: ReadReport,
    /// Remarks on decoding, where it did not follow the bag's own description.
    pub notes: Vec<String>,
}

impl<'a> Decoder<'a> {
    /// A decoder of these messages of a bag.
    pub fn new(content: &'a Content, messages: Vec<KeptMessage>) -> Self {
        let ignored_kinds = content.ignored();
        let report = ReadReport {
            ignored: ignored_kinds.values().sum(),
            ignored_kinds,
            truncated: content.truncated.clone(),
            ..content.damaged.clone()
        };
        let notes = content.notes.clone();
        Decoder { content, messages, decoded: BTreeSet::new(), report, notes }
    }

    /// The values of all messages of a topic of these kinds; malformed ones are skipped. `value` adds errors
    /// in a part of a message to its last argument.
    pub fn topic<T>(
        &mut self,
        wanted: impl Fn(&str, MessageKind) -> bool,
        mut value: impl FnMut(
            MessageKind,
            &View<'_>,
            &KeptMessage,
            &mut Vec<MessageError>,
        ) -> Result<T, MessageError>,
    ) -> Result<Vec<Logged<T>>, BagError> {
        self.each(wanted, |kind, layout, message, faults| match &message.body {
            Body::Encoded(data) => {
                layout.decode(limit(kind), data, |view| value(kind, view, message, faults))
            }
            _ => Err(decoded_before()),
        })
    }

    /// The poses of an odometry topic, as transforms between its two frames.
    pub fn odometry(&mut self, topic: &str) -> Result<Vec<Logged<TransformMessage>>, BagError> {
        self.each(
            |name, kind| name == topic && kind == MessageKind::Odometry,
            |kind, layout, message, _| match &message.body {
                Body::Odometry(moved) => Ok(moved.transform.clone()),
                Body::Encoded(data) => layout
                    .decode(limit(kind), data, OdometryMessage::new)
                    .map(|moved| moved.transform),
                Body::Scan(_) => Err(decoded_before()),
            },
        )
    }

    fn each<T>(
        &mut self,
        wanted: impl Fn(&str, MessageKind) -> bool,
        mut value: impl FnMut(
            MessageKind,
            &Layout,
            &mut KeptMessage,
            &mut Vec<MessageError>,
        ) -> Result<T, MessageError>,
    ) -> Result<Vec<Logged<T>>, BagError> {
        let content = self.content;
        let mut values = Vec::new();
        let mut count: BTreeMap<usize, usize> = BTreeMap::new();
        for (place, message) in self.messages.iter_mut().enumerate() {
            let topic = &content.topics[message.topic];
            let Some(kind) = topic.kind.filter(|&kind| wanted(&topic.name, kind)) else { continue };
            let layout = topic.layout()?;
            if self.decoded.insert(message.topic) && layout.is_standard {
                self.notes.push(format!(
                    "{}: the bag does not describe {}, so it is read as the standard type",
                    topic.name,
                    topic.type_name()
                ));
            }
            let count = count.entry(message.topic).or_default();
            *count += 1;
            let mut faults = Vec::new();
            match value(kind, layout, message, &mut faults) {
                Ok(value) => values.push(Logged {
                    value,
                    number: message.number,
                    log_time: i64::try_from(message.log_time).unwrap_or(0),
                    place,
                }),
                Err(error) => faults.push(error),
            }
            for fault in faults {
                match fault {
                    MessageError::Schema(error) => return Err(topic.schema_error(error)),
                    MessageError::Malformed { field, found, expected } => {
                        self.report.skip(SkippedRecord {
                            place: RecordPlace::Message {
                                topic: topic.name.clone(),
                                log_time: message.log_time,
                                position: message.position,
                            },
                            record: match kind {
                                MessageKind::Cloud => format!("{} {count}", topic.type_name()),
                                _ => topic.type_name().to_owned(),
                            },
                            field,
                            found,
                            expected,
                        });
                    }
                }
            }
        }
        Ok(values)
    }

    /// The scans of a topic without repetitions; `of_cloud` converts point clouds to scans.
    pub fn scans(
        &mut self,
        topic: &str,
        of_cloud: impl Fn(&View<'_>) -> Result<ScanMessage, MessageError>,
    ) -> Result<Vec<Logged<ScanMessage>>, BagError> {
        let mut frame: Option<String> = None;
        let scans = self.each(
            |name, kind| name == topic && kind.is_scan(),
            |kind, layout, message, _| {
                let scan = match std::mem::replace(&mut message.body, Body::Encoded(Vec::new())) {
                    Body::Scan(scan) => *scan,
                    Body::Odometry(_) => return Err(decoded_before()),
                    Body::Encoded(data) => {
                        layout.decode(limit(kind), &data, |view| match kind {
                            MessageKind::Scan => ScanMessage::new(view),
                            MessageKind::MultiEcho => ScanMessage::multi_echo(view),
                            _ => of_cloud(view),
                        })?
                    }
                };
                same_frame("header.frame_id", &mut frame, &scan.header.frame)?;
                Ok(scan)
            },
        )?;
        if scans.is_empty() {
            let because = match self.report.is_complete() {
                true => None,
                false => Some(self.report.to_string()),
            };
            return Err(BagError::NoScan { topics: self.content.list(), because });
        }
        Ok(scans)
    }

    /// The poses of a topic whose messages hold one pose or several.
    pub fn poses(&mut self, topic: &str) -> Result<Vec<Logged<PoseMessage>>, BagError> {
        let (mut frame, mut child) = (None, None);
        let messages = self.each(
            |name, kind| name == topic && kind.is_pose(),
            |kind, layout, message, faults| {
                let poses = match &message.body {
                    Body::Odometry(moved) => vec![PoseMessage::of_odometry((**moved).clone())],
                    Body::Encoded(data) => layout.decode(limit(kind), data, |view| {
                        Ok(match kind {
                            MessageKind::Odometry => {
                                vec![PoseMessage::of_odometry(OdometryMessage::new(view)?)]
                            }
                            MessageKind::PoseWithCovariance => {
                                vec![PoseMessage::pose_with_covariance(view)?]
                            }
                            MessageKind::Transform => {
                                vec![PoseMessage::of(TransformMessage::one(view)?)]
                            }
                            MessageKind::Path => path_poses(view, faults)?,
                            _ => vec![PoseMessage::pose(view)?],
                        })
                    })?,
                    Body::Scan(_) => return Err(decoded_before()),
                };
                for pose in &poses {
                    same_frame("header.frame_id", &mut frame, &pose.header.frame)?;
                    if let Some(found) = &pose.child {
                        same_frame("child_frame_id", &mut child, found)?;
                    }
                }
                Ok((kind, poses))
            },
        )?;
        let mut poses: Vec<Logged<PoseMessage>> = Vec::new();
        // A path repeats earlier poses, perhaps corrected: the last one of a stamp counts.
        let mut of_paths: BTreeMap<i64, Logged<PoseMessage>> = BTreeMap::new();
        for message in messages {
            let (message, (kind, several)) = message.split();
            for pose in several {
                let pose = message.map(pose);
                if kind != MessageKind::Path {
                    poses.push(pose);
                    continue;
                }
                let stamp = pose.value.header.stamp;
                match of_paths.entry(stamp) {
                    Entry::Occupied(mut known) => known.get_mut().value = pose.value,
                    Entry::Vacant(new) => drop(new.insert(pose)),
                }
            }
        }
        poses.extend(of_paths.into_values());
        Ok(poses)
    }

    /// The child frame of the bag's only odometry topic.
    pub fn odometry_frame(&mut self) -> Result<Option<String>, BagError> {
        let content = self.content;
        let &[only] = content.names(&[MessageKind::Odometry]).as_slice() else { return Ok(None) };
        let first = self.poses(only)?.into_iter().next();
        Ok(first.and_then(|pose| pose.value.child).filter(|child| !child.is_empty()))
    }

    /// The transforms of these topics, static ones first.
    pub fn transforms(
        &mut self,
        topics: &[&'a str],
    ) -> Result<Vec<PublishedTransform<'a>>, BagError> {
        let content = self.content;
        let mut published = Vec::new();
        for is_static in [true, false] {
            let messages = self.topic(
                |name, kind| {
                    kind == MessageKind::Transforms
                        && name.ends_with("tf_static") == is_static
                        && topics.contains(&name)
                },
                |_, view, message, faults| {
                    Ok((message.topic, TransformMessage::all(view, faults)?))
                },
            )?;
            for message in messages {
                let (message, (topic, transforms)) = message.split();
                let topic = content.topics[topic].name.as_str();
                for transform in transforms {
                    let transform = message.map(transform);
                    published.push(PublishedTransform { transform, topic, is_static });
                }
            }
        }
        Ok(published)
    }
}

/// The tree of frames that these transforms form; not sorted yet.
pub(super) fn tree(transforms: &[PublishedTransform<'_>], stretches: &Stretches) -> Motion {
    let mut motion = Motion::default();
    for PublishedTransform { transform, topic, is_static } in transforms {
        let at = time(transform.value.header.stamp, transform.log_time);
        let moment = stretches.moment(transform.place, at);
        motion.insert(transform.value.clone(), moment, *is_static, topic);
    }
    motion
}

/// The error for a message decoded as another type than its topic's, which does not happen.
fn decoded_before() -> MessageError {
    malformed("the message", "decoded as another type", "one of its topic's type")
}

/// Largest message decoded, in bytes.
fn limit(kind: MessageKind) -> usize {
    if kind == MessageKind::Cloud { MAX_CLOUD_BYTES } else { MAX_MESSAGE_BYTES }
}

/// Poses in different frames cannot be compared: those in another frame than the first count as malformed.
pub(super) fn same_frame(
    field: &str,
    known: &mut Option<String>,
    found: &str,
) -> Result<(), MessageError> {
    match known {
        Some(known) if known != found => Err(malformed(
            field,
            format!("{found:?}"),
            format!("{known:?} as in the first message"),
        )),
        _ => {
            *known = Some(found.to_owned());
            Ok(())
        }
    }
}

/// Time of a message (ns): its stamp, or its log time where the stamp is 0 or before 1970.
pub(super) fn time(stamp: i64, log_time: i64) -> i64 {
    if stamp > 0 { stamp } else { log_time }
}
