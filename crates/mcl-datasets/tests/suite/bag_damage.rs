//! Bags that are cut off, damaged or made to harm: read as far as they go, or refused with the place.

use std::io::Read;

use crate::bag_support::*;
use mcap::{Compression, WriteOptions};
use mcl_datasets::bag::{self, MAX_CHUNK_BYTES};
use mcl_datasets::log::ReadOptions;
use proptest::prelude::*;

#[test]
fn a_truncated_bag_keeps_what_came_before_the_cut() {
    let entries = walk(60);
    for (name, bytes) in [
        ("unchunked", unchunked(&entries)),
        ("zstd", bag(&entries)),
        (
            "small chunks",
            bag_as(
                &entries,
                WriteOptions::new().chunk_size(Some(500)).compression(Some(Compression::Lz4)),
            ),
        ),
        ("plain", bag_as(&entries, WriteOptions::new().compression(None))),
    ] {
        let ends = (8..bytes.len()).step_by(97).chain([bytes.len() - 1, bytes.len() - 8]);
        let seen = most_scans_of_cuts(name, &bytes, ends);
        assert_eq!(seen, 60, "{name}: cut in the summary, nothing is lost");
    }
    // Also within a chunk, if it is not packed as a whole.
    let plain = bag_as(&entries, WriteOptions::new().compression(None));
    let log = read(&plain[..plain.len() / 2]);
    assert!(log.recording.scans.len() > 10, "{}", log.recording.scans.len());
}

#[test]
fn files_that_are_not_bags_or_continue_after_their_end_are_reported() {
    assert_says(&refused(b"\x89MCAP1\r\n and more"), &["at byte 0", "magic"]);
    assert_says(&refused(b""), &["no sensor_msgs/msg/LaserScan"]);
    let mut twice = bag(&walk(2));
    twice.extend(bag(&walk(2)));
    let log = read(&twice);
    assert_eq!(log.recording.scans.len(), 2);
    assert!(log.report.truncated.unwrap().contains("what comes after is not read"));
}

/// Offset of the first record of this kind, outside of chunks.
fn record(bytes: &[u8], opcode: u8) -> usize {
    let mut at = 8;
    while bytes[at] != opcode {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at
}

const CHUNK: u8 = 6;

#[test]
fn a_chunk_with_a_bad_checksum_is_an_error_with_its_offset() {
    let mut bytes = bag_as(&walk(5), WriteOptions::new().compression(None));
    let chunk = record(&bytes, CHUNK);
    bytes[chunk + 300] ^= 1;
    assert_says(&refused(&bytes), &[&format!("at byte {chunk}"), "checksum of a chunk"]);
    // Compressed, the decompressor may notice first.
    let mut bytes = bag(&walk(5));
    let chunk = record(&bytes, CHUNK);
    bytes[chunk + 300] ^= 1;
    assert_says(&refused(&bytes), &[&format!("at byte {chunk}"), "damaged"]);
    // Outside of chunks, the checksum of the data shows it.
    let mut bytes = unchunked(&walk(5));
    let message = record(&bytes, 5);
    bytes[message + 40] ^= 1;
    assert_says(&refused(&bytes), &["checksum of the data"]);
}

#[test]
fn lengths_that_cannot_be_are_refused_before_anything_is_allocated() {
    for opcode in [3, 4, 5, CHUNK, 12, 9] {
        let mut bytes = bag(&walk(2));
        let at = record(&bytes, CHUNK);
        bytes[at] = opcode;
        bytes[at + 1..at + 9].copy_from_slice(&(1_u64 << 63).to_le_bytes());
        let error = refused(&bytes);
        assert_says(&error, &[&format!("at byte {at}"), "9223372036854775808 bytes long"]);
    }
    // A chunk that says that it unpacks to 2⁶³ bytes.
    let mut bytes = bag(&walk(2));
    let at = record(&bytes, CHUNK);
    bytes[at + 25..at + 33].copy_from_slice(&(1_u64 << 63).to_le_bytes());
    assert_says(&refused(&bytes), &[&format!("at byte {at}"), "unpacks to 9223372036854775808"]);
}

/// A file of one chunk.
fn chunk_file(compression: &str, size: u64, packed: &[u8]) -> Vec<u8> {
    let mut body = vec![0; 16];
    body.extend(size.to_le_bytes());
    body.extend(0_u32.to_le_bytes());
    body.extend((compression.len() as u32).to_le_bytes());
    body.extend(compression.as_bytes());
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    let mut bytes = mcap::MAGIC.to_vec();
    bytes.push(CHUNK);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    bytes
}

#[test]
fn a_zstd_bomb_is_stopped() {
    let bomb = zstd::encode_all(std::io::repeat(0).take(MAX_CHUNK_BYTES * 4), 1).unwrap();
    assert!(bomb.len() < 1 << 20);
    // It says what it is, or it lies.
    let honest = refused(&chunk_file("zstd", MAX_CHUNK_BYTES * 4, &bomb));
    assert_says(&honest, &["at byte 8", "unpacks to", &MAX_CHUNK_BYTES.to_string()]);
    let lie = refused(&chunk_file("zstd", 100, &bomb));
    assert_says(&lie, &["at byte 8", "unpacks to 100 bytes, found 101 or more"]);
    assert_says(&refused(&chunk_file("brotli", 100, &bomb)), &["\"brotli\"", "zstd or lz4"]);
    assert_says(&refused(&chunk_file("lz4", 100, &bomb)), &["does not unpack as lz4"]);
    let overrun = [&[5][..], &1000_u64.to_le_bytes(), &[0; 50]].concat();
    let error = refused(&chunk_file("", overrun.len() as u64, &overrun));
    assert_says(&error, &["1000 bytes long", "50 are left"]);
}

fn small_bags() -> Vec<Vec<u8>> {
    let entries = walk(4);
    vec![
        unchunked(&entries),
        bag(&entries),
        bag_as(
            &entries,
            WriteOptions::new()
                .compression(None)
                .calculate_chunk_crcs(false)
                .calculate_data_section_crc(false),
        ),
    ]
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
        let mut bytes = small_bags().swap_remove(which);
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
        let bytes = [mcap::MAGIC, &rest].concat();
        prop_assert!(bag::read(&*bytes, &ReadOptions::default()).is_err());
    }
}
