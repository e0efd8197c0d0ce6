//! The content of a result folder `<root>/<study>/<data set>/`.
//!
//! ```text
//! manifest.json  build and data that the rows depend on
//! study.toml     what was asked for
//! parts/         rows as trials ended, a file per process: what all else is made from
//! shown/         maps and paths that pictures show
//! trials.csv     the rows that the study asks for
//! timings.csv    processor time of the parts of each trial; differs between runs, as parts/ does
//! failures.csv   trials that failed, and why; only if there are any
//! summary.csv, tests.csv, figures/   the study's views
//! ```

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use mcl_core::files::{remove, write_atomically};
use mcl_core::text::thousands;
use serde::{Deserialize, Serialize};

use crate::data::facts::DataFacts;
use crate::recipe::DIGITS;
use crate::store::identity::Identity;
use crate::store::parts::{Parts, has_parts};
use crate::study::definition::Study;
use crate::study::plan::{ENTRIES, Plan};
use crate::table::{Cells, Table, Value};
use crate::trial::run::Trial;

/// The manifest of a result folder.
pub const MANIFEST: &str = "manifest.json";
/// The study of a result folder.
pub const STUDY: &str = "study.toml";
/// The rows that the study asks for.
pub const TRIALS: &str = "trials.csv";
/// Processor times.
pub const TIMINGS: &str = "timings.csv";
/// Trials that failed.
pub const FAILURES: &str = "failures.csv";
/// Folder of the files that pictures show.
pub const SHOWN: &str = "shown";
/// Means and intervals.
pub const SUMMARY: &str = "summary.csv";
/// Tests.
pub const TESTS: &str = "tests.csv";
/// Folder of the figures.
pub const FIGURES: &str = "figures";
/// Size limit of a small file of a result folder (bytes).
const MAX_BYTES: u64 = 4 << 20;

/// The rows of a study on a data set: those of the study's plan, and no others in the folder.
#[derive(Clone)]
pub struct Results {
    /// The folder.
    pub folder: PathBuf,
    /// Name of the study: that of its file without the ending.
    pub name: String,
    /// The study.
    pub study: Study,
    /// The trials of the study.
    pub plan: Plan,
    /// Facts about the data.
    pub facts: DataFacts,
    /// The rows, sorted, with the columns of [`Plan::columns`].
    pub table: Table,
    /// Trials that have all their rows.
    pub done: usize,
    /// Total number of trials.
    pub asked: usize,
    /// Trials that lack a row, in the order of the plan.
    pub without_rows: Vec<String>,
    /// The rows of the maps (and runs) of pictures, by picture and map as listed in the study; `None` where
    /// one is missing. Each has the [`SHOWN`] files beside it.
    pub pictured: Vec<Vec<Option<Pictured>>>,
    /// Damage found in the saved rows, a line each.
    pub damage: Vec<String>,
}

/// A map in a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Pictured {
    /// The measurements, as in a row.
    pub cells: Cells,
    /// The map's points (`.ply`), below the result folder's [`SHOWN`].
    pub map: PathBuf,
    /// The paths of the run, where one is shown.
    pub paths: Option<Paths>,
}

/// The paths of a run (TUM).
#[derive(Debug, Clone, PartialEq)]
pub struct Paths {
    /// The reference.
    pub reference: PathBuf,
    /// The estimate at the same scans.
    pub estimate: PathBuf,
    /// The odometry alone, from the first reference pose; versions before 0.2 did not keep it.
    pub odometry: PathBuf,
}

impl Pictured {
    /// The value of a column; empty where there is no such column.
    pub fn cell(&self, column: &str) -> &Value {
        let found = self.cells.iter().find(|(name, _)| name == column);
        found.map_or(&Value::Empty, |(_, value)| value)
    }
}

/// Studies that were read, by their text: parsing one plans each of its data sets, and the folders of all of
/// these hold the same text.
#[derive(Default)]
pub struct Studies(Mutex<HashMap<String, Study>>);

impl Studies {
    fn parse(&self, text: &str) -> Result<Study> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(text) {
            return Ok(known.clone());
        }
        let study = Study::parse(text)?;
        lock().insert(text.to_owned(), study.clone());
        Ok(study)
    }
}

/// The content of `manifest.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Name of the study: that of its file without the ending.
    pub study: String,
    /// What the rows depend on, apart from their recipes.
    pub identity: Identity,
}

impl Manifest {
    /// Parses the text of a manifest.
    ///
    /// # Errors
    /// When it is not a manifest.
    pub fn parse(text: &str) -> Result<Self> {
        Ok(serde_json::from_str(text)?)
    }

    /// Its text.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn to_text(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// Reads the manifest of a result folder; `None` where there is none.
    ///
    /// # Errors
    /// When it cannot be read, or is not of this version.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let Some(text) = read_text(&path)? else { return Ok(None) };
        let manifest = Self::parse(&text).with_context(|| {
            format!("{}: no manifest of this version; --fresh starts over", path.display())
        })?;
        Ok(Some(manifest))
    }
}

/// The text of a small file; `None` where there is none. A pipe is refused, as reading it could block.
pub(crate) fn read_text(path: &Path) -> Result<Option<String>> {
    let cannot = || format!("cannot read {}", path.display());
    let metadata = match fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error).with_context(cannot),
    };
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        bail!("{}: expected a file of at most {MAX_BYTES} bytes", path.display());
    }
    fs::read_to_string(path).map(Some).with_context(cannot)
}

impl Results {
    /// Whether every trial has its rows.
    pub fn is_complete(&self) -> bool {
        self.done == self.asked
    }

    /// "32 of 36 trials", where some are missing: everything made from the rows reports it.
    pub fn missing(&self) -> Option<String> {
        let found = || format!("{} of {} trials", thousands(self.done), thousands(self.asked));
        (!self.is_complete()).then(found)
    }

    /// Reads a result folder; `None` where it has no rows, as in those committed with the program.
    ///
    /// # Errors
    /// When a file is missing, cannot be read, or holds rows of another identity than the manifest's.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        Self::read_of(folder, &Studies::default())
    }

    /// Reads one of many folders as [`Results::read`] does.
    ///
    /// # Errors
    /// As there.
    pub fn read_of(folder: &Path, studies: &Studies) -> Result<Option<Self>> {
        if !has_parts(folder) {
            return Ok(None);
        }
        let in_folder = || folder.display().to_string();
        let Some(Manifest { study: name, identity }) =
            Manifest::read(folder).with_context(in_folder)?
        else {
            bail!("{} has rows but no {MANIFEST}; --fresh starts over", folder.display());
        };
        let path = folder.join(STUDY);
        let Some(text) = read_text(&path)? else {
            bail!("{} has rows but no {STUDY}; run the study again", folder.display());
        };
        let study = studies.parse(&text).with_context(|| format!("in {}", path.display()))?;
        let parts = Parts::read(folder, &identity).with_context(in_folder)?;
        Self::of(folder, &name, study, identity.data, parts).map(Some)
    }

    /// Selects, from the rows read, those of the study.
    ///
    /// # Errors
    /// When recipes cannot be written as JSON.
    pub fn of(
        folder: &Path,
        name: &str,
        study: Study,
        facts: DataFacts,
        mut parts: Parts,
    ) -> Result<Self> {
        let plan = study.plan(&facts.name)?;
        let columns = plan.columns(&study.measures)?;
        let pictured = pictured(folder, &study, &facts.name, &parts)?;
        let mut table = Table::new(columns.iter().cloned());
        let places = |of: &Vec<String>| of.iter().map(|column| table.column(column)).collect();
        let places: Vec<Vec<Option<usize>>> = parts.columns().iter().map(places).collect();
        let entries_place = table.column(ENTRIES);
        let mut without_rows = Vec::new();
        for (number, trial) in plan.trials.iter().enumerate() {
            let mut has_all = true;
            for (identity, entries) in plan.identities_of(number, &study.measures)? {
                let Some((of, values)) = parts.take(&identity) else {
                    has_all = false;
                    continue;
                };
                let mut row = vec![Value::Empty; columns.len()];
                for (place, value) in places[of].iter().zip(values) {
                    if let Some(place) = *place {
                        row[place] = value;
                    }
                }
                if let Some(place) = entries_place {
                    row[place] = entries.into();
                }
                table.push(row);
            }
            if !has_all {
                without_rows.push(trial.to_string());
            }
        }
        table.sort();
        let (name, folder, asked) = (name.to_owned(), folder.to_owned(), plan.trials.len());
        let (done, damage) = (asked - without_rows.len(), parts.damage);
        Ok(Results {
            folder,
            name,
            study,
            plan,
            facts,
            table,
            done,
            asked,
            without_rows,
            pictured,
            damage,
        })
    }
}

/// The maps and paths of pictures, as far as they exist.
fn pictured(
    folder: &Path,
    study: &Study,
    dataset: &str,
    parts: &Parts,
) -> Result<Vec<Vec<Option<Pictured>>>> {
    let of_map = |shown: ShownMap| {
        let row = parts.row(&shown.identity).filter(|_| shown.is_there())?;
        let cells = row.map(|(column, value)| (column.to_owned(), value.clone())).collect();
        Some(Pictured { cells, map: shown.map, paths: shown.paths })
    };
    let shown = ShownMap::all(study, folder, dataset)?.into_iter();
    Ok(shown.map(|maps| maps.into_iter().map(of_map).collect()).collect())
}

/// A map of a picture, and the paths of its files: they are named after the identity of its row, so that a
/// picture never shows another map than it names.
pub struct ShownMap {
    /// The map, with the run on it where one is shown.
    pub trial: Trial,
    /// The identity of its row.
    pub identity: String,
    /// Its points.
    pub map: PathBuf,
    /// Those of the run, where one is shown.
    pub paths: Option<Paths>,
}

/// Endings of the names of the files after the identity.
const SHOWN_ENDS: [&str; 4] = [".ply", "-reference.tum", "-estimate.tum", "-odometry.tum"];

impl ShownMap {
    /// All, by picture and map, as listed in the study.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn all(study: &Study, folder: &Path, dataset: &str) -> Result<Vec<Vec<Self>>> {
        let of_map = |map: &toml::Table, run: Option<u32>| -> Result<Self> {
            let trial = study.pictured(dataset, map, run)?;
            let identities = trial.identities(&study.measures)?;
            let identity = identities.into_iter().next().context("a map has a row")?;
            let [map, reference, estimate, odometry] =
                SHOWN_ENDS.map(|end| folder.join(SHOWN).join(format!("{identity}{end}")));
            let paths = run.map(|_| Paths { reference, estimate, odometry });
            Ok(ShownMap { trial, identity, map, paths })
        };
        let pictures = study.views.pictures.iter();
        pictures
            .map(|picture| picture.maps.iter().map(|map| of_map(map, picture.run)).collect())
            .collect()
    }

    /// Whether a path has the name of such a file.
    pub fn is_name(path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        SHOWN_ENDS.iter().any(|end| {
            name.strip_suffix(end).is_some_and(|identity| {
                identity.len() == DIGITS && identity.bytes().all(|byte| byte.is_ascii_hexdigit())
            })
        })
    }

    /// Its files.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.needed().chain(self.paths.iter().map(|paths| &paths.odometry))
    }

    fn needed(&self) -> impl Iterator<Item = &PathBuf> {
        let paths = self.paths.iter().flat_map(|paths| [&paths.reference, &paths.estimate]);
        paths.chain([&self.map])
    }

    /// Whether the files that a picture needs exist: odometry may be missing.
    pub fn is_there(&self) -> bool {
        self.needed().all(|file| file.is_file())
    }
}

/// Writes a file atomically.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a table as CSV; removes the file of an earlier one where there are no rows.
///
/// # Errors
/// When it cannot be written or removed.
pub fn save_table(path: &Path, table: &Table) -> Result<()> {
    if table.is_empty() {
        return remove(path).with_context(|| format!("cannot remove {}", path.display()));
    }
    save(path, &table.to_csv()?)
}

/// The content of a root of results.
#[derive(Default)]
pub struct FoundResults {
    /// Folders with rows.
    pub results: Vec<Results>,
    /// Result folders without rows, such as those that are committed.
    pub without_rows: Vec<PathBuf>,
    /// Folders that could not be read, with the error.
    pub damaged: Vec<(PathBuf, anyhow::Error)>,
}

/// Reads the result folders `<study>/<data set>/` below a root, sorted. One that cannot be read does not stop
/// the others.
///
/// # Errors
/// When the root cannot be read, or holds no result folder.
pub fn read_all(root: &Path) -> Result<FoundResults> {
    let mut found = FoundResults::default();
    let studies = Studies::default();
    for folder in folders(root)? {
        match Results::read_of(&folder, &studies) {
            Ok(Some(results)) => found.results.push(results),
            Ok(None) => found.without_rows.push(folder),
            Err(error) => found.damaged.push((folder, error)),
        }
    }
    Ok(found)
}

/// The result folders below a root, sorted: all `<study>/<data set>/` with a manifest.
///
/// # Errors
/// When a folder cannot be read, or no result folder exists.
pub fn folders(root: &Path) -> Result<Vec<PathBuf>> {
    let subfolders = |folder: &Path| -> Result<Vec<PathBuf>> {
        let entries =
            fs::read_dir(folder)
                .and_then(Iterator::collect::<std::io::Result<Vec<_>>>)
                .with_context(|| format!("cannot look for results in {}", folder.display()))?;
        Ok(entries.into_iter().map(|entry| entry.path()).filter(|path| path.is_dir()).collect())
    };
    let mut found = Vec::new();
    for study in subfolders(root)? {
        found.extend(subfolders(&study)?.into_iter().filter(|path| path.join(MANIFEST).exists()));
    }
    if found.is_empty() {
        bail!(
            "{}: no results, expected <study>/<data set>/{MANIFEST} below it; \
             `mcl-eval run likelihood` makes some",
            root.display()
        );
    }
    found.sort();
    Ok(found)
}
