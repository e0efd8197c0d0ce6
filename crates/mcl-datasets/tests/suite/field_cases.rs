//! Bags as they occur: kinds that stop people, or that a reader gets wrong without a word. A robot drives
//! through a room whose walls are known, so that every point that is read can be held against them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::bag_support::room::*;
use crate::bag_support::*;
use mcl_core::Pose2;
use mcl_datasets::bag::types::{
    self, MULTI_ECHO_LASER_SCAN, MessageType, PATH, POINT_CLOUD2, POSE_WITH_COVARIANCE_STAMPED,
    TRANSFORM_STAMPED,
};
use mcl_datasets::bag::{self, Encoder, PoseRequest, PoseRole};
use mcl_datasets::log::{LaserPose, ReadOptions, ReferencePoses, TopicChoice};
use nalgebra::{UnitQuaternion, Vector3};

#[test]
fn the_usual_bag_is_exact() {
    assert_exact(&read(&bag(&usual())));
    let ros1 = ros1::ros1_bag(&usual(), ros1::ROS1);
    assert_eq!(read(&ros1).recording, read(&bag(&usual())).recording);
}

#[test]
fn directions_that_contradict_each_other_are_reported_and_degrees_refused() {
    let with = |fields: Fields, beams: usize| {
        let ranges = vec![2.0; beams];
        let message = scan_message(START, "laser", fields, &ranges);
        bag(&[entry("/scan", &types::LASER_SCAN, START, message)])
    };
    let full = |angle_max| Fields { angle_min: -PI, angle_max, step: TAU / 360.0, ..HALF_TURN };
    // A full turn whose last beam is counted as the first again, or not.
    for angle_max in [PI, PI - TAU / 360.0] {
        assert_eq!(read(&with(full(angle_max), 360)).report.doubts, [""; 0]);
    }
    let other_setting = Fields { step: 0.00827, ..full(PI) };
    assert_doubts(
        &read(&with(other_setting, 719)),
        &[
            "in 1 of 1 scans",
            "719 readings",
            "0.008270",
            "end at 2.7963 rad",
            "angle_max is 3.1416",
        ],
    );
    let wrong_sign = Fields { angle_min: FRAC_PI_2, angle_max: -FRAC_PI_2, ..HALF_TURN };
    assert_doubts(
        &read(&with(wrong_sign, BEAMS)),
        &["end at 4.7124 rad, but angle_max is -1.5708"],
    );
    let degrees = Fields { angle_min: 0.0, angle_max: 359.0, step: 1.0, ..HALF_TURN };
    let message = scan_message(START, "laser", degrees, &[2.0; 360]);
    let scan = entry("/scan", &types::LASER_SCAN, START, message);
    let error = refused(&bag(&vec![scan; 25]));
    assert_says(&error, &["57.1 turns", "in radians (are these degrees?)"]);
    assert_says(&error, &["message could be read from the bag", "25 skipped records", "24 more"]);
    assert_eq!(error.to_string().lines().count(), 4, "the same is said once: {error}");
}

#[test]
fn a_reading_of_range_max_is_not_a_measurement() {
    let capped = |none: f64| {
        let mut entries = vec![mounted()];
        let fields = Fields { range_max: 3.5, ..HALF_TURN };
        for k in 0..=30 {
            let seconds = f64::from(k) * 0.2;
            entries.push(truth_at(seconds));
            entries.push(odometry_at("/odom", seconds, "base_link"));
            let mut ranges = seen(path(seconds).compose(&MOUNT), fields);
            ranges.iter_mut().filter(|range| **range > 3.5).for_each(|range| *range = none);
            let message = scan_message(at(seconds), "laser", fields, &ranges);
            entries.push(entry("/scan", &types::LASER_SCAN, at(seconds), message));
        }
        read(&bag(&entries))
    };
    let (equal, infinite) = (capped(3.5), capped(f64::INFINITY));
    assert_exact(&equal);
    assert_eq!(equal.recording, infinite.recording);
    assert!(equal.notes.iter().any(|note| note.contains("readings equal range_max")));
}

/// Nav2's convention: the same names of frames, topics below the robot's name.
#[test]
fn of_two_robots_only_the_transforms_of_the_one_that_is_read_count() {
    let other = Pose2::new(0.1, 0.0, PI);
    for odometry_on_tf in [false, true] {
        let mut entries = vec![
            edge("/robot1/tf_static", 0.0, ["base_link", "laser"], MOUNT),
            edge("/robot2/tf_static", 0.0, ["base_link", "laser"], other),
        ];
        for k in 0..=100 {
            let seconds = f64::from(k) * 0.1;
            let moved = odometry_pose(2.0 * seconds);
            entries.push(edge("/robot2/tf", seconds, ["odom", "base_link"], moved));
            entries.push(edge(
                "/robot1/tf",
                seconds,
                ["odom", "base_link"],
                odometry_pose(seconds),
            ));
            entries.push(pose_on("/robot1/ground_truth", at(seconds), path(seconds)));
            if !odometry_on_tf {
                entries.push(odometry_at("/robot1/odom", seconds, "base_link"));
            }
            entries.push(scan_at("/robot1/scan", seconds, "laser"));
            entries.push(scan_on("/robot2/scan", at(seconds), &[1.0]));
        }
        let topics = TopicChoice { scan: Some("/robot1/scan".into()), ..TopicChoice::default() };
        let options = ReadOptions { topics, ..ReadOptions::default() };
        let log = bag::read(&*bag(&entries), &options).unwrap();
        assert_exact(&log);
        assert!(
            log.notes.iter().any(|note| note.contains("/robot2/tf, /robot2/tf_static are left"))
        );
    }
    // Two topics that contradict each other on one frame.
    let mut entries = usual();
    entries.push(edge("/tf", 0.0, ["mast", "laser"], other));
    assert_doubts(&read(&bag(&entries)), &["two topics contradict each other on laser"]);
}

#[test]
fn odometry_on_tf_alone_whatever_its_frames_are_called() {
    for [odometry, base, laser] in [
        ["robot1/odom", "robot1/base_footprint", "robot1/laser"],
        ["odom_combined", "base_footprint", "laser"],
        ["odom", "base", "laser"],
        ["world", "body", "laser"],
    ] {
        let mut entries = vec![edge("/tf_static", 0.0, [base, laser], MOUNT)];
        for k in 0..=100 {
            let seconds = f64::from(k) * 0.1;
            // The robot's place in the map moves as well, by what a localizer corrects.
            let drift = Pose2::new(0.02 * seconds, 0.0, 0.0);
            entries.push(edge("/tf", seconds, [odometry, base], odometry_pose(seconds)));
            entries.push(edge("/tf", seconds, ["map", odometry], drift));
            entries.push(truth_at(seconds));
            entries.push(scan_at("/scan", seconds, laser));
        }
        let log = read(&bag(&entries));
        assert_exact(&log);
        assert!(
            log.notes.iter().any(|note| note.contains(&format!("from {odometry:?} to {base:?}"))),
            "{:?}",
            log.notes
        );
    }
}

#[test]
fn time_that_jumps_back_begins_a_new_stretch() {
    let mut entries = usual();
    // The same ten seconds again, elsewhere on the path and off by some milliseconds.
    for k in 0..=100 {
        let seconds = f64::from(k) * 0.1;
        let later = |mut entry: Entry| {
            entry.log_time += 10_200_000_000;
            entry
        };
        let place = path(seconds + 20.0);
        let moved = path(0.0).between(&place);
        entries.push(later(odometry_on("/odom", at(seconds + 0.05), "base_link", moved)));
        entries.push(later(pose_on("/ground_truth", at(seconds + 0.05), place)));
        if k % 2 == 0 && k > 0 {
            let seconds = seconds + 0.05;
            let ranges = seen(path(seconds - 0.05 + 20.0).compose(&MOUNT), HALF_TURN);
            let message = scan_message(at(seconds), "laser", HALF_TURN, &ranges);
            entries.push(later(entry("/scan", &types::LASER_SCAN, at(seconds), message)));
        }
    }
    let log = read(&bag(&entries));
    assert_doubts(&log, &["time jumps back 1 time, /odom by 9.950 s from 1700000010.000000000 s"]);
    assert_eq!(log.recording.scans.len(), 101);
    assert!(worst(&log) < 1e-5, "{}", worst(&log));
    let without: Vec<usize> =
        (0..101).filter(|&index| log.recording.scans[index].odometry.is_none()).collect();
    assert_eq!(without, [0, 51], "unknown is what lies between the two");
}

#[test]
fn nothing_is_interpolated_over_a_gap() {
    let is_lost = |seconds: f64| seconds > 2.95 && seconds < 7.05;
    for (of, what) in [("/odom", "odometry"), ("/ground_truth", "reference")] {
        let mut entries = usual();
        entries.retain(|entry| {
            entry.topic != of || !is_lost((entry.log_time as i64 - START) as f64 / 1e9)
        });
        // Scans between the samples.
        for entry in entries.iter_mut().filter(|entry| entry.topic == "/scan") {
            let seconds = (entry.log_time as i64 - START) as f64 / 1e9 + 0.03;
            *entry = scan_at("/scan", seconds.min(10.0), "laser");
        }
        let log = read(&bag(&entries));
        let gap = format!("21 scans lie in 1 gap of the {what}, up to 4.2");
        let place = "s long (from 1700000002.9";
        assert_doubts(&log, &[&gap, place, "30 of 51 scans have it"]);
        let scans = &log.recording.scans;
        let has = |index: usize| match what {
            "odometry" => scans[index].odometry.is_some(),
            _ => scans[index].map_from_laser.is_some(),
        };
        assert!(has(14) && !has(16) && !has(34) && has(37));
        // Unless that is asked for.
        let options = ReadOptions { longest_gap: Some(5.0), ..ReadOptions::default() };
        let log = bag::read(&*bag(&entries), &options).unwrap();
        assert_eq!(log.assumptions, [""; 0]);
        assert!(log.recording.has_odometry() && log.recording.has_reference());
    }
}

#[test]
fn the_estimate_of_another_program_is_not_ground_truth() {
    for name in ["/amcl_pose", "/pose", "/slam_toolbox/pose", "/robot1/tracked_pose"] {
        let mut entries = usual();
        entries.retain(|entry| entry.topic != "/ground_truth");
        let mut message = Encoder::default();
        message.header(stamp(START), "map").pose(path(0.0)).f64s(&[0.0; 36]);
        entries.push(entry(name, &POSE_WITH_COVARIANCE_STAMPED, START, message));
        entries.push(pose_on("/current_goal", START, Pose2::IDENTITY));
        let log = read(&bag(&entries));
        assert!(log.recording.scans.iter().all(|scan| scan.map_from_laser.is_none()), "{name}");
        let note = format!("reference: none; --reference-topic could take {name} (an estimate)");
        assert!(log.notes.contains(&note), "{:?}", log.notes);
        assert_eq!(log.report.doubts, [""; 0]);
        let log = bag::read(&*bag(&entries), &with_reference(name)).unwrap();
        assert!(log.recording.scans[0].map_from_laser.is_some());
    }
}

/// Several transforms in one message, of which one is NaN or has no rotation.
#[test]
fn one_bad_transform_of_many_costs_that_one() {
    let of = |edges: &[(&str, &str, [f64; 7])]| {
        let mut message = Encoder::default();
        message.u32(edges.len() as u32);
        for (parent, child, parts) in edges {
            message.header(stamp(START), parent).text(child).f64s(parts);
        }
        message
    };
    let [i, j, k, w] = quaternion(MOUNT.theta);
    let laser = [MOUNT.x, MOUNT.y, 0.2, i, j, k, w];
    for bad in [[f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [0.0; 7]] {
        let mut entries = usual();
        let message =
            of(&[("base_link", "camera", bad), ("base_link", "laser", laser), ("a", "b", laser)]);
        entries[0] = entry("/tf_static", &types::TF_MESSAGE, START, message);
        let log = read(&bag(&entries));
        assert_exact(&log);
        assert_eq!(log.report.skipped, 1);
        let report = log.report.to_string();
        assert!(report.contains("transforms[0] (child \"camera\")."), "{report}");
    }
}

#[test]
fn odometry_of_a_frame_without_transforms() {
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(odometry_at("/velocity_control/odom", seconds, "odom_link"));
        entries.push(truth_at(seconds));
    }));
    let log = read(&bag(&entries));
    assert_doubts(
        &log,
        &["frame \"odom_link\"", "taken as those of \"base_link\"", "--base-frame"],
    );
    assert!(worst(&log) < 1e-5);
    let options =
        ReadOptions { base_frame: Some("base_link".to_owned()), ..ReadOptions::default() };
    assert_exact(&bag::read(&*bag(&entries), &options).unwrap());
}

#[test]
fn a_mount_without_transforms_can_be_given() {
    let entries = &usual()[1..];
    let log = read(&bag(entries));
    assert_doubts(&log, &["no transform says where it is", "--laser-pose X,Y,THETA"]);
    assert!(worst(&log) > 1.0);
    let laser_pose = Some(LaserPose { robot_from_laser: MOUNT, roll: 0.0 });
    let options = ReadOptions { laser_pose, ..ReadOptions::default() };
    assert_exact(&bag::read(&*bag(entries), &options).unwrap());
}

/// A base that follows the roll of the IMU by some tenths of a degree.
#[test]
fn a_base_that_sways_is_taken_as_it_is_at_each_scan() {
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(odometry_at("/odom", seconds, "base_footprint"));
        entries.push(truth_at(seconds));
        let roll = 0.5 * 0.3_f64.to_radians() * (3.0 * seconds).sin();
        let parts = [0.0, 0.0, 0.1, roll.sin(), 0.0, 0.0, roll.cos()];
        let swaying = transform_on("/tf", at(seconds), "base_footprint", "base_link", parts);
        entries.push(swaying);
    }));
    let log = read(&bag(&entries));
    assert!(log.notes.iter().any(|note| note.contains("the laser sways")), "{:?}", log.notes);
    assert!(worst(&log) < 1e-3, "{}", worst(&log));
    // One that turns on the robot is no such laser.
    for entry in entries.iter_mut().filter(|entry| entry.topic == "/tf") {
        let seconds = (entry.log_time as i64 - START) as f64 / 1e9;
        *entry =
            edge("/tf", seconds, ["base_footprint", "base_link"], Pose2::new(0.0, 0.0, seconds));
    }
    assert_says(&refused(&bag(&entries)), &["the mount of the laser is not fixed"]);
}

#[test]
fn of_several_echoes_the_first_counts() {
    let mut entries = usual();
    for found in entries.iter_mut().filter(|entry| entry.topic == "/scan") {
        let seconds = (found.log_time as i64 - START) as f64 / 1e9;
        let mut message = Encoder::default();
        message.header(stamp(at(seconds)), "laser");
        message.f32(-FRAC_PI_2 as f32).f32(FRAC_PI_2 as f32).f32((PI / 180.0) as f32);
        message.f32(0.0).f32(0.1).f32(0.05).f32(30.0).u32(BEAMS as u32);
        for (beam, range) in seen(path(seconds).compose(&MOUNT), HALF_TURN).iter().enumerate() {
            match beam % 10 {
                3 => message.u32(0),
                4 => message.u32(1).f32(*range as f32),
                _ => message.u32(2).f32(*range as f32).f32(29.0),
            };
        }
        message.u32(0);
        *found = entry("/horizontal_laser_2d", &MULTI_ECHO_LASER_SCAN, at(seconds), message);
    }
    for bytes in [bag(&entries), ros1::ros1_bag(&entries, ros1::ROS1)] {
        let log = read(&bytes);
        assert_exact(&log);
        assert!(log.recording.scans[0].ranges[3].is_infinite(), "no echo");
    }
}

/// The recorder did not find the packages of the messages.
#[test]
fn standard_types_are_read_without_a_description() {
    let mut entries = usual();
    let expected = read(&bag(&entries)).recording;
    entries.iter_mut().for_each(|entry| {
        entry.schema.1.clear();
        entry.schema.2.clear();
    });
    let log = read(&bag(&entries));
    assert_eq!(log.recording, expected);
    let notes = log.notes.iter().filter(|note| note.contains("read as the standard type"));
    assert_eq!(notes.count(), 4, "{:?}", log.notes);
}

fn without_reference(extra: impl Fn(f64, &mut Vec<Entry>)) -> Vec<Entry> {
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(odometry_at("/odom", seconds, "base_link"));
        extra(seconds, entries);
    }));
    entries
}

#[test]
fn ground_truth_of_other_types_and_names() {
    let transforms = without_reference(|seconds, entries| {
        let mut message = Encoder::default();
        let frame = "vicon/robot/robot";
        message.header(stamp(at(seconds)), "world").text(frame).pose(path(seconds));
        entries.push(entry("/vicon/robot/robot", &TRANSFORM_STAMPED, at(seconds), message));
    });
    let options = with_reference("/vicon/robot/robot");
    let log = bag::read(&*bag(&transforms), &options).unwrap();
    assert_doubts(
        &log,
        &["frame \"vicon/robot/robot\"", "those of \"base_link\"", "--reference-frame"],
    );
    assert!(worst(&log) < 1e-5);
    let options = ReadOptions { reference_frame: Some("robot".to_owned()), ..options };
    assert_exact(&bag::read(&*bag(&transforms), &options).unwrap());

    // A path that grows, with a first version of its newest pose that is corrected later.
    let growing = without_reference(|seconds, entries| {
        let tenths = (seconds * 10.0).round() as i64;
        if tenths % 10 != 0 {
            return;
        }
        let mut message = Encoder::default();
        message.header(stamp(at(seconds)), "map").u32(tenths as u32 + 1);
        for k in 0..=tenths {
            let when = k as f64 * 0.1;
            let off = if k == tenths && tenths < 100 { 0.5 } else { 0.0 };
            let Pose2 { x, y, theta } = path(when);
            message.header(stamp(at(when)), "").pose(Pose2::new(x + off, y, theta));
        }
        entries.push(entry("/ground_truth", &PATH, at(seconds), message));
    });
    assert_exact(&read(&bag(&growing)));

    let on_tf = without_reference(|seconds, entries| {
        entries.push(edge("/tf", seconds, ["map", "odom"], path(0.0)));
        entries.push(edge("/tf", seconds, ["odom", "base_link"], odometry_pose(seconds)));
    });
    let log = read(&bag(&on_tf));
    let expected = "reference: none; --reference-topic could take /tf:map.base_link";
    assert!(log.notes.iter().any(|note| note == expected), "{:?}", log.notes);
    let error = bag::read(&*bag(&on_tf), &ReferencePoses::Recorded.into()).unwrap_err();
    assert_says(&error, &["--reference-topic could take /tf:map.base_link; topics: "]);
    let options = with_reference("/tf:map.base_link");
    assert_exact(&bag::read(&*bag(&on_tf), &options).unwrap());
    let request =
        PoseRequest { topic: Some("/tf:map.laser"), ..PoseRequest::of(PoseRole::Reference) };
    let poses = bag::read_poses(&*bag(&on_tf), &request).unwrap();
    assert_eq!((poses.trajectory.len(), poses.frame.as_deref()), (101, Some("laser")));
    let error = bag::read(&*bag(&on_tf), &with_reference("/tf:map.camera")).unwrap_err();
    assert_says(&error, &["/tf:map.camera", "base_link, laser, map, odom"]);

    let other_name = without_reference(|seconds, entries| {
        let pose = path(seconds);
        entries.push(odometry_on("/odom_ground_truth", at(seconds), "base_link", pose));
    });
    let log = read(&bag(&other_name));
    assert!(log.notes.iter().any(|note| note.ends_with("could take /odom_ground_truth")));
    let options = with_reference("/odom_ground_truth");
    assert_exact(&bag::read(&*bag(&other_name), &options).unwrap());
}

#[test]
fn scans_of_another_clock_than_the_odometry() {
    let mut entries = usual();
    for found in entries.iter_mut().filter(|entry| entry.topic == "/scan") {
        let since = found.log_time as i64 - START;
        let message = scan_message(3_484 * SECOND + since, "laser", HALF_TURN, &[1.0; BEAMS]);
        *found = Entry { data: message.into_bytes(), ..found.clone() };
    }
    entries.retain(|entry| entry.topic != "/ground_truth");
    assert_doubts(
        &read(&bag(&entries)),
        &[
            "odometry: it lasts from 1700000000.000000000 s to 1700000010.",
            "3484.000000000 s to 3494.",
            "clocks",
        ],
    );
}

/// A robot with nothing but a 3-D lidar.
#[test]
fn a_slice_of_point_clouds_as_scans() {
    const LIDAR: &MessageType = &POINT_CLOUD2;
    let cloud = |seconds: f64, tilt: UnitQuaternion<f64>| {
        let lidar = path(seconds).compose(&MOUNT);
        let mut points: Vec<[f32; 3]> = Vec::new();
        for beam in 0..1440 {
            let angle = -PI + TAU * f64::from(beam) / 1440.0;
            let range = cast(lidar, angle);
            // The wall at three heights, and the floor and the ceiling nearer.
            for (height, part) in [(-0.2, 1.0), (0.1, 1.0), (1.0, 1.0), (-0.5, 0.5), (2.0, 0.3)] {
                let (sin, cos) = angle.sin_cos();
                let level = Vector3::new(part * range * cos, part * range * sin, height);
                let seen = tilt.inverse() * level;
                points.push([seen.x as f32, seen.y as f32, seen.z as f32]);
            }
        }
        let mut message = Encoder::default();
        message.header(stamp(at(seconds)), "lidar").u32(1).u32(points.len() as u32).u32(3);
        for (index, name) in ["x", "y", "z"].into_iter().enumerate() {
            message.text(name).u32(4 * index as u32).u8(7).u32(1);
        }
        let bytes = 12 * points.len() as u32;
        message.u8(0).u32(12).u32(bytes).u32(bytes);
        for value in points.iter().flatten() {
            message.bytes(&value.to_le_bytes());
        }
        message.u8(1);
        entry("/points", LIDAR, at(seconds), message)
    };
    let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, MOUNT.theta);
    // Level, upside down, tilted; and so far that a scan would be refused.
    let tilts = [[0.0, 0.0], [PI, 0.0], [0.1, 0.3], [PI - 0.1, -0.2], [0.0, 0.9]];
    let mut entries = Vec::new();
    for [roll, pitch] in tilts {
        let tilt = UnitQuaternion::from_euler_angles(roll, pitch, 0.0);
        let [i, j, k, w] = (turned * tilt).coords.into();
        let parts = [MOUNT.x, MOUNT.y, 0.5, i, j, k, w];
        entries = vec![transform_on("/tf_static", START, "base_link", "lidar", parts)];
        for tenth in 0..=5 {
            let seconds = f64::from(tenth) * 0.1;
            entries.push(odometry_at("/odom", seconds, "base_link"));
            entries.push(truth_at(seconds));
            entries.push(cloud(seconds, tilt));
        }
        let options = ReadOptions { slice: Some((0.2, 1.2)), ..ReadOptions::default() };
        let log = bag::read(&*bag(&entries), &options).unwrap();
        assert_eq!(log.recording.scans.len(), 6);
        assert_eq!(log.recording.scans[0].usable_beams(100.0), 1440);
        assert_exact(&log);
    }
    assert_says(&refused(&bag(&entries)), &["no sensor_msgs/msg/LaserScan", "--slice"]);
    // From the floor up, it is the nearest.
    let options = ReadOptions { slice: Some((-0.2, 1.2)), ..ReadOptions::default() };
    assert!(worst(&bag::read(&*bag(&entries), &options).unwrap()) > 1.0);
}
