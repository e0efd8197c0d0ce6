//! The parts of a result folder that the page shows.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result};
use mcl_study::store::identity::Identity;
use mcl_study::store::results::{
    FAILURES, FIGURES, Manifest, Results, STUDY, SUMMARY, TESTS, TIMINGS, TRIALS,
};
use mcl_study::study::definition::Study;
use mcl_study::table::Table;
use mcl_study::view;
use mcl_study::view::chart::ChartData;
use mcl_study::view::estimate::Estimates;

use crate::report::files;
use crate::report::slot::Slot;

/// A study on a data set.
#[derive(Debug)]
pub struct Folder {
    /// Its path.
    pub path: PathBuf,
    /// Name of the study.
    pub study: String,
    /// Name of the data set.
    pub dataset: String,
    /// Build and data; `None` where the manifest is not of this version.
    pub identity: Option<Identity>,
    /// The study's file, as text.
    pub settings: Option<String>,
    /// Rows behind the results; `None` where only tables and figures exist.
    pub rows: Option<Rows>,
    /// Charts.
    pub charts: Vec<ChartData>,
    /// Means and intervals.
    pub summary: Table,
    /// Tests.
    pub tests: Table,
    /// Processor times.
    pub timings: Table,
    /// Trials that failed.
    pub failures: Table,
    /// Figures for print (SVG).
    pub figures: Vec<PathBuf>,
    /// Runs to watch and maps to compare.
    pub slots: Vec<Slot>,
    /// What is missing or damaged, a sentence each.
    pub notes: Vec<String>,
}

/// Counts of a folder's rows.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    /// Number of trials with all rows.
    pub done: usize,
    /// Total number of trials.
    pub asked: usize,
    /// Number of rows.
    pub count: usize,
    /// Time of the last change of their file, where the system reports it.
    pub written: Option<SystemTime>,
}

impl Folder {
    /// From rows.
    ///
    /// # Errors
    /// When a value is not usable, or a file cannot be read.
    pub fn of_rows(results: &Results) -> Result<Self> {
        let Results { folder, done, asked, .. } = results;
        let mut found = Folder::bare(folder);
        let estimates = Estimates::of(results)?;
        found.charts = view::charts::charts(&estimates)?;
        found.summary = view::summary::summary(&estimates)?;
        found.tests = view::compare::tests(&estimates.groups)?;
        found.settings = Some(results.study.text.clone());
        let written = fs::metadata(folder.join(TRIALS)).and_then(|file| file.modified()).ok();
        found.rows = Some(Rows { done: *done, asked: *asked, count: results.table.len(), written });
        if let Some(missing) = results.missing() {
            found.notes.push(format!(
                "Incomplete: {missing} have rows; the same command runs the missing ones."
            ));
        }
        let damaged = results.damage.iter().take(3).map(|damage| format!("Damaged: {damage}"));
        found.notes.extend(damaged);
        found.read_further(Some(&results.study))?;
        Ok(found)
    }

    /// From the tables and figures, without rows.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn of_files(folder: &Path) -> Result<Self> {
        let mut found = Folder::bare(folder);
        let study = folder.join(STUDY);
        found.settings = fs::read_to_string(&study).ok();
        let study = found.settings.as_deref().and_then(|text| Study::parse(text).ok());
        let table = |name| {
            Ok::<_, anyhow::Error>(files::read_table(&folder.join(name))?.unwrap_or_default())
        };
        found.summary = table(SUMMARY)?;
        found.tests = table(TESTS)?;
        for path in entries(&folder.join(FIGURES), "csv")? {
            let (Some(points), Some(name)) = (files::read_table(&path)?, stem(&path)) else {
                continue;
            };
            // Tables of regions have other columns.
            if ["panel", "measure", "curve", "x", "y"]
                .iter()
                .all(|column| points.column(column).is_some())
            {
                found.charts.push(files::chart(&name, &points, study.as_ref()));
            }
        }
        found.charts.retain(|chart| !chart.panels.is_empty());
        found.read_further(study.as_ref())?;
        Ok(found)
    }

    /// The information in the folder's path and manifest.
    fn bare(path: &Path) -> Self {
        let name = |path: Option<&Path>| {
            let name = path.and_then(Path::file_name).unwrap_or_default();
            name.to_string_lossy().into_owned()
        };
        let manifest = Manifest::read(path).ok().flatten();
        let notes = match manifest {
            Some(_) => Vec::new(),
            None => vec!["The manifest is of another version of the program.".to_owned()],
        };
        Folder {
            path: path.to_owned(),
            study: name(path.parent()),
            dataset: name(Some(path)),
            identity: manifest.map(|manifest| manifest.identity),
            settings: None,
            rows: None,
            charts: Vec::new(),
            summary: Table::default(),
            tests: Table::default(),
            timings: Table::default(),
            failures: Table::default(),
            figures: Vec::new(),
            slots: Vec::new(),
            notes,
        }
    }

    /// Reads what is common to all folders. Charts are in the study's order.
    fn read_further(&mut self, study: Option<&Study>) -> Result<()> {
        let table = |name| {
            Ok::<_, anyhow::Error>(files::read_table(&self.path.join(name))?.unwrap_or_default())
        };
        (self.timings, self.failures) = (table(TIMINGS)?, table(FAILURES)?);
        self.figures = entries(&self.path.join(FIGURES), "svg")?;
        if let Some(study) = study {
            let place = |chart: &ChartData| {
                let views = &study.views.charts;
                views.iter().position(|view| files::is_of(view, &chart.name)).unwrap_or(views.len())
            };
            self.charts.sort_by_key(place);
        }
        Ok(())
    }

    /// Whether there is nothing to show, as before the first trial ends.
    pub fn is_empty(&self) -> bool {
        let tables = [&self.summary, &self.tests, &self.failures];
        let has_figures = !self.charts.is_empty() || !self.figures.is_empty();
        self.rows.is_none() && !has_figures && tables.iter().all(|table| table.is_empty())
    }

    /// Name of the data in words, where it is known.
    pub fn title(&self) -> &str {
        self.identity.as_ref().map_or(&self.dataset, |identity| &identity.data.title)
    }
}

/// The files of a folder with an ending, sorted; empty where there is no folder.
fn entries(folder: &Path, ending: &str) -> Result<Vec<PathBuf>> {
    let cannot = || format!("cannot read {}", folder.display());
    let found = match fs::read_dir(folder) {
        Ok(entries) => entries.collect::<std::io::Result<Vec<_>>>().with_context(cannot)?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(cannot),
    };
    let mut paths: Vec<PathBuf> = found.into_iter().map(|entry| entry.path()).collect();
    paths.retain(|path| path.extension() == Some(ending.as_ref()) && path.is_file());
    paths.sort();
    Ok(paths)
}

/// A file's name without its ending.
pub fn stem(path: &Path) -> Option<String> {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned())
}
