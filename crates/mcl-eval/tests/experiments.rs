//! Experiments as a user runs them: rows, summaries and figures; interruptions, threads, refusals.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const LIKELIHOOD: &str = r#"
    kind = "likelihood"
    seed = 3
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    sizes = [{ percent = [1, 5], repeats = 3 }]
    figures = { overview = 5, comparison = 2 }
"#;

const LOCALIZATION: &str = r#"
    kind = "localization"
    seed = 3
    runs = 4
    maps = 2
    splits = ["same", "held-out"]
    sizes = [5, 20]
    odometry_noise = { xy = 0.01, theta = 0.01 }
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    filter = { particles = 50, beams = 30 }
    figures = { trajectory = 5 }
"#;

const SENSITIVITY: &str = r#"
    kind = "sensitivity"
    seed = 3
    runs = 2
    odometry_noise = { xy = 0.01, theta = 0.01 }
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    filter = { particles = 50, beams = 30, z_rand = 0.1, alpha = [0.05, 0.05, 0.05, 0.05], proposal = "motion" }
    [[sweep]]
    name = "sensor"
    maps = [{ strategy = "gbs", percent = 5 }, { strategy = "gbs+f-km", percent = 5 }]
    sigma_hit = [0.1, 0.2]
    z_rand = [0.1, 0.5]
    [[sweep]]
    name = "motion"
    maps = [{ strategy = "gbs+f-km", percent = 5 }, { strategy = "all", percent = 100 }]
    sigma_hit = [0.2]
    alpha = [[0.05, 0.05, 0.05, 0.05], [0.1, 0.1, 0.1, 0.1]]
    proposal = ["motion", "adaptive"]
    [[dataset]]
    name = "office"
    scans = 30
"#;

/// A folder with the first scans of the simulated office as `office.log`, and experiments.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        bench.mcl_eval(&["simulate", "-o", "whole.log"]);
        let whole = fs::read_to_string(bench.path("whole.log")).unwrap();
        // Comment and parameter lines, then each scan with its two odometry lines.
        let head = whole.lines().position(|line| line.starts_with("FLASER")).unwrap();
        let lines: Vec<&str> = whole.lines().take(head + 3 * 40).collect();
        fs::write(bench.path("office.log"), lines.join("\n") + "\n").unwrap();
        fs::write(bench.path("likelihood.toml"), LIKELIHOOD).unwrap();
        fs::write(bench.path("localization.toml"), LOCALIZATION).unwrap();
        fs::write(bench.path("sensitivity.toml"), SENSITIVITY).unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_mcl-eval"))
            .args(arguments)
            .current_dir(self.folder.path())
            .output()
            .unwrap()
    }

    /// Runs a command that has to succeed, and returns its stdout.
    #[track_caller]
    fn mcl_eval(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    #[track_caller]
    fn experiment(&self, name: &str, root: &str, more: &[&str]) -> PathBuf {
        let definition = format!("{name}.toml");
        let mut arguments = vec!["run", &definition, "--dataset", "office.log", "-o", root];
        arguments.extend(more);
        self.mcl_eval(&arguments);
        self.path(root).join(name).join("office")
    }
}

/// The rows without the columns that measure time.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let is_time = |name: &str| name.ends_with("seconds");
    let keep: Vec<usize> = reader
        .headers()
        .unwrap()
        .iter()
        .enumerate()
        .filter(|(_, name)| !is_time(name))
        .map(|(i, _)| i)
        .collect();
    reader
        .records()
        .map(|record| keep.iter().map(|&i| record.as_ref().unwrap()[i].to_owned()).collect())
        .collect()
}

#[test]
fn likelihood_experiment() {
    let bench = Bench::new();
    let one = bench.experiment("likelihood", "one", &["--threads", "1"]);
    let trials = rows(&one.join("trials.csv"));
    assert_eq!(trials.len(), 2 * 2 * 3);
    assert_eq!(rows(&one.join("summary.csv")).len(), 2 * 2 * 2);
    assert_eq!(rows(&one.join("tests.csv")).len(), 2 * 2);
    for figure in ["figure1-maps", "figure2-sampling", "figure3-points", "figure4-likelihood"] {
        for ending in ["svg", "png"] {
            assert!(one.join("figures").join(format!("{figure}.{ending}")).is_file(), "{figure}");
        }
    }

    // The same bits for any number of threads.
    for threads in ["2", "7"] {
        let other = bench.experiment("likelihood", threads, &["--threads", threads]);
        assert_eq!(rows(&other.join("trials.csv")), trials);
        assert_eq!(rows(&other.join("summary.csv")), rows(&one.join("summary.csv")));
    }

    // The same bits after an interruption in the middle of a row.
    let path = one.join("trials.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() / 2]).unwrap();
    let again = bench.run(&["run", "likelihood.toml", "--dataset", "office.log", "-o", "one"]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("are there already"));
    assert_eq!(rows(&path), trials);

    // Figures are drawn again from saved rows alone, to the same bytes.
    let figure = one.join("figures/figure4-likelihood.png");
    let before = fs::read(&figure).unwrap();
    fs::remove_file(&figure).unwrap();
    fs::remove_file(bench.path("office.log")).unwrap();
    bench.mcl_eval(&["plot", "one"]);
    assert_eq!(fs::read(&figure).unwrap(), before);
}

#[test]
fn a_map_of_a_trial_can_be_built_again() {
    let bench = Bench::new();
    let folder = bench.experiment("likelihood", "results", &[]);
    let mut reader = csv::Reader::from_path(folder.join("trials.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    for record in reader.records() {
        let record = record.unwrap();
        let field = |name: &str| &record[header.iter().position(|column| column == name).unwrap()];
        let size = format!("{}%", field("size_percent"));
        let offset = format!("--offset={},{}", field("offset_x_m"), field("offset_y_m"));
        let how: &[&str] = match field("builder") {
            "rnd" => &["--init", "random", "--size", &size, "--seed", field("seed")],
            _ => &["--init", "grid", "--cell", field("cell_m"), &offset],
        };
        let arguments = [&["map", "office.log", "-o", "map.csv", "--json"], how].concat();
        let built: serde_json::Value = serde_json::from_str(&bench.mcl_eval(&arguments)).unwrap();
        assert_eq!(built["map_points"].to_string(), field("initial_points"));
        let found = built["log_likelihood_per_point"].as_f64().unwrap();
        let expected: f64 = field("initial_log_likelihood").parse().unwrap();
        assert!((found - expected).abs() < 1e-12 * expected.abs(), "{found} and {expected}");
    }
}

#[test]
fn rows_of_other_settings_are_not_mixed() {
    let bench = Bench::new();
    bench.experiment("likelihood", "results", &[]);
    fs::write(bench.path("likelihood.toml"), LIKELIHOOD.replace("0.05", "0.1")).unwrap();
    let arguments = ["run", "likelihood.toml", "--dataset", "office.log"];
    let refused = bench.run(&arguments);
    assert_eq!(refused.status.code(), Some(1));
    let message = String::from_utf8_lossy(&refused.stderr);
    assert!(message.contains("sigma") && message.contains("--fresh"), "{message}");
    bench.mcl_eval(&[&arguments[..], &["--fresh"]].concat());

    // More sizes may be added.
    let more = LIKELIHOOD.replace("0.05", "0.1").replace("[1, 5]", "[1, 5, 10]");
    fs::write(bench.path("likelihood.toml"), more).unwrap();
    let ran = bench.mcl_eval(&[&arguments[..], &["--json"]].concat());
    let ran: serde_json::Value = serde_json::from_str(&ran).unwrap();
    assert_eq!((ran["trials"].as_u64(), ran["failed"].as_u64()), (Some(18), Some(0)));
}

#[test]
fn localization_experiment() {
    let bench = Bench::new();
    let one = bench.experiment("localization", "one", &["--threads", "1"]);
    let trials = rows(&one.join("trials.csv"));
    // Per split: 4 runs on all points, and on each of 2 sizes by 4 strategies.
    assert_eq!(trials.len(), 2 * (4 + 2 * 4 * 4));
    assert_eq!(rows(&one.join("summary.csv")).len(), 2 * (1 + 2 * 4));
    assert_eq!(rows(&one.join("tests.csv")).len(), 2 * 2 * 4);
    for figure in [
        "figure5-localization-same",
        "figure5-localization-held-out",
        "trajectory",
        "trajectory-error",
    ] {
        assert!(one.join("figures").join(format!("{figure}.svg")).is_file(), "{figure}");
    }
    let two = bench.experiment("localization", "two", &["--threads", "2"]);
    assert_eq!(rows(&two.join("trials.csv")), trials);

    let path = one.join("trials.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() / 3]).unwrap();
    bench.experiment("localization", "one", &["--threads", "7"]);
    assert_eq!(rows(&path), trials);
}

#[test]
fn sensitivity_study() {
    let bench = Bench::new();
    let one = bench.experiment("sensitivity", "one", &["--threads", "1"]);
    let trials = rows(&one.join("trials.csv"));
    // 2 runs of 4 settings on 2 maps, in both sweeps; one setting and map is in both.
    assert_eq!(trials.len(), 2 * (4 * 2 + 4 * 2 - 1));
    let summary = rows(&one.join("summary.csv"));
    assert_eq!(summary.len(), trials.len() / 2);
    // The grid-based map before and after fuzzy k-means, per setting of the first sweep.
    assert_eq!(rows(&one.join("tests.csv")).len(), 4);
    let manifest = fs::read_to_string(one.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["dataset"]["scans"].as_u64(), Some(30));
    for figure in ["sensor", "motion"] {
        assert!(one.join("figures").join(format!("{figure}.svg")).is_file(), "{figure}");
    }
    // Every setting of both sweeps, the best first.
    let ranking = rows(&bench.path("one/sensitivity/ranking.csv"));
    assert_eq!(ranking.len(), 8);
    assert_eq!((&*ranking[0][0], &*ranking[0][1]), ("sensor", "1"));

    let two = bench.experiment("sensitivity", "two", &["--threads", "2"]);
    assert_eq!(rows(&two.join("trials.csv")), trials);
    let path = one.join("trials.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() / 3]).unwrap();
    bench.experiment("sensitivity", "one", &["--threads", "7"]);
    assert_eq!(rows(&path), trials);
}

#[test]
fn a_log_with_malformed_records_ends_with_exit_3() {
    let bench = Bench::new();
    let mut text = fs::read_to_string(bench.path("office.log")).unwrap();
    text.push_str("FLASER 180 1 2 3\n");
    fs::write(bench.path("office.log"), text).unwrap();
    let output = bench.run(&["run", "likelihood.toml", "--dataset", "office.log", "--json"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&output.stderr).contains("FLASER skipped"));
    let ran: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(ran["done"].as_u64(), Some(12));
}

/// The definitions in the repository are valid, and name data sets of the registry.
#[test]
fn the_repositorys_experiments() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments");
    let registry = mcl_datasets::registry::Registry::built_in().unwrap();
    let mut definitions = 0;
    for entry in fs::read_dir(root).unwrap() {
        let experiment = mcl_eval::experiment::Experiment::read(&entry.unwrap().path()).unwrap();
        for name in experiment.dataset_names() {
            registry.get(name).unwrap();
        }
        definitions += 1;
    }
    assert!(definitions >= 2);
}
