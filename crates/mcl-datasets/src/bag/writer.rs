//! Writing a recording as a ROS 2 bag.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::ops::Range;

use mcap::records::{MessageHeader, Metadata};
use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry, Stamp};

use super::encode::Encoder;
use super::lists;
use super::messages::MAX_POSITION;
use super::planar::{laser_scan, pose_stamped, transforms};
use super::sink::{Delivery, Lists, Sink, TopicId, WriteBagError, qos, write_lists};
use super::types::{LASER_SCAN, MessageType, ODOMETRY, POSE_STAMPED, TF_MESSAGE};
#[cfg(feature = "sqlite")]
use super::write_database::DatabaseWriter;
use super::write_ros1::Ros1Writer;
use crate::mount::MountConversion;

/// Uncompressed size of a chunk, in bytes. Small, because a truncated file loses most of its last chunk.
const CHUNK_BYTES: u64 = 64 << 10;
const ODOMETRY_FRAME: &str = "odom";
/// The frame of the map, root of all others (REP 105).
pub const MAP_FRAME: &str = "map";
/// The robot's frame (REP 105).
pub const BASE_FRAME: &str = "base_link";
/// The laser's frame.
pub const LASER_FRAME: &str = "laser";

/// A bag being written: profile `ros2`, CDR messages with their descriptions, zstd chunks, index and summary.
/// The output is deterministic.
pub struct BagWriter<W: Write + Seek> {
    writer: mcap::Writer<W>,
    sequences: BTreeMap<u16, u32>,
}

impl<W: Write + Seek> Sink for BagWriter<W> {
    fn topic(
        &mut self,
        name: &str,
        message: &MessageType,
        delivery: Delivery,
    ) -> Result<TopicId, WriteBagError> {
        BagWriter::topic(self, name, message, delivery)
    }

    fn message(
        &mut self,
        topic: TopicId,
        log_time: u64,
        message: Encoder,
    ) -> Result<(), WriteBagError> {
        self.write(topic, log_time, message)
    }

    fn lists(&mut self, log_time: u64, lists: Lists) -> Result<(), WriteBagError> {
        // Other converters keep messages, but drop metadata records.
        if lists.contains_key(lists::NO_ODOMETRY) {
            write_lists(self, log_time, lists.clone())?;
        }
        self.metadata(lists::NAME, lists)
    }
}

/// The formats of bags that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// ROS 2: MCAP.
    Mcap,
    /// ROS 1, version 2.0, not compressed, with index.
    Ros1,
    /// ROS 2: a database of rosbag2 (SQLite) with the descriptions of its messages. ROS 2 tools expect a
    /// `metadata.yaml` beside it, which `ros2 bag reindex` writes.
    Database,
}

/// [`write`](fn@write) in any of the formats. Those without metadata records hold the same lists in a message
/// on `/mcl_eval` (`std_msgs/String`), and so does MCAP where scans lack odometry or reference that others
/// have.
///
/// # Errors
/// As [`write`](fn@write).
pub fn write_as<W: Write + Seek>(
    recording: &Recording,
    format: Format,
    sink: W,
) -> Result<W, WriteBagError> {
    let prepared = Prepared::of(recording)?;
    match format {
        Format::Mcap => {
            let mut bag = BagWriter::new(sink)?;
            prepared.write(recording, &mut bag)?;
            bag.finish()
        }
        Format::Ros1 => {
            let mut bag = Ros1Writer::new(sink)?;
            prepared.write(recording, &mut bag)?;
            bag.finish()
        }
        #[cfg(not(feature = "sqlite"))]
        Format::Database => Err(WriteBagError::Database(
            "this build cannot write databases (.db3): it was compiled without the feature `sqlite` of mcl-datasets"
                .to_owned(),
        )),
        #[cfg(feature = "sqlite")]
        Format::Database => {
            let mut bag = DatabaseWriter::new()?;
            prepared.write(recording, &mut bag)?;
            bag.finish(sink)
        }
    }
}

impl<W: Write + Seek> BagWriter<W> {
    /// Begins a bag.
    ///
    /// # Errors
    /// When the sink fails; the same holds for all methods.
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

    /// Finishes the bag, and returns the sink.
    ///
    /// # Errors
    /// When the sink fails.
    pub fn finish(mut self) -> Result<W, WriteBagError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }
}

/// Writes a recording as a ROS 2 bag:
///
/// | topic | type | |
/// |---|---|---|
/// | `/scan` | `sensor_msgs/msg/LaserScan` | frame `laser`; `range_min` and `range_max` enclose all readings of the recording, none of which equals `range_max` |
/// | `/odom` | `nav_msgs/msg/Odometry` | frames `odom`, `base_link`: the increments put together, from the origin |
/// | `/reference` | `geometry_msgs/msg/PoseStamped` | frame `map`: the reference pose of `base_link` |
/// | `/tf` | `tf2_msgs/msg/TFMessage` | `map` → `odom` (reference less odometry), `odom` → `base_link`; `map` → `base_link` without odometry |
/// | `/tf_static` | `tf2_msgs/msg/TFMessage` | `base_link` → `laser` |
///
/// All messages about a scan have its stamp. Messages are logged in the order of the scans at log times that
/// never decrease, as players require: at the scan's stamp, or at the latest one before it where stamps
/// decrease or are missing. A scan without stamp has stamp 0 and is listed in the metadata record `mcl-eval`,
/// which also says that the scans are in order, whatever their stamps.
///
/// Where the odometry of a step is missing, it restarts at the origin, and the record lists the scan;
/// likewise scans without reference pose among others that have one. The times between the beams of a scan
/// are left out where no pose follows the scan: the poses of its beams would not be known.
///
/// What the format cannot hold: readings and directions of beams are 32-bit floats; headings are stored as
/// quaternions (error 10⁻¹⁵ rad), and odometry as poses in one frame (error 10⁻¹² m within some hundred
/// metres of its origin).
///
/// # Errors
/// [`WriteBagError`] when the sink fails, or with the scan that a bag cannot hold. All scans are checked
/// before the first byte is written.
pub fn write<W: Write + Seek>(recording: &Recording, sink: W) -> Result<W, WriteBagError> {
    write_as(recording, Format::Mcap, sink)
}

/// A recording that has been checked.
struct Prepared {
    spans: Spans,
    /// Whether a scan lacks odometry or a reference pose that its neighbours have.
    has_gap: bool,
    placed: Vec<ScanPoses>,
}

impl Prepared {
    fn of(recording: &Recording) -> Result<Self, WriteBagError> {
        let mut spans = check(recording)?;
        // As many poses as scans, so that those of the same stamp are paired.
        let has_gap = spans.have_gap(&recording.scans);
        if !spans.odometry.is_empty() && has_gap {
            spans.odometry = 0..recording.scans.len();
        }
        let placed = place(recording, &spans)?;
        Ok(Prepared { spans, placed, has_gap })
    }

    /// What the messages cannot express about the scans.
    fn lists(&self, scans: &[LaserScan]) -> Lists {
        let listed = |is_listed: fn(&LaserScan) -> bool| {
            let numbered = scans.iter().enumerate().filter(|(_, scan)| is_listed(scan));
            numbered.map(|(index, _)| index.to_string()).collect::<Vec<_>>().join(" ")
        };
        let mut lists = vec![
            (lists::SCANS, scans.len().to_string()),
            (lists::UNSTAMPED, listed(|scan| scan.stamp.is_none())),
        ];
        if self.has_gap {
            lists.push((lists::NO_ODOMETRY, listed(|scan| scan.odometry.is_none())));
            lists.push((lists::NO_REFERENCE, listed(|scan| scan.map_from_laser.is_none())));
        }
        lists.into_iter().map(|(key, list)| (key.to_owned(), list)).collect()
    }

    fn write(self, recording: &Recording, bag: &mut dyn Sink) -> Result<(), WriteBagError> {
        let scans = &recording.scans;
        let zero = Stamp::from_nanoseconds(0);
        let first = scans.first().and_then(|scan| scan.stamp).unwrap_or(zero);
        let mut log_time = first.nanoseconds() as u64;
        bag.lists(log_time, self.lists(scans))?;
        let Prepared { spans, placed, .. } = self;
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

        let mounted = [(BASE_FRAME, LASER_FRAME, recording.robot_from_laser)];
        bag.message(static_topic, log_time, transforms(first, &mounted))?;
        let limits = range_limits(scans);
        let is_placed = !spans.odometry.is_empty() || !spans.reference.is_empty();
        for (index, (scan, placed)) in scans.iter().zip(placed).enumerate() {
            let mut scan = Cow::Borrowed(scan);
            if is_placed && scan.sweep.time_increment != 0.0 && !is_followed(scans, index) {
                scan.to_mut().sweep.time_increment = 0.0;
            }
            let stamp = scan.stamp.unwrap_or(zero);
            log_time = log_time.max(stamp.nanoseconds() as u64);
            let ScanPoses { odometry, reference, edges } = placed;
            if let Some(topic) = tf_topic.filter(|_| !edges.is_empty()) {
                bag.message(topic, log_time, transforms(stamp, &edges))?;
            }
            if let (Some(topic), Some(pose)) = (odom_topic, odometry) {
                let mut message = Encoder::default();
                message.header(stamp, ODOMETRY_FRAME).text(BASE_FRAME);
                // Covariance, velocity and its covariance are not known.
                message.pose(pose).f64s(&[0.0; 36 + 6 + 36]);
                bag.message(topic, log_time, message)?;
            }
            if let (Some(topic), Some(pose)) = (reference_topic, reference) {
                bag.message(topic, log_time, pose_stamped(stamp, MAP_FRAME, pose))?;
            }
            bag.message(scan_topic, log_time, laser_scan(&scan, stamp, LASER_FRAME, limits))?;
        }
        Ok(())
    }
}

/// Whether poses follow a scan without a gap until its last beam was measured.
fn is_followed(scans: &[LaserScan], index: usize) -> bool {
    let scan = &scans[index];
    let takes = scan.sweep.time_increment * scan.geometry.beams.saturating_sub(1) as f64;
    let steps = scans[index..].windows(2).map_while(|pair| {
        let has_poses = pair.iter().all(|scan| scan.map_from_laser.is_some());
        let next = pair[1].stamp.zip(scan.stamp)?;
        (pair[1].odometry.is_some() || has_poses).then_some(next)
    });
    let mut times = steps.map(|(next, start)| next.seconds_since(start));
    times.any(|later| later >= takes)
}

/// The poses written for a scan.
struct ScanPoses {
    odometry: Option<Pose2>,
    reference: Option<Pose2>,
    /// For `/tf`: parent, child, pose.
    edges: Vec<(&'static str, &'static str, Pose2)>,
}

/// The poses to write, which must be in the range that readers accept: sums of many steps, or of a pose and
/// the mount, may exceed it.
fn place(recording: &Recording, spans: &Spans) -> Result<Vec<ScanPoses>, WriteBagError> {
    let is_readable =
        |pose: &Pose2| pose.is_finite() && pose.x.abs().max(pose.y.abs()) <= MAX_POSITION;
    let out_of_range = |scan, what| {
        let expected = "finite angles and at most 1e9 m from the origin";
        WriteBagError::OutOfRange { scan, what, expected }
    };
    if !is_readable(&recording.robot_from_laser) {
        return Err(out_of_range(0, "mount of the laser is out of range"));
    }
    let mount = MountConversion::new(recording.robot_from_laser);
    let mut robot = Pose2::IDENTITY;
    let mut placed = Vec::with_capacity(recording.scans.len());
    for (index, scan) in recording.scans.iter().enumerate() {
        if index > spans.odometry.start {
            robot = match scan.odometry {
                Some(increment) => robot.compose(&mount.robot_increment(increment)),
                None => Pose2::IDENTITY,
            };
        }
        let odometry = spans.odometry.contains(&index).then_some(robot);
        let reference = scan.map_from_laser.map(|laser| mount.robot_pose(laser));
        let edges = match (reference, odometry) {
            (Some(reference), Some(odometry)) => vec![
                (MAP_FRAME, ODOMETRY_FRAME, reference.compose(&odometry.inverse())),
                (ODOMETRY_FRAME, BASE_FRAME, odometry),
            ],
            (Some(reference), None) => vec![(MAP_FRAME, BASE_FRAME, reference)],
            (None, Some(odometry)) => vec![(ODOMETRY_FRAME, BASE_FRAME, odometry)],
            (None, None) => vec![],
        };
        if !edges.iter().all(|(_, _, pose)| is_readable(pose)) {
            let what = "pose of the robot, with the odometry up to it, is out of range";
            return Err(out_of_range(index, what));
        }
        placed.push(ScanPoses { odometry, reference, edges });
    }
    Ok(placed)
}

/// Limits around all readings (m): 0 or the smallest, and a little more than the largest, as readers treat a
/// reading equal to the limit as no return.
fn range_limits(scans: &[LaserScan]) -> (f32, f32) {
    let readings = scans.iter().flat_map(|scan| &scan.ranges).map(|&range| range as f32);
    let (min, max) = readings
        .filter(|range| range.is_finite())
        .fold((0.0, 0.0), |(min, max): (f32, f32), range| (min.min(range), max.max(range)));
    (min, if max > 0.0 { max * 1.001 + f32::MIN_POSITIVE } else { max })
}

/// The ranges of scans from the first to the last with odometry, and with a reference pose.
struct Spans {
    odometry: Range<usize>,
    reference: Range<usize>,
}

/// Checks that a bag can hold each of these scans.
///
/// # Errors
/// [`WriteBagError::NoScan`], or what is wrong with the first scan that it cannot hold.
pub fn check_scans(scans: &[LaserScan]) -> Result<(), WriteBagError> {
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
        let ScanGeometry { start_angle, angle_step, .. } = scan.geometry;
        let (start, step) = (start_angle as f32, angle_step as f32);
        if !(start.is_finite() && step.is_finite()) || step == 0.0 && beams > 1 {
            let what = "directions of the beams do not fit into 32-bit floats";
            let expected = "finite angles, and a step between two beams that is not 0";
            return Err(WriteBagError::OutOfRange { scan: index, what, expected });
        }
        for (pose, what) in
            [(scan.map_from_laser, "reference pose"), (scan.odometry, "odometry increment")]
        {
            if pose.is_some_and(|pose| !pose.is_finite()) {
                return Err(WriteBagError::NotFinite { scan: index, what });
            }
        }
    }
    Ok(())
}

fn check(recording: &Recording) -> Result<Spans, WriteBagError> {
    let scans = &recording.scans;
    check_scans(scans)?;
    if let Some(scan) = scans.iter().position(|scan| scan.sweep.directions.is_some()) {
        return Err(WriteBagError::Uneven { scan });
    }
    let steps = span(scans, |index, scan| index > 0 && scan.odometry.is_some());
    let reference = span(scans, |_, scan| scan.map_from_laser.is_some());
    // A step connects its scan with the previous one.
    let start = steps.start.saturating_sub(1);
    let odometry = if steps.is_empty() { 0..0 } else { start..steps.end };
    Ok(Spans { odometry, reference })
}

impl Spans {
    /// Whether a scan lacks odometry or a reference pose that readers would fill in by interpolation.
    fn have_gap(&self, scans: &[LaserScan]) -> bool {
        let times = times(scans);
        self.odometry.clone().skip(1).any(|scan| scans[scan].odometry.is_none())
            || self.reference.clone().any(|scan| scans[scan].map_from_laser.is_none())
            || is_filled(&times, &self.odometry)
            || is_filled(&times, &self.reference)
    }
}

/// The times (ns) that readers assign to the scans: their stamps, or the log times where those are 0.
fn times(scans: &[LaserScan]) -> Vec<i64> {
    let mut log_time = 0;
    let mut time = |scan: &LaserScan| {
        let stamp = scan.stamp.map_or(0, Stamp::nanoseconds);
        log_time = log_time.max(stamp);
        if stamp > 0 { stamp } else { log_time }
    };
    scans.iter().map(&mut time).collect()
}

/// Whether a scan outside of the span lies within its time, which happens as stamps may repeat and decrease.
fn is_filled(times: &[i64], span: &Range<usize>) -> bool {
    let inside = &times[span.clone()];
    let (Some(&first), Some(&last)) = (inside.iter().min(), inside.iter().max()) else {
        return false;
    };
    let is_within = |index: &usize| (first..=last).contains(&times[*index]);
    (0..times.len()).filter(|index| !span.contains(index)).any(|index| is_within(&index))
}

/// The range from the first to the last scan for which `has` holds.
fn span(scans: &[LaserScan], has: impl Fn(usize, &LaserScan) -> bool) -> Range<usize> {
    let mut with = scans.iter().enumerate().filter(|(index, scan)| has(*index, scan));
    let Some((first, _)) = with.next() else { return 0..0 };
    first..with.next_back().map_or(first, |(last, _)| last) + 1
}
