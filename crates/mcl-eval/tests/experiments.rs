//! Experiments as a user runs them: rows, summaries and figures; interruptions, threads, refusals.

mod office;

use std::fs;
use std::path::Path;

use office::{Bench, LOCALIZATION, assert_same};

const LIKELIHOOD: &str = r#"
    kind = "likelihood"
    seed = 3
    sigma = 0.05
    tolerance = 1e-3
    max_iterations = 50
    sizes = [{ percent = [1, 5], repeats = 3 }]
    figures = { overview = 5, comparison = 2 }
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

fn bench() -> Bench {
    Bench::new(&[
        ("likelihood", LIKELIHOOD),
        ("localization", LOCALIZATION),
        ("sensitivity", SENSITIVITY),
    ])
}

fn rows(path: &Path) -> Vec<csv::StringRecord> {
    csv::Reader::from_path(path).unwrap().records().map(Result::unwrap).collect()
}

#[test]
fn likelihood_experiment() {
    let bench = bench();
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
        assert_same(&other, &one);
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
    let bench = bench();
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
    let bench = bench();
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
    let bench = bench();
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
    assert_same(&two, &one);

    let path = one.join("trials.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() / 3]).unwrap();
    bench.experiment("localization", "one", &["--threads", "7"]);
    assert_eq!(rows(&path), trials);
}

#[test]
fn sensitivity_study() {
    let bench = bench();
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
    assert_eq!((&ranking[0][0], &ranking[0][1]), ("sensor", "1"));

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
    let bench = bench();
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
