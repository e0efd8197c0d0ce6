//! Bags whose stamps repeat, jump, or belong to other poses.

use crate::bag_support::room::*;
use crate::bag_support::*;
use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_datasets::bag;
use mcl_datasets::bag::types::LASER_SCAN;
use mcl_datasets::log::{Log, ReadOptions, ReferenceTrack};

/// The usual bag, with the stamps of a topic changed; the times of logging stay.
fn stamped(topic: &str, change: impl Fn(f64) -> f64) -> Vec<Entry> {
    let mut entries = usual();
    for entry in entries.iter_mut().filter(|entry| entry.topic == topic) {
        let seconds = (entry.log_time as i64 - START) as f64 / 1e9;
        let stamp = at(change((seconds * 10.0).round() / 10.0));
        let [sec, nanosec] = [stamp / SECOND, stamp % SECOND];
        entry.data[4..8].copy_from_slice(&(sec as i32).to_le_bytes());
        entry.data[8..12].copy_from_slice(&(nanosec as u32).to_le_bytes());
    }
    entries
}

fn placed(log: &Log) -> usize {
    log.recording.scans.iter().filter(|scan| scan.map_from_laser.is_some()).count()
}

#[test]
fn stamps_that_scans_share_pair_them_with_nothing() {
    let one = read(&bag(&stamped("/scan", |_| 3.0)));
    assert_doubts(&one, &["51 of 51 scans share their stamp", "1 different stamp", "51 times"]);
    assert_doubts(&one, &["odometry: stamps do not say which of its poses belongs to 51 of 51"]);
    assert!(!one.recording.has_odometry() && placed(&one) == 0);
    // Cut to seconds: not even the last scan, which stands alone.
    let cut = read(&bag(&stamped("/scan", f64::floor)));
    assert_doubts(&cut, &["50 of 51 scans share", "11 different stamps"]);
    assert!(!cut.recording.has_odometry() && placed(&cut) == 0);
    let all = read(&ros1::ros1_bag(&stamped("/scan", f64::floor), ros1::ROS1));
    assert_eq!(all.recording, cut.recording);
}

#[test]
fn stamps_that_poses_share_place_no_scan() {
    for (topic, what) in [("/ground_truth", "reference"), ("/odom", "odometry")] {
        let log = read(&bag(&stamped(topic, f64::floor)));
        let doubt = format!("{what}: stamps do not say which of its poses belongs to 51 of 51");
        assert_doubts(
            &log,
            &[&doubt, "100 of its 101 poses share their stamp with another", " m and "],
        );
        let is_reference = topic == "/ground_truth";
        assert_eq!((placed(&log) == 0, log.recording.has_odometry()), (is_reference, is_reference));
    }
}

#[test]
fn a_few_scans_that_share_a_stamp_have_no_pose_and_the_others_theirs() {
    let log = read(&bag(&stamped("/scan", |at| if at == 4.0 { 4.2 } else { at })));
    assert_doubts(&log, &["2 of 51 scans share", "reference: stamps do not say", "to 2 of 51"]);
    assert_eq!(placed(&log), 49);
    let mut without = log.clone();
    without.recording.scans.retain(|scan| scan.map_from_laser.is_some());
    assert!(worst(&without) < 1e-5);
}

#[test]
fn a_message_that_comes_twice_counts_once() {
    let twice: Vec<Entry> = usual().into_iter().flat_map(|entry| [entry.clone(), entry]).collect();
    let log = read(&bag(&twice));
    assert_exact(&log);
    assert_eq!(log.recording, read(&bag(&usual())).recording);
    assert!(
        log.assumptions[0].contains("51 of 102 messages repeat another"),
        "{:?}",
        log.assumptions
    );
}

/// Drives, and then drives on with a clock that was set back.
fn set_back(seconds: f64) -> Vec<Entry> {
    let mut entries = vec![mounted()];
    for k in 0..=100 {
        let true_time = f64::from(k) * 0.1;
        let stamp = if k > 50 { true_time - seconds - 0.1 } else { true_time };
        let restart = if k > 50 { 5.1 } else { 0.0 };
        let moved = path(restart).between(&path(true_time));
        entries.push(odometry_on("/odom", at(stamp), "base_link", moved));
        entries.push(pose_on("/ground_truth", at(stamp), path(true_time)));
        if k % 2 == 0 || k == 51 {
            let ranges = seen(path(true_time).compose(&MOUNT), HALF_TURN);
            let message = scan_message(at(stamp), "laser", HALF_TURN, &ranges);
            entries.push(entry("/scan", &LASER_SCAN, at(stamp), message));
        }
    }
    entries
}

#[test]
fn a_clock_set_back_a_little_begins_a_new_stretch() {
    for seconds in [0.15, 0.35, 0.5, 0.9, 1.0, 1.1, 4.0] {
        let log = read(&bag(&set_back(seconds)));
        assert_doubts(&log, &["time jumps back 1 time", &format!("by {seconds:.3} s")]);
        assert!(worst(&log) < 1e-5, "{seconds}: {}", worst(&log));
        let known = log.recording.scans.iter().filter(|scan| scan.odometry.is_some()).count();
        assert_eq!((placed(&log), known), (52, 50), "{seconds}: no step leads over the jump");
    }
    // What is out of order is no jump.
    let mut entries = usual();
    let of_scans: Vec<usize> =
        (0..entries.len()).filter(|&index| entries[index].topic == "/scan").collect();
    for index in [10, 20, 30] {
        entries.swap(of_scans[index], of_scans[index + 1]);
        entries.swap(of_scans[index] - 1, of_scans[index + 1] - 1);
    }
    let log = read(&bag(&entries));
    assert_eq!(log.report.doubts, [""; 0]);
    assert!(worst(&log) < 1e-5 && placed(&log) == 51);
}

#[test]
fn a_reference_that_ends_early_is_a_loss() {
    let mut entries = usual();
    entries.retain(|entry| entry.topic != "/ground_truth" || (entry.log_time as i64) < at(4.05));
    let log = read(&bag(&entries));
    assert_doubts(&log, &["30 scans lie before the first or after the last reference message"]);
    assert_eq!(placed(&log), 21);
}

#[test]
fn a_file_of_poses_that_goes_over_the_same_time_again_belongs_to_as_many_stretches() {
    let poses = |times: &mut dyn Iterator<Item = (f64, f64)>| -> Trajectory {
        times.map(|(stamp, truly)| (Stamp::from_nanoseconds(at(stamp)), path(truly))).collect()
    };
    let reading = |entries: &[Entry], trajectory: Trajectory| {
        let frame = Some("base_link".into());
        let track = ReferenceTrack { name: "truth.tum".into(), trajectory, frame, doubt: None };
        let options = ReadOptions { reference_track: Some(track), ..ReadOptions::default() };
        bag::read(&*bag(entries), &options).unwrap()
    };
    let tenths = || (0..=100).map(|k| f64::from(k) * 0.1);
    let set_back_by =
        |seconds: f64| move |t: f64| (if t > 5.05 { t - seconds - 0.1 } else { t }, t);
    let twice = || poses(&mut tenths().map(set_back_by(0.5)));
    let log = reading(&set_back(0.5), twice());
    assert!(worst(&log) < 1e-5 && placed(&log) == 52);
    let log = reading(&usual(), twice());
    assert_doubts(
        &log,
        &["reference: time jumps back 1 time in truth.tum", "and 0 times in the scans"],
    );
    assert_eq!((placed(&log), &log.reference), (0, &None));
    let once = poses(&mut tenths().map(|t| (t, t)));
    assert_exact(&reading(&usual(), once));
    assert_ne!(path(1.0), Pose2::IDENTITY);
}
