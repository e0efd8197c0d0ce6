//! Writing a recording as a ROS 2 bag.

use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::ops::Range;

use mcap::records::{MessageHeader, Metadata};
use mcl_core::{LaserScan, Pose2, Recording, Stamp};

use super::encode::Encoder;
use super::types::{LASER_SCAN, MessageType, ODOMETRY, POSE_STAMPED, TF_MESSAGE};
use crate::mount::Mount;

/// Name of the metadata record that says which scans have no stamp.
pub(super) const METADATA_NAME: &str = "mcl-eval";
/// Its key: sequence numbers of the scans on `/scan` that have no stamp, parted by blanks. In a bag
/// that has the record, a stamp of 0 of any other scan is a time.
pub(super) const UNSTAMPED_KEY: &str = "scans_without_stamp";
/// Unpacked bytes of a chunk. Small, because a file that is cut off loses most of its last chunk.
const CHUNK_BYTES: u64 = 64 << 10;
const MAP_FRAME: &str = "map";
const ODOMETRY_FRAME: &str = "odom";
const BASE_FRAME: &str = "base_link";
const LASER_FRAME: &str = "laser";

/// Why a recording cannot be written as a bag.
#[derive(Debug, thiserror::Error)]
pub enum WriteBagError {
    /// The sink fails.
    #[error("cannot write the bag: {0}")]
    Mcap(#[from] mcap::McapError),
    /// There is nothing to write.
    #[error("the recording has no scan, expected at least one")]
    NoScan,
    /// A scan has no beams, or not as many readings as beams.
    #[error(
        "scan {scan} has {readings} readings for {beams} beams, expected one for each, and at least one"
    )]
    Readings {
        /// Index of the scan, from 0.
        scan: usize,
        /// Number of readings.
        readings: usize,
        /// Number of beams of its geometry.
        beams: usize,
    },
    /// A stamp that ROS cannot hold.
    #[error(
        "scan {scan} has the stamp {stamp} s, expected one from 0 to 2147483647 s (ROS times are 32-bit seconds)"
    )]
    Stamp {
        /// Index of the scan, from 0.
        scan: usize,
        /// Its stamp.
        stamp: Stamp,
    },
    /// A pose is not finite.
    #[error("scan {scan}: the {what} is not finite")]
    NotFinite {
        /// Index of the scan, from 0.
        scan: usize,
        /// What is not finite.
        what: &'static str,
    },
    /// Scans in the middle of the recording lack what those around them have.
    #[error(
        "scan {scan} has no {what}, but scans before and after it have: a bag would fill the gap by interpolation"
    )]
    Gap {
        /// Index of the scan, from 0.
        scan: usize,
        /// What it lacks.
        what: &'static str,
    },
}

/// How a topic offers its messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// To those who listen.
    Live,
    /// The last ones also to those who listen later, as `/tf_static` must.
    Latched,
}

/// A bag being written: profile `ros2`, CDR messages with their descriptions, zstd chunks, index and
/// summary. The same calls give the same bytes.
pub struct BagWriter<W: Write + Seek> {
    writer: mcap::Writer<W>,
    sequences: BTreeMap<u16, u32>,
}

/// A topic of a [`BagWriter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(u16);

impl<W: Write + Seek> BagWriter<W> {
    /// Begins a bag.
    ///
    /// # Errors
    /// When the sink fails; so for all methods.
    pub fn new(sink: W) -> Result<Self, WriteBagError> {
        let writer = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("mcl-eval/", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd))
            .chunk_size(Some(CHUNK_BYTES))
            // Threads would not change the bytes, but are not worth it.
            .compression_threads(0)
            .create(sink)?;
        Ok(BagWriter { writer, sequences: BTreeMap::new() })
    }

    /// Adds a topic.
    ///
    /// # Errors
    /// When the sink fails.
    pub fn topic(
        &mut self,
        name: &str,
        message: &MessageType,
        delivery: Delivery,
    ) -> Result<TopicId, WriteBagError> {
        let text = message.description();
        let schema = self.writer.add_schema(message.name, "ros2msg", text.as_bytes())?;
        let qos = ("offered_qos_profiles".to_owned(), qos(delivery));
        let id = self.writer.add_channel(schema, name, "cdr", &BTreeMap::from([qos]))?;
        Ok(TopicId(id))
    }

    /// Adds a message; messages of a topic are numbered from 0.
    ///
    /// # Errors
    /// When the sink fails.
    pub fn write(
        &mut self,
        topic: TopicId,
        log_time: u64,
        message: Encoder,
    ) -> Result<(), WriteBagError> {
        let next = self.sequences.entry(topic.0).or_default();
        let header = MessageHeader {
            channel_id: topic.0,
            sequence: *next,
            log_time,
            publish_time: log_time,
        };
        *next = next.wrapping_add(1);
        Ok(self.writer.write_to_known_channel(&header, &message.into_bytes())?)
    }

    /// Adds a metadata record.
    ///
    /// # Errors
    /// When the sink fails.
    pub fn metadata(
        &mut self,
        name: &str,
        entries: BTreeMap<String, String>,
    ) -> Result<(), WriteBagError> {
        Ok(self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata: entries })?)
    }

    /// Ends the bag, and gives back the sink.
    ///
    /// # Errors
    /// When the sink fails.
    pub fn finish(mut self) -> Result<W, WriteBagError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }
}

/// Quality of service as rosbag2 writes it into bags up to its version 8, and reads it in all:
/// keep last, reliable, volatile (2) or transient local (1).
fn qos(delivery: Delivery) -> String {
    let (depth, durability) = match delivery {
        Delivery::Live => (10, 2),
        Delivery::Latched => (1, 1),
    };
    format!(
        "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  \
         deadline:\n    sec: 0\n    nsec: 0\n  lifespan:\n    sec: 0\n    nsec: 0\n  \
         liveliness: 1\n  liveliness_lease_duration:\n    sec: 0\n    nsec: 0\n  \
         avoid_ros_namespace_conventions: false\n"
    )
}

/// Writes a recording as a ROS 2 bag:
///
/// | topic | type | |
/// |---|---|---|
/// | `/scan` | `sensor_msgs/msg/LaserScan` | frame `laser`; `range_min` and `range_max` enclose all readings of the recording |
/// | `/odom` | `nav_msgs/msg/Odometry` | frames `odom`, `base_link`: the increments put together, from the origin |
/// | `/reference` | `geometry_msgs/msg/PoseStamped` | frame `map`: the reference pose of `base_link` |
/// | `/tf` | `tf2_msgs/msg/TFMessage` | `map` → `odom` (reference less odometry), `odom` → `base_link`; `map` → `base_link` without odometry |
/// | `/tf_static` | `tf2_msgs/msg/TFMessage` | `base_link` → `laser` |
///
/// All messages about a scan have its stamp. Messages are logged in the order of the scans at times
/// that never step back, as players go by them: at the scan's stamp, or at the latest one before it
/// where stamps step back or are missing. A scan without stamp has stamp 0 and is listed in the
/// metadata record `mcl-eval`.
///
/// What the format cannot hold: readings and directions of beams are 32-bit floats; headings pass
/// through quaternions (10⁻¹⁵ rad), and odometry through poses in one frame (10⁻¹² m within some
/// hundred metres of its origin).
///
/// # Errors
/// [`WriteBagError`] when the sink fails, or names the scan that a bag cannot hold. All scans are
/// checked before the first byte is written.
pub fn write<W: Write + Seek>(recording: &Recording, sink: W) -> Result<W, WriteBagError> {
    let spans = check(recording)?;
    let scans = &recording.scans;
    let mut bag = BagWriter::new(sink)?;
    let unstamped = scans.iter().enumerate().filter(|(_, scan)| scan.stamp.is_none());
    let unstamped: Vec<String> = unstamped.map(|(index, _)| index.to_string()).collect();
    bag.metadata(METADATA_NAME, BTreeMap::from([(UNSTAMPED_KEY.to_owned(), unstamped.join(" "))]))?;

    let scan_topic = bag.topic("/scan", &LASER_SCAN, Delivery::Live)?;
    let odom_topic = match spans.odometry.is_empty() {
        true => None,
        false => Some(bag.topic("/odom", &ODOMETRY, Delivery::Live)?),
    };
    let reference_topic = match spans.reference.is_empty() {
        true => None,
        false => Some(bag.topic("/reference", &POSE_STAMPED, Delivery::Live)?),
    };
    let tf_topic = match odom_topic.or(reference_topic) {
        None => None,
        Some(_) => Some(bag.topic("/tf", &TF_MESSAGE, Delivery::Live)?),
    };
    let static_topic = bag.topic("/tf_static", &TF_MESSAGE, Delivery::Latched)?;

    let zero = Stamp::from_nanoseconds(0);
    let first = scans.first().and_then(|scan| scan.stamp).unwrap_or(zero);
    let mut log_time = first.nanoseconds() as u64;
    let mounted = [(BASE_FRAME, LASER_FRAME, recording.robot_from_laser)];
    bag.write(static_topic, log_time, transforms(first, &mounted))?;
    let mount = Mount::new(recording.robot_from_laser);
    let (range_min, range_max) = range_limits(scans);
    let mut robot = Pose2::IDENTITY;
    for (index, scan) in scans.iter().enumerate() {
        let stamp = scan.stamp.unwrap_or(zero);
        log_time = log_time.max(stamp.nanoseconds() as u64);
        if index > spans.odometry.start
            && let Some(increment) = scan.odometry
        {
            robot = robot.compose(&mount.robot_increment(increment));
        }
        let odometry = spans.odometry.contains(&index).then_some(robot);
        let reference = scan.map_from_laser.map(|laser| mount.robot_pose(laser));
        if let Some(topic) = tf_topic {
            let edges: Vec<(&str, &str, Pose2)> = match (reference, odometry) {
                (Some(reference), Some(odometry)) => vec![
                    (MAP_FRAME, ODOMETRY_FRAME, reference.compose(&odometry.inverse())),
                    (ODOMETRY_FRAME, BASE_FRAME, odometry),
                ],
                (Some(reference), None) => vec![(MAP_FRAME, BASE_FRAME, reference)],
                (None, Some(odometry)) => vec![(ODOMETRY_FRAME, BASE_FRAME, odometry)],
                (None, None) => vec![],
            };
            if !edges.is_empty() {
                bag.write(topic, log_time, transforms(stamp, &edges))?;
            }
        }
        if let (Some(topic), Some(pose)) = (odom_topic, odometry) {
            let mut message = Encoder::default();
            message.header(stamp, ODOMETRY_FRAME).text(BASE_FRAME);
            // Covariance, velocity and its covariance are not known.
            message.pose(pose).f64s(&[0.0; 36 + 6 + 36]);
            bag.write(topic, log_time, message)?;
        }
        if let (Some(topic), Some(pose)) = (reference_topic, reference) {
            let mut message = Encoder::default();
            message.header(stamp, MAP_FRAME).pose(pose);
            bag.write(topic, log_time, message)?;
        }
        bag.write(scan_topic, log_time, laser_scan(scan, stamp, range_min, range_max))?;
    }
    bag.finish()
}

fn transforms(stamp: Stamp, edges: &[(&str, &str, Pose2)]) -> Encoder {
    let mut message = Encoder::default();
    message.u32(edges.len() as u32);
    for (parent, child, pose) in edges {
        message.header(stamp, parent).text(child).pose(*pose);
    }
    message
}

fn laser_scan(scan: &LaserScan, stamp: Stamp, range_min: f32, range_max: f32) -> Encoder {
    let geometry = &scan.geometry;
    let mut message = Encoder::default();
    message
        .header(stamp, LASER_FRAME)
        .f32(geometry.start_angle as f32)
        .f32(geometry.angle(geometry.beams - 1) as f32)
        .f32(geometry.angle_step as f32)
        // Neither the time between beams nor that between scans is known.
        .f32(0.0)
        .f32(0.0)
        .f32(range_min)
        .f32(range_max)
        .u32(scan.ranges.len() as u32);
    for &range in &scan.ranges {
        message.f32(range as f32);
    }
    message.u32(0);
    message
}

/// The smallest and the largest reading, and 0 if that is smaller.
fn range_limits(scans: &[LaserScan]) -> (f32, f32) {
    let readings = scans.iter().flat_map(|scan| &scan.ranges).map(|&range| range as f32);
    readings
        .filter(|range| range.is_finite())
        .fold((0.0, 0.0), |(min, max): (f32, f32), range| (min.min(range), max.max(range)))
}

/// The scans with a pose by odometry, and those with a reference pose; each without gaps.
struct Spans {
    odometry: Range<usize>,
    reference: Range<usize>,
}

fn check(recording: &Recording) -> Result<Spans, WriteBagError> {
    let scans = &recording.scans;
    if scans.is_empty() {
        return Err(WriteBagError::NoScan);
    }
    for (index, scan) in scans.iter().enumerate() {
        let (readings, beams) = (scan.ranges.len(), scan.geometry.beams);
        if readings != beams || readings == 0 {
            return Err(WriteBagError::Readings { scan: index, readings, beams });
        }
        const LAST: i64 = (i32::MAX as i64 + 1) * 1_000_000_000 - 1;
        if let Some(stamp) = scan.stamp.filter(|stamp| !(0..=LAST).contains(&stamp.nanoseconds())) {
            return Err(WriteBagError::Stamp { scan: index, stamp });
        }
        for (pose, what) in
            [(scan.map_from_laser, "reference pose"), (scan.odometry, "odometry increment")]
        {
            if pose.is_some_and(|pose| !pose.is_finite()) {
                return Err(WriteBagError::NotFinite { scan: index, what });
            }
        }
    }
    let steps = span(scans, "odometry", |index, scan| index > 0 && scan.odometry.is_some())?;
    let reference = span(scans, "reference pose", |_, scan| scan.map_from_laser.is_some())?;
    // A step connects its scan with the one before.
    let start = steps.start.saturating_sub(1);
    let odometry = if steps.is_empty() { 0..0 } else { start..steps.end };
    Ok(Spans { odometry, reference })
}

/// From the first to the last scan that has something, which all between must have.
fn span(
    scans: &[LaserScan],
    what: &'static str,
    has: impl Fn(usize, &LaserScan) -> bool,
) -> Result<Range<usize>, WriteBagError> {
    let mut with = scans.iter().enumerate().filter(|(index, scan)| has(*index, scan));
    let Some((first, _)) = with.next() else { return Ok(0..0) };
    let last = with.next_back().map_or(first, |(last, _)| last);
    match (first..=last).find(|&index| !has(index, &scans[index])) {
        Some(scan) => Err(WriteBagError::Gap { scan, what }),
        None => Ok(first..last + 1),
    }
}
