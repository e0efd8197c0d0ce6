//! Bags whose names, axes or fields do not say what is meant.

use crate::bag_support::room::*;
use crate::bag_support::*;
use mcl_core::Stamp;
use mcl_datasets::bag::types::{LASER_SCAN, POSE_STAMPED};
use mcl_datasets::bag::{self, Encoder};
use mcl_datasets::log::{Log, ReadOptions};

/// The usual bag, with its poses on another topic.
fn with_poses_on(topic: &'static str) -> Log {
    let mut entries = usual();
    entries.iter_mut().filter(|e| e.topic == "/ground_truth").for_each(|e| e.topic = topic);
    read(&bag(&entries))
}

#[test]
fn estimates_of_other_programs_are_not_ground_truth() {
    for topic in [
        "/robot1/pose",
        "/amcl/pose",
        "/beluga_amcl/pose",
        "/emcl2/pose",
        "/slam/pose",
        "/ndt_pose",
        "/ekf_pose",
        "/robot_pose",
        "/pf/viz/inferred_pose",
        "/current_pose",
        "/rtabmap/localization_pose",
    ] {
        let log = with_poses_on(topic);
        assert!(!log.recording.has_reference(), "{topic}");
        let possible = format!("could take {topic} (an estimate)");
        assert!(log.notes.iter().any(|note| note.contains(&possible)), "{topic}: {:?}", log.notes);
    }
    for topic in
        ["/ground_truth/pose", "/vrpn_client_node/robot/pose", "/mocap/pose", "/gt", "/GroundTruth"]
    {
        let log = with_poses_on(topic);
        assert_exact(&log);
        assert_eq!(log.assumptions, [""; 0], "{topic}");
    }
    // What no name says is assumed, and reported.
    let log = with_poses_on("/tower");
    assert_exact(&log);
    assert!(log.assumptions[0].contains("/tower is the only topic of poses"));
}

#[test]
fn messages_without_a_stamp_are_counted() {
    for (topic, what) in [("/odom", "odometry"), ("/ground_truth", "reference")] {
        let mut entries = usual();
        entries.iter_mut().filter(|entry| entry.topic == topic).for_each(|entry| {
            entry.data[4..12].fill(0);
        });
        let log = read(&bag(&entries));
        assert_exact(&log);
        let expected = format!("{what}: 101 of 101 messages have no stamp in their header");
        assert!(log.assumptions[0].contains(&expected), "{:?}", log.assumptions);
    }
}

#[test]
fn a_requested_frame_must_exist() {
    let refused = |options: ReadOptions| bag::read(&*bag(&usual()), &options).unwrap_err();
    let nope = || Some("nope".to_owned());
    let error = refused(ReadOptions { odometry_frame: nope(), ..ReadOptions::default() });
    assert_says(&error, &["no frame \"nope\"", "--odom-frame", "base_link, laser"]);
    let error = refused(ReadOptions { reference_frame: nope(), ..ReadOptions::default() });
    assert_says(&error, &["no frame \"nope\"", "--reference-frame", "base_link, laser"]);
}

#[test]
fn the_time_between_beams_and_that_of_a_turn_contradict_each_other() {
    let with = |time_increment: f32, scan_time: f32| {
        let ranges = seen(path(0.0), HALF_TURN);
        let mut scans = vec![mounted()];
        for k in 0..5 {
            let time = at(0.2 * f64::from(k));
            let fields = Fields { time_increment, ..HALF_TURN };
            let mut message = scan_message(time, "laser", fields, &ranges).into_bytes();
            // Header with the frame, then angle_min, angle_max, angle_increment and time_increment.
            let place = 4 + 8 + 4 + "laser\0".len();
            let place = 4 + (place - 4).next_multiple_of(4) + 16;
            message[place..place + 4].copy_from_slice(&scan_time.to_le_bytes());
            let mut scan = entry("/scan", &LASER_SCAN, time, Encoder::default());
            scan.data = message;
            scans.push(scan);
        }
        read(&bag(&scans)).report.doubts
    };
    // Half a turn takes half the time of one.
    assert_eq!(with(0.05 / 180.0, 0.1), [""; 0]);
    assert_eq!(with(0.05 / 180.0, 0.0), [""; 0]);
    for scan_time in [0.01, 1.0] {
        let doubts = with(0.05 / 180.0, scan_time);
        assert!(doubts[0].contains("in 5 of 5 scans the times contradict"), "{doubts:?}");
        assert!(doubts[0].contains("takes 0.0500 s"), "{doubts:?}");
    }
}

/// Motion capture with y upwards: x, y and z are those of x, z and −y.
#[test]
fn a_reference_with_another_axis_upwards_is_in_doubt() {
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(odometry_at("/odom", seconds, "base_link"));
        let pose = path(seconds);
        let (sin, cos) = (0.5 * pose.theta).sin_cos();
        let mut message = Encoder::default();
        message.header(Stamp::from_nanoseconds(at(seconds)), "map");
        message.f64s(&[pose.x, 0.0, -pose.y, 0.0, sin, 0.0, cos]);
        entries.push(entry("/ground_truth", &POSE_STAMPED, at(seconds), message));
    }));
    let log = read(&bag(&entries));
    assert_doubts(
        &log,
        &["reference: /ground_truth: ", " of 101 poses are tilted by more than 10°"],
    );
    assert_doubts(&log, &["heights vary by ", "does an axis other than z point upwards?"]);
}
