//! Single records: geometry, stamps, what is ignored, what is malformed and what that costs.

use std::f64::consts::FRAC_PI_2;

use crate::support::*;
use mcl_core::Stamp;
use mcl_datasets::carmen::{self, CarmenError, MAX_LINE_BYTES, ScanKind};
use mcl_datasets::log::{LogKind, RecordPlace, ReferencePoses, SkippedRecord};

#[test]
fn beams_of_flaser_begin_at_minus_90_degrees_in_whole_or_half_degrees() {
    for (beams, degrees) in [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)] {
        let log = read(&flaser(&vec![2.0; beams], ORIGIN, ORIGIN, 1));
        let geometry = log.recording.scans[0].geometry;
        assert_eq!((geometry.beams, geometry.start_angle), (beams, -FRAC_PI_2));
        assert_eq!(geometry.angle_step, f64::to_radians(degrees));
        let straight_ahead = geometry.angle((90.0 / degrees) as usize);
        assert!(straight_ahead.abs() < 1e-12);
    }
}

#[test]
fn robotlaser1_brings_its_own_beams_and_poses() {
    let mount = pose(0.25, 0.0, 0.0);
    let robots = [ORIGIN, pose(1.0, 0.0, FRAC_PI_2), pose(1.0, 1.0, FRAC_PI_2)];
    let stamps = ["1.25", "1.5", "1.75"].iter();
    let text: String = robots
        .iter()
        .zip(stamps)
        .map(|(robot, stamp)| robot_laser(robot.compose(&mount), *robot, stamp))
        .collect();
    let log = read(&text);
    assert!(log.report.is_complete(), "{}", log.report);
    let scan = &log.recording.scans[0];
    let sixty_degrees: f64 = "1.047198".parse().unwrap();
    assert_eq!(scan.geometry.start_angle, -sixty_degrees);
    assert_eq!((scan.geometry.angle_step, scan.geometry.beams), (sixty_degrees, 3));
    assert_eq!(scan.ranges, [1.5, 2.5, 81.91]);
    assert_eq!(scan.stamp, Some(Stamp::from_nanoseconds(1_250_000_000)));
    assert_eq!(log.kind, LogKind::Raw);
    assert_close(Some(log.recording.robot_from_laser), mount, 1e-12);
    assert_close(log.recording.scans[1].odometry, pose(0.75, 0.25, FRAC_PI_2), 1e-12);
}

#[test]
fn remission_values_are_passed_over() {
    let plain = robot_laser(ORIGIN, ORIGIN, 7);
    let text = plain.replace(" 81.91 0 0 0 0 ", " 81.91 3 120 nan 7.5 0 0 0 ");
    assert_ne!(text, plain);
    let log = read(&text);
    assert!(log.report.is_complete(), "{}", log.report);
    assert_eq!(log.recording, read(&plain).recording);
}

#[test]
fn of_two_kinds_of_scan_records_the_first_is_read() {
    let both = scan(ORIGIN, 1)
        + &robot_laser(ORIGIN, ORIGIN, 1)
        + &scan(pose(1.0, 0.0, 0.0), 2)
        + &robot_laser(pose(1.0, 0.0, 0.0), pose(1.0, 0.0, 0.0), 2);
    let log = read(&both);
    assert_eq!((log.recording.scans.len(), log.report.ignored), (2, 2));
    assert!(log.recording.scans.iter().all(|scan| scan.ranges.len() == 180));
    let log = read(&(robot_laser(ORIGIN, ORIGIN, 0) + &both));
    assert_eq!((log.recording.scans.len(), log.report.ignored), (3, 2));
}

#[test]
fn other_kinds_are_ignored_and_counted_and_the_rest_is_silent() {
    let text = "\u{feff}# message formats defined: PARAM SYNC ODOM\n#\n\n   \t\n".to_owned()
        + "PARAM robot_use_laser on nohost 0\nPARAM robot_width\n"
        + "SYNC tag 1 host 1\r\nNEFF 14.5\nTRUEPOS 1 2 3 4 5 6\nRLASER 180 bad\n"
        + "ROBOTLASER2 x\nRAWLASER1 0\nLASER3\nODOMETRY 1\nflaser 180\n"
        + &scan(ORIGIN, 1);
    let log = read(&text);
    assert_eq!(log.report.ignored, 9);
    let ignored = "ignored records: LASER3 1, NEFF 1, ODOMETRY 1, RAWLASER1 1, RLASER 1, ROBOTLASER2 1, \
                SYNC 1, TRUEPOS 1, flaser 1";
    assert_eq!(log.notes[0], ignored);
    assert_eq!(log.report.ignored_kinds.values().sum::<usize>(), 9);
    assert_eq!(log.report.ignored_kinds["RAWLASER1"], 1);
    for kind in ["RLASER", "ROBOTLASER2"] {
        let note = format!("scans: --scan-topic {kind} reads those of the {kind} records instead");
        assert!(log.notes.contains(&note), "{:?}", log.notes);
    }
    assert!(log.report.is_complete(), "{}", log.report);
    assert_eq!(log.front_laser_offset, None);
}

#[test]
fn line_breaks_blanks_and_foreign_bytes_do_no_harm() {
    let plain = scan(pose(1.0, 2.0, 0.5), "3.25");
    let spaced = format!("\t {}  \r\n", plain.trim_end().replace(' ', "  \t"));
    assert_eq!(read(&spaced).recording, read(&plain).recording);
    assert_eq!(read(plain.trim_end()).recording, read(&plain).recording);
    let mut latin1 = b"# M\xfcnchen\n".to_vec();
    latin1.extend(plain.bytes().map(|byte| if byte == b'p' { 0xfc } else { byte }));
    let log = carmen::read(latin1.as_slice(), "", ReferencePoses::Auto).unwrap();
    assert_eq!((log.recording, log.report.skipped), (read(&plain).recording, 0));
}

#[test]
fn readings_that_are_not_measurements_are_kept_as_they_are() {
    let mut ranges = [1.0; 180];
    ranges[..5].copy_from_slice(&[f64::NAN, f64::INFINITY, -1.0, 0.0, 81.83]);
    let text = flaser(&ranges, ORIGIN, ORIGIN, 1);
    assert!(text.contains("NaN inf"), "{text}");
    let log = read(&text.replace("NaN", "-nan"));
    assert!(log.report.is_complete());
    let scan = &log.recording.scans[0];
    assert!(scan.ranges[0].is_nan());
    assert_eq!(scan.ranges[1..5], [f64::INFINITY, -1.0, 0.0, 81.83]);
    assert_eq!(scan.usable_beams(50.0), 175);
}

#[test]
fn stamps_that_are_not_times_are_counted_and_text_is_malformed() {
    let stamps = ["6.95e-310", "-1", "nan", "1e300", "0"];
    let text: String = stamps.iter().map(|stamp| scan(ORIGIN, stamp)).collect();
    let log = read(&(text + &scan(ORIGIN, "noon")));
    assert_eq!((log.report.unusable_stamps, log.report.skipped), (4, 1));
    assert_eq!(log.recording.scans.len(), 5);
    assert_eq!(log.recording.scans[4].stamp, Some(Stamp::from_nanoseconds(0)));
}

#[test]
fn stamps_keep_their_digits_and_order() {
    let log = read(&(scan(ORIGIN, "1071078718.462310123") + &scan(ORIGIN, "1071078718.462310122")));
    assert_eq!(log.recording.scans[0].stamp.unwrap().nanoseconds(), 1_071_078_718_462_310_123);
    assert_eq!(log.recording.backward_stamps(), 1);
}

/// Reads one bad line after a good scan, and returns what is said about it.
#[track_caller]
fn skipped(bad: &str) -> SkippedRecord {
    let log = read(&format!("{}{bad}\n", scan(ORIGIN, 1)));
    assert_eq!((log.report.skipped, log.recording.scans.len()), (1, 1), "{}", log.report);
    assert!(!log.report.is_complete());
    let record = log.report.skipped_details[0].clone();
    assert_eq!(record.place, RecordPlace::Line(2));
    record
}

#[track_caller]
fn assert_fault(bad: &str, field: &str, found: &str, expected: &str) {
    let record = skipped(bad);
    assert_eq!(record.field, field, "{record}");
    assert_eq!(record.found, found, "{record}");
    assert!(record.expected.contains(expected), "{record}");
    let message = record.to_string();
    assert!(message.contains("line 2") && message.contains(&record.record), "{message}");
}

#[test]
fn malformed_flaser_records_name_the_field_at_fault() {
    let good = scan(pose(1.5, 2.5, 0.5), "3.25");
    let good = good.trim_end();
    let short = good.replacen(" 1 ", " ", 1);
    assert_fault(&short, "number of fields", "190", "191 for n = 180");
    assert_fault(&format!("{good} 7"), "number of fields", "192", "191 for n = 180");
    assert_fault(
        &good.replacen("FLASER 180", "FLASER 90", 1),
        "number of fields",
        "191",
        "101 for n = 90",
    );
    assert_fault(&good.replacen("FLASER 180", "FLASER x", 1), "n", "x", "a count");
    assert_fault("FLASER -1", "n", "-1", "a count");
    assert_fault("FLASER", "n", "missing", "a count");
    assert_fault("FLASER 180 1.0 2.0", "number of fields", "4", "191");
    assert_fault(&good.replacen("1.5 2.5", "1.5 nan", 1), "y", "nan", "finite");
    assert_fault(&good.replacen("0.5 1.5", "inf 1.5", 1), "theta", "inf", "finite");
    assert_fault(&good.replacen("0.5 1.5", "0.5 1e10", 1), "ox", "1e10", "finite");
    assert_fault(&good.replacen("3.25", "soon", 1), "stamp", "soon", "seconds");
    let long = "x".repeat(500);
    let cut = format!("{}…", "x".repeat(40));
    assert_fault(&good.replacen("3.25", &long, 1), "stamp", &cut, "seconds");
}

#[test]
fn malformed_records_of_other_kinds_name_the_field_at_fault() {
    assert_fault("ODOM 1 2", "theta", "missing", "finite");
    assert_fault("ODOM 1 x 3 0 0 0 1 h 1", "y", "x", "finite");
    assert_fault("ODOM nan 2 3", "x", "nan", "finite");
    assert_fault("PARAM", "name", "missing", "name");
    assert_fault("PARAM robot_frontlaser_offset far", "robot_frontlaser_offset", "far", "finite");
    assert_fault("PARAM robot_frontlaser_offset", "robot_frontlaser_offset", "missing", "finite");
    assert_fault("PARAM mcl_reference_poses maybe", "mcl_reference_poses", "maybe", "recorded");
}

#[test]
fn malformed_robotlaser1_records_name_the_field_at_fault() {
    let good = robot_laser(pose(1.5, 0.0, 0.0), ORIGIN, 1);
    let fault = |from: &str, to: &str, field: &str, found: &str, expected: &str| {
        let bad = good.replacen(from, to, 1);
        assert_ne!(bad, good);
        let log = read(&(good.clone() + &bad));
        assert_eq!((log.report.skipped, log.recording.scans.len()), (1, 1), "{}", log.report);
        let record = &log.report.skipped_details[0];
        assert_eq!((record.record.as_str(), record.field.as_str()), ("ROBOTLASER1", field));
        assert_eq!(record.found, found);
        assert!(record.expected.contains(expected), "{record}");
    };
    fault("-1.047198", "left", "start_angle", "left", "finite");
    fault(" 1.047198", " 0", "resolution", "0", "not 0");
    fault(" 3 1.5", " 0 1.5", "n", "0", "at least 1");
    fault(" 3 1.5", " 18446744073709551615 1.5", "n", "18446744073709551615", "fields left");
    fault(" 3 1.5 2.5", " 3 1.5", "m", "1.5", "after n = 3 readings");
    fault(" 81.91 0", " 81.91 2", "number of fields", "27", "29 for n = 3, m = 2");
    fault("81.91 0", "81.91 18446744073709551615", "number of fields", "27", "m = 1844");
    fault(" 0 1 pippo 1", " 0 1 pippo", "number of fields", "26", "27");
}

#[test]
fn odometry_spans_a_skipped_scan() {
    let expected = corrected();
    let text = expected.text();
    let spanning = expected.raw[0].compose(&expected.raw[1]);
    let lines: Vec<&str> = text.lines().collect();
    let second = lines.iter().position(|line| line.ends_with(" 11 pippo 11")).unwrap();
    // Neither a readable nor an unreadable pose in the bad record makes a difference.
    for bad in ["FLASER 90 1 2 3".to_owned(), lines[second].replace(" 11 pippo", " x pippo")] {
        let mut changed = lines.clone();
        changed[second] = &bad;
        let log = read(&changed.join("\n"));
        assert_eq!((log.recording.scans.len(), log.report.skipped), (3, 1));
        assert_eq!(log.kind, LogKind::GfsCorrected);
        assert_close(log.recording.scans[1].odometry, spanning, 1e-12);
        assert_close(log.recording.scans[2].odometry, expected.raw[2], 1e-12);
    }
    // The restart line alone gives the pose of the skipped scan.
    let mut changed = lines.clone();
    changed[second] = "FLASER";
    changed[second + 1] = "ODOM";
    let log = read(&changed.join("\n"));
    assert_eq!(log.report.skipped, 2);
    assert_eq!(log.recording.scans[1].odometry, None);
    assert_close(log.recording.scans[2].odometry, expected.raw[2], 1e-12);
}

#[test]
fn two_skipped_scans_in_a_row_are_spanned_or_unknown() {
    let expected = corrected();
    let text = |first: &str, second: &str| {
        let corrected = &expected;
        // A good gap first, so that the kind of log is recognized.
        [
            corrected.scan(0),
            corrected.gap(0),
            corrected.scan(1),
            corrected.gap(1),
            first.to_owned(),
            corrected.gap(2),
            second.to_owned(),
            corrected.gap(0),
            corrected.scan(1),
        ]
        .concat()
    };
    let log = read(&text("FLASER\n", "FLASER\n"));
    let spanning = expected.raw[1].compose(&expected.raw[2]).compose(&expected.raw[0]);
    assert_eq!(log.recording.scans.len(), 3);
    assert_close(log.recording.scans[2].odometry, spanning, 1e-12);
    let log = read(&text("FLASER\nFLASER\n", ""));
    assert_eq!(log.recording.scans[2].odometry, None);
}

#[test]
fn odometry_of_a_raw_log_spans_a_skipped_scan() {
    let text =
        scan(ORIGIN, 1) + "FLASER 180 broken\n" + &odom(ORIGIN) + &scan(pose(2.0, 0.0, 0.1), 3);
    let log = read(&text);
    assert_eq!(log.kind, LogKind::Raw);
    assert_close(log.recording.scans[1].odometry, pose(2.0, 0.0, 0.1), 1e-12);
}

#[test]
fn an_unreadable_odom_line_costs_only_itself() {
    let expected = corrected();
    let plain = expected.text();
    let restart_line = restart(expected.poses[1]);
    let log = read(&plain.replacen(&restart_line, "ODOM ?\n", 1));
    assert_eq!(log.report.skipped, 1);
    assert!(log.recording.has_odometry());
    for (found, expected) in increments(&log).iter().zip(increments(&read(&plain))).skip(1) {
        assert_close(*found, expected.unwrap(), 1e-12);
    }
}

#[test]
fn many_skipped_records_are_counted_and_the_first_of_each_fault_described() {
    let text = scan(ORIGIN, 1) + "FLASER 2\n" + &"FLASER 1\n".repeat(49);
    let report = read(&text).report;
    assert_eq!((report.skipped, report.skipped_details.len()), (50, 20));
    let message = report.to_string();
    assert!(message.contains("50 skipped records") && message.contains("48 more"), "{message}");
}

#[test]
fn a_text_without_scan_says_what_it_holds() {
    let text = "# nothing\nODOM 1 2 3\nHELLO\nFLASER 7\n";
    let error = carmen::read(text.as_bytes(), "", ReferencePoses::Auto).unwrap_err();
    let message = error.to_string();
    for part in ["no laser scan in 4 lines", "FLASER 1, HELLO 1, ODOM 1", "line 4", "7"] {
        assert!(message.contains(part), "{message}");
    }
    assert!(!message.contains("--scan-topic") && !message.contains("ignored"), "{message}");
    // What is there is named, and what was looked for.
    let refused = |text: &str, kind: Option<&str>| {
        let kind = kind.and_then(ScanKind::named);
        carmen::read_scans(text.as_bytes(), "", ReferencePoses::Auto, kind).unwrap_err().to_string()
    };
    let rear = refused("RLASER 7\nROBOTLASER2 7\n", None);
    assert!(rear.contains("(--scan-topic RLASER or ROBOTLASER2 reads those)"), "{rear}");
    let front = refused(&scan(ORIGIN, 1), Some("RLASER"));
    for part in ["expected RLASER records", "(--scan-topic FLASER reads those)"] {
        assert!(front.contains(part), "{front}");
    }
}

#[test]
fn a_line_without_end_is_refused_before_it_fills_the_memory() {
    let good = scan(ORIGIN, 1);
    let text = good.clone() + &"1".repeat(MAX_LINE_BYTES + 1);
    let error = carmen::read(text.as_bytes(), "", ReferencePoses::Auto).unwrap_err();
    assert!(matches!(error, CarmenError::LineTooLong { line: 2 }), "{error}");
    assert!(error.to_string().contains("line 2 is longer than 1048576 bytes"));
    // The longest line allowed, line break included.
    let comment = format!("#{}\n", "-".repeat(MAX_LINE_BYTES - 2));
    assert_eq!(read(&(comment + &good)).recording, read(&good).recording);
}
