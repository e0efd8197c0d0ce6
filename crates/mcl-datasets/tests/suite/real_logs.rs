//! Facts about the public logs. Each is ignored where `MCL_DATA_DIR` does not hold its log.

use std::path::PathBuf;

use mcl_core::{Bounds, Pose2, Recording};
use mcl_datasets::carmen;
use mcl_datasets::log::{Log, LogKind, ReferencePoses, read_log};

fn real_log(name: &str) -> Log {
    let folder = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let log = read_log(&PathBuf::from(folder).join(name)).unwrap();
    assert!(log.report.is_complete(), "{}", log.report);
    assert_eq!(log.report.unusable_stamps, 0);
    assert_eq!(log.kind, LogKind::GfsCorrected);
    assert_eq!(log.recording.robot_from_laser, Pose2::IDENTITY);
    assert!(log.recording.has_reference() && log.recording.has_odometry());
    log
}

/// Root mean square translation (m) and rotation (rad) by which the odometry of a step misses the
/// reference.
fn odometry_error(recording: &Recording) -> (f64, f64) {
    let (mut translation, mut rotation) = (0.0, 0.0);
    for pair in recording.scans.windows(2) {
        let before = pair[0].map_from_laser.unwrap();
        let step = before.between(&pair[1].map_from_laser.unwrap());
        let error = step.between(&pair[1].odometry.unwrap());
        translation += error.x * error.x + error.y * error.y;
        rotation += error.theta * error.theta;
    }
    let steps = (recording.scans.len() - 1) as f64;
    ((translation / steps).sqrt(), (rotation / steps).sqrt())
}

/// Counts scans, beams per scan, and points up to 10 m.
fn assert_counts(log: &Log, scans: usize, beams: usize, points: usize) {
    let recording = &log.recording;
    assert_eq!(recording.scans.len(), scans);
    assert!(recording.scans.iter().all(|scan| scan.ranges.len() == beams));
    assert_eq!(recording.readings(), scans * beams);
    assert_eq!(recording.points(10.0).unwrap().len(), points);
    assert_eq!(log.report.ignored, scans, "one NEFF record per scan");
}

/// The path lengths and odometry errors below were also computed by another program, which reads
/// the text of the logs on its own.
#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn intel_research_lab() {
    let log = real_log("intel-lab/intel.gfs.log");
    assert_counts(&log, 910, 180, 155_648);
    let recording = &log.recording;
    assert_eq!(recording.backward_stamps(), 4);
    assert!((recording.path_length_m() - 499.543_208_4).abs() < 1e-6);
    let bounds = Bounds::of(&recording.points(10.0).unwrap()).unwrap();
    assert_eq!((bounds.extent(0).round(), bounds.extent(1).round()), (29.0, 29.0));
    let (translation, rotation) = odometry_error(recording);
    assert!((translation - 0.066_698_7).abs() < 1e-6, "{translation}");
    assert!((rotation.to_degrees() - 3.504_507_4).abs() < 1e-6, "{}", rotation.to_degrees());
    assert_eq!(recording.scans[0].stamp.unwrap().nanoseconds(), 32_906_800_000);
    let exactly_ten = recording.scans.iter().flat_map(|scan| &scan.ranges);
    assert_eq!(exactly_ten.filter(|&&range| range == 10.0).count(), 4);
}

#[test]
#[cfg_attr(not(real_data = "freiburg-079"), ignore = "needs freiburg-079 in MCL_DATA_DIR")]
fn freiburg_building_079() {
    let log = real_log("freiburg-079/freiburg-079-corrected.log.gz");
    assert_counts(&log, 4_791, 360, 1_654_968);
    assert_eq!(log.recording.readings(), 1_724_760);
    assert!((log.recording.path_length_m() - 422.471_159_9).abs() < 1e-6);
    let (translation, rotation) = odometry_error(&log.recording);
    assert!((translation - 0.044_749_0).abs() < 1e-6, "{translation}");
    assert!((rotation.to_degrees() - 1.573_334_4).abs() < 1e-6);
}

#[test]
#[cfg_attr(not(real_data = "aces"), ignore = "needs aces in MCL_DATA_DIR")]
fn aces_building() {
    let log = real_log("aces/aces-corrected.log.gz");
    assert_counts(&log, 440, 180, 73_195);
    assert_eq!(log.recording.readings(), 79_200);
    assert_eq!(log.front_laser_offset, Some(0.0));
    assert!((log.recording.path_length_m() - 323.156_118_9).abs() < 1e-6);
}

#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn a_real_log_survives_writing_and_reading() {
    let log = real_log("intel-lab/intel.gfs.log");
    let mut text = Vec::new();
    carmen::write(&log.recording, &["copy"], &mut text).unwrap();
    let copy = carmen::read(text.as_slice(), "copy.log", ReferencePoses::Auto).unwrap();
    assert_eq!(copy.kind, log.kind);
    for (copied, scan) in copy.recording.scans.iter().zip(&log.recording.scans) {
        assert_eq!(copied.stamp, scan.stamp);
        assert_eq!(copied.ranges, scan.ranges);
        assert_eq!(copied.geometry, scan.geometry);
        assert_eq!(copied.map_from_laser, scan.map_from_laser);
    }
    for (copied, scan) in copy.recording.scans.iter().zip(&log.recording.scans).skip(1) {
        let error = scan.odometry.unwrap().between(&copied.odometry.unwrap());
        assert!(error.x.hypot(error.y) < 1e-12 && error.theta.abs() < 1e-12);
    }
}

/// Numbers of scans, of beams, of points up to 10 m, and of steps whose odometry is missing.
#[test]
#[cfg_attr(
    not(all(
        real_data = "freiburg-101",
        real_data = "seattle",
        real_data = "csail",
        real_data = "orebro"
    )),
    ignore = "needs freiburg-101, seattle, csail and orebro in MCL_DATA_DIR"
)]
fn further_corrected_logs() {
    let folder = PathBuf::from(std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set"));
    for (name, scans, beams, points, lost) in [
        ("freiburg-101", 292, 360, 74_278, 0),
        ("seattle", 241, 361, 83_892, 1),
        ("csail", 406, 361, 138_174, 0),
        ("orebro", 237, 181, 39_670, 219),
    ] {
        let path = folder.join(name).join(format!("{name}-corrected.log.gz"));
        let log = read_log(&path).unwrap();
        assert_eq!((log.report.skipped, &log.report.truncated), (0, &None), "{name}");
        assert_eq!(log.kind, LogKind::GfsCorrected, "{name}");
        assert_counts(&log, scans, beams, points);
        let without = log.recording.scans[1..].iter().filter(|scan| scan.odometry.is_none());
        assert_eq!(without.count(), lost, "{name}");
        let doubts: Vec<&str> = match name {
            "csail" | "orebro" => vec!["share their stamp with another"],
            _ => vec![],
        };
        assert_eq!(log.report.doubts.len(), doubts.len(), "{name}: {}", log.report);
        let pairs = log.report.doubts.iter().zip(doubts);
        assert!(
            pairs.into_iter().all(|(found, part)| found.contains(part)),
            "{name}: {}",
            log.report
        );
    }
}
