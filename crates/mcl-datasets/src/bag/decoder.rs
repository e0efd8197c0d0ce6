//! From the messages of a bag to values, in the order of the bag.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::cdr::{Encoding, View};
use super::error::BagError;
use super::layout::{SchemaError, plain_name};
use super::messages::{
    MessageError, PoseMessage, ScanMessage, TransformMessage, malformed, path_poses,
};
use super::moment::Stretches;
use super::motion::Motion;
use super::schema::MessageSchema;
use super::topics::{Content, Kept, Kind, MAX_CLOUD_BYTES, MAX_MESSAGE_BYTES, Topic};
use super::types;
use crate::log::report::{Place, ReadReport, SkippedRecord};

/// A message's value with what its record says.
pub(super) struct Logged<T> {
    pub value: T,
    pub sequence: u32,
    pub log_time: i64,
    /// Its place among the messages of the bag.
    pub place: usize,
}

impl<T> Logged<T> {
    fn map<U>(&self, value: U) -> Logged<U> {
        let Logged { sequence, log_time, place, .. } = *self;
        Logged { value, sequence, log_time, place }
    }
}

/// A transform, and the topic that told it.
pub(super) struct ToldTransform<'a> {
    pub transform: Logged<TransformMessage>,
    pub topic: &'a str,
    pub is_static: bool,
}

pub(super) struct Decoder<'a> {
    content: &'a Content,
    schemas: BTreeMap<usize, MessageSchema>,
    pub report: ReadReport,
    /// How messages were decoded, where that is not as the bag describes them.
    pub notes: Vec<String>,
}

impl<'a> Decoder<'a> {
    pub fn new(content: &'a Content) -> Self {
        let report = ReadReport {
            ignored: content.ignored(),
            truncated: content.truncated.clone(),
            ..ReadReport::default()
        };
        Decoder { content, schemas: BTreeMap::new(), report, notes: Vec::new() }
    }

    /// The values of all messages of a topic and of these kinds; malformed ones are skipped. What is wrong
    /// with a part of a message, `value` adds to its last argument.
    pub fn topic<T>(
        &mut self,
        wanted: impl Fn(&str, Kind) -> bool,
        mut value: impl FnMut(Kind, &View<'_>, &Kept, &mut Vec<MessageError>) -> Result<T, MessageError>,
    ) -> Result<Vec<Logged<T>>, BagError> {
        let content = self.content;
        let mut values = Vec::new();
        let mut count: BTreeMap<usize, usize> = BTreeMap::new();
        for (place, message) in content.messages.iter().enumerate() {
            let topic = &content.topics[message.topic];
            let Some(kind) = topic.kind.filter(|&kind| wanted(&topic.name, kind)) else { continue };
            let schema_error = |error| BagError::Schema {
                topic: topic.name.clone(),
                schema: topic.type_name().to_owned(),
                error: Box::new(error),
            };
            let Some(encoding) = Encoding::named(&topic.encoding) else {
                let encoding = topic.encoding.clone();
                return Err(BagError::Encoding { topic: topic.name.clone(), encoding });
            };
            let schema = match self.schemas.entry(message.topic) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => {
                    // Kinds are told by the schema's name, so there is one.
                    let Some(text) = &topic.schema else { continue };
                    let standard = text.data.is_empty().then(|| standard(topic)).flatten();
                    let schema = match standard {
                        Some(standard) => {
                            self.notes.push(format!(
                                "{}: the bag does not describe {}, so it is read as the standard type",
                                topic.name, text.name
                            ));
                            standard
                        }
                        None => MessageSchema::parse(&text.name, &text.encoding, &text.data),
                    };
                    new.insert(schema.map_err(schema_error)?)
                }
            };
            let count = count.entry(message.topic).or_default();
            *count += 1;
            let limit = if kind == Kind::Cloud { MAX_CLOUD_BYTES } else { MAX_MESSAGE_BYTES };
            let mut faults = Vec::new();
            let decoded = if message.data.len() > limit {
                let found = format!("{} bytes long", message.data.len());
                Err(malformed("the message", found, format!("at most {limit}")))
            } else {
                encoding.decode(schema, &message.data).map_err(MessageError::from).and_then(
                    |decoded| value(kind, &View::new(schema, &decoded), message, &mut faults),
                )
            };
            match decoded {
                Ok(value) => values.push(Logged {
                    value,
                    sequence: message.sequence,
                    log_time: i64::try_from(message.log_time).unwrap_or(0),
                    place,
                }),
                Err(error) => faults.push(error),
            }
            for fault in faults {
                match fault {
                    MessageError::Schema(error) => return Err(schema_error(error)),
                    MessageError::Malformed { field, found, expected } => {
                        self.report.skip(SkippedRecord {
                            place: Place::Message {
                                topic: topic.name.clone(),
                                log_time: message.log_time,
                                position: message.position,
                            },
                            record: match kind {
                                Kind::Cloud => format!("{} {count}", topic.type_name()),
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

    /// The scans of a topic; `of_cloud` makes them of point clouds.
    pub fn scans(
        &mut self,
        topic: &str,
        of_cloud: impl Fn(&View<'_>) -> Result<ScanMessage, MessageError>,
    ) -> Result<Vec<Logged<ScanMessage>>, BagError> {
        let mut frame: Option<String> = None;
        let scans = self.topic(
            |name, kind| name == topic && kind.is_scan(),
            |kind, view, _, _| {
                let scan = match kind {
                    Kind::Scan => ScanMessage::new(view)?,
                    Kind::MultiEcho => ScanMessage::multi_echo(view)?,
                    _ => of_cloud(view)?,
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

    /// The poses of a topic, of a kind that has one pose or several.
    pub fn poses(&mut self, topic: &str) -> Result<Vec<Logged<PoseMessage>>, BagError> {
        let (mut frame, mut child) = (None, None);
        let messages = self.topic(
            |name, kind| name == topic && kind.is_pose(),
            |kind, view, _, faults| {
                let poses = match kind {
                    Kind::Odometry => vec![PoseMessage::odometry(view)?],
                    Kind::PoseWithCovariance => vec![PoseMessage::pose_with_covariance(view)?],
                    Kind::Transform => vec![PoseMessage::transform(view)?],
                    Kind::Path => path_poses(view, faults)?,
                    _ => vec![PoseMessage::pose(view)?],
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
        // A path repeats what it said before, and may have corrected it: the last one counts.
        let mut of_paths: BTreeMap<i64, Logged<PoseMessage>> = BTreeMap::new();
        for message in messages {
            let (kind, several) = &message.value;
            for pose in several {
                let pose = message.map(pose.clone());
                if *kind != Kind::Path {
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

    /// The frame whose poses the bag's only odometry topic holds.
    pub fn odometry_frame(&mut self) -> Result<Option<String>, BagError> {
        let content = self.content;
        let &[only] = content.names(&[Kind::Odometry]).as_slice() else { return Ok(None) };
        let first = self.poses(only)?.into_iter().next();
        Ok(first.and_then(|pose| pose.value.child).filter(|child| !child.is_empty()))
    }

    /// The transforms of these topics, static ones first.
    pub fn transforms(&mut self, topics: &[&'a str]) -> Result<Vec<ToldTransform<'a>>, BagError> {
        let content = self.content;
        let mut told = Vec::new();
        for is_static in [true, false] {
            let messages = self.topic(
                |name, kind| {
                    kind == Kind::Transforms
                        && name.ends_with("tf_static") == is_static
                        && topics.contains(&name)
                },
                |_, view, message, faults| {
                    Ok((message.topic, TransformMessage::all(view, faults)?))
                },
            )?;
            for message in messages {
                let (topic, transforms) = &message.value;
                let topic = content.topics[*topic].name.as_str();
                for transform in transforms {
                    let transform = message.map(transform.clone());
                    told.push(ToldTransform { transform, topic, is_static });
                }
            }
        }
        Ok(told)
    }
}

/// The tree of frames that transforms tell; to be sorted.
pub(super) fn tree(transforms: &[ToldTransform<'_>], stretches: &Stretches) -> Motion {
    let mut motion = Motion::default();
    for ToldTransform { transform, topic, is_static } in transforms {
        let at = time(transform.value.header.stamp, transform.log_time);
        let moment = stretches.moment(transform.place, at);
        motion.insert(transform.value.clone(), moment, *is_static, topic);
    }
    motion
}

/// The layout of a standard type, for a topic without a description.
pub(super) fn standard(topic: &Topic) -> Option<Result<MessageSchema, SchemaError>> {
    let kind = types::named(&plain_name(topic.type_name()))?;
    let (language, text) = match topic.encoding.as_str() {
        "ros1" => ("ros1msg", kind.description_of_ros1()),
        _ => ("ros2msg", kind.description()),
    };
    Some(MessageSchema::parse(kind.name, language, text.as_bytes()))
}

/// Poses in different frames cannot be compared: those in another frame than the first are malformed.
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

/// When a message was: its stamp, or when it was logged, where the stamp is 0 or before 1970.
pub(super) fn time(stamp: i64, log_time: i64) -> i64 {
    if stamp > 0 { stamp } else { log_time }
}
