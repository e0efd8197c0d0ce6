//! Databases of rosbag2: the same recording as from an MCAP file of the same messages, whole or in part.

use std::time::{Duration, Instant};

use crate::bag_support::database::{database, write_database};
use crate::bag_support::*;
use mcl_core::Pose2;
use mcl_datasets::bag;
use mcl_datasets::log::{ReadOptions, read_log};
use proptest::prelude::*;
use rusqlite::Connection;

fn with_reference() -> Vec<Entry> {
    let mut entries = walk(60);
    for k in 0..62 {
        entries.push(pose_on("/ground_truth", k * SECOND, Pose2::new(k as f64, 2.0, 0.25)));
    }
    entries
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    zstd::encode_all(bytes, 1).unwrap()
}

fn metadata(files: &[&str], more: &str) -> String {
    let files: String = files.iter().map(|name| format!("  - {name}\n")).collect();
    format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  \
         relative_file_paths:\n{files}{more}"
    )
}

#[test]
fn a_database_reads_the_same_as_mcap() {
    let entries = with_reference();
    let expected = read(&bag(&entries));
    assert!(expected.recording.has_reference() && expected.recording.has_odometry());
    let bytes = database(&entries, true);
    assert_eq!(read(&bytes), expected, "as a stream");
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // A name with characters that mean something in SQLite's addresses.
    for (name, bytes) in [("50% ü?#&.db3", bytes.clone()), ("a.bag", zstd(&bytes))] {
        std::fs::write(at(name), bytes).unwrap();
        assert_eq!(read_log(&at(name)).unwrap(), expected, "{name}");
        std::fs::remove_file(at(name)).unwrap();
    }
    // Without descriptions, as before 2023.
    let log = read(&database(&entries, false));
    assert_eq!(log.recording, expected.recording);
    let notes = log.notes.join("\n");
    for topic in ["/scan", "/odom", "/tf_static", "/ground_truth"] {
        assert!(notes.contains(&format!("{topic}: the bag does not describe")), "{notes}");
    }
    // Each message compressed on its own.
    let mut packed = entries.clone();
    packed.iter_mut().for_each(|entry| entry.data = zstd(&entry.data));
    assert_eq!(read(&database(&packed, true)), expected);
    assert_eq!(read(&bag(&packed)), expected);
}

#[test]
fn the_folder_of_a_split_bag_packed_file_by_file() {
    let entries = with_reference();
    let expected = read(&bag(&entries));
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_database(&at("b_0.db3"), &entries[..70], true);
    assert_eq!(read_log(folder.path()).unwrap(), read(&bag(&entries[..70])), "the only file");
    write_database(&at("b_1.db3"), &entries[70..], true);
    let error = read_log(folder.path()).unwrap_err().to_string();
    assert!(error.contains("2 files of bags but no metadata.yaml"), "{error}");
    let list = |files: &[&str], more: &str| {
        std::fs::write(at("metadata.yaml"), metadata(files, more)).unwrap();
        read_log(folder.path())
    };
    assert_eq!(list(&["b_0.db3", "b_1.db3"], "").unwrap(), expected);
    // The folder's name before that of the file, as the first versions wrote it.
    assert_eq!(list(&["bag/b_0.db3", "bag/b_1.db3"], "").unwrap(), expected);
    for name in ["b_0.db3", "b_1.db3"] {
        let packed = zstd(&std::fs::read(at(name)).unwrap());
        std::fs::write(at(&format!("{name}.zstd")), packed).unwrap();
        std::fs::remove_file(at(name)).unwrap();
    }
    let by_file = "  compression_format: zstd\n  compression_mode: FILE\n";
    assert_eq!(list(&["b_0.db3.zstd", "b_1.db3.zstd"], by_file).unwrap(), expected);
    assert_eq!(list(&["b_0.db3", "b_1.db3"], by_file).unwrap(), expected);
    // A cut file: which, and how far.
    write_database(&at("long.db3"), &walk(4000), true);
    let whole = zstd(&std::fs::read(at("long.db3")).unwrap());
    std::fs::write(at("b_1.db3.zstd"), &whole[..whole.len() * 3 / 4]).unwrap();
    let log = list(&["b_0.db3", "b_1.db3"], by_file).unwrap();
    let reason = log.report.truncated.unwrap();
    assert!(reason.starts_with("b_1.db3.zstd: the compressed data is cut off after"), "{reason}");
    assert!(log.recording.scans.len() > 1000, "{}", log.recording.scans.len());
}

#[test]
fn a_truncated_database_keeps_what_came_before_the_cut() {
    let entries = walk(300);
    let bytes = database(&entries, true);
    let whole = read(&bytes);
    let (mut before, mut refused) = (0, 0);
    for end in (200..bytes.len() - 1).step_by(1531) {
        match bag::read(&bytes[..end], &ReadOptions::default()) {
            Ok(log) => {
                let scans = &log.recording.scans;
                for (found, expected) in scans.iter().zip(&whole.recording.scans) {
                    assert_eq!((found.stamp, &found.ranges), (expected.stamp, &expected.ranges));
                }
                assert!(scans.len() >= before);
                before = scans.len();
                let reason = log.report.truncated.unwrap();
                let said = format!("has {end} bytes, its header says {}", bytes.len());
                assert!(reason.contains(&said), "{reason}");
            }
            Err(_) => refused += 1,
        }
    }
    assert!(before > 250, "{before} of 300 scans");
    assert!(refused * 1531 < bytes.len() / 2, "{refused}");
}

/// A recorder that is killed leaves the last messages beside the database.
#[test]
fn messages_in_a_write_ahead_log_are_read_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let entries = walk(6);
    write_database(&at("a.db3"), &entries[..7], true);
    let recorder = Connection::open(at("a.db3")).unwrap();
    recorder.execute_batch("PRAGMA journal_mode = WAL;").unwrap();
    for entry in &entries[7..] {
        let topic = if entry.topic == "/scan" { 3 } else { 2 };
        let row = (topic, entry.log_time as i64, entry.data.clone());
        let insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
        recorder.execute(insert, row).unwrap();
    }
    let copies = ["a.db3", "a.db3-wal"].map(|name| std::fs::read(at(name)).unwrap());
    drop(recorder);
    for name in ["a.db3", "a.db3-wal"] {
        let index = usize::from(name.ends_with("-wal"));
        std::fs::write(at(name), &copies[index]).unwrap();
    }
    assert_eq!(read_log(&at("a.db3")).unwrap().recording, read(&bag(&entries)).recording);
    let mut left: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["a.db3", "a.db3-wal"]);
    assert_eq!(["a.db3", "a.db3-wal"].map(|name| std::fs::read(at(name)).unwrap()), copies);
}

/// A database of these tables; then changed byte by byte.
fn made(sql: &str, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.db3");
    let database = Connection::open(&path).unwrap();
    database.execute_batch(sql).unwrap();
    database.close().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    change(&mut bytes);
    bytes
}

const TOPICS: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format); \
    INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr');";

#[test]
fn databases_of_something_else_are_refused_with_the_reason() {
    let messages = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data);";
    let row = "INSERT INTO messages VALUES (7, 1, 2, x'00');";
    for (sql, expected) in [
        ("CREATE TABLE people(name);".to_owned(), "no table topics"),
        (TOPICS.to_owned(), "no table messages"),
        // What looks like a table and runs a query without end.
        (
            format!(
                "{TOPICS} CREATE VIEW messages AS WITH RECURSIVE n(id) AS \
                 (SELECT 1 UNION ALL SELECT id + 1 FROM n) \
                 SELECT id, 1 AS topic_id, 1 AS timestamp, x'' AS data FROM n;"
            ),
            "no table messages",
        ),
        (format!("{TOPICS} CREATE TABLE messages(id, data);"), "no such column: topic_id"),
        (
            format!(
                "{TOPICS} CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data) WITHOUT ROWID;"
            ),
            "no such column: rowid",
        ),
        (
            format!("{TOPICS} {messages} {}", row.replace("1, 2", "9, 2")),
            "row 7: messages skipped: topic_id is 9, expected the number of a topic",
        ),
        (
            format!("{TOPICS} {messages} {}", row.replace("x'00'", "'text'")),
            "row 7: messages skipped: data is of type Text, expected a BLOB",
        ),
        (
            format!("{TOPICS} {messages} {}", row.replace("1, 2", "1, 'x'")),
            "row 7: messages skipped: timestamp is of type Text, expected INTEGER",
        ),
        (
            format!("{} {messages} {row}", TOPICS.replace("'/scan'", "NULL")),
            "row 1: topics skipped: name is of type Null, expected TEXT",
        ),
        (
            format!(
                "{TOPICS} {messages} WITH RECURSIVE n(id) AS (SELECT 2 UNION ALL SELECT id + 1 FROM n \
                 WHERE id < 66000) INSERT INTO topics SELECT id, '/' || id, 'a', 'cdr' FROM n;"
            ),
            "topics has more than 65535 rows",
        ),
    ] {
        assert_says(&refused(&made(&sql, |_| ())), &[expected]);
    }
}

/// It cost the whole file.
#[test]
fn a_row_of_other_values_costs_itself_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.db3");
    let entries = walk(20);
    let whole = read(&bag(&entries));
    let change = |sql: &str| {
        let _ = std::fs::remove_file(&path);
        write_database(&path, &entries, true);
        let database = Connection::open(&path).unwrap();
        // Older versions do not say what a column holds.
        database
            .execute_batch(&format!(
                "CREATE TABLE loose(id INTEGER PRIMARY KEY, topic_id, timestamp, data);
                 INSERT INTO loose SELECT id, topic_id, timestamp, data FROM messages;
                 DROP TABLE messages; ALTER TABLE loose RENAME TO messages; {sql}"
            ))
            .unwrap();
        database.close().unwrap();
        read_log(&path).unwrap()
    };
    assert_eq!(change("").recording, whole.recording);
    // Rows 1 to 41: the mount, then odometry and scans in turn.
    for (value, reason) in [
        ("data = NULL", None),
        ("data = 'text'", Some("data is of type Text, expected a BLOB")),
        ("data = 7", Some("data is of type Integer, expected a BLOB")),
        ("timestamp = 'noon'", Some("timestamp is of type Text, expected INTEGER")),
        ("timestamp = 1.5", Some("timestamp is of type Real, expected INTEGER")),
        ("timestamp = NULL", Some("timestamp is of type Null, expected INTEGER")),
        ("topic_id = -3", Some("topic_id is -3, expected the number of a topic")),
        ("topic_id = NULL", Some("topic_id is of type Null, expected INTEGER")),
        ("topic_id = 'x'", Some("topic_id is of type Text, expected INTEGER")),
    ] {
        let log = change(&format!("UPDATE messages SET {value} WHERE id = 21;"));
        assert_eq!((log.recording.scans.len(), log.report.skipped), (19, 1), "{value}");
        assert!(!log.report.is_complete() && log.report.truncated.is_none(), "{value}");
        let report = log.report.to_string();
        if let Some(reason) = reason {
            assert!(report.contains(&format!("row 21: messages skipped: {reason}")), "{report}");
        }
        let mut left = whole.recording.scans.clone();
        left.remove(9);
        let stamps = |scans: &[mcl_core::LaserScan]| -> Vec<_> {
            scans.iter().map(|scan| (scan.stamp, scan.ranges.clone())).collect()
        };
        assert_eq!(stamps(&log.recording.scans), stamps(&left), "{value}");
    }
    // A topic that cannot be read costs its messages.
    let log = change("UPDATE topics SET name = x'00' WHERE name = '/odom';");
    assert_eq!((log.recording.scans.len(), log.report.skipped), (20, 22));
    // A description that cannot be read: the type is a standard one.
    let log = change("UPDATE message_definitions SET encoded_message_definition = x'00';");
    assert_eq!(log.recording, whole.recording);
    assert!(log.report.skipped > 0 && log.notes.join("").contains("does not describe"));
}

/// Rows that a file does not hold: computed ones, and pages that stand in the tree many times.
#[test]
fn a_small_database_of_many_or_large_rows_is_stopped() {
    let start = Instant::now();
    let counted =
        "WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n WHERE id < 20000)";
    let computed = made(
        &format!(
            "{TOPICS} CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, \
             data AS (zeroblob(100000000))); {counted} INSERT INTO messages SELECT id, 1, id FROM n;"
        ),
        |_| (),
    );
    assert_says(&refused(&computed), &["take more bytes than the file has"]);
    let mut longer = computed.clone();
    let call = b"zeroblob(100000000)";
    let at = longer.windows(call.len()).position(|bytes| bytes == call).unwrap();
    longer[at + 9..at + 18].fill(b'9');
    assert_says(&refused(&longer), &["a row is longer than"]);
    // All pages of one level of the tree are the first of them.
    let tables = "PRAGMA page_size = 512; ";
    let doubled = made(
        &format!(
            "{tables} {TOPICS} CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data); \
             {counted} INSERT INTO messages SELECT id, 1, id, x'0001' FROM n;"
        ),
        |bytes| {
            for page in bytes.chunks_exact_mut(512).filter(|page| page[0] == 5) {
                let cells = usize::from(u16::from_be_bytes([page[3], page[4]]));
                let cell = |k: usize| {
                    usize::from(u16::from_be_bytes([page[12 + 2 * k], page[13 + 2 * k]]))
                };
                let cells: Vec<usize> = (0..cells).map(cell).collect();
                let first: [u8; 4] = page[cells[0]..cells[0] + 4].try_into().unwrap();
                for cell in cells {
                    page[cell..cell + 4].copy_from_slice(&first);
                }
            }
        },
    );
    assert_says(&refused(&doubled), &["occurs twice"]);
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

#[test]
fn a_page_that_is_lost_costs_what_comes_after() {
    let entries = walk(300);
    let bytes = database(&entries, true);
    let pages = bytes.len() / 1024;
    let mut lost = bytes.clone();
    // A leaf of the table of messages, in the middle.
    let middle = (pages / 2..pages).find(|page| lost[page * 1024] == 13).unwrap();
    lost[middle * 1024..][..1024].fill(0);
    let log = read(&lost);
    let reason = log.report.truncated.unwrap();
    assert!(reason.contains("damaged") && reason.contains("the messages up to row"), "{reason}");
    let scans = log.recording.scans.len();
    assert!((100..250).contains(&scans), "{scans} of 300");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_bytes_make_the_reader_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut_at in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let mut bytes = database(&walk(4), true);
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if is_cut {
            bytes.truncate(cut_at.index(bytes.len()));
        }
        if let Ok(log) = bag::read(&*bytes, &ReadOptions::default()) {
            prop_assert!(log.recording.scans.len() <= 4);
        }
    }
}
