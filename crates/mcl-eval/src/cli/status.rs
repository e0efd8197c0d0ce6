//! `status`: the progress of the studies in a result folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result, bail};
use mcl_core::text::printable;
use mcl_study::store::parts::{PARTS, Parts, has_parts};
use mcl_study::store::results::{Manifest, STUDY};
use mcl_study::study::definition::Study;
use mcl_study::trial::cost::Costs;
use serde::Serialize;

use super::Outcome;
use super::args::StatusArgs;
use super::output::print;
use crate::progress::span;

/// A process that saved a row within this many seconds counts as running.
const ALIVE: f64 = 600.0;

#[derive(Serialize)]
struct Status {
    folders: Vec<FolderStatus>,
}

/// The progress of a study on a data set.
#[derive(Serialize)]
struct FolderStatus {
    folder: String,
    /// Numbers of trials: total, with all rows, failed without rows since, without rows.
    asked: usize,
    done: usize,
    failed: usize,
    missing: usize,
    /// Processes that saved a row within ten minutes.
    running: usize,
    /// Seconds since the last row was saved.
    last_sign_s: Option<f64>,
    /// Processor hours left; and wall-clock hours with the running processes, each on one thread.
    left_hours: f64,
    left_wall_hours: Option<f64>,
}

pub fn run(args: &StatusArgs) -> Result<Outcome> {
    loop {
        let status = Status { folders: look(&args.root)? };
        print(args.json, &status, text)?;
        let is_done = status.folders.iter().all(|folder| folder.missing == 0);
        let Some(seconds) = args.watch.filter(|_| !is_done) else {
            return Ok(Outcome::of(is_done));
        };
        sleep(Duration::from_secs_f64(seconds));
    }
}

/// Every folder below the root that has rows of its own.
fn look(root: &Path) -> Result<Vec<FolderStatus>> {
    let folders = |path: &Path| -> Result<Vec<PathBuf>> {
        let entries =
            fs::read_dir(path).with_context(|| format!("cannot read {}", path.display()))?;
        let mut folders: Vec<PathBuf> =
            entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
        folders.sort();
        Ok(folders)
    };
    let mut found = Vec::new();
    for study in folders(root)? {
        for folder in folders(&study)?.into_iter().filter(|folder| has_parts(folder)) {
            found.push(of_folder(&folder).with_context(|| folder.display().to_string())?);
        }
    }
    if found.is_empty() {
        bail!("no study below {} has rows of its own", root.display());
    }
    Ok(found)
}

fn of_folder(folder: &Path) -> Result<FolderStatus> {
    let manifest = Manifest::read(folder)?.context("it has rows but no manifest")?;
    let data = manifest.identity.data.clone();
    let path = folder.join(STUDY);
    let text =
        fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let study = Study::parse(&text)?;
    let parts = Parts::read(folder, &manifest.identity)?;
    let plan = study.plan(&data.name)?;
    let costs = Costs::measured(&data, &study.measures, &plan.trials, &parts);
    let (mut done, mut failed, mut left) = (0, 0, 0.0);
    for trial in &plan.trials {
        let identities = trial.identities(&study.measures)?;
        if identities.iter().all(|identity| parts.has(identity)) {
            done += 1;
            continue;
        }
        left += costs.of(trial);
        let name = trial.to_string();
        failed += usize::from(parts.failed.iter().any(|failed| failed.trial == name));
    }
    let now = SystemTime::now();
    let ages: Vec<f64> = fs::read_dir(folder.join(PARTS))
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.metadata().ok()?.modified().ok())
        .map(|modified| now.duration_since(modified).unwrap_or_default().as_secs_f64())
        .collect();
    let running = ages.iter().filter(|age| **age < ALIVE).count();
    let (asked, missing) = (plan.trials.len(), plan.trials.len() - done);
    Ok(FolderStatus {
        folder: folder.display().to_string(),
        asked,
        done,
        failed,
        missing,
        running: if missing > 0 { running } else { 0 },
        last_sign_s: ages.into_iter().reduce(f64::min),
        left_hours: left / 3600.0,
        left_wall_hours: (running > 0 && missing > 0).then(|| left / 3600.0 / running as f64),
    })
}

fn text(status: &Status) -> String {
    let line = |folder: &FolderStatus| {
        let FolderStatus { asked, done, failed, missing, running, .. } = folder;
        let mut line = format!("{}: {done} of {asked} trials done", printable(&folder.folder));
        if *missing > 0 {
            line += &format!(", {missing} missing ({failed} failed), {running} running");
            if let Some(seconds) = folder.last_sign_s {
                line += &format!(", last row {} ago", span(seconds));
            }
            line += &format!("; {} of processor time left", span(3600.0 * folder.left_hours));
            if let Some(hours) = folder.left_wall_hours {
                line += &format!(", about {} with these", span(3600.0 * hours));
            }
        }
        line
    };
    status.folders.iter().map(line).collect::<Vec<_>>().join("\n")
}
