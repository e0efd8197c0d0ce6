//! The paper's experiments as a user runs them: rows, summaries and figures; interruptions, threads, edits.

use std::fs;
use std::path::Path;

use crate::office::{Bench, LOCALIZATION, assert_same, cut_rows, number, rows};
use mcl_study::study::definition::Study;

const LIKELIHOOD: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
sigma = 0.05
tolerance = 1e-3
max_iterations = 50
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [1, 5]
draws = 3
[views.summary]
columns = ["map_points", "log_likelihood"]
[[views.tests]]
y = "log_likelihood"
test = "welch"
pairs = [["gbs+f-km", "gbs"], ["rnd+f-km", "rnd"]]
[[views.pictures]]
name = "figure1-maps"
maps = [{ map = "all" }, { map = "gbs", size = 5, offset = "origin" }]
[[views.charts]]
name = "figure4-likelihood"
x = { column = "real_percent", scale = "log" }
y = { column = "log_likelihood", scale = "symlog" }
"#;

const SENSITIVITY: &str = r#"
seed = 3
[base]
sigma = 0.05
tolerance = 1e-3
max_iterations = 50
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 50
beams = 30
z_rand = 0.1
alpha = [0.05, 0.05, 0.05, 0.05]
proposal = "motion"
[[trials]]
name = "sensor"
map = ["gbs", "gbs+f-km"]
size = 5
sigma_hit = [0.1, 0.2]
z_rand = [0.1, 0.5]
draws = 2
runs = 1
[[trials]]
name = "motion"
map = ["gbs+f-km", "all"]
size = 5
sigma_hit = 0.2
alpha = [[0.05, 0.05, 0.05, 0.05], [0.1, 0.1, 0.1, 0.1]]
proposal = ["motion", "adaptive"]
draws = 2
runs = 1
[[dataset]]
name = "office"
scans = 30
[views.summary]
columns = ["weighted"]
[[views.tests]]
of = "sensor"
y = "weighted"
pairs = [["gbs+f-km", "gbs"]]
[views.ranking]
of = ["sensor", "motion"]
y = "weighted"
"#;

fn bench() -> Bench {
    Bench::new(&[
        ("likelihood", LIKELIHOOD),
        ("localization", LOCALIZATION),
        ("sensitivity", SENSITIVITY),
    ])
}

#[test]
fn likelihood_experiment() {
    let bench = bench();
    let one = bench.study("likelihood", "one", &["--threads", "1"]);
    let trials = rows(&one.join("trials.csv"));
    assert_eq!(trials.len(), 4 * 2 * 3);
    assert_eq!(rows(&one.join("summary.csv")).len(), 4 * 2);
    assert_eq!(rows(&one.join("tests.csv")).len(), 2 * 2);
    for figure in ["figure1-maps", "figure4-likelihood"] {
        for ending in ["svg", "png"] {
            assert!(one.join("figures").join(format!("{figure}.{ending}")).is_file(), "{figure}");
        }
    }

    // The same bits for any number of threads.
    for threads in ["2", "7"] {
        let other = bench.study("likelihood", threads, &["--threads", threads]);
        assert_same(&other, &one);
    }

    // The same bits after an interruption in the middle of a row.
    cut_rows(&one, 2);
    let again = bench.run(&["run", "likelihood.toml", "--dataset", "office.log", "-o", "one"]);
    assert!(String::from_utf8_lossy(&again.stderr).contains("are there already"));
    assert_same(&one, &bench.path("2/likelihood/office"));

    // Figures are drawn again from saved rows alone, to the same bytes.
    fs::remove_dir_all(one.join("figures")).unwrap();
    for table in ["trials.csv", "summary.csv", "tests.csv"] {
        fs::remove_file(one.join(table)).unwrap();
    }
    fs::remove_file(bench.path("office.log")).unwrap();
    bench.mcl_eval(&["plot", "one"]);
    assert_same(&one, &bench.path("2/likelihood/office"));
}

/// Figures for a paper stand beside the others, with every row that they show, and do not outlive their rows.
#[test]
fn figures_for_papers_have_all_their_rows() {
    let bench = bench();
    let folder = bench.study("likelihood", "results", &[]);
    let before = fs::read(folder.join("figures/figure4-likelihood.svg")).unwrap();
    bench.mcl_eval(&["plot", "results", "--style", "paper"]);
    let paper = folder.join("figures/paper");
    for figure in ["figure1-maps", "figure4-likelihood"] {
        for ending in ["svg", "png", "pdf", "txt", "csv"] {
            assert!(paper.join(format!("{figure}.{ending}")).is_file(), "{figure}.{ending}");
        }
    }
    assert!(!folder.join("figures/figure1-maps.csv").exists(), "coordinates of the data");
    assert_eq!(fs::read(folder.join("figures/figure4-likelihood.svg")).unwrap(), before);
    let points = rows(&paper.join("figure1-maps.csv"));
    let shown = |panel: &str| points.iter().filter(|row| row["panel"].starts_with(panel)).count();
    let trials = rows(&folder.join("trials.csv"));
    assert_eq!(shown("all data"), number(&trials[0], "data_points") as usize);
    assert!(points.iter().all(|row| row["what"] == "point" && number(row, "x").is_finite()));
    assert!((1..shown("all data")).contains(&shown("grid-based")), "{}", shown("grid-based"));
    let of_chart = rows(&paper.join("figure4-likelihood.csv"));
    assert_eq!(of_chart.len(), rows(&folder.join("summary.csv")).len());
    bench.run(&["run", "likelihood.toml", "--dataset", "office.log", "-o", "results"]);
    assert!(!paper.exists(), "figures of earlier rows");
}

#[test]
fn a_map_of_a_trial_can_be_built_again() {
    let bench = bench();
    let folder = bench.study("likelihood", "results", &[]);
    for row in rows(&folder.join("trials.csv")) {
        let size = format!("{}%", row["size_percent"]);
        let offset = format!("--offset={},{}", row["offset_x_m"], row["offset_y_m"]);
        let how: &[&str] = match row["map"].as_str() {
            // As studies call them.
            "rnd" => &["--init", "rnd", "--size", &size, "--seed", &row["map_seed"]],
            "gbs" => &["--init", "gbs", "--cell", &row["cell_m"], &offset],
            _ => continue,
        };
        let arguments = [&["map", "office.log", "-o", "map.csv", "--json"], how].concat();
        let built: serde_json::Value = serde_json::from_str(&bench.mcl_eval(&arguments)).unwrap();
        assert_eq!(built["map_points"].to_string(), row["map_points"]);
        let found = built["log_likelihood_per_point"].as_f64().unwrap();
        let expected = number(&row, "log_likelihood");
        assert!((found - expected).abs() < 1e-12 * expected.abs(), "{found} and {expected}");
    }
}

/// Rows of other settings stay where they are, but nothing is made of them.
#[test]
fn rows_of_other_settings_are_not_mixed() {
    let bench = bench();
    let folder = bench.study("likelihood", "results", &[]);
    let edited = LIKELIHOOD.replace("0.05", "0.1");
    fs::write(bench.path("likelihood.toml"), &edited).unwrap();
    bench.study("likelihood", "results", &[]);
    assert_same(&folder, &bench.study("likelihood", "fresh", &[]));

    // More sizes may be added: only theirs are run.
    fs::write(bench.path("likelihood.toml"), edited.replace("[1, 5]", "[1, 5, 10]")).unwrap();
    let arguments = ["run", "likelihood.toml", "--dataset", "office.log", "--json"];
    let ran = bench.run(&arguments);
    let message = String::from_utf8_lossy(&ran.stderr);
    assert!(message.contains("24 of 36 trials are there already"), "{message}");
    let json: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    let count = |key: &str| json[key].as_u64();
    assert_eq!([count("trials"), count("done"), count("failed")], [Some(36), Some(36), Some(0)]);

    // Of other readings they are refused, and --fresh removes them.
    let other = [&arguments[..], &["--max-range", "5"]].concat();
    let refused = bench.run(&other);
    assert_eq!(refused.status.code(), Some(1));
    let message = String::from_utf8_lossy(&refused.stderr);
    assert!(message.contains("max_range 10 m") && message.contains("--fresh"), "{message}");
    bench.mcl_eval(&[&other[..], &["--fresh"]].concat());
}

#[test]
fn localization_experiment() {
    let bench = bench();
    let one = bench.reproduced("localization");
    // Per split: 4 runs on all points, and on each of 2 sizes by 4 kinds of map.
    assert_eq!(rows(&one.join("trials.csv")).len(), 2 * (4 + 2 * 4 * 4));
    assert_eq!(rows(&one.join("summary.csv")).len(), 2 * (1 + 2 * 4));
    assert_eq!(rows(&one.join("tests.csv")).len(), 2 * 2 * 4);
    for figure in [
        "figure5-localization-same",
        "figure5-localization-alternate",
        "trajectory",
        "trajectory-error",
    ] {
        assert!(one.join("figures").join(format!("{figure}.svg")).is_file(), "{figure}");
    }
}

#[test]
fn sensitivity_study() {
    let bench = bench();
    let one = bench.reproduced("sensitivity");
    let trials = rows(&one.join("trials.csv"));
    // 2 runs of 4 settings on 2 maps, in both entries; one setting and map is in both.
    assert_eq!(trials.len(), 2 * (4 * 2 + 4 * 2 - 1));
    assert_eq!(trials.iter().filter(|row| row["trials"] == "sensor motion").count(), 2);
    // The grid-based map before and after fuzzy k-means, per setting of the first entry.
    assert_eq!(rows(&one.join("tests.csv")).len(), 4);
    let manifest = fs::read_to_string(one.join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["identity"]["data"]["scans"].as_u64(), Some(30));
    // Every setting of both entries, the best first.
    let ranking = rows(&bench.path("one/sensitivity/ranking.csv"));
    assert_eq!(ranking.len(), 8);
    assert_eq!((&*ranking[0]["trials"], &*ranking[0]["rank"]), ("sensor", "1"));
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
    assert_eq!(ran["done"].as_u64(), Some(24));
}

/// The studies in the repository are valid, and name data sets of the registry.
#[test]
fn the_repositorys_experiments() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments");
    let registry = mcl_datasets::registry::Registry::built_in().unwrap();
    let mut studies = 0;
    for folder in [root.clone(), root.join("examples")] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                continue;
            }
            for name in Study::read(&path).unwrap().dataset_names() {
                registry.get(name).unwrap();
            }
            studies += 1;
        }
    }
    assert!(studies >= 13, "{studies}");
}

/// A study that is built in is taken by its name in any folder, and its results are those of its file.
#[test]
fn a_built_in_study_is_taken_by_its_name() {
    let bench = Bench::with_scans(5, &[]);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments/examples/my-log.toml");
    let of = |study: &str, root: &str| {
        bench.mcl_eval(&["run", study, "--dataset", "office.log", "-o", root, "--quiet"]);
        bench.path(root).join("my-log").join("office")
    };
    let by_name = of("my-log", "name");
    let by_file = of(file.to_str().unwrap(), "file");
    assert_same(&by_name, &by_file);
    assert_eq!(
        fs::read_to_string(by_name.join("study.toml")).unwrap(),
        fs::read_to_string(&file).unwrap()
    );
    let status = bench.mcl_eval(&["status", "name"]);
    assert!(status.contains("my-log"), "{status}");
}

#[test]
fn plan_and_list_take_a_built_in_study_and_the_script_names_it() {
    let bench = Bench::with_scans(5, &[]);
    let listed = bench.mcl_eval(&["run", "likelihood", "--list", "--dataset", "office.log"]);
    assert!(listed.contains("trials, "), "{listed}");
    let arguments = ["plan", "likelihood", "--parts", "2", "--engine", "parallel"];
    let script = bench.mcl_eval(&[&arguments[..], &["--dataset", "office.log"]].concat());
    assert!(script.contains("mcl-eval run likelihood --dataset office.log"), "{script}");
}

/// A file comes before built-in studies; a folder is not a study.
#[test]
fn a_file_hides_the_built_in_study_of_its_name() {
    let bench = bench();
    fs::copy(bench.path("localization.toml"), bench.path("likelihood")).unwrap();
    let listed = bench.mcl_eval(&["run", "likelihood", "--list", "--dataset", "office.log"]);
    assert!(listed.contains("36 trials, "), "{listed}");
    fs::create_dir(bench.path("global")).unwrap();
    let output = bench.run(&["run", "global", "--dataset", "office.log"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr.contains("global is a folder, expected the file of a study"), "{stderr}");
}

#[test]
fn an_unknown_study_is_answered_with_the_nearest_and_all_that_are_known() {
    let bench = Bench::new(&[]);
    let fails = |study: &str| {
        let output = bench.run(&["run", study, "--dataset", "office.log"]);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8_lossy(&output.stderr).replace('\n', " ")
    };
    let message = fails("likelyhood");
    assert!(message.contains("did you mean likelihood?"), "{message}");
    assert!(message.contains("choices, choices-grid, consistency,"), "{message}");
    assert!(!fails("quite-another").contains("did you mean"));
    // What is meant as a file is none of the built-in ones.
    for file in ["likelihood.toml", "./likelihood"] {
        let message = fails(file);
        assert!(message.contains("cannot read study"), "{message}");
    }
    let message = fails("localizers");
    assert!(message.contains("run experiments/localizers.toml in the repository"), "{message}");
    let help = bench.mcl_eval(&["run", "--help"]);
    assert!(
        help.contains("Built-in studies") && help.contains("global: How small may a map be"),
        "{help}"
    );
}
