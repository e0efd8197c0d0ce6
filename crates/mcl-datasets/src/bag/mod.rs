//! Bags of ROS messages: reading them as recordings, and writing recordings as bags.
//!
//! A bag is an MCAP file, a ROS 1 bag, a SQLite database of rosbag2, or the folder of a split bag with its
//! `metadata.yaml` ([`container`](crate::container)), plain or compressed. Messages are decoded by the
//! descriptions in the bag (`ros2msg`, `ros2idl`, `ros1msg`), whatever the order of their fields; standard
//! types without a description in the bag are decoded by the standard one.
//!
//! * **Topics** are found by the types of their messages; [`TopicChoice`](crate::log::TopicChoice)
//!   selects one where several match. Scans: `sensor_msgs/LaserScan` or `MultiEchoLaserScan` (the first
//!   echo of each beam), the only topic or `/scan`; with
//!   [`ReadOptions::slice`](crate::log::ReadOptions::slice) a `PointCloud2`, whose points between two
//!   heights make a scan. Odometry: `nav_msgs/Odometry`, the only topic or `/odom`. Reference:
//!   `geometry_msgs/PoseStamped` or `PoseWithCovarianceStamped`, the only topic or the one named as
//!   ground truth (`/reference`, `/ground_truth`, …), except goals, initial poses and topics named as the
//!   estimate of another program (`/amcl_pose`, `/robot1/pose`, …); `Odometry`, `TransformStamped` and
//!   `nav_msgs/Path` if they are named as ground truth or requested, and two frames of transforms
//!   (`/tf:map.base_link`). Where several odometries or references remain, none is used, and the report
//!   says so.
//! * **Stamps** are those of the headers, or the log times where a header's stamp is zero. A jump back by
//!   more than a second, or by more than the usual interval of a topic to a time covered before, begins a
//!   new stretch of time, and nothing is interpolated from one to the other. Scans and poses that share
//!   stamps are paired only where there are as many of each; a repeated message counts once.
//! * **Readings** nearer than `range_min` are −∞, and from `range_max` on +∞ (REP 117), so they never
//!   become points; limits that are equal or in the wrong order are ignored. A scanner that turns
//!   clockwise has a negative `angle_increment`, which is kept. Scans of more than a turn are malformed.
//! * **Frames**: transforms are those of the scan topic's namespace. The robot's frame is the odometry's
//!   `child_frame_id`, or the frame that the laser moves with on `/tf`; without an odometry topic, its
//!   parent there is the odometry frame. [`crate::log::ReadOptions`] overrides this.
//! * **The mount** of the laser is the chain of transforms from the robot's frame to the scan's, seen
//!   from above; a swaying one is evaluated at each scan. For a laser mounted upside down, the directions
//!   are reversed; for one tilted by 3° or more, the endpoints are projected into the plane. Without such
//!   a chain the laser is assumed at the robot's origin.
//! * **Motion during a scan**: where a scan states how long it takes (`time_increment`), each beam is
//!   placed at the pose of the laser when it was measured, by the odometry or else by the reference,
//!   relative to the pose at the stamp ([`Sweep`](mcl_core::Sweep)). Readings measured at a time when
//!   neither has a pose are left out. [`ReadOptions::no_deskew`](crate::log::ReadOptions::no_deskew)
//!   treats scans as measured at once.
//! * **Odometry** at the time of a scan is interpolated between its two neighbours: positions linearly,
//!   headings along the shorter arc. `/tf` has the same poses, and is used before the first and after the
//!   last message of the topic, or without one. Nothing is extrapolated, nor interpolated over more than
//!   a few usual intervals: scans there have no odometry. The **reference** is treated in the same way;
//!   its poses are those of the robot's frame, or of the `child_frame_id` of its messages.
//!
//! Contradictions and guesses are listed in [`ReadReport::doubts`](crate::log::ReadReport::doubts).
//!
//! **Point clouds** ([`read_clouds`]): `sensor_msgs/PointCloud2`, the only topic or `/points`. x, y and z
//! are FLOAT32 or FLOAT64 fields at any offset of a point, in either byte order; padding and other fields
//! are ignored, and points that are not finite are left out and counted. All clouds of the topic are
//! joined in the frame at the root of `/tf` and `/tf_static`, each at the scanner's pose at its stamp,
//! interpolated between the two neighbouring transforms; an odometry topic supplies the transform between
//! its two frames where `/tf` does not. Several clouds are joined without transforms only in a fixed
//! frame: `map`, `odom`, `world`, `earth`, `camera_init`, or one that others move in. Clouds are not
//! corrected for motion during a turn of the scanner.
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

mod beams;
pub mod cdr;
pub(crate) mod clouds;
pub(crate) mod content;
mod decoder;
mod encode;
pub(crate) mod error;
mod idl_text;
mod laser;
mod layout;
mod lists;
mod messages;
pub(crate) mod moment;
mod motion;
mod msg_text;
pub(crate) mod pairing;
pub mod planar;
mod point_cloud;
pub(crate) mod poses;
pub(crate) mod recording;
mod scans;
pub mod schema;
#[cfg(feature = "bags")]
mod sink;
mod slice;
pub(crate) mod survey;
pub(crate) mod topics;
pub(crate) mod track;
pub mod types;
#[cfg(feature = "sqlite")]
mod write_database;
#[cfg(feature = "bags")]
mod write_ros1;
#[cfg(feature = "bags")]
mod writer;

use std::io::{BufReader, Read};

pub use crate::container::chunk::MAX_CHUNK_BYTES;
pub use crate::container::folder::listed_files;
pub use clouds::{BagCloud, CloudOptions};
use content::{Content, Purpose};
pub use content::{MAX_CLOUD_BYTES, MAX_KEPT_BYTES, MAX_MESSAGE_BYTES};
pub use encode::Encoder;
pub use error::BagError;
pub use point_cloud::is_in_range;
pub use poses::{PoseRequest, PoseTopic};
#[cfg(feature = "bags")]
pub use sink::{Delivery, TopicId, WriteBagError};
pub use survey::{Choice, Survey, TopicFacts};
pub use topics::PoseRole;
#[cfg(feature = "bags")]
pub use writer::{
    BASE_FRAME, BagWriter, Format, LASER_FRAME, MAP_FRAME, check_scans, write, write_as,
};

use crate::container::item::Input;
use crate::log::content::Log;
use crate::log::options::ReadOptions;

/// Reads a bag of one file.
///
/// # Errors
/// [`BagError`] for bytes that are not a bag or are damaged, and for a bag without scans.
pub fn read(input: impl Read, options: &ReadOptions) -> Result<Log, BagError> {
    recording::assemble(filled(recording::content(options), input)?, options)
}

/// Reads the point clouds of one topic of a bag of one file.
///
/// # Errors
/// [`BagError`] for bytes that are not a bag or are damaged, for a bag without point clouds or with several
/// topics of them, and for several clouds of a scanner whose poses are not known.
pub fn read_clouds(input: impl Read, options: &CloudOptions) -> Result<BagCloud, BagError> {
    clouds::join(filled(clouds::content(options), input)?, options)
}

/// Reads the poses of one topic of a bag of one file: the requested topic, or the one found by its type and
/// name.
///
/// # Errors
/// [`BagError`] for bytes that are not a bag or are damaged, and where no topic, or more than one, matches.
pub fn read_poses(input: impl Read, request: &PoseRequest<'_>) -> Result<PoseTopic, BagError> {
    poses::poses(filled(Content::new(Purpose::Scans, None), input)?, request)
}

fn filled(mut content: Content, input: impl Read) -> Result<Content, BagError> {
    content.add(Input { stream: Box::new(BufReader::new(input)), file: None }, None)?;
    Ok(content)
}
