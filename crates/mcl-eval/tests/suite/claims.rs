//! `mcl-eval claims` as a user calls it, on result folders whose rows are planted.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use mcl_study::data::facts::DataFacts;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{OwnPart, PARTS, SavedTrial};
use mcl_study::store::results::{MANIFEST, Manifest, STUDY};
use mcl_study::study::definition::Study;
use mcl_study::table::{Cells, Value};
use serde_json::Value as Json;
use tempfile::TempDir;

const LIKELIHOOD: &str = r#"seed = 1
measures = ["likelihood"]
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [1, 20]
draws = 3
[[dataset]]
name = "elsewhere"
"#;

const LOCALIZATION: &str = r#"seed = 1
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [0.1, 1, 2]
draws = 2
runs = 2
"#;

/// A study of likelihood on two data sets, one of localization on one of them, and a folder as those that
/// are committed: without rows.
fn results() -> TempDir {
    let root = tempfile::tempdir().unwrap();
    for dataset in ["intel-lab", "office"] {
        plant(&root, "likelihood", LIKELIHOOD, dataset, true);
    }
    plant(&root, "localization", LOCALIZATION, "office", true);
    plant(&root, "localization", LOCALIZATION, "intel-lab", false);
    root
}

fn folder(root: &TempDir, study: &str, dataset: &str) -> PathBuf {
    root.path().join(study).join(dataset)
}

/// The rows of a study, if any: fuzzy k-means gains 3 nats per point at 1 % and nothing at
/// 20 %, the filter is lost in one run at 0.1 % only.
fn plant(root: &TempDir, name: &str, text: &str, dataset: &str, with_rows: bool) {
    let folder = folder(root, name, dataset);
    fs::create_dir_all(&folder).unwrap();
    let data = DataFacts {
        name: dataset.into(),
        title: "A building".into(),
        sha256: "00".into(),
        dimensions: 2,
        scans: 910,
        max_range: Some(10.0),
        points: 155_648,
        skipped_records: 0,
    };
    let identity = Identity { build: Build::this(), data };
    let manifest = Manifest { study: name.into(), identity: identity.clone() };
    fs::write(folder.join(MANIFEST), manifest.to_text().unwrap()).unwrap();
    fs::write(folder.join(STUDY), text).unwrap();
    let study = Study::parse(text).unwrap();
    let mut part = OwnPart::new(&folder, &identity);
    for trial in study.plan(dataset).unwrap().trials.iter().filter(|_| with_rows) {
        let mut rows: Vec<Cells> = vec![trial.map.cells()];
        if !trial.runs.is_empty() {
            rows = trial
                .runs
                .iter()
                .map(|run| [trial.map.cells(), run.cells().unwrap()].concat())
                .collect();
        }
        let measured = |mut cells: Cells| {
            let get =
                |name: &str| cells.iter().find(|(column, _)| column == name).unwrap().1.clone();
            let (map, size) = (get("map").to_string(), get("size_percent").number().unwrap());
            let draw = f64::from(trial.map.draw);
            let gain = if map.ends_with("+f-km") && size == 1.0 { 3.0 } else { 0.0 };
            let lost = size == 0.1 && map == "rnd" && draw == 1.0;
            let error = if lost { 4.0 } else { 0.03 + 0.001 * draw };
            let values: [(&str, Value); 5] = [
                ("requested_points", 1556u32.into()),
                ("map_points", 1556u32.into()),
                ("log_likelihood", (-60.0 / (size + 5.0) + 0.01 * draw + gain).into()),
                ("weighted", error.into()),
                ("diverged", lost.into()),
            ];
            cells.extend(values.map(|(column, value)| (column.to_owned(), value)));
            cells
        };
        let identities = trial.identities(&study.measures).unwrap();
        let rows = identities.into_iter().zip(rows.into_iter().map(measured)).collect();
        part.save(Ok(SavedTrial::new(trial.map.to_string(), rows, Vec::new()))).unwrap();
    }
}

fn claims(root: &TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mcl-eval"))
        .arg("claims")
        .args(arguments)
        .current_dir(root.path())
        .env_remove("COLUMNS")
        .output()
        .unwrap()
}

/// Stdout and stderr of a call that ends with this code.
#[track_caller]
fn output(root: &TempDir, arguments: &[&str], code: i32) -> [String; 2] {
    let output = claims(root, arguments);
    let [stdout, stderr] =
        [output.stdout, output.stderr].map(|out| String::from_utf8(out).unwrap());
    assert_eq!(output.status.code(), Some(code), "{stdout}\n{stderr}");
    [stdout, stderr]
}

/// The claims of a call that ends with this code, and stderr.
#[track_caller]
fn json(root: &TempDir, code: i32) -> (Vec<Json>, String) {
    let [stdout, stderr] = output(root, &[".", "--json"], code);
    let found: Json = serde_json::from_str(&stdout).expect("one JSON object");
    (found["claims"].as_array().unwrap().clone(), stderr)
}

fn find<'a>(claims: &'a [Json], dataset: &str, id: &str) -> &'a Json {
    claims.iter().find(|claim| claim["dataset"] == dataset && claim["id"] == id).unwrap()
}

#[test]
fn text_markdown_and_json_hold_the_same_claims() {
    let root = results();
    let [text, _] = output(&root, &[".", "-o", "claims.md", "--verbose"], 0);
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let markdown = fs::read_to_string(root.path().join("claims.md")).unwrap();
    let (found, _) = json(&root, 0);
    assert_eq!(found.len(), 17 + 10);
    for claim in &found {
        let id = format!("| `{}` |", claim["id"].as_str().unwrap());
        assert!(markdown.contains(&id), "{id}");
        let measured = claim["measured"].as_str().unwrap();
        assert!(markdown.replace('\\', "").contains(measured), "{claim}");
    }
    for dataset in ["intel-lab", "office"] {
        let counts = ["reproduced", "not reproduced", "not testable"].map(|verdict| {
            let of_dataset = found.iter().filter(|claim| claim["dataset"] == dataset);
            format!("{} {verdict}", of_dataset.filter(|claim| claim["verdict"] == verdict).count())
        });
        let line = format!("{dataset}: {}", counts.join(", "));
        assert!(text.contains(&line) && markdown.contains(&line), "{line}\n{text}");
    }
    assert_eq!(find(&found, "office", "improvement-shrinks")["verdict"], "reproduced");
    assert_eq!(find(&found, "intel-lab", "points")["verdict"], "reproduced");
    // Folders without rows are no results.
    let missing = "No results of elsewhere, which the studies list as well.";
    assert!(text.contains(missing) && markdown.contains(missing), "{text}");
    assert!(text.contains("intel-lab: No study says anything on localization"), "{text}");
}

/// Fault: hundreds of lines, most of them of what was not tested.
#[test]
fn the_brief_summary_fits_a_screen() {
    let root = results();
    let [text, stderr] = output(&root, &["."], 0);
    assert!((10..=30).contains(&text.lines().count()), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let (found, _) = json(&root, 0);
    let decided = |id: &str| {
        let mut of_claim = found.iter().filter(|claim| claim["id"] == id);
        of_claim.any(|claim| claim["verdict"] != "not testable")
    };
    let of_claims = text.lines().filter(|line| line.get(1..2) == Some("/"));
    let ids = found.iter().map(|claim| claim["id"].as_str().unwrap());
    let ids: std::collections::BTreeSet<&str> = ids.filter(|id| decided(id)).collect();
    assert_eq!(of_claims.count(), ids.len(), "{text}");
    for part in ["gbs is grid-based", "--verbose", "mean error d (diverged runs)", "elsewhere"] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(stderr.contains("without rows left out"), "{stderr}");
}

/// One torn folder once stopped all others.
#[test]
fn a_damaged_folder_stops_no_other() {
    let root = results();
    fs::write(folder(&root, "likelihood", "office").join(MANIFEST), "{").unwrap();
    let (found, stderr) = json(&root, 3);
    assert!(stderr.contains("likelihood/office") && stderr.contains(MANIFEST), "{stderr}");
    assert_eq!(found.iter().filter(|claim| claim["dataset"] == "intel-lab").count(), 10);
    assert_eq!(found.iter().filter(|claim| claim["dataset"] == "office").count(), 3 + 7);
    // A damaged row is missing, and named.
    let root = results();
    let parts = folder(&root, "localization", "office").join(PARTS);
    let part = fs::read_dir(parts).unwrap().next().unwrap().unwrap().path();
    let rows = fs::read_to_string(&part).unwrap();
    let lines: Vec<&str> = rows.lines().collect();
    let damaged = [&lines[..3], &["{\"trial\": 1}"], &lines[4..]].concat().join("\n") + "\n";
    fs::write(&part, damaged).unwrap();
    let (found, stderr) = json(&root, 3);
    assert!(stderr.contains("line 4"), "{stderr}");
    let measured = &find(&found, "office", "localization-improved")["measured"];
    assert_eq!(measured, "23 of 24 trials are there");
    // A torn last row is no damage, but it is missing.
    let torn = rows.len() - 5;
    fs::write(&part, &rows[..torn]).unwrap();
    let [text, stderr] = output(&root, &["."], 3);
    assert!(stderr.contains("localization/office: 23 of 24 trials have rows"), "{stderr}");
    assert!(text.contains("localization/office, 23 of 24 trials are there"), "{text}");
}

#[test]
fn a_root_without_rows_of_claims_fails() {
    let root = results();
    let failure = |arguments: &[&str]| {
        let [stdout, stderr] = output(&root, arguments, 1);
        assert_eq!(stdout, "");
        stderr
    };
    let message = failure(&["nowhere"]);
    assert!(message.contains("nowhere"), "{message}");
    fs::create_dir(root.path().join("empty")).unwrap();
    let message = failure(&["empty"]);
    assert!(message.contains("no results, expected <study>/<data set>"), "{message}");
    let message = failure(&[".", "-o", "no/such/folder.md"]);
    assert!(message.contains("cannot write no/such/folder.md"), "{message}");
    // Results of other kinds alone.
    for study in ["likelihood", "localization"] {
        fs::remove_dir_all(root.path().join(study)).unwrap();
    }
    let other = LOCALIZATION.replace(r#", "rnd", "rnd+f-km""#, "");
    plant(&root, "other", &other, "office", true);
    let message = failure(&[".", "--json"]);
    assert!(message.contains("no rows that the claims are about"), "{message}");
}
