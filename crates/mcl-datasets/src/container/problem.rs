//! What can be wrong with a container.

use mcl_core::OutOfMemory;

use super::position::Position;

/// A required field of a record that is missing or is not text.
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
    /// The operating system could not read the file.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// Reading needs more memory than is available.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// This build was compiled without the reader for this format.
    #[error(
        "this build cannot read {format}: it was compiled without the feature `{feature}` of mcl-datasets"
    )]
    LeftOut {
        /// The format.
        format: &'static str,
        /// The feature that would read it.
        feature: &'static str,
    },
    /// It begins like no known container.
    #[error(
        "the file does not begin with the magic bytes of MCAP, of a ROS 1 bag (#ROSBAG V2.0) or of an SQLite database"
    )]
    Magic,
    /// An unknown opcode.
    #[error("0 is not a kind of record; the file is damaged")]
    Opcode,
    /// A record longer than accepted.
    #[error(
        "a record of kind {opcode:#04x} says that it is {length} bytes long, expected at most {limit}; the file is damaged"
    )]
    RecordLength {
        /// Code of the record's kind.
        opcode: u8,
        /// Its stated length.
        length: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A malformed record.
    #[error("{0}; the file is damaged")]
    Record(#[from] BadRecord),
    /// A chunk that decompresses to more than is accepted.
    #[error(
        "a chunk says that it unpacks to {size} bytes, expected at most {limit}; write the bag with smaller chunks"
    )]
    ChunkTooLarge {
        /// Its stated size.
        size: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A chunk whose content is longer than its record.
    #[error("a chunk says that it holds {size} bytes, but {there} are there; the file is damaged")]
    ChunkLength {
        /// Its stated size.
        size: u64,
        /// The bytes available.
        there: usize,
    },
    /// A chunk whose decompressed size differs from the stated one.
    #[error(
        "a chunk says that it unpacks to {declared} bytes, found {found}{}; the file is damaged",
        if found > declared { " or more" } else { "" }
    )]
    UnpackedLength {
        /// Its stated size.
        declared: u64,
        /// The size found, at most one more than declared.
        found: u64,
    },
    /// A chunk with an unknown compression.
    #[error("a chunk is compressed with {found:?}, expected {expected}")]
    UnknownCompression {
        /// The stated compression.
        found: String,
        /// Those that the format defines.
        expected: &'static str,
    },
    /// A chunk that cannot be decompressed.
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
    /// The checksum of everything before the end of the data differs.
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
        /// Its stated length.
        length: u64,
        /// The bytes left.
        there: usize,
    },
    /// A chunk that ends within a record.
    #[error("the last {there} bytes of a chunk are not a whole record; the file is damaged")]
    CutInChunk {
        /// The bytes left.
        there: usize,
    },
    /// An encrypted bag.
    #[error("the bag is encrypted ({0}); decrypt it with `rosbag decompress` first")]
    Encrypted(String),
    /// SQLite cannot read the database.
    #[error("{0}")]
    Sqlite(String),
    /// A database without rosbag2's tables.
    #[error("the database has no table {0}, expected the tables of rosbag2: topics and messages")]
    NoTable(&'static str),
    /// A table that differs from rosbag2's layout.
    #[error("{table} {found}; the database is not a bag of rosbag2, or is damaged")]
    Database {
        /// The table, or the column in it.
        table: &'static str,
        /// What is wrong with it.
        found: String,
    },
    /// A database that would decompress to more than is accepted.
    #[error(
        "the database says that it has {declared} bytes, expected at most {limit}; unpack it first"
    )]
    DatabaseTooLarge {
        /// Its stated size.
        declared: u64,
        /// The largest accepted.
        limit: u64,
    },
    /// A message of a channel that no record before it describes.
    #[error(
        "a message is of channel {0}, which no record before it describes; the file is damaged"
    )]
    UnknownChannel(u32),
    /// A channel whose schema no record before it describes.
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
    /// For a file that is wrong as a whole.
    pub fn at_start(problem: impl Into<StreamProblem>) -> Self {
        StreamError { position: Position::Byte(0), problem: problem.into() }
    }
}
