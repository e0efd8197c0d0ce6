//! What can be wrong with a container.

use mcl_core::OutOfMemory;

use super::position::Position;

/// A field that a record should have and has not, or that is no text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{record} record: {field} is {found}")]
pub struct BadRecord {
    /// Kind of the record.
    pub record: &'static str,
    /// The field at fault.
    pub field: &'static str,
    /// What is wrong with it.
    pub found: &'static str,
}

impl BadRecord {
    pub(super) const fn new(
        record: &'static str,
        field: &'static str,
        found: &'static str,
    ) -> Self {
        BadRecord { record, field, found }
    }
}

/// What is wrong with the bytes of a container.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StreamProblem {
    /// The system could not read the file.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// It takes more memory than there is.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// This build was compiled without what reads it.
    #[error(
        "this build reads no {format}: it was compiled without the feature `{feature}` of mcl-datasets"
    )]
    LeftOut {
        /// What is not read.
        format: &'static str,
        /// The feature that would read it.
        feature: &'static str,
    },
    /// It begins like no container.
    #[error(
        "the file does not begin with the magic bytes of MCAP, of a ROS 1 bag (#ROSBAG V2.0) or of an SQLite database"
    )]
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
    #[error("a chunk is compressed with {found:?}, expected {expected}")]
    UnknownCompression {
        /// The compression it says.
        found: String,
        /// Those that the format knows.
        expected: &'static str,
    },
    /// A chunk that does not unpack.
    #[error("a chunk does not unpack as {compression}: {reason}; the file is damaged")]
    Decompression {
        /// The compression.
        compression: &'static str,
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
    /// A chunk that ends within a record.
    #[error("the last {there} bytes of a chunk are no whole record; the file is damaged")]
    CutInChunk {
        /// The bytes left.
        there: usize,
    },
    /// A bag that only its owner can read.
    #[error("the bag is encrypted ({0}); decrypt it with `rosbag decompress` first")]
    Encrypted(String),
    /// SQLite cannot read the database.
    #[error("{0}")]
    Sqlite(String),
    /// A database of something else.
    #[error("the database has no table {0}, expected the tables of rosbag2: topics and messages")]
    NoTable(&'static str),
    /// A table that is not as rosbag2 writes it.
    #[error("{table} {found}; the database is no bag of rosbag2, or damaged")]
    Database {
        /// The table, or the column in it.
        table: &'static str,
        /// What is wrong with it.
        found: String,
    },
    /// A database that would unpack to more than is accepted.
    #[error(
        "the database says that it has {declared} bytes, expected at most {limit}; unpack it first"
    )]
    DatabaseTooLarge {
        /// The size it says.
        declared: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A message of a channel that no record describes.
    #[error(
        "a message is of channel {0}, which no record before it describes; the file is damaged"
    )]
    UnknownChannel(u32),
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
    Conflict(&'static str, u32),
    /// More messages than are kept in memory.
    #[error(
        "the scans, odometry, poses and transforms take more than {0} bytes; cut the bag into parts"
    )]
    TooMuch(u64),
}

/// Why a container cannot be read, and where.
#[derive(Debug, thiserror::Error)]
#[error("at {position}: {problem}")]
pub struct StreamError {
    /// The record at fault, the chunk that holds it, or the end of what was read.
    pub position: Position,
    /// What is wrong.
    pub problem: StreamProblem,
}

impl StreamError {
    /// Of a file that is wrong as a whole.
    pub fn at_start(problem: impl Into<StreamProblem>) -> Self {
        StreamError { position: Position::Byte(0), problem: problem.into() }
    }
}
