//! `mcl-eval localize --replay`: the bag of a run.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::process::Command;

use mcl_datasets::bag::cdr::{View, decode};
use mcl_datasets::bag::schema::MessageSchema;
use mcl_datasets::container::item::Item;
use mcl_datasets::container::mcap::read_stream;
use serde_json::Value;
use tempfile::TempDir;

const SCANS: usize = 60;
const PARTICLES: usize = 100;

/// A folder with the first scans of the simulated office (`office.log`) and a map of it (`map.csv`).
struct Lab(TempDir);

impl Lab {
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        lab.ends(&["simulate", "-o", "whole.log", "-q"], 0);
        let text = lab.read("whole.log");
        let end = text.match_indices("FLASER").nth(SCANS).unwrap().0;
        lab.write("office.log", &text[..end]);
        lab.ends(&["map", "office.log", "--init", "grid", "--cell", "0.2", "-o", "map.csv"], 0);
        lab
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.0.path().join(name)).unwrap()
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.path().join(name)).unwrap()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Changes the stamp of every scan of `office.log`, given its number.
    fn restamp(&self, change: impl Fn(usize, &str) -> String) {
        let mut scan = 0;
        let lines = self.read("office.log");
        let lines = lines.lines().map(|line| {
            let mut fields: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if fields[0] == "FLASER" {
                let stamp = fields.len() - 3;
                fields[stamp] = change(scan, &fields[stamp]);
                scan += 1;
            }
            fields.join(" ") + "\n"
        });
        self.write("office.log", &lines.collect::<String>());
    }

    /// Stdout and stderr of a call that must end with a code.
    #[track_caller]
    fn ends(&self, args: &[&str], code: i32) -> (String, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mcl-eval"));
        let output = command.current_dir(self.0.path()).args(args).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "{args:?}\n{stdout}\n{stderr}");
        (stdout, stderr)
    }

    #[track_caller]
    fn localize(&self, more: &[&str], code: i32) -> (String, String) {
        let mut args = vec!["localize", "office.log", "--map", "map.csv", "--beams", "20"];
        let particles = PARTICLES.to_string();
        args.extend(["--particles", &particles]);
        args.extend(more);
        self.ends(&args, code)
    }

    /// The messages of a bag, by topic; log times must not step back.
    fn bag(&self, name: &str) -> BTreeMap<String, Vec<Message>> {
        let mut topics: BTreeMap<String, Vec<Message>> = BTreeMap::new();
        let mut before = 0;
        let cut = read_stream(File::open(self.0.path().join(name)).unwrap(), |item| {
            if let Item::Message(message) = item {
                assert!(message.log_time >= before, "{}", message.channel.topic);
                before = message.log_time;
                let text = message.channel.schema.as_ref().unwrap();
                topics.entry(message.channel.topic.clone()).or_default().push(Message {
                    log_time: message.log_time,
                    schema: MessageSchema::parse(&text.name, &text.encoding, &text.data).unwrap(),
                    data: message.data.to_vec(),
                });
            }
            Ok(())
        });
        assert_eq!(cut.unwrap(), None);
        topics
    }
}

struct Message {
    log_time: u64,
    schema: MessageSchema,
    data: Vec<u8>,
}

impl Message {
    fn look<T>(&self, look: impl FnOnce(View<'_>) -> T) -> T {
        let value = decode(&self.schema, &self.data).unwrap();
        look(View::new(&self.schema, &value))
    }

    fn value(&self) -> f64 {
        self.look(|view| view.number("data").unwrap())
    }

    /// Nanoseconds.
    fn stamp(&self) -> u64 {
        self.look(|view| {
            let stamp = view.message("header").unwrap().message("stamp").unwrap();
            let part = |name| stamp.number(name).unwrap() as u64;
            part("sec") * 1_000_000_000 + part("nanosec")
        })
    }
}

#[test]
fn the_bag_says_what_the_run_says() {
    let lab = Lab::new();
    let (stdout, _) = lab.localize(&["-o", "out", "--replay", "run.mcap"], 0);
    assert!(stdout.contains("run.mcap: run 0"), "{stdout}");
    let bag = lab.bag("run.mcap");
    let counts: Vec<(&str, usize)> =
        bag.iter().map(|(name, messages)| (name.as_str(), messages.len())).collect();
    let expected = [
        ("/effective_sample_size", SCANS),
        ("/error/heading", SCANS),
        ("/error/nees", SCANS),
        ("/error/translation", SCANS),
        ("/error/weighted", SCANS),
        ("/estimate", SCANS),
        ("/explained_beams", SCANS),
        ("/log_evidence", SCANS),
        ("/map", 1),
        ("/particles", SCANS),
        ("/reference", SCANS),
        ("/scan", SCANS),
        ("/tf", SCANS),
        ("/tf_static", 1),
    ];
    assert_eq!(counts, expected);
    let map_points = lab.read("map.csv").lines().count() - 1;
    assert_eq!(bag["/map"][0].look(|map| map.number("width").unwrap()), map_points as f64);

    let mut rows = csv::Reader::from_path(lab.0.path().join("out/run-000.csv")).unwrap();
    let trajectory = lab.read("out/run-000.tum");
    let mut trajectory = trajectory.lines();
    for (index, row) in rows.records().enumerate() {
        let row = row.unwrap();
        let column = |number: usize| row[number].parse::<f64>().unwrap();
        // The very numbers, both written so that they survive.
        assert_eq!(bag["/error/translation"][index].value(), column(5));
        assert_eq!(bag["/error/heading"][index].value(), column(6));
        assert_eq!(bag["/error/weighted"][index].value(), column(7));
        assert_eq!(bag["/effective_sample_size"][index].value(), column(8));
        assert_eq!(bag["/error/nees"][index].value(), column(17));
        assert_eq!(bag["/log_evidence"][index].value(), column(18));
        assert_eq!(bag["/explained_beams"][index].value(), column(19));
        let particles =
            bag["/particles"][index].look(|array| array.messages("poses").unwrap().len());
        assert_eq!(particles, PARTICLES);
        let line: Vec<f64> =
            trajectory.next().unwrap().split(' ').map(|field| field.parse().unwrap()).collect();
        let position = bag["/estimate"][index].look(|estimate| {
            let pose = estimate.message("pose").unwrap().message("pose").unwrap();
            let position = pose.message("position").unwrap();
            [position.number("x").unwrap(), position.number("y").unwrap()]
        });
        assert_eq!(position[..], line[1..3]);
        // The limits leave what is used: 0 < r ≤ 10 m.
        bag["/scan"][index].look(|scan| {
            assert!(scan.number("range_min").unwrap() > 0.0);
            assert_eq!(scan.number("range_max"), Ok(10.0));
        });
        for topic in ["/scan", "/particles", "/estimate", "/reference"] {
            assert_eq!(bag[topic][index].stamp(), bag[topic][index].log_time, "{topic}");
        }
    }
}

#[test]
fn recording_changes_nothing_and_repeats_itself() {
    let lab = Lab::new();
    lab.localize(&["--runs", "2", "-o", "plain"], 0);
    lab.localize(&["--runs", "2", "-o", "watched", "--replay", "run.mcap"], 0);
    for name in ["run-000.csv", "run-001.csv", "run-000.tum", "run-001.tum"] {
        let read = |folder: &str| lab.read(&format!("{folder}/{name}"));
        assert_eq!(read("plain"), read("watched"), "{name}");
    }
    // What was there is replaced; run 0 is the same however many runs there are.
    let first = lab.bytes("run.mcap");
    lab.localize(&["--runs", "2", "--threads", "1", "--replay", "run.mcap"], 0);
    assert!(first == lab.bytes("run.mcap"), "other bytes");
    lab.localize(&["--replay", "one.mcap"], 0);
    assert!(first == lab.bytes("one.mcap"), "other bytes");
    lab.localize(&["--seed", "2", "--replay", "other.mcap"], 0);
    assert!(first != lab.bytes("other.mcap"), "the same bytes");
    assert!(lab.names().iter().all(|name| !name.ends_with(".tmp")), "{:?}", lab.names());
}

#[test]
fn a_lost_robot_and_one_without_reference_are_recorded() {
    let lab = Lab::new();
    // Far away from where the robot starts: it never finds itself.
    lab.localize(&["--initial-pose", "25,25,2", "--replay", "lost.mcap"], 0);
    let lost = lab.bag("lost.mcap");
    assert!(lost["/error/translation"].last().unwrap().value() > 1.0);
    assert_eq!(lost["/estimate"].len(), SCANS);

    let raw = ["--reference", "none", "--initial-pose", "7,7,-0.02", "--replay", "raw.mcap"];
    lab.localize(&raw, 0);
    let raw = lab.bag("raw.mcap");
    let names: Vec<&str> = raw.keys().map(String::as_str).collect();
    let expected = [
        "/effective_sample_size",
        "/estimate",
        "/explained_beams",
        "/log_evidence",
        "/map",
        "/particles",
        "/scan",
        "/tf",
        "/tf_static",
    ];
    assert_eq!(names, expected);
}

#[test]
fn logging_times_advance_where_stamps_do_not() {
    let lab = Lab::new();
    // Scans 0 and 30 have no stamp, scan 10 that of scan 9, and scan 20 steps back by five seconds.
    let log = lab.read("office.log");
    let stamps: Vec<f64> = log
        .lines()
        .filter(|line| line.starts_with("FLASER"))
        .map(|line| line.split(' ').rev().nth(2).unwrap().parse().unwrap())
        .collect();
    lab.restamp(|scan, stamp| match scan {
        0 | 30 => "-1".to_owned(),
        10 => stamps[9].to_string(),
        20 => (stamps[20] - 5.0).to_string(),
        _ => stamp.to_owned(),
    });
    lab.localize(&["--replay", "run.mcap"], 0);
    let bag = lab.bag("run.mcap");
    let scans = &bag["/scan"];
    assert_eq!(scans.len(), SCANS);
    for (index, pair) in scans.windows(2).enumerate() {
        assert!(pair[0].log_time < pair[1].log_time, "scans {index} and {}", index + 1);
    }
    let nanoseconds = |seconds: f64| (seconds * 1e9).round() as u64;
    for (index, scan) in scans.iter().enumerate() {
        let expected = match index {
            0 | 30 => scan.log_time,
            10 => nanoseconds(stamps[9]),
            20 => nanoseconds(stamps[20] - 5.0),
            _ => nanoseconds(stamps[index]),
        };
        assert!(scan.stamp().abs_diff(expected) < 1000, "scan {index}");
        // The frames have the stamp of the scan that they place.
        let stamp = bag["/tf"][index].look(|tf| {
            let header = tf.messages("transforms").unwrap()[0].message("header").unwrap();
            let part = |name| header.message("stamp").unwrap().number(name).unwrap() as u64;
            part("sec") * 1_000_000_000 + part("nanosec")
        });
        assert_eq!(stamp, scan.stamp(), "scan {index}");
    }
    for index in [10, 20, 30] {
        assert_eq!(scans[index].log_time - scans[index - 1].log_time, 1_000_000);
    }
}

#[test]
fn an_unwritable_replay_is_reported_before_the_run() {
    let lab = Lab::new();
    for name in ["run.log", "run", "run.mcap.gz", ".mcap"] {
        let (stdout, stderr) = lab.localize(&["--replay", name], 2);
        assert!(stdout.is_empty() && stderr.contains(".mcap"), "{name}: {stderr}");
    }
    fs::create_dir(lab.0.path().join("folder.mcap")).unwrap();
    for (name, expected) in [("absent/run.mcap", "absent"), ("folder.mcap", "folder")] {
        let (stdout, stderr) = lab.localize(&["--replay", name], 1);
        assert!(stdout.is_empty() && stderr.contains(name), "{name}: {stderr}");
        assert!(stderr.contains(expected), "{name}: {stderr}");
    }
    lab.ends(&["convert", "office.log", "office.mcap"], 0);
    let before = lab.bytes("office.mcap");
    let args = ["localize", "office.mcap", "--map", "map.csv", "--replay", "./office.mcap"];
    let (_, stderr) = lab.ends(&args, 1);
    assert!(stderr.contains("it is the input office.mcap"), "{stderr}");
    assert!(before == lab.bytes("office.mcap"), "the log has changed");
}

#[test]
fn the_layout_shows_what_is_in_the_bag() {
    let layout: Value =
        serde_json::from_str(include_str!("../../../../docs/foxglove-layout.json")).unwrap();
    let lab = Lab::new();
    lab.localize(&["--replay", "run.mcap"], 0);
    let mut unseen: BTreeSet<String> = lab.bag("run.mcap").into_keys().collect();
    // Frames are drawn without being asked for.
    unseen.remove("/tf");
    unseen.remove("/tf_static");
    let known = unseen.clone();
    let panels = layout["configById"].as_object().unwrap();
    for (name, panel) in panels {
        let shown: Vec<String> = match name.split_once('!').unwrap().0 {
            "3D" => {
                let frame = panel["followTf"].as_str().unwrap();
                assert!(["map", "base_link"].contains(&frame), "{name}: {frame}");
                panel["topics"].as_object().unwrap().keys().cloned().collect()
            }
            "Plot" => {
                let paths = panel["paths"].as_array().unwrap().iter();
                let field = |path: &Value| path["value"].as_str().unwrap().to_owned();
                paths.map(|path| field(path).strip_suffix(".data").unwrap().to_owned()).collect()
            }
            other => panic!("panel {other}"),
        };
        for topic in shown {
            assert!(known.contains(&topic), "{name}: {topic}");
            unseen.remove(&topic);
        }
    }
    assert!(unseen.is_empty(), "not shown: {unseen:?}");

    // Every panel has its place, once.
    fn places(part: &Value) -> Vec<&str> {
        match part.as_str() {
            Some(name) => vec![name],
            None => [places(&part["first"]), places(&part["second"])].concat(),
        }
    }
    let mut placed = places(&layout["layout"]);
    placed.sort_unstable();
    assert_eq!(placed, panels.keys().map(String::as_str).collect::<Vec<_>>());
}
