//! Result folders `<root>/<experiment>/<data set>/`: filled by experiments, read by figures.
//!
//! ```text
//! manifest.json  what it was computed from and by
//! trials.csv     a row per trial, saved as trials end
//! timings.csv    processor time of the parts of each trial, the only file that differs between runs
//! failures.csv   trials that failed, and why; only if there are any
//! summary.csv    mean, spread and interval per strategy and size
//! sweeps.csv     choices: what the exhaustive sweep found
//! tests.csv      strategies against each other, with p values
//! maps/          likelihood: the maps that figures show, and maps.csv about them
//! trajectory/    localization: map and trajectories of the run that figures show
//! figures/       SVG and PNG, drawn from the files above only
//! ```

mod choices;
mod compare;
mod figures;
mod figures_in_space;
mod likelihood;
mod localization;
mod localization_figures;
mod maps;
mod refinement;
mod representations;
mod representations_figure;
mod sensitivity;
mod sensitivity_figures;

use std::collections::HashSet;
use std::fmt::Display;
use std::fs::{self, File, TryLockError};
use std::hash::Hash;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_core::files::is_leftover;
use serde::Serialize;
use serde::de::DeserializeOwned;

pub use compare::{Comparison, compare};
pub use sensitivity::{Ranking, write_ranking};

use crate::cli::told_once;
use crate::experiment::{
    Experiment, FailureRow, Kind, Manifest, Stopwatch, TimingRow, Trial, TrialOutcome, TrialStore,
    run_trials, write_rows,
};
use crate::progress::{self, tell};
use mcl_study::data::source::DataSource;

pub(crate) use maps::ComparisonMaps;

pub(crate) const MANIFEST: &str = "manifest.json";
pub(crate) const TRIALS: &str = "trials.csv";
const TIMINGS: &str = "timings.csv";
const FAILURES: &str = "failures.csv";
const LOCK: &str = ".lock";
pub(crate) const SUMMARY: &str = "summary.csv";
pub(crate) const TESTS: &str = "tests.csv";
/// What an exhaustive sweep found.
const SWEEPS: &str = "sweeps.csv";
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

/// Runs an experiment on one log or point cloud into `folder`, going on where an earlier run stopped, then
/// summarizes and draws. The rows of trials that succeeded are kept whatever happens.
///
/// # Errors
/// When the log has no points, the folder holds rows of other settings, or a file cannot be written.
/// Failing trials are told on stderr and counted.
pub fn run_experiment(
    experiment: &Experiment,
    name: &str,
    source: &DataSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    match experiment {
        Experiment::Likelihood(definition) => {
            likelihood::run(definition, name, source, folder, options)
        }
        Experiment::Localization(definition) => {
            localization::run(definition, name, source.log()?, folder, options)
        }
        Experiment::Sensitivity(definition) => {
            sensitivity::run(definition, name, source.log()?, folder, options)
        }
        Experiment::Refinement(definition) => {
            refinement::run(definition, name, source, folder, options)
        }
        Experiment::Choices(definition) => {
            choices::run(definition, name, source.log()?, folder, options)
        }
        Experiment::Representations(definition) => {
            representations::run(definition, name, source.log()?, folder, options)
        }
    }
}

/// Whether a result folder has the rows of its trials; those committed with the program do not.
pub fn has_rows(folder: &Path) -> bool {
    folder.join(TRIALS).exists()
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
        Kind::Refinement => refinement::draw(folder, manifest),
        Kind::Choices => choices::draw(folder, manifest),
        Kind::Representations => representations_figure::draw(folder, manifest),
    }
}

/// The trials of an experiment on one log, and where their rows go.
struct Trials<'a, T> {
    dataset: &'a str,
    folder: &'a Path,
    /// Those that an earlier run has left done.
    done: Vec<T>,
    pending: Vec<T>,
}

impl<'a, T: Trial + Display> Trials<'a, T> {
    /// Divides trials into those that have all their rows and those to be run. The rows of a trial that was
    /// cut off between two of them are dropped: it is run again as a whole. `key` tells rows apart, and `keys`
    /// are those of a trial's rows.
    fn divide<R, K>(
        dataset: &'a str,
        folder: &'a Path,
        trials: Vec<T>,
        store: &mut TrialStore<R>,
        key: impl Fn(&R) -> K,
        keys: impl Fn(&T) -> Vec<K>,
    ) -> Result<Self>
    where
        R: Serialize + DeserializeOwned,
        K: Eq + Hash,
    {
        let saved: HashSet<K> = store.rows().iter().map(&key).collect();
        let is_done = |trial: &T| keys(trial).iter().all(|key| saved.contains(key));
        let (done, pending): (Vec<T>, Vec<T>) = trials.into_iter().partition(is_done);
        let redone: HashSet<K> = pending.iter().flat_map(keys).collect();
        store.retain(|row| !redone.contains(&key(row)))?;
        Ok(Trials { dataset, folder, done, pending })
    }

    /// Runs the pending trials with a progress bar, saving the rows of each as it ends, then the list
    /// of those that failed. The times of a trial are saved before its rows.
    fn run<R: Serialize + DeserializeOwned + Send>(
        &self,
        store: &mut TrialStore<R>,
        options: &RunOptions,
        run: impl Fn(&T, &mut Stopwatch) -> Result<Vec<R>> + Sync,
    ) -> Result<TrialOutcome> {
        let Trials { dataset, folder, done, pending } = self;
        if !done.is_empty() && !options.quiet {
            let all = done.len() + pending.len();
            tell!("{dataset}: {} of {all} trials are there already", done.len());
        }
        let mut timings: TrialStore<TimingRow> = TrialStore::open(&folder.join(TIMINGS))?;
        let redone: HashSet<String> = pending.iter().map(T::to_string).collect();
        timings.retain(|row| !redone.contains(&row.trial))?;
        let mut failures = Vec::new();
        // As many as the pool of the whole program has.
        let threads = rayon::current_num_threads();
        let total: f64 = pending.iter().map(Trial::cost).sum();
        // In parts of the whole, so that the time left follows the work and not the number of trials.
        const PARTS: f64 = 1e6;
        let bar = progress::bar(PARTS as u64, dataset, options.quiet);
        let (mut finished, mut cost) = (0, 0.0);
        let timed = |trial: &T| {
            let mut watch = Stopwatch::start();
            Ok((run(trial, &mut watch)?, watch))
        };
        let outcome = run_trials(pending, threads, timed, |trial, result| {
            finished += 1;
            cost += trial.cost();
            bar.set_position((PARTS * cost / total) as u64);
            bar.set_message(format!("{finished}/{} trials", pending.len()));
            match result {
                Ok((rows, watch)) => {
                    timings.push(watch.laps().iter().map(|&(part, seconds)| TimingRow {
                        trial: trial.to_string(),
                        part: part.to_owned(),
                        seconds,
                    }))?;
                    store.push(rows)
                }
                Err(error) => {
                    let reason = told_once(&error);
                    // Often all fail for the same reason; it is told once.
                    if failures.iter().all(|failure: &FailureRow| failure.reason != reason) {
                        bar.suspend(|| tell!("{dataset}: trial {trial} failed: {reason}"));
                    }
                    failures.push(FailureRow { trial: trial.to_string(), reason });
                    Ok(())
                }
            }
        });
        bar.finish_and_clear();
        let outcome = outcome?;
        timings.finish(|row| (row.trial.clone(), row.part.clone()))?;
        let path = folder.join(FAILURES);
        if failures.is_empty() {
            remove(&path, |path| fs::remove_file(path))?;
        } else {
            failures.sort_by(|a, b| a.trial.cmp(&b.trial));
            write_rows(&path, &failures)?;
            let (failed, all) = (failures.len(), done.len() + pending.len());
            tell!("{dataset}: {failed} of {all} trials failed, see {}", path.display());
        }
        if store.rows().is_empty() {
            bail!("no trial succeeded: there is nothing to summarize");
        }
        Ok(TrialOutcome { done: outcome.done + done.len(), failed: outcome.failed })
    }
}

/// A result folder that this run alone writes to.
struct Prepared {
    /// The manifest of an earlier run that this one goes on from.
    earlier: Option<Manifest>,
    /// Locked as long as it is open.
    _lock: File,
}

/// Makes the folder, sees that no other run writes there and that rows of an earlier run may stay, and
/// writes the manifest.
fn prepare(folder: &Path, manifest: &Manifest, fresh: bool) -> Result<Prepared> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let lock = lock(folder)?;
    if fresh {
        forget(folder)?;
    }
    for subfolder in ["", MAPS, FIGURES, localization::TRAJECTORY] {
        remove_leftovers(&folder.join(subfolder))?;
    }
    let path = folder.join(MANIFEST);
    // A manifest alone is that of results whose rows were not kept, as those in the repository.
    let earlier = match (has_rows(folder), path.exists()) {
        (true, true) => Some(Manifest::read(&path).context("--fresh starts anew")?),
        (true, false) => {
            bail!("{} has rows but no {MANIFEST}; --fresh starts anew", folder.display())
        }
        (false, _) => None,
    };
    if let Some(earlier) = &earlier {
        manifest.check_continues(earlier).with_context(|| folder.display().to_string())?;
    }
    manifest.write(&path)?;
    Ok(Prepared { earlier, _lock: lock })
}

/// Keeps other runs out of a folder until the file returned is closed, be it by the end of the program.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    let file = File::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => bail!(
            "another run is writing to {}; wait for its end, or choose another folder with -o",
            folder.display()
        ),
        Err(TryLockError::Error(error)) => tell!(
            "warning: {} cannot be locked ({error}); no other run may write there meanwhile",
            folder.display()
        ),
    }
    Ok(file)
}

/// Removes the temporary files of a run that was killed while it wrote them.
fn remove_leftovers(folder: &Path) -> Result<()> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for entry in entries.flatten().filter(|entry| is_leftover(&entry.path())) {
        remove(&entry.path(), |path| fs::remove_file(path))?;
    }
    Ok(())
}

/// Removes what an earlier run left, and nothing else.
fn forget(folder: &Path) -> Result<()> {
    for file in [TRIALS, TIMINGS, FAILURES, SUMMARY, SWEEPS, TESTS, MANIFEST] {
        remove(&folder.join(file), |path| fs::remove_file(path))?;
    }
    for subfolder in [MAPS, FIGURES, localization::TRAJECTORY] {
        remove(&folder.join(subfolder), |path| fs::remove_dir_all(path))?;
    }
    Ok(())
}

/// Removes what may be there.
fn remove(path: &Path, remove: impl Fn(&Path) -> io::Result<()>) -> Result<()> {
    match remove(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
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
