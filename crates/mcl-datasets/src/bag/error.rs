//! Why a bag cannot be read.

use mcl_core::Stamp;

use super::bytes::BadRecord;
use super::schema::SchemaError;

/// What is wrong with the records of an MCAP file.
#[derive(Debug, thiserror::Error)]
pub enum StreamProblem {
    /// The system could not read the file.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// It does not begin like MCAP.
    #[error("the file does not begin with the magic bytes of MCAP (89 4d 43 41 50 30 0d 0a)")]
    Magic,
    /// No record has this code.
    #[error("0 is no kind of record; the file is damaged")]
    Opcode,
    /// A record longer than any should be.
    #[error(
        "a record of kind {opcode:#04x} says that it is {length} bytes long, expected at most {limit}; the file is damaged"
    )]
    RecordLength {
        /// Code of the record's kind.
        opcode: u8,
        /// The length it says.
        length: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A record that is too short for its fields.
    #[error("{0}; the file is damaged")]
    Record(#[from] BadRecord),
    /// A chunk that unpacks to more than is accepted.
    #[error(
        "a chunk says that it unpacks to {size} bytes, expected at most {limit}; write the bag with smaller chunks"
    )]
    ChunkTooLarge {
        /// The size it says.
        size: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A chunk whose content is longer than its record.
    #[error("a chunk says that it holds {size} bytes, but {there} are there; the file is damaged")]
    ChunkLength {
        /// The size it says.
        size: u64,
        /// The bytes there.
        there: usize,
    },
    /// A chunk that unpacks to another size than it says.
    #[error(
        "a chunk says that it unpacks to {declared} bytes, found {found}{}; the file is damaged",
        if found > declared { " or more" } else { "" }
    )]
    UnpackedLength {
        /// The size it says.
        declared: u64,
        /// The bytes unpacked, at most one more than declared.
        found: u64,
    },
    /// A chunk compressed in a way that is not known.
    #[error("a chunk is compressed with {0:?}, expected none, zstd or lz4")]
    UnknownCompression(String),
    /// A chunk that does not unpack.
    #[error("a chunk does not unpack as {compression}: {reason}; the file is damaged")]
    Decompression {
        /// The compression.
        compression: String,
        /// The decompressor's reason.
        reason: String,
    },
    /// A chunk whose checksum differs.
    #[error("the checksum of a chunk is {found:08x}, expected {declared:08x}; the file is damaged")]
    ChunkCrc {
        /// The checksum written in the chunk.
        declared: u32,
        /// The checksum of its content.
        found: u32,
    },
    /// The checksum of all that comes before the end of the data differs.
    #[error(
        "the checksum of the data is {found:08x}, expected {declared:08x}; the file is damaged"
    )]
    DataCrc {
        /// The checksum written in the file.
        declared: u32,
        /// The checksum of the content.
        found: u32,
    },
    /// A record in a chunk that is longer than the chunk.
    #[error(
        "a record of kind {opcode:#04x} in a chunk says that it is {length} bytes long, but {there} are left of the chunk; the file is damaged"
    )]
    RecordInChunk {
        /// Code of the record's kind.
        opcode: u8,
        /// The length it says.
        length: u64,
        /// The bytes left.
        there: usize,
    },
    /// A message of a channel that no record describes.
    #[error(
        "a message is of channel {0}, which no record before it describes; the file is damaged"
    )]
    UnknownChannel(u16),
    /// A channel with a schema that no record describes.
    #[error(
        "topic {topic} has schema {schema}, which no record before it describes; the file is damaged"
    )]
    UnknownSchema {
        /// The topic.
        topic: String,
        /// Number of the schema.
        schema: u16,
    },
    /// Two records describe one channel or schema differently.
    #[error("two {0} records of number {1} differ; the file is damaged")]
    Conflict(&'static str, u16),
    /// More messages than are kept in memory.
    #[error(
        "the scans, odometry, poses and transforms take more than {0} bytes; cut the bag into parts"
    )]
    TooMuch(u64),
}

/// Why no recording could be read from a bag.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The bytes are no MCAP, or damaged.
    #[error("at byte {offset}: {problem}")]
    Stream {
        /// Offset of the record at fault, of the chunk that holds it, or of the end of what was read.
        offset: u64,
        /// What is wrong.
        problem: StreamProblem,
    },
    /// There is no scan.
    #[error("no sensor_msgs/msg/LaserScan message in the bag{}; topics: {topics}", because.as_ref().map(|text| format!(" ({text})")).unwrap_or_default())]
    NoScan {
        /// The topics of the bag with their types.
        topics: String,
        /// What else is to be said, such as how many messages were malformed.
        because: Option<String>,
    },
    /// There is no point cloud.
    #[error("no sensor_msgs/msg/PointCloud2 message in the bag{}; topics: {topics}", because.as_ref().map(|text| format!(" ({text})")).unwrap_or_default())]
    NoCloud {
        /// The topics of the bag with their types.
        topics: String,
        /// What else is to be said, such as how many messages were malformed.
        because: Option<String>,
    },
    /// Several clouds of a scanner that nothing tells the place of.
    #[error(
        "topic {topic} has {clouds} clouds in frame {frame:?}, and {why}; expected transforms on /tf or an Odometry topic that lead from a fixed frame to {frame:?} over the time of the clouds; without them, cut the bag to one cloud"
    )]
    NoPlace {
        /// The topic.
        topic: String,
        /// Its clouds.
        clouds: usize,
        /// Their frame.
        frame: String,
        /// What is missing.
        why: String,
    },
    /// Several topics could be meant.
    #[error("several topics of {what}: {candidates}; choose one with {option}")]
    Ambiguous {
        /// What was looked for.
        what: &'static str,
        /// The topics.
        candidates: String,
        /// The option that chooses.
        option: &'static str,
    },
    /// A topic asked for is not there.
    #[error("no topic {topic} in the bag ({option}); topics: {topics}")]
    NoTopic {
        /// The topic asked for.
        topic: String,
        /// The option that asked.
        option: &'static str,
        /// The topics of the bag with their types.
        topics: String,
    },
    /// A topic asked for has messages of another type.
    #[error("topic {topic} ({option}) has messages of type {found}, expected {expected}")]
    WrongType {
        /// The topic asked for.
        topic: String,
        /// The option that asked.
        option: &'static str,
        /// The type found.
        found: String,
        /// The types that would do.
        expected: &'static str,
    },
    /// Messages of a topic are encoded in a way that is not read.
    #[error(
        "topic {topic}: messages are encoded as {encoding:?}, expected \"cdr\" (ROS 2); convert the bag first"
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
    /// A reference was asked for, and the bag has none.
    #[error(
        "no reference poses in the bag: no topic of geometry_msgs/msg/PoseStamped or PoseWithCovarianceStamped, expected one (--reference recorded); name an Odometry topic with --reference-topic; topics: {topics}"
    )]
    NoReference {
        /// The topics of the bag with their types.
        topics: String,
    },
    /// Poses were wanted, and the bag has none.
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
        /// Angle between the two z axes or their opposites.
        degrees: f64,
    },
    /// The laser moves on the robot.
    #[error(
        "the mount of the laser is not fixed: the transform from {parent} to {child} on /tf changes during the bag"
    )]
    MovingLaser {
        /// The parent frame.
        parent: String,
        /// The child frame.
        child: String,
    },
    /// The folder of a split bag is not one.
    #[error("{0}")]
    Folder(String),
}
