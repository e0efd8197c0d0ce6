//! Bags built in code, message by message, with the `mcap` crate.

pub mod database;
pub mod room;
pub mod ros1;

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use mcl_core::{Pose2, Stamp};
use mcl_datasets::bag::types::{LASER_SCAN, MessageType, ODOMETRY, POSE_STAMPED, TF_MESSAGE};
use mcl_datasets::bag::{self, BagError, Encoder};
use mcl_datasets::log::{Log, ReadOptions};

pub const SECOND: i64 = 1_000_000_000;

/// One message to be written.
#[derive(Clone)]
pub struct Entry {
    pub topic: &'static str,
    pub schema: (String, String, Vec<u8>),
    pub encoding: &'static str,
    pub log_time: u64,
    pub data: Vec<u8>,
}

/// A bag of these messages, in this order.
pub fn bag_as(entries: &[Entry], options: WriteOptions) -> Vec<u8> {
    let mut writer: Writer<Cursor<Vec<u8>>> =
        options.profile("ros2").create(Cursor::new(Vec::new())).unwrap();
    for (sequence, entry) in entries.iter().enumerate() {
        let (name, encoding, text) = &entry.schema;
        let schema = writer.add_schema(name, encoding, text).unwrap();
        let channel =
            writer.add_channel(schema, entry.topic, entry.encoding, &BTreeMap::new()).unwrap();
        let header = MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time: entry.log_time,
            publish_time: entry.log_time,
        };
        writer.write_to_known_channel(&header, &entry.data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

pub fn bag(entries: &[Entry]) -> Vec<u8> {
    bag_as(entries, WriteOptions::new().compression(Some(Compression::Zstd)))
}

pub fn unchunked(entries: &[Entry]) -> Vec<u8> {
    bag_as(entries, WriteOptions::new().use_chunks(false))
}

pub fn entry(topic: &'static str, message: &MessageType, stamp: i64, data: Encoder) -> Entry {
    let text = message.description().into_bytes();
    Entry {
        topic,
        schema: (message.name.to_owned(), "ros2msg".to_owned(), text),
        encoding: "cdr",
        log_time: stamp as u64,
        data: data.into_bytes(),
    }
}

pub fn stamp(nanoseconds: i64) -> Stamp {
    Stamp::from_nanoseconds(nanoseconds)
}

/// A scan of three beams at −45°, 0 and 45°, limits 0.1 m and 20 m.
pub fn scan_on(topic: &'static str, at: i64, ranges: &[f32]) -> Entry {
    scan_with(topic, at, "laser", [-0.75, 0.75], [0.1, 20.0], ranges)
}

pub fn scan(at: i64) -> Entry {
    scan_on("/scan", at, &[1.0, 2.0, 3.0])
}

pub fn scan_with(
    topic: &'static str,
    at: i64,
    frame: &str,
    [start, step]: [f32; 2],
    [min, max]: [f32; 2],
    ranges: &[f32],
) -> Entry {
    let mut message = Encoder::default();
    message.header(stamp(at), frame).f32(start).f32(start + 2.0 * step).f32(step);
    message.f32(0.0).f32(0.0).f32(min).f32(max).u32(ranges.len() as u32);
    for &range in ranges {
        message.f32(range);
    }
    message.u32(0);
    entry(topic, &LASER_SCAN, at, message)
}

pub fn odometry_on(topic: &'static str, at: i64, child: &str, pose: Pose2) -> Entry {
    let mut message = Encoder::default();
    message.header(stamp(at), "odom").text(child).pose(pose).f64s(&[0.0; 78]);
    entry(topic, &ODOMETRY, at, message)
}

pub fn odometry(at: i64, x: f64, y: f64, theta: f64) -> Entry {
    odometry_on("/odom", at, "base_link", Pose2::new(x, y, theta))
}

pub fn pose_on(topic: &'static str, at: i64, pose: Pose2) -> Entry {
    let mut message = Encoder::default();
    message.header(stamp(at), "map").pose(pose);
    entry(topic, &POSE_STAMPED, at, message)
}

pub fn transform_on(
    topic: &'static str,
    at: i64,
    parent: &str,
    child: &str,
    parts: [f64; 7],
) -> Entry {
    let mut message = Encoder::default();
    message.u32(1).header(stamp(at), parent).text(child).f64s(&parts);
    entry(topic, &TF_MESSAGE, at, message)
}

/// A walk of `n` scans, one a second, between odometry messages at every half second, laser turned
/// by 90° at (0.2, 0) on the robot.
pub fn walk(n: i64) -> Vec<Entry> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let mounted = [0.2, 0.0, 0.3, 0.0, 0.0, half, half];
    let mut entries = vec![transform_on("/tf_static", SECOND, "base_link", "laser", mounted)];
    for k in 1..=n {
        let at = k * SECOND;
        entries.push(odometry(at - SECOND / 2, k as f64 - 0.5, 0.0, 0.0));
        entries.push(scan(at));
    }
    entries.push(odometry(n * SECOND + SECOND / 2, n as f64 + 0.5, 0.0, 0.0));
    entries
}

pub fn read(bytes: &[u8]) -> Log {
    bag::read(bytes, &ReadOptions::default()).unwrap()
}

pub fn refused(bytes: &[u8]) -> BagError {
    bag::read(bytes, &ReadOptions::default()).unwrap_err()
}

#[track_caller]
pub fn assert_says(error: &BagError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

/// Cuts a bag off at each of these bytes: what is read has to be what the whole bag begins with, and the place
/// reported. Returns the largest number of scans read.
#[track_caller]
pub fn most_scans_of_cuts(name: &str, bytes: &[u8], ends: impl Iterator<Item = usize>) -> usize {
    let whole = read(bytes);
    let mut seen = 0;
    for end in ends {
        match bag::read(&bytes[..end], &ReadOptions::default()) {
            Ok(log) => {
                let scans = &log.recording.scans;
                seen = seen.max(scans.len());
                for (found, expected) in scans.iter().zip(&whole.recording.scans) {
                    assert_eq!((found.stamp, &found.ranges), (expected.stamp, &expected.ranges));
                }
                let reason = log.report.truncated.expect(name);
                assert!(reason.contains(&format!("ends at byte {end}")), "{name}: {reason}");
            }
            Err(error) => assert_says(&error, &["LaserScan"]),
        }
    }
    seen
}

#[track_caller]
pub fn assert_doubts(log: &Log, parts: &[&str]) {
    let doubts = log.report.doubts.join("\n");
    for part in parts {
        assert!(doubts.contains(part), "no {part:?} in: {doubts}");
    }
    assert!(!log.report.is_complete());
}

#[track_caller]
pub fn assert_pose(found: Option<Pose2>, x: f64, y: f64, theta: f64) {
    let found = found.expect("a pose");
    let error = Pose2::new(x, y, theta).between(&found);
    assert!(error.x.hypot(error.y) < 1e-12 && error.theta.abs() < 1e-12, "{found:?}");
}
