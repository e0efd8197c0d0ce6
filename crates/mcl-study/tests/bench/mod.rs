//! A tiny log, and studies of it in folders that are gone afterwards.

// Each test program uses a part of this.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use anyhow::Result;
use mcl_core::{LaserScan, Recording, ScanGeometry, Seed};
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::run::{RunResult, run_study};
use mcl_study::share::Share;
use mcl_study::store::results::Results;
use mcl_study::study::definition::Study;
use mcl_study::trial::division::StudyData;
use tempfile::TempDir;

/// One beam of so many is kept.
const THINNED: usize = 6;

/// The first scans of the simulated office, thinned: 360 readings.
pub static RECORDING: LazyLock<Recording> = LazyLock::new(|| {
    let office = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
    let thinned = |scan: &LaserScan| {
        let ScanGeometry { start_angle, angle_step, beams } = scan.geometry;
        let geometry = ScanGeometry {
            start_angle,
            angle_step: angle_step * THINNED as f64,
            beams: beams.div_ceil(THINNED),
        };
        let ranges = scan.ranges.iter().step_by(THINNED).copied().collect();
        LaserScan { geometry, ranges, ..scan.clone() }
    };
    let scans = office.scans.iter().take(12).map(thinned).collect();
    Recording { scans, robot_from_laser: office.robot_from_laser }
});

/// The log under a name.
pub fn log(name: &str) -> LogSource {
    LogSource::of_recording(name, RECORDING.clone())
}

/// A folder, in memory where there is such a place: thousands of runs would wait for a disk.
pub fn folder() -> TempDir {
    match Path::new("/dev/shm") {
        memory if memory.is_dir() => tempfile::tempdir_in(memory).unwrap(),
        _ => tempfile::tempdir().unwrap(),
    }
}

/// Runs a study on a log into a folder.
pub fn run(text: &str, log: LogSource, folder: &Path) -> Result<RunResult> {
    let study = Study::parse(text)?;
    let data = StudyData::new(DataSource::Log(log));
    run_study(&study, "study", &data, folder, Share::Whole { fresh: false }, |_| {})
}

/// What an undisturbed run of a study on a log leaves.
#[track_caller]
/// The tables of a run that made them.
pub fn tables(ran: &RunResult) -> &Results {
    ran.results.as_ref().unwrap()
}

pub fn fresh(text: &str, log: LogSource) -> BTreeMap<PathBuf, Vec<u8>> {
    let folder = folder();
    let ran = run(text, log, folder.path()).unwrap();
    assert_eq!(ran.failed, [], "{text}");
    assert!(tables(&ran).is_complete());
    contents(folder.path())
}

/// What is in the files that are the same bytes for every run, by path.
pub fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let relative = path.strip_prefix(folder).unwrap().to_owned();
            if path.is_dir() {
                folders.push(path);
            } else if relative != Path::new("timings.csv") && !relative.starts_with("parts") {
                found.insert(relative, fs::read(path).unwrap());
            }
        }
    }
    found
}

/// Asserts that a folder holds these files with these bytes.
#[track_caller]
pub fn assert_holds(folder: &Path, expected: &BTreeMap<PathBuf, Vec<u8>>, what: &str) {
    let found = contents(folder);
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&found), names(expected), "{what}");
    for (path, bytes) in expected {
        assert!(found[path] == *bytes, "{what}: {} differs", path.display());
    }
}

/// The only file of rows of a folder.
#[track_caller]
pub fn part(folder: &Path) -> PathBuf {
    let entries = fs::read_dir(folder.join("parts")).unwrap();
    let paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    let [path] = &paths[..] else { panic!("expected one file of rows, found {paths:?}") };
    path.clone()
}
