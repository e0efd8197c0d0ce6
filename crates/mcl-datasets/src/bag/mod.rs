//! Bags of ROS messages: reading them as recordings, and writing recordings as bags.
//!
//! A bag is an MCAP file, a ROS 1 bag, a SQLite database of rosbag2, or the folder of a split bag with its
//! `metadata.yaml` ([`container`](crate::container)), plain or compressed. Messages are decoded as the bag
//! describes them (`ros2msg`, `ros2idl`, `ros1msg`), whatever the order of their fields; standard types
//! that it does not describe, as the standard says.
//!
//! * **Topics** are found by the types of their messages; [`TopicChoice`](crate::log::TopicChoice)
//!   chooses where several could be meant. Scans: `sensor_msgs/LaserScan` or `MultiEchoLaserScan` (of each
//!   beam the first echo), the only topic or `/scan`; with
//!   [`ReadOptions::slice`](crate::log::ReadOptions::slice) a `PointCloud2`, of which the points between
//!   two heights make a scan. Odometry: `nav_msgs/Odometry`, the only topic or `/odom`. Reference:
//!   `geometry_msgs/PoseStamped` or `PoseWithCovarianceStamped`, the only topic or the one named as ground
//!   truth (`/reference`, `/ground_truth`, …), but for goals, initial poses and what is named as the
//!   estimate of another program (`/amcl_pose`, `/robot1/pose`, …); `Odometry`, `TransformStamped` and `nav_msgs/Path` if
//!   they are named as ground truth or asked for, and two frames of transforms (`/tf:map.base_link`). Where
//!   that leaves several odometries or references, none is taken, and the report says so.
//! * **Stamps** are those of the headers, or the time of logging where a header's is zero. A jump back by
//!   more than a second, or by more than the usual interval of a topic to where it was before, begins a new
//!   stretch of time, and nothing leads from one into the other. Stamps that several scans or poses share pair
//!   them only where there are as many of each; a message that comes twice counts once.
//! * **Readings** nearer than `range_min` are −∞, and from `range_max` on +∞ (REP 117), so never points;
//!   limits that are equal or in the wrong order are none. A scanner that turns clockwise has a
//!   negative `angle_increment`, and keeps it. Scans of more than a turn are malformed.
//! * **Frames**: transforms are those of the scan topic's namespace. The robot is the odometry's
//!   `child_frame_id`, or what the laser moves with on `/tf`; its parent there is the odometry, where no
//!   topic is. [`crate::log::ReadOptions`] says otherwise.
//! * **The mount** of the laser is the chain of transforms from the robot's frame to the scan's, seen from
//!   above; one that sways is taken as it is at each scan. A laser mounted upside down has its directions
//!   turned over; of one that is tilted by 3° or more, the endpoints are projected into the plane. Without
//!   such a chain the laser is taken to be at the robot's origin.
//! * **Motion during a scan**: where a scan says how long it takes (`time_increment`), each beam is placed
//!   where the laser was when it was measured, by the odometry, or else by the reference, as seen from where
//!   it was at the stamp ([`Sweep`](mcl_core::Sweep)). Readings measured where neither tells of a pose are
//!   left out. [`ReadOptions::no_deskew`](crate::log::ReadOptions::no_deskew) takes scans as measured at once.
//! * **Odometry** at the time of a scan lies between its two neighbours: on the line between the
//!   positions, on the shorter arc between the headings. `/tf` tells the same poses, and is used before
//!   the first and after the last message of the topic, or without one. Nothing is extrapolated, nor
//!   interpolated over more than a few usual intervals: scans there have no odometry. The **reference** is
//!   taken in the same way; its poses are those of the robot's frame, or of the `child_frame_id` of its
//!   messages.
//!
//! What contradicts itself or is guessed is in [`ReadReport::doubts`](crate::log::ReadReport::doubts).
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
/// [`BagError`] for bytes that are no bag or damaged, and for a bag without scans.
pub fn read(input: impl Read, options: &ReadOptions) -> Result<Log, BagError> {
    recording::assemble(filled(recording::content(options), input)?, options)
}

/// Reads the point clouds of one topic of a bag of one file.
///
/// # Errors
/// [`BagError`] for bytes that are no bag or damaged, for a bag without point clouds or with several
/// topics of them, and for several clouds of a scanner that nothing tells the place of.
pub fn read_clouds(input: impl Read, options: &CloudOptions) -> Result<BagCloud, BagError> {
    clouds::join(filled(clouds::content(options), input)?, options)
}

/// Reads the poses of one topic of a bag of one file: the topic asked for, or the one that its type and
/// name tell.
///
/// # Errors
/// [`BagError`] for bytes that are no bag or damaged, and where no topic, or several, could be meant.
pub fn read_poses(input: impl Read, request: &PoseRequest<'_>) -> Result<PoseTopic, BagError> {
    poses::poses(filled(Content::new(Purpose::Scans, None), input)?, request)
}

fn filled(mut content: Content, input: impl Read) -> Result<Content, BagError> {
    content.add(Input { stream: Box::new(BufReader::new(input)), file: None }, None)?;
    Ok(content)
}
