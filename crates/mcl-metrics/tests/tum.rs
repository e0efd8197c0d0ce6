//! TUM files: round trips, and errors with their position.

use mcl_core::files::fault::{Fault, during};
use mcl_core::{Pose2, Stamp, Trajectory, wrap_angle};
use mcl_metrics::tum::{self, NonPlanar, TumError, TumTrajectory};
use proptest::prelude::*;

fn read(text: &str) -> Result<TumTrajectory, TumError> {
    tum::read(text.as_bytes(), "run.tum", NonPlanar::Refuse)
}

fn message(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

#[test]
fn comments_blank_lines_and_windows_line_ends() {
    let text = "\u{feff}# stamp x y z ...\r\n\r\n  5.5\t1 2 0 0 0 0 1 \r\n# end\r\n5.25 3 4 -0.0005 0 0 2 2";
    let file = read(text).unwrap();
    assert_eq!(file.backward_stamps, 1);
    assert_eq!(
        file.trajectory.stamps().iter().map(|s| s.nanoseconds()).collect::<Vec<_>>(),
        [5_500_000_000, 5_250_000_000]
    );
    assert_eq!(file.trajectory.poses()[0], Pose2::new(1.0, 2.0, 0.0));
    // A quaternion need not be normalized.
    assert_eq!(file.trajectory.poses()[1], Pose2::new(3.0, 4.0, std::f64::consts::FRAC_PI_2));
}

#[test]
fn errors_name_file_line_and_field() {
    let good = "0 0 0 0 0 0 0 1\n";
    assert_eq!(
        message(&format!("{good}1 2 3\n")),
        "run.tum, line 2: 3 fields, expected 8 separated by blanks: t x y z qx qy qz qw"
    );
    assert_eq!(
        message(&format!("#\n{good}1 0 0.x 0 0 0 0 1\n")),
        "run.tum, line 3, field y: found \"0.x\", expected a finite number"
    );
    assert_eq!(
        message(&format!("{good}1 0 0 0 0 0 nan 1\n")),
        "run.tum, line 2, field qz: found \"nan\", expected a finite number"
    );
    assert_eq!(
        message("noon 0 0 0 0 0 0 1\n"),
        "run.tum, line 1, field t: found \"noon\", expected seconds; this is not a decimal \
         number of seconds"
    );
    assert_eq!(
        message("1 0 0 0 0 0 0 0\n"),
        "run.tum, line 1, field qx qy qz qw: found 0 0 0 0, expected a quaternion that can be \
         normalized"
    );
    assert_eq!(
        message("# nothing\n"),
        "run.tum: no pose found, expected lines of t x y z qx qy qz qw"
    );
    let long = message(&format!("1 {} 0 0 0 0 0 1\n", "9x".repeat(1000)));
    assert!(long.len() < 150 && long.contains('…'), "{long}");
    let binary = tum::read(&b"0 0 0 0 0 0 0 1\n\xff\xfe\n"[..], "b.tum", NonPlanar::Refuse);
    assert!(binary.unwrap_err().to_string().starts_with("b.tum, line 2: cannot read: "));
    let missing = tum::read_file("no/such.tum", NonPlanar::Refuse).unwrap_err().to_string();
    assert!(missing.starts_with("no/such.tum: "), "{missing}");
}

#[test]
fn poses_off_the_plane_are_refused_or_projected() {
    assert_eq!(
        message("1 0 0 0.3 0 0 0 1\n"),
        "run.tum, line 1, field z: found 0.3 m, expected a height within 0.001 m of 0; project the \
         poses onto the plane if that is meant"
    );
    // Roll of 0.2 rad after a yaw of 1 rad.
    let (sz, cz) = 0.5_f64.sin_cos();
    let (sx, cx) = 0.1_f64.sin_cos();
    let tilted = format!("1 2 3 0.3 {} {} {} {}\n", cz * sx, sz * sx, sz * cx, cz * cx);
    let flat = tilted.replace(" 0.3 ", " 0 ");
    assert!(
        message(&flat).contains("line 1, field qx qy qz qw: found a tilt of 0.2000 rad"),
        "{flat}"
    );
    let pose = tum::read(tilted.as_bytes(), "run.tum", NonPlanar::Project).unwrap();
    let pose = pose.trajectory.poses()[0];
    assert!((pose.x, pose.y) == (2.0, 3.0) && (pose.theta - 1.0).abs() < 1e-15, "{pose:?}");
    // Upside down is not planar either; straight up has no heading.
    assert!(message("1 0 0 0 1 0 0 0\n").contains("found a tilt of 3.1416 rad"));
    let up = tum::read(&b"1 0 0 0 0 -1 0 1\n"[..], "run.tum", NonPlanar::Project).unwrap_err();
    assert!(up.to_string().contains("found a pitch of ±90°"), "{up}");
}

#[test]
fn what_no_reader_would_take_is_not_written() {
    for x in [f64::NAN, f64::INFINITY] {
        let pose = (Stamp::from_nanoseconds(0), Pose2::new(x, 0.0, 0.0));
        let error = tum::write(Vec::new(), &[pose].into_iter().collect()).unwrap_err();
        assert!(matches!(error, TumError::Pose { index: 0, .. }), "{error}");
    }
}

/// Such files were once refused at the first line, but stamps relative to the start of the reference are common.
#[test]
fn negative_stamps_are_times_before_zero() {
    let file = read("-0.049999952 1 2 0 0 0 0 1\n0.050000048 1 2 0 0 0 0 1\n").unwrap();
    let stamps: Vec<i64> = file.trajectory.stamps().iter().map(|s| s.nanoseconds()).collect();
    assert_eq!(stamps, [-49_999_952, 50_000_048]);
    let mut written = Vec::new();
    tum::write(&mut written, &file.trajectory).unwrap();
    assert!(written.starts_with(b"-0.049999952 1 2 "));
    assert_eq!(tum::read(&written[..], "written.tum", NonPlanar::Refuse).unwrap(), file);
}

#[test]
fn files_are_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.tum");
    let trajectory: Trajectory =
        [(Stamp::from_nanoseconds(7), Pose2::new(0.1, -2.0, 0.0))].into_iter().collect();
    tum::write_file(&path, &trajectory).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "0.000000007 0.1 -2 0 0 0 0 1\n");
    assert_eq!(tum::read_file(&path, NonPlanar::Refuse).unwrap().trajectory, trajectory);
}

/// Files were once written in place, so that readers took partly written ones for complete.
#[test]
fn a_trajectory_file_is_the_old_or_the_new_one_wherever_its_writing_ends() {
    let trajectory = |poses: i64| -> Trajectory {
        let pose = |i| (Stamp::from_nanoseconds(i), Pose2::new(i as f64, 0.5, 0.25));
        (0..poses).map(pose).collect()
    };
    let (old, new) = (trajectory(2), trajectory(9));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("estimate.tum");
    let (result, steps) = during(Fault::None, || tum::write_file(&path, &new));
    result.unwrap();
    let mut failed = 0;
    for (at, (_, length, _)) in steps.iter().enumerate() {
        for bytes in 0..=*length {
            for fault in [Fault::Stop { at, bytes }, Fault::Full { at, bytes }] {
                tum::write_file(&path, &old).unwrap();
                let (result, _) = during(fault, || tum::write_file(&path, &new));
                let found = tum::read_file(&path, NonPlanar::Refuse).unwrap().trajectory;
                assert_eq!(&found, if result.is_ok() { &new } else { &old }, "{fault:?}");
                if let Err(error) = result {
                    assert!(error.to_string().contains("estimate.tum"), "{error}");
                    failed += 1;
                }
            }
        }
    }
    assert!(failed > 2 * std::fs::metadata(&path).unwrap().len(), "{failed}");
}

proptest! {
    #[test]
    fn written_reads_back(
        poses in prop::collection::vec(
            (any::<i64>(), prop::num::f64::NORMAL, -1e3..1e3f64, -10.0..10.0f64), 1..20),
    ) {
        let trajectory: Trajectory = poses
            .iter()
            .map(|&(ns, x, y, t)| (Stamp::from_nanoseconds(ns), Pose2::new(x, y, t)))
            .collect();
        let mut bytes = Vec::new();
        tum::write(&mut bytes, &trajectory).unwrap();
        let back = tum::read(&bytes[..], "memory", NonPlanar::Refuse).unwrap().trajectory;
        prop_assert_eq!(back.stamps(), trajectory.stamps());
        for (a, b) in back.poses().iter().zip(trajectory.poses()) {
            prop_assert!(a.x == b.x && a.y == b.y);
            prop_assert!(a.theta == wrap_angle(a.theta));
            prop_assert!(wrap_angle(a.theta - wrap_angle(b.theta)).abs() < 1e-15);
        }
    }
}
