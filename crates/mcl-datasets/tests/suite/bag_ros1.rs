//! ROS 1 bags: the same recording as from an MCAP file of the same messages, whole or in part.

use std::io::Read;

use crate::bag_support::ros1::*;
use crate::bag_support::*;
use mcl_core::Pose2;
use mcl_datasets::bag::{self, MAX_CHUNK_BYTES};
use mcl_datasets::log::{Log, ReadOptions, read_log};
use proptest::prelude::*;

fn with_reference() -> Vec<Entry> {
    let mut entries = walk(60);
    for k in 0..62 {
        entries.push(pose_on("/ground_truth", k * SECOND, Pose2::new(k as f64, 2.0, 0.25)));
    }
    entries
}

/// Everything but the names of topics' types.
fn assert_same(found: &Log, expected: &Log) {
    assert_eq!(found.recording, expected.recording);
    assert_eq!(found.notes, expected.notes);
    assert_eq!(found.report, expected.report);
}

#[test]
fn every_way_to_write_it_reads_the_same_as_mcap() {
    let entries = with_reference();
    let expected = read(&bag(&entries));
    assert_eq!(expected.recording.scans.len(), 60);
    assert!(expected.recording.has_reference() && expected.recording.has_odometry());
    for compression in ["none", "bz2", "lz4"] {
        for chunk in [1, 7, 1000] {
            let bytes = ros1_bag(&entries, Ros1Options { compression, chunk, ..ROS1 });
            assert_same(&read(&bytes), &expected);
        }
    }
    // A bag that was never closed lacks nothing but its index, and says so.
    let log = read(&ros1_bag(&entries, Ros1Options { has_index: false, ..ROS1 }));
    assert_eq!(log.recording, expected.recording);
    assert!(log.report.truncated.unwrap().contains("never closed"));
    // Records that stand in no chunk.
    let bytes = ros1_bag(&entries, Ros1Options { chunk: 1000, ..ROS1 });
    let start = bag_header(0, 0, 0).len();
    let head = 4 + u32::from_le_bytes(bytes[start..start + 4].try_into().unwrap()) as usize;
    let loose = [&bytes[..start], &bytes[start + head + 4..]].concat();
    assert_eq!(read(&loose).recording, expected.recording);
}

#[test]
fn it_is_recognized_by_its_bytes_plain_or_packed() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = ros1_bag(&with_reference(), ROS1);
    let expected = read(&bytes);
    let packed = zstd::encode_all(&*bytes, 1).unwrap();
    for (name, bytes) in [("a.mcap", &bytes), ("a.log", &bytes), ("a.bag.zst", &packed)] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(read_log(&path).unwrap(), expected, "{name}");
    }
}

/// What a recorder leaves that is stopped by force: a last chunk whose length it never wrote.
#[test]
fn a_chunk_that_was_never_finished_is_read_as_far_as_it_goes() {
    let entries = walk(10);
    let bytes = ros1_bag(&entries, Ros1Options { chunk: 1000, has_index: false, ..ROS1 });
    let mut active = bytes.clone();
    let start = bag_header(0, 0, 0).len();
    let head = 4 + u32::from_le_bytes(bytes[start..start + 4].try_into().unwrap()) as usize;
    active[start + head..start + head + 4].fill(0);
    active.truncate(active.len() - 300);
    let log = read(&active);
    assert_eq!(log.recording.scans[..8], read(&bytes).recording.scans[..8]);
    assert!(log.report.truncated.unwrap().contains("ends within a record"));
    // Packed, nothing of it can be recognized.
    let mut active = ros1_bag(&entries, Ros1Options { chunk: 8, has_index: false, ..ROS1 });
    chunk(&mut active, "bz2", 0, b"");
    active.extend(b"BZh91AY&SY and so on, for some hundred bytes".repeat(9));
    let log = read(&active);
    assert_eq!(log.recording.scans, read(&bytes).recording.scans);
    assert!(log.report.truncated.unwrap().contains("its last chunk was never finished"));
}

#[test]
fn a_truncated_bag_keeps_what_came_before_the_cut() {
    let entries = walk(60);
    for compression in ["none", "bz2", "lz4"] {
        let bytes = ros1_bag(&entries, Ros1Options { compression, chunk: 9, has_index: true });
        let ends = (20..bytes.len()).step_by(89).chain([bytes.len() - 1, bytes.len() - 20]);
        let seen = most_scans_of_cuts(compression, &bytes, ends);
        assert_eq!(seen, 60, "{compression}: cut in the index, nothing is lost");
    }
    // Also within a chunk that is not packed.
    let plain = ros1_bag(&entries, Ros1Options { chunk: 1000, ..ROS1 });
    assert!(read(&plain[..plain.len() / 2]).recording.scans.len() > 10);
}

#[test]
fn several_publishers_of_one_topic_are_one_topic() {
    let entries = walk(3);
    let mut bytes = ros1_bag(&entries, Ros1Options { has_index: false, ..ROS1 });
    let mut records = Vec::new();
    let text = mcl_datasets::bag::types::LASER_SCAN.description_of_ros1();
    connection(&mut records, 99, "/scan", "sensor_msgs/LaserScan", &text);
    message(&mut records, 99, 9, b"short");
    chunk(&mut bytes, "none", records.len() as u32, &records);
    let log = read(&bytes);
    assert_eq!((log.recording.scans.len(), log.report.skipped), (3, 1));
    assert!(log.report.to_string().contains("/scan at 0.000000009 s (byte "), "{}", log.report);
}

#[test]
fn bytes_made_to_harm_are_refused_with_their_place() {
    let start = bag_header(0, 0, 0).len();
    let file = |body: &[u8]| [&bag_header(1 << 40, 0, 0)[..], body].concat();
    let place = format!("at byte {start}");
    // Lengths beyond anything.
    let huge = [0xff, 0xff, 0xff, 0xff, b'x'];
    assert_says(&refused(&file(&huge)), &[&place, "4294967295 bytes long"]);
    let mut long = Vec::new();
    record(&mut long, &[("op", &[2])], b"");
    let at = long.len() - 4;
    long[at..].fill(0xff);
    assert_says(&refused(&file(&long)), &[&place, "4294967295 bytes long"]);
    // Bombs that say what they are, and those that lie.
    let zeros = 200 << 20;
    let mut bomb = Vec::new();
    bzip2::read::BzEncoder::new(std::io::repeat(0).take(zeros), Default::default())
        .read_to_end(&mut bomb)
        .unwrap();
    assert!(bomb.len() < 1000);
    let chunk_of = |compression: &str, size: u32, packed: &[u8]| {
        let mut body = Vec::new();
        chunk(&mut body, compression, size, packed);
        file(&body)
    };
    let honest = refused(&chunk_of("bz2", zeros as u32, &bomb));
    assert_says(&honest, &[&place, "unpacks to", &MAX_CHUNK_BYTES.to_string()]);
    let lie = refused(&chunk_of("bz2", 100, &bomb));
    assert_says(&lie, &[&place, "unpacks to 100 bytes, found 101 or more"]);
    assert_says(&refused(&chunk_of("zstd", 1, b"x")), &["\"zstd\"", "none, bz2 or lz4"]);
    assert_says(&refused(&chunk_of("lz4", 1, b"x")), &["does not unpack as lz4"]);
    // A chunk in a chunk, and so on, is no chunk.
    let mut inner = Vec::new();
    chunk(&mut inner, "none", 0, b"");
    assert_says(
        &refused(&chunk_of("none", inner.len() as u32, &inner)),
        &[&place, "op is neither"],
    );
    // Messages of nothing, connections that change, headers that are none.
    let mut body = Vec::new();
    message(&mut body, 3, 1, b"");
    assert_says(&refused(&file(&body)), &[&place, "of channel 3"]);
    let mut body = Vec::new();
    connection(&mut body, 1, "/a", "std_msgs/String", "string data\n");
    connection(&mut body, 1, "/b", "std_msgs/String", "string data\n");
    assert_says(&refused(&file(&body)), &["two Connection records of number 1 differ"]);
    let mut body = Vec::new();
    record(&mut body, &[("op", &[7, 7])], b"");
    assert_says(&refused(&file(&body)), &["op is of another length"]);
    let mut encrypted = b"#ROSBAG V2.0\n".to_vec();
    record(&mut encrypted, &[("op", &[3]), ("encryptor", b"rosbag/AesCbcEncryptor")], b"");
    assert_says(&refused(&encrypted), &["encrypted (rosbag/AesCbcEncryptor)"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_make_the_reader_panic(
        which in 0..3_usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let compression = ["none", "bz2", "lz4"][which];
        let mut bytes = ros1_bag(&walk(4), Ros1Options { compression, chunk: 4, has_index: true });
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(log) = bag::read(&*bytes, &ReadOptions::default()) {
            prop_assert!(log.recording.scans.len() <= 4);
        }
    }

    #[test]
    fn nor_do_bytes_after_the_magic(rest in prop::collection::vec(any::<u8>(), 0..300)) {
        let bytes = [b"#ROSBAG V2.0\n", &*rest].concat();
        prop_assert!(bag::read(&*bytes, &ReadOptions::default()).is_err());
    }
}
