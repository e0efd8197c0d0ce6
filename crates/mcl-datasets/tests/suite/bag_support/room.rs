//! A robot drives through a room whose walls are known, so that every point that is read can be held against
//! them.

use std::f64::consts::{FRAC_PI_2, PI};

use mcl_core::Pose2;
use mcl_datasets::bag::Encoder;
use mcl_datasets::bag::types;
use mcl_datasets::log::{Log, ReadOptions, TopicChoice};

use super::*;

/// Walls of the room: from 0 to 8 m in x and from 0 to 6 m in y.
pub const SIZE: [f64; 2] = [8.0, 6.0];
pub const MOUNT: Pose2 = Pose2::new(-0.15, 0.05, FRAC_PI_2);
pub const START: i64 = 1_700_000_000 * SECOND;

/// Where the robot is, seconds after the start: on an ellipse.
pub fn path(seconds: f64) -> Pose2 {
    let phase = 0.2 * seconds;
    let (sin, cos) = phase.sin_cos();
    Pose2::new(4.0 + 1.5 * cos, 3.0 + sin, (0.2 * cos).atan2(-0.3 * sin))
}

/// Distance to the wall in a direction, from inside.
pub fn cast(laser: Pose2, angle: f64) -> f64 {
    let (sin, cos) = (laser.theta + angle).sin_cos();
    let along = |at: f64, size: f64, direction: f64| match direction {
        d if d > 1e-12 => (size - at) / d,
        d if d < -1e-12 => -at / d,
        _ => f64::INFINITY,
    };
    along(laser.x, SIZE[0], cos).min(along(laser.y, SIZE[1], sin))
}

pub fn wall_distance([x, y]: [f64; 2]) -> f64 {
    let inside = x.min(SIZE[0] - x).min(y).min(SIZE[1] - y);
    inside.abs()
}

/// How far the points of a log are off the walls, at most.
pub fn worst(log: &Log) -> f64 {
    let scans = log.recording.scans.iter();
    let points = scans.flat_map(|scan| scan.endpoints(scan.map_from_laser.unwrap(), 100.0));
    let points: Vec<_> = points.collect();
    assert!(points.len() > 500, "{} points", points.len());
    points.into_iter().map(wall_distance).fold(0.0, f64::max)
}

pub fn at(seconds: f64) -> i64 {
    START + (seconds * 1e9).round() as i64
}

/// The fields of a scan before its readings.
#[derive(Clone, Copy)]
pub struct Fields {
    pub angle_min: f64,
    pub angle_max: f64,
    pub step: f64,
    pub range_max: f32,
    pub time_increment: f32,
}

pub const BEAMS: usize = 181;
pub const HALF_TURN: Fields = Fields {
    angle_min: -FRAC_PI_2,
    angle_max: FRAC_PI_2,
    step: PI / 180.0,
    range_max: 30.0,
    time_increment: 0.0,
};

pub fn scan_message(time: i64, frame: &str, fields: Fields, ranges: &[f64]) -> Encoder {
    let mut message = Encoder::default();
    message.header(stamp(time), frame);
    message.f32(fields.angle_min as f32).f32(fields.angle_max as f32).f32(fields.step as f32);
    message
        .f32(fields.time_increment)
        .f32(0.0)
        .f32(0.05)
        .f32(fields.range_max)
        .u32(ranges.len() as u32);
    for &range in ranges {
        message.f32(range as f32);
    }
    message.u32(0);
    message
}

/// What the laser sees from a place.
pub fn seen(laser: Pose2, fields: Fields) -> Vec<f64> {
    (0..BEAMS).map(|beam| cast(laser, fields.angle_min + beam as f64 * fields.step)).collect()
}

pub fn scan_at(topic: &'static str, seconds: f64, frame: &str) -> Entry {
    let ranges = seen(path(seconds).compose(&MOUNT), HALF_TURN);
    let message = scan_message(at(seconds), frame, HALF_TURN, &ranges);
    entry(topic, &types::LASER_SCAN, at(seconds), message)
}

pub fn quaternion(theta: f64) -> [f64; 4] {
    [0.0, 0.0, (0.5 * theta).sin(), (0.5 * theta).cos()]
}

pub fn edge(topic: &'static str, seconds: f64, [parent, child]: [&str; 2], pose: Pose2) -> Entry {
    let [i, j, k, w] = quaternion(pose.theta);
    transform_on(topic, at(seconds), parent, child, [pose.x, pose.y, 0.0, i, j, k, w])
}

/// Odometry begins where the robot does.
pub fn odometry_pose(seconds: f64) -> Pose2 {
    path(0.0).between(&path(seconds))
}

pub fn odometry_at(topic: &'static str, seconds: f64, child: &str) -> Entry {
    odometry_on(topic, at(seconds), child, odometry_pose(seconds))
}

pub fn truth_at(seconds: f64) -> Entry {
    pose_on("/ground_truth", at(seconds), path(seconds))
}

pub fn mounted() -> Entry {
    edge("/tf_static", 0.0, ["base_link", "laser"], MOUNT)
}

/// Ten seconds: what `at_each` gives every tenth of a second, and a scan every second time.
pub fn drive(at_each: impl Fn(f64, &mut Vec<Entry>)) -> Vec<Entry> {
    let mut entries = Vec::new();
    for k in 0..=100 {
        let seconds = f64::from(k) * 0.1;
        at_each(seconds, &mut entries);
        if k % 2 == 0 {
            entries.push(scan_at("/scan", seconds, "laser"));
        }
    }
    entries
}

/// The usual bag.
pub fn usual() -> Vec<Entry> {
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(odometry_at("/odom", seconds, "base_link"));
        entries.push(truth_at(seconds));
    }));
    entries
}

pub fn with_reference(topic: &str) -> ReadOptions {
    let topics = TopicChoice { reference: Some(topic.to_owned()), ..TopicChoice::default() };
    ReadOptions { topics, ..ReadOptions::default() }
}

#[track_caller]
pub fn assert_exact(log: &Log) {
    assert!(worst(log) < 1e-5, "{}", worst(log));
    assert!(log.recording.has_odometry(), "{:?}", log.notes);
    assert_eq!(log.report.doubts, [""; 0]);
    for pair in log.recording.scans.windows(2) {
        let before = pair[0].map_from_laser.unwrap();
        let expected = before.between(&pair[1].map_from_laser.unwrap());
        let found = pair[1].odometry.unwrap();
        assert!(expected.between(&found).x.abs() < 1e-9, "{found:?}, expected {expected:?}");
    }
}
