//! What holds for every recording that was read, and its way through the writers.

use std::io::Cursor;

use mcl_core::{Pose2, Recording, ScanGeometry, wrap_angle};
use mcl_datasets::bag::{self, WriteBagError};
use mcl_datasets::carmen::{self, NO_RETURN, WriteError};
use mcl_datasets::log::{Log, LogKind, ReadOptions, ReferencePoses};

/// Checks a log as it was read from these bytes, then writes it and reads it back: as CARMEN, and one in
/// eight, as packing takes longer than all the rest, as a bag.
pub fn check(log: &Log, bytes: &[u8]) {
    let recording = &log.recording;
    is_sound(recording);
    assert_eq!(log.report.skipped_details.len(), log.report.skipped.min(20));
    assert!(log.report.is_complete() || !log.report.to_string().is_empty());
    assert!(log.kind != LogKind::Raw || !recording.has_reference());
    through_carmen(recording);
    if crc32fast::hash(bytes).is_multiple_of(8) {
        through_a_bag(recording);
    }
}

fn is_sound(recording: &Recording) {
    assert!(!recording.scans.is_empty());
    assert!(recording.robot_from_laser.is_finite(), "mount {:?}", recording.robot_from_laser);
    assert_eq!(recording.scans[0].odometry, None);
    for (index, scan) in recording.scans.iter().enumerate() {
        assert_eq!(scan.ranges.len(), scan.geometry.beams);
        assert!(scan.geometry.beams > 0);
        if let Some(directions) = &scan.sweep.directions {
            assert_eq!(directions.len(), scan.ranges.len());
            assert!(directions.iter().all(|direction| direction.is_finite()), "scan {index}");
        }
        let last = scan.geometry.angle(scan.geometry.beams - 1);
        assert!(scan.geometry.start_angle.is_finite() && last.is_finite(), "scan {index}");
        assert!(scan.map_from_laser.is_none_or(|pose| pose.is_finite()), "scan {index}");
        assert!(scan.odometry.is_none_or(|pose| pose.is_finite()), "scan {index}");
        assert!(scan.stamp.is_none_or(|stamp| stamp.nanoseconds() >= 0), "scan {index}");
    }
    assert!(recording.path_length_m().is_finite());
    assert!(recording.duration_s().is_finite());
    if recording.has_reference() {
        let points = recording.points(10.0).expect("every scan has a reference pose");
        assert!(points.iter().flatten().all(|coordinate| coordinate.is_finite()));
        assert!(points.len() <= recording.readings());
    }
}

fn through_carmen(recording: &Recording) {
    let mut text = Vec::new();
    match carmen::write(recording, &["fuzzed"], &mut text) {
        Ok(()) => {}
        Err(WriteError::Io(error)) => panic!("writing to memory failed: {error}"),
        Err(_) => {
            assert!(text.is_empty(), "scans are checked before the first byte is written");
            return;
        }
    }
    let log = match carmen::read(text.as_slice(), "written.log", ReferencePoses::Auto) {
        Ok(log) => log,
        Err(error) => panic!("what was written as CARMEN cannot be read: {error}"),
    };
    is_whole(&log);
    let expect = |range: f64| if range.is_finite() { range } else { NO_RETURN };
    same(&log.recording, recording, expect, |angle| angle);
}

/// Nothing was lost; what the scans leave in doubt, such as stamps that repeat, they leave again.
fn is_whole(log: &Log) {
    assert!(log.report.skipped == 0 && log.report.truncated.is_none(), "{}", log.report);
}

fn through_a_bag(recording: &Recording) {
    let bytes = match bag::write(recording, Cursor::new(Vec::new())) {
        Ok(sink) => sink.into_inner(),
        Err(WriteBagError::Mcap(error)) => panic!("writing to memory failed: {error}"),
        Err(_) => return,
    };
    let log = match bag::read(&*bytes, &ReadOptions::default()) {
        Ok(log) => log,
        Err(error) => panic!("what was written as a bag cannot be read: {error}"),
    };
    is_whole(&log);
    let narrow = |value: f64| f64::from(value as f32);
    same(&log.recording, recording, narrow, narrow);
}

/// Whether a recording came back: stamps and readings to the bit, poses but for rounding.
fn same(
    found: &Recording,
    expected: &Recording,
    reading: impl Fn(f64) -> f64,
    angle: impl Fn(f64) -> f64,
) {
    let rounding = Rounding::of(expected);
    assert_eq!(found.scans.len(), expected.scans.len());
    rounding.close(Some(found.robot_from_laser), Some(expected.robot_from_laser), "mount");
    for (found, expected) in found.scans.iter().zip(&expected.scans) {
        assert_eq!(found.stamp, expected.stamp);
        let ScanGeometry { start_angle, angle_step, beams } = expected.geometry;
        let geometry =
            ScanGeometry { start_angle: angle(start_angle), angle_step: angle(angle_step), beams };
        assert_eq!(found.geometry, geometry);
        for (found, expected) in found.ranges.iter().zip(&expected.ranges) {
            let expected = reading(*expected);
            assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan());
        }
        rounding.close(found.map_from_laser, expected.map_from_laser, "reference");
        rounding.close(found.odometry, expected.odometry, "odometry");
    }
}

/// What composing poses may lose.
struct Rounding {
    metres: f64,
    radians: f64,
}

impl Rounding {
    /// Each composition rounds coordinates and headings in their last digits; an error of a heading
    /// acts at the end of the longest lever, and all of them add up along the log.
    fn of(recording: &Recording) -> Self {
        let poses = || {
            let of_scans =
                recording.scans.iter().flat_map(|scan| [scan.map_from_laser, scan.odometry]);
            of_scans.flatten().chain([recording.robot_from_laser])
        };
        let reach: f64 = 1.0 + poses().map(|pose| pose.x.abs() + pose.y.abs()).sum::<f64>();
        let turn = poses().map(|pose| pose.theta.abs()).fold(1.0, f64::max);
        let steps = 1.0 + recording.scans.len() as f64;
        let radians = 16.0 * f64::EPSILON * steps * turn;
        Rounding { metres: 4.0 * radians * reach, radians }
    }

    fn close(&self, found: Option<Pose2>, expected: Option<Pose2>, what: &str) {
        let (found, expected) = match (found, expected) {
            (Some(found), Some(expected)) => (found, expected),
            (found, expected) => {
                assert_eq!(found, expected, "{what}");
                return;
            }
        };
        let turn = wrap_angle(found.theta - expected.theta).abs();
        assert!(
            found.distance(&expected) <= self.metres && turn <= self.radians,
            "{what}: {found:?}, expected {expected:?} within {} m and {} rad",
            self.metres,
            self.radians
        );
    }
}
