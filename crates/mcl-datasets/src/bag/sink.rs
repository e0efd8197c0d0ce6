//! What topics and messages of a bag are written into, in any format.

use std::io;

use mcl_core::Stamp;

use super::encode::Encoder;
use super::types::MessageType;

/// Why a recording cannot be written as a bag.
#[derive(Debug, thiserror::Error)]
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
    /// Readers of bags would not accept it: a pose beyond 10⁹ m from the origin, directions of beams that
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
    /// Directions of beams that do not follow each other by even steps.
    #[error(
        "scan {scan}: its beams were placed by the motion or the tilt of the laser, so their directions are not even, as scans of a bag have them; read the log with --no-deskew, and a tilted laser as level with --laser-pose"
    )]
    Uneven {
        /// Index of the scan, from 0.
        scan: usize,
    },
    /// A stamp that is missing, 0, or more than a second earlier than the one before.
    #[error(
        "scan {scan} has no stamp after 0, or one more than a second earlier than the scan before; of bags only those of this suite in MCAP (.mcap) can say so"
    )]
    Order {
        /// Index of the scan, from 0.
        scan: usize,
    },
    /// Scans in the middle of the recording lack what those around them have.
    #[error(
        "scan {scan} has no {what}, but scans before and after it or at its time have: of bags only those of this suite in MCAP (.mcap) can say so, others would fill the gap by interpolation"
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

/// A topic of a [`BagWriter`](super::BagWriter).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopicId(pub(super) u16);

/// What writes topics and messages.
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
