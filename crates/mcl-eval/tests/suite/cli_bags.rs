//! Bags on the command line: converting, choosing topics, and what is said about bad input.

use crate::called;
use std::fs;

use serde_json::Value;
use tempfile::TempDir;

#[track_caller]
fn ends(folder: &TempDir, args: &[&str], code: i32) -> (String, String) {
    called::ends(folder.path(), args, code)
}

#[track_caller]
fn json(folder: &TempDir, args: &[&str]) -> Value {
    serde_json::from_str(&ends(folder, args, 0).0).unwrap()
}

/// A folder with the first 40 scans of the simulated office as `office.log` and `office.mcap`.
fn lab() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    called::write_office(folder.path());
    let found = json(&folder, &["convert", "office.log", "office.mcap", "--json"]);
    assert_eq!((&found["converted"], &found["scans"]), (&"log".into(), &40.into()));
    folder
}

#[test]
fn a_log_and_its_bag_say_the_same() {
    let lab = lab();
    let log = json(&lab, &["inspect", "office.log", "--json"]);
    let bag = json(&lab, &["inspect", "office.mcap", "--json"]);
    for key in [
        "scans",
        "readings",
        "points",
        "duration_s",
        "backward_stamps",
        "has_reference",
        "has_odometry",
    ] {
        assert_eq!(bag[key], log[key], "{key}");
    }
    let notes = bag["bag"].to_string();
    for part in ["/scan", "/odom, 40 messages", "/reference, 40 messages"] {
        assert!(notes.contains(part), "{part}: {notes}");
    }
    ends(&lab, &["convert", "office.mcap", "back.log.gz"], 0);
    assert_eq!(json(&lab, &["inspect", "back.log.gz", "--json"])["points"], log["points"]);
    let first = fs::read(lab.path().join("office.mcap")).unwrap();
    ends(&lab, &["convert", "office.log", "again.mcap"], 0);
    assert!(fs::read(lab.path().join("again.mcap")).unwrap() == first, "other bytes");
}

#[test]
fn a_bag_goes_wherever_a_log_goes() {
    let lab = lab();
    let args = ["map", "office.mcap", "--init", "grid", "--cell", "0.5", "-o", "map.csv"];
    ends(&lab, &args, 0);
    let found = json(&lab, &["likelihood", "office.mcap", "--map", "map.csv", "--json"]);
    assert!(found["log_likelihood"].is_number());
    let found = json(&lab, &["localize", "office.mcap", "--map", "map.csv", "--json"]);
    assert!(found["translation"]["mean"].as_f64().unwrap() < 0.5, "{found}");
    let found = json(&lab, &["inspect", "office.mcap", "--reference", "none", "--json"]);
    assert_eq!(found["has_reference"], false);
    let found = json(
        &lab,
        &[
            "inspect",
            "office.mcap",
            "--scan-topic",
            "/scan",
            "--odom-topic",
            "/odom",
            "--reference-topic",
            "/odom",
            "--json",
        ],
    );
    assert_eq!((&found["has_reference"], &found["has_odometry"]), (&true.into(), &true.into()));
}

#[test]
fn bad_bags_are_refused_with_the_reason() {
    let lab = lab();
    let bytes = fs::read(lab.path().join("office.mcap")).unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(lab.path().join(name), bytes).unwrap();
    write("head.mcap", &bytes[..bytes.len() / 10]);
    let (_, stderr) = ends(&lab, &["inspect", "head.mcap"], 1);
    assert!(stderr.contains("head.mcap") && stderr.contains("ends at byte"), "{stderr}");
    ends(&lab, &["convert", "whole.log", "whole.mcap"], 0);
    let whole = fs::read(lab.path().join("whole.mcap")).unwrap();
    write("cut.mcap", &whole[..whole.len() / 2]);
    let (stdout, stderr) = ends(&lab, &["inspect", "cut.mcap", "--json"], 3);
    let scans = serde_json::from_str::<Value>(&stdout).unwrap()["scans"].as_u64().unwrap();
    assert!((350..550).contains(&scans), "{scans} of 916");
    assert!(stderr.contains("of its last chunk are there"), "{stderr}");
    write("end.mcap", &bytes[..bytes.len() - 20]);
    let (stdout, stderr) = ends(&lab, &["inspect", "end.mcap", "--json"], 3);
    assert!(stdout.contains("\"scans\":40"), "{stdout}");
    assert!(stderr.contains("all messages come before"), "{stderr}");
    // Formats are recognized by content: this is taken for the text of a log.
    write("text.mcap", b"not a bag at all");
    write("empty.mcap", b"");
    for (args, parts) in [
        (vec!["inspect", "text.mcap"], vec!["text.mcap", "no laser scan"]),
        (vec!["inspect", "empty.mcap"], vec!["empty.mcap", "empty"]),
        (vec!["inspect", "no.mcap"], vec!["no.mcap", "no such file"]),
        (vec!["inspect", "office.log", "--scan-topic", "/scan"], vec!["office.log", "no topics"]),
        (
            vec!["convert", "office.log", "office.txt"],
            vec!["office.txt", ".mcap", ".db3", ".bag", ".csv"],
        ),
        (vec!["convert", "office.log", "no/a.mcap"], vec!["no folder"]),
        (vec!["convert", "office.log", "a.csv"], vec!["a.csv has the extension of a map"]),
        (vec!["convert", "nowhere.log", "a.mcap"], vec!["nowhere.log", "no such file"]),
    ] {
        let (stdout, stderr) = ends(&lab, &args, 1);
        assert!(stdout.is_empty(), "{args:?}: {stdout}");
        for part in parts {
            assert!(stderr.contains(part), "{args:?}: no {part:?} in {stderr}");
        }
    }
    // What is in the bag is shown all the same.
    for (options, parts) in [
        (["--scan-topic", "/odom"], ["topic /odom (--scan-topic)", "LaserScan"]),
        (["--odom-topic", "/no"], ["no topic /no", "/scan ("]),
    ] {
        let (stdout, stderr) = ends(&lab, &[&["inspect", "office.mcap"], &options[..]].concat(), 3);
        for part in parts {
            let printed = format!("{stdout}{stderr}");
            assert!(printed.contains(part), "{options:?}: no {part:?} in {printed}");
        }
    }
}

#[test]
fn maps_change_their_format_and_not_their_points() {
    let lab = lab();
    let args = ["map", "office.log", "--init", "random", "--size", "50", "-o", "map.csv"];
    ends(&lab, &args, 0);
    assert_eq!(json(&lab, &["convert", "map.csv", "map.ply", "--json"])["map_points"], 50);
    ends(&lab, &["convert", "map.ply", "map.pcd", "--ascii"], 0);
    ends(&lab, &["convert", "map.pcd", "again.csv"], 0);
    let read = |name: &str| fs::read(lab.path().join(name)).unwrap();
    assert_eq!(read("map.csv"), read("again.csv"));
}
