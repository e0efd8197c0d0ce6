//! Saved results, as a run goes on from them, and as claims and comparisons read them.

use std::fmt::Debug;
use std::path::Path;

use mcl_eval::claims;
use mcl_eval::experiment::{
    FailureRow, LikelihoodRow, LocalizationRow, LocalizationSummaryRow, LocalizationTestRow,
    Manifest, SensitivityRow, SummaryRow, TestRow, TimingRow, TrialStore, compare_strategies,
    parse_rows, summarize, summarize_localization, summarize_sensitivity, test_improvement,
    test_localization, write_rows,
};
use mcl_eval::results::compare;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tempfile::TempDir;

use crate::memory::{ANY_INPUT, bounded};

/// A row of single digits takes several times its bytes, its text fields an allocation each.
const PER_BYTE: usize = 256;

/// A table of rows of any kind, and what is made of them.
pub fn rows(bytes: &[u8]) {
    if let Some(rows) = table::<LikelihoodRow>(bytes) {
        let _ = summarize(&rows);
        let _ = test_improvement(&rows);
    }
    if let Some(rows) = table::<LocalizationRow>(bytes) {
        let _ = summarize_localization(&rows);
        let _ = test_localization(&rows);
    }
    if let Some(rows) = table::<SensitivityRow>(bytes) {
        let _ = summarize_sensitivity(&rows);
        let _ = compare_strategies(&rows);
    }
    table::<SummaryRow>(bytes);
    table::<TestRow>(bytes);
    table::<LocalizationSummaryRow>(bytes);
    table::<LocalizationTestRow>(bytes);
    table::<TimingRow>(bytes);
    table::<FailureRow>(bytes);
}

/// The rows, if it is a table of them, after a way through a file.
fn table<R: Serialize + DeserializeOwned + Debug>(bytes: &[u8]) -> Option<Vec<R>> {
    let parse = |bytes: &[u8]| parse_rows::<R>(bytes, Path::new("fuzzed.csv"));
    let rows = bounded(bytes.len(), ANY_INPUT, PER_BYTE, || parse(bytes)).ok()?;
    let scratch = scratch();
    let path = scratch.path().join("rows.csv");
    write_rows(&path, &rows).expect("rows can be written");
    let written = std::fs::read(&path).expect("they were written");
    let again = parse(&written).expect("what was written can be read");
    // NaN equals itself in text.
    assert_eq!(format!("{rows:?}"), format!("{again:?}"));
    Some(rows)
}

/// A result folder: `manifest.json` and `trials.csv`, parted by a NUL.
pub fn folder(bytes: &[u8]) {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    let (manifest, trials) = (&bytes[..end], bytes.get(end + 1..).unwrap_or_default());
    if let Ok(text) = std::str::from_utf8(manifest) {
        let parsed = bounded(bytes.len(), ANY_INPUT, 1_000, || Manifest::parse(text));
        if let Ok(manifest) = parsed {
            let text = serde_json::to_string(&manifest).expect("JSON holds it");
            let again = Manifest::parse(&text).expect("what was written can be read");
            assert_eq!(again, manifest);
            again.check_continues(&manifest).expect("the same manifest");
            assert!(!manifest.dataset.describe().is_empty());
        }
    }
    let scratch = scratch();
    let folder = scratch.path();
    write(&folder.join("manifest.json"), manifest);
    write(&folder.join("trials.csv"), trials);
    if let Ok(datasets) = claims::decide(&[folder.to_owned()]) {
        for dataset in datasets {
            assert!(!dataset.claims.is_empty());
            serde_json::to_string(&dataset).expect("claims can be told in JSON");
        }
    }
    let same = compare(folder, folder, 0.0).expect("the files are there");
    assert_eq!((same.files, same.differences), (2, 0));
    goes_on::<LikelihoodRow>(&folder.join("trials.csv"), trials);
    goes_on::<LocalizationRow>(&folder.join("trials.csv"), trials);
}

/// A stopped run finds its whole rows, and finds the same ones when it is stopped once more.
fn goes_on<R: Serialize + DeserializeOwned + Debug>(path: &Path, trials: &[u8]) {
    write(path, trials);
    let Ok(store) = TrialStore::<R>::open(path) else { return };
    let rows = format!("{:?}", store.rows());
    drop(store);
    let kept = std::fs::read(path).expect("the file is there");
    assert!(trials.starts_with(&kept));
    let again = TrialStore::<R>::open(path).expect("it was opened before");
    assert_eq!(format!("{:?}", again.rows()), rows);
}

fn write(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).expect("a file of the test can be written");
}

/// A folder for one input, in memory where the system has one there. Readers of folders take paths.
fn scratch() -> TempDir {
    let memory = Path::new("/dev/shm");
    let base = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    tempfile::tempdir_in(base).expect("a folder of the test")
}
