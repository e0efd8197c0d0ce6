//! `mcl-eval claims` as a user calls it, on result folders written by hand.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::process::{Command, Output};

use serde_json::{Value, json};
use tempfile::TempDir;

const CLAIMS: [&str; 17] = [
    "figure-1-size",
    "figure-2-size",
    "even-spread",
    "size-not-exact",
    "cost-of-grid",
    "points",
    "improvement",
    "improvement-shrinks",
    "strategy-above-10",
    "rnd-fkm-below-gbs",
    "localization-improved",
    "localization-most-on-small",
    "localization-gbs-over-rnd",
    "localization-no-gain",
    "localization-slightly-worse",
    "localization-recovers",
    "localization-diverges-below",
];

const VERDICTS: [&str; 3] = ["reproduced", "not reproduced", "not testable"];

/// A likelihood experiment on two data sets, a localization experiment on one of them, and one of a
/// kind that claims are not about.
fn results() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for dataset in ["intel-lab", "office"] {
        write(&folder, &format!("likelihood/{dataset}/manifest.json"), &likelihood(dataset));
        let rows = likelihood_rows(dataset);
        write(&folder, &format!("likelihood/{dataset}/trials.csv"), &rows);
    }
    write(&folder, "localization/office/manifest.json", &localization("office"));
    write(&folder, "localization/office/trials.csv", &localization_rows("office"));
    let other = json!({"kind": "sensitivity", "what": "of another time"}).to_string();
    write(&folder, "sensitivity/office/manifest.json", &other);
    folder
}

fn write(folder: &TempDir, path: &str, text: &str) {
    let path = folder.path().join(path);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

fn manifest(dataset: &str, kind: &str, definition: Value) -> String {
    let facts = json!({
        "name": dataset, "title": "A building", "sha256": "00", "scans": 910, "max_range": 10.0,
        "points": 155_648, "skipped_records": 0,
    });
    let manifest = json!({
        "experiment": kind, "kind": kind, "version": "0.1.0", "dataset": facts,
        "definition": definition,
    });
    manifest.to_string()
}

fn likelihood(dataset: &str) -> String {
    let definition = json!({
        "kind": "likelihood", "seed": 1, "sigma": 0.05, "tolerance": 1e-4, "max_iterations": 1000,
        "sizes": [{"percent": [1.0, 20.0], "repeats": 3}],
        "figures": {"overview": 0.8, "comparison": 0.25},
    });
    manifest(dataset, "likelihood", definition)
}

fn localization(dataset: &str) -> String {
    let definition = json!({
        "kind": "localization", "seed": 1, "runs": 4, "maps": 2, "splits": ["same"],
        "sizes": [0.1, 1.0, 2.0], "odometry_noise": {"xy": 0.01, "theta": 0.01}, "sigma": 0.05,
        "tolerance": 1e-4, "max_iterations": 1000, "figures": {"trajectory": 1.0},
    });
    manifest(dataset, "localization", definition)
}

/// Fuzzy k-means gains 3 nats per point at 1 % and nothing at 20 %.
fn likelihood_rows(dataset: &str) -> String {
    let mut text = "dataset,builder,size_percent,repeat,seed,data_points,requested_points,cell_m,\
                    offset_x_m,offset_y_m,initial_points,initial_log_likelihood,\
                    iterations,converged,fitted_log_likelihood,improved_points,\
                    improved_log_likelihood\n"
        .to_owned();
    for builder in ["gbs", "rnd"] {
        for (size, gain) in [(1.0, 3.0), (20.0, 0.0)] {
            for repeat in 0..3 {
                let initial = -60.0 / (size + 5.0) + 0.01 * f64::from(repeat);
                let improved = initial + gain;
                writeln!(
                    text,
                    "{dataset},{builder},{size},{repeat},1,155648,1556,,,,1556,{initial},10,\
                     true,{improved},1556,{improved}"
                )
                .unwrap();
            }
        }
    }
    text
}

/// The filter is lost in one run at 0.1 % only.
fn localization_rows(dataset: &str) -> String {
    let mut text =
        "dataset,split,strategy,size_percent,map,map_seed,run,data_points,map_points,scans,\
                    used_beams,weighted,translation,heading,translation_max,diverged,lost_episodes,\
                    recovered_episodes,mean_effective_sample_size,resamplings\n"
            .to_owned();
    for strategy in ["gbs", "gbs+f-km", "rnd", "rnd+f-km"] {
        for size in [0.1, 1.0, 2.0] {
            for run in 0..4 {
                let diverged = size == 0.1 && strategy == "rnd" && run == 1;
                let error = if diverged { 4.0 } else { 0.03 + 0.001 * f64::from(run) };
                writeln!(
                    text,
                    "{dataset},same,{strategy},{size},{},1,{run},155648,155,910,1000,{error},\
                     {error},0,{error},{diverged},0,0,250,10",
                    run % 2
                )
                .unwrap();
            }
        }
    }
    text
}

fn claims(folder: &TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mcl-eval"))
        .arg("claims")
        .args(arguments)
        .current_dir(folder.path())
        .env_remove("COLUMNS")
        .output()
        .unwrap()
}

#[track_caller]
fn stdout(output: Output) -> String {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    String::from_utf8(output.stdout).unwrap()
}

/// Stderr of a call that must fail.
#[track_caller]
fn failure(output: Output) -> String {
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stdout));
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

fn json(folder: &TempDir) -> Vec<Value> {
    let output: Value =
        serde_json::from_str(&stdout(claims(folder, &[".", "--json"]))).expect("one JSON object");
    output["claims"].as_array().unwrap().clone()
}

fn find<'a>(claims: &'a [Value], dataset: &str, id: &str) -> &'a Value {
    claims.iter().find(|claim| claim["dataset"] == dataset && claim["id"] == id).unwrap()
}

#[test]
fn every_data_set_gets_every_claim() {
    let found = json(&results());
    for dataset in ["intel-lab", "office"] {
        let of_dataset: Vec<&Value> =
            found.iter().filter(|claim| claim["dataset"] == dataset).collect();
        assert_eq!(of_dataset.len(), CLAIMS.len());
        let ids: BTreeSet<&str> =
            of_dataset.iter().map(|claim| claim["id"].as_str().unwrap()).collect();
        assert_eq!(ids, BTreeSet::from(CLAIMS));
    }
    for claim in &found {
        for key in ["dataset", "id", "statement", "measured", "test", "verdict", "section"] {
            assert!(claim[key].as_str().is_some_and(|text| !text.is_empty()), "{key} of {claim}");
        }
        assert!(VERDICTS.contains(&claim["verdict"].as_str().unwrap()), "{claim}");
        let p = &claim["p"];
        assert!(p.is_null() || p.as_f64().is_some_and(|p| (0.0..=1.0).contains(&p)), "{claim}");
        if claim["verdict"] == "not testable" {
            assert!(p.is_null(), "{claim}");
        }
        let split = if claim["section"] == "V-B" { json!("same") } else { Value::Null };
        assert_eq!(claim["split"], split, "{claim}");
    }
}

#[test]
fn verdicts_follow_from_the_rows() {
    let found = json(&results());
    for (dataset, id, verdict) in [
        ("intel-lab", "points", "reproduced"),
        ("office", "points", "not testable"),
        ("intel-lab", "even-spread", "not testable"),
        ("intel-lab", "size-not-exact", "not reproduced"),
        ("intel-lab", "improvement", "not reproduced"),
        ("intel-lab", "improvement-shrinks", "reproduced"),
        ("intel-lab", "localization-recovers", "not testable"),
        ("office", "localization-recovers", "reproduced"),
        ("office", "localization-diverges-below", "reproduced"),
        ("office", "localization-improved", "not reproduced"),
    ] {
        let claim = find(&found, dataset, id);
        assert_eq!(claim["verdict"], verdict, "{claim}");
    }
    let claim = find(&found, "intel-lab", "localization-recovers");
    assert_eq!(claim["measured"], "no localization experiment was run on this data set");
    assert_eq!(claim["experiment"], Value::Null);
    assert_eq!(find(&found, "office", "localization-recovers")["experiment"], "localization");
}

#[test]
fn text_and_markdown_hold_the_same_claims() {
    let folder = results();
    let text = stdout(claims(&folder, &[".", "-o", "claims.md"]));
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let markdown = fs::read_to_string(folder.path().join("claims.md")).unwrap();
    for id in CLAIMS {
        assert_eq!(markdown.matches(&format!("| `{id}` |")).count(), 2, "{id}");
    }
    let found = json(&folder);
    for claim in &found {
        assert!(markdown.contains(claim["measured"].as_str().unwrap()), "{claim}");
    }
    for dataset in ["intel-lab", "office"] {
        let counts = VERDICTS.map(|verdict| {
            let of_dataset = found.iter().filter(|claim| claim["dataset"] == dataset);
            let count = of_dataset.filter(|claim| claim["verdict"] == verdict).count();
            format!("{count} {verdict}")
        });
        let line = format!("{dataset}: {}", counts.join(", "));
        assert!(text.contains(&line) && markdown.contains(&line), "{line}\n{text}");
    }
}

#[test]
fn an_unfinished_experiment_is_not_testable() {
    let folder = results();
    let rows = likelihood_rows("office");
    let begun: Vec<&str> = rows.lines().filter(|line| !line.contains("rnd,20")).collect();
    write(&folder, "likelihood/office/trials.csv", &(begun.join("\n") + "\n"));
    fs::remove_file(folder.path().join("localization/office/trials.csv")).unwrap();
    let found = json(&folder);
    let claim = find(&found, "office", "improvement");
    assert_eq!(claim["measured"], "there is no map rnd 20 %");
    let claim = find(&found, "office", "localization-improved");
    assert_eq!(claim["verdict"], "not testable");
    assert!(claim["measured"].as_str().unwrap().contains("trials.csv is missing"), "{claim}");
    // Only the header is there yet.
    let header = localization_rows("office").lines().next().unwrap().to_owned() + "\n";
    write(&folder, "localization/office/trials.csv", &header);
    let found = json(&folder);
    assert_eq!(find(&found, "office", "localization-improved")["verdict"], "not testable");
}

#[test]
fn damaged_rows_are_an_error_that_names_the_line() {
    for (right, wrong, named) in
        [("gbs,1,2,", "gbs,one,2,", "line: 4"), ("true,-6.98", "true,-6.98,1", "line: 4")]
    {
        let folder = results();
        let rows = likelihood_rows("office");
        assert!(rows.contains(right), "{rows}");
        write(&folder, "likelihood/office/trials.csv", &rows.replacen(right, wrong, 1));
        let message = failure(claims(&folder, &["."]));
        assert!(message.contains("office/trials.csv") && message.contains(named), "{message}");
    }
    let folder = results();
    let rows = localization_rows("office").replacen(",0.031,", ",NaN,", 1);
    write(&folder, "localization/office/trials.csv", &rows);
    let message = failure(claims(&folder, &["."]));
    assert!(message.contains("trials.csv: line 3: weighted is NaN, expected"), "{message}");
}

#[test]
fn a_root_without_results_fails() {
    let folder = results();
    let message = failure(claims(&folder, &["nowhere"]));
    assert!(message.contains("nowhere"), "{message}");
    fs::create_dir(folder.path().join("empty")).unwrap();
    let message = failure(claims(&folder, &["empty"]));
    assert!(message.contains("no results, expected <experiment>/<data set>"), "{message}");
    // Results of other kinds alone.
    for kind in ["likelihood", "localization"] {
        fs::remove_dir_all(folder.path().join(kind)).unwrap();
    }
    let message = failure(claims(&folder, &[".", "--json"]));
    assert!(message.contains("results of other kinds only"), "{message}");
    let message = failure(claims(&results(), &[".", "-o", "no/such/folder.md"]));
    assert!(message.contains("cannot write no/such/folder.md"), "{message}");
}
