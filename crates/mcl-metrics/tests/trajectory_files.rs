//! Trajectory files of other programs: each format is recognized by its content, and errors have their position.

use mcl_core::{Pose2, Stamp};
use mcl_metrics::trajectory_file::{
    NonPlanar, QuaternionOrder, ReadSettings, TrajectoryFile, TrajectoryFileError,
    TrajectoryFormat, read, read_file,
};
use proptest::prelude::*;
use std::f64::consts::FRAC_PI_2;

const DEFAULT: ReadSettings =
    ReadSettings { non_planar: NonPlanar::Refuse, order: QuaternionOrder::Xyzw };
const PROJECT: ReadSettings = ReadSettings { non_planar: NonPlanar::Project, ..DEFAULT };

fn file(text: &str) -> TrajectoryFile {
    read(text.as_bytes(), "run.txt", &DEFAULT).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn message_with(text: &str, settings: &ReadSettings) -> String {
    read(text.as_bytes(), "run.txt", settings).unwrap_err().to_string()
}

fn message(text: &str) -> String {
    message_with(text, &DEFAULT)
}

fn stamps(file: &TrajectoryFile) -> Vec<i64> {
    file.trajectory.stamps().iter().map(|stamp| stamp.nanoseconds()).collect()
}

/// Two poses in all formats, the second turned left by 90°.
#[test]
fn the_same_poses_from_every_format() {
    let half = 0.5_f64.sqrt();
    let quaternions = format!("0,0,0,1\n1500000000100000000,3,4,0,0,0,{half},{half}\n");
    let texts = [
        (
            format!("# t x y z qx qy qz qw\n1500000000 1 2 0 0 0 0 1\n1500000000.1 3 4 0 0 0 {half} {half}\n"),
            TrajectoryFormat::Tum,
        ),
        // With tabs, and its column names in a comment with commas.
        (
            format!("# t,x,y,z,qx,qy,qz,qw\n1500000000\t1\t2\t0\t0\t0\t0\t1\n1500000000.1\t3\t4\t0\t0\t0\t{half}\t{half}"),
            TrajectoryFormat::Tum,
        ),
        (
            format!(
                "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n\
                 1500000000000000000,1,2,0,1,0,0,0\n1500000000100000000,3,4,0,{half},0,0,{half}\n"
            ),
            TrajectoryFormat::Euroc,
        ),
        ("time,x,y,theta\n1500000000,1,2,0\n1500000000.1,3,4,1.5707963267948966\n".into(), TrajectoryFormat::Csv),
        (
            "\u{feff}yaw_deg ; y ; x ; timestamp_ms;name\r\n0;2;1;1500000000000;a\r\n\r\n90;4;3;1500000000100;\"b;c\"\r\n".into(),
            TrajectoryFormat::Csv,
        ),
        (
            "sec\tnanosec\tposition.x\tposition.y\theading\n1500000000\t0\t1\t2\t0\n1500000000\t100000000\t3\t4\t1.5707963267948966\n".into(),
            TrajectoryFormat::Csv,
        ),
        // Nanoseconds without a unit: too large for seconds.
        (format!("stamp,x,y,z,qx,qy,qz,qw\n1500000000000000000,1,2,0,{quaternions}"), TrajectoryFormat::Csv),
    ];
    for (text, format) in texts {
        let found = file(&text);
        assert_eq!((found.format, found.has_headings), (format, true), "{text}");
        assert_eq!(
            stamps(&found),
            [1_500_000_000_000_000_000, 1_500_000_000_100_000_000],
            "{text}"
        );
        assert_eq!(found.trajectory.poses()[0], Pose2::new(1.0, 2.0, 0.0));
        let second = found.trajectory.poses()[1];
        assert!((second.x, second.y) == (3.0, 4.0) && (second.theta - FRAC_PI_2).abs() < 1e-15);
        assert!(found.notes.is_empty(), "{:?}", found.notes);
    }
}

#[test]
fn kitti_files_have_frames_for_stamps() {
    let found = file("1 0 0 1 0 1 0 2 0 0 1 0\n0 -1 0 3 1 0 0 4 0 0 1 0\n");
    assert_eq!(found.format, TrajectoryFormat::Kitti);
    assert_eq!(stamps(&found), [0, 1_000_000_000]);
    assert_eq!(
        found.trajectory.poses(),
        [Pose2::new(1.0, 2.0, 0.0), Pose2::new(3.0, 4.0, FRAC_PI_2)]
    );
    assert_eq!(
        found.notes,
        ["a file in the KITTI format has no stamps: its frame numbers are used as seconds"]
    );
    let good = "1 0 0 1 0 1 0 2 0 0 1 0\n";
    assert_eq!(
        message(&format!("{good}1 0 0 1 0 1\n")),
        "run.txt, line 2: 6 fields, expected 12, as in the lines before: a matrix of 3 rows and 4 columns"
    );
    assert_eq!(
        message(&format!("{good}1 0 0 1 0 1 0 2 0 0 inf 0\n")),
        "run.txt, line 2, field 11: found \"inf\", expected a finite number"
    );
    assert!(message("1 0 0 1 0 1 0 2 0 0 1 0.5\n").contains("field 12 (z): found 0.5 m"));
    assert!(message("5 0 0 1 0 1 0 2 0 0 1 0\n").contains("found a matrix that is not a rotation"));
    // A roll of 0.2 rad, and of a half turn.
    let (sin, cos) = 0.2_f64.sin_cos();
    let rolled = format!("1 0 0 1 0 {cos} {} 2 0 {sin} {cos} 0\n", -sin);
    assert!(message(&rolled).contains("field 1 to 11 (rotation): found a tilt of 0.2000 rad"));
    let pose = read(rolled.as_bytes(), "r", &PROJECT).unwrap().trajectory.poses()[0];
    assert_eq!(pose, Pose2::new(1.0, 2.0, 0.0));
    assert!(message_with("1 0 0 1 0 -1 0 2 0 0 -1 0\n", &PROJECT).contains("nearly upside down"));
}

/// Such files were once refused, or got headings that had not been measured.
#[test]
fn positions_without_headings_are_positions() {
    for text in [
        "1 0 0 0 0 0 0 0\n2 1 0 0 0 0 0 0\n",
        "t,x,y\n1,0,0\n2,1,0\n",
        "time,p_x,p_y,p_z\n1,0,0,0\n2,1,0,0\n",
    ] {
        let found = file(text);
        assert!(!found.has_headings, "{text}");
        assert_eq!(found.trajectory.poses()[1], Pose2::new(1.0, 0.0, 0.0));
    }
    // A file with some headings does not contain positions only.
    let message = message("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 0\n");
    assert!(message.starts_with("run.txt, line 2, field qx qy qz qw: found 0 0 0 0"), "{message}");
}

#[test]
fn headings_that_never_change_on_a_path_that_turns_are_noted() {
    let line = |t: i32, x: f64, y: f64, q: &str| format!("{t} {x} {y} 0 0 0 {q}\n");
    let square = [(0.0, 0.0), (0.6, 0.0), (1.2, 0.0), (1.2, 0.7)];
    let text = |q: &str, path: &[(f64, f64)]| -> String {
        path.iter().zip(0..).map(|(&(x, y), t)| line(t, x, y, q)).collect()
    };
    let doubts = |text: &str| file(text).doubts;
    assert!(
        doubts(&text("0 1", &square))[0]
            .starts_with("all headings are the same on a path that turns")
    );
    assert!(doubts(&text("0.3 1", &square)).len() == 1);
    assert!(doubts(&text("0 1", &square[..3])).is_empty(), "straight on");
    assert!(doubts(&text("0 1", &[(0.0, 0.0), (0.3, 0.0), (0.3, 0.3)])).is_empty(), "too short");
    // Noise of a robot at rest has all directions, but no path.
    let noise: Vec<_> =
        (0..400).map(|k| (0.01 * f64::from(k % 2), 0.01 * f64::from(k % 3))).collect();
    assert!(doubts(&text("0 1", &noise)).is_empty());
    assert!(doubts("0 0 0 0 0 0 0 0\n1 1 0 0 0 0 0 0\n2 1 1 0 0 0 0 0\n").is_empty());
}

/// The advice was once to project, with which the headings were wrong by 137°, with exit code 0.
#[test]
fn quaternions_with_w_first_are_recognized() {
    let heading = |theta: f64| {
        let (sin, cos) = (0.5 * theta).sin_cos();
        format!("{cos} 0 0 {sin}")
    };
    let text = format!("1 0 0 0 {}\n2 1 0 0 {}\n", heading(0.03), heading(-2.0));
    assert_eq!(
        message(&text),
        "run.txt, line 1, field qx qy qz qw: found a tilt of 3.1116 rad, nearly upside down, expected \
         roll and pitch within 0.001 rad of 0; are the quaternions in the order qw qx qy qz?"
    );
    let projected = message_with(&text, &PROJECT);
    assert!(
        projected.contains("expected less than 90° to be projected; are the quaternions in"),
        "{projected}"
    );
    let settings = ReadSettings { order: QuaternionOrder::Wxyz, ..DEFAULT };
    let found = read(text.as_bytes(), "run.txt", &settings).unwrap();
    let headings: Vec<f64> = found.trajectory.poses().iter().map(|pose| pose.theta).collect();
    assert!(
        (headings[0] - 0.03).abs() < 1e-15 && (headings[1] + 2.0).abs() < 1e-15,
        "{headings:?}"
    );
    // In the opposite case, the hint would not help.
    assert!(!message_with("1 0 0 0 0 0 0.1 1\n", &settings).contains("qw qx"));
}

#[test]
fn a_robot_on_its_back_is_not_projected() {
    // Rolled by 100°.
    let (sin, cos) = (50.0_f64.to_radians()).sin_cos();
    let over = message_with(&format!("1 0 0 0 {sin} 0.01 0 {cos}\n"), &PROJECT);
    assert!(over.contains("found a tilt of 1.7"), "{over}");
    let csv = format!("t,x,y,qx,qy,qz,qw\n1,0,0,{sin},0.01,0,{cos}\n");
    assert!(message_with(&csv, &PROJECT).contains("line 2, field qx: found a tilt of 1.7"));
    let (sin, cos) = (40.0_f64.to_radians()).sin_cos();
    assert!(read(format!("1 0 0 0 {sin} 0 0 {cos}\n").as_bytes(), "r", &PROJECT).is_ok());
}

#[test]
fn stamps_that_repeat_or_step_back_are_counted() {
    let found = file("t,x,y\n5,0,0\n5,0,0\n4,0,0\n4,0,0\n4,0,0\n-6,0,0\n");
    assert_eq!((found.repeated_stamps, found.backward_stamps), (3, 2));
    assert_eq!(stamps(&found)[5], -6_000_000_000);
}

#[test]
fn errors_are_reported_with_their_place() {
    for (text, expected) in [
        (
            "time,lat,lon\n1,2,3\n",
            "run.txt, line 1: there is no column for x (x, position.x, p_x); the columns are time, lat, lon",
        ),
        (
            "# comment\nt,x,y,position.x\n1,2,3,4\n",
            "run.txt, line 2: x, position.x could each be x; the columns are t, x, y, position.x",
        ),
        (
            "t,x,y,theta\n# comment\n1,2,3,0\n2,2,3\n",
            "run.txt, line 4: 3 fields, expected 4, as many as columns are named",
        ),
        (
            "t,x,y\n1,2,3\n2,2,y\n",
            "run.txt, line 3, field y: found \"y\", expected a finite number",
        ),
        (
            "t,x,y\n1700000000000,2,3\n",
            "run.txt, line 2, field t: found \"1700000000000\", expected seconds; this is not a usable time \
             (not finite, below a nanosecond, or too large) (the unit may stand in the column's name, as in \
             time_ms)",
        ),
        (
            "time_us,x,y\n9300000000000000000,2,3\n",
            "run.txt, line 2, field time_us: found \"9300000000000000000\", expected a time in the years 1677 to 2262",
        ),
        ("t,x,y\n", "run.txt: no pose found below the names of the columns"),
        (
            "1,2,3,0\n2,2,3,0\n",
            "run.txt, line 1: found \"1,2,3,0\", expected a line before it with the names of the columns \
             (t,x,y,theta), or a file in the TUM format: t x y z qx qy qz qw, separated by blanks",
        ),
        (
            "sec,nsec,x,y\n1,1000000000,0,0\n",
            "run.txt, line 2, field nsec: found \"1000000000\", expected nanoseconds from 0 to 999999999",
        ),
        ("# nothing\n", "run.txt: no pose found, expected lines of t x y z qx qy qz qw"),
        ("", "run.txt: no pose found, expected lines of t x y z qx qy qz qw"),
        // The writer was killed.
        (
            "0 0 0 0 0 0 0 1\n1 0 0",
            "run.txt, line 2: 3 fields, expected 8 separated by blanks: t x y z qx qy qz qw",
        ),
        (
            "pippo\n",
            "run.txt, line 1: 1 fields, expected 8 separated by blanks: t x y z qx qy qz qw",
        ),
    ] {
        assert_eq!(message(text), expected);
    }
    let binary = read(&b"t,x,y\n1,2,3\n2,\xff,3\n"[..], "b.csv", &DEFAULT).unwrap_err();
    assert_eq!(binary.to_string(), "b.csv, line 3: cannot read: the line is not UTF-8 text");
    let missing = read_file("no/such.csv", &DEFAULT).unwrap_err();
    assert!(matches!(missing, TrajectoryFileError::Open { .. }), "{missing}");
    let many = format!("t,{}\n1,2\n", vec!["column"; 5000].join(","));
    assert!(message(&many).len() < 500 && message(&many).ends_with("and 4971 more"));
}

proptest! {
    #[test]
    fn hostile_text_is_an_error_or_finite(
        text in prop_oneof![
            "[txyzq,;\t #%\"\n0-9.e-]{0,60}",
            "t,x,y,theta\n([0-9,.\"\n-]{0,40})",
            "#timestamp,p_RS_R_x,p_RS_R_y\n([0-9,.\n-]{0,40})",
            "([0-9.-]{1,3} ){11}[0-9]\n.{0,30}",
        ],
        project in any::<bool>(),
    ) {
        let settings = if project { PROJECT } else { DEFAULT };
        match read(text.as_bytes(), "run.txt", &settings) {
            Ok(found) => {
                prop_assert!(!found.trajectory.is_empty());
                prop_assert!(found.trajectory.poses().iter().all(Pose2::is_finite));
                prop_assert!(found.has_headings || found.trajectory.poses().iter().all(|p| p.theta == 0.0));
            }
            Err(error) => prop_assert!(error.to_string().starts_with("run.txt"), "{error}"),
        }
    }

    #[test]
    fn a_table_reads_back(poses in prop::collection::vec((any::<i64>(), -1e9..1e9f64, -3.0..3.0f64), 1..20)) {
        let mut text = "time_ns,x,y,theta\n".to_owned();
        for (stamp, x, theta) in &poses {
            text += &format!("{stamp},{x},{},{theta}\n", -x);
        }
        let found = file(&text);
        for ((stamp, pose), (ns, x, theta)) in found.trajectory.iter().zip(&poses) {
            prop_assert_eq!((stamp, pose), (Stamp::from_nanoseconds(*ns), Pose2::new(*x, -x, *theta)));
        }
    }
}
