//! Runs a study on a data set, resuming earlier runs.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use mcl_core::files::{create_folder, remove, remove_folder, remove_leftovers};
use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_maps::files::{Encoding, write_map};
use mcl_metrics::tum;

use crate::data::facts::DataFacts;
use crate::data::source::LogSource;
use crate::localizer::process::Ended;
use crate::localizer::program::{FAILED_RUNS, Programs, failed_run};
use crate::measure::{MapMeasure, OfDimension};
use crate::recipe::run::RunRecipe;
use crate::share::{Share, deal};
use crate::store::identity::{Build, Identity};
use crate::store::parts::{FailedTrial, OwnPart, PARTS, Parts, SavedTrial};
use crate::store::results::{
    FAILURES, FIGURES, MANIFEST, Manifest, Paths, Results, SHOWN, STUDY, SUMMARY, ShownMap, TESTS,
    TIMINGS, TRIALS, read_text, save, save_table,
};
use crate::study::definition::Study;
use crate::table::{Cells, Table};
use crate::trial::cost::Costs;
use crate::trial::division::{Division, StudyData};
use crate::trial::map::Dimension;
use crate::trial::maps::Maps;
use crate::trial::pace::Pace;
use crate::trial::run::{OF_RUNS, Trial, run_trial};
use crate::trial::scheduler::run_trials;
use crate::trial::stopwatch::Stopwatch;
use crate::trial::tracking::TrackedRun;

/// Progress of a study.
pub enum Event<'e> {
    /// Before the first trial.
    Started {
        /// Trials completed by earlier runs.
        done: usize,
        /// Total number of trials.
        asked: usize,
        /// Damage found in the rows of earlier runs.
        damage: &'e [String],
    },
    /// The missing trials are about to be run; not sent when none is missing.
    Begins {
        /// Their number.
        trials: usize,
        /// Number of threads.
        threads: usize,
        /// Estimated wall-clock time.
        expected: Duration,
    },
    /// A trial ended.
    Ended {
        /// Number of trials that ended in this run, and number to be run.
        ended: (usize, usize),
        /// Share of the work of this run that is done, from 0 to 1.
        share: f64,
        /// Estimated wall-clock time until all have ended, from the times of those that have.
        left: Duration,
        /// The trial, and why it failed, if it did.
        failed: Option<&'e FailedTrial>,
    },
}

/// The result of a run.
pub struct RunResult {
    /// The rows, including those of earlier runs; `None` for a part, which leaves the tables to the merge.
    pub results: Option<Results>,
    /// Number of trials of this process; `done` of them have rows.
    pub asked: usize,
    /// See `asked`.
    pub done: usize,
    /// Trials that failed in this run, in the order of the plan; for a merge, those that failed and have no
    /// rows.
    pub failed: Vec<FailedTrial>,
}

/// A trial to be run.
struct Task {
    trial: Trial,
    /// Identities of its rows, one per run.
    identities: Vec<String>,
}

/// Runs a study, or a share of it, on an open log or point cloud into `folder`, resuming earlier runs. The
/// rows of completed trials are kept in any case.
///
/// # Errors
/// When the log has no points, the folder holds rows of other data or of another build, or a file cannot be
/// written. A failed trial does not stop the others.
pub fn run_study(
    study: &Study,
    name: &str,
    data: &StudyData,
    folder: &Path,
    share: Share,
    mut see: impl FnMut(Event<'_>),
) -> Result<RunResult> {
    let identity = Identity { build: Build::this(), data: DataFacts::of(&data.source)? };
    let dataset = identity.data.name.clone();
    create_folder(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    if share == (Share::Whole { fresh: true }) {
        let files = [MANIFEST, STUDY, TRIALS, TIMINGS, FAILURES, SUMMARY, TESTS];
        forget(folder, &files, &[PARTS, SHOWN, FIGURES, FAILED_RUNS])?;
    }
    remove_leftovers(folder);
    for subfolder in [PARTS, SHOWN, FIGURES] {
        let path = folder.join(subfolder);
        if path.is_symlink() {
            bail!("{} is a symbolic link, which is not written through; remove it", path.display());
        }
        remove_leftovers(&path);
    }
    let in_folder = || folder.display().to_string();
    let plan = study.plan(&dataset)?;
    let (mine, asked) = match share {
        Share::Whole { .. } | Share::Merge => (None, plan.trials.len()),
        Share::Part(part) => {
            let (dealt, mut rows) =
                deal_out(study, &plan.trials, folder, &identity.data, part.of())?;
            let of_part = dealt.iter().filter(|of| **of == part.number()).count();
            (Some(rows.swap_remove(part.number() - 1)), of_part)
        }
    };
    let is_mine = |row: &String| mine.as_ref().is_none_or(|mine| mine.contains(row));
    let parts = Parts::read_wanted(folder, &identity, mine.as_ref()).with_context(in_folder)?;
    // Files of pictures may exist without a row, from other data or another build.
    let before = Manifest::read(folder).ok().flatten();
    if before.is_none_or(|found| identity.check_same(&found.identity).is_err()) {
        forget(folder, &[], &[SHOWN])?;
    }
    let manifest = Manifest { study: name.to_owned(), identity: identity.clone() }.to_text()?;
    // Parts start at the same time: correct files are left alone.
    let is_there = |file: &str, text: &str| {
        let path = folder.join(file);
        !path.is_symlink() && read_text(&path).is_ok_and(|found| found.as_deref() == Some(text))
    };
    for (file, text) in [(MANIFEST, &manifest), (STUDY, &study.text)] {
        if !is_there(file, text) {
            save(&folder.join(file), text.as_bytes())?;
        }
    }

    let mut tasks = pending(study, &plan.trials, &parts, is_mine)?;
    let costs = Costs::measured(&identity.data, &study.measures, &plan.trials, &parts);
    see(Event::Started { done: asked - tasks.len(), asked, damage: &parts.damage });
    let mut shown = HashMap::new();
    if share == Share::Merge {
        tasks.clear();
    } else {
        shown = add_pictured(&mut tasks, ShownMap::all(study, folder, &dataset)?, &parts);
        tasks.retain(|task| task.identities.iter().any(is_mine));
        shown.retain(|identity, _| is_mine(identity));
    }
    // Read again after new rows were added.
    let parts = tasks.is_empty().then_some(parts);
    let mut part = OwnPart::new(folder, &identity);
    let programs = Programs::new(folder, study.folder.as_deref());
    let work =
        TrialWork { study, data, tasks: &tasks, programs: &programs, shown: &shown, costs: &costs };
    let failed = match identity.data.dimensions {
        3 => run_tasks::<3>(&work, &mut part, &mut see)?,
        _ => run_tasks::<2>(&work, &mut part, &mut see)?,
    };
    programs.end();

    // Another process may have started another study there, or recreated the folder.
    if !is_there(MANIFEST, &manifest) || !is_there(STUDY, &study.text) {
        bail!(
            "another run has changed the study in {}; rows are safe, and the same command continues from there",
            folder.display()
        );
    }
    if let Share::Part(_) = share {
        // Maps needed only for pictures are not among the trials of the study.
        let done = asked.saturating_sub(failed.len());
        return Ok(RunResult { results: None, asked, done, failed });
    }
    let parts = match parts {
        Some(parts) => parts,
        None => Parts::read(folder, &identity).with_context(in_folder)?,
    };
    let failed = match share {
        Share::Merge => without_rows(study, &plan.trials, &parts)?,
        _ => failed,
    };
    remove_unpictured(study, folder, &dataset)?;
    let timings = timings(&parts, &plan.trials);
    let failures = failures(&failed, study, &plan.trials, &parts)?;
    let results = Results::of(folder, name, study.clone(), identity.data, parts)?;
    save_table(&folder.join(TRIALS), &results.table)?;
    save_table(&folder.join(TIMINGS), &timings)?;
    save_table(&folder.join(FAILURES), &failures)?;
    if results.table.is_empty() {
        // Tables and figures of rows that the study asked for before.
        forget(folder, &[SUMMARY, TESTS], &[FIGURES])?;
        bail!(
            "{} of {} trials failed, there is nothing to summarize; {FAILURES} has the reasons",
            failed.len(),
            plan.trials.len()
        );
    }
    let (asked, done) = (results.asked, results.done);
    Ok(RunResult { results: Some(results), asked, done, failed })
}

/// The part (from 1, of `parts`) that runs each trial of a plan, and the identities of the rows of each part:
/// those of its trials, and of its share of the maps that are needed only for pictures. `folder` is that of
/// the results.
///
/// # Errors
/// When recipes cannot be written as JSON.
pub fn deal_out(
    study: &Study,
    trials: &[Trial],
    folder: &Path,
    data: &DataFacts,
    parts: usize,
) -> Result<(Vec<usize>, Vec<HashSet<String>>)> {
    let costs = Costs::built_in(data, &study.measures);
    let mut all: Vec<(f64, Vec<String>)> = Vec::new();
    for trial in trials {
        all.push((costs.of(trial), trial.identities(&study.measures)?));
    }
    let known: HashSet<String> = all.iter().flat_map(|(_, rows)| rows).cloned().collect();
    let pictured = ShownMap::all(study, folder, &data.name)?.into_iter().flatten();
    for shown in pictured.filter(|shown| !known.contains(&shown.identity)) {
        all.push((costs.of(&shown.trial), vec![shown.identity]));
    }
    let by_first: Vec<(f64, &str)> =
        all.iter().map(|(cost, rows)| (*cost, rows.first().map_or("", String::as_str))).collect();
    let dealt = deal(&by_first, parts);
    let mut rows = vec![HashSet::new(); parts];
    for ((_, of_trial), part) in all.into_iter().zip(&dealt) {
        rows[part - 1].extend(of_trial);
    }
    Ok((dealt[..trials.len()].to_vec(), rows))
}

/// The trials that failed in some process and have no rows, in the order of the plan, each with its last
/// reason.
fn without_rows(study: &Study, trials: &[Trial], parts: &Parts) -> Result<Vec<FailedTrial>> {
    let reasons: HashMap<&str, &FailedTrial> =
        parts.failed.iter().map(|failed| (failed.trial.as_str(), failed)).collect();
    let mut failed = Vec::new();
    for trial in trials {
        let has_rows = trial.identities(&study.measures)?.iter().all(|row| parts.has(row));
        let reason = reasons.get(trial.to_string().as_str());
        failed.extend(reason.filter(|_| !has_rows).map(|failed| (*failed).clone()));
    }
    Ok(failed)
}

/// Removes maps and paths of pictures that the study no longer has.
fn remove_unpictured(study: &Study, folder: &Path, dataset: &str) -> Result<()> {
    let shown = ShownMap::all(study, folder, dataset)?;
    let wanted: HashSet<&PathBuf> = shown.iter().flatten().flat_map(ShownMap::files).collect();
    let Ok(entries) = std::fs::read_dir(folder.join(SHOWN)) else { return Ok(()) };
    for path in entries.flatten().map(|entry| entry.path()) {
        if ShownMap::is_name(&path) && !wanted.contains(&path) {
            remove(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

/// The trials with missing rows, each with the runs whose rows are missing.
fn pending(
    study: &Study,
    trials: &[Trial],
    parts: &Parts,
    is_wanted: impl Fn(&String) -> bool,
) -> Result<Vec<Task>> {
    let is_missing = |row: &String| is_wanted(row) && !parts.has(row);
    let mut tasks = Vec::new();
    for trial in trials {
        let mut identities = trial.identities(&study.measures)?;
        let runs = trial.runs.iter().zip(&identities);
        let runs = runs.filter(|(_, identity)| is_missing(identity));
        let runs = runs.map(|(run, _)| run.clone()).collect();
        identities.retain(is_missing);
        if !identities.is_empty() {
            tasks.push(Task { trial: Trial { map: trial.map.clone(), runs }, identities });
        }
    }
    Ok(tasks)
}

/// Adds the maps of pictures whose files or rows are missing, and returns these by the identity of their
/// rows.
fn add_pictured(
    tasks: &mut Vec<Task>,
    pictured: Vec<Vec<ShownMap>>,
    parts: &Parts,
) -> HashMap<String, ShownMap> {
    let mut missing = HashMap::new();
    for shown in pictured.into_iter().flatten() {
        let identity = shown.identity.clone();
        if parts.has(&identity) && shown.is_there() {
            continue;
        }
        // Most are trials of the study that are run anyway.
        if !tasks.iter().any(|task| task.identities.contains(&identity)) {
            tasks.push(Task { trial: shown.trial.clone(), identities: vec![identity.clone()] });
        }
        missing.insert(identity, shown);
    }
    missing
}

/// The work to do, with its context.
struct TrialWork<'w> {
    study: &'w Study,
    data: &'w StudyData,
    tasks: &'w [Task],
    programs: &'w Programs,
    /// Maps of pictures, by the identity of the row.
    shown: &'w HashMap<String, ShownMap>,
    costs: &'w Costs,
}

fn run_tasks<const D: usize>(
    work: &TrialWork<'_>,
    part: &mut OwnPart<'_>,
    see: &mut impl FnMut(Event<'_>),
) -> Result<Vec<FailedTrial>>
where
    Division<D>: Dimension<D>,
    MapMeasure: OfDimension<D>,
{
    let &TrialWork { study, data, tasks, programs, shown, costs } = work;
    let maps = Maps::<D>::new(data, tasks.iter().map(|task| &task.trial.map))?;
    let compute = |task: &Task| -> Result<SavedTrial> {
        let mut watch = Stopwatch::start();
        let mut runs = task.identities.iter();
        let show_run = |_: &RunRecipe, tracked: &TrackedRun| {
            let shown = runs.next().and_then(|identity| shown.get(identity)?.paths.as_ref());
            let Some(paths) = shown else { return Ok(()) };
            save_paths(paths, data.log()?, tracked)
        };
        for shown in task.identities.iter().filter_map(|identity| shown.get(identity)) {
            save_map(&shown.map, &maps, &task.trial)?;
        }
        let rows =
            run_trial(&task.trial, &maps, data, &study.measures, programs, &mut watch, show_run)?;
        let rows: Vec<(String, Cells)> = task.identities.iter().cloned().zip(rows).collect();
        Ok(SavedTrial::new(task.trial.to_string(), rows, watch.into_laps()))
    };
    // A failed trial no longer needs its maps, either.
    let run = |task: &Task| {
        let saved = compute(task);
        maps.release(&task.trial.map)?;
        saved
    };
    // As many as in the global thread pool.
    let threads = rayon::current_num_threads();
    let mut pace = Pace::new(tasks.iter().map(|task| costs.parts_of(&task.trial)), threads);
    if !tasks.is_empty() {
        let threads = threads.min(tasks.len());
        see(Event::Begins { trials: tasks.len(), threads, expected: pace.left() });
    }
    let timed = |task: &Task| {
        let begin = Instant::now();
        // The time of a failed trial counts, too.
        Ok((run(task), begin.elapsed()))
    };
    let mut ended = 0;
    let mut failed: Vec<FailedTrial> = Vec::new();
    run_trials(
        tasks,
        |task| costs.of(&task.trial),
        threads,
        timed,
        |task, result| {
            ended += 1;
            let (result, took) = match result {
                Ok((result, took)) => (result, took),
                Err(panic) => (Err(panic), Duration::ZERO),
            };
            let measured = result.as_ref().ok().map(|saved| seconds_of(saved, &task.trial, took));
            pace.end(costs.parts_of(&task.trial), measured, took);
            let ended_with = result.map_err(|error| FailedTrial {
                trial: task.trial.to_string(),
                reason: format!("{error:#}"),
            });
            let failure = ended_with.as_ref().err().cloned();
            part.save(ended_with)?;
            let (share, left) = (pace.share(), pace.left());
            see(Event::Ended {
                ended: (ended, tasks.len()),
                share,
                left,
                failed: failure.as_ref(),
            });
            failed.extend(failure);
            Ok(())
        },
    )?;
    // In the order of the plan, not in the order in which they ended.
    let order = |failure: &FailedTrial| {
        tasks.iter().position(|task| task.trial.to_string() == failure.trial)
    };
    failed.sort_by_key(order);
    Ok(failed)
}

/// Seconds for a trial's map and for the runs on it. An external program has its own processor time, so its
/// runs count with the remaining wall-clock time.
fn seconds_of(saved: &SavedTrial, trial: &Trial, took: Duration) -> [f64; 2] {
    let is_of_runs = |part: &str| OF_RUNS.contains(&part);
    let sum = |of_runs: bool| -> f64 {
        let parts = saved.seconds.iter().filter(|(part, _)| is_of_runs(part) == of_runs);
        parts.map(|(_, seconds)| seconds).sum()
    };
    let [map, runs] = [sum(false), sum(true)];
    match trial.runs.iter().any(|run| run.program().is_some()) {
        true => [map, (took.as_secs_f64() - map).max(runs)],
        false => [map, runs],
    }
}

fn save_map<const D: usize>(path: &Path, maps: &Maps<'_, D>, trial: &Trial) -> Result<()>
where
    Division<D>: Dimension<D>,
{
    let map = maps.get(&trial.map)?;
    let points = map.points().with_context(|| format!("{trial}: pictures show maps of points"))?;
    if let Some(folder) = path.parent() {
        create_folder(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    Ok(write_map(path, points, Encoding::Binary)?)
}

fn save_paths(
    Paths { reference, estimate, odometry }: &Paths,
    log: &LogSource,
    tracked: &TrackedRun,
) -> Result<()> {
    let path = |poses: &mut dyn Iterator<Item = Option<Pose2>>| -> Trajectory {
        // TUM files need a time for every pose; without stamps the index of the scan is used.
        let stamp = |scan: usize| {
            let number = Stamp::from_nanoseconds(scan as i64 * 1_000_000_000);
            log.recording.scans[scan].stamp.unwrap_or(number)
        };
        let poses = tracked.scans.iter().zip(poses);
        poses.filter_map(|(&scan, pose)| Some((stamp(scan), pose?))).collect()
    };
    // Both at the same scans: a program may lack an estimate at some.
    let pairs = tracked.reference.iter().zip(&tracked.map_from_laser);
    tum::write_file(reference, &path(&mut pairs.map(|(pose, found)| found.map(|_| *pose))))?;
    tum::write_file(odometry, &path(&mut tracked.odometry.iter().copied().map(Some)))?;
    let estimates = tracked.map_from_laser.iter().copied();
    Ok(tum::write_file(estimate, &path(&mut { estimates }))?)
}

/// Processor times of the trials of a plan; the last ones of each trial.
fn timings(parts: &Parts, trials: &[Trial]) -> Table {
    let planned: HashSet<String> = trials.iter().map(ToString::to_string).collect();
    let mut table = Table::new(["trial", "part", "seconds"]);
    let mut seen = HashSet::new();
    for (trial, seconds) in parts.seconds.iter().rev() {
        if planned.contains(trial) && seen.insert(trial) {
            for (part, seconds) in seconds {
                table.push(vec![trial.as_str().into(), part.as_str().into(), (*seconds).into()]);
            }
        }
    }
    table.sort();
    table
}

/// The trials that failed, and the runs of programs that ended abnormally, which have rows.
fn failures(
    failed: &[FailedTrial],
    study: &Study,
    trials: &[Trial],
    parts: &Parts,
) -> Result<Table> {
    let mut table = Table::new(["trial", "reason"]);
    for FailedTrial { trial, reason } in failed {
        table.push(vec![trial.as_str().into(), reason.as_str().into()]);
    }
    for trial in trials.iter().filter(|trial| trial.runs.iter().any(|run| run.program().is_some()))
    {
        for (run, identity) in trial.runs.iter().zip(trial.identities(&study.measures)?) {
            let ended = parts.ended(&identity).filter(|ended| *ended != Ended::Ok.to_string());
            if let Some(ended) = ended {
                let reason = format!("{ended} ({FAILED_RUNS}/{})", failed_run(&identity));
                table.push(vec![format!("{trial} {run}").into(), reason.into()]);
            }
        }
    }
    Ok(table)
}

/// Removes files and folders of earlier runs.
fn forget(folder: &Path, files: &[&str], subfolders: &[&str]) -> Result<()> {
    for file in files {
        let path = folder.join(file);
        remove(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    for subfolder in subfolders {
        let path = folder.join(subfolder);
        remove_folder(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(())
}
