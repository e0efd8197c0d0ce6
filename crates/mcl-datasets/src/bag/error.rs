//! Why a bag cannot be read.

use mcl_core::{OutOfMemory, Stamp};

use super::layout::SchemaError;
use crate::container::folder::FolderError;
use crate::container::problem::StreamError;

/// Why no recording could be read from a bag.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BagError {
    /// The container is malformed or damaged.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// The scans need more memory than is available.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// There is no scan.
    #[error(
        "no sensor_msgs/msg/LaserScan message could be read from the bag; topics: {topics}{}{}",
        advice(topics),
        last_lines(because.as_deref())
    )]
    NoScan {
        /// The topics of the bag with their types.
        topics: String,
        /// Further details, such as how many messages were malformed.
        because: Option<String>,
    },
    /// There is no point cloud.
    #[error("no sensor_msgs/msg/PointCloud2 message could be read from the bag; topics: {topics}{}", last_lines(because.as_deref()))]
    NoCloud {
        /// The topics of the bag with their types.
        topics: String,
        /// Further details, such as how many messages were malformed.
        because: Option<String>,
    },
    /// Several clouds of a scanner whose poses are not known.
    #[error(
        "topic {topic} has {clouds} clouds in frame {frame:?}, and {why}; expected transforms on /tf or an Odometry topic that lead from a fixed frame to {frame:?} over the time of the clouds; without them, cut the bag to one cloud"
    )]
    NoPlace {
        /// The topic.
        topic: String,
        /// Number of its clouds.
        clouds: usize,
        /// Their frame.
        frame: String,
        /// What is missing.
        why: String,
    },
    /// Several topics match.
    #[error("several topics of {what}: {candidates}; choose one with {option}")]
    Ambiguous {
        /// What was looked for.
        what: &'static str,
        /// The topics.
        candidates: String,
        /// The option that selects one.
        option: &'static str,
    },
    /// The requested topic does not exist.
    #[error("no topic {topic} in the bag ({option}); topics: {topics}")]
    NoTopic {
        /// The requested topic.
        topic: String,
        /// The option that requested it.
        option: &'static str,
        /// The topics of the bag with their types.
        topics: String,
    },
    /// The requested topic has messages of another type.
    #[error("topic {topic} ({option}) has messages of type {found}, expected {expected}")]
    WrongType {
        /// The requested topic.
        topic: String,
        /// The option that requested it.
        option: &'static str,
        /// The type found.
        found: String,
        /// The accepted types.
        expected: &'static str,
    },
    /// The requested frame does not exist.
    #[error("no frame {frame:?} in the bag ({option}); frames: {frames}")]
    NoFrame {
        /// The requested frame.
        frame: String,
        /// The option that requested it.
        option: &'static str,
        /// The frames of the bag.
        frames: String,
    },
    /// The two requested frames do not move relative to each other.
    #[error(
        "{topic}: no transforms that change lead from one of the two frames to the other; frames: {frames}"
    )]
    NoPair {
        /// What was requested.
        topic: String,
        /// The frames of the bag.
        frames: String,
    },
    /// The transforms leave open which pair of frames is meant.
    #[error(
        "{topic}: the transforms do not say which pose is meant; expected two frames as /tf:map.base_link{}; frames: {frames}",
        match pairs.as_str() { "" => String::new(), pairs => format!(", one of {pairs}") }
    )]
    WhichPair {
        /// What was requested.
        topic: String,
        /// The candidate pairs.
        pairs: String,
        /// The frames of the bag.
        frames: String,
    },
    /// Messages of a topic have an unsupported encoding.
    #[error(
        "topic {topic}: messages are encoded as {encoding:?}, expected \"cdr\" (ROS 2) or \"ros1\"; convert the bag first"
    )]
    Encoding {
        /// The topic.
        topic: String,
        /// The encoding.
        encoding: String,
    },
    /// The schema of a topic cannot be used.
    #[error("topic {topic}: schema {schema}: {error}")]
    Schema {
        /// The topic.
        topic: String,
        /// Name of the schema.
        schema: String,
        /// What is wrong with it.
        error: Box<SchemaError>,
    },
    /// A reference was requested, and the bag has none.
    #[error(
        "no reference poses in the bag, expected some (--reference recorded){possible}; topics: {topics}"
    )]
    NoReference {
        /// What could be requested, as a clause; empty where there is nothing.
        possible: String,
        /// The topics of the bag with their types.
        topics: String,
    },
    /// Poses were requested, and the bag has none.
    #[error(
        "no such poses in the bag: no topic of geometry_msgs/msg/PoseStamped or PoseWithCovarianceStamped; an Odometry topic, a reference or a goal must be named (--reference-topic for the reference, --topic for an estimate); topics: {topics}"
    )]
    NoPoses {
        /// The topics of the bag with their types.
        topics: String,
    },
    /// The reference was recorded at another time than the scans.
    #[error(
        "the reference poses on {topic} ({reference_start} s to {reference_end} s) do not overlap in time with the scans on {scan_topic} ({scan_start} s to {scan_end} s); were they stamped by different clocks?"
    )]
    NoOverlap {
        /// Topic of the reference.
        topic: String,
        /// Topic of the scans.
        scan_topic: String,
        /// Earliest stamp of the reference.
        reference_start: Stamp,
        /// Latest stamp of the reference.
        reference_end: Stamp,
        /// Earliest stamp of the scans.
        scan_start: Stamp,
        /// Latest stamp of the scans.
        scan_end: Stamp,
    },
    /// The laser does not scan in the plane the robot moves in.
    #[error(
        "the laser ({laser_frame}) is tilted by {degrees:.0}° against {base_frame}, expected a laser that scans in the plane the robot moves in; choose another one with --scan-topic"
    )]
    Tilted {
        /// Frame of the laser.
        laser_frame: String,
        /// Frame of the robot.
        base_frame: String,
        /// Angle between the z axes of the two frames, or between one and the opposite of the other.
        degrees: f64,
    },
    /// The laser moves relative to the robot.
    #[error(
        "the mount of the laser is not fixed: the transform from {parent} to {child} changes during the bag"
    )]
    MovingLaser {
        /// The parent frame.
        parent: String,
        /// The child frame.
        child: String,
    },
    /// The folder is not a split bag.
    #[error(transparent)]
    Folder(#[from] FolderError),
}

/// Why nothing could be read, below the message.
fn last_lines(because: Option<&str>) -> String {
    because.map_or(String::new(), |text| format!("\n{text}"))
}

/// Advice where there is no scan, by the topic types that are present.
fn advice(topics: &str) -> &'static str {
    if topics.contains("sensor_msgs/msg/PointCloud2") || topics.contains("sensor_msgs/PointCloud2")
    {
        "; scans can be made of point clouds with --slice Z1,Z2 (heights in metres)"
    } else if topics.contains("(no type, ") {
        "; the recorder did not find the types of some topics: name the folder of the bag, if it has a metadata.yaml, or record again with the message packages installed"
    } else {
        ""
    }
}
