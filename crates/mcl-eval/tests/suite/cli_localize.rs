//! `mcl-eval localize` and `mcl-eval evaluate`, called as a user calls them, on the simulated office.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

/// A folder with the first scans of the simulated office (`office.log`) and a map of it (`map.csv`).
struct Lab(TempDir);

const SCANS: usize = 60;

impl Lab {
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        lab.done(&["simulate", "-o", "whole.log", "-q"]);
        let mut scans = 0;
        let log = lab.edited("whole.log", |line| {
            scans += usize::from(line.starts_with("FLASER"));
            (scans <= SCANS).then(|| line.to_owned())
        });
        lab.write("office.log", &log);
        lab.done(&["map", "office.log", "--init", "grid", "--cell", "0.2", "-o", "map.csv"]);
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// A file with each line changed, or dropped.
    fn edited(&self, name: &str, change: impl FnMut(&str) -> Option<String>) -> String {
        let lines: Vec<String> = self.read(name).lines().filter_map(change).collect();
        lines.join("\n") + "\n"
    }

    fn call(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        command.current_dir(self.0.path()).args(args).output().unwrap()
    }

    /// What a call that must succeed prints.
    fn done(&self, args: &[&str]) -> String {
        self.ends(args, 0).0
    }

    /// Stdout and stderr of a call that must end with a code.
    fn ends(&self, args: &[&str], code: i32) -> (String, String) {
        let output = self.call(args);
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
        (stdout, stderr)
    }

    fn json(&self, args: &[&str]) -> Value {
        serde_json::from_str(&self.done(args)).unwrap()
    }
}

/// `localize` with few particles and beams, for the sake of time.
const LOCALIZE: [&str; 8] =
    ["localize", "office.log", "--map", "map.csv", "--particles", "100", "--beams", "20"];

fn localize<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&LOCALIZE, more].concat()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

fn has_figures(value: &Value) -> bool {
    ["mean", "median", "rmse", "max"].iter().all(|name| value[name].as_f64().is_some())
}

#[test]
fn the_motion_of_a_log_is_fitted() {
    let lab = Lab::new();
    let text = lab.done(&["inspect", "simulated-office", "--fit-motion"]);
    let found = lab.json(&["inspect", "simulated-office", "--fit-motion", "--json"]);
    let fitted = &found["fitted_motion"];
    assert_eq!((&fitted["steps"], &fitted["unknown_steps"]), (&915.into(), &0.into()));
    // By the log's odometry, steps err by 1 to 6 cm whatever their length.
    let parts = fitted["position_noise"].as_array().unwrap();
    for part in parts.iter().chain(fitted["alpha"].as_array().unwrap()) {
        let [low, value, high] =
            [&part["ci95"][0], &part["value"], &part["ci95"][1]].map(|n| n.as_f64().unwrap());
        assert!(0.0 <= low && low <= value && value <= high && low < high, "{part}");
    }
    assert!((0.01..0.06).contains(&parts[0]["value"].as_f64().unwrap()), "{parts:?}");
    // Options as they are printed are options of localize.
    for options in ["gaussian_options", "book_options"] {
        let options = fitted[options].as_str().unwrap();
        assert!(text.contains(options), "{text}");
        let localize = ["localize", "office.log", "--map", "map.csv", "--particles", "20"];
        lab.done(&[&localize[..], &options.split(' ').collect::<Vec<&str>>()].concat());
    }
    assert!(lab.json(&["inspect", "office.log", "--json"])["fitted_motion"].is_null());

    for (args, expected) in [
        (&["office.log", "--reference", "none"][..], "--reference FILE"),
        (&["map.csv"], "a point cloud has no odometry"),
        (&["office.log"], "at least 100"),
    ] {
        let (_, stderr) = lab.ends(&[&["inspect", "--fit-motion"], args].concat(), 1);
        assert!(stderr.contains(expected), "{args:?}: {stderr}");
    }
}

#[test]
fn localize_and_evaluate_agree() {
    let lab = Lab::new();
    let found = lab.json(&localize(&["--runs", "3", "-o", "out", "--json"]));
    assert_eq!((&found["runs"], &found["diverged"]), (&Value::from(3), &Value::from(0)));
    assert!(number(&found["weighted"]["mean"]) < 0.05, "{found}");
    assert!(number(&found["ns_per_beam"]) > 0.0);
    for name in ["weighted", "translation", "heading"] {
        assert!(has_figures(&found[name]), "{found}");
        let interval = &found["mean_ci95"][name];
        let mean = number(&found[name]["mean"]);
        assert!(number(&interval["low"]) <= mean && mean <= number(&interval["high"]), "{found}");
        assert_eq!(found["without_diverged"][name], found[name]);
    }

    let mut evaluate = vec!["evaluate", "--json", "--reference", "out/reference.tum"];
    evaluate.extend(["out/run-000.tum", "out/run-001.tum", "out/run-002.tum"]);
    let rows = lab.json(&evaluate)["estimates"].clone();
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 3);
    for (number_of_run, row) in rows.iter().enumerate() {
        assert_eq!(row["file"], format!("out/run-{number_of_run:03}.tum"));
        assert_eq!((&row["pairs"], &row["unmatched"]), (&Value::from(SCANS), &Value::from(0)));
        let distances: Vec<f64> = row["rpe"]
            .as_array()
            .unwrap()
            .iter()
            .map(|relative| {
                assert!(has_figures(&relative["translation"]) && has_figures(&relative["heading"]));
                number(&relative["distance_m"])
            })
            .collect();
        assert_eq!(distances, [1.0, 5.0, 10.0]);
        for name in ["weighted", "translation", "heading"] {
            for figure in ["mean", "median", "rmse", "max"] {
                let of_run = number(&found["each"][number_of_run][name][figure]);
                // The TUM file keeps positions exactly and headings within 1e-15 rad.
                assert!((number(&row[name][figure]) - of_run).abs() < 1e-12, "{name} {figure}");
                // The same distances, in another frame.
                let distance = number(&row["ate"][figure]) - number(&row["translation"][figure]);
                assert!(distance.abs() < 1e-12, "{figure}");
            }
        }
    }
    // Runs of as many scans: the pooled mean is the mean of the runs' means, the maximum theirs.
    let of_rows = |name: &str, figure: &str| {
        rows.iter().map(|row| number(&row[name][figure])).collect::<Vec<_>>()
    };
    for name in ["weighted", "translation", "heading"] {
        let mean = of_rows(name, "mean").iter().sum::<f64>() / 3.0;
        assert!((number(&found[name]["mean"]) - mean).abs() < 1e-12);
        let max = of_rows(name, "max").into_iter().fold(0.0, f64::max);
        assert!((number(&found[name]["max"]) - max).abs() < 1e-12);
    }
}

#[test]
fn the_folder_holds_rows_trajectories_and_a_summary() {
    let lab = Lab::new();
    lab.done(&localize(&["--runs", "2", "--seed", "7", "-o", "deep/out", "-q"]));
    let mut reader = csv::Reader::from_path(lab.path("deep/out/run-001.csv")).unwrap();
    let expected = "scan,stamp,dx,dy,dtheta,translation,heading,weighted,effective_sample_size,\
                    resampled,used_beams,var_x,var_y,var_theta,cov_xy,cov_xtheta,cov_ytheta,nees,\
                    log_evidence,explained_beams,particles,likelihood_exponent";
    assert_eq!(reader.headers().unwrap().iter().collect::<Vec<_>>().join(","), expected);
    let stamps: Vec<String> = lab
        .read("deep/out/reference.tum")
        .lines()
        .map(|line| line.split(' ').next().unwrap().to_owned())
        .collect();
    let (mut rows, mut squares) = (0, 0.0);
    for (index, row) in reader.records().enumerate() {
        let row = row.unwrap();
        let [dx, dy, dtheta, translation, heading, weighted] =
            std::array::from_fn(|column| row[column + 2].parse::<f64>().unwrap());
        assert_eq!((row[0].parse(), &row[1]), (Ok(index), stamps[index].as_str()));
        assert!((dx.hypot(dy) - translation).abs() < 1e-12 && dtheta.abs() == heading);
        let squared = 0.8 * dtheta * dtheta + 0.2 * (dx * dx + dy * dy);
        assert!((weighted - squared.sqrt()).abs() < 1e-12);
        assert!((1.0..=100.0).contains(&row[8].parse::<f64>().unwrap()));
        let value = |column: usize| row[column].parse::<f64>().unwrap();
        let [xx, yy, tt, xy, xt, yt] = [11, 12, 13, 14, 15, 16].map(value);
        // The laser of this log is the robot.
        let nees = mcl_metrics::nees([dx, dy, dtheta], [[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]);
        assert!((value(17) - nees.unwrap()).abs() < 1e-6 * (1.0 + value(17)));
        squares += value(17);
        assert!(value(18).is_finite() && (0.5..=1.0).contains(&value(19)));
        assert_eq!([value(20), value(21)], [100.0, 1.0]);
        rows += 1;
    }
    assert_eq!((rows, stamps.len()), (SCANS, SCANS));
    let summary: Value = serde_json::from_str(&lab.read("deep/out/summary.json")).unwrap();
    assert_eq!(summary["setup"]["seed"], 7);
    assert_eq!(summary["setup"]["filter"]["particles"], 100);
    assert_eq!(summary["figures"]["runs"], 2);
    let figures = &summary["figures"];
    let mut other = csv::Reader::from_path(lab.path("deep/out/run-000.csv")).unwrap();
    squares += other.records().map(|row| row.unwrap()[17].parse::<f64>().unwrap()).sum::<f64>();
    let mean = squares / (2 * SCANS) as f64;
    assert!((number(&figures["nees"]) / mean - 1.0).abs() < 1e-12, "{mean}: {figures}");
    assert!((0.0..=1.0).contains(&number(&figures["inside_95"])));
    assert!((0.5..=1.0).contains(&number(&figures["explained_beams"])));
    assert!(figures["log_evidence"].is_f64());
    assert_eq!(summary["figures"]["each"][1]["lost_episodes"], Value::Array(Vec::new()));

    // Fewer runs into the same folder: none of the earlier call is left, other files are.
    lab.write("deep/out/notes.txt", "mine");
    lab.done(&localize(&["-o", "deep/out", "-q"]));
    let mut names: Vec<String> = fs::read_dir(lab.path("deep/out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let expected =
        "notes.txt reference.tum run-000.csv run-000.tum run-000.watch.json summary.json";
    assert_eq!(names.join(" "), expected);
}

#[test]
fn results_do_not_depend_on_threads_but_on_the_seed() {
    let lab = Lab::new();
    let files = |threads: &str, seed: &str, noise: &str| {
        lab.done(&localize(&[
            "--runs",
            "3",
            "--threads",
            threads,
            "--seed",
            seed,
            "--odometry-noise",
            noise,
            "-o",
            "out",
        ]));
        ["run-000.tum", "run-001.tum", "run-002.tum", "run-002.csv"]
            .map(|name| lab.read(&format!("out/{name}")))
    };
    let one = files("1", "1", "0.02,0.01");
    assert_eq!(one, files("3", "1", "0.02,0.01"));
    assert_ne!(one, files("3", "2", "0.02,0.01"));
    assert_ne!(one, files("3", "1", "0,0"));
    assert!(one[0] != one[1] && one[1] != one[2]);
}

#[test]
fn every_setting_changes_the_run() {
    let lab = Lab::new();
    let trajectory = |more: &[&str]| {
        lab.done(&[&localize(&["-o", "out", "-q"]), more].concat());
        lab.read("out/run-000.tum")
    };
    let plain = trajectory(&[]);
    let settings: [&[&str]; 11] = [
        &["--sigma-hit", "0.1"],
        &["--z-rand", "0.3"],
        &["--max-distance", "0.5"],
        &["--alpha", "0.1,0.1,0.1,0.1"],
        &["--proposal", "motion"],
        &["--resampling", "residual"],
        &["--ess-fraction", "0.1"],
        &["--likelihood-exponent", "0.3"],
        &["--initial-pose", "7.1,6.9,0.02"],
        &["--initial", "uniform"],
        &["--max-range", "6"],
    ];
    for more in settings {
        assert!(trajectory(more) != plain, "{more:?}");
    }
    let sigma_hit = mcl_filter::FilterSettings::default().sigma_hit.to_string();
    assert_eq!(trajectory(&["--sigma-hit", &sigma_hit, "--proposal", "adaptive"]), plain);
}

#[test]
fn without_a_reference_the_start_must_be_given_and_errors_are_null() {
    let lab = Lab::new();
    let raw = |more: &[&'static str]| localize(&[&["--reference", "none"], more].concat());
    let (_, stderr) = lab.ends(&raw(&[]), 1);
    assert!(stderr.contains("--initial-pose"), "{stderr}");
    let start = ["--initial-pose", "7,7,-0.02", "--json", "-o", "out"];
    let found = lab.json(&raw(&start));
    for name in ["weighted", "translation", "heading", "diverged", "mean_ci95"] {
        assert_eq!(found.get(name), Some(&Value::Null), "{name}");
    }
    assert!(number(&found["ns_per_beam"]) > 0.0);
    assert_eq!(lab.read("out/run-000.tum").lines().count(), SCANS);
    assert!(!lab.path("out/reference.tum").exists());
    assert!(lab.read("out/run-000.csv").lines().nth(1).unwrap().contains(",,,,,,,"));

    let text = lab.done(&raw(&["--initial", "uniform", "--runs", "2"]));
    assert!(text.contains("no reference poses"), "{text}");
    assert!(text.contains("from their mean position"), "{text}");
}

#[test]
fn a_robot_that_did_not_know_where_it_was_is_found_after_some_scans() {
    let lab = Lab::new();
    let args = ["localize", "office.log", "--map", "map.csv", "--initial", "scan", "--runs", "3"];
    let text = lab.done(&args);
    assert!(text.contains("250..10000") && text.contains("found in 3 of 3 runs, after "), "{text}");
    let found = lab.json(&[&args[..], &["--json"]].concat());
    let after = |run: usize| found["each"][run]["scans_until_found"].as_u64();
    assert!((0..3).all(|run| after(run).is_some_and(|scans| scans < 10)), "{found}");
    assert_eq!(found["spread"], Value::Null);
}

#[test]
fn a_log_without_odometry_names_the_scan_and_what_to_do() {
    let lab = Lab::new();
    let log = lab.edited("office.log", |line| (!line.starts_with("ODOM")).then(|| line.to_owned()));
    lab.write("office.log", &log);
    let (_, stderr) = lab.ends(&localize(&[]), 1);
    assert!(
        stderr.contains("scan 1 has no odometry") && stderr.contains("--reference none"),
        "{stderr}"
    );
}

#[test]
fn scans_without_stamp_are_reported_and_keep_their_rows() {
    let lab = Lab::new();
    let mut scan = 0;
    let log = lab.edited("office.log", |line| {
        let mut fields: Vec<&str> = line.split(' ').collect();
        if fields[0] == "FLASER" {
            scan += 1;
            if scan % 20 == 0 {
                let stamp = fields.len() - 3;
                fields[stamp] = "-1";
            }
        }
        Some(fields.join(" "))
    });
    lab.write("office.log", &log);
    let (_, stderr) = lab.ends(&localize(&["-o", "out"]), 3);
    assert!(stderr.contains("3 of 60 scans have no usable stamp"), "{stderr}");
    assert_eq!(lab.read("out/run-000.csv").lines().count(), 1 + SCANS);
    assert_eq!(lab.read("out/run-000.tum").lines().count(), SCANS - 3);
    lab.done(&["evaluate", "--reference", "out/reference.tum", "out/run-000.tum"]);
    // Without files nothing is missing.
    lab.done(&localize(&[]));
}

#[test]
fn stamps_that_step_back_in_time_match_themselves() {
    let lab = Lab::new();
    let mut scan = 0;
    let log = lab.edited("office.log", |line| {
        let mut fields: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if fields[0] == "FLASER" {
            let stamp = fields.len() - 3;
            // Every tenth scan is stamped 9.7 s too early, before scans that came earlier.
            if scan % 10 == 9 {
                fields[stamp] = (fields[stamp].parse::<f64>().unwrap() - 9.7).to_string();
            }
            scan += 1;
        }
        Some(fields.join(" "))
    });
    lab.write("office.log", &log);
    let found = lab.json(&localize(&["-o", "out", "--json"]));
    let evaluate = ["evaluate", "--reference", "out/reference.tum", "out/run-000.tum", "--json"];
    let (stdout, stderr) = lab.ends(&evaluate, 0);
    assert!(stderr.contains("6 of its stamps and 6 of the reference's step back"), "{stderr}");
    let row: Value = serde_json::from_str(&stdout).unwrap();
    let row = &row["estimates"][0];
    assert_eq!(row["pairs"], SCANS);
    assert!((number(&row["weighted"]["max"]) - number(&found["weighted"]["max"])).abs() < 1e-12);
}

#[test]
fn invalid_arguments_are_wrong_usage() {
    let lab = Lab::new();
    let cases: [(&[&str], &str); 16] = [
        (&["--alpha", "0.1,0.2,0.3"], "expected 4 numbers"),
        (&["--motion", "gaussian", "--alpha", "0,0,0,0"], "--motion book"),
        (&["--motion", "book", "--heading-noise", "0,0,0"], "--motion gaussian"),
        (&["--alpha", "0,0,0,0", "--position-noise", "0,0,0"], "cannot be used with"),
        (&["--particles", "500..100"], "particles is 500..100"),
        (&["--particles", "0"], "particles is 0"),
        (&["--runs", "0"], "--runs"),
        (&["--beams", "some"], "all"),
        (&["--sigma-hit", "0"], "sigma_hit is 0"),
        // A value, not an unknown option.
        (&["--sigma-hit", "-1"], "sigma_hit is -1"),
        (&["--particles", "-1"], "expected a number of particles"),
        (&["--z-rand", "1.5"], "z_rand is 1.5"),
        (&["--resampling", "wheel"], "systematic"),
        (&["--odometry-noise=-0.1,0"], "standard deviations"),
        (&["--initial-pose", "1,2"], "expected 3 numbers"),
        (&["--initial", "uniform", "--initial-pose", "1,2,3"], "--initial-pose"),
    ];
    for (more, expected) in cases {
        let mut args: Vec<&str> = vec!["localize", "absent.log", "--map", "absent.csv"];
        args.extend(more);
        let (stdout, stderr) = lab.ends(&args, 2);
        assert!(stdout.is_empty() && stderr.contains(expected), "{more:?}: {stderr}");
    }
    let (_, stderr) = lab.ends(&["localize", "office.log", "--map", "absent.csv"], 1);
    assert!(stderr.contains("absent.csv"), "{stderr}");
    let (_, stderr) = lab.ends(&localize(&["-o", "map.csv"]), 1);
    assert!(stderr.contains("map.csv"), "{stderr}");
    lab.ends(&["evaluate", "a.tum"], 2);
    lab.ends(&["evaluate", "--reference", "a.tum"], 2);
    lab.ends(&["evaluate", "--reference", "a.tum", "b.tum", "--xi", "1.1"], 2);
}

/// Ten poses along x, a metre and a second apart, each changed.
fn tum(change: impl Fn(f64) -> (f64, f64, f64, f64)) -> String {
    (0..10)
        .map(|i| {
            let (stamp, x, y, theta) = change(f64::from(i));
            let (sin, cos) = (0.5 * theta).sin_cos();
            format!("{stamp} {x} {y} 0 0 0 {sin} {cos}\n")
        })
        .collect()
}

#[test]
fn equal_trajectories_have_no_error() {
    let lab = Lab(tempfile::tempdir().unwrap());
    lab.write("a.tum", &tum(|t| (t, t, 0.3 * t, 0.5 * t)));
    let found = lab.json(&["evaluate", "--reference", "a.tum", "a.tum", "--json"]);
    let row = &found["estimates"][0];
    for value in [&row["weighted"], &row["translation"], &row["heading"], &row["ate"]] {
        for figure in ["mean", "median", "rmse", "max"] {
            assert_eq!(value[figure], 0.0, "{row}");
        }
    }
    assert_eq!(row["rpe"][0]["translation"]["max"], 0.0);
    assert_eq!(row["rpe"][0]["pairs"], 9);
    // The path is 9.4 m long.
    assert_eq!(row["rpe"][2]["distance_m"], 10.0);
    assert_eq!(row["rpe"][2]["pairs"], 0);
    assert_eq!(row["rpe"][2].get("translation"), Some(&Value::Null));
}

#[test]
fn known_offsets_give_known_errors() {
    let lab = Lab(tempfile::tempdir().unwrap());
    lab.write("a.tum", &tum(|t| (t, t, 0.0, 0.0)));
    lab.write("b.tum", &tum(|t| (t + 0.004, t + 3.0, 4.0, 0.5)));
    let evaluate = |more: &[&str]| {
        let args = ["evaluate", "--reference", "a.tum", "b.tum", "--json"];
        lab.json(&[&args, more].concat())["estimates"][0].clone()
    };
    let near = |value: &Value, expected: f64| {
        assert!((number(value) - expected).abs() < 1e-12, "{value}, expected {expected}");
    };
    let row = evaluate(&[]);
    near(&row["translation"]["mean"], 5.0);
    near(&row["ate"]["rmse"], 5.0);
    near(&row["heading"]["median"], 0.5);
    near(&row["weighted"]["max"], (0.8 * 0.25 + 0.2 * 25.0f64).sqrt());
    near(&evaluate(&["--xi", "0"])["weighted"]["mean"], 5.0);
    near(&evaluate(&["--xi", "1"])["weighted"]["mean"], 0.5);
    // Aligned by positions, only the heading is off.
    let aligned = evaluate(&["--align"]);
    near(&aligned["translation"]["max"], 0.0);
    near(&aligned["heading"]["max"], 0.5);
    near(&aligned["reference_from_estimate"]["x"], -3.0);
    let row = evaluate(&["--rpe-distance", "2", "--rpe-distance", "3.5"]);
    let pairs: Vec<&Value> = row["rpe"].as_array().unwrap().iter().map(|r| &r["pairs"]).collect();
    assert_eq!(pairs, [4, 2]);
    // In its own frame, turned by 0.5 rad, each step of b points elsewhere.
    near(&row["rpe"][0]["translation"]["mean"], 2.0 * 2.0 * 0.25f64.sin());
    lab.ends(&["evaluate", "--reference", "a.tum", "b.tum", "--tolerance", "0.001"], 1);
}

#[test]
fn poses_without_partner_are_reported() {
    let lab = Lab(tempfile::tempdir().unwrap());
    lab.write("a.tum", &tum(|t| (t, t, 0.0, 0.0)));
    // Three of ten have no partner, on either side.
    lab.write("b.tum", &tum(|t| (t + 3.0, t + 3.0, 0.0, 0.0)));
    let evaluate = ["evaluate", "--reference", "a.tum", "b.tum", "a.tum", "--json"];
    let (stdout, stderr) = lab.ends(&evaluate, 3);
    // Those of b that are later than all of a cannot have one; what of a is not covered is said.
    assert!(stderr.contains("it covers 77.8 % of the reference's time"), "{stderr}");
    let found: Value = serde_json::from_str(&stdout).unwrap();
    let row = &found["estimates"][0];
    assert_eq!((&row["pairs"], &row["unmatched"]), (&Value::from(7), &Value::from(6)));
    assert_eq!(row["translation"]["max"], 0.0);
    assert_eq!(found["estimates"][1]["unmatched"], 0);
}

#[test]
fn files_that_cannot_be_compared_say_why() {
    let lab = Lab(tempfile::tempdir().unwrap());
    lab.write("a.tum", &tum(|t| (t, t, 0.0, 0.0)));
    lab.write("later.tum", &tum(|t| (t + 100.0, t, 0.0, 0.0)));
    lab.write("empty.tum", "# nothing\n");
    lab.write("high.tum", "0 0 0 1.5 0 0 0 1\n");
    lab.write("short.tum", "0 0 0 0 0 0 1\n");
    let cases = [
        ("later.tum", "no stamps match"),
        ("empty.tum", "no pose found"),
        ("high.tum", "line 1, field z"),
        ("short.tum", "7 fields, expected 8"),
        ("absent.tum", "absent.tum"),
    ];
    for (file, expected) in cases {
        let (stdout, stderr) = lab.ends(&["evaluate", "--reference", "a.tum", file], 1);
        assert!(stdout.is_empty() && stderr.contains(file), "{file}: {stderr}");
        assert!(stderr.contains(expected), "{file}: {stderr}");
    }
    lab.ends(&["evaluate", "--reference", "a.tum", "high.tum", "--project"], 3);
}

/// Position tracking on the real Intel log.
#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn tracks_the_intel_robot() {
    let lab = Lab(tempfile::tempdir().unwrap());
    lab.done(&["map", "intel-lab", "--init", "grid", "--size", "1%", "-o", "map.ply"]);
    let log = ["localize", "intel-lab", "--map", "map.ply", "--beams", "45", "-o", "out", "--json"];
    let found = lab.json(&log);
    // Dead reckoning is off by 9.7 on average.
    assert!(number(&found["weighted"]["mean"]) < 0.05, "{found}");
    assert_eq!(found["diverged"], 0);
    let evaluate = ["evaluate", "--reference", "out/reference.tum", "out/run-000.tum", "--json"];
    let row = lab.json(&evaluate)["estimates"][0].clone();
    assert_eq!((&row["pairs"], &row["unmatched"]), (&Value::from(910), &Value::from(0)));
    let difference = number(&row["weighted"]["mean"]) - number(&found["weighted"]["mean"]);
    assert!(difference.abs() < 1e-12);
}
