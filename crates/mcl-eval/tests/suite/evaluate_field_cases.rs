//! What stopped people who evaluated trajectories: each kind as they met it, with the right figures.

use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use mcl_core::{LaserScan, Pose2, ScanGeometry, Stamp, Sweep};
use mcl_datasets::bag::planar::laser_scan;
use mcl_datasets::bag::types::{LASER_SCAN, ODOMETRY, POSE_WITH_COVARIANCE_STAMPED, TF_MESSAGE};
use mcl_datasets::bag::{BagWriter, Delivery, Encoder};
use serde_json::Value;
use tempfile::TempDir;

/// Stamps begin here (s).
const START: f64 = 1_700_000_000.0;
/// Where the laser is on the robot.
const MOUNT: Pose2 = Pose2::new(0.2, 0.0, FRAC_PI_2);

struct Lab(TempDir);

impl Lab {
    fn new() -> Self {
        Lab(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn ends(&self, args: &[&str], code: i32) -> (String, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        let args = [&["evaluate"], args].concat();
        let output = command.current_dir(self.0.path()).args(&args).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
        (stdout, stderr)
    }

    fn json(&self, args: &[&str], code: i32) -> Value {
        serde_json::from_str(&self.ends(&[args, &["--json"]].concat(), code).0).unwrap()
    }

    /// The row of the only estimate.
    fn row(&self, args: &[&str], code: i32) -> Value {
        self.json(args, code)["estimates"][0].clone()
    }
}

/// A robot that goes 0.5 m/s along a winding path for a minute.
fn truth(t: f64) -> Pose2 {
    let s = 0.5 * t;
    Pose2::new(s, 2.0 * (0.3 * s).sin(), (0.6 * (0.3 * s).cos()).atan())
}

/// Off by up to 4 cm and 1.2°, differently at every tenth of a second.
fn estimate(t: f64) -> Pose2 {
    let k = t * 10.0;
    let Pose2 { x, y, theta } = truth(t);
    Pose2::new(
        x + 0.03 * (1.7 * k).sin(),
        y + 0.03 * (2.3 * k).cos(),
        theta + 0.02 * (2.9 * k).sin(),
    )
}

/// Times of a minute at a rate (Hz).
fn times(rate: f64) -> impl Iterator<Item = f64> {
    (0..(60.0 * rate) as usize).map(move |k| k as f64 / rate)
}

fn line(stamp: f64, pose: Pose2) -> String {
    let (sin, cos) = (0.5 * pose.theta).sin_cos();
    format!("{stamp:.6} {:.9} {:.9} 0 0 0 {sin:.12} {cos:.12}\n", pose.x, pose.y)
}

fn tum(times: impl Iterator<Item = f64>, pose: impl Fn(f64) -> Pose2) -> String {
    times.map(|t| line(START + t, pose(t))).collect()
}

/// Root mean square of the distances of the estimate from the truth.
fn ate() -> f64 {
    let squares = times(10.0).map(|t| estimate(t).distance(&truth(t)).powi(2));
    (squares.sum::<f64>() / 600.0).sqrt()
}

fn near(value: &Value, expected: f64, tolerance: f64) {
    let found = value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"));
    assert!((found - expected).abs() < tolerance, "{found}, expected {expected}");
}

/// With truth and estimate at 10 Hz.
fn usual() -> Lab {
    let lab = Lab::new();
    lab.write("ref.tum", &tum(times(10.0), truth));
    lab.write("est.tum", &tum(times(10.0), estimate));
    lab
}

/// What a bag holds beside its poses.
#[derive(Clone, Copy, PartialEq)]
enum Poses {
    /// An Odometry of ground truth, and a scan with its mount.
    Truth,
    /// What AMCL publishes, in this frame.
    Amcl(&'static str),
    /// `map` to `odom`, and `odom` to `base_link`.
    Transforms,
}

fn bag(lab: &Lab, name: &str, what: Poses, pose: impl Fn(f64) -> Pose2) {
    let mut bag = BagWriter::new(std::io::Cursor::new(Vec::new())).unwrap();
    let (live, latched) = (Delivery::Live, Delivery::Latched);
    let at = |t: f64| ((START + t) * 1e9).round() as i64;
    let stamp = |t: f64| Stamp::from_nanoseconds(at(t));
    let transform = |message: &mut Encoder, t: f64, frames: [&str; 2], pose: Pose2| {
        let (sin, cos) = (0.5 * pose.theta).sin_cos();
        message.header(stamp(t), frames[0]).text(frames[1]);
        message.f64s(&[pose.x, pose.y, 0.0, 0.0, 0.0, sin, cos]);
    };
    match what {
        Poses::Truth => {
            let poses = bag.topic("/ground_truth", &ODOMETRY, live).unwrap();
            let scans = bag.topic("/scan", &LASER_SCAN, live).unwrap();
            let fixed = bag.topic("/tf_static", &TF_MESSAGE, latched).unwrap();
            let mut message = Encoder::default();
            message.u32(1);
            transform(&mut message, 0.0, ["base_link", "laser"], MOUNT);
            bag.write(fixed, at(0.0) as u64, message).unwrap();
            let scan = LaserScan {
                geometry: ScanGeometry { start_angle: -0.5, angle_step: 0.5, beams: 3 },
                ranges: vec![1.0, 2.0, 3.0],
                stamp: None,
                map_from_laser: None,
                odometry: None,
                sweep: Sweep::default(),
            };
            let message = laser_scan(&scan, stamp(0.0), "laser", (0.1, 20.0));
            bag.write(scans, at(0.0) as u64, message).unwrap();
            for t in times(10.0) {
                let mut message = Encoder::default();
                message.header(stamp(t), "map").text("base_link").pose(pose(t)).f64s(&[0.0; 78]);
                bag.write(poses, at(t) as u64, message).unwrap();
            }
        }
        Poses::Amcl(frame) => {
            let poses = bag.topic("/amcl_pose", &POSE_WITH_COVARIANCE_STAMPED, live).unwrap();
            let mut covariance = [0.0; 36];
            (covariance[0], covariance[7], covariance[35]) = (4.5e-4, 4.5e-4, 2e-4);
            for t in times(10.0) {
                let mut message = Encoder::default();
                message.header(stamp(t), frame).pose(pose(t)).f64s(&covariance);
                bag.write(poses, at(t) as u64, message).unwrap();
            }
        }
        Poses::Transforms => {
            let moving = bag.topic("/tf", &TF_MESSAGE, live).unwrap();
            let drift = Pose2::new(1.0, -2.0, 0.7);
            for t in times(10.0) {
                let mut message = Encoder::default();
                message.u32(2);
                transform(&mut message, t, ["map", "odom"], drift);
                transform(&mut message, t, ["odom", "base_link"], drift.between(&pose(t)));
                bag.write(moving, at(t) as u64, message).unwrap();
            }
        }
    }
    fs::write(lab.path(name), bag.finish().unwrap().into_inner()).unwrap();
}

/// 01: one side was moved to the laser, the other was not.
#[test]
fn two_sources_of_the_robots_poses_are_taken_as_they_stand() {
    let lab = usual();
    bag(&lab, "truth.mcap", Poses::Truth, truth);
    bag(&lab, "amcl.mcap", Poses::Amcl("map"), estimate);
    let row = lab.row(&["--reference", "truth.mcap", "amcl.mcap"], 0);
    near(&row["ate"]["rmse"], ate(), 1e-6);
    let frames = &row["frames"];
    assert_eq!(
        (&frames["compared"], &frames["reference"]["of"]),
        (&"base_link".into(), &"base_link".into())
    );
    assert_eq!(
        (&frames["estimate"]["of"], &frames["estimate"]["within"]),
        (&"robot".into(), &"map".into())
    );
    // A file that says nothing: the robot's, which is guessed where the bag has a laser elsewhere.
    near(&lab.row(&["--reference", "truth.mcap", "est.tum"], 3)["ate"]["rmse"], ate(), 1e-6);
    let of_robot = ["--reference", "truth.mcap", "est.tum", "--estimate-frame", "robot"];
    near(&lab.row(&of_robot, 0)["ate"]["rmse"], ate(), 1e-6);
    // Both moved to the laser, by the mount that one side knows.
    let laser = lab.row(&["--reference", "truth.mcap", "amcl.mcap", "--frame", "laser"], 0);
    let squares = times(10.0).map(|t| {
        let [a, b] = [truth(t), estimate(t)].map(|pose| pose.compose(&MOUNT));
        a.distance(&b).powi(2)
    });
    near(&laser["ate"]["rmse"], (squares.sum::<f64>() / 600.0).sqrt(), 1e-6);
    // Where neither side can be moved, nothing is compared.
    let (_, stderr) = lab.ends(
        &[
            "--reference",
            "ref.tum",
            "--reference-frame",
            "laser",
            "est.tum",
            "--estimate-frame",
            "robot",
        ],
        1,
    );
    assert!(stderr.contains("--mount"), "{stderr}");
    let given = ["--reference-frame", "laser", "--estimate-frame", "robot", "--mount", "0,0,0.1"];
    let row = lab.row(&[&["--reference", "ref.tum", "est.tum"], &given[..]].concat(), 0);
    near(&row["axes"]["yaw"]["mean"], 0.1, 1e-3);
}

/// 02: noise makes a path longer, and the noisier estimate looked better over it.
#[test]
fn relative_errors_are_over_the_references_path() {
    let lab = Lab::new();
    let jitter = |t: f64| {
        let k = t * 10.0;
        let pose = truth(t);
        Pose2::new(pose.x + 0.1 * (1.7 * k).sin(), pose.y + 0.1 * (2.3 * k).cos(), pose.theta)
    };
    lab.write("ref.tum", &tum(times(10.0), truth));
    lab.write("smooth.tum", &tum(times(10.0), |t| truth(1.02 * t)));
    lab.write("jitter.tum", &tum(times(10.0), jitter));
    let found = lab.json(&["--reference", "ref.tum", "smooth.tum", "jitter.tum"], 0);
    let pairs = |row: usize| found["estimates"][row]["rpe"][1]["pairs"].as_u64().unwrap();
    assert_eq!(pairs(0), pairs(1));
    let of_estimate = ["--reference", "ref.tum", "jitter.tum", "--rpe-path", "estimate"];
    let own = lab.row(&of_estimate, 0);
    assert!(own["rpe"][1]["pairs"].as_u64().unwrap() > pairs(1), "its own path is longer");
}

/// 03: a file whose poses are in no order gave other relative errors, without a word.
#[test]
fn an_unsorted_estimate_is_taken_in_order_of_time() {
    let lab = usual();
    let mut lines: Vec<String> = times(10.0).map(|t| line(START + t, estimate(t))).collect();
    lines.reverse();
    lines.swap(3, 500);
    lab.write("shuffled.tum", &lines.concat());
    let expected = lab.row(&["--reference", "ref.tum", "est.tum"], 0);
    let (stdout, stderr) = lab.ends(&["--reference", "ref.tum", "shuffled.tum", "--json"], 0);
    assert!(stderr.contains("step back in time") && stderr.contains("order of time"), "{stderr}");
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(found["estimates"][0]["rpe"], expected["rpe"]);
}

/// 04: stamps cut to whole seconds.
#[test]
fn stamps_that_repeat_cannot_be_matched() {
    let lab = Lab::new();
    let whole = |rate: f64, pose: fn(f64) -> Pose2| -> String {
        times(rate).map(|t| line((START + t).floor(), pose(t))).collect()
    };
    lab.write("ref.tum", &whole(100.0, truth));
    lab.write("est.tum", &whole(10.0, estimate));
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "est.tum"], 3);
    assert!(
        stderr.contains("540 of its 600") && stderr.contains("5940 of the reference's 6000"),
        "{stderr}"
    );
}

/// 05: half a period between the two, and the estimate lies on the true path.
#[test]
fn poses_between_stamps_are_interpolated() {
    let lab = Lab::new();
    lab.write("ref.tum", &tum(times(10.0), truth));
    lab.write("est.tum", &tum(times(10.0).map(|t| t + 0.05), truth));
    let row = lab.row(&["--reference", "ref.tum", "est.tum", "--match", "interpolate"], 0);
    assert_eq!(row["pairs"], 599);
    near(&row["ate"]["rmse"], 0.0, 1e-4);
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "est.tum"], 1);
    assert!(stderr.contains("--match interpolate") && stderr.contains("--offset"), "{stderr}");
    let near_ones = ["--reference", "ref.tum", "est.tum", "--tolerance", "0.06"];
    let (_, stderr) = lab.ends(&near_ones, 0);
    assert!(stderr.contains("50.0 ms apart on average"), "{stderr}");
}

/// 06: one cut, empty or foreign file ended the evaluation of all others.
#[test]
fn a_bad_run_is_a_row_with_its_reason() {
    let lab = usual();
    let whole = tum(times(10.0), estimate);
    lab.write("cut.tum", &whole[..whole.len() - 40]);
    lab.write("empty.tum", "");
    lab.write("clock.tum", &tum(times(10.0).map(|t| t + 36_000.0), estimate));
    let files = ["est.tum", "cut.tum", "empty.tum", "clock.tum", "absent.tum"];
    let found = lab.json(&[&["--reference", "ref.tum"], &files[..]].concat(), 3);
    let rows = found["estimates"].as_array().unwrap();
    near(&rows[0]["ate"]["rmse"], ate(), 1e-6);
    for (row, reason) in
        rows[1..].iter().zip(["line 600", "no pose found", "no stamps match", "absent"])
    {
        assert!(row["failure"].as_str().unwrap().contains(reason), "{row}");
        assert_eq!(row["ate"], Value::Null);
    }
    let (text, _) =
        lab.ends(&["--reference", "ref.tum", "est.tum", "cut.tum", "--errors", "e.csv"], 3);
    assert!(text.contains("cut.tum") && text.contains("failed"), "{text}");
    // The reason names the file, once.
    let (text, stderr) =
        lab.ends(&["--reference", "ref.tum", "est.tum", "cut.tum", "absent.tum"], 3);
    assert_eq!(stderr.matches("cut.tum").count(), 1, "{stderr}");
    assert!(stderr.contains("no figures: absent.tum: no such file; check the path"), "{stderr}");
    assert!(text.contains("\ncut.tum, line 600: "), "{text}");
    assert_eq!(fs::read_to_string(lab.path("e.csv")).unwrap().lines().count(), 601);
    lab.ends(&["--reference", "ref.tum", "cut.tum", "empty.tum"], 1);
    lab.ends(&["--reference", "absent.tum", "est.tum", "est.tum"], 1);
    // Aligned, a localizer that never moved.
    lab.write("frozen.tum", &tum(times(10.0), |_| Pose2::IDENTITY));
    let found = lab.json(&["--align", "--reference", "ref.tum", "est.tum", "frozen.tum"], 3);
    assert!(found["estimates"][1]["failure"].as_str().unwrap().contains("align"));
}

/// Runs of two localizers: the first as good as the estimate, the second twice as far off; of the second, one gets
/// lost and one dies.
fn runs(lab: &Lab) {
    for run in 0..6 {
        let shift = 0.1 * f64::from(run);
        let off = |t: f64, factor: f64| {
            let (a, b) = (truth(t), estimate(t + shift));
            let there = truth(t + shift);
            Pose2::new(a.x + factor * (b.x - there.x), a.y + factor * (b.y - there.y), a.theta)
        };
        lab.write(&format!("ours/run-{run}.tum"), &tum(times(10.0), |t| off(t, 1.0)));
        let of_theirs = |t: f64| {
            let pose = off(t, 2.0);
            Pose2 { x: pose.x + if run == 4 && t > 35.0 { 6.0 } else { 0.0 }, ..pose }
        };
        let until = if run == 5 { 20.0 } else { 60.0 };
        let times = times(10.0).filter(|t| *t < until);
        lab.write(&format!("theirs/run-{run}.tum"), &tum(times, of_theirs));
    }
}

/// 07: a row per file, and nothing of all runs.
#[test]
fn groups_of_runs_are_summed_up_and_compared() {
    let lab = usual();
    runs(&lab);
    let groups = ["--group", "ours=ours/run-*.tum", "--group", "theirs=theirs/run-*.tum"];
    let args = [&["--reference", "ref.tum"], &groups[..]].concat();
    let files = ["--plot", "runs.png", "--table", "runs.md", "--errors", "e.csv"];
    let found = lab.json(&[&args[..], &files].concat(), 3);
    assert_eq!(found["estimates"].as_array().unwrap().len(), 12);
    assert_eq!(found["estimates"][7]["group"], "theirs");
    let [ours, theirs] = [&found["groups"][0], &found["groups"][1]];
    let counts = |group: &Value| {
        ["runs", "failed", "diverged", "lost"].map(|key| group[key].as_u64().unwrap())
    };
    assert_eq!(counts(ours), [6, 0, 0, 0]);
    assert_eq!(counts(theirs), [6, 2, 1, 1]);
    near(&theirs["coverage_time"], (5.0 + 20.0 / 60.0) / 6.0, 2e-3);
    assert!(ours["translation"]["ci95"]["low"].as_f64() < ours["translation"]["mean"].as_f64());
    near(
        &theirs["of_others"]["translation"]["mean"],
        2.0 * ours["translation"]["mean"].as_f64().unwrap(),
        2e-3,
    );
    let comparison = |measure: &str| {
        let all = found["comparisons"].as_array().unwrap();
        all.iter().find(|tested| tested["measure"] == measure).unwrap().clone()
    };
    let translation = comparison("translation");
    assert_eq!(translation["test"], "paired t over runs");
    assert!(translation["difference"].as_f64().unwrap() < 0.0, "{translation}");
    let failed = comparison("failed");
    // SciPy 1.17.1, fisher_exact([[0, 6], [2, 4]]).
    near(&failed["p"], 0.4545454545454545, 1e-12);
    for tested in found["comparisons"].as_array().unwrap() {
        assert!(tested["p_holm"].as_f64() >= tested["p"].as_f64(), "{tested}");
        assert!(tested["ci95"]["low"].is_number(), "{tested}");
    }
    assert!(fs::read(lab.path("runs.png")).unwrap().starts_with(b"\x89PNG"));
    let table = fs::read_to_string(lab.path("runs.md")).unwrap();
    assert!(table.contains("| theirs | 6 | 2 |"), "{table}");
    lab.ends(&[&args[..], &["--table", "runs.tex"]].concat(), 3);
    lab.ends(&[&args[..], &["--table", "runs.csv"]].concat(), 3);
    let csv = fs::read_to_string(lab.path("runs.csv")).unwrap();
    assert_eq!(csv.lines().count(), 13);
    assert!(csv.starts_with("group,file,topic,failure,pairs,"), "{csv}");
    assert!(fs::read_to_string(lab.path("runs.tex")).unwrap().contains("\\begin{tabular}"));
    // A run without figures: errors are not tested, as that would be conditioned on the outcome; failures are.
    lab.write("theirs/run-2.tum", "");
    let found = lab.json(&args, 3);
    let of = |measure: &str| {
        let all = found["comparisons"].as_array().unwrap();
        all.iter().find(|tested| tested["measure"] == measure).unwrap()["p"].clone()
    };
    assert_eq!(of("translation"), Value::Null);
    near(&of("failed"), 0.18181818181818182, 1e-12);
    for wrong in [["--group", "ours"], ["--group", "=x"]] {
        lab.ends(&[&["--reference", "ref.tum"], &wrong[..]].concat(), 2);
    }
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "--group", "none=no/*.tum"], 1);
    assert!(stderr.contains("no file matches"), "{stderr}");
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "--group", "ours=ours"], 1);
    assert!(stderr.contains("by a pattern, such as 'ours/*.tum'"), "{stderr}");
}

/// Runs on logs of their own each have their own reference.
#[test]
fn each_run_has_its_own_reference() {
    let lab = Lab::new();
    for run in 0..3 {
        let later = |t: f64| t + 10.0 * f64::from(run);
        lab.write(&format!("truth/run-{run}.tum"), &tum(times(10.0), |t| truth(later(t))));
        lab.write(&format!("runs/run-{run}.tum"), &tum(times(10.0), |t| truth(later(t))));
    }
    let found = lab.json(&["--reference", "truth/{run}.tum", "--group", "all=runs/*.tum"], 0);
    near(&found["groups"][0]["translation"]["max"], 0.0, 1e-9);
    fs::remove_file(lab.path("truth/run-1.tum")).unwrap();
    let found = lab.json(&["--reference", "truth/{run}.tum", "--group", "all=runs/*.tum"], 3);
    let failure = found["estimates"][1]["failure"].as_str().unwrap();
    assert!(failure.starts_with("runs/run-1.tum: its reference: truth/run-1.tum: "), "{failure}");
}

/// Field case `escape-codes`: a spreadsheet computed the names of files.
#[test]
fn names_are_no_formulas() {
    let lab = usual();
    fs::copy(lab.path("est.tum"), lab.path("=1+1.tum")).unwrap();
    let files = ["--table", "t.csv", "--errors", "e.csv"];
    lab.ends(&[&["--reference", "ref.tum", "=1+1.tum"], &files[..]].concat(), 0);
    let read = |name: &str| fs::read_to_string(lab.path(name)).unwrap();
    assert!(read("t.csv").lines().nth(1).unwrap().starts_with(",'=1+1.tum,"));
    assert!(read("e.csv").lines().skip(1).all(|line| line.starts_with("'=1+1.tum,")));
}

/// What the text says of how many poses there are, and of how many are compared.
#[test]
fn counts_are_of_what_they_say() {
    let lab = usual();
    let (text, _) = lab.ends(&["--reference", "ref.tum", "est.tum"], 0);
    assert!(text.contains("est.tum: 600 pairs, 0 poses unmatched; "), "{text}");
    assert!(text.ends_with("reference: ref.tum, 600 poses, of the robot (assumed)\n"), "{text}");
    let over = text.lines().find(|line| line.starts_with("  over 10 m, m")).unwrap();
    let pairs = lab.row(&["--reference", "ref.tum", "est.tum"], 0)["rpe"][2]["pairs"].clone();
    assert!(over.ends_with(&format!("  {pairs} pairs")), "{over}");
    lab.write("one.tum", &tum(times(10.0).take(1), estimate));
    let (text, _) = lab.ends(&["--reference", "ref.tum", "one.tum"], 3);
    assert!(text.contains("one.tum: 1 pair, 599 poses unmatched; "), "{text}");
    // Those that lie beyond the other side are no part of the count.
    let every_other_late = |(k, t): (usize, f64)| t + 0.03 * (k % 2) as f64;
    lab.write("late.tum", &tum(times(10.0).enumerate().map(every_other_late), estimate));
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "late.tum"], 3);
    let expected =
        "299 of its 599 poses that lie in the time of the other side have no match there";
    assert!(stderr.contains(expected), "{stderr}");
}

/// 08: the run that died early had the smaller error. 19: another rate looked like a run that stopped.
#[test]
fn coverage_distinguishes_a_dead_run_from_another_rate() {
    let lab = Lab::new();
    let drifting = |t: f64| Pose2 { y: truth(t).y + 0.004 * t, ..truth(t) };
    lab.write("ref.tum", &tum(times(100.0), truth));
    lab.write("whole.tum", &tum(times(10.0), drifting));
    lab.write("died.tum", &tum(times(10.0).filter(|t| *t < 20.0), drifting));
    let whole = lab.row(&["--reference", "ref.tum", "whole.tum"], 0);
    assert_eq!(
        (&whole["coverage"]["time"], &whole["unmatched"]),
        (&Value::from(1.0), &Value::from(5400))
    );
    let (stdout, stderr) = lab.ends(&["--reference", "ref.tum", "died.tum", "--json"], 3);
    assert!(
        stderr.contains("it covers 33.") && stderr.contains("from 20.0 s to 60.0 s"),
        "{stderr}"
    );
    let died: Value = serde_json::from_str(&stdout).unwrap();
    let died = &died["estimates"][0];
    assert!(died["ate"]["rmse"].as_f64() < whole["ate"]["rmse"].as_f64(), "its errors are smaller");
    near(&died["coverage"]["path"], 0.333, 5e-3);
    // With what is missing counted as lost it is the worse.
    near(&died["with_missing"]["lost_share"], 0.667, 5e-3);
    assert_eq!(died["with_missing"]["median"], Value::Null);
    assert!(whole["with_missing"]["p95"].as_f64() < Some(0.25));
    // The reference is the sparser: all of its poses have partners.
    lab.row(&["--reference", "whole.tum", "ref.tum"], 0);
    // Only the part that is asked for.
    lab.row(&["--reference", "ref.tum", "died.tum", "--end", "19.5"], 0);
    let late = lab.row(&["--reference", "ref.tum", "whole.tum", "--start", "30"], 0);
    near(&late["axes"]["y"]["mean"], 0.004 * 45.0, 2e-3);
}

/// 09: localizers that publish transforms, or a path.
#[test]
fn transforms_are_poses() {
    let lab = usual();
    bag(&lab, "tf.mcap", Poses::Transforms, estimate);
    for topic in [&[][..], &["--topic", "/tf"], &["--topic", "/tf:map.base_link"]] {
        let row = lab.row(&[&["--reference", "ref.tum", "tf.mcap"], topic].concat(), 0);
        near(&row["ate"]["rmse"], ate(), 1e-6);
        assert_eq!(row["topic"], "/tf:map.base_link");
    }
}

/// 10: clocks that differ.
#[test]
fn offsets_of_clocks_are_given_or_found() {
    let lab = usual();
    let late: String = times(10.0).map(|t| line(START + t + 0.35, estimate(t))).collect();
    lab.write("late.tum", &late);
    let given = lab.row(&["--reference", "ref.tum", "late.tum", "--offset", "-0.35"], 0);
    near(&given["ate"]["rmse"], ate(), 1e-6);
    let args = ["--reference", "ref.tum", "late.tum", "--offset", "auto", "--match", "interpolate"];
    let found = lab.row(&args, 0);
    near(&found["offset_s"], -0.35, 5e-3);
    near(&found["ate"]["rmse"], ate(), 2e-3);
}

/// 11: a total station knows positions only.
#[test]
fn positions_have_no_headings() {
    let lab = usual();
    let positions = |q: &str| -> String {
        let text = |t: f64| format!("{:.6} {} {} 0 {q}\n", START + t, truth(t).x, truth(t).y);
        times(10.0).map(text).collect()
    };
    lab.write("zero.tum", &positions("0 0 0 0"));
    lab.write("same.tum", &positions("0 0 0 1"));
    lab.write(
        "named.csv",
        &std::iter::once("time,x,y\n".to_owned())
            .chain(times(10.0).map(|t| format!("{:.6},{},{}\n", START + t, truth(t).x, truth(t).y)))
            .collect::<String>(),
    );
    for args in [&["zero.tum"][..], &["same.tum", "--positions"], &["named.csv"]] {
        let row = lab.row(&[&["--reference"], args, &["est.tum"]].concat(), 0);
        near(&row["ate"]["rmse"], ate(), 1e-6);
        assert_eq!([&row["heading"], &row["weighted"], &row["axes"]["yaw"]], [&Value::Null; 3]);
        assert_eq!(row["rpe"].as_array().unwrap().len(), 0);
    }
    let (_, stderr) = lab.ends(&["--reference", "same.tum", "est.tum"], 3);
    assert!(stderr.contains("--positions"), "{stderr}");
}

/// 12: poses in the frame of odometry were compared with poses in the map.
#[test]
fn frames_of_the_world_are_named_and_compared() {
    let lab = usual();
    bag(&lab, "truth.mcap", Poses::Truth, truth);
    bag(&lab, "odom.mcap", Poses::Amcl("odom"), |t| Pose2::new(3.0, 5.0, 0.0).compose(&truth(t)));
    for reference in ["ref.tum", "truth.mcap"] {
        let (stdout, stderr) = lab.ends(&["--reference", reference, "odom.mcap", "--json"], 3);
        assert!(stderr.contains("in frame \"odom\""), "{stderr}");
        let found: Value = serde_json::from_str(&stdout).unwrap();
        assert_eq!(found["estimates"][0]["frames"]["estimate"]["within"], "odom");
        // Aligned, it does not matter.
        let row = lab.row(&["--align", "--reference", reference, "odom.mcap"], 0);
        near(&row["ate"]["rmse"], 0.0, 1e-6);
    }
}

/// 13: quaternions with w first look upside down, and projected they gave wrong headings.
#[test]
fn quaternions_that_begin_with_w_are_recognized() {
    let lab = usual();
    let wxyz = |t: f64| {
        let pose = estimate(t);
        let (sin, cos) = (0.5 * pose.theta).sin_cos();
        format!("{:.6} {:.9} {:.9} 0 {cos:.12} 0 0 {sin:.12}\n", START + t, pose.x, pose.y)
    };
    lab.write("wxyz.tum", &times(10.0).map(wxyz).collect::<String>());
    for project in [&[][..], &["--project"]] {
        let args = [&["--reference", "ref.tum", "wxyz.tum"], project].concat();
        let (_, stderr) = lab.ends(&args, 1);
        assert!(stderr.contains("qw qx qy qz"), "{stderr}");
    }
    let expected = lab.row(&["--reference", "ref.tum", "est.tum"], 0);
    lab.write(
        "ref_wxyz.tum",
        &times(10.0)
            .map(|t| {
                let (sin, cos) = (0.5 * truth(t).theta).sin_cos();
                format!(
                    "{:.6} {:.9} {:.9} 0 {cos:.12} 0 0 {sin:.12}\n",
                    START + t,
                    truth(t).x,
                    truth(t).y
                )
            })
            .collect::<String>(),
    );
    let row = lab.row(&["--reference", "ref_wxyz.tum", "wxyz.tum", "--wxyz"], 0);
    near(&row["heading"]["rmse"], expected["heading"]["rmse"].as_f64().unwrap(), 1e-9);
}

/// 20: stamps before zero.
#[test]
fn negative_stamps_are_times() {
    let lab = Lab::new();
    let from = |start: f64, pose: fn(f64) -> Pose2| -> String {
        times(10.0).map(|t| line(start + t, pose(t))).collect()
    };
    lab.write("ref.tum", &from(0.0, truth));
    lab.write("est.tum", &from(-0.05, |t| truth(t - 0.05)));
    let row = lab.row(&["--reference", "ref.tum", "est.tum", "--match", "interpolate"], 0);
    assert_eq!(row["pairs"], 599);
    near(&row["ate"]["rmse"], 0.0, 1e-4);
}

/// 22: covariances that an estimate carries are held against its errors.
#[test]
fn covariances_of_estimates_are_judged() {
    let lab = usual();
    bag(&lab, "truth.mcap", Poses::Truth, truth);
    bag(&lab, "amcl.mcap", Poses::Amcl("map"), estimate);
    for frame in ["robot", "laser"] {
        let row = lab.row(&["--reference", "truth.mcap", "amcl.mcap", "--frame", frame], 0);
        let consistency = &row["consistency"];
        assert_eq!(consistency["poses"], 600);
        // Sines of 3 cm and 0.02 rad have these variances; none leaves the ellipsoid.
        near(&consistency["median_nees"], 3.0, 0.5);
        near(&consistency["inside_95"], 1.0, 1e-9);
    }
    assert_eq!(lab.row(&["--reference", "ref.tum", "est.tum"], 0)["consistency"], Value::Null);
}

/// Files of others: KITTI, EuRoC and names of columns are the same poses.
#[test]
fn formats_of_others_are_read() {
    let lab = usual();
    let euroc = |t: f64| {
        let (sin, cos) = (0.5 * estimate(t).theta).sin_cos();
        let nanoseconds = ((START + t) * 1e6).round() as i64 * 1000;
        format!(
            "{nanoseconds},{:.9},{:.9},0,{cos:.12},0,0,{sin:.12}\n",
            estimate(t).x,
            estimate(t).y
        )
    };
    let head = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n";
    lab.write("euroc.csv", &(head.to_owned() + &times(10.0).map(euroc).collect::<String>()));
    let named = |t: f64| {
        format!(
            "{:.12},{:.9},{:.6},{:.9}\n",
            estimate(t).theta,
            estimate(t).y,
            START + t,
            estimate(t).x
        )
    };
    lab.write(
        "named.csv",
        &("yaw,y,stamp,x\n".to_owned() + &times(10.0).map(named).collect::<String>()),
    );
    let expected = lab.row(&["--reference", "ref.tum", "est.tum"], 0);
    for file in ["euroc.csv", "named.csv"] {
        let row = lab.row(&["--reference", "ref.tum", file], 0);
        near(&row["weighted"]["mean"], expected["weighted"]["mean"].as_f64().unwrap(), 1e-8);
    }
    let kitti = |pose: Pose2| {
        let (sin, cos) = pose.theta.sin_cos();
        format!("{cos} {} 0 {} {sin} {cos} 0 {} 0 0 1 0\n", -sin, pose.x, pose.y)
    };
    lab.write("ref.kitti", &times(10.0).map(|t| kitti(truth(t))).collect::<String>());
    lab.write("est.kitti", &times(10.0).map(|t| kitti(estimate(t))).collect::<String>());
    let row = lab.row(&["--reference", "ref.kitti", "est.kitti"], 0);
    near(&row["ate"]["rmse"], ate(), 1e-6);
}

/// The side that is interpolated changed with one pose at the end, and so did the error by a fifth.
#[test]
fn the_same_side_is_interpolated_whatever_the_ends() {
    let lab = Lab::new();
    lab.write("ref.tum", &tum(times(10.0), truth));
    let rmse = |poses: usize| {
        let times = times(10.0).map(|t| t + 0.05).take(poses);
        lab.write("est.tum", &tum(times, estimate));
        let row = lab.row(&["--reference", "ref.tum", "est.tum", "--match", "interpolate"], 0);
        row["ate"]["rmse"].as_f64().unwrap()
    };
    let all = rmse(600);
    for fewer in [599, 598, 597] {
        assert!((rmse(fewer) - all).abs() < 1e-4, "{fewer}: {}, not {all}", rmse(fewer));
    }
}

/// A bag that names the frame of its odometry is of that robot, with or without transforms.
#[test]
fn the_frame_of_odometry_is_the_robots() {
    let lab = usual();
    let write = |name: &str, parent: &'static str, drift: Option<[&str; 2]>| {
        let mut bag = BagWriter::new(std::io::Cursor::new(Vec::new())).unwrap();
        let poses = bag.topic("/fused", &POSE_WITH_COVARIANCE_STAMPED, Delivery::Live).unwrap();
        let odometry = bag.topic("/odom", &ODOMETRY, Delivery::Live).unwrap();
        let moving = bag.topic("/tf", &TF_MESSAGE, Delivery::Live).unwrap();
        let apart = Pose2::new(1.0, -2.0, 0.7);
        for t in times(10.0) {
            let at = ((START + t) * 1e9).round() as i64;
            let stamp = Stamp::from_nanoseconds(at);
            let pose = if drift.is_some() { apart.between(&estimate(t)) } else { estimate(t) };
            let mut message = Encoder::default();
            message.header(stamp, parent).pose(pose).f64s(&[0.0; 36]);
            bag.write(poses, at as u64, message).unwrap();
            let mut message = Encoder::default();
            message.header(stamp, "odom").text("base_link").pose(truth(t)).f64s(&[0.0; 78]);
            bag.write(odometry, at as u64, message).unwrap();
            if let Some([parent, child]) = drift {
                let (sin, cos) = (0.5 * apart.theta).sin_cos();
                let mut message = Encoder::default();
                message.u32(1).header(stamp, parent).text(child);
                message.f64s(&[apart.x, apart.y, 0.0, 0.0, 0.0, sin, cos]);
                bag.write(moving, at as u64, message).unwrap();
            }
        }
        fs::write(lab.path(name), bag.finish().unwrap().into_inner()).unwrap();
    };
    write("plain.mcap", "map", None);
    let row = lab.row(&["--reference", "ref.tum", "plain.mcap", "--topic", "/fused"], 0);
    near(&row["ate"]["rmse"], ate(), 1e-6);
    assert_eq!(row["frames"]["compared"], "robot");
    // Poses in the odometry frame of a namespace are carried into its map.
    write("named.mcap", "robot1/odom", Some(["robot1/map", "robot1/odom"]));
    let row = lab.row(&["--reference", "ref.tum", "named.mcap", "--topic", "/fused"], 0);
    near(&row["ate"]["rmse"], ate(), 1e-6);
    // Without transforms there is a warning.
    write("alone.mcap", "robot1/odom", None);
    let (_, stderr) = lab.ends(&["--reference", "ref.tum", "alone.mcap", "--topic", "/fused"], 3);
    assert!(stderr.contains("\"robot1/odom\", which drifts"), "{stderr}");
}

/// Files of one name in folders of their own: who belongs to whom, nothing says.
#[test]
fn runs_of_one_name_are_not_paired() {
    let lab = usual();
    for (group, factor) in [("a", 1.0), ("b", 2.0)] {
        for run in 0..4 {
            let off = |t: f64| {
                let (a, b) = (truth(t), estimate(t + 0.1 * f64::from(run)));
                let there = truth(t + 0.1 * f64::from(run));
                Pose2::new(a.x + factor * (b.x - there.x), a.y + factor * (b.y - there.y), a.theta)
            };
            lab.write(&format!("{group}/{run}/est.tum"), &tum(times(10.0), off));
        }
    }
    let groups = ["--group", "a=a/*/est.tum", "--group", "b=b/*/est.tum"];
    let found = lab.json(&[&["--reference", "ref.tum"], &groups[..]].concat(), 0);
    let tested = &found["comparisons"][1];
    assert_eq!(
        (&tested["measure"], &tested["test"]),
        (&"translation".into(), &"Welch's t over runs".into())
    );
    assert!(tested["p"].is_number(), "{tested}");
    // Nothing is lost where nothing could be evaluated.
    lab.write("a/0/est.tum", "");
    lab.write("b/0/est.tum", "");
    let none = lab.json(&["--reference", "ref.tum", "a/0/est.tum", "b/0/est.tum"], 1);
    assert!(none["estimates"][1]["failure"].is_string());
}
