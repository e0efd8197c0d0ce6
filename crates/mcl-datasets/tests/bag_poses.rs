//! Topics of poses as trajectories.

mod bag_support;

use std::f64::consts::FRAC_PI_2;

use bag_support::{SECOND, assert_pose, assert_says, bag, odometry_on, pose_on, scan_on, walk};
use mcl_core::Pose2;
use mcl_datasets::bag::{PoseRole, PoseTopic, read_poses};

fn at(x: f64) -> Pose2 {
    Pose2::new(x, 0.0, 0.0)
}

fn poses(entries: &[bag_support::Entry], topic: Option<&str>, role: PoseRole) -> PoseTopic {
    read_poses(&*bag(entries), topic, role).unwrap()
}

#[test]
fn poses_keep_their_own_stamps_and_the_mount_is_told() {
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
fn a_topic_is_found_by_its_role_or_asked_for() {
    let mut entries = walk(2);
    entries.push(pose_on("/ground_truth", SECOND, at(1.0)));
    entries.push(pose_on("/goal_pose", SECOND, at(9.0)));
    assert_eq!(poses(&entries, None, PoseRole::Reference).name, "/ground_truth");
    assert_eq!(poses(&entries, None, PoseRole::Estimate).name, "/odom");
    assert_eq!(poses(&entries, Some("/goal_pose"), PoseRole::Estimate).name, "/goal_pose");
    entries.push(pose_on("/amcl", SECOND, at(1.0)));
    let refused = |topic, role| read_poses(&*bag(&entries), topic, role).unwrap_err();
    let several = refused(None, PoseRole::Estimate);
    assert_says(&several, &["/amcl", "/odom", "choose one with --topic"]);
    assert_says(&refused(Some("/pose"), PoseRole::Estimate), &["no topic /pose", "--topic"]);
    assert_says(&refused(Some("/scan"), PoseRole::Reference), &["LaserScan", "--reference-topic"]);
    let none = read_poses(&*bag(&walk(2)), None, PoseRole::Reference).unwrap_err();
    assert_says(&none, &["no such poses", "--reference-topic", "/odom (nav_msgs/msg/Odometry"]);
}

#[test]
fn a_bag_without_one_laser_says_no_mount() {
    let only = [odometry_on("/odom", SECOND, "base_link", at(1.0))];
    let found = poses(&only, None, PoseRole::Estimate);
    assert_eq!((found.trajectory.len(), found.frame_from_laser), (1, None));
    let mut two = walk(2);
    two.push(scan_on("/scan_rear", SECOND, &[1.0, 2.0, 3.0]));
    assert_eq!(poses(&two, None, PoseRole::Estimate).frame_from_laser, None);
}
