//! Result folders `<root>/<experiment>/<data set>/`: filled by experiments, read by figures.
//!
//! ```text
//! manifest.json  what it was computed from and by
//! trials.csv     a row per trial, saved as trials end
//! summary.csv    mean, spread and interval per strategy and size
//! tests.csv      strategies against each other, with p values
//! maps/          likelihood: the maps that figures show, and maps.csv about them
//! trajectory/    localization: map and trajectories of the run that figures show
//! figures/       SVG and PNG, drawn from the files above only
//! ```

mod figures;
mod likelihood;
mod localization;
mod localization_figures;
mod maps;
mod sensitivity;
mod sensitivity_figures;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde::de::DeserializeOwned;

pub use sensitivity::{Ranking, write_ranking};

use crate::experiment::{Experiment, Kind, Manifest, Trial, TrialOutcome, TrialStore, run_trials};
use crate::progress;
use crate::source::LogSource;

pub(crate) use maps::ComparisonMaps;

pub(crate) const MANIFEST: &str = "manifest.json";
pub(crate) const TRIALS: &str = "trials.csv";
pub(crate) const SUMMARY: &str = "summary.csv";
pub(crate) const TESTS: &str = "tests.csv";
const MAPS: &str = "maps";
const FIGURES: &str = "figures";

/// How to run an experiment.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    /// Forget the rows of an earlier run.
    pub fresh: bool,
    /// No progress bars and notes.
    pub quiet: bool,
}

/// Runs an experiment on one log into `folder`, going on where an earlier run stopped, then
/// summarizes and draws. The rows of trials that succeeded are kept whatever happens.
///
/// # Errors
/// When the log has no points, the folder holds rows of other settings, or a file cannot be written.
/// Failing trials are told on stderr and counted.
pub fn run_experiment(
    experiment: &Experiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    match experiment {
        Experiment::Likelihood(definition) => {
            likelihood::run(definition, name, source, folder, options)
        }
        Experiment::Localization(definition) => {
            localization::run(definition, name, source, folder, options)
        }
        Experiment::Sensitivity(definition) => {
            sensitivity::run(definition, name, source, folder, options)
        }
    }
}

/// Draws the figures of a result folder from its saved files, and returns what was written.
///
/// # Errors
/// When a file is missing or cannot be read or written.
pub fn draw_figures(folder: &Path) -> Result<Vec<PathBuf>> {
    let manifest = Manifest::read(&folder.join(MANIFEST))?;
    let figures = folder.join(FIGURES);
    fs::create_dir_all(&figures).with_context(|| format!("cannot make {}", figures.display()))?;
    match manifest.kind {
        Kind::Likelihood => figures::draw(folder, manifest),
        Kind::Localization => localization_figures::draw(folder, manifest),
        Kind::Sensitivity => sensitivity_figures::draw(folder, manifest),
    }
}

/// Runs the trials that have no rows yet, with a progress bar, saving the rows of each as it ends.
fn run_pending<T, R>(
    dataset: &str,
    pending: &[T],
    store: &mut TrialStore<R>,
    options: &RunOptions,
    run: impl Fn(&T) -> Result<Vec<R>> + Sync,
) -> Result<TrialOutcome>
where
    T: Trial + std::fmt::Display,
    R: Serialize + DeserializeOwned + Send,
{
    // As many as the pool of the whole program has.
    let threads = rayon::current_num_threads();
    let total: f64 = pending.iter().map(Trial::cost).sum();
    // In parts of the whole, so that the time left follows the work and not the number of trials.
    const PARTS: f64 = 1e6;
    let bar = progress::bar(PARTS as u64, dataset, options.quiet);
    let (mut finished, mut cost) = (0, 0.0);
    let outcome = run_trials(pending, threads, run, |trial, result| {
        finished += 1;
        cost += trial.cost();
        bar.set_position((PARTS * cost / total) as u64);
        bar.set_message(format!("{finished}/{} trials", pending.len()));
        match result {
            Ok(rows) => store.push(rows),
            Err(error) => {
                bar.suspend(|| eprintln!("{dataset}: trial {trial} failed: {error:#}"));
                Ok(())
            }
        }
    });
    bar.finish_and_clear();
    outcome
}

/// Says how many trials an earlier run has left done.
fn tell_resumed(dataset: &str, done: usize, pending: usize, options: &RunOptions) {
    if done > 0 && !options.quiet {
        eprintln!("{dataset}: {done} of {} trials are there already", done + pending);
    }
}

/// Makes the folder, checks that rows of an earlier run may stay, and writes the manifest. Returns the
/// earlier manifest.
fn prepare(folder: &Path, manifest: &Manifest, fresh: bool) -> Result<Option<Manifest>> {
    let path = folder.join(MANIFEST);
    if fresh {
        forget(folder)?;
    }
    let earlier = match path.exists() {
        true => Some(Manifest::read(&path).context("--fresh starts anew")?),
        false if folder.join(TRIALS).exists() => {
            bail!("{} has rows but no {MANIFEST}; --fresh starts anew", folder.display())
        }
        false => None,
    };
    if let Some(earlier) = &earlier {
        manifest.check_continues(earlier).with_context(|| folder.display().to_string())?;
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    manifest.write(&path)?;
    Ok(earlier)
}

/// Removes what an earlier run left, and nothing else.
fn forget(folder: &Path) -> Result<()> {
    let remove = |path: PathBuf, remove: fn(&Path) -> io::Result<()>| match remove(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    };
    for file in [TRIALS, SUMMARY, TESTS, MANIFEST] {
        remove(folder.join(file), |path| fs::remove_file(path))?;
    }
    for subfolder in [MAPS, FIGURES, localization::TRAJECTORY] {
        remove(folder.join(subfolder), |path| fs::remove_dir_all(path))?;
    }
    Ok(())
}

/// The result folders below a root, sorted: all `<experiment>/<data set>/` with a manifest.
///
/// # Errors
/// When a folder cannot be read, or there are none.
pub fn folders(root: &Path) -> Result<Vec<PathBuf>> {
    let subfolders = |folder: &Path| -> Result<Vec<PathBuf>> {
        let entries = fs::read_dir(folder)
            .and_then(Iterator::collect::<io::Result<Vec<_>>>)
            .with_context(|| format!("cannot look for results in {}", folder.display()))?;
        Ok(entries.into_iter().map(|entry| entry.path()).filter(|path| path.is_dir()).collect())
    };
    let mut found = Vec::new();
    for experiment in subfolders(root)? {
        found.extend(
            subfolders(&experiment)?.into_iter().filter(|path| path.join(MANIFEST).exists()),
        );
    }
    if found.is_empty() {
        bail!(
            "{}: no results, expected <experiment>/<data set>/manifest.json below it; \
             `mcl-eval run experiments/likelihood.toml` makes some",
            root.display()
        );
    }
    found.sort();
    Ok(found)
}
