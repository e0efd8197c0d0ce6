//! Where topics and messages of a bag are written, in any format.

use std::collections::BTreeMap;
use std::io;

use mcl_core::Stamp;

use super::encode::Encoder;
use super::lists;
use super::types::{MessageType, STRING};

/// Why a recording cannot be written as a bag.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteBagError {
    /// The sink fails.
    #[error("cannot write the bag: {0}")]
    Mcap(#[from] mcap::McapError),
    /// The sink fails.
    #[error("cannot write the bag: {0}")]
    Io(#[from] io::Error),
    /// The database fails.
    #[error("cannot write the bag: {0}")]
    Database(String),
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
    /// A stamp outside the range of ROS times.
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
    /// Values that readers of bags would reject: a pose beyond 10⁹ m from the origin, or beam directions that
    /// 32-bit floats cannot hold.
    #[error("scan {scan}: the {what}, expected {expected}")]
    OutOfRange {
        /// Index of the scan, from 0.
        scan: usize,
        /// What is out of range.
        what: &'static str,
        /// What is accepted.
        expected: &'static str,
    },
    /// Beam directions that are not evenly spaced.
    #[error(
        "scan {scan}: its beams were placed by the motion or the tilt of the laser, so their directions are not even, as scans of a bag have them; read the log with --no-deskew, and a tilted laser as level with --laser-pose"
    )]
    Uneven {
        /// Index of the scan, from 0.
        scan: usize,
    },
}

/// The delivery of a topic's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// To current subscribers only.
    Live,
    /// The last messages also to later subscribers, as `/tf_static` requires.
    Latched,
}

/// A topic of a [`BagWriter`](super::BagWriter).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(pub(super) u16);

/// Lists of scan indices by key.
pub(super) type Lists = BTreeMap<String, String>;

/// A writer of topics and messages.
pub(super) trait Sink {
    fn topic(
        &mut self,
        name: &str,
        message: &MessageType,
        delivery: Delivery,
    ) -> Result<TopicId, WriteBagError>;

    fn message(
        &mut self,
        topic: TopicId,
        log_time: u64,
        message: Encoder,
    ) -> Result<(), WriteBagError>;

    /// Writes what the messages cannot express about the scans.
    fn lists(&mut self, log_time: u64, lists: Lists) -> Result<(), WriteBagError> {
        write_lists(self, log_time, lists)
    }
}

/// Writes the lists as a message.
pub(super) fn write_lists<S: Sink + ?Sized>(
    sink: &mut S,
    log_time: u64,
    lists: Lists,
) -> Result<(), WriteBagError> {
    let topic = sink.topic(lists::TOPIC, &STRING, Delivery::Latched)?;
    let lines = lists.into_iter().map(|(key, list)| format!("{key}: {list}\n"));
    let mut message = Encoder::default();
    message.text(&lines.collect::<String>());
    sink.message(topic, log_time, message)
}

/// Quality of service as rosbag2 writes it into bags up to its version 8, and reads it in all:
/// keep last, reliable, volatile (2) or transient local (1).
pub(super) fn qos(delivery: Delivery) -> String {
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
