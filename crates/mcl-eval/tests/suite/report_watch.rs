//! Runs to watch and maps to compare: what is chosen, computed again, and held against the rows.

use std::fs;
use std::path::PathBuf;

use crate::office::{Bench, number, rows};
use mcl_eval::report::exhibits::{
    ExhibitRequest, Exhibits, PageBudget, PageExhibit, localized, recorded_folders, repeat,
};
use mcl_eval::report::record::{MOST_FRAMES, RecordedRun};
use mcl_eval::report::watch::{self, Watch};
use mcl_study::store::results::{Results, read_all};
use mcl_study::study::definition::Study;
use mcl_study::table::Table;

/// Maps of two sizes, of which a picture shows one: two draws with two runs each.
const SMALL: &str = r#"
seed = 3
[base]
sigma = 0.05
tolerance = 1e-3
max_iterations = 50
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 50
beams = 30
[[trials]]
map = ["gbs", "gbs+f-km"]
size = [1, 5]
draws = 2
runs = 2
[[views.pictures]]
name = "trajectory"
maps = [{ map = "gbs+f-km", size = 5 }]
run = 0
"#;

/// All of the simulated office, small maps and few particles.
const WHOLE: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
sigma = 0.05
tolerance = 1e-2
max_iterations = 20
odometry_noise = { xy = 0.01, theta = 0.01 }
particles = 60
beams = 30
[[trials]]
map = ["gbs", "gbs+f-km"]
size = [0.2, 1]
draws = 1
runs = 3
"#;

/// The results of a study on the first scans of the office, as `office.log`.
fn small() -> (Bench, Vec<Results>) {
    let bench = Bench::new(&[("localization", SMALL)]);
    bench.mcl_eval(&["run", "localization.toml", "--dataset", "office.log", "-o", "results", "-q"]);
    let results = read_all(&bench.path("results")).unwrap().results;
    assert_eq!(results.len(), 1);
    (bench, results)
}

fn shown(results: &[Results], logs: &[String]) -> Vec<Exhibits> {
    let wanted: Vec<ExhibitRequest> =
        results.iter().map(|results| ExhibitRequest::of(results).unwrap()).collect();
    repeat(&wanted, logs, &mut PageBudget::default(), true)
}

/// Of the one folder below a root where runs were recorded; and the files that cannot be read.
fn recorded_in(bench: &Bench, root: &str) -> (PageExhibit<Watch>, Vec<(PathBuf, String)>) {
    let folders = recorded_folders(&bench.path(root));
    assert_eq!(folders, [bench.path("root/inside/out")], "{root}");
    let mut damaged = Vec::new();
    let shown = localized(&folders[0], &mut PageBudget::default(), &mut damaged).unwrap();
    (shown, damaged)
}

#[test]
fn best_median_and_worst_are_computed_again_and_come_out_as_their_rows() {
    let (bench, results) = small();
    let log = bench.path("office.log").display().to_string();
    let shown = shown(&results, std::slice::from_ref(&log));
    let watch = &shown[0].runs.as_ref().unwrap().as_ref().unwrap().what;
    let table = rows(&bench.path("results/localization/office/trials.csv"));
    let mut errors: Vec<f64> = table
        .iter()
        .filter(|row| {
            let is = |column: &str, value: &str| row[column] == value;
            is("map", "gbs+f-km") && is("size_percent", "5") && is("split", "same")
        })
        .map(|row| number(row, "weighted"))
        .collect();
    errors.sort_by(f64::total_cmp);
    assert_eq!(errors.len(), 4);
    let found: Vec<(&str, f64)> =
        watch.runs.iter().map(|shown| (shown.role, shown.run.mean_errors.unwrap()[0])).collect();
    let expected = [("best", errors[0]), ("median", errors[1]), ("worst", errors[3])];
    for ((role, error), (expected_role, expected)) in found.iter().zip(expected) {
        assert_eq!(*role, expected_role);
        assert!((error - expected).abs() < 1e-12, "{role}: {error}, {expected}");
    }
    assert_eq!(found.len(), 3);
    assert!(watch.rule.starts_with("Of 4 runs on gbs+f-km 5 %"), "{}", watch.rule);
    assert!(watch.rule.contains("smallest, the median") && watch.rule.contains("weighted error d"));
    for shown in &watch.runs {
        assert_eq!((shown.run.frames, shown.run.scans), (40, 40));
        let label = &shown.run.label;
        assert!(label.starts_with("gbs+f-km 5 %, draw ") && label.contains(", run "), "{label}");
        assert!(watch.describe().contains(label.as_str()));
    }
    // What the page carries is what can be read again.
    let run = &watch.runs[0].run;
    assert_eq!(RecordedRun::parse(&run.to_json().unwrap()).unwrap(), *run);
}

/// A page must not show a run that is not the one of its row.
#[test]
fn a_run_that_comes_out_otherwise_is_not_shown() {
    let (bench, mut results) = small();
    let table = &results[0].table;
    let mut changed = Table::new(table.columns().to_vec());
    for row in table.rows() {
        let value = |column: &String| match (column.as_str(), row.number("weighted")) {
            ("weighted", Some(error)) => (error * (1.0 + 1e-15)).next_up().into(),
            _ => row.get(column).clone(),
        };
        changed.push(table.columns().iter().map(value).collect());
    }
    results[0].table = changed;
    let log = bench.path("office.log").display().to_string();
    let shown = shown(&results, &[log]);
    let reason = shown[0].runs.as_ref().unwrap().as_ref().unwrap_err();
    assert!(reason.contains("weighted comes out as") && reason.contains("row says"), "{reason}");
}

#[test]
fn a_missing_or_different_log_is_reported() {
    let (bench, results) = small();
    let found = shown(&results, &[]);
    let reason = found[0].runs.as_ref().unwrap().as_ref().unwrap_err();
    assert!(reason.contains("log is not at hand") && reason.contains("\"office\""), "{reason}");

    // The name opens nothing by itself, wherever the program runs.
    let whole = fs::read_to_string(bench.path("office.log")).unwrap();
    let path = bench.path("other/office.log");
    fs::create_dir(bench.path("other")).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    fs::write(&path, lines[..lines.len() - 3].join("\n") + "\n").unwrap();
    let found = shown(&results, &[path.display().to_string()]);
    let reason = found[0].runs.as_ref().unwrap().as_ref().unwrap_err();
    assert!(reason.contains("computed from other data"), "{reason}");
}

#[test]
fn rows_of_another_build_are_not_repeated() {
    let (bench, _) = small();
    let path = bench.path("results/localization/office/manifest.json");
    let text = fs::read_to_string(&path).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
    let sources = manifest["identity"]["build"]["sources"].as_str().unwrap();
    let results = read_all(&bench.path("results")).unwrap().results;
    fs::write(&path, text.replace(sources, "0123456789abcdef")).unwrap();
    let log = bench.path("office.log").display().to_string();
    let found = shown(&results, &[log]);
    let reason = found[0].runs.as_ref().unwrap().as_ref().unwrap_err();
    assert!(reason.contains("were computed by build"), "{reason}");
}

#[test]
fn a_whole_log_fits_the_page_and_its_maps_are_those_of_the_rows() {
    let bench = Bench::new(&[("whole", WHOLE)]);
    bench.mcl_eval(&["run", "whole.toml", "--dataset", "simulated-office", "-o", "results", "-q"]);
    let results = read_all(&bench.path("results")).unwrap().results;
    // A data set of the registry needs no path.
    let found = shown(&results, &[]);
    let runs = found[0].runs.as_ref().unwrap().as_ref().unwrap();
    assert!(runs.slot.json.len() < 300_000, "{} bytes", runs.slot.json.len());
    assert_eq!(runs.what.runs.len(), 3);
    for shown in &runs.what.runs {
        let run = &shown.run;
        assert_eq!((run.frames, run.particles, run.is_stamped), (MOST_FRAMES, 40, true));
        assert!(run.scans > run.frames && run.beams > 20 && run.map_points == run.map_size);
        assert!(run.label.starts_with("gbs+f-km 1 %"), "{}", run.label);
    }
    let maps = found[0].maps.as_ref().unwrap().as_ref().unwrap();
    assert!(maps.slot.json.len() < 100_000, "{} bytes", maps.slot.json.len());
    let pair = &maps.what;
    assert_eq!([&pair.maps[0].label, &pair.maps[1].label], ["gbs 1 %", "gbs+f-km 1 %"]);
    let table = rows(&bench.path("results/whole/simulated-office/trials.csv"));
    for (map, kind) in pair.maps.iter().zip(["gbs", "gbs+f-km"]) {
        let of_map = |row: &&std::collections::BTreeMap<String, String>| {
            row["map"] == kind && row["size_percent"] == "1"
        };
        let row = table.iter().find(of_map).unwrap();
        assert_eq!(map.log_likelihood, number(row, "log_likelihood"));
        assert_eq!(map.size as f64, number(row, "map_points"));
    }
    // The shown points are a fair sample: their mean is that of all.
    assert!(pair.points == 6_000 && pair.all_points > 100_000 && pair.low < pair.high);
    assert!(pair.maps[0].below > pair.maps[1].below, "refined maps leave less unexplained");
}

#[test]
fn runs_that_localize_recorded_are_shown_and_damaged_ones_reported() {
    let bench = Bench::new(&[]);
    bench.mcl_eval(&["map", "office.log", "--init", "grid", "--size", "5%", "-o", "map.csv", "-q"]);
    let localize = ["localize", "office.log", "--map", "map.csv", "--particles", "60"];
    let more = ["--runs", "4", "-o", "root/inside/out", "-q"];
    bench.mcl_eval(&[&localize[..], &more].concat());
    for root in ["root", "root/inside/out"] {
        let (PageExhibit { what: watch, .. }, damaged) = recorded_in(&bench, root);
        assert!(damaged.is_empty(), "{damaged:?}");
        let roles: Vec<&str> = watch.runs.iter().map(|shown| shown.role).collect();
        assert_eq!(roles, ["best", "median", "worst"]);
        let errors: Vec<f64> =
            watch.runs.iter().map(|shown| shown.run.mean_errors.unwrap()[0]).collect();
        assert!(errors.is_sorted(), "{errors:?}");
        // The same figures as in the error rows.
        let label = &watch.runs[0].run.label;
        let number_of_run = label.rsplit(' ').next().unwrap().parse::<u32>().unwrap();
        let table = rows(&bench.path(&format!("root/inside/out/run-{number_of_run:03}.csv")));
        let mean =
            table.iter().map(|row| number(row, "weighted")).sum::<f64>() / table.len() as f64;
        assert!((errors[0] / mean - 1.0).abs() < 1e-9, "{label}: {} {mean}", errors[0]);
    }

    let path = bench.path("root/inside/out/run-002.watch.json");
    let text = fs::read_to_string(&path).unwrap();
    let mut run: serde_json::Value = serde_json::from_str(&text).unwrap();
    let frames = run["frames"].as_u64().unwrap();
    for (key, value, expected) in [
        ("frames", (frames + 1).into(), "data holds"),
        ("frames", 1_000_000.into(), "frames is 1000000"),
        ("data", "no base64!".into(), "not base64"),
        ("format", "other".into(), "format is \"other\""),
        ("origin", serde_json::json!([1e300, "<script>"]), "invalid type"),
    ] {
        let before = std::mem::replace(&mut run[key], value);
        fs::write(&path, run.to_string()).unwrap();
        // The others are shown.
        let (shown, damaged) = recorded_in(&bench, "root");
        assert!(shown.what.rule.starts_with("Of 3 runs of localize"), "{}", shown.what.rule);
        let [(file, reason)] = &damaged[..] else { panic!("{damaged:?}") };
        assert!(*file == path && reason.contains(expected), "{reason}");
        run[key] = before;
    }
    let output = bench.run(&["report", "root", "-o", "page.html"]);
    assert_eq!(output.status.code(), Some(3));
    let page = fs::read_to_string(bench.path("page.html")).unwrap();
    assert!(page.contains("Left out: ") && page.contains("run-002.watch.json: "));
}

/// The page has what was recorded, computed again or not shown, beside what else it says.
#[test]
fn the_page_has_runs_and_maps() {
    let (bench, _) = small();
    bench.mcl_eval(&["map", "office.log", "--init", "grid", "--size", "5%", "-o", "map.csv", "-q"]);
    let localize = ["localize", "office.log", "--map", "map.csv", "--particles", "60"];
    bench.mcl_eval(&[&localize[..], &["-o", "out", "-q"]].concat());
    let page = |arguments: &[&str]| {
        bench.mcl_eval(&[&["report", "-o", "page.html", "-q"], arguments].concat());
        fs::read_to_string(bench.path("page.html")).unwrap()
    };
    let slots = |page: &str| {
        [r#"<div class="watch" data-run=""#, r#"<div class="compare-maps" data-maps=""#]
            .map(|slot| page.matches(slot).count())
    };
    let with_log = page(&["results", "out", "--log", "office.log"]);
    assert_eq!(slots(&with_log), [2, 1]);
    assert!(
        with_log.contains("Of 4 runs on gbs+f-km 5 %") && !with_log.contains("No runs are shown")
    );
    let without = page(&["results"]);
    assert_eq!(slots(&without), [0, 0]);
    assert!(without.contains("No runs are shown: its log is not at hand"));
    // A folder of localize needs no results beside it.
    let of_localize = page(&["out"]);
    assert_eq!(slots(&of_localize), [1, 0]);
    // It says what was run, and has no empty sections.
    for part in [
        "1 folder of localize",
        "href=\"#localized\"",
        "map map.csv: ",
        ", 60 particles, ",
        "Mean weighted error d ",
        "mcl-eval localize office.log --map=map.csv --particles=60 -o out",
    ] {
        assert!(of_localize.contains(part), "{part}");
    }
    for part in ["0 studies", "id=\"answer\"", "id=\"claims\"", "class=\"run\""] {
        assert!(!of_localize.contains(part), "{part}");
    }
    let run = bench.path("out/run-000.watch.json");
    let before = fs::read(&run).unwrap();
    assert!(!bench.run(&["report", "out", "-o", "out/run-000.watch.json"]).status.success());
    assert_eq!(fs::read(&run).unwrap(), before);
    assert!(!bench.run(&["report", "nothing-here", "-o", "page.html"]).status.success());
    fs::remove_file(run).unwrap();
    let without = bench.run(&["report", "out", "-o", "page.html"]);
    let stderr = String::from_utf8_lossy(&without.stderr);
    assert!(stderr.contains("no runs to watch (run-NNN.watch.json)"), "{stderr}");
}

/// Nobody knows that a program of others does the same again.
#[test]
fn runs_of_programs_alone_are_not_shown() {
    let text = "seed = 1\n[localizer.theirs]\ncommand = [\"true\"]\nlog = \"carmen\"\nmap = \"csv\"\ntime_limit = 5\n[[trials]]\n\
                localizer = \"theirs\"\nmap = \"gbs\"\nsize = 5\nruns = 1\n";
    let (_bench, mut results) = small();
    results[0].study = Study::parse(text).unwrap();
    results[0].plan = results[0].study.plan(&results[0].facts.name).unwrap();
    let choose = |results: &Results| watch::choose(results, &results.plan);
    let reason = choose(&results[0]).unwrap_err().to_string();
    assert!(reason.contains("external programs"), "{reason}");
    // With the own filter beside them, its runs are shown.
    let (_bench, results) = small();
    assert_eq!(choose(&results[0]).unwrap().runs.len(), 3);
}
