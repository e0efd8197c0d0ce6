//! Bags that other programs wrote: the format's conformance suite and bags of rosbag2 (where
//! `MCL_MCAP_DIR` names the folder of their archives), and the Olin bag (`MCL_DATA_DIR`).

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcl_datasets::bag::cdr::decode_prefix;
use mcl_datasets::bag::schema::MessageSchema;
use mcl_datasets::bag::{self, BagError, PoseRequest, PoseRole};
use mcl_datasets::container::item::Item;
use mcl_datasets::container::mcap::read_stream;
use mcl_datasets::log::{ReadOptions, read_log, read_poses};
use serde_json::Value;

/// The files of an archive by name.
fn archive(name: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = std::env::var_os("MCL_MCAP_DIR").expect("MCL_MCAP_DIR is set");
    let file = std::fs::File::open(Path::new(&folder).join(name)).unwrap();
    let mut files = BTreeMap::new();
    for entry in tar::Archive::new(liblzma::read::XzDecoder::new(file)).entries().unwrap() {
        let mut entry = entry.unwrap();
        let path: PathBuf = entry.path().unwrap().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        files.insert(path.to_string_lossy().into_owned(), bytes);
    }
    files
}

/// A message as both sides know it: topic, sequence, log and publish time, bytes.
type Seen = (String, u32, u64, u64, Vec<u8>);

fn messages(bytes: &[u8]) -> (Vec<Seen>, Option<String>) {
    let mut seen = Vec::new();
    let end = read_stream(bytes, |item| {
        if let Item::Message(message) = item {
            seen.push((
                message.channel.topic.clone(),
                message.sequence,
                message.log_time,
                message.publish_time,
                message.data.to_vec(),
            ));
        }
        Ok(())
    });
    (seen, end.unwrap())
}

/// The messages that the suite's JSON expects.
fn expected(json: &Value) -> Vec<Seen> {
    let mut topics = BTreeMap::new();
    let mut expected = Vec::new();
    for record in json["records"].as_array().unwrap() {
        let fields: BTreeMap<&str, &Value> = record["fields"]
            .as_array()
            .unwrap()
            .iter()
            .map(|pair| (pair[0].as_str().unwrap(), &pair[1]))
            .collect();
        let number = |value: &Value| value.as_str().unwrap().parse::<u64>().unwrap();
        match record["type"].as_str().unwrap() {
            "Channel" => {
                let topic = fields["topic"].as_str().unwrap().to_owned();
                topics.insert(number(fields["id"]), topic);
            }
            "Message" => expected.push((
                topics[&number(fields["channel_id"])].clone(),
                number(fields["sequence"]) as u32,
                number(fields["log_time"]),
                number(fields["publish_time"]),
                fields["data"].as_array().unwrap().iter().map(|b| number(b) as u8).collect(),
            )),
            _ => {}
        }
    }
    expected
}

#[test]
#[cfg_attr(
    not(real_data = "conformance.tar.xz"),
    ignore = "needs conformance.tar.xz in MCL_MCAP_DIR"
)]
fn the_conformance_suite() {
    let files = archive("conformance.tar.xz");
    let (mut count, mut with_messages) = (0, 0);
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".mcap")) {
        let json = &files[&name.replace(".mcap", ".json")];
        let expected = expected(&serde_json::from_slice(json).unwrap());
        let (seen, end) = messages(bytes);
        assert_eq!(end, None, "{name}");
        assert_eq!(seen, expected, "{name}");
        // None of them holds a scan, and none is invented.
        let error = bag::read(&**bytes, &ReadOptions::default()).unwrap_err();
        assert!(matches!(error, BagError::NoScan { .. }), "{name}: {error}");
        count += 1;
        with_messages += usize::from(!seen.is_empty());
    }
    assert_eq!(count, 416);
    assert!(with_messages > 100, "{with_messages}");
}

#[test]
#[cfg_attr(not(real_data = "rosbag2.tar.xz"), ignore = "needs rosbag2.tar.xz in MCL_MCAP_DIR")]
fn bags_of_rosbag2_and_every_message_in_them() {
    let files = archive("rosbag2.tar.xz");
    let bags = files.iter().filter(|(name, _)| name.ends_with(".mcap"));
    let (mut count, mut decoded) = (0, 0);
    let mut unread = BTreeMap::new();
    for (name, bytes) in bags {
        let error = bag::read(&**bytes, &ReadOptions::default()).unwrap_err();
        assert!(matches!(error, BagError::NoScan { .. }), "{name}: {error}");
        count += 1;
        let end = read_stream(&**bytes, |item| {
            let Item::Message(message) = item else { return Ok(()) };
            let Some(schema) = message.channel.schema.as_deref() else { return Ok(()) };
            if message.channel.message_encoding != "cdr" || schema.encoding != "ros2msg" {
                return Ok(());
            }
            let parsed = match MessageSchema::parse(&schema.name, &schema.encoding, &schema.data) {
                Ok(parsed) => parsed,
                Err(error) => {
                    unread.insert(schema.name.clone(), error.to_string());
                    return Ok(());
                }
            };
            let (_, length) = decode_prefix(&parsed, message.data)
                .unwrap_or_else(|error| panic!("{name}: {}: {error}", schema.name));
            // To the last byte, but for padding.
            let left = message.data.len() - length;
            assert!(left < 4, "{name}: {}: {left} bytes left", schema.name);
            decoded += 1;
            Ok(())
        });
        assert_eq!(end.unwrap(), None, "{name}");
    }
    assert_eq!(count, 20);
    assert!(decoded > 9000, "{decoded}");
    eprintln!("{decoded} messages decoded; schemas refused: {unread:?}");
}

#[test]
#[cfg_attr(not(real_data = "olin-mac"), ignore = "needs olin-mac in MCL_DATA_DIR")]
fn the_olin_bag() {
    let folder = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let folder = Path::new(&folder).join("olin-mac");
    let log = read_log(&folder.join("take2_zstd.mcap")).unwrap();
    assert_eq!(read_log(&folder).unwrap(), log, "as the folder of a bag");
    assert!(log.report.is_complete());
    let recording = &log.recording;
    assert_eq!(recording.scans.len(), 357);
    assert!(recording.scans.iter().all(|scan| scan.ranges.len() == 720));
    assert!(log.notes.iter().any(|note| note.contains("/odom, 920 messages")), "{:?}", log.notes);
    let mount = recording.robot_from_laser;
    assert!((mount.x - 0.003_935_84).abs() < 1e-12 && mount.y.abs() < 1e-12);
    assert!((mount.theta.to_degrees() - 90.0).abs() < 1e-9);
    let infinite = recording.scans.iter().flat_map(|scan| &scan.ranges).filter(|r| r.is_infinite());
    assert!(infinite.count() > 1000);
    assert!(!recording.has_reference());
    // /tf reaches back before the first scan; only the last lies 0.5 ms after all odometry.
    let without: Vec<usize> =
        (1..357).filter(|&index| recording.scans[index].odometry.is_none()).collect();
    assert_eq!(without, [356]);
    assert!((recording.path_length_m() - 8.3).abs() < 0.1, "{}", recording.path_length_m());
}

/// Bags of the test data of evo and LAMBKIN, where `MCL_BAG_DIR` names their folder: a ROS 1 bag and a
/// database of the same transforms, one of strings, and one of a TurtleBot without its scans.
#[test]
#[cfg_attr(not(real_data = "tf_example.bag"), ignore = "needs tf_example.bag in MCL_BAG_DIR")]
fn bags_of_ros_1_and_databases() {
    let folder = PathBuf::from(std::env::var_os("MCL_BAG_DIR").expect("MCL_BAG_DIR is set"));
    let refused = |name: &str| read_log(&folder.join(name)).unwrap_err().to_string();
    let message = refused("basic.bag");
    assert!(message.ends_with("topics: /input (std_msgs/String, 47 messages)"), "{message}");
    for name in ["tf_example.bag", "tf_example", "tf_example/tf_example.db3"] {
        assert!(refused(name).contains("TFMessage, 517 messages"), "{}", refused(name));
    }
    assert!(refused("nav2_turtlebot.mcap").contains("/amcl_pose"));
    let poses = |name: &str, topic: &str| {
        let request = PoseRequest { topic: Some(topic), ..PoseRequest::of(PoseRole::Reference) };
        read_poses(&folder.join(name), &request).unwrap().trajectory
    };
    let of_ros1 = poses("tf_example.bag", "/tf:odom.base_link");
    assert!(of_ros1.len() > 100, "{}", of_ros1.len());
    assert_eq!(poses("tf_example", "/tf:odom.base_link"), of_ros1);
    assert_eq!(poses("nav2_turtlebot.mcap", "/amcl_pose").len(), 135);
    assert!(poses("nav2_turtlebot.mcap", "/tf:map.base_footprint").len() > 1000);
}
