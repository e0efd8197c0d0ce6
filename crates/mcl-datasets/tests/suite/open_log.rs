//! Files: plain and compressed, damaged, empty, and no log at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::support::*;
use flate2::{Compression, write::GzEncoder};
use mcl_datasets::log::{LogError, ReadOptions, TopicChoice, read_log, read_log_as};
use mcl_datasets::log::{LogKind, ReferencePoses};

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A corrected log of several hundred scans whose readings do not compress away.
fn long_log() -> String {
    let mut state = 1_u32;
    let mut reading = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 16) / 1000.0
    };
    let mut text = String::new();
    for k in 0..400 {
        let place = pose(f64::from(k), 0.0, 0.0);
        let ranges: Vec<f64> = (0..180).map(|_| reading()).collect();
        text += &flaser(&ranges, place, place, k);
        text += &restart(place);
        text += &odom(pose(f64::from(k) + 0.9, 0.0, 0.0));
    }
    text
}

#[track_caller]
fn assert_message(error: &LogError, path: &Path, parts: &[&str]) {
    let message = error.to_string();
    assert!(message.starts_with(&path.display().to_string()), "{message}");
    for part in parts {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn compression_is_recognized_by_content_not_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let text = corrected().text();
    let plain = read_log(&file(folder.path(), "a.log", text.as_bytes())).unwrap();
    assert_eq!(plain.kind, LogKind::GfsCorrected);
    for name in ["b.log.gz", "b.clf", "b"] {
        assert_eq!(read_log(&file(folder.path(), name, &gzip(text.as_bytes()))).unwrap(), plain);
    }
    assert_eq!(read_log(&file(folder.path(), "c.log.gz", text.as_bytes())).unwrap(), plain);
    // Parts compressed one by one, as `cat a.gz b.gz` gives.
    let (head, tail) = text.split_at(text.len() / 2);
    let parts = [gzip(head.as_bytes()), gzip(tail.as_bytes())].concat();
    assert_eq!(read_log(&file(folder.path(), "d.log.gz", &parts)).unwrap(), plain);
}

#[test]
fn the_override_reaches_the_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "a.log", scan(pose(1.0, 2.0, 0.0), 1).as_bytes());
    assert!(!read_log(&path).unwrap().recording.has_reference());
    assert!(
        read_log_as(&path, &ReferencePoses::Recorded.into()).unwrap().recording.has_reference()
    );
    let named = file(folder.path(), "a.gfs.log", scan(pose(1.0, 2.0, 0.0), 1).as_bytes());
    assert!(read_log(&named).unwrap().recording.has_reference());
}

#[test]
fn files_that_are_not_logs_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.log");
    let error = read_log(&missing).unwrap_err();
    assert!(matches!(error, LogError::NotFound { .. }));
    assert_message(&error, &missing, &["no such file"]);

    let error = read_log(folder.path()).unwrap_err();
    assert!(matches!(error, LogError::Directory { .. }));
    assert_message(&error, folder.path(), &["directory"]);

    for (name, bytes) in [("empty.log", Vec::new()), ("empty.log.gz", gzip(b""))] {
        let path = file(folder.path(), name, &bytes);
        let error = read_log(&path).unwrap_err();
        assert!(matches!(error, LogError::Empty { .. }), "{error}");
        assert_message(&error, &path, &["empty", "CARMEN"]);
    }

    let path = file(folder.path(), "image.log", b"\x7fELF\x02\x01\x01\x00\x00\n\n");
    let error = read_log(&path).unwrap_err();
    assert!(matches!(error, LogError::Binary { offset: 7, .. }), "{error}");
    assert_message(&error, &path, &["binary", "byte 7"]);

    let path = file(folder.path(), "bag.mcap", b"\x89MCAP0\r\n\x01\x00");
    let error = read_log(&path).unwrap_err();
    assert!(matches!(error, LogError::Bag { .. }), "{error}");
    assert_message(&error, &path, &["no sensor_msgs/msg/LaserScan", "topics: none"]);

    // The first bytes decide, never the name alone.
    let path = file(folder.path(), "text.mcap", b"FLASER 180 and so on");
    assert_message(&read_log(&path).unwrap_err(), &path, &["no laser scan", "FLASER skipped"]);
    let path = file(folder.path(), "bag.mcap", b"PK\x03\x04 and so on");
    assert_message(&read_log(&path).unwrap_err(), &path, &["a ZIP archive", "`unzip FILE`"]);
    let mut archive = tar::Builder::new(Vec::new());
    archive.append_dir("bag", folder.path()).unwrap();
    let archive = gzip(&archive.into_inner().unwrap());
    let path = file(folder.path(), "bag.tar.gz", &archive);
    assert_message(&read_log(&path).unwrap_err(), &path, &["a tar archive", "`tar -xf FILE`"]);

    let path = file(folder.path(), "a.log", scan(pose(1.0, 2.0, 0.0), 1).as_bytes());
    let topics = TopicChoice { scan: Some("/scan".into()), ..TopicChoice::default() };
    let options = ReadOptions { topics, ..ReadOptions::default() };
    let error = read_log_as(&path, &options).unwrap_err();
    assert_message(&error, &path, &["no topics", "\"/scan\"", "--scan-topic"]);

    let path = file(folder.path(), "notes.log", b"# no scans here\nODOM 0 0 0\n");
    let error = read_log(&path).unwrap_err();
    assert!(matches!(error, LogError::Carmen { .. }), "{error}");
    assert_message(&error, &path, &["no laser scan in 2 lines"]);

    let path = file(folder.path(), "noise.log", &[b'x'; 2_000_000]);
    assert_message(&read_log(&path).unwrap_err(), &path, &["line 1 is longer than"]);
}

#[test]
fn a_cut_off_gzip_keeps_what_came_before() {
    let folder = tempfile::tempdir().unwrap();
    let text = long_log();
    let whole = read_log(&file(folder.path(), "whole.log", text.as_bytes())).unwrap();
    let packed = gzip(text.as_bytes());
    let path = file(folder.path(), "cut.log.gz", &packed[..packed.len() / 2]);
    let log = read_log(&path).unwrap();
    let count = log.recording.scans.len();
    assert!((150..250).contains(&count), "{count} of 400 scans");
    assert_eq!(log.recording.scans, whole.recording.scans[..count]);
    assert_eq!(log.report.skipped, 0, "the incomplete last line is no malformed record");
    assert!(!log.report.is_complete());
    let reason = log.report.truncated.clone().unwrap();
    assert!(reason.contains("cut off") && reason.contains("after line"), "{reason}");
    assert!(log.report.to_string().contains(&reason));
}

#[test]
fn a_damaged_gzip_keeps_what_came_before_or_says_that_nothing_did() {
    let folder = tempfile::tempdir().unwrap();
    let mut packed = gzip(long_log().as_bytes());
    let checksum = packed.len() - 8;
    packed[checksum] ^= 0xff;
    let log = read_log(&file(folder.path(), "checksum.log.gz", &packed)).unwrap();
    assert_eq!(log.recording.scans.len(), 400);
    assert!(log.report.truncated.unwrap().contains("damaged"));

    let path = file(folder.path(), "head.log.gz", &packed[..12]);
    let error = read_log(&path).unwrap_err();
    assert_message(&error, &path, &["compressed data is cut off"]);
    let path = file(folder.path(), "none.log.gz", b"\x1f\x8b and then nonsense");
    let error = read_log(&path).unwrap_err();
    assert!(matches!(error, LogError::Compressed { .. }), "{error}");
}
