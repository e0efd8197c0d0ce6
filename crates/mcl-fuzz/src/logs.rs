//! Logs: CARMEN, and bags from the whole file down to the message.

use std::path::Path;

use mcl_core::{LaserScan, Pose2, ScanGeometry, Stamp};
use mcl_datasets::bag::schema::MessageSchema;
use mcl_datasets::bag::{
    PoseRequest, PoseRole, cdr, listed_files, planar, read, read_poses, types,
};
use mcl_datasets::carmen;
use mcl_datasets::log::{ReadOptions, ReferencePoses, read_log_as, read_log_from, survey};

use crate::framing::{Compression, OneMessage, bag_of, chunked, ros1_chunked};
use crate::memory::{ANY_INPUT, bounded};
use crate::recording;

/// A scan record of 60 bytes becomes a scan, its poses and a share of the growing vectors.
const PER_BYTE_OF_TEXT: usize = 64;
/// A message of the worst kind takes some fifty times its bytes when decoded, and messages are kept
/// beside what is made of them.
const PER_BYTE_OF_BAG: usize = 200;
/// A chunk may unpack to a thousand times its bytes (zstd; lz4 to 255 times).
const PER_PACKED_BYTE: usize = 1 << 18;

/// A CARMEN log, whatever its name and the choice of references.
pub fn carmen(bytes: &[u8]) {
    for reference in [ReferencePoses::Auto, ReferencePoses::Recorded, ReferencePoses::None] {
        let read = bounded(bytes.len(), ANY_INPUT, PER_BYTE_OF_TEXT, || {
            carmen::read(bytes, "fuzzed.log", reference)
        });
        match read {
            Ok(log) => recording::check(&log, bytes),
            Err(error) => {
                assert!(error.to_string().len() < 10_000, "{error}");
                return;
            }
        }
    }
}

/// A file of any format, packed or not, recognized by its bytes. Unpacking alone is checked here: deflate
/// packs a thousand bytes into one.
pub fn any_log(bytes: &[u8]) {
    let read = bounded(bytes.len(), 2 * ANY_INPUT, PER_PACKED_BYTE, || {
        read_log_from(bytes, Path::new("fuzzed.log"), &ReadOptions::default())
    });
    match read {
        Ok(log) => recording::check(&log, bytes),
        Err(error) => assert!(error.to_string().starts_with("fuzzed.log: "), "{error}"),
    }
}

fn bag_file(bytes: &[u8], per_byte: usize) {
    let log =
        bounded(bytes.len(), 4 * ANY_INPUT, per_byte, || read(bytes, &ReadOptions::default()));
    for role in [PoseRole::Reference, PoseRole::Estimate] {
        if let Ok(topic) =
            read_poses(bytes, &PoseRequest { into: Some("map"), ..PoseRequest::of(role) })
        {
            let trajectory = &topic.trajectory;
            assert!(trajectory.poses().iter().all(Pose2::is_finite));
            assert!(topic.frame_from_laser.is_none_or(|pose| pose.is_finite()));
        }
    }
    match log {
        Ok(log) => recording::check(&log, bytes),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    seekable(bytes, per_byte);
}

/// The same as a file, in which the index leads past what is not of use; a survey uses nothing but the first
/// message of each topic.
fn seekable(bytes: &[u8], per_byte: usize) {
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(file.path(), bytes).expect("a temporary file");
    let options = ReadOptions::default();
    let log = bounded(bytes.len(), 4 * ANY_INPUT, per_byte, || read_log_as(file.path(), &options));
    if let Ok(log) = log {
        recording::check(&log, bytes);
    }
    let found = bounded(bytes.len(), 4 * ANY_INPUT, per_byte, || survey(file.path(), &options));
    if let Ok(Some(found)) = found {
        assert!(found.topics.iter().all(|topic| (topic.messages == 0) == topic.logged.is_none()));
    }
}

/// A bag of one file, byte by byte.
pub fn mcap(bytes: &[u8]) {
    bag_file(bytes, PER_PACKED_BYTE);
}

/// The records of a chunk, whose lengths and checksum are right; the first byte says how it is packed.
pub fn mcap_chunk(bytes: &[u8]) {
    let Some((&kind, records)) = bytes.split_first() else { return };
    let compression = match kind % 3 {
        0 => Compression::None,
        1 => Compression::Zstd,
        _ => Compression::Lz4,
    };
    let bag = chunked(records, compression);
    bag_file(&bag, PER_PACKED_BYTE.min(PER_BYTE_OF_BAG * (records.len() / bag.len() + 1)));
}

/// A bag of ROS 1, byte by byte.
pub fn ros1_bag(bytes: &[u8]) {
    bag_file(bytes, PER_PACKED_BYTE);
}

/// The records of a chunk of a bag of ROS 1, whose lengths are right; the first byte says how it is packed.
pub fn ros1_chunk(bytes: &[u8]) {
    let Some((&kind, records)) = bytes.split_first() else { return };
    // Seldom packed: bzip2 takes most of the time, and the records are the same.
    let compression = match kind {
        1 => Compression::Bzip2,
        2 => Compression::Lz4,
        _ => Compression::None,
    };
    let bag = ros1_chunked(records, compression);
    bag_file(&bag, PER_PACKED_BYTE.min(PER_BYTE_OF_BAG * (records.len() / bag.len() + 1)));
}

/// A database of rosbag2, page by page.
pub fn database(bytes: &[u8]) {
    bag_file(bytes, PER_PACKED_BYTE);
}

/// A description and a message: the first byte says its language and what the message is used as;
/// then the text of the description up to a NUL, then the message with its head.
pub fn cdr(bytes: &[u8]) {
    let Some((&flags, rest)) = bytes.split_first() else { return };
    let end = rest.iter().position(|&byte| byte == 0).unwrap_or(rest.len());
    let (description, data) = (&rest[..end], rest.get(end + 1..).unwrap_or_default());
    let encoding = if flags & 1 == 0 { "ros2msg" } else { "ros2idl" };
    let (topic, type_name) = match flags >> 1 & 7 {
        0 => ("/scan", types::LASER_SCAN.name),
        1 => ("/odom", types::ODOMETRY.name),
        2 => ("/reference", types::POSE_STAMPED.name),
        3 => ("/reference", types::POSE_WITH_COVARIANCE_STAMPED.name),
        4 => ("/tf", types::TF_MESSAGE.name),
        _ => ("/tf_static", types::TF_MESSAGE.name),
    };
    let schema = bounded(description.len(), ANY_INPUT, PER_BYTE_OF_BAG, || {
        MessageSchema::parse(type_name, encoding, description)
    });
    let Ok(schema) = schema else { return };
    let decoded =
        bounded(data.len(), ANY_INPUT, PER_BYTE_OF_BAG, || cdr::decode_prefix(&schema, data));
    if let Ok((value, length)) = decoded {
        assert!(length <= data.len());
        assert!((length as u64) >= 4 + schema.root().min_bytes, "shorter than the schema allows");
        // What follows the message does not matter. (NaN equals itself in text.)
        let again = cdr::decode(&schema, &data[..length]).expect("the same message");
        assert_eq!(format!("{value:?}"), format!("{again:?}"));
    }
    let geometry = ScanGeometry { start_angle: -0.5, angle_step: 0.5, beams: 3 };
    let scan = LaserScan {
        stamp: None,
        geometry,
        ranges: vec![1.0, 2.0, 3.0],
        map_from_laser: None,
        odometry: None,
        sweep: Default::default(),
    };
    let second = Stamp::from_nanoseconds(1_000_000_000);
    let scan = planar::laser_scan(&scan, second, "laser", (0.0, 10.0)).into_bytes();
    let scan_description = types::LASER_SCAN.description();
    let mut messages = vec![OneMessage { topic, type_name, encoding, description, data }];
    if topic != "/scan" {
        messages.push(OneMessage {
            topic: "/scan",
            type_name: types::LASER_SCAN.name,
            encoding: "ros2msg",
            description: scan_description.as_bytes(),
            data: &scan,
        });
    }
    bag_file(&bag_of(&messages), PER_BYTE_OF_BAG);
}

/// The `metadata.yaml` of a split bag.
pub fn bag_metadata(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let listed = bounded(bytes.len(), ANY_INPUT, 2_000, || listed_files(text));
    match listed {
        Ok(names) => assert!(!names.is_empty()),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
