//! Bags whose beams are not where the fields of their scans put them: lasers that are tilted, that move while they
//! measure, and clocks of scans that cannot be right.

use std::f64::consts::{PI, TAU};

use crate::bag_support::room::*;
use crate::bag_support::*;
use mcl_core::{Pose2, Trajectory};
use mcl_datasets::bag::types;
use mcl_datasets::bag::{self, WriteBagError};
use mcl_datasets::log::{LaserPose, Log, ReadOptions, ReferenceTrack};

/// A laser pitched forward, and what it sees of walls that are upright.
fn tilted(degrees: f64) -> Vec<Entry> {
    let pitch = degrees.to_radians();
    let (sin, cos) = (0.5 * pitch).sin_cos();
    let mounted = [0.0, 0.0, 0.2, 0.0, sin, 0.0, cos];
    let mut entries = usual();
    entries[0] = transform_on("/tf_static", START, "base_link", "laser", mounted);
    for found in entries.iter_mut().filter(|entry| entry.topic == "/scan") {
        let seconds = (found.log_time as i64 - START) as f64 / 1e9;
        let range = |beam: usize| {
            let angle = HALF_TURN.angle_min + beam as f64 * HALF_TURN.step;
            let level = [pitch.cos() * angle.cos(), angle.sin()];
            cast(path(seconds), level[1].atan2(level[0])) / level[0].hypot(level[1])
        };
        let ranges: Vec<f64> = (0..BEAMS).map(range).collect();
        let message = scan_message(at(seconds), "laser", HALF_TURN, &ranges);
        *found = entry("/scan", &types::LASER_SCAN, at(seconds), message);
    }
    entries
}

#[test]
fn the_beams_of_a_tilted_laser_are_projected_into_the_plane() {
    let log = read(&bag(&tilted(20.0)));
    assert!(worst(&log) < 1e-5, "{}", worst(&log));
    assert_eq!(log.report.doubts, [""; 0]);
    let assumptions = log.assumptions.join("\n");
    assert!(
        assumptions.contains("tilted by 20.0°") && assumptions.contains("projected"),
        "{assumptions}"
    );
    // Slightly tilted by accident: as it was, and not a word.
    let log = read(&bag(&tilted(2.0)));
    assert_eq!(log.assumptions, [""; 0]);
    assert!(log.recording.scans.iter().all(|scan| scan.sweep.directions.is_none()));
    assert!((1e-4..0.01).contains(&worst(&log)), "{}", worst(&log));
    assert_says(&refused(&bag(&tilted(40.0))), &["tilted by 40°"]);
    // Taken as level where that is asked for.
    let laser_pose = Some(LaserPose { robot_from_laser: Pose2::IDENTITY, roll: 0.0 });
    let level = ReadOptions { laser_pose, ..ReadOptions::default() };
    let log = bag::read(&*bag(&tilted(20.0)), &level).unwrap();
    assert!(worst(&log) > 0.2 && log.assumptions.is_empty(), "{}", worst(&log));
}

/// The mount that is asked for may be rolled, and is upside down at half a turn.
#[test]
fn a_requested_mount_may_be_rolled() {
    let rolled = |roll: f64| {
        let laser_pose = Some(LaserPose { robot_from_laser: MOUNT, roll });
        let options = ReadOptions { laser_pose, ..ReadOptions::default() };
        bag::read(&*bag(&usual()), &options)
    };
    let (level, down) = (rolled(0.0).unwrap(), rolled(PI).unwrap());
    let geometry = down.recording.scans[0].geometry;
    assert_eq!(geometry.start_angle, -level.recording.scans[0].geometry.start_angle);
    let tilted = rolled(0.2).unwrap();
    let scan = &tilted.recording.scans[0];
    assert!((scan.ranges[0] / level.recording.scans[0].ranges[0] - 0.2_f64.cos()).abs() < 1e-12);
    assert_says(&rolled(1.0).unwrap_err(), &["tilted by 57°"]);
}

const FULL_TURN: usize = 360;
/// A scanner of a full turn at 5 Hz.
const SPINNING: Fields = Fields {
    angle_min: -PI,
    angle_max: PI - TAU / FULL_TURN as f64,
    step: TAU / FULL_TURN as f64,
    range_max: 30.0,
    time_increment: 0.2 / FULL_TURN as f32,
};

/// The robot turns by a radian a second as it drives, and each beam is measured from where it is by then.
fn spinning(with: impl Fn(f64, Pose2) -> Vec<Entry>) -> Vec<Entry> {
    let place = |seconds: f64| {
        let Pose2 { x, y, theta } = path(seconds);
        Pose2::new(x, y, theta + seconds)
    };
    let mut entries = vec![mounted()];
    for k in 0..=100 {
        let seconds = f64::from(k) * 0.02;
        entries.extend(with(seconds, place(seconds)));
        if k % 10 != 0 {
            continue;
        }
        let beam = |i: usize| {
            let then = place(seconds + i as f64 * f64::from(SPINNING.time_increment));
            cast(then.compose(&MOUNT), SPINNING.angle_min + i as f64 * SPINNING.step)
        };
        let ranges: Vec<f64> = (0..FULL_TURN).map(beam).collect();
        let message = scan_message(at(seconds), "laser", SPINNING, &ranges);
        entries.push(entry("/scan", &types::LASER_SCAN, at(seconds), message));
    }
    entries
}

fn odometry_from_start(seconds: f64, place: Pose2) -> Entry {
    odometry_on("/odom", at(seconds), "base_link", path(0.0).between(&place))
}

fn usable(log: &Log, scan: usize) -> usize {
    log.recording.scans[scan].usable_beams(100.0)
}

#[test]
fn beams_are_placed_where_the_laser_was_when_they_were_measured() {
    let both = spinning(|seconds, place| {
        vec![odometry_from_start(seconds, place), pose_on("/ground_truth", at(seconds), place)]
    });
    let reference_alone =
        spinning(|seconds, place| vec![pose_on("/ground_truth", at(seconds), place)]);
    for (entries, by) in [(&both, "odometry"), (&reference_alone, "reference")] {
        let log = read(&bag(entries));
        assert!(worst(&log) < 1e-3, "{by}: {}", worst(&log));
        let notes = log.notes.join("\n");
        assert!(
            notes.contains("beams of 11 scans are placed") && notes.contains("0.199 s"),
            "{notes}"
        );
        // What comes after the last pose has no place.
        assert_eq!((usable(&log, 9), usable(&log, 10)), (FULL_TURN, 1));
        let assumptions = log.assumptions.join("\n");
        assert!(
            assumptions.contains("359 readings were measured at times for which neither"),
            "{assumptions}"
        );
        assert!(log.report.is_complete());
        assert!(log.recording.scans.iter().all(|scan| scan.sweep.time_increment == 0.0));
    }
    let options = ReadOptions { no_deskew: true, ..ReadOptions::default() };
    let log = bag::read(&*bag(&both), &options).unwrap();
    assert!(worst(&log) > 0.5, "{}", worst(&log));
    assert_eq!(log.assumptions, [""; 0]);
    assert!(log.notes.iter().any(|note| note.contains("measured at once, as requested")));
    // Written as they were measured, they come to the same; but the last, as the bag has no pose after it.
    let written = bag::write(&log.recording, std::io::Cursor::new(Vec::new())).unwrap();
    let mut again = read(written.get_ref());
    assert_eq!((usable(&again, 10), usable(&log, 10)), (FULL_TURN, FULL_TURN));
    again.recording.scans.truncate(10);
    assert!(worst(&again) < 0.02, "poses at the scans alone: {}", worst(&again));
    let placed = read(&bag(&both)).recording;
    let error = bag::write(&placed, std::io::Cursor::new(Vec::new())).unwrap_err();
    assert!(matches!(error, WriteBagError::Uneven { scan: 0 }), "{error}");
    assert!(error.to_string().contains("--no-deskew"), "{error}");
}

#[test]
fn unknown_motion_during_a_scan_is_reported() {
    let log = read(&bag(&spinning(|_, _| Vec::new())));
    let assumptions = log.assumptions.join("\n");
    assert!(
        assumptions.contains("for 11 of 11 neither odometry nor reference says how"),
        "{assumptions}"
    );
    assert_eq!(usable(&log, 10), FULL_TURN);
}

/// Milliseconds written as seconds.
#[test]
fn a_scan_that_takes_longer_than_the_next_is_in_doubt() {
    let mut entries = usual();
    for found in entries.iter_mut().filter(|entry| entry.topic == "/scan") {
        let seconds = (found.log_time as i64 - START) as f64 / 1e9;
        let fields = Fields { time_increment: 0.5, ..HALF_TURN };
        let ranges = seen(path(seconds).compose(&MOUNT), fields);
        let message = scan_message(at(seconds), "laser", fields, &ranges);
        *found = entry("/scan", &types::LASER_SCAN, at(seconds), message);
    }
    let log = read(&bag(&entries));
    assert_doubts(&log, &["a scan takes 90.000 s, but there is one every 0.200 s"]);
    assert!(worst(&log) < 1e-5, "{}", worst(&log));
}

/// Poses of a file of its own, of the robot, of the laser, and of a frame of the bag.
#[test]
fn a_reference_from_elsewhere_has_the_given_frame() {
    let mut entries = usual();
    entries.retain(|entry| entry.topic != "/ground_truth");
    let camera = Pose2::new(0.1, -0.2, 1.0);
    entries.push(edge("/tf_static", 0.0, ["base_link", "camera"], camera));
    let track = |mount: Pose2, frame: Option<&str>| ReferenceTrack {
        doubt: None,
        name: "truth.tum".to_owned(),
        trajectory: (0..=1000)
            .map(|k| f64::from(k) * 0.01)
            .map(|seconds| (stamp(at(seconds)), path(seconds).compose(&mount)))
            .collect::<Trajectory>(),
        frame: frame.map(str::to_owned),
    };
    for (mount, frame, asked, whose) in [
        (Pose2::IDENTITY, None, Some("robot"), "base_link"),
        (Pose2::IDENTITY, Some("laser"), Some("robot"), "base_link"),
        (MOUNT, None, Some("laser"), "laser"),
        (MOUNT, Some("laser"), None, "laser"),
        (camera, Some("camera"), None, "camera"),
    ] {
        let options = ReadOptions {
            reference_track: Some(track(mount, frame)),
            reference_frame: asked.map(str::to_owned),
            ..ReadOptions::default()
        };
        let log = bag::read(&*bag(&entries), &options).unwrap();
        assert_exact(&log);
        let used = format!("truth.tum, 1,001 poses, poses of {whose:?}");
        assert_eq!(log.reference, Some(used));
    }
    for (frame, doubt) in
        [(Some("tracker"), "frame \"tracker\""), (None, "does not say whose poses")]
    {
        let options = ReadOptions {
            reference_track: Some(track(Pose2::IDENTITY, frame)),
            ..ReadOptions::default()
        };
        assert_doubts(&bag::read(&*bag(&entries), &options).unwrap(), &[doubt]);
    }
}
