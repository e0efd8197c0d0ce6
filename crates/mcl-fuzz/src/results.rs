//! Saved results, as a run goes on from them, and as tables, charts, claims and comparisons read them.

use std::path::Path;

use mcl_eval::{claims, compare};
use mcl_study::data::facts::DataFacts;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{PARTS, Parts, seal};
use mcl_study::store::results::{MANIFEST, Manifest, Results, STUDY};
use mcl_study::view;
use tempfile::TempDir;

use crate::memory::{ANY_INPUT, bounded};

/// A row of single digits takes many times its bytes, its identity and its text an allocation each.
const PER_BYTE: usize = 512;
/// The name of a file of rows.
const PART: &str = "rows-1-AbCd1234.jsonl";

/// A file of rows, as it is and with the digests made right: whatever is in it, the same is read twice, and no
/// more when its end is cut off.
pub fn parts(bytes: &[u8]) {
    let identity = identity();
    for is_sealed in [false, true] {
        let file = if is_sealed { sealed(bytes) } else { bytes.to_vec() };
        let scratch = scratch();
        write_part(scratch.path(), &file);
        let read = || Parts::read(scratch.path(), &identity);
        let parts = match bounded(file.len(), 2 * ANY_INPUT, PER_BYTE, read) {
            Ok(parts) => parts,
            Err(error) => {
                assert!(format!("{error:#}").contains(PART), "{error:#}");
                continue;
            }
        };
        let again = Parts::read(scratch.path(), &identity).expect("it was read before");
        let content =
            |parts: &Parts| format!("{:?} {:?} {:?}", parts.seconds, parts.failed, parts.damage);
        assert_eq!(content(&parts), content(&again));
        if !is_sealed {
            // Nobody finds a digest by chance; the corpus holds no whole lines.
            assert!(parts.seconds.is_empty() || file.starts_with(b"{\"sha256\":"));
        }
        write_part(scratch.path(), &file[..file.len() / 2]);
        let half = Parts::read(scratch.path(), &identity).expect("a part of what was read before");
        assert!(parts.seconds.starts_with(&half.seconds) && parts.failed.starts_with(&half.failed));
    }
}

/// A result folder: `manifest.json`, the study and the file of rows without digests, parted by NULs.
pub fn folder(bytes: &[u8]) {
    let mut files = bytes.splitn(3, |&byte| byte == 0);
    let [manifest, study, rows] = [(); 3].map(|()| files.next().unwrap_or_default());
    if let Ok(text) = std::str::from_utf8(manifest)
        && let Ok(manifest) = bounded(bytes.len(), ANY_INPUT, 1_000, || Manifest::parse(text))
    {
        let text = manifest.to_text().expect("JSON holds it");
        let again = Manifest::parse(&text).expect("what was written can be read");
        assert_eq!(again.to_text().expect("JSON holds it"), text);
        again.identity.check_same(&manifest.identity).expect("the same identity");
        assert!(!manifest.identity.data.describe().is_empty());
    }
    let scratch = scratch();
    let folder = scratch.path().join("study").join("lab");
    std::fs::create_dir_all(&folder).expect("a folder of the test");
    for (name, bytes) in [(MANIFEST, manifest), (STUDY, study)] {
        std::fs::write(folder.join(name), bytes).expect("a file of the test can be written");
    }
    write_part(&folder, &sealed(rows));
    let same = compare::compare(scratch.path(), scratch.path(), 0.0).expect("the files are there");
    assert_eq!((same.files, same.differences), (2, 0));
    let results = match Results::read(&folder) {
        Ok(results) => results.expect("there is a file of rows"),
        Err(error) => return assert!(!format!("{error:#}").is_empty()),
    };
    assert!(results.done <= results.asked && results.table.len() <= 1_000_000);
    assert_eq!(results.is_complete(), results.done == results.asked);
    let again = Results::read(&folder).expect("it was read before").expect("it was there");
    assert!(again.table == results.table);
    // A large study is seldom one of few bytes, and its bootstrap takes its time.
    if results.asked > 300 {
        return;
    }
    results.table.to_csv().expect("there is memory for it");
    if let Ok(estimates) = view::estimate::Estimates::of(&results) {
        drop((view::summary::summary(&estimates), view::compare::tests(&estimates.groups)));
        if let Ok(charts) = view::charts::charts(&estimates) {
            charts.iter().for_each(|chart| drop(chart.to_table()));
        }
    }
    let all = [results];
    drop(view::ranking::ranking(&all));
    for dataset in claims::decide(&all) {
        assert!(!dataset.claims.is_empty());
        serde_json::to_string(&dataset).expect("claims can be written as JSON");
    }
}

/// Lines with their digests; the last, if it has no end, stays torn.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    let lines = bytes.split_inclusive(|&byte| byte == b'\n');
    let line = |line: &[u8]| match line.strip_suffix(b"\n") {
        Some(line) => [&*seal(line), b"\n"].concat(),
        None => line.to_vec(),
    };
    lines.flat_map(line).collect()
}

/// That of the rows in the corpus.
fn identity() -> Identity {
    let text = |text: &str| text.to_owned();
    let build = Build { version: text("0.1.0"), revision: None, sources: text("0123456789abcdef") };
    let data = DataFacts {
        name: text("lab"),
        title: text("Lab"),
        sha256: text("00"),
        dimensions: 2,
        scans: 12,
        max_range: Some(10.0),
        points: 300,
        skipped_records: 0,
    };
    Identity { build, data }
}

fn write_part(folder: &Path, bytes: &[u8]) {
    let parts = folder.join(PARTS);
    std::fs::create_dir_all(&parts).expect("a folder of the test");
    std::fs::write(parts.join(PART), bytes).expect("a file of the test can be written");
}

/// A folder for one input, in memory where the system has one there. Readers of folders take paths.
fn scratch() -> TempDir {
    let memory = Path::new("/dev/shm");
    let base = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    tempfile::tempdir_in(base).expect("a folder of the test")
}
