//! The index of a bag: chunks without any message of use are passed over by it, and an index that is wrong
//! changes nothing.

use std::fs;
use std::io::Cursor;

use crate::bag_support::ros1::{ROS1, Ros1Options, ros1_bag};
use crate::bag_support::{Entry, SECOND, bag_as, entry, scan, stamp, walk};
use mcap::{Compression, WriteOptions};
use mcl_datasets::bag::planar::point_cloud;
use mcl_datasets::bag::types::POINT_CLOUD2;
use mcl_datasets::log::{Log, LogError, ReadOptions, read_log, read_log_from, survey};

const NOTE: &str = "the index of the bag does not say what is in it, so all of it is read";

/// Messages of a chunk.
const CHUNK: usize = 8;
const CLOUDS: usize = 5 * CHUNK;

/// A chunk of a walk, five of point clouds, which no scan is made of unless asked for, and one of scans alone.
fn entries() -> Vec<Entry> {
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8)
    };
    let mut entries = walk(4);
    entries.truncate(CHUNK);
    for k in 0..CLOUDS as i64 {
        let at = 10 * SECOND + k;
        let points: Vec<_> = (0..100).map(|_| [next(), next()]).collect();
        entries.push(entry("/points", &POINT_CLOUD2, at, point_cloud(stamp(at), "lidar", &points)));
    }
    entries.extend((20..28).map(|k| scan(k * SECOND)));
    entries
}

fn ros1(compression: &'static str) -> Vec<u8> {
    ros1_bag(&entries(), Ros1Options { compression, chunk: CHUNK, ..ROS1 })
}

fn mcap(compression: Option<Compression>) -> Vec<u8> {
    // Some ten clouds fill a chunk.
    bag_as(&entries(), WriteOptions::new().compression(compression).chunk_size(Some(12 << 10)))
}

/// All bags, with a byte amid the clouds of each.
fn bags() -> Vec<(&'static str, Vec<u8>, usize)> {
    let of_ros1 = ["none", "bz2", "lz4"].map(|compression| {
        let bytes = ros1(compression);
        let chunks = places(&bytes, b"compression=");
        (compression, bytes, chunks[3] + (chunks[4] - chunks[3]) / 2)
    });
    let kinds = [("plain", None), ("zstd", Some(Compression::Zstd))];
    let of_mcap = kinds.map(|(name, compression)| {
        let bytes = mcap(compression);
        let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
        let middle = &chunks[chunks.len() / 2];
        (name, bytes, (middle.chunk_start_offset + middle.chunk_length / 2) as usize)
    });
    of_ros1.into_iter().chain(of_mcap).collect()
}

fn places(bytes: &[u8], part: &[u8]) -> Vec<usize> {
    let found = bytes.windows(part.len()).enumerate().filter(|(_, window)| *window == part);
    found.map(|(at, _)| at).collect()
}

/// The log of a file, in which what is not wanted can be passed over.
fn of_file(bytes: &[u8]) -> Result<Log, LogError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    read_log(file.path())
}

/// The log of bytes that come one after the other.
fn of_stream(bytes: &[u8]) -> Result<Log, LogError> {
    read_log_from(Cursor::new(bytes), "bag".as_ref(), &ReadOptions::default())
}

#[test]
fn chunks_without_anything_of_use_are_passed_over_and_counted() {
    for (name, mut bytes, amid) in bags() {
        let whole = of_stream(&bytes).unwrap();
        assert_eq!(whole.report.ignored, CLOUDS, "{name}");
        assert_eq!(whole.recording.scans.len(), 11, "{name}");
        let clouds = &whole.survey.as_ref().unwrap().topics[1];
        assert_eq!((clouds.messages, clouds.frame.as_deref()), (CLOUDS, Some("lidar")), "{name}");
        let (first, last) = clouds.logged.unwrap();
        assert_eq!((first, last), (stamp(10 * SECOND), stamp(10 * SECOND + 39)), "{name}");
        assert_eq!(of_file(&bytes).unwrap(), whole, "{name}");
        // What is not read may be damaged.
        bytes[amid..amid + 60].fill(0x55);
        if !matches!(name, "none" | "plain") {
            assert!(of_stream(&bytes).is_err(), "{name}");
        }
        assert_eq!(of_file(&bytes).unwrap(), whole, "{name}");
    }
}

#[test]
fn a_survey_reads_the_first_message_of_each_topic_and_the_index() {
    for (name, mut bytes, amid) in bags() {
        bytes[amid..amid + 60].fill(0x55);
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), &bytes).unwrap();
        let found = survey(file.path(), &ReadOptions::default()).unwrap().unwrap();
        let counts: Vec<usize> = found.topics.iter().map(|topic| topic.messages).collect();
        assert_eq!((counts, &found.truncated), (vec![4, CLOUDS, 11, 1], &None), "{name}");
    }
}

/// Of a bag whose index is wrong, everything is read, and that is said.
#[track_caller]
fn assert_read_whole(bytes: &[u8]) {
    let mut found = of_file(bytes).unwrap();
    let notes = found.notes.len();
    found.notes.retain(|note| note != NOTE);
    assert_eq!(notes, found.notes.len() + 1);
    assert_eq!(found, of_stream(bytes).unwrap());
    assert_eq!(found.recording.scans.len(), 11);
}

/// The chunk of scans is said to hold point clouds.
#[test]
fn an_index_that_hides_messages_is_not_believed() {
    for compression in ["none", "bz2", "lz4"] {
        let mut bytes = ros1(compression);
        let info = *places(&bytes, b"chunk_pos=").last().unwrap();
        // The number of the connection after the field `count` and the length of the data.
        let id = info + places(&bytes[info..], b"count=")[0] + 14;
        assert_eq!(number(&bytes, id), 2, "the scans");
        bytes[id] = 3;
        match compression {
            // Chunks that are not compressed need no index.
            "none" => assert_eq!(of_file(&bytes).unwrap(), of_stream(&bytes).unwrap()),
            _ => assert_read_whole(&bytes),
        }
    }
}

/// It was taken for a bag that is cut off, or not reason.
#[test]
fn a_wrong_index_is_reported_and_changes_nothing() {
    for compression in ["none", "bz2", "lz4"] {
        let bytes = ros1(compression);
        let whole = of_file(&bytes).unwrap();
        assert_eq!(whole.report.truncated, None);
        let index = places(&bytes, b"index_pos=")[0] + 10;
        let chunk = places(&bytes, b"chunk_pos=")[3] + 10;
        for (at, what) in [(index, "the index"), (chunk, "a chunk")] {
            for (place, reason) in [
                (1_u64 << 40, "beyond the end of the file"),
                (bytes.len() as u64, "beyond the end of the file"),
                (5_000, "where there is none"),
            ] {
                let mut damaged = bytes.clone();
                damaged[at..at + 8].copy_from_slice(&place.to_le_bytes());
                for read in [of_file, of_stream] {
                    let mut found = read(&damaged).unwrap();
                    let note = format!(
                        "the index of the bag is damaged: {what} is said to be at byte {place}, {reason}; the bag was read record by record"
                    );
                    let notes = found.notes.len();
                    found.notes.retain(|found| *found != note);
                    assert_eq!(found.notes.len() + 1, notes, "{note}");
                    found.notes.retain(|note| note != NOTE);
                    assert_eq!(found, whole, "{compression}: {note}");
                }
            }
        }
    }
}

/// It was refused, though all messages come before.
#[test]
fn an_index_of_broken_records_costs_nothing() {
    let bytes = ros1("lz4");
    let whole = of_file(&bytes).unwrap();
    let index = number(&bytes, places(&bytes, b"index_pos=")[0] + 10) as usize;
    let chunk = places(&bytes, b"chunk_pos=")[2];
    for at in [index, index + 4, chunk - 4] {
        let mut damaged = bytes.clone();
        damaged[at..at + 4].fill(0xff);
        for read in [of_file, of_stream] {
            let mut found = read(&damaged).unwrap();
            let is_index_note =
                |note: &String| note.contains("the index of the bag is damaged at byte");
            assert_eq!(found.notes.iter().filter(|note| is_index_note(note)).count(), 1, "{at}");
            found.notes.retain(|note| !is_index_note(note));
            assert_eq!(found, whole, "{at}");
        }
    }
}

#[test]
fn a_summary_that_hides_messages_is_not_believed() {
    for compression in [None, Some(Compression::Zstd)] {
        let bytes = mcap(compression);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let channel = |topic: &str| {
            let mut channels = summary.channels.values();
            channels.find(|channel| channel.topic == topic).unwrap().id
        };
        let last = summary.chunk_indexes.iter().max_by_key(|chunk| chunk.chunk_start_offset);
        let place = last.unwrap().chunk_start_offset.to_le_bytes();
        let at = *places(&bytes, &place).last().unwrap();
        let mut lie = bytes.clone();
        // After the place, the length and the length of the map.
        let ids = at + 20;
        assert_eq!(lie[ids..ids + 2], channel("/scan").to_le_bytes());
        lie[ids..ids + 2].copy_from_slice(&channel("/points").to_le_bytes());
        assert_read_whole(&lie);
    }
}

/// A plain chunk of ROS 1 needs no index: messages that are not wanted are passed over one by one. Whatever is
/// wrong with it is found as in a stream.
#[test]
fn in_plain_chunks_each_message_that_is_not_wanted_is_passed_over() {
    let mut mixed = walk(6);
    for k in 0..6 {
        let at = k * SECOND;
        let cloud = point_cloud(stamp(at), "lidar", &[[1.0, 2.0]; 20]);
        mixed.insert(3 * k as usize, entry("/points", &POINT_CLOUD2, at, cloud));
    }
    let same = |bytes: &[u8]| {
        let [found, expected] = [of_file(bytes), of_stream(bytes)].map(|read| {
            read.map_err(|error| match error {
                LogError::Bag { error, .. } => error.to_string(),
                other => panic!("{other}"),
            })
        });
        assert_eq!(found, expected);
        found.is_ok()
    };
    for has_index in [true, false] {
        let bytes = ros1_bag(&mixed, Ros1Options { chunk: 5, has_index, ..ROS1 });
        assert!(same(&bytes));
        let mut read = 0;
        // Behind the first record, which is nearly all padding.
        for at in (4100..bytes.len()).step_by(13) {
            let mut damaged = bytes.clone();
            damaged[at] = 0xff;
            read += usize::from(same(&damaged));
        }
        assert!(read > 100 && read < (bytes.len() - 4200) / 13, "{read}");
    }
}

fn number(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(*bytes[at..].first_chunk().unwrap())
}
