//! Reads result folders for the page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use mcl_study::data::reference::RUN_SUMMARY;
use mcl_study::store::results::{Results, Studies, folders};
use rayon::prelude::*;

use crate::claims::claim::DatasetClaims;
use crate::claims::{decide, without_results};
use crate::progress::error_message;
use crate::report::exhibits::{self, ExhibitRequest, Exhibits, PageBudget, recorded_folders};
use crate::report::folder::Folder;
use crate::report::record::RECORDED_END;
use crate::report::slot::Slot;

/// The content of the page.
#[derive(Debug, Default)]
pub struct Report {
    /// Folders by the name of their study, each sorted by data set.
    pub studies: BTreeMap<String, Vec<Folder>>,
    /// The paper's claims, decided from the folders with rows.
    pub claims: Vec<DatasetClaims>,
    /// Data sets that are listed by studies with claims and have no result folder.
    pub without_results: Vec<String>,
    /// Folders and recorded runs that are left out, with the reason.
    pub damaged: Vec<(PathBuf, String)>,
    /// Folders with runs recorded by `localize`: their slot, or why they are not shown.
    pub localized: Vec<(PathBuf, Result<Slot, String>)>,
    /// Logs by path.
    pub logs: Vec<String>,
}

/// The content of the folders of one data set.
#[derive(Default)]
struct OfDataset {
    folders: Vec<Folder>,
    claims: Vec<DatasetClaims>,
    without_results: Vec<String>,
    damaged: Vec<(PathBuf, String)>,
    /// By folder with rows.
    wanted: Vec<(PathBuf, ExhibitRequest)>,
}

/// Reads the result folders below some roots. A folder that cannot be read does not stop the others. Claims
/// compare studies on the same data, so the rows of one data set are in memory together, and no others with
/// them on the same thread.
///
/// # Errors
/// When a root cannot be read, or holds no result folder.
pub fn gather(roots: &[PathBuf], logs: &[String], is_quiet: bool) -> Result<Report> {
    let mut by_dataset: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    let mut recorded = Vec::new();
    for root in roots {
        let of_root = recorded_folders(root);
        for folder in result_folders(root, &of_root)? {
            by_dataset.entry(name_of(&folder)).or_default().push(folder);
        }
        recorded.extend(of_root);
    }
    // A root may be given twice, and lie in another one.
    for folders in by_dataset.values_mut().chain([&mut recorded]) {
        folders.sort();
        folders.dedup();
    }
    let studies = Studies::default();
    let found: Vec<OfDataset> =
        by_dataset.into_values().par_bridge().map(|f| of_dataset(&f, &studies)).collect();
    let mut report = Report { logs: logs.to_owned(), ..Report::default() };
    let mut wanted = Vec::new();
    for of_dataset in found {
        wanted.extend(of_dataset.wanted);
        for folder in of_dataset.folders {
            report.studies.entry(folder.study.clone()).or_default().push(folder);
        }
        report.claims.extend(of_dataset.claims);
        report.without_results.extend(of_dataset.without_results);
        report.damaged.extend(of_dataset.damaged);
    }
    for folders in report.studies.values_mut() {
        folders.sort_by(|a, b| (&a.dataset, &a.path).cmp(&(&b.dataset, &b.path)));
    }
    let Report { studies, claims, without_results, damaged, localized, .. } = &mut report;
    claims.sort_by(|a, b| a.name.cmp(&b.name));
    without_results.retain(|name| !studies.values().flatten().any(|of| of.dataset == *name));
    without_results.sort();
    without_results.dedup();
    let mut budget = PageBudget::default();
    for folder in recorded {
        let shown = exhibits::localized(&folder, &mut budget, damaged);
        let slot = shown.map(|shown| shown.slot).map_err(|error| error_message(&error));
        localized.push((folder, slot));
    }
    damaged.sort();
    exhibit(&mut report, wanted, logs, budget, is_quiet);
    Ok(report)
}

/// The result folders of a root; a root with recorded runs may have none.
///
/// # Errors
/// When the root cannot be read, or has neither.
pub fn result_folders(root: &Path, recorded: &[PathBuf]) -> Result<Vec<PathBuf>> {
    match folders(root) {
        Err(_) if !recorded.is_empty() => Ok(Vec::new()),
        Err(_) if root.join(RUN_SUMMARY).is_file() => bail!(
            "{}: has {RUN_SUMMARY} but no runs to watch (run-NNN{RECORDED_END}); `mcl-eval localize` of this \
             version records them",
            root.display()
        ),
        found => found,
    }
}

/// Adds to each folder its exhibits, or a note why it has none.
fn exhibit(
    report: &mut Report,
    mut wanted: Vec<(PathBuf, ExhibitRequest)>,
    logs: &[String],
    mut budget: PageBudget,
    is_quiet: bool,
) {
    wanted.sort_by(|(a, _), (b, _)| a.cmp(b));
    let (paths, wanted): (Vec<_>, Vec<_>) = wanted.into_iter().unzip();
    let exhibits = exhibits::repeat(&wanted, logs, &mut budget, is_quiet);
    let mut by_path: BTreeMap<PathBuf, Exhibits> = paths.into_iter().zip(exhibits).collect();
    for folder in report.studies.values_mut().flatten() {
        let Some(Exhibits { runs, maps }) = by_path.remove(&folder.path) else { continue };
        let shown = [
            ("runs", runs.map(|runs| runs.map(|shown| shown.slot))),
            ("maps", maps.map(|maps| maps.map(|shown| shown.slot))),
        ];
        let mut reasons: Vec<(&str, String)> = Vec::new();
        for (what, shown) in shown {
            match shown {
                None => {}
                Some(Ok(slot)) => folder.slots.push(slot),
                Some(Err(why)) if reasons.iter().any(|(_, other)| *other == why) => {}
                Some(Err(why)) => reasons.push((what, why)),
            }
        }
        let notes = reasons.iter().map(|(what, why)| format!("No {what} are shown: {why}."));
        folder.notes.extend(notes);
    }
}

fn name_of(folder: &Path) -> String {
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn of_dataset(folders: &[PathBuf], studies: &Studies) -> OfDataset {
    let mut found = OfDataset::default();
    let mut all = Vec::new();
    for path in folders {
        let read = Results::read_of(path, studies).and_then(|results| match results {
            Some(results) => {
                let (folder, wanted) = (Folder::of_rows(&results)?, ExhibitRequest::of(&results)?);
                found.wanted.push((path.clone(), wanted));
                all.push(results);
                Ok(folder)
            }
            None => Folder::of_files(path),
        });
        let read = read.and_then(|folder| match folder.is_empty() {
            true => bail!("it has no rows, tables or figures: the study has hardly begun"),
            false => Ok(folder),
        });
        match read {
            Ok(folder) => found.folders.push(folder),
            Err(error) => found.damaged.push((path.clone(), error_message(&error))),
        }
    }
    found.claims = decide(&all);
    found.without_results = without_results(&all, &found.claims);
    found
}
