//! What a recording takes from the messages of a bag.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::io::Cursor;

use crate::bag_support::*;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use mcl_core::Pose2;
use mcl_datasets::bag::{self, Encoder, types};
use mcl_datasets::log::{LogKind, ReadOptions, RecordPlace, ReferencePoses, TopicChoice, read_log};

fn with_topics(scan: Option<&str>, odometry: Option<&str>, reference: Option<&str>) -> ReadOptions {
    let topics = TopicChoice {
        scan: scan.map(str::to_owned),
        odometry: odometry.map(str::to_owned),
        reference: reference.map(str::to_owned),
    };
    ReadOptions { topics, ..ReadOptions::default() }
}

#[test]
fn a_bag_of_scans_odometry_and_a_turned_laser() {
    let log = read(&bag(&walk(4)));
    assert_eq!(log.kind, LogKind::Bag);
    assert!(log.report.is_complete() && log.report.skipped == 0 && log.assumptions.is_empty());
    let recording = &log.recording;
    assert_eq!(recording.scans.len(), 4);
    assert_eq!(recording.scans[2].stamp.unwrap().nanoseconds(), 3 * SECOND);
    assert_eq!(recording.scans[0].ranges, [1.0, 2.0, 3.0]);
    assert_eq!(recording.scans[0].geometry.start_angle, -0.75);
    assert_pose(Some(recording.robot_from_laser), 0.2, 0.0, FRAC_PI_2);
    assert_eq!(recording.scans[0].odometry, None);
    // The robot drives 1 m ahead, which is to the right of the laser.
    assert_pose(recording.scans[1].odometry, 0.0, -1.0, 0.0);
    assert!(recording.has_odometry() && !recording.has_reference());
    assert!(log.notes.iter().any(|note| note.contains("turned by 90.0°")), "{:?}", log.notes);
}

#[test]
fn every_way_to_write_a_bag_reads_the_same() {
    let entries = walk(40);
    let expected = read(&unchunked(&entries));
    assert_eq!(expected.recording.scans.len(), 40);
    for compression in [None, Some(Compression::Lz4), Some(Compression::Zstd)] {
        for (size, has_index) in [(100, true), (1000, false), (1 << 20, true), (1 << 20, false)] {
            let options = WriteOptions::new()
                .compression(compression)
                .chunk_size(Some(size))
                .emit_message_indexes(has_index)
                .emit_chunk_indexes(has_index)
                .emit_summary_records(has_index)
                .emit_summary_offsets(has_index)
                .emit_statistics(has_index);
            assert_eq!(read(&bag_as(&entries, options)), expected, "{compression:?} {size}");
        }
    }
}

#[test]
fn readings_outside_of_the_limits_are_no_returns() {
    let ranges = [0.05, 0.1, 20.0, 20.5, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0];
    let log = read(&bag(&[scan_on("/scan", SECOND, &ranges)]));
    let found = &log.recording.scans[0].ranges;
    let inf = f64::INFINITY;
    // A driver writes the limit itself where nothing came back.
    assert_eq!(found[..4], [-inf, f64::from(0.1_f32), inf, inf]);
    assert!(found[4].is_nan());
    assert_eq!(found[5..], [inf, -inf, -inf]);
    assert_eq!(log.recording.scans[0].usable_beams(100.0), 1);
    assert!(log.notes.iter().any(|note| note.contains("1 of 8 readings equal range_max")));
    // Limits that were never set are none.
    let entry = scan_with("/scan", SECOND, "laser", [0.0, 0.1], [0.0, 0.0], &[5.0, 30.0]);
    assert_eq!(read(&bag(&[entry])).recording.scans[0].ranges, [5.0, 30.0]);
}

#[test]
fn inverted_and_upside_down_scanners() {
    let entry = scan_with("/scan", SECOND, "laser", [1.5, -0.5], [0.0, 9.0], &[1.0; 7]);
    let geometry = read(&bag(std::slice::from_ref(&entry))).recording.scans[0].geometry;
    assert_eq!((geometry.start_angle, geometry.angle_step), (1.5, -0.5));
    let rolled =
        transform_on("/tf_static", 1, "base_link", "laser", [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let log = read(&bag(&[rolled, entry, odometry(SECOND, 0.0, 0.0, 0.0)]));
    let geometry = log.recording.scans[0].geometry;
    assert_eq!((geometry.start_angle, geometry.angle_step), (-1.5, 0.5));
    assert!(log.notes.iter().any(|note| note.contains("upside down")));
}

#[test]
fn odometry_is_interpolated_on_the_shorter_arc_and_never_extrapolated() {
    let entries = [
        scan(SECOND),
        odometry(2 * SECOND, 0.0, 0.0, PI - 0.2),
        scan(2 * SECOND),
        scan(2 * SECOND + SECOND / 4),
        odometry(3 * SECOND, 4.0, 0.0, -PI + 0.2),
        scan(3 * SECOND + 1),
    ];
    let log = read(&bag(&entries));
    let scans = &log.recording.scans;
    assert_eq!(
        scans.iter().map(|scan| scan.odometry.is_some()).collect::<Vec<_>>(),
        [false, false, true, false]
    );
    let step = Pose2::new(0.0, 0.0, PI - 0.2).between(&Pose2::new(1.0, 0.0, PI - 0.1));
    assert_pose(scans[2].odometry, step.x, step.y, 0.1);
    let said = log.assumptions.join("\n");
    assert!(said.contains("2 scans lie before the first or after the last odometry"), "{said}");
    let doubts = log.report.to_string();
    assert!(
        doubts.contains("at the robot's origin") && doubts.contains("--laser-pose"),
        "{doubts}"
    );
    assert!(!log.report.is_complete(), "no mount is known");
}

#[test]
fn tf_covers_scans_before_and_after_the_odometry_topic() {
    let on_tf = |at: i64, x: f64| {
        transform_on("/tf", at, "odom", "base_link", [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    };
    let mut entries = vec![on_tf(0, 0.0), scan(SECOND), odometry(2 * SECOND, 2.0, 0.0, 0.0)];
    entries.extend([scan(2 * SECOND), odometry(3 * SECOND, 3.0, 0.0, 0.0), on_tf(4 * SECOND, 4.0)]);
    let log = read(&bag(&entries));
    assert_pose(log.recording.scans[1].odometry, 1.0, 0.0, 0.0);
    // And without any topic of odometry.
    let entries = [on_tf(SECOND, 1.0), scan(SECOND), scan(2 * SECOND), on_tf(2 * SECOND, 2.5)];
    let log = read(&bag(&entries));
    assert_pose(log.recording.scans[1].odometry, 1.5, 0.0, 0.0);
    let expected = "odometry: 2 transforms from \"odom\" to \"base_link\"";
    assert!(log.notes.iter().any(|note| note == expected), "{:?}", log.notes);
    let log = read(&bag(&[scan(SECOND), scan(2 * SECOND)]));
    assert!(!log.recording.has_odometry());
    assert!(log.notes.iter().any(|note| note.contains("odometry: none")));
}

#[test]
fn reference_poses_are_of_the_robot_and_become_those_of_the_laser() {
    let mut entries = walk(3);
    for k in 0..5 {
        entries.push(pose_on("/truth", k * SECOND, Pose2::new(10.0, k as f64, FRAC_PI_2)));
        entries.push(pose_on("/goal_pose", k * SECOND, Pose2::IDENTITY));
    }
    let log = read(&bag(&entries));
    assert!(log.recording.has_reference());
    assert_pose(log.recording.scans[1].map_from_laser, 10.0, 2.2, PI);
    let none = ReadOptions::from(ReferencePoses::None);
    assert!(!bag::read(&*bag(&entries), &none).unwrap().recording.has_reference());
    let error = bag::read(&*bag(&walk(3)), &ReferencePoses::Recorded.into()).unwrap_err();
    assert_says(&error, &["no reference poses", "--reference recorded", "/odom"]);

    // Another odometry topic, of another frame of the robot.
    let mut entries = walk(3);
    let truth = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0];
    entries.push(transform_on("/tf_static", 1, "base_footprint", "base_link", truth));
    for k in 0..5 {
        let pose = Pose2::new(k as f64, 5.0, 0.0);
        entries.push(odometry_on("/gazebo", k * SECOND, "base_footprint", pose));
    }
    let two = [
        scan(1),
        odometry_on("/a", 1, "b", Pose2::IDENTITY),
        odometry_on("/b", 1, "b", Pose2::IDENTITY),
    ];
    assert_doubts(
        &read(&bag(&two)),
        &[
            "several topics of nav_msgs/msg/Odometry",
            "/a (",
            "/b (",
            "--odom-topic",
            "none is used",
        ],
    );
    let log = bag::read(&*bag(&entries), &with_topics(None, None, Some("/gazebo"))).unwrap();
    assert_pose(log.recording.scans[0].map_from_laser, 1.2, 5.0, FRAC_PI_2);
}

#[test]
fn a_reference_of_another_time_is_an_error_with_both_intervals() {
    let mut entries = walk(3);
    entries.push(pose_on("/truth", 100 * SECOND, Pose2::IDENTITY));
    entries.push(pose_on("/truth", 101 * SECOND, Pose2::IDENTITY));
    assert_says(
        &refused(&bag(&entries)),
        &["/truth", "100.000000000 s to 101.000000000 s", "1.000000000 s to 3.000000000 s"],
    );
}

#[test]
fn several_topics_are_listed_with_how_to_choose() {
    let two = [scan_on("/front", SECOND, &[1.0]), scan_on("/rear", SECOND, &[2.0, 2.0])];
    assert_says(&refused(&bag(&two)), &["/front (", "/rear (", "--scan-topic", "1 message)"]);
    let log = bag::read(&*bag(&two), &with_topics(Some("/rear"), None, None)).unwrap();
    assert_eq!(log.recording.scans[0].ranges, [2.0, 2.0]);
    // The obvious one.
    let three = [scan_on("/front", SECOND, &[1.0]), scan(SECOND)];
    assert_eq!(read(&bag(&three)).recording.scans[0].ranges.len(), 3);

    let error = bag::read(&*bag(&walk(2)), &with_topics(Some("/scam"), None, None)).unwrap_err();
    assert_says(&error, &["no topic /scam", "--scan-topic", "/scan (sensor_msgs/msg/LaserScan, 2"]);
    let error = bag::read(&*bag(&walk(2)), &with_topics(Some("/odom"), None, None)).unwrap_err();
    assert_says(&error, &["/odom", "nav_msgs/msg/Odometry", "expected sensor_msgs/msg/LaserScan"]);
    assert_says(&refused(&bag(&walk(2)[1..2])), &["no sensor_msgs/msg/LaserScan", "/odom ("]);
    let truths = [scan(1), pose_on("/a", 1, Pose2::IDENTITY), pose_on("/b", 1, Pose2::IDENTITY)];
    assert_doubts(&read(&bag(&truths)), &["several topics of poses", "--reference-topic"]);
    let recorded = ReferencePoses::Recorded.into();
    assert_says(&bag::read(&*bag(&truths), &recorded).unwrap_err(), &["several topics of poses"]);
}

#[test]
fn messages_are_decoded_by_the_schema_of_the_bag() {
    // Other fields, another order, big-endian, and in IDL.
    let msg = "float32[] ranges\nuint8 quality\nfloat32 range_max\nfloat32 range_min\n\
               float32 angle_increment\nfloat32 angle_min\nstd_msgs/Header header\nstring note\n\
               ================\nMSG: std_msgs/Header\nstring frame_id\nbuiltin_interfaces/Time stamp\n";
    let mut data = vec![0, 0, 0, 0];
    data.extend(2_u32.to_be_bytes());
    data.extend([1.5_f32, 2.5].map(f32::to_be_bytes).concat());
    data.extend([7, 0, 0, 0]);
    data.extend([9.0_f32, 0.5, 0.25, -1.0].map(f32::to_be_bytes).concat());
    data.extend(6_u32.to_be_bytes());
    data.extend(b"laser\0\0\0");
    data.extend([5_u32, 250, 3].map(u32::to_be_bytes).concat());
    data.extend(b"ok\0");
    let mut entry = scan(SECOND);
    entry.schema.2 = msg.into();
    entry.data = data;
    let log = read(&bag(&[entry.clone()]));
    let scan = &log.recording.scans[0];
    assert_eq!(scan.ranges, [1.5, 2.5]);
    assert_eq!((scan.geometry.start_angle, scan.geometry.angle_step), (-1.0, 0.25));
    assert_eq!(scan.stamp.unwrap().nanoseconds(), 5 * SECOND + 250);

    let idl = "module sensor_msgs { module msg { struct LaserScan { sequence<float> ranges; octet quality; \
               float range_max; float range_min, angle_increment; float angle_min; \
               std_msgs::msg::Header header; string note; }; }; };\n\
               ====\nIDL: std_msgs/msg/Header\nmodule std_msgs { module msg { struct Header { string frame_id; \
               builtin_interfaces::msg::Time stamp; }; }; };";
    let mut in_idl = entry.clone();
    in_idl.schema = (entry.schema.0.clone(), "ros2idl".into(), idl.into());
    assert_eq!(read(&bag(&[in_idl])).recording, log.recording);

    let mut lacking = entry.clone();
    lacking.schema.2 = msg.replace("float32 angle_min", "float32 angle_first").into();
    let error = refused(&bag(&[lacking]));
    assert_says(&error, &["/scan", "sensor_msgs/msg/LaserScan", "no field angle_min"]);
    let mut unread = entry.clone();
    unread.schema.2 = "float32 [] ranges".into();
    assert_says(&refused(&bag(&[unread])), &["/scan", "line 1", "float32 [] ranges"]);
    let mut other = entry;
    other.encoding = "json";
    assert_says(&refused(&bag(&[other])), &["/scan", "\"json\"", "expected \"cdr\""]);
}

#[test]
fn malformed_messages_are_skipped_and_named() {
    let mut entries = walk(5);
    entries[4].data.truncate(30); // The second scan.
    entries[6].data[1] = 9; // The third.
    let mut bad = Encoder::default();
    bad.u32(0xffff_ffff);
    entries.push(Entry { data: bad.into_bytes(), ..entries[0].clone() });
    let log = read(&bag(&entries));
    assert_eq!((log.recording.scans.len(), log.report.skipped), (3, 3));
    // The increment spans them.
    assert_pose(log.recording.scans[1].odometry, 0.0, -3.0, 0.0);
    let details = &log.report.skipped_details;
    let RecordPlace::Message { topic, log_time, .. } = &details[0].place else { panic!() };
    assert_eq!((topic.as_str(), *log_time), ("/scan", 2 * SECOND as u64));
    let text = log.report.to_string();
    for part in ["/scan at 2.000000000 s", "ends at byte 30", "0x0009", "transforms"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // When nothing is left, the reason is reported.
    let mut only = scan(SECOND);
    only.data.truncate(10);
    assert_says(&refused(&bag(&[only])), &["no sensor_msgs/msg/LaserScan", "ends at byte 10"]);
}

#[test]
fn scans_without_a_stamp_get_the_time_they_were_logged() {
    let mut entries = walk(3);
    let mut unstamped = scan(0);
    unstamped.log_time = 2 * SECOND as u64;
    entries[4] = unstamped;
    let log = read(&bag(&entries));
    assert_eq!(log.recording.scans[1].stamp.unwrap().nanoseconds(), 2 * SECOND);
    assert!(
        log.assumptions[0].contains("without a stamp in their header: 1"),
        "{:?}",
        log.assumptions
    );
}

/// A bag may come from anywhere: it must not make us read files elsewhere.
#[test]
fn a_bag_that_lists_files_elsewhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("inside");
    std::fs::create_dir_all(inside.join("sub")).unwrap();
    let outside = folder.path().join("outside.mcap");
    let bytes = bag(&walk(4));
    let list = |path: &str| {
        let text = format!(
            "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:\n    - {path:?}\n"
        );
        std::fs::write(inside.join("metadata.yaml"), text).unwrap();
        read_log(&inside)
    };
    for there in [&outside, &inside.join("a.mcap"), &inside.join("sub/a.mcap")] {
        std::fs::write(there, &bytes).unwrap();
    }
    for path in ["a.mcap", "./a.mcap", "sub/a.mcap"] {
        assert!(list(path).is_ok(), "{path}");
    }
    let absolute = outside.display().to_string();
    for path in [
        "../outside.mcap",
        "sub/../../outside.mcap",
        "sub/../a.mcap",
        "..",
        "",
        &absolute,
        "..\\outside.mcap",
        "C:\\outside.mcap",
        "C:outside.mcap",
        "a.mcap\0",
    ] {
        let message = list(path).unwrap_err().to_string();
        assert!(message.contains("inside") && message.contains("metadata.yaml"), "{message}");
        assert!(message.contains("relative_file_paths lists"), "{path}: {message}");
        assert!(message.contains("expected paths below the folder"), "{message}");
    }
}

#[test]
fn a_description_of_a_bag_without_end_is_not_read_on() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("metadata.yaml"), vec![b'#'; (1 << 24) + 1]).unwrap();
    let message = read_log(folder.path()).unwrap_err().to_string();
    assert!(message.contains("longer than 16777216 bytes"), "{message}");
}

#[test]
fn a_split_bag_is_read_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let entries = walk(6);
    let whole = read(&bag(&entries));
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("b_0.mcap"), bag(&entries[..5])).unwrap();
    std::fs::write(at("a_1.mcap"), unchunked(&entries[5..])).unwrap();
    let error = read_log(folder.path()).unwrap_err().to_string();
    assert!(error.contains("metadata.yaml"), "{error}");
    let yaml = |storage: &str, mode: &str| {
        format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n  \
             compression_mode: \"{mode}\"\n  relative_file_paths:\n    - b_0.mcap\n    - a_1.mcap\n"
        )
    };
    std::fs::write(at("metadata.yaml"), yaml("mcap", "")).unwrap();
    assert_eq!(read_log(folder.path()).unwrap(), whole);
    for (text, expected) in [
        (
            yaml("mcap", "FILE").replace("  relative", "  compression_format: lz4\n  relative"),
            "lz4",
        ),
        (yaml("mcap", "").replace("a_1.mcap", "./b_0.mcap"), "lists \"./b_0.mcap\" twice"),
        ("x: [".to_owned(), "metadata.yaml"),
        (yaml("mcap", "").replace("a_1", "c_1"), "c_1.mcap: no such file"),
    ] {
        std::fs::write(at("metadata.yaml"), text).unwrap();
        let error = read_log(folder.path()).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    std::fs::remove_file(at("metadata.yaml")).unwrap();
    std::fs::remove_file(at("a_1.mcap")).unwrap();
    std::fs::write(at("b_0.mcap"), bag(&entries)).unwrap();
    assert_eq!(read_log(folder.path()).unwrap(), whole);
}

/// Found while writing its fuzz target: each new topic was compared with a copy of every one before it, minutes
/// for a file of two megabytes.
#[test]
fn a_file_of_as_many_topics_as_there_can_be() {
    let mut writer = WriteOptions::new().compression(None).create(Cursor::new(Vec::new())).unwrap();
    let text = types::LASER_SCAN.description();
    let schema = writer.add_schema(types::LASER_SCAN.name, "ros2msg", text.as_bytes()).unwrap();
    for index in 0..20_000 {
        let name = format!("/scan_{index}");
        let id = writer.add_channel(schema, &name, "cdr", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id: id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &[]).unwrap();
    }
    writer.finish().unwrap();
    let error = refused(&writer.into_inner().into_inner());
    assert_says(&error, &["/scan_0 ", "… and 19900 more", "--scan-topic"]);
}
