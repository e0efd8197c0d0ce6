//! Storage of rows: every process that runs trials appends to its own file, and reads those of all others. A
//! file is only ever changed by the process that created it, so that no lock is needed. Truncated or damaged
//! rows are ignored, and computed again.

use std::borrow::Cow;
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use mcl_core::files::{Journal, JournalLine, create_folder, journal_lines, journals};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::measure::program::{ENDED, MEASURED_ANEW};
use crate::recipe::localizer::{LOCALIZER, OWN};
use crate::recipe::{DIGITS, digest};
use crate::store::identity::Identity;
use crate::table::{Cells, Value};

/// Folder of the files of rows, below a result folder.
pub const PARTS: &str = "parts";
const PREFIX: &str = "rows";
/// Size limit of a line (bytes): only a trial with about [`MAX_ROWS`](crate::study) rows would exceed it, and
/// such a trial would never end.
const MAX_LINE: usize = 256 << 20;

/// A line of a file of rows.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
enum Line<Trial> {
    /// The first line: what all rows of the file depend on.
    Identity(Box<Identity>),
    /// Rows of a trial that ended.
    Trial(Trial),
    /// A trial that failed.
    Failed(FailedTrial),
}

/// The JSON of a line as saved: with its digest, so that damage is detected.
pub fn seal(json: &[u8]) -> Vec<u8> {
    [SEAL[0], digest(json).as_bytes(), SEAL[1], json, SEAL[2]].concat()
}

/// The text before the digest, between digest and JSON, and after it: the whole is JSON, too.
const SEAL: [&[u8]; 3] = [br#"{"sha256":""#, br#"","line":"#, b"}"];

/// The digest and the JSON of a saved line.
fn sealed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (digest, rest) = bytes.strip_prefix(SEAL[0])?.split_at_checked(DIGITS)?;
    Some((digest, rest.strip_prefix(SEAL[1])?.strip_suffix(SEAL[2])?))
}

impl<'l> Line<ReadTrial<'l>> {
    /// Parses a saved line, unless it is damaged.
    fn unsealed(bytes: &'l [u8]) -> Option<Self> {
        let (found, json) = sealed(bytes)?;
        if found != digest(json).as_bytes() {
            return None;
        }
        serde_json::from_slice(json).ok()
    }
}

/// The part of a trial's line that identifies its rows.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Glance<'a> {
    Trial {
        #[serde(borrow)]
        rows: Vec<(Cow<'a, str>, IgnoredAny)>,
    },
}

impl Glance<'_> {
    /// Whether a saved line holds only rows with other identities than the wanted ones.
    fn is_of_others(bytes: &[u8], wanted: &HashSet<String>) -> bool {
        let glance = sealed(bytes).and_then(|(_, json)| serde_json::from_slice(json).ok());
        glance.is_some_and(|Glance::Trial { rows }| {
            !rows.iter().any(|(identity, _)| wanted.contains(&**identity))
        })
    }
}

/// Rows of a trial that ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SavedTrial {
    /// The trial in words.
    pub trial: String,
    /// The columns of the rows.
    pub columns: Vec<String>,
    /// Rows with their identities.
    pub rows: Vec<(String, Vec<Value>)>,
    /// Processor time of the trial's parts, in seconds.
    pub seconds: Vec<(String, f64)>,
}

/// The same while reading: the columns of most lines are identical to those of an earlier line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReadTrial<'l> {
    trial: String,
    #[serde(borrow)]
    columns: &'l RawValue,
    rows: Vec<(String, Vec<Value>)>,
    seconds: Vec<(String, f64)>,
}

/// A trial that failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailedTrial {
    /// The trial in words.
    pub trial: String,
    /// Why it failed.
    pub reason: String,
}

impl SavedTrial {
    /// From rows that share their columns.
    pub fn new(trial: String, rows: Vec<(String, Cells)>, seconds: Vec<(String, f64)>) -> Self {
        let columns = rows.first().map_or(Vec::new(), |(_, cells)| {
            cells.iter().map(|(column, _)| column.clone()).collect()
        });
        let values = |cells: Cells| cells.into_iter().map(|(_, value)| value).collect();
        let rows = rows.into_iter().map(|(identity, cells)| (identity, values(cells))).collect();
        SavedTrial { trial, columns, rows, seconds }
    }
}

/// The file of rows of this process, created when the first trial ends.
pub struct OwnPart<'a> {
    folder: &'a Path,
    identity: &'a Identity,
    journal: Option<Journal>,
}

impl<'a> OwnPart<'a> {
    /// For a result folder.
    pub fn new(folder: &'a Path, identity: &'a Identity) -> Self {
        OwnPart { folder, identity, journal: None }
    }

    /// Saves the rows of a trial, or why it failed, and syncs them to the disk.
    ///
    /// # Errors
    /// When they cannot be written, or the folder was removed or replaced.
    pub fn save(&mut self, ended: Result<SavedTrial, FailedTrial>) -> Result<()> {
        let line = ended.map_or_else(Line::Failed, Line::<SavedTrial>::Trial);
        let parts = self.folder.join(PARTS);
        let cannot = || format!("cannot write rows in {}", parts.display());
        let journal = match &mut self.journal {
            Some(journal) => journal,
            None => {
                create_folder(&parts).with_context(cannot)?;
                let mut journal = Journal::create(&parts, PREFIX).with_context(cannot)?;
                let first = serde_json::to_vec(&Line::<SavedTrial>::Identity(Box::new(
                    self.identity.clone(),
                )))?;
                journal.append(&seal(&first)).with_context(cannot)?;
                self.journal.insert(journal)
            }
        };
        journal.append(&seal(&serde_json::to_vec(&line)?)).with_context(cannot)
    }
}

/// The content of the files of rows of a result folder.
#[derive(Debug, Default)]
pub struct Parts {
    /// Values of rows by identity, each with the index of its columns.
    rows: HashMap<String, KeptRow>,
    /// Columns of trials; most trials share them.
    columns: Vec<Vec<String>>,
    /// The same as written in the lines.
    written_columns: Vec<Box<RawValue>>,
    /// Processor times by trial.
    pub seconds: Vec<(String, Vec<(String, f64)>)>,
    /// Trials that failed, in the order of failure.
    pub failed: Vec<FailedTrial>,
    /// What was damaged, a line each.
    pub damage: Vec<String>,
}

#[derive(Debug)]
struct KeptRow {
    columns: usize,
    values: Vec<Value>,
    /// The file, and the line number in it.
    place: (Arc<Path>, usize),
}

impl Parts {
    /// Reads the rows of all processes, which must have the same identity. Rows damaged by a killed process
    /// or a broken disk are ignored.
    ///
    /// # Errors
    /// When a file cannot be read, rows are of another identity (with the first difference), or two rows
    /// of one identity differ (with both places).
    pub fn read(folder: &Path, identity: &Identity) -> Result<Self> {
        Self::read_wanted(folder, identity, None)
    }

    /// Reads as [`Parts::read`] does, but keeps only trials with rows of the wanted identities: one process
    /// of a thousand needs a thousandth of the rows.
    ///
    /// # Errors
    /// As [`Parts::read`]; for rows that are not wanted, only another identity.
    pub fn read_wanted(
        folder: &Path,
        identity: &Identity,
        wanted: Option<&HashSet<String>>,
    ) -> Result<Self> {
        let mut parts = Parts::default();
        let paths = journals(&folder.join(PARTS), PREFIX)
            .with_context(|| format!("cannot read {}", folder.join(PARTS).display()))?;
        for path in paths {
            let read = parts.read_part(&path.as_path().into(), identity, wanted);
            read.with_context(|| format!("in {}", path.display()))?;
        }
        Ok(parts)
    }

    fn read_part(
        &mut self,
        path: &Arc<Path>,
        identity: &Identity,
        wanted: Option<&HashSet<String>>,
    ) -> Result<()> {
        let mut is_of_this = None;
        for (number, line) in (1..).zip(journal_lines(path, MAX_LINE)?) {
            let damaged = |what: &str| format!("{} line {number}: {what}", path.display());
            let line = match line {
                Ok(JournalLine::Whole(line)) => line,
                // Truncated by the end of its process, or still being written by another one.
                Ok(JournalLine::Torn { .. }) => break,
                Err(error) if error.kind() == std::io::ErrorKind::InvalidData => {
                    self.damage.push(damaged("too long, left out"));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let is_of_others = |wanted| Glance::is_of_others(&line, wanted);
            if matches!(is_of_this, Some(Ok(()))) && wanted.is_some_and(is_of_others) {
                continue;
            }
            match (Line::unsealed(&line), &is_of_this) {
                (Some(Line::Identity(found)), None) => {
                    is_of_this = Some(identity.check_same(&found));
                }
                (Some(Line::Trial(saved)), Some(Ok(()))) => {
                    self.add(saved, path, number)?;
                }
                (Some(Line::Failed(failed)), Some(Ok(()))) => self.failed.push(failed),
                (Some(Line::Trial(_)), Some(Err(difference))) => {
                    bail!(
                        "the rows there {difference}; --fresh removes them and starts over, -o writes elsewhere"
                    );
                }
                (Some(Line::Failed(_)), Some(Err(_))) => {}
                (_, None) => {
                    // The owner of these rows cannot be known.
                    self.damage.push(damaged(
                        "damaged; it identified the build and data of the rows that follow, which are left out",
                    ));
                    break;
                }
                _ => self.damage.push(damaged("damaged, left out")),
            }
        }
        Ok(())
    }

    fn add(&mut self, read: ReadTrial<'_>, path: &Arc<Path>, line: usize) -> Result<()> {
        let ReadTrial { trial, columns, rows, seconds } = read;
        let known = self.written_columns.iter().position(|known| known.get() == columns.get());
        let columns = match known {
            Some(known) => known,
            None => {
                let Ok(names) = serde_json::from_str(columns.get()) else {
                    self.damage.push(format!("{} line {line}: damaged, left out", path.display()));
                    return Ok(());
                };
                self.columns.push(names);
                self.written_columns.push(columns.to_owned());
                self.columns.len() - 1
            }
        };
        for (identity, values) in rows {
            if values.len() != self.columns[columns].len() {
                let place = format!("{} line {line}", path.display());
                self.damage.push(format!("{place}: damaged, left out"));
                return Ok(());
            }
            match self.rows.entry(identity) {
                Entry::Vacant(entry) => {
                    entry.insert(KeptRow { columns, values, place: (path.clone(), line) });
                }
                // Two processes may run the same trial, with the same result.
                Entry::Occupied(entry) => {
                    let kept = entry.get();
                    if kept.columns == columns && kept.values == values {
                        continue;
                    }
                    let is_same = kept.columns == columns;
                    let columns = &self.columns[columns];
                    if is_same && may_differ(columns, &kept.values, &values) {
                        continue;
                    }
                    let differs = columns.iter().zip(kept.values.iter().zip(&values));
                    let first = differs.into_iter().find(|(_, (a, b))| a != b);
                    let (column, a, b) = first.map_or(
                        ("the columns", String::new(), String::new()),
                        |(column, (a, b))| (column.as_str(), a.to_string(), b.to_string()),
                    );
                    bail!(
                        "line {line} and {} line {} hold the same row of trial {trial} with \
                         different values: {column} is {b:?} and {a:?}; one of the files is damaged: \
                         remove it, or start over with --fresh",
                        kept.place.0.display(),
                        kept.place.1
                    );
                }
            }
        }
        self.seconds.push((trial, seconds));
        Ok(())
    }

    /// How the localizer of a row ended, where the row has it.
    pub fn ended(&self, identity: &str) -> Option<&str> {
        let ended = |(column, value)| if column == ENDED { Value::text(value) } else { None };
        self.row(identity)?.find_map(ended)
    }

    /// Whether there is a row.
    pub fn has(&self, identity: &str) -> bool {
        self.rows.contains_key(identity)
    }

    /// The distinct sets of columns of the rows.
    pub fn columns(&self) -> &[Vec<String>] {
        &self.columns
    }

    /// Removes a row: the index of its columns in [`Parts::columns`], and its values.
    pub fn take(&mut self, identity: &str) -> Option<(usize, Vec<Value>)> {
        self.rows.remove(identity).map(|row| (row.columns, row.values))
    }

    /// The values of a row by column.
    pub fn row(&self, identity: &str) -> Option<impl Iterator<Item = (&str, &Value)>> {
        let row = self.rows.get(identity)?;
        Some(self.columns[row.columns].iter().map(String::as_str).zip(&row.values))
    }
}

/// Whether two rows with the same identity may differ as they do: times and memory differ from run to run,
/// and an external program may differ in all results. Then the first one counts.
fn may_differ(columns: &[String], kept: &[Value], values: &[Value]) -> bool {
    let place = columns.iter().position(|column| column == LOCALIZER);
    let localizer = place.and_then(|place| kept[place].text());
    let is_program = localizer.is_some_and(|name| name != OWN);
    let mut cells = columns.iter().zip(kept.iter().zip(values));
    is_program || cells.all(|(column, (a, b))| a == b || MEASURED_ANEW.contains(&column.as_str()))
}

/// Whether a result folder has files of rows; those committed with the program do not.
pub fn has_parts(folder: &Path) -> bool {
    fs::read_dir(folder.join(PARTS)).is_ok_and(|mut entries| entries.next().is_some())
}
