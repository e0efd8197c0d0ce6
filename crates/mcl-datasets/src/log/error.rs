//! Why no log could be read from a file.

use std::io;
use std::path::PathBuf;

use crate::bag::error::BagError;
use crate::carmen::reader::CarmenError;

/// The supported inputs.
const EXPECTED: &str = "a CARMEN log, an MCAP file, a ROS 1 bag or a rosbag2 database (.db3), plain or as .gz, .bz2, .xz or .zst";

/// Why no log could be read from a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file does not exist.
    #[error("{}: no such file; check the path, or fetch the data set first", path.display())]
    NotFound {
        /// The requested path.
        path: PathBuf,
    },
    /// The path is a directory.
    #[error("{}: a directory, expected a log file, or the folder of a rosbag2 bag with its metadata.yaml", path.display())]
    Directory {
        /// The requested path.
        path: PathBuf,
    },
    /// The operating system could not open or read the file.
    #[error("{}: cannot be read: {error}", path.display())]
    Io {
        /// The requested path.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// The file, or its decompressed content, is empty.
    #[error("{}: the file is empty, expected {EXPECTED}", path.display())]
    Empty {
        /// The requested path.
        path: PathBuf,
    },
    /// The file, or its decompressed content, is not text.
    #[error(
        "{}: a binary file (byte {offset} is NUL), expected {EXPECTED}",
        path.display()
    )]
    Binary {
        /// The requested path.
        path: PathBuf,
        /// Offset of the first NUL byte, from 0, after decompression.
        offset: usize,
    },
    /// The file is of an unsupported kind.
    #[error("{}: {what}, expected {EXPECTED}; {advice}", path.display())]
    Foreign {
        /// The requested path.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// No recording could be read from a bag.
    #[error("{}: {error}", path.display())]
    Bag {
        /// The requested file or folder, or the file of a split bag.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<BagError>,
    },
    /// Topics were requested, but the log is not a bag.
    #[error("{}: a CARMEN log has no topics, so there is no {topic:?}; leave out --odom-topic and --reference-topic; --scan-topic, if given, names a kind of record: FLASER, RLASER, ROBOTLASER1 or ROBOTLASER2", path.display())]
    NoTopics {
        /// The requested path.
        path: PathBuf,
        /// The first topic requested.
        topic: String,
    },
    /// An option was used that applies only to bags.
    #[error("{}: a CARMEN log, which gives the pose of its laser itself and has neither frames nor point clouds; {option} applies to bags only", path.display())]
    OfBags {
        /// The requested path.
        path: PathBuf,
        /// The option.
        option: &'static str,
    },
    /// The file begins like a compressed one, but cannot be decompressed.
    #[error("{}: {reason}; fetch the file again", path.display())]
    Compressed {
        /// The requested path.
        path: PathBuf,
        /// What is wrong with the compressed data.
        reason: String,
    },
    /// The text could not be read as a CARMEN log.
    #[error("{}: {error}", path.display())]
    Carmen {
        /// The requested path.
        path: PathBuf,
        /// What is wrong with it.
        error: CarmenError,
    },
}
