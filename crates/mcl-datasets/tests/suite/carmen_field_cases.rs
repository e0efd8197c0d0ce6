//! CARMEN logs as they occur: other numbers of beams, other records, other ends of lines.

use std::f64::consts::{PI, TAU};

use crate::support::*;
use mcl_core::Pose2;
use mcl_datasets::carmen::{self, ScanKind};
use mcl_datasets::log::{Log, LogKind, ReferencePoses, read_log};

fn parameters(fov: &str, degrees: &str) -> String {
    format!(
        "PARAM laser_front_laser_fov {fov}\nPARAM laser_front_laser_resolution {degrees} nohost 0\n"
    )
}

fn angles(text: &str) -> (f64, f64) {
    let geometry = read(text).recording.scans[0].geometry;
    (geometry.angle(0), geometry.angle(geometry.beams - 1))
}

#[track_caller]
fn assert_angles(text: &str, first: f64, last: f64) {
    let found = angles(text);
    assert!((found.0 - first).abs() < 1e-5 && (found.1 - last).abs() < 1e-5, "{found:?}");
}

#[test]
fn any_number_of_beams_by_the_parameters_of_the_log() {
    let scan = |beams: usize| flaser(&vec![1.0; beams], ORIGIN, ORIGIN, 1);
    for (beams, fov, resolution) in [
        (541, "4.71239", "0.5"),
        (682, "4.18879", "0.3524"),
        (401, "1.74533", "0.25"),
        (91, "3.14159", "2.0000"),
        (541, "270", "0.5"),
    ] {
        let text = parameters(fov, resolution) + &scan(beams);
        let fov: f64 = fov.parse().unwrap();
        let half = 0.5 * if fov > 7.0 { fov.to_radians() } else { fov };
        assert_angles(&text, -half, half);
        assert!(read(&text).assumptions.is_empty());
    }
    // A full turn in 360 steps, and not half a one in 720.
    let full = parameters("6.28319", "1.0") + &scan(360);
    assert_angles(&full, -PI, PI - TAU / 360.0);
    // Parameters of another number of beams than the records have.
    let other = parameters("3.14159", "1.0") + &scan(360);
    assert_angles(&other, -0.5 * PI, -0.5 * PI + 359.0 * PI / 360.0);
    let usual = parameters("3.14159", "1.0") + &scan(181);
    assert_eq!(read(&usual).recording, read(&scan(181)).recording);
}

#[test]
fn without_parameters_the_rule_of_carmen_is_reported() {
    for (beams, half_degrees) in [(541, 90.0_f64), (401, 50.0), (91, 90.0), (2, 90.0)] {
        let text = flaser(&vec![1.0; beams], ORIGIN, ORIGIN, 1);
        assert_angles(&text, -half_degrees.to_radians(), half_degrees.to_radians());
        let assumption = &read(&text).assumptions[0];
        assert!(
            assumption.contains(&format!("of {beams} beams"))
                && assumption.contains("CARMEN's own rule")
        );
    }
}

/// Of one of nine public logs, 219 of the 236 gaps hold nothing but the restart.
#[test]
fn a_gap_with_only_the_restart_gives_no_motion() {
    let log = corrected();
    let text = log.text();
    let lost = text.replace(&log.gap(1), &restart(log.poses[1]));
    assert_ne!(lost, text);
    let found = read(&lost);
    assert_eq!(found.kind, LogKind::GfsCorrected);
    let steps = increments(&found);
    assert_close(steps[1], log.raw[0], 1e-12);
    assert_eq!(steps[2], None);
    assert_close(steps[3], log.raw[2], 1e-12);
    // A robot that stands still says so.
    let still = restart(log.poses[1]) + &odom(log.poses[1]);
    let steps = increments(&read(&text.replace(&log.gap(1), &still)));
    assert_close(steps[2], ORIGIN, 1e-12);
}

#[test]
fn scans_of_one_stamp_are_reported() {
    let text: String = (0..6).map(|k| scan(pose(f64::from(k), 0.0, 0.0), "1.01893e+09")).collect();
    let doubts = read(&text).report.doubts.join("\n");
    assert!(
        doubts.contains("6 of 6 scans share their stamp") && doubts.contains("1 different"),
        "{doubts}"
    );
    let at = |k: usize| pose(k as f64, 0.0, 0.0);
    let different: String = (0..40).map(|k| scan(at(k), k)).collect();
    let log = read(&different);
    assert!(log.assumptions.is_empty() && log.report.is_complete());
    // Every stamp twice.
    let pairs: String = (0..20).map(|k| scan(at(k), k / 2)).collect();
    assert!(read(&pairs).report.doubts[0].contains("20 of 20 scans"));
    // A few are only to be known.
    let few: String = (0..40).map(|k| scan(at(k), if k == 7 { 6 } else { k })).collect();
    let log = read(&few);
    assert!(log.assumptions[0].contains("2 of 40 scans share") && log.report.is_complete());
}

#[test]
fn directions_that_contradict_each_other_are_reported_and_degrees_refused() {
    let record = |angles: &str| {
        let readings = ["1.5"; 181].join(" ");
        let text = format!(
            "ROBOTLASER1 0 {angles} 81.9 0.01 0 181 {readings} 0 0 0 0 0 0 0 0 0 0 0 0 7 host 7\n"
        );
        carmen::read(text.as_bytes(), "", ReferencePoses::Recorded)
    };
    // The last beam is counted or not, and a field that is not set says nothing.
    for fov in ["3.141593", "3.159046", "0", "-3.141593"] {
        let log = record(&format!("-1.570796 {fov} 0.017453")).unwrap();
        assert!(log.report.is_complete(), "{fov}: {}", log.report);
    }
    let log = record("-1.570796 3.141593 0.008727").unwrap();
    let doubts = &log.report.doubts[0];
    for part in ["in 1 of 1", "line 1: 181 readings", "0.008727", "1.5709 rad", "fov is 3.1416"] {
        assert!(doubts.contains(part), "{part}: {doubts}");
    }
    let refused = record("-90 180 1").unwrap_err().to_string();
    assert!(refused.contains("28.6 turns") && refused.contains("are these degrees?"), "{refused}");
}

#[test]
fn one_parameter_alone_gives_the_directions_and_those_of_other_scans_are_reported() {
    let scan = |beams: usize| flaser(&vec![1.0; beams], ORIGIN, ORIGIN, 1);
    let fov = |angle: &str| format!("PARAM laser_front_laser_fov {angle}\n");
    let resolution = |angle: &str| format!("PARAM laser_front_laser_resolution {angle}\n");
    let half = f64::to_radians(135.0);
    assert_angles(&(fov("4.712389") + &scan(541)), -half, half);
    assert_angles(&(resolution("0.5") + &scan(541)), -half, half);
    assert_angles(&(fov("6.283185") + &scan(720)), -PI, PI - TAU / 720.0);
    for text in [fov("4.712389") + &scan(541), resolution("1.0") + &scan(181)] {
        assert!(read(&text).report.is_complete());
    }
    // What the number implies stays.
    for (parameters, beams) in [
        (fov("3.14159") + &resolution("0.25"), 181),
        (fov("3.14159") + &resolution("0.25"), 541),
        (resolution("0.5"), 181),
        (fov("4.712389"), 361),
    ] {
        let text = parameters + &scan(beams);
        assert_eq!(angles(&text), angles(&scan(beams)));
        let log = read(&text);
        let doubts = log.report.doubts.join("\n");
        assert!(
            doubts.contains(&format!("contradict FLASER records of {beams} beams")),
            "{doubts}"
        );
        assert!(!log.assumptions.join("\n").contains("no parameters"), "{:?}", log.assumptions);
    }
}

/// Its pose is not that of the origin.
#[test]
fn a_scan_before_any_odometry_has_no_pose() {
    let scans: String = (0..4).map(|k| raw_laser(k, 2.5)).collect();
    let log = carmen::read(scans.as_bytes(), "", ReferencePoses::Recorded).unwrap();
    assert!(!log.recording.has_reference() && !log.recording.has_odometry());
    assert_eq!(log.reference, None);
    assert!(log.assumptions[0].contains("which 4 of 4 do not have"), "{:?}", log.assumptions);
    let at = |k: usize| pose(1.0 + k as f64, 0.0, 0.0);
    let later: String = (2..5).map(|k| odom(at(k)) + &raw_laser(k, 2.5)).collect();
    let text = raw_laser(0, 2.5) + &raw_laser(1, 2.5) + &later;
    let log = carmen::read(text.as_bytes(), "", ReferencePoses::Auto).unwrap();
    let known: Vec<bool> = increments(&log).iter().map(Option::is_some).collect();
    assert_eq!(known, [false, false, false, true, true]);
}

fn raw_laser(stamp: usize, reading: f64) -> String {
    let readings = vec![reading.to_string(); 5].join(" ");
    format!(
        "RAWLASER1 0 -1.570796 3.141593 0.785398 81.9 0.01 0 5 {readings} 0 {stamp} host {stamp}\n"
    )
}

#[test]
fn scans_of_the_scanner_itself_are_read_with_the_odometry() {
    let at = |k: usize| pose(k as f64, 0.5 * k as f64, 0.1 * k as f64);
    let text: String = (0..4).map(|k| odom(at(k)) + &raw_laser(k, 2.5)).collect();
    let log = read(&format!("PARAM robot_frontlaser_offset 0.2\n{text}"));
    assert_eq!((log.kind, log.recording.scans.len()), (LogKind::Raw, 4));
    assert_eq!(log.recording.scans[0].ranges, [2.5; 5]);
    assert_eq!(log.recording.robot_from_laser.x, 0.2);
    let mount = Pose2::new(0.2, 0.0, 0.0);
    let expected = at(0).compose(&mount).between(&at(1).compose(&mount));
    assert_close(increments(&log)[1], expected, 1e-12);
    assert!(log.assumptions[0].contains("RAWLASER1"));
    // Where another record has the same scans with their poses, that one is read.
    let both: String = (0..4).map(|k| odom(at(k)) + &raw_laser(k, 2.5) + &scan(at(k), k)).collect();
    let log = read(&both);
    assert_eq!((log.recording.scans.len(), log.report.ignored), (4, 4));
    assert!(log.recording.scans.iter().all(|scan| scan.ranges.len() == 180));
    assert!(log.report.is_complete());
}

#[test]
fn true_poses_of_a_simulator_are_the_reference() {
    let robot = |k: usize| pose(k as f64, 0.0, 0.1);
    let truth = |k: usize| pose(1.1 * k as f64, 0.2, 0.05);
    let line = |k: usize| {
        let (Pose2 { x, y, theta }, odometry) = (truth(k), robot(k));
        format!(
            "TRUEPOS {x} {y} {theta} {} {} {} {k} host {k}\n",
            odometry.x, odometry.y, odometry.theta
        )
    };
    let text: String = (0..4).map(|k| line(k) + &odom(robot(k)) + &scan(robot(k), k)).collect();
    let log = read(&text);
    assert_eq!(log.kind, LogKind::RawWithTruth);
    for (k, scan) in log.recording.scans.iter().enumerate() {
        assert_close(scan.map_from_laser, truth(k), 1e-12);
    }
    assert_close(increments(&log)[2], robot(1).between(&robot(2)), 1e-12);
    let none = read_as(&text, ReferencePoses::None);
    assert!(none.recording.scans.iter().all(|scan| scan.map_from_laser.is_none()));
}

#[test]
fn where_there_is_no_scan_the_kinds_that_are_there_are_named() {
    let rear = scan(ORIGIN, 1).replace("FLASER", "RLASER");
    let text = rear.repeat(10) + &odom(ORIGIN).repeat(3) + "#ROBOT 1 2 3\n#LASER 181 0: 1\n";
    let error = carmen::read(text.as_bytes(), "rear.log", ReferencePoses::Auto).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("in 15 lines (#LASER 1, #ROBOT 1, ODOM 3, RLASER 10)"), "{message}");
    // A text with a new word in each line is not listed in full.
    let text: String = (0..1000).map(|k| format!("word{k}\n")).collect();
    let error = carmen::read(text.as_bytes(), "words.log", ReferencePoses::Auto).unwrap_err();
    assert!(error.to_string().contains("others 980"), "{error}");
}

#[test]
fn the_end_of_a_record_may_be_missing() {
    let place = pose(1.0, 2.0, 0.5);
    let whole = scan(place, "3.25");
    let expected = read(&whole).recording.scans[0].clone();
    for (tail, has_stamp) in [(" pippo 3.25", true), (" 3.25", true), (" pippo", true)] {
        let cut = whole.trim_end().strip_suffix(tail).unwrap_or(whole.trim_end());
        let found = read(cut);
        assert_eq!(found.report.skipped, 0, "{cut}");
        assert_eq!(found.recording.scans[0].stamp.is_some(), has_stamp);
        assert_eq!(found.recording.scans[0].ranges, expected.ranges);
    }
    let cut = whole.trim_end().strip_suffix(" 3.25 pippo 3.25").unwrap();
    let log = read(cut);
    assert_eq!((log.report.skipped, log.report.unusable_stamps), (0, 1));
    assert_eq!(
        (log.recording.scans[0].stamp, &log.recording.scans[0].ranges),
        (None, &expected.ranges)
    );
    // A reading too few is none of these.
    let short = whole.replacen(" 1 ", " ", 1);
    assert_eq!(read(&(short + &whole)).report.skipped, 1);
}

#[test]
fn readings_that_programs_of_windows_print_are_no_returns() {
    for (text, is_nan) in [
        ("1.#INF", false),
        ("1.#INF00", false),
        ("-1.#IND", true),
        ("1.#QNAN", true),
        ("-nan(ind)", true),
        ("nan(snan)", true),
        ("-1.#J", true),
    ] {
        let line = scan(ORIGIN, 1).replacen(" 1 ", &format!(" {text} "), 1);
        let log = read(&(line + &scan(ORIGIN, 2)));
        assert_eq!(log.report.skipped, 0, "{text}");
        let found = log.recording.scans[0].ranges[0];
        assert!(if is_nan { found.is_nan() } else { found == f64::INFINITY }, "{text}: {found}");
        assert_eq!(log.recording.scans[0].usable_beams(10.0), 179);
        let is_word = text == "-1.#J";
        assert_eq!(log.notes.join("").contains("not numbers: 1"), is_nan && !is_word);
        assert_eq!(log.report.is_complete(), !is_word, "{text}");
    }
}

/// It cost the scan.
#[test]
fn a_reading_that_is_a_word_costs_itself_alone() {
    for text in ["wall", "1,5", "0x1F", "1.2.3", "--", "\u{fffd}"] {
        let line = scan(ORIGIN, 2).replacen(" 1 ", &format!(" {text} "), 1);
        let log = read(&(scan(ORIGIN, 1) + &line + &scan(ORIGIN, 3)));
        assert_eq!((log.recording.scans.len(), log.report.skipped), (3, 0), "{text}");
        let found = &log.recording.scans[1].ranges;
        assert!(found[0].is_nan() && found[1..].iter().all(|&range| range == 1.0), "{text}");
        let doubt = format!("readings: 1 in 1 of 3 scans are not numbers (line 2: r1 is {text})");
        assert!(log.report.doubts[0].contains(&doubt), "{}", log.report);
        assert!(!log.report.is_complete());
    }
    // Of a record with remission values, which are not used.
    let plain = raw_laser(1, 2.5);
    let odd = plain.replacen(" 2.5 0 1 ", " wall 2 x 7 1 ", 1);
    assert_ne!(odd, plain);
    let log = read(&(odom(ORIGIN) + &odd));
    assert!(log.recording.scans[0].ranges[4].is_nan() && log.report.skipped == 0, "{}", log.report);
    // Two readings in one word shift the others: a record with a wrong number of fields.
    let merged = scan(ORIGIN, 2).replacen(" 1 1 ", " 1.251.5 ", 1);
    for tail in ["", " pippo 2", " 2 pippo 2"] {
        let line = merged.trim_end().strip_suffix(tail).unwrap().to_owned() + "\n";
        let log = read(&(scan(ORIGIN, 1) + &line));
        assert_eq!((log.recording.scans.len(), log.report.skipped), (1, 1), "{tail}");
    }
}

#[test]
fn parameters_that_come_late_change_or_are_of_the_rear_laser() {
    let scan = |beams: usize, kind: &str, stamp: usize| {
        flaser(&vec![1.0; beams], ORIGIN, ORIGIN, stamp).replace("FLASER", kind)
    };
    let front = |beams, stamp| scan(beams, "FLASER", stamp);
    let spans = |text: &str, asked: Option<&str>| -> (Vec<i64>, Log) {
        let kind = asked.and_then(ScanKind::named);
        let log = carmen::read_scans(text.as_bytes(), "", ReferencePoses::Auto, kind).unwrap();
        let degrees = log.recording.scans.iter().map(|scan| {
            let geometry = scan.geometry;
            (geometry.angle(geometry.beams - 1) - geometry.angle(0)).to_degrees().round() as i64
        });
        (degrees.collect(), log)
    };
    let wide = parameters("4.712389", "0.5");
    // Behind the first scans, which nothing else says the directions of.
    let (found, log) = spans(&(front(541, 1) + &front(541, 2) + &wide + &front(541, 3)), None);
    assert_eq!(found, [270; 3]);
    assert!(log.report.is_complete() && log.assumptions.len() == 1, "{:?}", log.assumptions);
    assert!(log.assumptions[0].contains("after the first 2"), "{:?}", log.assumptions);
    let (found, _) = spans(&(front(541, 1) + &front(541, 2) + &wide), None);
    assert_eq!(found, [270; 2], "behind all");
    // In any order, and the latest before a scan.
    let backwards: String = wide.lines().rev().map(|line| format!("{line}\n")).collect();
    let narrow = parameters("1.570796", "0.166667");
    let text = backwards + &front(541, 1) + &narrow + &front(541, 2) + &front(361, 3);
    let (found, log) = spans(&text, None);
    assert_eq!(found, [270, 90, 180]);
    assert!(log.report.doubts[0].contains("contradict FLASER records of 361 beams"));
    // Each laser by its own.
    let rear = wide.replace("front", "rear");
    let text =
        parameters("3.141593", "0.333333") + &rear + &front(541, 1) + &scan(541, "RLASER", 1);
    assert_eq!(spans(&text, None).0, [180]);
    assert_eq!(spans(&text, Some("RLASER")).0, [270]);
}

#[test]
fn the_place_of_the_laser_may_come_late_and_contradict_itself() {
    let at = |k: usize| pose(k as f64, 0.0, 0.1);
    let walk: String = (0..4).map(|k| odom(at(k)) + &raw_laser(k, 2.5)).collect();
    let first = "PARAM robot_frontlaser_offset 0.2\n".to_owned();
    let expected = read(&(first.clone() + &walk));
    let log = read(&(walk.clone() + &first));
    assert_eq!(log.recording, expected.recording);
    let log = read(&("PARAM robot_frontlaser_offset 0.3\n".to_owned() + &walk + &first));
    assert_eq!(log.recording, expected.recording, "the last one");
    assert!(
        log.report.doubts[0].contains("two mounts on the robot (0.3 and 0.2)"),
        "{}",
        log.report
    );
    // Beside the robot, and turned.
    let side =
        "PARAM robot_frontlaser_side_offset -0.1\nPARAM robot_frontlaser_angular_offset 0.5\n";
    let log = read(&(side.to_owned() + &first + &walk));
    assert_eq!(log.recording.robot_from_laser, pose(0.2, -0.1, 0.5));
    let mount = log.recording.robot_from_laser;
    let expected = at(0).compose(&mount).between(&at(1).compose(&mount));
    assert_close(increments(&log)[1], expected, 1e-12);
}

/// Some were counted without their name.
#[test]
fn all_that_is_ignored_is_named_with_its_number() {
    let words = ["#SONAR", "GPS.NMEA", "$GPGGA", "SONAR-2", "A_NAME_OF_MORE_THAN_TWENTY_LETTERS"];
    let others: String = words[1..].iter().map(|word| format!("{word} 1 2\n").repeat(2)).collect();
    let many: String = (0..30).map(|k| format!("KIND{k} 1\n")).collect();
    let truth = "TRUEPOS 1 2 3 0 0 0 1 host 1\n";
    let raw = raw_laser(1, 1.0).repeat(3);
    let log = read_as(
        &(raw + &scan(ORIGIN, 1) + &others + &many + truth + &raw_laser(2, 1.0) + "1.5 2.5\n"),
        ReferencePoses::None,
    );
    let named = &log.report.ignored_kinds;
    assert_eq!(named.values().sum::<usize>(), log.report.ignored);
    let number = |name: &str| named.get(name).copied();
    assert!(words[1..].iter().all(|word| number(word) == Some(2)), "{named:?}");
    assert_eq!((number("RAWLASER1"), number("TRUEPOS")), (Some(4), Some(1)));
    assert_eq!((number("KIND29"), number("others")), (Some(1), Some(1)));
}

#[test]
fn a_log_in_utf_16_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let text = corrected().text();
    let plain = read(&text);
    let little: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_be_bytes).collect();
    for (name, bytes) in [("little.log", little), ("big.log", big)] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(read_log(&path).unwrap().recording, plain.recording, "{name}");
    }
}
