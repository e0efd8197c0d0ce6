//! `mcl-eval evaluate` on logs, bags and several estimates, and grid maps, called as a user calls them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

struct Lab(TempDir);

impl Lab {
    /// With the simulated office as `office.log` and `office.mcap`, and its reference as `reference.tum`.
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        lab.ends(&["simulate", "-o", "office.log"], 0);
        lab.ends(&["convert", "office.log", "office.mcap"], 0);
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn ends(&self, args: &[&str], code: i32) -> (String, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        let output = command.current_dir(self.0.path()).args(args).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
        (stdout, stderr)
    }

    fn rows(&self, args: &[&str], code: i32) -> Vec<Value> {
        let args = [&["evaluate", "--json"], args].concat();
        let found: Value = serde_json::from_str(&self.ends(&args, code).0).unwrap();
        found["estimates"].as_array().unwrap().clone()
    }

    fn json(&self, args: &[&str]) -> Value {
        serde_json::from_str(&self.ends(args, 0).0).unwrap()
    }
}

/// Poses along a bend, half a metre and a tenth of a second apart.
fn tum(count: usize, change: impl Fn(f64) -> (f64, f64, f64)) -> String {
    (0..count)
        .map(|i| {
            let t = i as f64;
            let (dx, dy, dtheta) = change(t);
            let (sin, cos) = (0.5 * (0.05 * t + dtheta)).sin_cos();
            let (x, y) = (0.5 * t + dx, 0.01 * t * t + dy);
            format!("{} {x} {y} 0 0 0 {sin} {cos}\n", 100.0 + 0.1 * t)
        })
        .collect()
}

fn near(value: &Value, expected: f64) {
    let found = value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"));
    assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
}

#[test]
fn a_log_and_the_bag_made_of_it_are_the_same_trajectory() {
    let lab = Lab::new();
    let both = lab.rows(
        &["--reference", "office.log", "office.log", "office.mcap", "--topic", "/reference"],
        0,
    );
    assert_eq!((&both[0]["topic"], &both[1]["topic"]), (&Value::Null, &Value::from("/reference")));
    for row in &both {
        assert_eq!(row["unmatched"], 0);
        near(&row["ate"]["max"], 0.0);
        near(&row["heading"]["max"], 0.0);
    }
    // Odometry leaves the reference, less and less over shorter paths.
    // It is in another frame than the reference, which is reported.
    let odometry = lab.rows(&["--reference", "office.mcap", "office.mcap"], 3);
    let figure = |value: &Value| value["rmse"].as_f64().unwrap();
    let row = &odometry[0];
    assert_eq!(row["topic"], "/odom");
    let over = |k: usize| figure(&row["rpe"][k]["translation"]);
    assert!(over(0) < over(1) && over(1) < over(2) && over(2) < figure(&row["ate"]), "{row}");
    // As a reference, odometry must be asked for.
    let reversed =
        lab.rows(&["--reference", "office.mcap", "--reference-topic", "/odom", "office.log"], 0);
    let frames = &odometry[0]["frames"];
    assert_eq!(
        (&frames["reference"]["within"], &frames["estimate"]["within"]),
        (&"map".into(), &"odom".into())
    );
    near(&reversed[0]["ate"]["rmse"], figure(&row["ate"]));
    for (args, code, expected) in [
        (
            &["--reference", "office.mcap", "office.mcap", "--topic", "/pose"][..],
            1,
            "no topic /pose",
        ),
        (&["--reference", "office.mcap", "office.mcap", "--topic", "/scan"], 1, "LaserScan"),
        (
            &["--reference", "office.log", "--reference-topic", "/odom", "office.log"],
            2,
            "is not a bag",
        ),
        (
            &["--reference", "office.log", "office.log", "--topic", "/odom"],
            2,
            "--topic applies to bags only",
        ),
        (&["--reference", "office.log", "office.log", "--plot", "a.gif"], 1, ".svg, .png or .pdf"),
        (&["--reference", "office.log", "absent.tum"], 1, "absent.tum"),
        (&["--reference", "absent", "office.log"], 1, "no data set of that name"),
    ] {
        let (stdout, stderr) = lab.ends(&[&["evaluate"], args].concat(), code);
        assert!(stdout.is_empty() && stderr.contains(expected), "{args:?}: {stderr}");
    }
}

#[test]
fn raw_odometry_is_an_estimate_but_no_reference() {
    let lab = Lab(tempfile::tempdir().unwrap());
    let ranges = "2.0 ".repeat(180);
    let log: String = (0..20)
        .map(|i| format!("FLASER 180 {ranges}{i} 0 0 {i} 0 0 {}.5 host {i}.5\n", 10 + i))
        .collect();
    fs::write(lab.path("raw.log"), log).unwrap();
    let tum: String = (0..20).map(|i| format!("{}.5 {i} 1 0 0 0 0 1\n", 10 + i)).collect();
    fs::write(lab.path("truth.tum"), tum).unwrap();
    let rows = lab.rows(&["--reference", "truth.tum", "raw.log"], 0);
    near(&rows[0]["axes"]["y"]["mean"], -1.0);
    let (_, stderr) = lab.ends(&["evaluate", "--reference", "raw.log", "truth.tum"], 1);
    assert!(stderr.contains("the log is raw"), "{stderr}");
}

#[test]
fn errors_per_axis_as_rows_and_as_a_figure() {
    let lab = Lab(tempfile::tempdir().unwrap());
    fs::write(lab.path("a.tum"), tum(40, |_| (0.0, 0.0, 0.0))).unwrap();
    fs::write(lab.path("b.tum"), tum(40, |t| (0.3, if t < 20.0 { -0.1 } else { 0.1 }, 0.2)))
        .unwrap();
    // Ten poses are missing at the end.
    fs::write(lab.path("c.tum"), tum(30, |_| (0.0, 0.0, -0.1))).unwrap();
    let args = ["--reference", "a.tum", "b.tum", "c.tum", "--errors", "e.csv", "--delta", "2,7.5"];
    let rows = lab.rows(&[&args[..], &["--plot", "e.svg"]].concat(), 3);
    let axes = &rows[0]["axes"];
    near(&axes["x"]["mean"], 0.3);
    near(&axes["x"]["std"], 0.0);
    near(&axes["y"]["mean"], 0.0);
    near(&axes["y"]["rmse"], 0.1);
    near(&axes["y"]["max"], 0.1);
    near(&axes["yaw"]["mean"], 0.2);
    near(&rows[1]["axes"]["yaw"]["mean"], -0.1);
    near(&rows[1]["axes"]["yaw"]["max"], 0.1);
    assert_eq!((&rows[1]["pairs"], &rows[1]["unmatched"]), (&Value::from(30), &Value::from(10)));
    let distances: Vec<&Value> =
        rows[0]["rpe"].as_array().unwrap().iter().map(|rpe| &rpe["distance_m"]).collect();
    assert_eq!(distances, [2.0, 7.5]);

    let csv = fs::read_to_string(lab.path("e.csv")).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 1 + 40 + 30);
    assert!(lines[0].starts_with("file,stamp,dx,dy,dtheta,weighted,translation,heading,"));
    let fields: Vec<&str> = lines[1].split(',').collect();
    assert_eq!((fields[0], fields[1]), ("b.tum", "100.000000000"));
    let numbers: Vec<f64> = fields[2..8].iter().map(|field| field.parse().unwrap()).collect();
    let translation = 0.1_f64.sqrt();
    let weighted = (0.8 * 0.04 + 0.2 * 0.1_f64).sqrt();
    for (found, expected) in numbers.iter().zip([0.3, -0.1, 0.2, weighted, translation, 0.2]) {
        assert!((found - expected).abs() < 1e-9, "{fields:?}");
    }
    let svg = fs::read_to_string(lab.path("e.svg")).unwrap();
    assert!(svg.contains("b.tum") && svg.contains("c.tum") && svg.contains("translation error"));
    assert!(!lab.path("e.png").exists());
    lab.rows(&[&args[..], &["--plot", "e.png"]].concat(), 3);
    assert!(fs::read(lab.path("e.png")).unwrap().starts_with(b"\x89PNG"));
    let (text, _) = lab.ends(&["evaluate", "--reference", "a.tum", "b.tum", "c.tum"], 3);
    assert!(text.starts_with("estimate") && text.contains("RPE 10 m"), "{text}");
}

#[test]
fn alignment_by_the_first_pose_or_by_all() {
    let lab = Lab(tempfile::tempdir().unwrap());
    fs::write(lab.path("a.tum"), tum(40, |_| (0.0, 0.0, 0.0))).unwrap();
    // The first pose is off by itself, the others are not.
    let off = |t: f64| if t == 0.0 { (1.0, -2.0, 0.0) } else { (0.0, 0.0, 0.0) };
    fs::write(lab.path("b.tum"), tum(40, off)).unwrap();
    let row = |align: &[&str]| {
        lab.rows(&[&["--reference", "a.tum", "b.tum"], align].concat(), 0).swap_remove(0)
    };
    near(&row(&[])["ate"]["median"], 0.0);
    assert!(row(&[])["reference_from_estimate"].is_null());
    let origin = row(&["--align=origin"]);
    near(&origin["ate"]["median"], 5.0_f64.sqrt());
    near(&origin["reference_from_estimate"]["x"], -1.0);
    let rigid = row(&["--align"]);
    assert!(rigid["ate"]["rmse"].as_f64() < row(&[])["ate"]["rmse"].as_f64());
    assert_eq!(rigid, row(&["--align=se2"]));
}

#[test]
fn grid_maps_are_written_read_and_localized_on() {
    let lab = Lab::new();
    let map = ["map", "office.log", "--init", "grid", "--cell", "0.1", "--json", "-o"];
    let built = lab.json(&[&map[..], &["map.yaml", "--resolution", "0.1"]].concat());
    let grid = &built["grid"];
    assert_eq!(grid["occupied"], built["map_points"]);
    let cells = ["occupied", "free", "unknown"].map(|kind| grid[kind].as_u64().unwrap());
    let size = ["width", "height"].map(|side| grid[side].as_u64().unwrap());
    assert_eq!(cells.iter().sum::<u64>(), size[0] * size[1]);
    assert!(cells[1] > cells[0] && cells[2] > 0, "{grid}");
    let found = lab.json(&["likelihood", "office.log", "--map", "map.yaml", "--json"]);
    assert_eq!(found["map_points"], built["map_points"]);
    assert_eq!(found["log_likelihood_per_point"], built["log_likelihood_per_point"]);
    let localize = ["localize", "office.log", "--map", "map.yaml", "--particles", "100", "--json"];
    let found = lab.json(&[&localize[..], &["--beams", "20"]].concat());
    assert!(found["translation"]["mean"].as_f64().unwrap() < 0.1, "{found}");

    // The same points by way of a point map; with the log, the same grid.
    let read = |name: &str| fs::read(lab.path(name)).unwrap();
    lab.ends(&["convert", "map.yaml", "points.csv"], 0);
    let grid =
        ["convert", "points.csv", "again.yaml", "--resolution", "0.1", "--log", "office.log"];
    lab.ends(&grid, 0);
    assert_eq!(read("again.pgm"), read("map.pgm"));
    lab.ends(&["convert", "map.yaml", "copy.yaml"], 0);
    assert_eq!(read("copy.pgm"), read("map.pgm"));
    let plain = lab.json(&["convert", "points.csv", "plain.yaml", "--json"]);
    assert_eq!(plain["grid"]["free"], 0);
    for (args, code, expected) in [
        (
            &["convert", "points.csv", "a.ply", "--resolution", "0.1"][..],
            2,
            "--resolution applies only to",
        ),
        (&["convert", "points.csv", "a.ply", "--log", "office.log"], 2, "--log applies only to"),
        (
            &["convert", "points.csv", "a.yaml", "--resolution", "1e-7"],
            1,
            "use a larger resolution",
        ),
        (&["likelihood", "office.log", "--map", "map.pgm"], 1, "name the .yaml file"),
    ] {
        let (_, stderr) = lab.ends(args, code);
        assert!(stderr.contains(expected), "{args:?}: {stderr}");
    }
    let text = "image: ../elsewhere.pgm\nresolution: 1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n\
                free_thresh: 0.2\n";
    fs::write(lab.path("map.yaml"), text).unwrap();
    let (_, stderr) = lab.ends(&["convert", "map.yaml", "b.csv"], 1);
    assert!(stderr.contains("\"../elsewhere.pgm\", which leads elsewhere"), "{stderr}");
    assert!(!Path::new(&lab.path("b.csv")).exists());
}
