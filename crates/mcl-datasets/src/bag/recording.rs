//! From the messages of a bag to a recording.

use std::collections::BTreeMap;

use mcl_core::{LaserScan, Pose2, Recording, Stamp};

use super::cdr::{Encoding, View};
use super::error::BagError;
use super::layout::{SchemaError, plain_name};
use super::messages::{
    MessageError, PoseMessage, ScanMessage, TransformMessage, malformed, planar,
};
use super::schema::MessageSchema;
use super::topics::{
    Chosen, Content, Kept, Kind, MAX_CLOUD_BYTES, MAX_MESSAGE_BYTES, Topic, choose,
};
use super::track::PoseTrack;
use super::transforms::{BASE_FRAMES, Mount, Transforms};
use super::types;
use crate::log::content::{Log, LogKind};
use crate::log::options::ReadOptions;
use crate::log::report::{Place, ReadReport, SkippedRecord};

/// Parent of the robot's frame in odometry, by REP 105.
const ODOMETRY_FRAME: &str = "odom";

/// Makes a recording of a bag's content.
pub(crate) fn assemble(content: Content, options: &ReadOptions) -> Result<Log, BagError> {
    let chosen = choose(&content, &options.topics, options.reference)?;
    let mut decoder = Decoder::new(&content);
    let scans = decoder.scans(chosen.scan)?;
    let odometry = match chosen.odometry {
        Some(topic) => decoder.poses(topic)?,
        None => Vec::new(),
    };
    let reference = match chosen.reference {
        Some(topic) => decoder.poses(topic)?,
        None => Vec::new(),
    };
    let frames = decoder.frames()?;
    let Decoder { report, notes, .. } = decoder;
    let assumptions = Vec::new();
    Assembly {
        content: &content,
        chosen,
        scans,
        odometry,
        reference,
        frames,
        report,
        notes,
        assumptions,
    }
    .log()
}

/// A message's value with what its record says.
pub(super) struct Logged<T> {
    pub value: T,
    sequence: u32,
    pub log_time: i64,
}

/// When the robot's frame was where, according to `/tf`.
pub(super) struct Frames {
    pub tree: Transforms,
    /// Transforms from the odometry's frame, by child, with stamp or else log time.
    from_odometry: BTreeMap<String, Vec<(i64, Pose2)>>,
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

    /// The values of all messages of a topic and of these kinds; malformed ones are skipped.
    pub fn topic<T>(
        &mut self,
        wanted: impl Fn(&str, Kind) -> bool,
        mut value: impl FnMut(Kind, &View<'_>, &Kept) -> Result<T, MessageError>,
    ) -> Result<Vec<Logged<T>>, BagError> {
        let content = self.content;
        let mut values = Vec::new();
        let mut count: BTreeMap<usize, usize> = BTreeMap::new();
        for message in &content.messages {
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
                std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
                std::collections::btree_map::Entry::Vacant(new) => {
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
            *count.entry(message.topic).or_default() += 1;
            let limit = if kind == Kind::Cloud { MAX_CLOUD_BYTES } else { MAX_MESSAGE_BYTES };
            let decoded = if message.data.len() > limit {
                let found = format!("{} bytes long", message.data.len());
                Err(malformed("the message", found, format!("at most {limit}")))
            } else {
                encoding
                    .decode(schema, &message.data)
                    .map_err(MessageError::from)
                    .and_then(|decoded| value(kind, &View::new(schema, &decoded), message))
            };
            match decoded {
                Ok(value) => values.push(Logged {
                    value,
                    sequence: message.sequence,
                    log_time: i64::try_from(message.log_time).unwrap_or(0),
                }),
                Err(MessageError::Schema(error)) => return Err(schema_error(error)),
                Err(MessageError::Malformed { field, found, expected }) => {
                    self.report.skip(SkippedRecord {
                        place: Place::Message {
                            topic: topic.name.clone(),
                            log_time: message.log_time,
                            position: message.position,
                        },
                        record: match kind {
                            Kind::Cloud => {
                                format!("{} {}", topic.type_name(), count[&message.topic])
                            }
                            _ => topic.type_name().to_owned(),
                        },
                        field,
                        found,
                        expected,
                    });
                }
            }
        }
        Ok(values)
    }

    pub fn scans(&mut self, topic: &str) -> Result<Vec<Logged<ScanMessage>>, BagError> {
        let mut frame: Option<String> = None;
        let scans = self.topic(
            |name, kind| name == topic && kind == Kind::Scan,
            |_, view, _| {
                let scan = ScanMessage::new(view)?;
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

    pub fn poses(&mut self, topic: &str) -> Result<Vec<Logged<PoseMessage>>, BagError> {
        let (mut frame, mut child) = (None, None);
        self.topic(
            |name, kind| name == topic && !matches!(kind, Kind::Scan | Kind::Transforms),
            |kind, view, _| {
                let pose = match kind {
                    Kind::Odometry => PoseMessage::odometry(view)?,
                    Kind::PoseWithCovariance => PoseMessage::pose_with_covariance(view)?,
                    _ => PoseMessage::pose(view)?,
                };
                same_frame("header.frame_id", &mut frame, &pose.header.frame)?;
                if let Some(found) = &pose.child {
                    same_frame("child_frame_id", &mut child, found)?;
                }
                Ok(pose)
            },
        )
    }

    /// The frame whose poses the bag's only odometry topic holds.
    pub fn odometry_frame(&mut self) -> Result<Option<String>, BagError> {
        let content = self.content;
        let &[only] = content.names(&[Kind::Odometry]).as_slice() else { return Ok(None) };
        let first = self.poses(only)?.into_iter().next();
        Ok(first.and_then(|pose| pose.value.child).filter(|child| !child.is_empty()))
    }

    pub fn frames(&mut self) -> Result<Frames, BagError> {
        let mut tree = Transforms::default();
        let mut from_odometry: BTreeMap<String, Vec<(i64, Pose2)>> = BTreeMap::new();
        for is_static in [true, false] {
            let messages = self.topic(
                |name, kind| kind == Kind::Transforms && name.ends_with("tf_static") == is_static,
                |_, view, _| TransformMessage::all(view),
            )?;
            for Logged { value, log_time, .. } in messages {
                for transform in value {
                    tree.insert(&transform, is_static);
                    if !is_static {
                        let pose = planar(&transform.parent_from_child);
                        let key = format!("{} {}", transform.header.frame, transform.child);
                        let stamp = time(transform.header.stamp, log_time);
                        from_odometry.entry(key).or_default().push((stamp, pose));
                    }
                }
            }
        }
        Ok(Frames { tree, from_odometry })
    }
}

/// The layout of a standard type, for a topic without a description.
fn standard(topic: &Topic) -> Option<Result<MessageSchema, SchemaError>> {
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

struct Assembly<'a> {
    content: &'a Content,
    chosen: Chosen<'a>,
    scans: Vec<Logged<ScanMessage>>,
    odometry: Vec<Logged<PoseMessage>>,
    reference: Vec<Logged<PoseMessage>>,
    frames: Frames,
    report: ReadReport,
    notes: Vec<String>,
    assumptions: Vec<String>,
}

impl Assembly<'_> {
    fn log(mut self) -> Result<Log, BagError> {
        let (base, odometry) = self.odometry_track();
        let laser = self.scans[0].value.header.frame.clone();
        let base = base.unwrap_or_else(|| self.base_frame(&laser));
        self.notes.push(format!("scans: {}, frame {laser:?}", self.chosen.scan));
        let mount = self.mount(&base, &laser)?;
        let times: Vec<i64> =
            self.scans.iter().map(|scan| time(scan.value.header.stamp, scan.log_time)).collect();
        let reference = self.reference_track(&times)?;
        // From the frame that the reference is of.
        let reference_child = self.reference.first().and_then(|pose| pose.value.child.clone());
        let reference_mount = match reference_child.filter(|child| *child != base) {
            Some(child) => self.frames.tree.mount(&child, &laser)?.unwrap_or(mount),
            None => mount,
        };
        let on = |mount: Mount, robot: Pose2| match mount.robot_from_laser == Pose2::IDENTITY {
            true => robot,
            false => robot.compose(&mount.robot_from_laser),
        };
        let occurrences = occurrences(&times);
        let mut scans: Vec<LaserScan> = Vec::with_capacity(self.scans.len());
        let mut before: Option<Pose2> = None;
        let (mut by_log_time, mut outside_odometry, mut outside_reference) = (0, 0, 0);
        for ((logged, &at), &occurrence) in self.scans.iter().zip(&times).zip(&occurrences) {
            let header = logged.value.header.stamp;
            let stamp = match &self.content.unstamped {
                Some(unstamped) => {
                    (!unstamped.contains(&logged.sequence) && header >= 0).then_some(header)
                }
                None => {
                    by_log_time += usize::from(header <= 0);
                    Some(at)
                }
            };
            self.report.unusable_stamps += usize::from(stamp.is_none());
            let laser_in = |track: &Option<PoseTrack>, mount| {
                track
                    .as_ref()
                    .and_then(|track| track.at(at, occurrence))
                    .map(|pose| on(mount, pose))
            };
            let odometry_pose = laser_in(&odometry, mount);
            let map_from_laser = laser_in(&reference, reference_mount);
            outside_odometry += usize::from(odometry.is_some() && odometry_pose.is_none());
            outside_reference += usize::from(reference.is_some() && map_from_laser.is_none());
            let increment = match (scans.is_empty(), before, odometry_pose) {
                (false, Some(before), Some(pose)) => Some(before.between(&pose)),
                _ => None,
            };
            before = odometry_pose;
            scans.push(LaserScan {
                stamp: stamp.map(Stamp::from_nanoseconds),
                geometry: mount.seen_from_above(logged.value.geometry),
                ranges: logged.value.ranges.clone(),
                map_from_laser,
                odometry: increment,
            });
        }
        if by_log_time > 0 {
            self.assumptions.push(format!(
                "stamps: scans without a stamp in their header: {by_log_time}; the time they were logged is taken"
            ));
        }
        for (outside, what) in [(outside_odometry, "odometry"), (outside_reference, "reference")] {
            if outside > 0 {
                let which = if outside == 1 {
                    "1 scan lies".to_owned()
                } else {
                    format!("{outside} scans lie")
                };
                self.assumptions.push(format!(
                    "{which} before the first or after the last {what} message: nothing is extrapolated, so no {what} there"
                ));
            }
        }
        Ok(Log {
            recording: Recording { scans, robot_from_laser: mount.robot_from_laser },
            kind: LogKind::Bag,
            report: self.report,
            front_laser_offset: None,
            notes: self.notes,
            assumptions: self.assumptions,
        })
    }

    /// The robot's frame and its poses in the odometry's frame: of the odometry's topic, and before
    /// and after that of `/tf`, which tells the same.
    fn odometry_track(&mut self) -> (Option<String>, Option<PoseTrack>) {
        let samples = |poses: &[Logged<PoseMessage>]| {
            let sample = |pose: &Logged<PoseMessage>| {
                (time(pose.value.header.stamp, pose.log_time), pose.value.pose)
            };
            poses.iter().map(sample).collect::<Vec<_>>()
        };
        if let (Some(topic), Some(first)) = (self.chosen.odometry, self.odometry.first()) {
            let frame = &first.value.header.frame;
            let base = first.value.child.clone().filter(|child| !child.is_empty());
            self.notes.push(format!(
                "odometry: {topic}, {} messages, frame {frame:?} to {:?}",
                self.odometry.len(),
                base.as_deref().unwrap_or_default()
            ));
            let on_tf = base
                .as_ref()
                .and_then(|base| self.frames.from_odometry.get(&format!("{frame} {base}")));
            let track = PoseTrack::new(samples(&self.odometry));
            let track = match (track, on_tf) {
                (Some(track), Some(on_tf)) => Some(track.extended_by(on_tf)),
                (track, _) => track,
            };
            return (base, track);
        }
        let on_tf = BASE_FRAMES.iter().find_map(|base| {
            let key = format!("{ODOMETRY_FRAME} {base}");
            self.frames.from_odometry.get(&key).map(|samples| (*base, samples.clone()))
        });
        match on_tf {
            Some((base, samples)) => {
                let count = samples.len();
                self.notes.push(format!(
                    "odometry: no topic of nav_msgs/msg/Odometry; {count} transforms from {ODOMETRY_FRAME:?} to {base:?} on /tf"
                ));
                (Some(base.to_owned()), PoseTrack::new(samples))
            }
            None => {
                self.notes.push("odometry: none in the bag".to_owned());
                (None, None)
            }
        }
    }

    /// The robot's frame where no odometry tells it: of the usual ones that which the laser is fixed
    /// to, else the laser's own.
    fn base_frame(&self, laser: &str) -> String {
        self.frames.tree.base_of(laser).unwrap_or(laser).to_owned()
    }

    fn mount(&mut self, base: &str, laser: &str) -> Result<Mount, BagError> {
        match self.frames.tree.mount(base, laser)? {
            Some(mount) => {
                let Pose2 { x, y, theta } = mount.robot_from_laser;
                let turned = if mount.is_upside_down { ", upside down" } else { "" };
                self.notes.push(format!(
                    "laser on {base:?}: x {x:.3} m, y {y:.3} m, turned by {:.1}°{turned}",
                    theta.to_degrees()
                ));
                Ok(mount)
            }
            None => {
                let why = match self.frames.tree.contains(laser) {
                    true => "no transforms lead from one to the other",
                    false => "no transform says where it is",
                };
                self.assumptions.push(format!(
                    "laser on {base:?}: {why}, so it is taken to be at the robot's origin, looking ahead"
                ));
                Ok(Mount::IDENTITY)
            }
        }
    }

    fn reference_track(&mut self, times: &[i64]) -> Result<Option<PoseTrack>, BagError> {
        let Some(topic) = self.chosen.reference else {
            self.notes.push("reference: none".to_owned());
            return Ok(None);
        };
        let sample = |pose: &Logged<PoseMessage>| {
            (time(pose.value.header.stamp, pose.log_time), pose.value.pose)
        };
        let Some(track) = PoseTrack::new(self.reference.iter().map(sample).collect()) else {
            self.assumptions.push(format!("reference: {topic} has no readable message"));
            return Ok(None);
        };
        let (start, end) = track.span();
        let scan_start = times.iter().copied().min().unwrap_or_default();
        let scan_end = times.iter().copied().max().unwrap_or_default();
        if end < scan_start || start > scan_end {
            return Err(BagError::NoOverlap {
                topic: topic.to_owned(),
                scan_topic: self.chosen.scan.to_owned(),
                reference_start: Stamp::from_nanoseconds(start),
                reference_end: Stamp::from_nanoseconds(end),
                scan_start: Stamp::from_nanoseconds(scan_start),
                scan_end: Stamp::from_nanoseconds(scan_end),
            });
        }
        self.notes.push(format!("reference: {topic}, {} messages", self.reference.len()));
        Ok(Some(track))
    }
}

/// How often each time has been there before.
fn occurrences(times: &[i64]) -> Vec<usize> {
    let mut seen: BTreeMap<i64, usize> = BTreeMap::new();
    let mut occurrence = |&time: &i64| {
        let count = seen.entry(time).or_default();
        *count += 1;
        *count - 1
    };
    times.iter().map(&mut occurrence).collect()
}
