//! Result folders `<root>/<experiment>/<data set>/`: filled by experiments, read by figures.
//!
//! ```text
//! manifest.json  what it was computed from and by
//! trials.csv     a row per trial, saved as trials end
//! summary.csv    mean, spread and interval per strategy and size
//! tests.csv      improved against initial maps
//! maps/          the maps that figures show, and maps.csv about them
//! figures/       SVG and PNG, drawn from the files above only
//! ```

mod figures;
mod maps;

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_maps::PointSet;

pub use figures::draw_figures;

use crate::experiment::{
    DatasetFacts, Experiment, LikelihoodExperiment, LikelihoodRow, LikelihoodTrial, Manifest,
    Trial, TrialOutcome, TrialStore, run_likelihood_trial, run_trials, summarize, test_improvement,
    trials, write_rows,
};
use crate::progress;
use crate::source::LogSource;

const MANIFEST: &str = "manifest.json";
const TRIALS: &str = "trials.csv";
const SUMMARY: &str = "summary.csv";
const TESTS: &str = "tests.csv";
const MAPS: &str = "maps";
const FIGURES: &str = "figures";

/// How to run an experiment.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    /// Forget the rows of an earlier run.
    pub fresh: bool,
    /// No progress bars and notes.
    pub quiet: bool,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
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
        Experiment::Likelihood(experiment) => {
            run_likelihood(experiment, name, source, folder, options)
        }
    }
}

fn run_likelihood(
    experiment: &LikelihoodExperiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let points = source.points()?;
    let sizes = experiment.sizes_for(&source.name);
    let facts = DatasetFacts::of(source, points.len());
    let manifest = Manifest::new(name, experiment, facts, sizes);
    let earlier = prepare(folder, &manifest, options.fresh)?;
    let data = PointSet::new(points)?;

    let mut store = TrialStore::open(&folder.join(TRIALS))?;
    let saved: HashSet<_> =
        store.rows().iter().map(|row: &LikelihoodRow| identity(row.key())).collect();
    let all = trials(experiment, &source.name, sizes, data.len());
    let (done, pending): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|trial| saved.contains(&identity(trial.key())));
    if !done.is_empty() && !options.quiet {
        eprintln!(
            "{}: {} of {} trials are there already",
            source.name,
            done.len(),
            done.len() + pending.len()
        );
    }
    let outcome = run_pending(experiment, &source.name, &data, &pending, &mut store, options)?;
    let rows = store.finish(LikelihoodRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize(&rows)?)?;
    write_rows(&folder.join(TESTS), &test_improvement(&rows)?)?;

    let unchanged = earlier.is_some_and(|earlier| earlier.definition.figures == experiment.figures);
    if !unchanged || !maps::complete(&folder.join(MAPS)) {
        maps::build(experiment, &source.name, &data, &folder.join(MAPS))?;
    }
    draw_figures(folder)?;
    Ok(TrialOutcome { done: outcome.done + done.len(), failed: outcome.failed })
}

fn run_pending(
    experiment: &LikelihoodExperiment,
    dataset: &str,
    data: &PointSet<2>,
    pending: &[LikelihoodTrial],
    store: &mut TrialStore<LikelihoodRow>,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let threads = match options.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    let total: f64 = pending.iter().map(Trial::cost).sum();
    // In parts of the whole, so that the time left follows the work and not the number of trials.
    const PARTS: f64 = 1e6;
    let bar = progress::bar(PARTS as u64, dataset, options.quiet);
    let (mut finished, mut cost) = (0, 0.0);
    let outcome = run_trials(
        pending,
        threads,
        |trial| run_likelihood_trial(experiment, dataset, data, trial),
        |trial, result| {
            finished += 1;
            cost += trial.cost();
            bar.set_position((PARTS * cost / total) as u64);
            bar.set_message(format!("{finished}/{} trials", pending.len()));
            match result {
                Ok(row) => store.push(row),
                Err(error) => {
                    let (size, builder, repeat) = trial.key();
                    let strategy = builder.label(false);
                    bar.suspend(|| {
                        eprintln!(
                            "{dataset}: trial {strategy} {size} % #{repeat} failed: {error:#}"
                        );
                    });
                    Ok(())
                }
            }
        },
    );
    bar.finish_and_clear();
    outcome
}

/// A trial's key in a form that can be hashed.
fn identity<B>((size, builder, repeat): (f64, B, u32)) -> (u64, B, u32) {
    (size.to_bits(), builder, repeat)
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
    for folder in [folder.join(MAPS), folder.join(FIGURES)] {
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
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
    for subfolder in [MAPS, FIGURES] {
        remove(folder.join(subfolder), |path| fs::remove_dir_all(path))?;
    }
    Ok(())
}

/// The result folders below a root, sorted: all `<experiment>/<data set>/` with a manifest.
///
/// # Errors
/// When a folder cannot be read.
pub fn folders(root: &Path) -> io::Result<Vec<PathBuf>> {
    let subfolders = |folder: &Path| -> io::Result<Vec<PathBuf>> {
        let entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
        Ok(entries.into_iter().map(|entry| entry.path()).filter(|path| path.is_dir()).collect())
    };
    let mut found = Vec::new();
    for experiment in subfolders(root)? {
        found.extend(
            subfolders(&experiment)?.into_iter().filter(|path| path.join(MANIFEST).exists()),
        );
    }
    found.sort();
    Ok(found)
}
