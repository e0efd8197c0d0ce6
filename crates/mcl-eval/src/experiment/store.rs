use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Processor time of a part of a trial. Kept apart from the rows, which are the same bits for every run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of timings.csv, described in docs/results.md.
pub struct TimingRow {
    pub trial: String,
    pub part: String,
    pub seconds: f64,
}

/// A trial that has no rows, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of failures.csv, described in docs/results.md.
pub struct FailureRow {
    pub trial: String,
    pub reason: String,
}

/// Held while a file is written, so that the program can be ended between two writes.
static SAVING: Mutex<()> = Mutex::new(());

/// Waits until no file is being written, and lets none be written while the guard lives.
pub(crate) fn pause_saving() -> MutexGuard<'static, ()> {
    SAVING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The rows of an experiment on one data set, saved one by one as trials end.
pub struct TrialStore<R> {
    path: PathBuf,
    file: File,
    rows: Vec<R>,
}

impl<R: Serialize + DeserializeOwned> TrialStore<R> {
    /// Opens `path`, reading the rows that an earlier run left; a last line that was cut off in the
    /// middle is dropped.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds rows of another kind.
    pub fn open(path: &Path) -> Result<Self> {
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => {
                return Err(error).with_context(|| format!("cannot read {}", path.display()));
            }
        };
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let rows = parse_rows(whole.as_bytes(), path)
            .context("these rows are not of this experiment; --fresh starts anew")?;
        if whole.len() < text.len() {
            write_atomically(path, whole.as_bytes())?;
        }
        Ok(TrialStore { path: path.to_owned(), file: open_to_append(path)?, rows })
    }

    /// The rows so far.
    pub fn rows(&self) -> &[R] {
        &self.rows
    }

    /// Saves the rows of a trial.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn push(&mut self, rows: impl IntoIterator<Item = R>) -> Result<()> {
        let header = self.rows.is_empty();
        let first = self.rows.len();
        self.rows.extend(rows);
        // One write per trial: what another process, or a crash, sees is mostly whole lines.
        let lines = to_csv(&self.rows[first..], header)?;
        let _saving = pause_saving();
        self.file
            .write_all(&lines)
            .and_then(|()| self.file.sync_data())
            // What is written to a file that was removed meanwhile is lost, without an error.
            .and_then(|()| std::fs::metadata(&self.path))
            .map(drop)
            .with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Drops the rows that are not to be kept: those of a trial that was cut off between two rows.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn retain(&mut self, keep: impl Fn(&R) -> bool) -> Result<()> {
        let before = self.rows.len();
        self.rows.retain(keep);
        if self.rows.len() == before {
            return Ok(());
        }
        write_rows(&self.path, &self.rows)?;
        // Renaming left the open file behind.
        self.file = open_to_append(&self.path)?;
        Ok(())
    }

    /// Rewrites the file in the order of `key`, so that it does not tell in which order trials ended,
    /// and returns the rows.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish<K: PartialOrd>(mut self, key: impl Fn(&R) -> K) -> Result<Vec<R>> {
        self.rows.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
        write_rows(&self.path, &self.rows)?;
        Ok(self.rows)
    }
}

fn open_to_append(path: &Path) -> Result<File> {
    OpenOptions::new()
        .append(true)
        .create(true)
        .open(path)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Reads the rows of a CSV file.
///
/// # Errors
/// When the file cannot be read or a row is not of this kind; the message names file and line.
pub fn read_rows<R: DeserializeOwned>(path: &Path) -> Result<Vec<R>> {
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    parse_rows(file, path)
}

/// Writes a CSV file with a header, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_rows<R: Serialize>(path: &Path, rows: &[R]) -> Result<()> {
    write_atomically(path, &to_csv(rows, true)?)
}

/// Reads the rows of the content of a CSV file; `path` stands for it in errors.
///
/// # Errors
/// As [`read_rows`].
pub fn parse_rows<R: DeserializeOwned>(source: impl std::io::Read, path: &Path) -> Result<Vec<R>> {
    csv::Reader::from_reader(source)
        .deserialize()
        .collect::<Result<_, _>>()
        .with_context(|| format!("in {}", path.display()))
}

fn to_csv<R: Serialize>(rows: &[R], header: bool) -> Result<Vec<u8>> {
    let mut writer = csv::WriterBuilder::new().has_headers(header).from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    Ok(writer.into_inner()?)
}

/// Writes a file beside its final name and renames it: readers see the old content or the new.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let _saving = pause_saving();
    mcl_core::files::write_atomically(path, bytes)
        .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Row {
        name: String,
        value: f64,
        cell: Option<f64>,
    }

    fn row(name: &str, value: f64) -> Row {
        Row { name: name.to_owned(), value, cell: (value > 1.0).then_some(0.1) }
    }

    #[test]
    fn an_interrupted_run_goes_on_after_its_last_whole_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials.csv");
        let mut store = TrialStore::open(&path).unwrap();
        store.push([row("b", 0.1 + 0.2), row("c", 2.0)]).unwrap();
        drop(store);
        // Killed in the middle of a row.
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("d,3.");
        std::fs::write(&path, text).unwrap();

        let mut store: TrialStore<Row> = TrialStore::open(&path).unwrap();
        assert_eq!(store.rows(), [row("b", 0.1 + 0.2), row("c", 2.0)]);
        store.push([row("a", 4.0), row("e", 5.0)]).unwrap();
        store.retain(|row| row.name != "e").unwrap();
        let rows = store.finish(|row| row.name.clone()).unwrap();
        assert_eq!(rows, [row("a", 4.0), row("b", 0.1 + 0.2), row("c", 2.0)]);
        assert_eq!(read_rows::<Row>(&path).unwrap(), rows);
    }

    #[test]
    fn rows_of_a_folder_that_vanished_are_not_taken_for_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials.csv");
        let mut store = TrialStore::open(&path).unwrap();
        store.push([row("a", 1.0)]).unwrap();
        drop(folder);
        let message = format!("{:#}", store.push([row("b", 2.0)]).unwrap_err());
        assert!(message.contains("cannot write") && message.contains("trials.csv"), "{message}");
    }

    #[test]
    fn rows_of_another_kind_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trials.csv");
        std::fs::write(&path, "name,value\na,many\n").unwrap();
        let Err(error) = TrialStore::<Row>::open(&path) else { panic!("accepted") };
        let message = format!("{error:#}");
        assert!(message.contains("trials.csv") && message.contains("line: 2"), "{message}");
    }
}
