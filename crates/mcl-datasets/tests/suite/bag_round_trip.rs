//! What is written as a bag is read back, to the last bit that a bag can hold.

use std::f64::consts::FRAC_PI_2;
use std::io::Cursor;
use std::path::PathBuf;

use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry, Seed, Stamp, wrap_angle};
use mcl_datasets::bag::{self, Format, WriteBagError};
use mcl_datasets::log::{ReadOptions, read_log};
use mcl_datasets::simulator::{OfficeSettings, simulate};

fn written(recording: &Recording) -> Vec<u8> {
    bag::write(recording, Cursor::new(Vec::new())).unwrap().into_inner()
}

/// Stamps are what they were.
fn of_stamps(doubt: &str) -> bool {
    doubt.contains("share their stamp")
}

fn round_trip(recording: &Recording) -> Recording {
    let bytes = written(recording);
    assert_eq!(bytes, written(recording), "the same bytes each time");
    let log = bag::read(&*bytes, &ReadOptions::default()).unwrap();
    assert!(log.report.doubts.iter().all(|doubt| of_stamps(doubt)), "{}", log.report);
    assert_eq!((log.report.skipped, &log.report.truncated), (0, &None), "{}", log.report);
    log.recording
}

fn assert_close(found: Option<Pose2>, expected: Option<Pose2>, tolerance: f64) {
    match (found, expected) {
        (Some(found), Some(expected)) => {
            let turn = wrap_angle(found.theta - expected.theta).abs();
            assert!(
                found.distance(&expected) <= tolerance && turn <= tolerance,
                "{found:?}, expected {expected:?}"
            );
        }
        (found, expected) => assert_eq!(found, expected),
    }
}

fn assert_same(found: &Recording, expected: &Recording, tolerance: f64) {
    let narrow = |value: f64| f64::from(value as f32);
    assert_eq!(found.scans.len(), expected.scans.len());
    assert_close(Some(found.robot_from_laser), Some(expected.robot_from_laser), 1e-15);
    for (found, expected) in found.scans.iter().zip(&expected.scans) {
        assert_eq!(found.stamp, expected.stamp);
        let ranges: Vec<f64> = expected.ranges.iter().map(|&range| narrow(range)).collect();
        assert_eq!(found.ranges, ranges);
        let ScanGeometry { start_angle, angle_step, beams } = expected.geometry;
        let (start_angle, angle_step) = (narrow(start_angle), narrow(angle_step));
        assert_eq!(found.geometry, ScanGeometry { start_angle, angle_step, beams });
        assert_close(found.map_from_laser, expected.map_from_laser, tolerance);
        assert_close(found.odometry, expected.odometry, tolerance);
    }
}

#[test]
fn the_simulated_office() {
    let recording = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
    let found = round_trip(&recording);
    assert_same(&found, &recording, 1e-12);
    assert!(found.has_reference() && found.has_odometry());
}

/// What is written in each format says the same.
fn assert_all_formats(recording: &Recording) {
    let expected = round_trip(recording);
    for format in [Format::Ros1, Format::Database] {
        let write = || {
            bag::write_as(recording, format, Cursor::new(Vec::new()))
                .map(Cursor::into_inner)
                .unwrap()
        };
        let bytes = write();
        assert_eq!(bytes, write(), "{format:?}: the same bytes each time");
        let log = bag::read(&*bytes, &ReadOptions::default()).unwrap();
        assert!(
            log.report.doubts.iter().all(|doubt| of_stamps(doubt)),
            "{format:?}: {}",
            log.report
        );
        assert_eq!(log.report.ignored, 0, "{format:?}");
        assert_same(&log.recording, &expected, 0.0);
    }
}

#[test]
fn every_format_holds_the_same_recording() {
    let settings = OfficeSettings::default();
    let mut recording = simulate(&settings, Seed::new(1)).unwrap();
    assert_all_formats(&recording);
    // Time between beams, and no reference.
    for scan in &mut recording.scans {
        scan.sweep.time_increment = f64::from(1e-4_f32);
        scan.map_from_laser = None;
    }
    let bytes = bag::write_as(&recording, Format::Ros1, Cursor::new(Vec::new())).unwrap();
    let options = ReadOptions { no_deskew: true, ..ReadOptions::default() };
    let found = bag::read(bytes.get_ref().as_slice(), &options).unwrap().recording;
    assert_same(&found, &recording, 1e-12);
    assert_eq!(found.scans[7].sweep, recording.scans[7].sweep);
}

/// They were refused, or read back in another order, but for MCAP.
#[test]
fn bags_of_any_format_keep_the_order_of_scans_whose_stamps_go_back() {
    let recording = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
    let shifted = |from: usize, by: i64| {
        let mut changed = recording.clone();
        for scan in &mut changed.scans[from..] {
            let stamp = scan.stamp.unwrap().nanoseconds();
            scan.stamp = Some(Stamp::from_nanoseconds(stamp + by));
        }
        changed
    };
    let interval = |recording: &Recording| {
        let stamp = |k: usize| recording.scans[k].stamp.unwrap().nanoseconds();
        stamp(1) - stamp(0)
    };
    // Over the same times again by some intervals, and far back.
    for back in [3 * interval(&recording), 20 * SECOND] {
        let changed = shifted(40, -back);
        assert_eq!(changed.backward_stamps(), 1);
        assert_all_formats(&changed);
    }
    let mut changed = recording.clone();
    changed.scans[7].stamp = None;
    changed.scans[9].stamp = Some(Stamp::from_nanoseconds(0));
    changed.scans[11].stamp = Some(Stamp::from_nanoseconds(1));
    assert_all_formats(&changed);
    // One that says the same as the one before, at the same time.
    changed.scans[20] = changed.scans[19].clone();
    assert_all_formats(&changed);
}

/// Numbers of scans are of use for these scans alone.
#[test]
fn lists_of_scans_are_not_used_for_other_scans() {
    let scans = (0..20).map(|k| scan(Some(k * SECOND / 10), 0.1 * k as f64)).collect();
    let mut recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
    recording.scans[12].odometry = None;
    let bytes = bag::write_as(&recording, Format::Database, Cursor::new(Vec::new())).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.db3");
    std::fs::write(&path, bytes.into_inner()).unwrap();
    let database = rusqlite::Connection::open(&path).unwrap();
    database.execute_batch("DELETE FROM messages WHERE id BETWEEN 4 AND 30;").unwrap();
    database.close().unwrap();
    let log = read_log(&path).unwrap();
    assert!(log.recording.scans.len() < 20);
    let doubt = &log.report.doubts[0];
    assert!(doubt.contains("lists 20 scans") && doubt.contains("another program"), "{doubt}");
}

#[test]
#[cfg_attr(
    not(all(real_data = "intel-lab", real_data = "aces")),
    ignore = "needs intel-lab and aces in MCL_DATA_DIR"
)]
fn the_real_logs() {
    let folder = PathBuf::from(std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set"));
    // Intel's stamps step back four times.
    for name in ["intel-lab/intel.gfs.log", "aces/aces-corrected.log.gz"] {
        let log = read_log(&folder.join(name)).unwrap();
        let found = round_trip(&log.recording);
        assert_same(&found, &log.recording, 1e-12);
        assert_eq!(found.backward_stamps(), log.recording.backward_stamps());
        assert_all_formats(&log.recording);
    }
}

fn scan(stamp: Option<i64>, x: f64) -> LaserScan {
    LaserScan {
        stamp: stamp.map(Stamp::from_nanoseconds),
        geometry: ScanGeometry { start_angle: -FRAC_PI_2, angle_step: 0.1, beams: 3 },
        ranges: vec![x, f64::INFINITY, 81.83],
        map_from_laser: Some(Pose2::new(x, -x, 0.5 * x)),
        odometry: Some(Pose2::new(0.5, 0.1 * x, 0.25)),
        sweep: Default::default(),
    }
}

#[test]
fn stamps_that_repeat_step_back_or_are_missing() {
    let stamps = [None, Some(0), Some(7), Some(7), None, Some(3), Some(7), None, Some(0), Some(90)];
    let mut scans: Vec<LaserScan> =
        stamps.iter().enumerate().map(|(k, &stamp)| scan(stamp, k as f64)).collect();
    scans[0].odometry = None;
    let robot_from_laser = Pose2::new(0.2, 0.1, 0.3);
    let recording = Recording { scans, robot_from_laser };
    assert_same(&round_trip(&recording), &recording, 1e-12);
    assert_all_formats(&recording);
    for part in ["reference", "odometry", "both"] {
        let mut without = recording.clone();
        for scan in &mut without.scans {
            if part != "odometry" {
                scan.map_from_laser = None;
            }
            if part != "reference" {
                scan.odometry = None;
            }
        }
        assert_same(&round_trip(&without), &without, 1e-12);
    }
}

#[test]
fn what_a_bag_cannot_hold_is_refused_with_the_scan() {
    let mut base = Recording {
        scans: (0..4).map(|k| scan(Some(k * 1000), k as f64)).collect(),
        robot_from_laser: Pose2::IDENTITY,
    };
    base.scans[0].odometry = None;
    let error = |change: &dyn Fn(&mut Recording)| {
        let mut recording = base.clone();
        change(&mut recording);
        bag::write(&recording, Cursor::new(Vec::new())).unwrap_err()
    };
    let late = Stamp::from_nanoseconds((1 << 31) * 1_000_000_000);
    let found = error(&|recording| recording.scans[2].stamp = Some(late));
    assert!(found.to_string().contains("scan 2 has the stamp 2147483648.000000000 s"), "{found}");
    for nanoseconds in [-1, i64::MIN] {
        let stamp = Some(Stamp::from_nanoseconds(nanoseconds));
        let found = error(&|recording| recording.scans[1].stamp = stamp);
        assert!(matches!(found, WriteBagError::Stamp { scan: 1, .. }), "{found}");
    }
    // What readers of other bags fill in is listed.
    let gap = |scan: usize, change: &dyn Fn(&mut LaserScan)| {
        let mut recording = base.clone();
        change(&mut recording.scans[scan]);
        assert_same(&round_trip(&recording), &recording, 1e-12);
        assert_all_formats(&recording);
    };
    gap(2, &|scan| scan.odometry = None);
    gap(1, &|scan| scan.map_from_laser = None);
    let found = error(&|recording| recording.scans.clear());
    assert!(matches!(found, WriteBagError::NoScan));
    let found = error(&|recording| recording.scans[3].ranges.clear());
    assert!(matches!(found, WriteBagError::Readings { scan: 3, .. }), "{found}");
    // The last second of 32 bits is one.
    let mut recording = base.clone();
    let last = Stamp::from_nanoseconds(((1 << 31) - 1) * 1_000_000_000 + 999_999_999);
    recording.scans[3].stamp = Some(last);
    assert_same(&round_trip(&recording), &recording, 1e-12);
}

#[test]
fn the_bag_names_its_frames_and_describes_its_messages() {
    let recording = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
    let bytes = written(&recording);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let scans = recording.scans.len() as u64;
    assert_eq!(summary.stats.unwrap().message_count, 4 * scans + 1);
    assert!(!summary.chunk_indexes.is_empty());
    assert!(summary.chunk_indexes.iter().all(|chunk| chunk.compression == "zstd"));
    let mut topics: Vec<&str> = summary.channels.values().map(|c| c.topic.as_str()).collect();
    topics.sort_unstable();
    assert_eq!(topics, ["/odom", "/reference", "/scan", "/tf", "/tf_static"]);
    // Players go by these times.
    let times: Vec<u64> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.unwrap().log_time)
        .collect();
    assert!(times.is_sorted());
}

/// Found by fuzzing: of two scans of one time, only the first with odometry, both came back with it.
#[test]
fn a_scan_without_odometry_at_the_time_of_one_with_it_is_listed() {
    let at = [0, 1_000, 2_000, 2_000];
    let scans = at.iter().enumerate().map(|(k, &at)| scan(Some(at), k as f64)).collect();
    let mut recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
    recording.scans[0].odometry = None;
    recording.scans[3].odometry = None;
    let is_kept = |recording: &Recording| {
        assert_same(&round_trip(recording), recording, 1e-12);
        assert_all_formats(recording);
    };
    is_kept(&recording);
    // Later, nothing is filled in.
    recording.scans[3].stamp = Some(Stamp::from_nanoseconds(3_000));
    assert_same(&round_trip(&recording), &recording, 1e-12);
    // Back in time, between two scans with a reference pose.
    recording.scans[3].stamp = Some(Stamp::from_nanoseconds(500));
    recording.scans[3].map_from_laser = None;
    is_kept(&recording);
}

/// As in Örebro, where most steps are unknown and all stamps are one; and as behind a gap of the reference.
#[test]
fn unknown_steps_stay_unknown() {
    let stamps: [fn(i64) -> i64; 2] = [|k| k * 1_000_000, |_| 7];
    for stamp in stamps {
        let scans = (0..40).map(|k| scan(Some(stamp(k)), 0.1 * k as f64)).collect();
        let mut recording = Recording { scans, robot_from_laser: Pose2::new(0.2, 0.0, 0.1) };
        for (k, scan) in recording.scans.iter_mut().enumerate() {
            scan.odometry = scan.odometry.filter(|_| k % 7 == 3 || k % 7 == 4);
        }
        assert_same(&round_trip(&recording), &recording, 1e-12);
        assert_all_formats(&recording);
        if stamp(1) != stamp(2) {
            for scan in &mut recording.scans[10..20] {
                scan.map_from_laser = None;
            }
            assert_same(&round_trip(&recording), &recording, 1e-12);
        }
    }
}

/// Nothing follows them by which all of their beams could be placed, so readings would be lost.
#[test]
fn the_last_scans_are_written_as_measured_at_once() {
    let scans = (0..9).map(|k| scan(Some(k * SECOND / 5), 1.0 + 0.1 * k as f64)).collect();
    let mut recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
    recording.scans[0].odometry = None;
    for scan in &mut recording.scans {
        scan.sweep.time_increment = 0.125;
    }
    let log = bag::read(&*written(&recording), &ReadOptions::default()).unwrap();
    let usable = |recording: &Recording| -> Vec<usize> {
        recording.scans.iter().map(|scan| scan.usable_beams(100.0)).collect()
    };
    assert_eq!(usable(&log.recording), usable(&recording));
    assert!(log.report.is_complete() && log.assumptions == [""; 0], "{:?}", log.assumptions);
    assert!(log.notes.iter().any(|note| note.contains("beams of 7 scans are placed")));
}

const SECOND: i64 = 1_000_000_000;

/// Found while writing its fuzz target: the written bag held messages that its reader skips.
#[test]
fn poses_and_beams_that_readers_refuse_are_not_written() {
    let refused = |change: &dyn Fn(&mut Recording)| {
        let scans = (0..3).map(|k| scan(Some(k * 1_000), k as f64)).collect();
        let mut recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
        recording.scans[0].odometry = None;
        change(&mut recording);
        let found = bag::write(&recording, Cursor::new(Vec::new())).unwrap_err();
        assert!(matches!(found, WriteBagError::OutOfRange { .. }), "{found}");
        found.to_string()
    };
    let far = Pose2::new(9e8, 0.0, 0.0);
    let message =
        refused(&|recording| recording.scans[1].map_from_laser = Some(Pose2::new(2e9, 0.0, 0.0)));
    assert!(message.starts_with("scan 1: the pose of the robot"), "{message}");
    // Each step is in range, their sum is not.
    let message = refused(&|recording| {
        recording.scans.iter_mut().skip(1).for_each(|scan| scan.odometry = Some(far));
    });
    assert!(message.starts_with("scan 2: the pose of the robot"), "{message}");
    refused(&|recording| recording.robot_from_laser = Pose2::new(0.0, -2e9, 0.0));
    refused(&|recording| recording.scans[2].geometry.start_angle = 1e300);
    let message = refused(&|recording| recording.scans[2].geometry.angle_step = 1e-300);
    assert!(message.contains("32-bit floats"), "{message}");
}
