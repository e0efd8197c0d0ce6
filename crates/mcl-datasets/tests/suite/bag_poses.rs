//! Topics of poses as trajectories.

use crate::bag_support;
use std::f64::consts::FRAC_PI_2;

use crate::bag_support::{
    SECOND, assert_pose, assert_says, bag, entry, odometry_on, pose_on, scan_on, stamp,
    transform_on, walk,
};
use mcl_core::Pose2;
use mcl_datasets::bag::types::{PATH, POSE_STAMPED, POSE_WITH_COVARIANCE_STAMPED};
use mcl_datasets::bag::{Encoder, PoseRequest, PoseRole, PoseTopic, read_poses};

fn at(x: f64) -> Pose2 {
    Pose2::new(x, 0.0, 0.0)
}

fn poses(entries: &[bag_support::Entry], topic: Option<&str>, role: PoseRole) -> PoseTopic {
    read_poses(&*bag(entries), &PoseRequest { topic, ..PoseRequest::of(role) }).unwrap()
}

#[test]
fn poses_keep_their_own_stamps_and_the_mount_is_reported() {
    let mut entries = walk(3);
    entries.push(pose_on("/amcl", 2 * SECOND + 7, at(1.5)));
    let odometry = poses(&entries, Some("/odom"), PoseRole::Estimate);
    assert_eq!((odometry.name.as_str(), odometry.trajectory.len()), ("/odom", 4));
    assert_eq!(odometry.trajectory.stamps()[0].nanoseconds(), SECOND / 2);
    assert_eq!(odometry.trajectory.poses()[3], at(3.5));
    assert_eq!(odometry.frame.as_deref(), Some("base_link"));
    assert_pose(odometry.frame_from_laser, 0.2, 0.0, FRAC_PI_2);
    // A topic that does not say whose poses it holds: those of the frame of the odometry.
    let estimate = poses(&entries, Some("/amcl"), PoseRole::Estimate);
    assert_eq!(estimate.trajectory.stamps()[0].nanoseconds(), 2 * SECOND + 7);
    assert_eq!(estimate.frame.as_deref(), Some("base_link"));
    assert_pose(estimate.frame_from_laser, 0.2, 0.0, FRAC_PI_2);
}

#[test]
fn a_topic_is_found_by_its_role_or_requested() {
    let mut entries = walk(2);
    entries.push(pose_on("/ground_truth", SECOND, at(1.0)));
    entries.push(pose_on("/goal_pose", SECOND, at(9.0)));
    assert_eq!(poses(&entries, None, PoseRole::Reference).name, "/ground_truth");
    assert_eq!(poses(&entries, None, PoseRole::Estimate).name, "/odom");
    assert_eq!(poses(&entries, Some("/goal_pose"), PoseRole::Estimate).name, "/goal_pose");
    entries.push(pose_on("/amcl", SECOND, at(1.0)));
    let refused = |topic, role| {
        let request = PoseRequest { topic, ..PoseRequest::of(role) };
        read_poses(&*bag(&entries), &request).unwrap_err()
    };
    let several = refused(None, PoseRole::Estimate);
    assert_says(&several, &["/amcl", "/odom", "choose one with --topic"]);
    assert_says(&refused(Some("/pose"), PoseRole::Estimate), &["no topic /pose", "--topic"]);
    assert_says(&refused(Some("/scan"), PoseRole::Reference), &["LaserScan", "--reference-topic"]);
    let none = read_poses(&*bag(&walk(2)), &PoseRequest::of(PoseRole::Reference)).unwrap_err();
    assert_says(&none, &["no such poses", "--reference-topic", "/odom (nav_msgs/msg/Odometry"]);
}

#[test]
fn a_bag_without_a_single_laser_has_no_mount() {
    let only = [odometry_on("/odom", SECOND, "base_link", at(1.0))];
    let found = poses(&only, None, PoseRole::Estimate);
    assert_eq!((found.trajectory.len(), found.frame_from_laser), (1, None));
    let mut two = walk(2);
    two.push(scan_on("/scan_rear", SECOND, &[1.0, 2.0, 3.0]));
    assert_eq!(poses(&two, None, PoseRole::Estimate).frame_from_laser, None);
}

/// map → odom lags by half a metre and turns by 90°, odom → base_link drives.
fn localized(n: i64) -> Vec<bag_support::Entry> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let mut entries = walk(n);
    for second in 0..=n {
        let at = second * SECOND;
        let drift = [0.5, 0.0, 0.0, 0.0, 0.0, half, half];
        let driven = [second as f64, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        entries.push(transform_on("/tf", at, "map", "odom", drift));
        entries.push(transform_on("/tf", at, "odom", "base_link", driven));
    }
    entries
}

/// Field case: some localizers publish only transforms, and nothing could evaluate their bags.
#[test]
fn transforms_alone_are_poses_of_the_robot_in_the_map() {
    let all: Vec<_> = localized(4).into_iter().filter(|entry| entry.topic != "/odom").collect();
    for topic in [None, Some("/tf"), Some("/tf:map.base_link")] {
        let found = poses(&all, topic, PoseRole::Estimate);
        assert_eq!(found.name, "/tf:map.base_link");
        assert_eq!(
            (found.parent.as_deref(), found.frame.as_deref()),
            (Some("map"), Some("base_link"))
        );
        assert_eq!(found.trajectory.len(), 5);
        assert_pose(Some(found.trajectory.poses()[3]), 0.5, 3.0, FRAC_PI_2);
        assert_pose(found.mounts.get("laser").copied(), 0.2, 0.0, FRAC_PI_2);
    }
    // Two robots: which is meant, nothing says.
    let still = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut two = all.clone();
    two.push(transform_on("/tf", 0, "map", "other/base_link", still));
    let refused = read_poses(&*bag(&two), &PoseRequest::of(PoseRole::Estimate)).unwrap_err();
    assert_says(&refused, &["/tf:map.base_link", "/tf:map.other/base_link", "frames: "]);
}

#[test]
fn a_path_is_found_without_a_request() {
    let mut message = Encoder::default();
    message.header(stamp(2 * SECOND), "map").u32(2);
    message.header(stamp(SECOND), "").pose(at(1.0)).header(stamp(2 * SECOND), "").pose(at(2.0));
    let only = [entry("/path", &PATH, 2 * SECOND, message)];
    let found = poses(&only, None, PoseRole::Estimate);
    assert_eq!((found.name.as_str(), found.trajectory.len()), ("/path", 2));
    assert_eq!(found.parent.as_deref(), Some("map"));
}

/// Field case: poses in "odom" were compared with poses in "map" without a word.
#[test]
fn poses_are_carried_into_a_frame_that_transforms_lead_to() {
    let mut entries = localized(4);
    let halves = (0..5).map(|second| second * SECOND + SECOND / 2);
    entries.extend(halves.map(|at| {
        let mut message = Encoder::default();
        message.header(stamp(at), "odom").pose(Pose2::new(at as f64 / 1e9, 0.0, 0.0));
        entry("/fused", &POSE_STAMPED, at, message)
    }));
    let request =
        |into| PoseRequest { topic: Some("/fused"), role: PoseRole::Estimate, into: Some(into) };
    let found = read_poses(&*bag(&entries), &request("map")).unwrap();
    assert_eq!(
        (found.parent.as_deref(), found.carried_from.as_deref()),
        (Some("map"), Some("odom"))
    );
    // Poses come at every half second up to 4.5 s; transforms end at 4 s, and nothing is extrapolated.
    let last = found.trajectory.len() - 1;
    assert_eq!(found.trajectory.stamps()[last].nanoseconds(), 7 * SECOND / 2);
    assert_pose(Some(found.trajectory.poses()[last]), 0.5, 3.5, FRAC_PI_2);
    assert!(found.report.to_string().contains("1 of 5 poses are left out"), "{}", found.report);
    let as_they_stand = read_poses(&*bag(&entries), &request("world")).unwrap();
    assert_eq!((as_they_stand.parent.as_deref(), as_they_stand.carried_from), (Some("odom"), None));
    let odometry = PoseRequest { topic: Some("/odom"), ..request("map") };
    assert_eq!(read_poses(&*bag(&entries), &odometry).unwrap().parent.as_deref(), Some("odom"));
}

#[test]
fn covariances_turn_with_the_frame() {
    let mut covariance = [0.0; 36];
    (covariance[0], covariance[7], covariance[35], covariance[5]) = (0.04, 0.01, 0.09, 0.02);
    covariance[30] = 0.02;
    let with = |topic, covariance: &[f64]| {
        let mut message = Encoder::default();
        message.header(stamp(SECOND), "odom").pose(at(1.0)).f64s(covariance);
        entry(topic, &POSE_WITH_COVARIANCE_STAMPED, SECOND, message)
    };
    let mut entries = localized(2);
    entries.push(with("/filtered", &covariance));
    entries.push(with("/unknown", &[0.0; 36]));
    let of = |topic, into| {
        let request = PoseRequest { topic: Some(topic), role: PoseRole::Estimate, into };
        read_poses(&*bag(&entries), &request).unwrap().covariances
    };
    let as_it_stands = of("/filtered", None)[0].unwrap();
    assert_eq!(as_it_stands, [[0.04, 0.0, 0.02], [0.0, 0.01, 0.0], [0.02, 0.0, 0.09]]);
    let carried = of("/filtered", Some("map"))[0].unwrap();
    let expected = [[0.01, 0.0, 0.0], [0.0, 0.04, 0.02], [0.0, 0.02, 0.09]];
    for (found, expected) in carried.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-15, "{carried:?}");
    }
    // Zeros, as writers leave them that know none.
    assert!(of("/unknown", None).is_empty());
}
