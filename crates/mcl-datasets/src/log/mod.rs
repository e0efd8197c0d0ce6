//! Reading a laser log of any supported format: opening the file, recognizing its format by its first bytes,
//! and the report of a reader beside the recording.
//!
//! # Example
//! ```no_run
//! use mcl_datasets::log::read_log;
//!
//! let log = read_log("intel.gfs.log".as_ref())?;
//! println!("{} scans, {}", log.recording.scans.len(), log.kind);
//! if !log.report.is_complete() {
//!     eprintln!("{}", log.report);
//! }
//! # Ok::<(), mcl_datasets::log::LogError>(())
//! ```

pub(crate) mod content;
pub(crate) mod error;
mod foreign;
mod open;
pub(crate) mod options;
pub(crate) mod plane;
pub(crate) mod reference;
pub(crate) mod report;

pub use content::{Log, LogKind};
pub use error::LogError;
pub use open::{
    is_bag, is_bag_folder, read_clouds, read_log, read_log_as, read_log_from, read_poses, survey,
};
pub use options::{
    LaserPose, ParseReferencePosesError, ReadOptions, ReferencePoses, ReferenceTrack, TopicChoice,
};
pub use plane::{PoseInSpace, out_of_plane};
pub use reference::poses_at;
pub use report::{ReadReport, RecordPlace, SkippedRecord};
