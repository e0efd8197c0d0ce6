//! Options for what logs and bags leave open, references from files of their own, and what `inspect` shows of a
//! bag that no log can be read from.

use crate::called;
use std::fs;

use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_datasets::bag::planar::{laser_scan, pose_stamped, transforms};
use mcl_datasets::bag::types::{LASER_SCAN, ODOMETRY, POSE_STAMPED, TF_MESSAGE};
use mcl_datasets::bag::{BagWriter, Delivery, Encoder};
use mcl_datasets::log::read_log;
use mcl_metrics::tum;
use serde_json::Value;
use tempfile::TempDir;

struct Lab(TempDir);

const MOUNT: Pose2 = Pose2::new(0.2, -0.1, 0.5);

impl Lab {
    /// The first 40 scans of the simulated office, with a laser that sits beside the robot's centre: as a bag
    /// with its reference, as one without, and the robot's poses as a TUM file.
    fn new() -> Self {
        let lab = Lab(tempfile::tempdir().unwrap());
        called::write_office(lab.0.path());
        let mut recording = read_log(lab.path("office.log").as_ref()).unwrap().recording;
        recording.robot_from_laser = MOUNT;
        let write = |name: &str, recording: &mcl_core::Recording| {
            let bytes = std::io::Cursor::new(Vec::new());
            let bag = mcl_datasets::bag::write(recording, bytes).unwrap().into_inner();
            fs::write(lab.path(name), bag).unwrap();
        };
        write("whole.mcap", &recording);
        let reference = recording.stamped_reference();
        let robot: Trajectory =
            reference.iter().map(|(stamp, pose)| (stamp, pose.compose(&MOUNT.inverse()))).collect();
        tum::write_file(lab.path("robot.tum"), &robot).unwrap();
        tum::write_file(lab.path("laser.tum"), &reference).unwrap();
        recording.scans.iter_mut().for_each(|scan| scan.map_from_laser = None);
        write("raw.mcap", &recording);
        lab
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    #[track_caller]
    fn ends(&self, args: &[&str], code: i32) -> (String, String) {
        called::ends(self.0.path(), args, code)
    }

    #[track_caller]
    fn json(&self, args: &[&str], code: i32) -> Value {
        let (stdout, _) = self.ends(&[args, &["--json"]].concat(), code);
        serde_json::from_str(&stdout).unwrap()
    }

    /// The points of a map of all points.
    #[track_caller]
    fn points(&self, args: &[&str]) -> Vec<[f64; 2]> {
        self.ends(&[&["map"], args, &["--init", "all", "-o", "points.csv"]].concat(), 0);
        let text = fs::read_to_string(self.path("points.csv")).unwrap();
        let number = |text: &str| text.parse::<f64>().unwrap();
        let rows = text.lines().skip(1).map(|line| line.split_once(',').unwrap());
        rows.map(|(x, y)| [number(x), number(y)]).collect()
    }
}

fn farthest(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    assert!(a.len() > 1000, "{}", a.len());
    a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
}

/// A TUM file of the robot or of the laser, and a bag, whoever's poses they are.
#[test]
fn a_reference_from_a_file_places_the_scans_of_logs_and_bags() {
    let lab = Lab::new();
    let expected = lab.points(&["whole.mcap"]);
    for args in [
        &["raw.mcap", "--reference", "robot.tum", "--reference-frame", "robot"][..],
        &["raw.mcap", "--reference", "laser.tum", "--reference-frame", "laser"],
        &["raw.mcap", "--reference", "whole.mcap"],
        &["raw.mcap", "--reference", "whole.mcap", "--reference-topic", "/reference"],
        &["raw.mcap", "--reference", "whole.mcap", "--reference-topic", "/tf:map.base_link"],
        &["office.log", "--reference", "laser.tum", "--reference-frame", "laser"],
        &["raw.mcap", "--reference", "office.log"],
    ] {
        let off = farthest(&lab.points(args), &expected);
        assert!(off < 1e-4, "{args:?}: {off}");
    }
    // Poses of the robot taken as those of the laser.
    let wrong = ["raw.mcap", "--reference", "robot.tum", "--reference-frame", "laser"];
    assert!(farthest(&lab.points(&wrong), &expected) > 0.2);

    // A file that does not say whose poses it has holds the robot's, which is a guess.
    let args = ["likelihood", "raw.mcap", "--map", "points.csv", "--reference", "robot.tum"];
    let found = lab.json(&args, 3);
    assert_eq!(found["reference"], "robot.tum, 40 poses, poses of \"base_link\"");
    lab.points(&["whole.mcap"]);
    let args = ["localize", "raw.mcap", "--map", "points.csv", "--reference", "robot.tum"];
    let (_, stderr) = lab.ends(&args, 3);
    assert!(stderr.contains("does not say whose poses it has"), "{stderr}");
    let found = lab.json(&[&args[..], &["--reference-frame", "robot"]].concat(), 0);
    assert!(found["translation"]["mean"].as_f64().unwrap() < 0.2, "{found}");
    assert_eq!(found["bridged_steps"], 0);
    let found = lab.json(&["inspect", "raw.mcap", "--reference", "robot.tum"], 3);
    assert_eq!(found["has_reference"], true);
    let (stdout, _) = lab.ends(&["convert", "raw.mcap", "b.db3", "--reference", "robot.tum"], 3);
    assert!(stdout.contains("reference: robot.tum, 40 poses"), "{stdout}");
    assert!(farthest(&lab.points(&["b.db3"]), &expected) < 1e-4);

    let refused = ["map", "raw.mcap", "--reference", "no.tum", "--init", "all", "-o", "m.csv"];
    let (_, stderr) = lab.ends(&refused, 1);
    assert!(stderr.contains("no.tum"), "{stderr}");
    let over = ["map", "raw.mcap", "--reference", "robot.tum", "--init", "all", "-o", "robot.tum"];
    lab.ends(&over, 1);
}

#[test]
fn every_format_of_bags_is_written_and_read_back() {
    let lab = Lab::new();
    let expected = lab.json(&["inspect", "whole.mcap"], 0);
    for name in ["again.bag", "again.db3", "again.mcap"] {
        lab.ends(&["convert", "whole.mcap", name], 0);
        let found = lab.json(&["inspect", name], 0);
        for key in ["points", "readings", "has_odometry", "duration_s", "reference"] {
            assert_eq!(found[key], expected[key], "{name}: {key}");
        }
        for key in ["path_length_m", "odometry_rmse_m"] {
            let [found, expected] = [&found, &expected].map(|all| all[key].as_f64().unwrap());
            assert!((found - expected).abs() < 1e-9, "{name}: {key} {found}, not {expected}");
        }
    }
    let (_, stderr) = lab.ends(&["convert", "whole.mcap", "whole.mcap"], 1);
    assert!(stderr.contains("whole.mcap"), "{stderr}");
}

#[test]
fn mounts_and_frames_can_be_given() {
    let lab = Lab::new();
    let expected = lab.points(&["whole.mcap"]);
    let found = lab.points(&["whole.mcap", "--laser-pose", "0.2,-0.1,0.5"]);
    assert!(farthest(&found, &expected) < 1e-9);
    let found = lab.points(&["whole.mcap", "--laser-pose=-0.2,-0.1,0.5"]);
    assert!((farthest(&found, &expected) - 0.4).abs() < 1e-9);
    let found = lab.points(&["whole.mcap", "--laser-pose", "0.2,-0.1,0.5,3.141592653589793"]);
    assert!(farthest(&found, &expected) > 1.0, "upside down");
    assert!(farthest(&lab.points(&["whole.mcap", "--base-frame", "base_link"]), &expected) < 1e-9);
    for args in [
        &["inspect", "office.log", "--laser-pose", "0,0,0"][..],
        &["inspect", "office.log", "--slice", "0,1"],
    ] {
        let (_, stderr) = lab.ends(args, 1);
        assert!(stderr.contains(args[2]) && stderr.contains("applies to bags only"), "{stderr}");
    }
    lab.ends(&["inspect", "whole.mcap", "--slice", "1,0"], 2);
    let found = lab.json(&["inspect", "whole.mcap", "--slice", "0,1"], 3);
    assert!(found["problem"].as_str().unwrap().contains("no sensor_msgs/msg/LaserScan"), "{found}");
}

/// A run is of the laser and says where it is on the robot: so can be a reference of the robot.
#[test]
fn evaluate_takes_the_mount_between_poses_of_the_robot_and_of_the_laser() {
    let lab = Lab::new();
    lab.points(&["whole.mcap"]);
    lab.ends(&["localize", "whole.mcap", "--map", "points.csv", "-o", "runs"], 0);
    let mean = |args: &[&str], code| {
        let found = lab.json(&[&["evaluate"], args, &["runs/run-000.tum"]].concat(), code);
        let mean = found["estimates"][0]["ate"]["rmse"].as_f64().unwrap();
        (mean, found["reference"].as_str().unwrap().to_owned())
    };
    let of_laser = ["--reference", "laser.tum", "--reference-frame", "laser"];
    let (expected, described) = mean(&of_laser, 0);
    assert_eq!(described, "laser.tum, 40 poses, of the laser");
    for args in [
        &["--reference", "robot.tum", "--reference-frame", "robot"][..],
        &["--reference", "whole.mcap"],
        &["--reference", "runs/reference.tum"],
    ] {
        let (found, described) = mean(args, 0);
        assert!((found - expected).abs() < 1e-6, "{args:?}: {found}, not {expected}");
        assert!(described.contains(" of "), "{described}");
    }
    // As of localize: what does not say whose poses it has holds the robot's, which is doubtful beside a mount.
    let (found, described) = mean(&["--reference", "robot.tum"], 3);
    assert!(
        (found - expected).abs() < 1e-6 && described.ends_with("of the robot (assumed)"),
        "{described}"
    );
    assert!(mean(&["--reference", "laser.tum"], 3).0 > 0.2, "another's poses");
}

/// Stamps printed with six digits: an estimate that lacks one pose would be compared with the wrong ones.
#[test]
fn repeated_stamps_end_with_3() {
    let lab = Lab::new();
    let pose = |k: usize| format!("1018930000 {} 0 0 0 0 0 1\n", k as f64 * 0.1);
    let file = |name: &str, poses: &mut dyn Iterator<Item = usize>| {
        fs::write(lab.path(name), poses.map(pose).collect::<String>()).unwrap();
    };
    file("all.tum", &mut (0..20));
    file("same.tum", &mut (0..20));
    file("lacks.tum", &mut (0..20).filter(|k| *k != 7));
    lab.ends(&["evaluate", "--reference", "all.tum", "same.tum"], 0);
    let (_, stderr) = lab.ends(&["evaluate", "--reference", "all.tum", "lacks.tum"], 3);
    assert!(stderr.contains("its stamps do not identify its poses"), "{stderr}");
}

/// Several topics of scans, of odometry and of poses: nothing can be read, but all is shown.
#[test]
fn inspect_shows_what_has_to_be_chosen() {
    let lab = Lab::new();
    let recording = read_log(lab.path("office.log").as_ref()).unwrap().recording;
    let write = |name: &str, scans: &[&str]| {
        let mut bag = BagWriter::new(std::io::Cursor::new(Vec::new())).unwrap();
        let live = Delivery::Live;
        let scans: Vec<_> =
            scans.iter().map(|name| bag.topic(name, &LASER_SCAN, live).unwrap()).collect();
        let odometry = ["/platform/odom", "/zed_node/odom"]
            .map(|name| bag.topic(name, &ODOMETRY, live).unwrap());
        let pose = bag.topic("/amcl_pose", &POSE_STAMPED, live).unwrap();
        let fixed = bag.topic("/tf_static", &TF_MESSAGE, Delivery::Latched).unwrap();
        for (k, scan) in recording.scans.iter().enumerate() {
            let at = (k as i64 + 1) * 1_000_000_000;
            let stamp = Stamp::from_nanoseconds(at);
            if k == 0 {
                let mounted = [("base_link", "front", MOUNT)];
                bag.write(fixed, at as u64, transforms(stamp, &mounted)).unwrap();
            }
            for &topic in &scans {
                bag.write(topic, at as u64, laser_scan(scan, stamp, "front", (0.0, 90.0))).unwrap();
            }
            for topic in odometry {
                let mut message = Encoder::default();
                message.header(stamp, "odom").text("base_link").pose(Pose2::IDENTITY);
                message.f64s(&[0.0; 78]);
                bag.write(topic, at as u64, message).unwrap();
            }
            bag.write(pose, at as u64, pose_stamped(stamp, "map", Pose2::IDENTITY)).unwrap();
        }
        fs::write(lab.path(name), bag.finish().unwrap().into_inner()).unwrap();
    };
    write("two.mcap", &["/front/scan", "/rear/scan"]);
    let found = lab.json(&["inspect", "two.mcap"], 3);
    assert!(found["problem"].as_str().unwrap().contains("--scan-topic"), "{found}");
    let topics = found["topics"].as_array().unwrap();
    assert_eq!(topics.len(), 6);
    let front = topics.iter().find(|topic| topic["name"] == "/front/scan").unwrap();
    assert_eq!(
        *front,
        serde_json::json!({"name": "/front/scan", "type": "sensor_msgs/msg/LaserScan", "messages": 40,
            "first_s": "1.000000000", "last_s": "40.000000000", "frame": "front"})
    );
    let (stdout, stderr) = lab.ends(&["inspect", "two.mcap"], 3);
    for part in
        ["/zed_node/odom (nav_msgs/msg/Odometry, 40 messages", "scans: one has to be chosen"]
    {
        assert!(stdout.contains(part), "no {part:?} in {stdout}");
    }
    assert!(stderr.contains("several topics"), "{stderr}");
    // With one topic of scans, the log is read; of the odometry, one has to be chosen still.
    write("one.mcap", &["/front/scan"]);
    let found = lab.json(&["inspect", "one.mcap"], 3);
    assert_eq!((&found["scans"], &found["has_odometry"]), (&40.into(), &false.into()));
    // The path is not known, and not 0 m.
    assert_eq!((&found["path_length_m"], &found["duration_s"]), (&Value::Null, &39.0.into()));
    assert!(found["doubts"][0].as_str().unwrap().contains("--odom-topic; none is used"), "{found}");
    let (stdout, _) = lab.ends(&["inspect", "one.mcap"], 3);
    for part in
        ["note          odometry: none is used", "scans: /front/scan is chosen", ", logged 1."]
    {
        assert!(stdout.contains(part), "no {part:?} in {stdout}");
    }
    assert!(!stdout.contains("  path"), "{stdout}");
    let choice = |what: &str| {
        let choices = found["choices"].as_array().unwrap();
        choices.iter().find(|choice| choice["what"] == what).unwrap().clone()
    };
    assert_eq!(choice("scans")["taken"], "/front/scan");
    assert_eq!(choice("odometry")["is_open"], true);
    let reference = choice("reference");
    assert_eq!(
        reference["others"],
        serde_json::json!(["/amcl_pose (an estimate)", "/platform/odom", "/zed_node/odom"])
    );
    let args = ["inspect", "one.mcap", "--odom-topic", "/platform/odom", "--reference", "none"];
    let found = lab.json(&args, 0);
    assert_eq!(found["has_odometry"], true);
    assert!(found["commands"]["localize"].as_str().unwrap().contains("--initial-pose"), "{found}");
    assert!(found["commands"]["map"].as_str().unwrap().contains("no reference"), "{found}");
}

/// A log that lost some of its odometry: a few steps are bridged and reported, most are refused.
#[test]
fn steps_of_unknown_odometry_are_counted_bridged_or_refused() {
    let lab = Lab::new();
    let text = fs::read_to_string(lab.path("office.log")).unwrap();
    // Of the lines of a gap, the restart at the scan's pose alone says nothing of the motion.
    let without = |is_lost: &dyn Fn(usize) -> bool| -> String {
        let (mut scan, mut in_gap) = (0, 0);
        let mut kept = String::new();
        for line in text.lines() {
            match line.split(' ').next() {
                Some("FLASER") => (scan, in_gap) = (scan + 1, 0),
                Some("ODOM") => in_gap += 1,
                _ => {}
            }
            if !(line.starts_with("ODOM") && in_gap > 1 && is_lost(scan)) {
                kept += line;
                kept.push('\n');
            }
        }
        kept
    };
    fs::write(lab.path("few.log"), without(&|scan| scan == 20)).unwrap();
    fs::write(lab.path("most.log"), without(&|scan| scan != 20)).unwrap();
    let found = lab.json(&["inspect", "few.log"], 0);
    assert_eq!(found["odometry_unknown_steps"], 1, "{found}");
    assert_eq!(found["odometry_worst_unknown"]["scan"], 20);
    let (stdout, _) = lab.ends(&["inspect", "few.log"], 0);
    assert!(stdout.contains("unknown on 1 of 39 steps, at worst "), "{stdout}");
    lab.points(&["few.log"]);
    let (stdout, stderr) = lab.ends(&["localize", "few.log", "--map", "points.csv", "--json"], 3);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(found["bridged_steps"], 1);
    assert!(found["translation"]["max"].as_f64().unwrap() < 0.5, "{found}");
    assert!(stderr.contains("the odometry is missing for 1 of 39 steps"), "{stderr}");
    let (_, stderr) = lab.ends(&["localize", "most.log", "--map", "points.csv"], 1);
    assert!(stderr.contains("38 of 39 steps"), "{stderr}");
    let found = lab.json(&["inspect", "most.log"], 0);
    assert_eq!(found["odometry_unknown_steps"], 38);
    assert!(found["commands"]["localize"].as_str().unwrap().contains("38 of 39"), "{found}");
}

/// Maps, errors and bounds are of the scans that have a reference, and how many these are is said.
#[test]
fn a_reference_with_a_gap_is_used_where_it_is() {
    let lab = Lab::new();
    lab.points(&["whole.mcap"]);
    lab.ends(&["localize", "whole.mcap", "--map", "points.csv", "-o", "out"], 0);
    let poses = fs::read_to_string(lab.path("out/reference.tum")).unwrap();
    let rows = poses.lines().enumerate().filter(|(row, _)| !(15..25).contains(row));
    let gap: String = rows.map(|(_, row)| format!("{row}\n")).collect();
    fs::write(lab.path("gap.tum"), gap).unwrap();
    let with = ["--reference", "gap.tum", "--reference-frame", "laser", "--json"];
    let call = |first: &[&'static str]| [first, &with].concat();
    let (stdout, _) = lab.ends(&call(&["inspect", "whole.mcap"]), 3);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((&found["has_reference"], &found["reference_scans"]), (&true.into(), &30.into()));
    assert!(found["bounds"].is_array(), "{found}");
    assert!(found["doubts"][0].as_str().unwrap().contains("1 gap of the reference"), "{found}");
    let (stdout, stderr) = lab.ends(&call(&["localize", "whole.mcap", "--map", "points.csv"]), 3);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(found["reference_scans"], 30);
    assert!(found["translation"]["max"].as_f64().unwrap() < 0.5, "{found}");
    assert!(stderr.contains("10 scans lie in 1 gap of the reference"), "{stderr}");
    let late: String = poses.lines().skip(10).map(|row| format!("{row}\n")).collect();
    fs::write(lab.path("late.tum"), late).unwrap();
    let late = ["--reference", "late.tum", "--reference-frame", "laser", "-o", "late.csv"];
    let (_, stderr) = lab.ends(&[&["map", "whole.mcap", "--init", "all"][..], &late].concat(), 3);
    let left_out = "10 scans are left out at the ends of the log, where poses are missing";
    assert!(stderr.contains(left_out), "{stderr}");
    // Without odometry, the reason is that there is none in the log.
    let (_, stderr) =
        lab.ends(&["map", "whole.mcap", "--reference", "none", "--init", "all", "-o", "m.csv"], 1);
    assert!(stderr.contains("--reference-topic could take /reference"), "{stderr}");
    assert!(!stderr.contains("raw log"), "{stderr}");
    // Nor is a corrected log a raw one, because its poses are not used.
    let unused = ["map", "office.log", "--reference", "none", "--init", "all", "-o", "m.csv"];
    let (_, stderr) = lab.ends(&unused, 1);
    assert!(stderr.contains("no scan has a reference pose"), "{stderr}");
    assert!(!stderr.contains("raw log"), "{stderr}");
}

/// The scans of a second laser, on request.
#[test]
fn records_of_a_second_laser_are_read_on_request() {
    let lab = Lab::new();
    let text = fs::read_to_string(lab.path("office.log")).unwrap();
    let front = lab.json(&["inspect", "office.log"], 0);
    fs::write(lab.path("rear.log"), text.replace("FLASER", "RLASER")).unwrap();
    let (stdout, stderr) = lab.ends(&["inspect", "rear.log"], 3);
    assert!(stdout.contains("ODOM 80, PARAM 1, RLASER 40"), "{stdout}");
    lab.ends(&["map", "rear.log", "--init", "all", "-o", "rear.csv"], 1);
    assert!(stderr.contains("RLASER 40") && stderr.contains("--scan-topic RLASER"), "{stderr}");
    let rear = lab.json(&["inspect", "rear.log", "--scan-topic", "RLASER"], 0);
    assert_eq!((&rear["points"], &rear["bounds"]), (&front["points"], &front["bounds"]));
    assert_eq!(rear["reference"], "poses of the laser in RLASER");
}

/// Map savers write absolute paths; the image is beside the description all the same.
#[test]
fn the_image_of_a_map_is_found_beside_its_description() {
    let lab = Lab::new();
    lab.ends(&["map", "whole.mcap", "--init", "all", "-o", "map.yaml"], 0);
    let text = fs::read_to_string(lab.path("map.yaml")).unwrap();
    let args = |name: &'static str| ["localize", "whole.mcap", "--map", name, "--json"];
    let (expected, _) = lab.ends(&args("map.yaml"), 0);
    let mean =
        |text: &str| serde_json::from_str::<Value>(text).unwrap()["weighted"]["mean"].clone();
    let moved = text.replace("image: map.pgm", "image: /home/robot/maps/map.pgm");
    fs::write(lab.path("moved.yaml"), &moved).unwrap();
    let (found, stderr) = lab.ends(&args("moved.yaml"), 0);
    assert_eq!(mean(&found), mean(&expected));
    assert!(stderr.contains("given as \"/home/robot/maps/map.pgm\""), "{stderr}");
    fs::write(lab.path("gone.yaml"), moved.replace("map.pgm", "gone.pgm")).unwrap();
    let (_, stderr) = lab.ends(&args("gone.yaml"), 1);
    assert!(stderr.contains("leads elsewhere"), "{stderr}");
}

/// A topic asked for that is not there, and a bag that is damaged after its messages: what is there is shown.
#[test]
fn inspect_shows_what_a_bag_holds_whatever_is_wrong_with_it() {
    let lab = Lab::new();
    let found = lab.json(&["inspect", "whole.mcap", "--scan-topic", "/none"], 3);
    assert!(found["problem"].as_str().unwrap().contains("no topic /none"), "{found}");
    let scans = |found: &Value| {
        let topics = found["topics"].as_array().unwrap();
        topics.iter().find(|topic| topic["name"] == "/scan").unwrap()["messages"].clone()
    };
    assert_eq!(scans(&found), 40);
    let recording = read_log(lab.path("whole.mcap").as_ref()).unwrap().recording;
    let bag = std::io::Cursor::new(Vec::new());
    let bag = mcl_datasets::bag::write_as(&recording, mcl_datasets::bag::Format::Ros1, bag);
    let mut bag = bag.unwrap().into_inner();
    // The record that follows the only chunk: what comes after it cannot be found.
    let place = bag.windows(4).position(|part| part == b"ver=").unwrap() - 16;
    bag[place..place + 4].fill(0xff);
    fs::write(lab.path("damaged.bag"), &bag).unwrap();
    let found = lab.json(&["inspect", "damaged.bag"], 3);
    assert!(found["problem"].as_str().unwrap().contains("the file is damaged"), "{found}");
    assert_eq!(scans(&found), 40);
    // Where nothing can be read, there is nothing to show.
    fs::write(lab.path("nothing.bag"), &bag[..40]).unwrap();
    lab.ends(&["inspect", "nothing.bag"], 1);
}
