//! Why no log could be read from a file.

use std::io;
use std::path::PathBuf;

use crate::bag::error::BagError;
use crate::carmen::reader::CarmenError;

/// What is read.
const EXPECTED: &str = "a CARMEN log, an MCAP file, a ROS 1 bag or a rosbag2 database (.db3), plain or as .gz, .bz2, .xz or .zst";

/// Why no log could be read from a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// There is no such file.
    #[error("{}: no such file; check the path, or fetch the data set first", path.display())]
    NotFound {
        /// The file asked for.
        path: PathBuf,
    },
    /// The path is a directory.
    #[error("{}: a directory, expected a log file, or the folder of a rosbag2 bag with its metadata.yaml", path.display())]
    Directory {
        /// The path asked for.
        path: PathBuf,
    },
    /// The operating system could not open or read the file.
    #[error("{}: cannot be read: {error}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The file, or what it decompresses to, has no bytes.
    #[error("{}: the file is empty, expected {EXPECTED}", path.display())]
    Empty {
        /// The file asked for.
        path: PathBuf,
    },
    /// The file, or what it decompresses to, is not text.
    #[error(
        "{}: a binary file (byte {offset} is NUL), expected {EXPECTED}",
        path.display()
    )]
    Binary {
        /// The file asked for.
        path: PathBuf,
        /// Offset of the first NUL byte, from 0, after decompression.
        offset: usize,
    },
    /// It is a file of another kind.
    #[error("{}: {what}, expected {EXPECTED}; {advice}", path.display())]
    Foreign {
        /// The file asked for.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// No recording could be read from a bag.
    #[error("{}: {error}", path.display())]
    Bag {
        /// The file or folder asked for, or the file of a split bag.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<BagError>,
    },
    /// Topics were asked for, but the log is no bag.
    #[error("{}: a CARMEN log has no topics, and so no {topic:?}; leave out --odom-topic and --reference-topic, and name with --scan-topic, if at all, a kind of record: FLASER, RLASER, ROBOTLASER1 or ROBOTLASER2", path.display())]
    NoTopics {
        /// The file asked for.
        path: PathBuf,
        /// The first topic asked for.
        topic: String,
    },
    /// Something was asked for that only bags have.
    #[error("{}: a CARMEN log, which says itself where its laser is and has neither frames nor point clouds; {option} goes with bags", path.display())]
    OfBags {
        /// The file asked for.
        path: PathBuf,
        /// The option that asked.
        option: &'static str,
    },
    /// The file begins like a compressed one, but nothing of it can be decompressed.
    #[error("{}: {reason}; fetch the file again", path.display())]
    Compressed {
        /// The file asked for.
        path: PathBuf,
        /// What is wrong with the compressed data.
        reason: String,
    },
    /// The text is no CARMEN log that could be read.
    #[error("{}: {error}", path.display())]
    Carmen {
        /// The file asked for.
        path: PathBuf,
        /// What is wrong with it.
        error: CarmenError,
    },
}
