//! Running a study on a data set, and going on where an earlier run ended.

use std::collections::HashSet;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::files::{create_folder, remove, remove_folder, remove_leftovers};
use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_maps::files::{Encoding, write_map};
use mcl_metrics::tum;

use crate::data::facts::DataFacts;
use crate::data::source::LogSource;
use crate::measure::{MapMeasure, OfDimension};
use crate::recipe::run::RunRecipe;
use crate::store::identity::{Build, Identity};
use crate::store::parts::{FailedTrial, OwnPart, PARTS, Parts, Saved};
use crate::store::results::{
    FAILURES, MANIFEST, Manifest, Results, SHOWN, STUDY, Shown, TIMINGS, TRIALS, save, save_table,
};
use crate::study::definition::Study;
use crate::table::{Cells, Table};
use crate::trial::cost::Costs;
use crate::trial::division::{Division, StudyData};
use crate::trial::map::Dimension;
use crate::trial::maps::Maps;
use crate::trial::run::{Trial, run_trial};
use crate::trial::scheduler::run_trials;
use crate::trial::stopwatch::Stopwatch;
use crate::trial::tracking::TrackedRun;

/// What happens while a study runs.
pub enum Event<'e> {
    /// Before the first trial.
    Started {
        /// Trials that an earlier run left done.
        done: usize,
        /// Trials in all.
        asked: usize,
        /// What was found damaged in the rows of earlier runs.
        damage: &'e [String],
    },
    /// A trial ended.
    Ended {
        /// Trials that ended in this run, and those to be run.
        ended: (usize, usize),
        /// Share of the work of this run that is done, from 0 to 1.
        share: f64,
        /// The trial, and why it failed, if it did.
        failed: Option<&'e FailedTrial>,
    },
}

/// How a run ended.
pub struct Ran {
    /// The rows, with those of earlier runs.
    pub results: Results,
    /// Trials that failed in this run, in the order of the plan.
    pub failed: Vec<FailedTrial>,
}

/// A trial that is to be run.
struct Task {
    trial: Trial,
    /// Whether a picture shows its map.
    is_shown: bool,
    /// Identities of its rows.
    identities: Vec<String>,
}

/// Runs a study on an open log or point cloud into `folder`, going on where earlier runs ended. The rows of
/// trials that succeeded are kept whatever happens. `fresh` removes what earlier runs left.
///
/// # Errors
/// When the log has no points, the folder holds rows of other data or of another build, or a file cannot
/// be written. A trial that fails ends nothing but itself.
pub fn run_study(
    study: &Study,
    name: &str,
    data: &StudyData,
    folder: &Path,
    fresh: bool,
    mut see: impl FnMut(Event<'_>),
) -> Result<Ran> {
    let identity = Identity { build: Build::this(), data: DataFacts::of(&data.source)? };
    let dataset = identity.data.name.clone();
    create_folder(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    if fresh {
        forget(folder)?;
    }
    for subfolder in ["", SHOWN, "figures"] {
        remove_leftovers(&folder.join(subfolder));
    }
    let parts = Parts::read(folder, &identity).with_context(|| folder.display().to_string())?;
    let manifest = Manifest { study: name.to_owned(), identity: identity.clone() }.to_text()?;
    save(&folder.join(MANIFEST), manifest.as_bytes())?;
    save(&folder.join(STUDY), study.text.as_bytes())?;

    let plan = study.plan(&dataset)?;
    let mut tasks = pending(study, &plan.trials, &parts)?;
    let costs = Costs::measured(identity.data.points, &plan.trials, &parts);
    let done = plan.trials.len() - tasks.len();
    see(Event::Started { done, asked: plan.trials.len(), damage: &parts.damage });
    tasks.extend(pictured(study, folder, &dataset, &parts)?);
    drop(parts);
    let mut part = OwnPart::new(folder, &identity);
    let failed = match identity.data.dimensions {
        3 => run_tasks::<3>(study, data, folder, &tasks, &costs, &mut part, &mut see)?,
        _ => run_tasks::<2>(study, data, folder, &tasks, &costs, &mut part, &mut see)?,
    };

    // Somebody may have begun another study there, or the folder anew.
    let is_ours = |file: &str, text: &str| {
        std::fs::read_to_string(folder.join(file)).is_ok_and(|found| found == text)
    };
    if !is_ours(MANIFEST, &manifest) || !is_ours(STUDY, &study.text) {
        bail!(
            "another run has changed the study in {}; rows are safe, and the same command goes on from \
             there",
            folder.display()
        );
    }
    let parts = Parts::read(folder, &identity).with_context(|| folder.display().to_string())?;
    let results = Results::of(folder, name, study.clone(), identity.data.clone(), &parts)?;
    if results.table.is_empty() {
        let reason = failed.first().map_or(String::new(), |f| format!(": {}", f.reason));
        bail!("no trial succeeded: there is nothing to summarize{reason}");
    }
    save(&folder.join(TRIALS), &results.table.to_csv()?)?;
    save_table(&folder.join(TIMINGS), &timings(&parts, &plan.trials))?;
    save_table(&folder.join(FAILURES), &failures(&failed))?;
    Ok(Ran { results, failed })
}

/// The trials of which rows are missing, each with those of its runs whose rows are.
fn pending(study: &Study, trials: &[Trial], parts: &Parts) -> Result<Vec<Task>> {
    let mut tasks = Vec::new();
    for trial in trials {
        let identities = trial.identities(&study.measures)?;
        let is_missing: Vec<bool> =
            identities.iter().map(|identity| !parts.has(identity)).collect();
        if !is_missing.contains(&true) {
            continue;
        }
        let mut missing = is_missing.iter();
        let runs =
            trial.runs.iter().filter(|_| *missing.next().unwrap_or(&false)).cloned().collect();
        let mut missing = is_missing.iter();
        let identities =
            identities.into_iter().filter(|_| *missing.next().unwrap_or(&false)).collect();
        let trial = Trial { map: trial.map.clone(), runs };
        tasks.push(Task { trial, is_shown: false, identities });
    }
    Ok(tasks)
}

/// The maps that pictures show, as far as their files or rows are not there.
fn pictured(study: &Study, folder: &Path, dataset: &str, parts: &Parts) -> Result<Vec<Task>> {
    let mut tasks: Vec<Task> = Vec::new();
    for picture in &study.views.pictures {
        for map in &picture.maps {
            let trial = study.pictured(dataset, map, picture.run)?;
            let identities = trial.identities(&study.measures)?;
            let is_there = identities.iter().all(|identity| {
                parts.has(identity) && Shown::of(folder, identity).is_there(!trial.runs.is_empty())
            });
            if !is_there && tasks.iter().all(|task| task.identities != identities) {
                tasks.push(Task { trial, is_shown: true, identities });
            }
        }
    }
    Ok(tasks)
}

fn run_tasks<const D: usize>(
    study: &Study,
    data: &StudyData,
    folder: &Path,
    tasks: &[Task],
    costs: &Costs,
    part: &mut OwnPart<'_>,
    see: &mut impl FnMut(Event<'_>),
) -> Result<Vec<FailedTrial>>
where
    Division<D>: Dimension<D>,
    MapMeasure: OfDimension<D>,
{
    let maps = Maps::<D>::new(data, tasks.iter().map(|task| &task.trial.map))?;
    let run = |task: &Task| -> Result<Saved> {
        let mut watch = Stopwatch::start();
        let shown = task.identities.first().filter(|_| task.is_shown);
        let show_run = |_: &RunRecipe, tracked: &TrackedRun| match shown {
            None => Ok(()),
            Some(identity) => {
                let division = maps.division(&task.trial.map)?;
                save_paths(
                    &Shown::of(folder, identity),
                    data.log()?,
                    &division.scans.rating,
                    tracked,
                )
            }
        };
        if let Some(identity) = shown {
            save_map(&Shown::of(folder, identity), &maps, &task.trial)?;
        }
        let rows = run_trial(&task.trial, &maps, data, &study.measures, &mut watch, show_run)?;
        maps.release(&task.trial.map)?;
        let rows: Vec<(String, Cells)> = task.identities.iter().cloned().zip(rows).collect();
        Ok(Saved::new(task.trial.to_string(), rows, watch.into_laps()))
    };
    let total: f64 = tasks.iter().map(|task| costs.of(&task.trial)).sum();
    let (mut ended, mut cost) = (0, 0.0);
    let mut failed: Vec<FailedTrial> = Vec::new();
    // As many as the pool of the whole program has.
    let threads = rayon::current_num_threads();
    run_trials(
        tasks,
        |task| costs.of(&task.trial),
        threads,
        run,
        |task, result| {
            ended += 1;
            cost += costs.of(&task.trial);
            let failure = match result {
                Ok(saved) => {
                    part.save(saved)?;
                    None
                }
                Err(error) => {
                    let trial = task.trial.to_string();
                    let failure = FailedTrial { trial, reason: format!("{error:#}") };
                    part.save_failure(failure.clone())?;
                    Some(failure)
                }
            };
            let (share, ended) = (cost / total, (ended, tasks.len()));
            see(Event::Ended { ended, share, failed: failure.as_ref() });
            failed.extend(failure);
            Ok(())
        },
    )?;
    // In the order of the plan, not in that in which they happened to end.
    let order = |failure: &FailedTrial| {
        tasks.iter().position(|task| task.trial.to_string() == failure.trial)
    };
    failed.sort_by_key(order);
    Ok(failed)
}

fn save_map<const D: usize>(shown: &Shown, maps: &Maps<'_, D>, trial: &Trial) -> Result<()>
where
    Division<D>: Dimension<D>,
{
    let map = maps.get(&trial.map)?;
    let points = map.points().with_context(|| format!("{trial}: pictures show maps of points"))?;
    if let Some(folder) = shown.map.parent() {
        create_folder(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    Ok(write_map(&shown.map, points, Encoding::Binary)?)
}

fn save_paths(
    shown: &Shown,
    log: &LogSource,
    rating: &[usize],
    tracked: &TrackedRun,
) -> Result<()> {
    let path = |poses: &mut dyn Iterator<Item = Pose2>| -> Trajectory {
        // TUM files need a time for every pose; without stamps the scan's number serves.
        let stamp = |scan: usize| {
            let number = Stamp::from_nanoseconds(scan as i64 * 1_000_000_000);
            log.recording.scans[scan].stamp.unwrap_or(number)
        };
        rating.iter().zip(poses).map(|(&scan, pose)| (stamp(scan), pose)).collect()
    };
    let reference = |&scan: &usize| log.recording.scans[scan].map_from_laser;
    tum::write_file(&shown.reference, &path(&mut rating.iter().filter_map(reference)))?;
    let estimates = &tracked.run.map_from_laser;
    Ok(tum::write_file(&shown.estimate, &path(&mut estimates.iter().copied()))?)
}

/// Processor times of the trials of a plan, the last of each.
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

fn failures(failed: &[FailedTrial]) -> Table {
    let mut table = Table::new(["trial", "reason"]);
    for FailedTrial { trial, reason } in failed {
        table.push(vec![trial.as_str().into(), reason.as_str().into()]);
    }
    table
}

/// Removes what earlier runs left, and nothing else.
fn forget(folder: &Path) -> Result<()> {
    for file in [MANIFEST, STUDY, TRIALS, TIMINGS, FAILURES, "summary.csv", "tests.csv"] {
        let path = folder.join(file);
        remove(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    for subfolder in [PARTS, SHOWN, "figures"] {
        let path = folder.join(subfolder);
        remove_folder(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(())
}
