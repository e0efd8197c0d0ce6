//! Reads result folders for the page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use mcl_study::store::results::{Results, folders};
use rayon::prelude::*;

use crate::claims::claim::DatasetClaims;
use crate::claims::{decide, without_results};
use crate::cli::told_once;
use crate::report::folder::Folder;

/// What the page shows.
#[derive(Debug, Default)]
pub struct Report {
    /// Folders by the name of their study, each sorted by data set.
    pub studies: BTreeMap<String, Vec<Folder>>,
    /// The paper's claims, decided from the folders with rows.
    pub claims: Vec<DatasetClaims>,
    /// Data sets that studies with claims list and that have no results.
    pub without_results: Vec<String>,
    /// Folders that could not be read, and why.
    pub damaged: Vec<(PathBuf, String)>,
}

/// What the folders of one data set say.
#[derive(Default)]
struct OfDataset {
    folders: Vec<Folder>,
    claims: Vec<DatasetClaims>,
    without_results: Vec<String>,
    damaged: Vec<(PathBuf, String)>,
}

/// Reads the result folders below some roots. A folder that cannot be read stops no other. Claims compare studies on
/// the same data, so the rows of one data set are in memory together, and no others with them on the same thread.
///
/// # Errors
/// When a root cannot be read, or holds no result folder.
pub fn gather(roots: &[PathBuf]) -> Result<Report> {
    let mut by_dataset: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for root in roots {
        for folder in folders(root)? {
            by_dataset.entry(name_of(&folder)).or_default().push(folder);
        }
    }
    let found: Vec<OfDataset> =
        by_dataset.into_values().par_bridge().map(|f| of_dataset(&f)).collect();
    let mut report = Report::default();
    for of_dataset in found {
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
    let Report { claims, without_results, damaged, .. } = &mut report;
    claims.sort_by(|a, b| a.name.cmp(&b.name));
    without_results.retain(|name| !claims.iter().any(|dataset| dataset.name == *name));
    without_results.sort();
    without_results.dedup();
    damaged.sort();
    Ok(report)
}

fn name_of(folder: &Path) -> String {
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn of_dataset(folders: &[PathBuf]) -> OfDataset {
    let mut found = OfDataset::default();
    let mut all = Vec::new();
    for path in folders {
        let read = Results::read(path).and_then(|results| match results {
            Some(results) => {
                let folder = Folder::of_rows(&results)?;
                all.push(results);
                Ok(folder)
            }
            None => Folder::of_files(path),
        });
        match read {
            Ok(folder) => found.folders.push(folder),
            Err(error) => found.damaged.push((path.clone(), told_once(&error))),
        }
    }
    found.claims = decide(&all);
    found.without_results = without_results(&all, &found.claims);
    found
}
