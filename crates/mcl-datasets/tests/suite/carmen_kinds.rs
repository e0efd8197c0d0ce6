//! What the poses of a log mean, recognized by its content.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::support::*;
use mcl_core::Pose2;
use mcl_datasets::carmen;
use mcl_datasets::log::{LogKind, ReferencePoses};

#[test]
fn a_corrected_log_restarts_its_odometry_at_each_scan() {
    let expected = corrected();
    let log = read(&expected.text());
    assert_eq!(log.kind, LogKind::GfsCorrected);
    for (scan, pose) in log.recording.scans.iter().zip(expected.poses) {
        assert_eq!(scan.map_from_laser, Some(pose));
    }
    assert_eq!(log.recording.scans[0].odometry, None);
    for k in 0..3 {
        assert_close(log.recording.scans[k + 1].odometry, expected.raw[k], 1e-12);
    }
    assert!(log.recording.has_reference() && log.recording.has_odometry());
    assert_eq!(log.recording.robot_from_laser, Pose2::IDENTITY);
}

#[test]
fn restarts_are_recognized_by_position_whatever_their_stamp() {
    let plain = corrected().text();
    for stamp in ["0", "-1", "nan", "1.5", "99999999999999", "pippo"] {
        let log = read(&plain.replace("6.9e-310", stamp));
        assert_eq!(log.kind, LogKind::GfsCorrected, "{stamp}");
        assert_eq!(log.report.skipped, 0);
        assert_eq!(increments(&log), increments(&read(&plain)));
    }
}

#[test]
fn neff_records_prove_a_correction_without_any_odometry() {
    let text = scan(pose(1.0, 2.0, 0.5), 1) + "NEFF 30\n" + &scan(pose(2.0, 2.0, 0.5), 2);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::GfsCorrected);
    assert_eq!(log.report.ignored, 1);
    assert!(log.recording.has_reference());
    assert!(!log.recording.has_odometry());
    assert_eq!(increments(&log), [None, None]);
}

#[test]
fn a_gap_without_odometry_has_no_increment_and_the_others_keep_theirs() {
    let expected = corrected();
    let text = expected.scan(0)
        + &expected.gap(0)
        + &expected.scan(1)
        + &expected.scan(2)
        + &expected.gap(2)
        + &expected.scan(3);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::GfsCorrected);
    assert_close(log.recording.scans[1].odometry, expected.raw[0], 1e-12);
    assert_eq!(log.recording.scans[2].odometry, None);
    assert_close(log.recording.scans[3].odometry, expected.raw[2], 1e-12);
    assert!(!log.recording.has_odometry());
}

#[test]
fn raw_odometry_beside_corrected_poses_is_used() {
    let text = flaser(&[1.0; 361], pose(1.0, 1.0, 0.0), pose(0.0, 0.0, 0.0), 1)
        + &flaser(&[1.0; 361], pose(2.0, 1.0, FRAC_PI_2), pose(1.1, 0.0, FRAC_PI_2), 2)
        + &flaser(&[1.0; 361], pose(2.0, 3.0, FRAC_PI_2), pose(1.1, 1.9, FRAC_PI_2), 3);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::CorrectedWithOdometry);
    assert_eq!(log.recording.scans[2].map_from_laser, Some(pose(2.0, 3.0, FRAC_PI_2)));
    assert_close(log.recording.scans[1].odometry, pose(1.1, 0.0, FRAC_PI_2), 1e-12);
    assert_close(log.recording.scans[2].odometry, pose(1.9, 0.0, 0.0), 1e-12);

    // The laser swings around the robot's centre when that turns on the spot.
    let log = read(&format!("PARAM robot_frontlaser_offset 0.3 12.5 host 12.5\n{text}"));
    assert_eq!(log.front_laser_offset, Some(0.3));
    assert_eq!(log.recording.robot_from_laser, pose(0.3, 0.0, 0.0));
    // The robot: 1.1 m ahead, then 90° to the left. The laser: from (0.3, 0) to (1.1, 0.3).
    assert_close(log.recording.scans[1].odometry, pose(0.8, 0.3, FRAC_PI_2), 1e-12);
}

#[test]
fn corrected_poses_beside_zeros_have_no_odometry() {
    let text = flaser(&[1.0; 180], pose(1.0, 1.0, 0.0), ORIGIN, 1)
        + &flaser(&[1.0; 180], pose(2.0, 1.0, 0.0), ORIGIN, 2);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::CorrectedWithOdometry);
    assert!(log.recording.has_reference() && !log.recording.has_odometry());
}

#[test]
fn a_raw_log_has_no_reference_and_odometry_from_its_scans() {
    let poses = [ORIGIN, pose(1.0, 0.0, FRAC_PI_2), pose(1.0, 2.0, PI)];
    // ODOM lines go on through the scans, whose poses lie between those of the lines.
    let text = odom(ORIGIN)
        + &scan(poses[0], 1)
        + &odom(pose(0.4, 0.0, 0.1))
        + &odom(pose(0.9, 0.0, 1.5))
        + &scan(poses[1], 2)
        + &odom(pose(1.0, 0.1, FRAC_PI_2))
        + &odom(pose(1.0, 1.9, 3.0))
        + &scan(poses[2], 3);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert!(log.recording.scans.iter().all(|scan| scan.map_from_laser.is_none()));
    assert_close(log.recording.scans[1].odometry, pose(1.0, 0.0, FRAC_PI_2), 1e-12);
    assert_close(log.recording.scans[2].odometry, pose(2.0, 0.0, FRAC_PI_2), 1e-12);
}

#[test]
fn a_raw_log_whose_odometry_lines_follow_each_scan_is_not_taken_for_a_corrected_one() {
    // The first ODOM line after a scan repeats its pose, and the next scan differs from it.
    let poses = [ORIGIN, pose(1.0, 0.0, 0.2), pose(1.9, 0.1, 0.3), pose(3.0, 0.3, 0.1)];
    let text: String = poses.iter().map(|&pose| scan(pose, 1) + &odom(pose)).collect();
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert_close(log.recording.scans[1].odometry, poses[1], 1e-12);
}

#[test]
fn a_raw_log_of_a_robot_that_stops_for_each_scan_is_not_taken_for_a_corrected_one() {
    // ODOM lines begin and end at poses of scans, as after a restart; but no scan was moved.
    let poses = [ORIGIN, pose(1.0, 0.0, 0.2), pose(1.9, 0.1, 0.3)];
    let text = scan(poses[0], 1)
        + &odom(poses[0])
        + &odom(poses[1])
        + &scan(poses[1], 2)
        + &odom(poses[1])
        + &odom(poses[2])
        + &scan(poses[2], 3);
    assert_eq!(read(&text).kind, LogKind::Raw);
    // A name that says so settles what the content leaves open, and nothing else.
    let named = |name| carmen::read(text.as_bytes(), name, ReferencePoses::Auto).unwrap().kind;
    assert_eq!(named("walk.gfs.log.gz"), LogKind::GfsCorrected);
    assert_eq!(named("walk.log"), LogKind::Raw);
}

#[test]
fn a_name_does_not_overrule_odometry_that_goes_on_through_the_scans() {
    let text = scan(ORIGIN, 1)
        + &odom(pose(0.4, 0.0, 0.0))
        + &odom(pose(0.9, 0.0, 0.0))
        + &scan(pose(1.0, 0.0, 0.0), 2);
    let log = carmen::read(text.as_bytes(), "walk.gfs.log", ReferencePoses::Auto).unwrap();
    assert_eq!(log.kind, LogKind::Raw);
}

#[test]
fn a_constant_mount_is_found_in_rounded_poses() {
    let mount = pose(0.15, -0.05, 0.02);
    let rounded = |pose: Pose2| {
        let six_decimals = |value: f64| (value * 1e6).round() / 1e6;
        Pose2::new(six_decimals(pose.x), six_decimals(pose.y), six_decimals(pose.theta))
    };
    let text: String = (0..50)
        .map(|k| {
            let angle = 0.37 * f64::from(k);
            let robot = pose(40.0 * angle.cos(), 40.0 * angle.sin(), angle.rem_euclid(3.0));
            flaser(&[1.0; 180], rounded(robot.compose(&mount)), rounded(robot), k)
        })
        .collect();
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert_close(Some(log.recording.robot_from_laser), mount, 1e-6);
}

#[test]
fn a_wrong_digit_in_one_of_many_scans_does_not_change_the_kind_of_log() {
    let poses: Vec<Pose2> = (0..120).map(|k| pose(f64::from(k), 0.5, 0.0)).collect();
    let text: String = poses
        .iter()
        .enumerate()
        .map(|(k, place)| {
            let laser = if k == 0 { pose(4.0, 0.5, 0.0) } else { *place };
            let walked = pose(place.x + 0.9, 0.5, 0.0);
            flaser(&[1.0; 180], laser, *place, k) + &restart(*place) + &odom(walked)
        })
        .collect();
    let log = read(&text);
    assert_eq!(log.kind, LogKind::GfsCorrected);
    assert_eq!(log.recording.robot_from_laser, ORIGIN);
    for step in &increments(&log)[1..] {
        assert_close(*step, pose(0.9, 0.0, 0.0), 1e-12);
    }
}

#[test]
fn a_laser_that_looks_back_has_a_constant_mount() {
    // Headings of the mount come out on both sides of ±π.
    let mount = pose(-0.2, 0.0, PI);
    let text: String = (0..9)
        .map(|k| {
            let robot = pose(f64::from(k), 1.0, 0.7 * f64::from(k));
            let laser = robot.compose(&mount);
            let theta = laser.theta + if k % 2 == 0 { 1e-6 } else { -1e-6 };
            flaser(&[1.0; 180], Pose2 { theta, ..laser }, robot, k)
        })
        .collect();
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert_close(Some(log.recording.robot_from_laser), mount, 2e-6);
}

#[test]
fn a_mount_that_agrees_with_the_parameter_is_the_parameter() {
    let text = "PARAM robot_frontlaser_offset 0.3 host 0\n".to_owned()
        + &flaser(&[1.0; 180], pose(0.300_001, 0.0, 0.0), ORIGIN, 1)
        + &flaser(&[1.0; 180], pose(1.3, 0.000_001, 0.0), pose(1.0, 0.0, 0.0), 2);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert_eq!(log.recording.robot_from_laser, pose(0.3, 0.0, 0.0));
}

#[test]
fn a_robot_that_stands_still_throughout_is_raw_with_odometry() {
    let place = pose(1.0, 2.0, 3.0);
    let gap = odom(place) + &odom(place);
    let log = read(&[scan(place, 1), gap.clone(), scan(place, 2), gap, scan(place, 3)].concat());
    assert_eq!(log.kind, LogKind::Raw);
    assert_eq!(increments(&log), [None, Some(ORIGIN), Some(ORIGIN)]);
}

#[test]
fn zero_poses_are_odometry_only_where_odom_lines_say_so() {
    let text = scan(ORIGIN, 1) + &scan(ORIGIN, 2);
    assert_eq!(increments(&read(&text)), [None, None]);
    assert_eq!(increments(&read(&(odom(ORIGIN) + &text))), [None, Some(ORIGIN)]);
}

#[test]
fn a_single_scan_is_a_log() {
    let place = pose(1.0, 2.0, 3.0);
    let log = read(&scan(place, 1));
    assert_eq!((log.kind, log.recording.scans.len()), (LogKind::Raw, 1));
    assert!(!log.recording.has_reference() && !log.recording.has_odometry());
    let log = read_as(&scan(place, 1), ReferencePoses::Recorded);
    assert_eq!(log.recording.scans[0].map_from_laser, Some(place));
}

#[test]
fn recorded_poses_are_reference_when_asked_and_their_copies_no_odometry() {
    let text = scan(pose(1.0, 0.0, 0.0), 1) + &scan(pose(2.0, 0.0, 0.0), 2);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert!(log.recording.has_odometry() && !log.recording.has_reference());

    let log = read_as(&text, ReferencePoses::Recorded);
    assert_eq!(log.kind, LogKind::GfsCorrected);
    assert!(log.recording.has_reference() && !log.recording.has_odometry());
}

#[test]
fn recorded_poses_beside_odometry_that_never_restarts_use_it_as_it_goes_on() {
    let log = read_as(
        &[
            odom(pose(7.0, 0.0, FRAC_PI_2)),
            scan(pose(1.0, 0.0, 0.0), 1),
            odom(pose(7.0, 0.5, FRAC_PI_2)),
            odom(pose(7.0, 1.0, FRAC_PI_2)),
            scan(pose(2.0, 0.0, 0.0), 2),
            scan(pose(3.0, 0.0, 0.0), 3),
        ]
        .concat(),
        ReferencePoses::Recorded,
    );
    assert_close(log.recording.scans[1].odometry, pose(1.0, 0.0, 0.0), 1e-12);
    assert_eq!(log.recording.scans[2].odometry, None);
}

#[test]
fn references_can_be_withheld_and_odometry_stays() {
    let text = corrected().text();
    let log = read_as(&text, ReferencePoses::None);
    assert!(log.recording.scans.iter().all(|scan| scan.map_from_laser.is_none()));
    assert_eq!(increments(&log), increments(&read(&text)));
}

#[test]
fn the_choice_of_reference_has_the_same_name_everywhere() {
    for choice in [ReferencePoses::Auto, ReferencePoses::Recorded, ReferencePoses::None] {
        let name = choice.to_string();
        assert_eq!(name.parse::<ReferencePoses>().unwrap(), choice);
        assert_eq!(serde_json::to_string(&choice).unwrap(), format!("{name:?}"));
    }
    let error = "maybe".parse::<ReferencePoses>().unwrap_err().to_string();
    assert!(error.contains("`maybe`") && error.contains("recorded"), "{error}");
}
