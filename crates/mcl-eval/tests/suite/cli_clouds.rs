//! Point clouds on the command line: every format, both dimensions, bags, and an experiment.

use crate::office;
use std::fs;
use std::io::Cursor;

use crate::office::{Bench, assert_same};
use mcl_core::{Pose2, Stamp};
use mcl_datasets::bag::types::{LASER_SCAN, ODOMETRY, POINT_CLOUD2};
use mcl_datasets::bag::{BagWriter, Delivery, Encoder};
use serde_json::Value;

const EXPERIMENT: &str = r#"
seed = 3
measures = ["likelihood"]
[base]
sigma = 0.1
tolerance = 1e-3
max_iterations = 20
[[trials]]
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [1, 5]
draws = 2
[[views.charts]]
name = "figure4-likelihood"
x = { column = "real_percent", scale = "log" }
y = { column = "log_likelihood", scale = "symlog" }
[[views.pictures]]
name = "figure1-maps"
maps = [{ map = "all" }, { map = "gbs+f-km", size = 5, offset = "origin" }]
[[views.pictures]]
name = "figure2-sampling"
maps = [{ map = "rnd", size = 2 }, { map = "gbs", size = 2, offset = "origin" }]
[[dataset]]
name = "room"
hide_above = 2.4
"#;

/// A folder with 3,000 points of the simulated office in three dimensions as `room.ply`.
fn bench() -> Bench {
    let bench = Bench::new(&[("space", EXPERIMENT)]);
    bench.mcl_eval(&["simulate", "--three-dimensional", "-o", "whole.ply"]);
    bench.mcl_eval(&["map", "whole.ply", "--init", "random", "--size", "3000", "-o", "room.ply"]);
    bench
}

fn json(bench: &Bench, arguments: &[&str]) -> Value {
    serde_json::from_str(&bench.mcl_eval(&[arguments, &["--json"]].concat())).unwrap()
}

/// What is said on stderr by a call that ends with this code.
#[track_caller]
fn said(bench: &Bench, arguments: &[&str], code: i32) -> String {
    let output = bench.run(arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    text
}

#[test]
fn maps_and_likelihoods_in_space() {
    let bench = bench();
    let found = json(&bench, &["inspect", "room.ply"]);
    assert_eq!((&found["dimensions"], &found["points"]), (&3.into(), &3000.into()));
    let bounds = found["bounds"].as_array().unwrap();
    assert_eq!(bounds.len(), 6);
    assert!(bounds[5].as_f64().unwrap() > 2.5);

    for ending in ["pcd", "csv", "ply"] {
        let map = format!("map.{ending}");
        let arguments = ["map", "room.ply", "--init", "grid", "--size", "5%", "--refine", "fkm"];
        let built = json(&bench, &[&arguments[..], &["--sigma", "0.2", "-o", &map]].concat());
        assert_eq!((&built["dimensions"], &built["points"]), (&3.into(), &3000.into()));
        assert_eq!(built["offset_m"], serde_json::json!([0.0, 0.0, 0.0]));
        let scored = json(&bench, &["likelihood", "room.ply", "--map", &map, "--sigma", "0.2"]);
        assert_eq!(scored["dimensions"], 3);
        assert_eq!(scored["map_points"], built["map_points"]);
        assert_eq!(scored["log_likelihood_per_point"], built["log_likelihood_per_point"]);
        // The map is a cloud as well, and a subset of the data.
        assert_eq!(json(&bench, &["inspect", &map])["dimensions"], 3);
    }
    let arguments = ["map", "room.ply", "--init", "grid", "--cell", "1", "-o", "map.ply"];
    let built = json(&bench, &[&arguments[..], &["--offset=0.5,-0.5,0.25"]].concat());
    assert_eq!(built["offset_m"], serde_json::json!([0.5, -0.5, 0.25]));
    let text = said(&bench, &[&arguments[..], &["--offset=0,1"]].concat(), 2);
    assert!(text.contains("X,Y,Z"), "{text}");
}

#[test]
fn the_dimension_can_be_chosen() {
    let bench = bench();
    let map = ["map", "room.ply", "--init", "grid", "--size", "5%", "-o"];
    let planar = json(&bench, &[&map[..], &["flat.yaml", "--dimensions", "2"]].concat());
    assert_eq!((&planar["dimensions"], planar["grid"].is_object()), (&2.into(), true));
    let text = said(&bench, &[&map[..], &["grid.yaml"]].concat(), 1);
    assert!(text.contains("--dimensions 2") && !bench.path("grid.yaml").exists(), "{text}");
    fs::write(bench.path("plane.csv"), "x,y\n1,2\n3,4\n5,6\n").unwrap();
    assert_eq!(json(&bench, &["inspect", "plane.csv"])["dimensions"], 2);
    let text = said(&bench, &["inspect", "plane.csv", "--dimensions", "3"], 1);
    assert!(text.contains("no column \"z\""), "{text}");
    fs::write(bench.path("level.csv"), "x,y,z\n1,2,7\n3,4,7\n").unwrap();
    assert_eq!(json(&bench, &["inspect", "level.csv"])["dimensions"], 2);
    assert_eq!(json(&bench, &["inspect", "level.csv", "--dimensions", "3"])["dimensions"], 3);
    said(&bench, &["inspect", "office.log", "--dimensions", "3"], 1);
    said(&bench, &["inspect", "room.ply", "--dimensions", "4"], 2);
}

#[test]
fn unmeasured_points_are_left_out_and_the_range_is_from_the_scanner() {
    let bench = bench();
    fs::write(bench.path("scan.csv"), "x,y,z\nnan,nan,nan\n0,0,0\n3,0,4\n0,6,0\n1,1,1\n").unwrap();
    let found = json(&bench, &["inspect", "scan.csv"]);
    assert_eq!((&found["points"], &found["not_finite"]), (&4.into(), &1.into()));
    let near = json(&bench, &["inspect", "scan.csv", "--max-range", "5"]);
    assert_eq!((&near["points"], &near["out_of_range"]), (&2.into(), &2.into()));
    let text = said(&bench, &["inspect", "scan.csv", "--max-range", "0.5"], 1);
    assert!(text.contains("no point is usable") && text.contains("0.5 m"), "{text}");
}

#[test]
fn what_needs_scans_refuses_points() {
    let bench = bench();
    fs::write(bench.path("map.csv"), "x,y\n1,2\n3,4\n").unwrap();
    for arguments in [
        &["localize", "room.ply", "--map", "map.csv"][..],
        &["localize", "simulated-office-3d", "--map", "map.csv"],
        &["convert", "simulated-office-3d", "out.log"],
    ] {
        let text = said(&bench, arguments, 1);
        assert!(text.contains("is a point cloud") && text.contains("CARMEN"), "{text}");
    }
    fs::write(bench.path("planar.toml"), office::LOCALIZATION).unwrap();
    let text = said(&bench, &["run", "planar.toml", "--dataset", "room.ply"], 1);
    assert!(text.contains("room is a point cloud"), "{text}");
    let text = said(&bench, &["simulate", "--three-dimensional", "-o", "office.log"], 1);
    assert!(text.contains(".ply"), "{text}");
}

/// A cloud of one point, 1 m ahead and as high as its stamp in seconds.
fn cloud(seconds: i64) -> Encoder {
    let mut message = Encoder::default();
    let stamp = Stamp::from_nanoseconds(seconds * 1_000_000_000);
    message.header(stamp, "lidar").u32(1).u32(1).u32(3);
    for (index, name) in ["x", "y", "z"].into_iter().enumerate() {
        message.text(name).u32(4 * index as u32).u8(7).u32(1);
    }
    message.u8(0).u32(12).u32(12).u32(12);
    for value in [1.0_f32, 0.0, seconds as f32] {
        message.bytes(&value.to_le_bytes());
    }
    message.u8(1);
    message
}

#[test]
fn bags_are_read_for_their_clouds_where_they_have_no_scans_or_it_is_asked_for() {
    let bench = bench();
    let write = |name: &str, with_scan: bool, second_topic: bool| {
        let mut bag = BagWriter::new(Cursor::new(Vec::new())).unwrap();
        let points = bag.topic("/lidar/points", &POINT_CLOUD2, Delivery::Live).unwrap();
        let odom = bag.topic("/odom", &ODOMETRY, Delivery::Live).unwrap();
        if with_scan {
            let scan = bag.topic("/scan", &LASER_SCAN, Delivery::Live).unwrap();
            let mut message = Encoder::default();
            message.header(Stamp::from_nanoseconds(1_000_000_000), "laser");
            message.f32(0.0).f32(0.1).f32(0.1).f32(0.0).f32(0.0).f32(0.1).f32(9.0);
            message.u32(2).f32(1.0).f32(2.0).u32(0);
            bag.write(scan, 1_000_000_000, message).unwrap();
        }
        for seconds in 1..=3 {
            let at = seconds as u64 * 1_000_000_000;
            let mut pose = Encoder::default();
            pose.header(Stamp::from_nanoseconds(at as i64), "odom").text("lidar");
            pose.pose(Pose2::new(10.0 * seconds as f64, 0.0, 0.0)).f64s(&[0.0; 78]);
            bag.write(odom, at, pose).unwrap();
            bag.write(points, at, cloud(seconds)).unwrap();
        }
        if second_topic {
            let other = bag.topic("/other", &POINT_CLOUD2, Delivery::Live).unwrap();
            bag.write(other, 1, cloud(1)).unwrap();
        }
        fs::write(bench.path(name), bag.finish().unwrap().into_inner()).unwrap();
    };
    write("clouds.mcap", false, false);
    let found = json(&bench, &["inspect", "clouds.mcap"]);
    assert_eq!((&found["dimensions"], &found["clouds"]), (&3.into(), &3.into()));
    assert_eq!(found["bounds"], serde_json::json!([11.0, 0.0, 1.0, 31.0, 0.0, 3.0]));
    let map = ["map", "clouds.mcap", "--init", "all", "-o", "map.pcd"];
    assert_eq!(json(&bench, &map)["map_points"], 3);

    write("both.mcap", true, true);
    // No transform says where the laser is: that is guessed, reported, and ends with 3.
    let inspected = bench.run(&["inspect", "both.mcap", "--json"]);
    assert_eq!(inspected.status.code(), Some(3));
    let found: Value = serde_json::from_slice(&inspected.stdout).unwrap();
    assert_eq!(found["scans"], 1);
    let text = said(&bench, &["inspect", "both.mcap", "--dimensions", "3"], 3);
    assert!(text.contains("--cloud-topic") && text.contains("/other"), "{text}");
    let asked = ["inspect", "both.mcap", "--cloud-topic", "/lidar/points"];
    assert_eq!(json(&bench, &asked)["points"], 3);
    said(&bench, &["inspect", "room.ply", "--cloud-topic", "/lidar/points"], 1);
}

#[test]
fn an_experiment_in_space() {
    let bench = bench();
    let run = |root: &str, threads: &str| {
        let arguments = ["run", "space.toml", "--dataset", "room.ply", "-o", root];
        bench.mcl_eval(&[&arguments[..], &["--threads", threads]].concat());
        bench.path(root).join("space/room")
    };
    let one = run("one", "1");
    for figure in ["figure1-maps", "figure2-sampling", "figure4-likelihood"] {
        for ending in ["svg", "png"] {
            assert!(one.join("figures").join(format!("{figure}.{ending}")).is_file(), "{figure}");
        }
    }
    let manifest = fs::read_to_string(one.join("manifest.json")).unwrap();
    let manifest: Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["identity"]["data"]["dimensions"], 3);
    let rows = fs::read_to_string(one.join("trials.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 4 * 2 * 2);
    let shown: Vec<_> = fs::read_dir(one.join("shown")).unwrap().collect();
    assert_eq!(shown.len(), 4);
    for map in shown {
        let map = map.unwrap().path().display().to_string();
        assert_eq!(json(&bench, &["inspect", &map])["dimensions"], 3);
    }

    assert_same(&run("two", "2"), &one);
    // The same bytes after an interruption in the middle of a row.
    office::cut_rows(&one, 2);
    assert_same(&run("one", "2"), &bench.path("two/space/room"));
    // No claim of the paper is about space.
    assert!(said(&bench, &["claims", "one"], 1).contains("experiments in the plane"));
}
