//! The commands that need no particle filter, called as a new user calls them: keys of `--json`, exit
//! codes, and what is said about bad input.

use crate::called;
use std::fs;

use serde_json::Value;
use tempfile::TempDir;

/// A folder with the first scans of the simulated office, `office.log`.
fn lab() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    called::write_office(folder.path());
    folder
}

fn ends(folder: &TempDir, args: &[&str], code: i32) -> (String, String) {
    called::ends(folder.path(), args, code)
}

fn done(folder: &TempDir, args: &[&str]) -> String {
    ends(folder, args, 0).0
}

fn json(folder: &TempDir, args: &[&str]) -> Value {
    serde_json::from_str(&done(folder, args)).unwrap()
}

fn assert_keys(value: &Value, keys: &str) {
    for key in keys.split(' ') {
        assert!(value.get(key).is_some(), "no {key} in {value}");
    }
}

#[test]
fn inspect_describes_a_log() {
    let lab = lab();
    let found = json(&lab, &["inspect", "office.log", "--json"]);
    assert_keys(
        &found,
        "scans readings points bounds duration_s path_length_m beams_used_per_scan ignored_records \
         skipped_records backward_stamps has_reference has_odometry odometry_rmse_m odometry_rmse_rad \
         odometry_opposed_steps odometry_opposed_m",
    );
    assert!(found["odometry_rmse_m"].as_f64().unwrap() > 0.0);
    assert_eq!((&found["scans"], &found["readings"]), (&Value::from(40), &Value::from(40 * 180)));
    assert_eq!(found["has_reference"], true);
    assert_eq!(found["has_odometry"], true);
    let points = |more: &[&str]| {
        let args = [&["inspect", "office.log", "--json"], more].concat();
        json(&lab, &args)["points"].as_u64().unwrap()
    };
    assert!(points(&["--max-range", "2"]) < points(&[]));
    assert_eq!(json(&lab, &["inspect", "simulated-office", "--json"])["scans"], 916);
}

#[test]
fn a_damaged_log_is_read_with_a_warning() {
    let lab = lab();
    let text = fs::read_to_string(lab.path().join("office.log")).unwrap();
    // A record of an unknown kind is not a loss; half a record is.
    fs::write(lab.path().join("ignored.log"), format!("{text}NEFF 0.5\n")).unwrap();
    let found = json(&lab, &["inspect", "ignored.log", "--json"]);
    assert_eq!((&found["ignored_records"], &found["ignored"]["NEFF"]), (&1.into(), &1.into()));
    let (half, _) = text.trim_end().rsplit_once(" nohost").unwrap();
    let half = &half[..half.rfind("FLASER").unwrap() + 40];
    fs::write(lab.path().join("half.log"), half).unwrap();
    let (stdout, stderr) = ends(&lab, &["inspect", "half.log", "--json"], 3);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((&found["scans"], &found["skipped_records"]), (&Value::from(39), &Value::from(1)));
    assert!(stderr.contains("FLASER skipped"), "{stderr}");
    ends(&lab, &["map", "half.log", "--init", "all", "-o", "m.csv"], 3);

    fs::write(lab.path().join("empty.log"), "").unwrap();
    fs::write(lab.path().join("words.log"), "no laser log at all\n").unwrap();
    for name in ["empty.log", "words.log", "absent.log"] {
        let (stdout, stderr) = ends(&lab, &["inspect", name], 1);
        assert!(stdout.is_empty() && stderr.contains(name), "{stderr}");
    }
}

#[test]
fn maps_are_built_and_their_likelihood_is_found_again() {
    let lab = lab();
    let keys = "points map_points cell_m iterations converged log_likelihood_trace \
                log_likelihood_per_point";
    for (format, more) in [
        ("csv", &["--init", "grid", "--size", "5%"][..]),
        ("ply", &["--init", "grid", "--cell", "0.5", "--offset", "0.1,-0.1"]),
        ("pcd", &["--init", "random", "--size", "100", "--seed", "3", "--refine", "fkm"]),
        ("pcd", &["--init", "grid", "--size", "100", "--refine", "fkm-accelerated"]),
    ] {
        let map = format!("map.{format}");
        let args = [&["map", "office.log", "-o", &map, "--json"], more].concat();
        let built = json(&lab, &args);
        assert_keys(&built, keys);
        assert_eq!(built["cell_m"].is_null(), more[1] != "grid");
        let found = json(&lab, &["likelihood", "office.log", "--map", &map, "--json"]);
        assert_keys(&found, "points map_points log_likelihood log_likelihood_per_point");
        assert_eq!(found["map_points"], built["map_points"]);
        assert_eq!(found["log_likelihood_per_point"], built["log_likelihood_per_point"]);
    }
    let all = json(&lab, &["map", "office.log", "--init", "all", "-o", "all.csv", "--json"]);
    assert_eq!(all["map_points"], all["points"]);
}

#[test]
fn wrong_usage_and_failures_have_codes_of_their_own() {
    let lab = lab();
    let usage: [&[&str]; 10] = [
        &[],
        &["mapp"],
        &["inspect"],
        &["inspect", "office.log", "--max-range", "-1"],
        &["map", "office.log", "--init", "grid", "-o", "m.csv"],
        &["map", "office.log", "--init", "grid", "--size", "5%", "--cell", "1", "-o", "m.csv"],
        &["map", "office.log", "--init", "random", "--cell", "1", "-o", "m.csv"],
        &["map", "office.log", "--init", "all", "--size", "5%", "-o", "m.csv"],
        &["map", "office.log", "--init", "random", "--size", "200%", "-o", "m.csv"],
        &["likelihood", "office.log"],
    ];
    for args in usage {
        ends(&lab, args, 2);
    }
    let failures: [(&[&str], &str); 5] = [
        (&["map", "office.log", "--init", "all", "-o", "m.xyz"], "m.xyz"),
        (&["map", "office.log", "--init", "all", "-o", "no/such/m.csv"], "m.csv"),
        (
            &["map", "office.log", "--reference", "none", "--init", "all", "-o", "m.csv"],
            "reference",
        ),
        (&["likelihood", "office.log", "--map", "absent.ply"], "absent.ply"),
        (&["run", "absent.toml"], "absent.toml"),
    ];
    for (args, expected) in failures {
        let (_, stderr) = ends(&lab, args, 1);
        assert!(stderr.contains(expected), "{args:?}: {stderr}");
    }
    assert!(!lab.path().join("m.csv").exists());
    for help in
        [&["--help"][..], &["--version"], &["localize", "--help"], &["evaluate", "--version"]]
    {
        assert!(!done(&lab, help).is_empty());
    }
}

#[test]
fn the_simulation_is_decided_by_its_seed() {
    let lab = lab();
    let simulated = json(&lab, &["simulate", "-o", "again.log", "--json"]);
    assert_keys(&simulated, "scans readings path_length_m");
    let read = |name: &str| fs::read(lab.path().join(name)).unwrap();
    assert_eq!(read("again.log"), read("whole.log"));
    done(&lab, &["simulate", "-o", "other.log.gz", "--seed", "2"]);
    let other = json(&lab, &["inspect", "other.log.gz", "--json"]);
    assert_ne!(other["points"], json(&lab, &["inspect", "whole.log", "--json"])["points"]);
}

#[test]
fn an_experiment_runs_on_a_log_that_no_registry_knows() {
    let lab = lab();
    let experiment = "seed = 1\nmeasures = [\"likelihood\"]\n[base]\ntolerance = 1e-2\nmax_iterations = 20\n\
        [[trials]]\nmap = [\"gbs+f-km\", \"rnd+f-km\"]\nsize = [5, 10]\ndraws = 2\n\
        [[views.charts]]\nname = \"chart\"\nx = { column = \"real_percent\" }\n\
        y = { column = \"log_likelihood\" }\n[[dataset]]\nname = \"intel-lab\"\n";
    fs::write(lab.path().join("small.toml"), experiment).unwrap();
    let run = ["run", "small.toml", "--dataset", "office.log", "-o", "out", "--json"];
    let ran = json(&lab, &run);
    assert_keys(&ran, "trials done failed");
    // Two sizes, two draws, grid and random.
    assert_eq!((&ran["done"], &ran["failed"]), (&Value::from(8), &Value::from(0)));
    let folder = lab.path().join("out/small/office");
    for name in ["manifest.json", "trials.csv", "summary.csv", "figures"] {
        assert!(folder.join(name).exists(), "{name}");
    }
    let rows = fs::read_to_string(folder.join("trials.csv")).unwrap();
    fs::remove_dir_all(folder.join("figures")).unwrap();
    done(&lab, &["plot", "out"]);
    assert!(fs::read_dir(folder.join("figures")).unwrap().count() > 0);
    // Done trials are not done again: even the seconds are the same.
    done(&lab, &run);
    assert_eq!(fs::read_to_string(folder.join("trials.csv")).unwrap(), rows);

    // None of the experiment's own data sets is at hand.
    let (_, stderr) = ends(&lab, &["run", "small.toml", "-o", "out"], 1);
    assert!(stderr.contains("intel-lab") && stderr.contains("fetch"), "{stderr}");
    fs::write(lab.path().join("small.toml"), experiment.replace("seed", "sead")).unwrap();
    let (_, stderr) = ends(&lab, &run, 1);
    assert!(stderr.contains("small.toml") && stderr.contains("sead"), "{stderr}");
}

#[test]
fn the_registry_says_what_is_not_at_hand() {
    let lab = lab();
    assert!(done(&lab, &["datasets", "list"]).contains("simulated-office"));
    let (_, stderr) = ends(&lab, &["inspect", "intel-lab"], 1);
    assert!(stderr.contains("fetch"), "{stderr}");
    let (_, stderr) = ends(&lab, &["inspect", "intel-lob"], 1);
    assert!(stderr.contains("intel-lab"), "{stderr}");
}
