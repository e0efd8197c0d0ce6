//! Bags whose transforms contradict each other, or have a frame move in several others.

use crate::bag_support::room::*;
use crate::bag_support::*;
use mcl_core::Pose2;
use mcl_datasets::bag;
use mcl_datasets::log::ReadOptions;

const OTHER: Pose2 = Pose2::new(0.25, 0.05, 0.0);

/// In either order, and whichever of the two is right.
#[test]
fn contradicting_mounts_of_two_topics_are_reported() {
    for (fixed, moving) in [(MOUNT, OTHER), (OTHER, MOUNT)] {
        for is_first in [true, false] {
            let mut entries = usual();
            entries[0] = edge("/tf_static", 0.0, ["base_link", "laser"], fixed);
            let others =
                (0..100).map(|k| edge("/tf", f64::from(k) * 0.1, ["base_link", "laser"], moving));
            match is_first {
                true => entries.splice(0..0, others).for_each(drop),
                false => entries.extend(others),
            }
            let log = read(&bag(&entries));
            assert_doubts(
                &log,
                &["contradict each other on laser", "/tf has it 0.400 m and 90.0°"],
            );
            assert_eq!(worst(&log) < 1e-5, fixed == MOUNT, "that of /tf_static counts");
        }
    }
    // The same on both is none.
    let mut entries = usual();
    entries.push(edge("/tf", 0.0, ["base_link", "laser"], MOUNT));
    assert_exact(&read(&bag(&entries)));
}

/// A motion capture system publishes the robot's place beside the odometry.
#[test]
fn a_robot_that_moves_in_two_frames_has_a_track_in_each() {
    for world in ["world", "vicon", "map"] {
        for is_first in [true, false] {
            let mut entries = vec![mounted()];
            entries.extend(drive(|seconds, entries| {
                let odometry = edge("/tf", seconds, ["odom", "base_link"], odometry_pose(seconds));
                let truth = edge("/tf", seconds, [world, "base_link"], path(seconds));
                entries.extend(if is_first { [truth, odometry] } else { [odometry, truth] });
            }));
            let pair = format!("/tf:{world}.base_link");
            let log = bag::read(&*bag(&entries), &with_reference(&pair)).unwrap();
            assert_exact(&log);
            let log = read(&bag(&entries));
            assert!(log.recording.has_odometry() && !log.recording.has_reference());
            let notes = log.notes.join("\n");
            for part in [
                format!("\"base_link\" moves in \"odom\" and also in {world:?} on /tf"),
                "101 transforms from \"odom\"".to_owned(),
                format!("could take {pair}"),
            ] {
                assert!(notes.contains(&part), "{part}: {notes}");
            }
        }
    }
    // Where no name says which is the odometry, that is in doubt; and it can be said.
    let mut entries = vec![mounted()];
    entries.extend(drive(|seconds, entries| {
        entries.push(edge("/tf", seconds, ["here", "base_link"], odometry_pose(seconds)));
        entries.push(edge("/tf", seconds, ["there", "base_link"], path(seconds)));
    }));
    assert_doubts(&read(&bag(&entries)), &["\"base_link\" moves in", "--odom-frame NAME"]);
    for frame in ["here", "there"] {
        let odometry_frame = Some(frame.to_owned());
        let options = ReadOptions { odometry_frame, ..with_reference("/tf:there.base_link") };
        let log = bag::read(&*bag(&entries), &options).unwrap();
        assert!(worst(&log) < 1e-5 && log.recording.has_odometry());
    }
}
