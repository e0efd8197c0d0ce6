//! Refined maps, and sizes and σ that the data chooses, as a user asks for them.

use std::fs;
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

/// A folder with scans of the simulated office as `office.log`, and in another order as `shuffled.log`.
fn lab(scans: usize) -> TempDir {
    let lab = tempfile::tempdir().unwrap();
    ends(&lab, &["simulate", "-o", "whole.log"], 0);
    let whole = fs::read_to_string(lab.path().join("whole.log")).unwrap();
    let lasers: Vec<&str> = whole.lines().filter(|line| line.starts_with("FLASER")).collect();
    let log = |order: &dyn Fn(usize) -> usize| -> String {
        (0..scans).map(|place| format!("{}\n", lasers[order(place) % scans])).collect()
    };
    fs::write(lab.path().join("office.log"), log(&|place| place)).unwrap();
    // 37 shares no factor with the number of scans.
    fs::write(lab.path().join("shuffled.log"), log(&|place| place * 37 + 5)).unwrap();
    lab
}

fn ends(lab: &TempDir, args: &[&str], code: i32) -> (String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
    let output = command.current_dir(lab.path()).env_remove("MCL_DATA_DIR").args(args).output();
    let output = output.unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
    (stdout, stderr)
}

/// `map LOG --init grid … --json`.
fn map(lab: &TempDir, log: &str, more: &str) -> Value {
    let mut args = vec!["map", log, "--reference", "recorded", "--init", "grid"];
    args.extend(more.split_whitespace());
    args.extend(["-o", "map.ply", "--json"]);
    serde_json::from_str(&ends(lab, &args, 0).0).unwrap()
}

#[test]
fn refinements_explain_the_data_better_than_fuzzy_k_means() {
    let lab = lab(60);
    let of = |method: &str| {
        let built = map(&lab, "office.log", &format!("--size 1% --refine {method}"));
        let steps = built["steps"].as_array().unwrap();
        assert_eq!(steps.len(), built["log_likelihood_trace"].as_array().unwrap().len());
        assert_eq!(steps[0]["stage"], "initial");
        built["log_likelihood_per_point"].as_f64().unwrap()
    };
    let plain = of("fkm");
    for method in ["split-merge --rounds 6", "best", "exchange"] {
        assert!(of(method) > plain, "{method}");
    }
    assert!(of("restarts --restarts 1").is_finite() && of("annealed").is_finite());
    let quick = map(&lab, "office.log", "--size 1% --refine best --refine-seconds 0");
    assert!(quick["map_points"].as_u64().unwrap() > 0 && quick["converged"] == false);
}

#[test]
fn the_size_does_not_depend_on_the_order_of_scans() {
    let lab = lab(60);
    for by in ["held-out", "bic", "mdl"] {
        let chosen = |log: &str| {
            let built = map(
                &lab,
                log,
                &format!("--size auto --auto-by {by} --max-iterations 20 --refine fkm"),
            );
            let chosen = &built["auto_size"];
            assert_eq!(chosen["by"], by);
            let tried = chosen["tried"].as_array().unwrap();
            let score = |tried: &Value| tried["score"].as_f64().unwrap();
            let best = tried.iter().min_by(|a, b| score(a).total_cmp(&score(b))).unwrap();
            assert_eq!(best["value"], chosen["value"]);
            let points = built["map_points"].as_f64().unwrap();
            assert!(points > 0.0 && points <= chosen["value"].as_f64().unwrap());
            chosen["value"].clone()
        };
        assert_eq!(chosen("office.log"), chosen("shuffled.log"), "{by}");
    }
}

#[test]
fn sigma_of_other_scans_is_wider_than_that_of_the_data_itself() {
    let lab = lab(60);
    let [own, others] = ["likelihood", "held-out"].map(|by| {
        let built = map(&lab, "office.log", &format!("--size 20% --sigma auto --auto-by {by}"));
        let sigma = built["sigma_m"].as_f64().unwrap();
        assert_eq!(built["auto_sigma"]["value"].as_f64(), Some(sigma));
        sigma
    });
    // The points are a few centimetres apart, with 1 cm of noise; few other scans saw the same walls.
    assert!((0.005..0.1).contains(&own) && own < others, "{own} {others}");
}

#[test]
fn combinations_that_mean_nothing_are_wrong_usage() {
    let lab = lab(5);
    for (more, said) in [
        ("--size 1% --refine fkm --rounds 3", "--rounds goes with"),
        ("--size 1% --refine best --restarts 3", "--restarts goes with"),
        ("--size 1% --refine best --no-snap", "--no-snap does not go with"),
        ("--size 1% --refine-seconds 3", "--refine"),
        ("--size auto --sigma auto", "do not go together"),
        ("--size auto --auto-by likelihood", "always likelier"),
        ("--size 1% --sigma auto --auto-by bic", "held-out or likelihood"),
        ("--size many", "not a map size"),
        ("--size 1% --sigma -1", "positive number or auto"),
    ] {
        let mut args = vec!["map", "office.log", "--init", "grid", "-o", "map.ply"];
        args.extend(more.split_whitespace());
        let (_, stderr) = ends(&lab, &args, 2);
        assert!(stderr.contains(said), "{more}: {stderr}");
    }
    // Too few scans to leave blocks out.
    let log = ["map", "office.log", "--reference", "recorded", "-o", "map.ply"];
    let stderr = ends(&lab, &[&log[..], &["--init", "grid", "--size", "auto"]].concat(), 1).1;
    assert!(stderr.contains("5 scans, expected at least 41"), "{stderr}");
}
