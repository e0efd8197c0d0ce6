//! ROS 2 bags in MCAP files: reading them as recordings, and writing recordings as bags.
//!
//! A bag is a `.mcap` file or the folder of a split bag with its `metadata.yaml`: profile `ros2`,
//! messages in CDR, descriptions in `ros2msg` or `ros2idl`, chunks packed by zstd, lz4 or not at all, or
//! no chunks; an index is not needed. Messages are decoded as the bag describes them, whatever the
//! order of their fields.
//!
//! * **Topics** are found by the types of their messages; [`TopicChoice`](crate::log::TopicChoice)
//!   chooses where several could be meant. Scans: `sensor_msgs/LaserScan`, the only topic or `/scan`.
//!   Odometry: `nav_msgs/Odometry`, the only topic or `/odom`. Reference: `geometry_msgs/PoseStamped` or
//!   `PoseWithCovarianceStamped`, the only topic or the one named as ground truth (`/reference`,
//!   `/ground_truth`, …), but for goals and initial poses. Where that leaves several, it is an error
//!   that lists them.
//! * **Stamps** are those of the headers, or the time of logging where a header's is zero.
//! * **Readings** nearer than `range_min` are −∞ and beyond `range_max` +∞ (REP 117), so never points;
//!   limits that are equal or in the wrong order are none. A scanner that turns clockwise has a
//!   negative `angle_increment`, and keeps it.
//! * **The mount** of the laser is the chain of transforms from the odometry's `child_frame_id` to the
//!   scan's `frame_id` on `/tf_static`, or on `/tf` where they do not change, seen from above. A laser
//!   mounted upside down has its directions turned over. Without such a chain the laser is taken to be
//!   at the robot's origin, and the log's notes say so.
//! * **Odometry** at the time of a scan lies between its two neighbours: on the line between the
//!   positions, on the shorter arc between the headings. `/tf` tells the same poses, and is used before
//!   the first and after the last message of the topic, or without one. Nothing is extrapolated: scans
//!   outside have no odometry. The **reference** is taken in the same way; its poses are those of the
//!   robot's frame, or of the `child_frame_id` of an odometry topic.
//!
//! **Point clouds** ([`read_clouds`]): `sensor_msgs/PointCloud2`, the only topic or `/points`. x, y and z are
//! FLOAT32 or FLOAT64 fields at any place of a point, in either byte order; padding and other fields are
//! passed over, and points that are not finite left out and counted. All clouds of the topic are joined in
//! the frame at the root of `/tf` and `/tf_static`, each where the scanner was at its stamp, between the
//! two neighbouring transforms; an odometry topic tells of its two frames where `/tf` does not. Several
//! clouds are taken as they are only in a frame that stands still: `map`, `odom`, `world`, `earth`,
//! `camera_init`, or one that others move in. Clouds are not corrected for motion during a turn of the
//! scanner.
//!
//! # Example
//! ```
//! use mcl_core::Seed;
//! use mcl_datasets::bag;
//! use mcl_datasets::log::{LogKind, ReadOptions, read_log_as};
//! use mcl_datasets::simulator::{OfficeSettings, simulate};
//! use std::io::Cursor;
//!
//! let recording = simulate(&OfficeSettings::default(), Seed::new(1))?;
//! let bytes = bag::write(&recording, Cursor::new(Vec::new()))?.into_inner();
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("office.mcap");
//! std::fs::write(&path, bytes)?;
//! let log = read_log_as(&path, &ReadOptions::default())?;
//! assert_eq!(log.kind, LogKind::Bag);
//! assert_eq!(log.recording.scans.len(), recording.scans.len());
//! assert!(log.recording.has_reference() && log.recording.has_odometry());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cdr;
pub(crate) mod clouds;
mod decoder;
mod encode;
pub(crate) mod error;
mod idl_text;
mod layout;
mod messages;
mod moment;
mod motion;
mod msg_text;
pub mod planar;
mod point_cloud;
pub(crate) mod poses;
pub(crate) mod recording;
pub mod schema;
mod slice;
pub(crate) mod topics;
mod track;
pub mod types;
mod writer;

use std::io::{BufReader, Read};

pub use crate::container::chunk::MAX_CHUNK_BYTES;
pub use crate::container::folder::listed_files;
pub use clouds::{BagCloud, CloudOptions};
pub use encode::Encoder;
pub use error::BagError;
pub use point_cloud::is_in_range;
pub use poses::PoseTopic;
use topics::{Content, Purpose};
pub use topics::{MAX_CLOUD_BYTES, MAX_KEPT_BYTES, MAX_MESSAGE_BYTES, PoseRole};
pub use writer::{
    BASE_FRAME, BagWriter, Delivery, LASER_FRAME, MAP_FRAME, TopicId, WriteBagError, check_scans,
    write,
};

use crate::container::item::Input;
use crate::log::content::Log;
use crate::log::options::ReadOptions;

/// Reads a bag of one file.
///
/// # Errors
/// [`BagError`] for bytes that are no bag or damaged, and for a bag without scans.
pub fn read(input: impl Read, options: &ReadOptions) -> Result<Log, BagError> {
    recording::assemble(content_of(input, recording::purpose(options))?, options)
}

/// Reads the point clouds of one topic of a bag of one file.
///
/// # Errors
/// [`BagError`] for bytes that are no bag or damaged, for a bag without point clouds or with several
/// topics of them, and for several clouds of a scanner that nothing tells the place of.
pub fn read_clouds(input: impl Read, options: &CloudOptions) -> Result<BagCloud, BagError> {
    clouds::join(&content_of(input, Purpose::Clouds)?, options)
}

/// Reads the poses of one topic of a bag of one file: the topic asked for, or the one that its type and
/// name tell.
///
/// # Errors
/// [`BagError`] for bytes that are no bag or damaged, and where no topic, or several, could be meant.
pub fn read_poses(
    input: impl Read,
    topic: Option<&str>,
    role: PoseRole,
) -> Result<PoseTopic, BagError> {
    poses::poses(&content_of(input, Purpose::Scans)?, topic, role)
}

fn content_of(input: impl Read, purpose: Purpose) -> Result<Content, BagError> {
    let mut content = Content::new(purpose);
    content.add(Input { stream: Box::new(BufReader::new(input)), file: None }, None)?;
    Ok(content)
}
