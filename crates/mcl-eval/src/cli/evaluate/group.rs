//! Runs of several localizers: a summary of each group, and comparisons between groups.
//!
//! A run is the independent unit: a group's mean is the mean of the means of its runs, with Student's
//! interval over runs. Differences are tested over runs, in pairs where two groups have runs of the same name
//! (a bag, a seed), and all tests of a call are one family.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_datasets::log::is_bag_folder;
use mcl_metrics::{
    Blocked, Effect, Interval, Rate, Summary, fisher_exact, holm, mean_interval, paired,
    rate_difference, two_sample,
};
use mcl_study::data::reference::RUN_SUMMARY;
use serde::Serialize;

use super::row::{RowFigures, Sampled};
use crate::cli::args::Group;
use crate::pose_errors::ErrorSamples;

/// Share of the reference's path that a run has to cover; otherwise it counts as failed.
const FOLLOWED: f64 = 0.9;

/// A run of a group: its name, and its result.
pub struct Run<'a> {
    pub name: &'a str,
    pub found: Option<Found<'a>>,
}

/// Figures, and the samples that they were computed from.
pub type Found<'a> = (&'a RowFigures, &'a Sampled);

impl<'a> Run<'a> {
    pub fn sampled(&self) -> Option<&'a Sampled> {
        self.found.map(|(_, sampled)| sampled)
    }

    fn has_failed(&self) -> bool {
        self.found.is_none_or(|(figures, _)| figures.diverged || figures.coverage.path < FOLLOWED)
    }
}

/// Summary of a group.
#[derive(Serialize)]
pub struct GroupFigures {
    pub name: String,
    pub runs: usize,
    /// Runs that could not be evaluated, ended lost or left out more than a tenth of the path.
    pub failed: usize,
    pub failed_ci95: Interval,
    /// Among these: without figures, and ended lost.
    pub without_figures: usize,
    pub diverged: usize,
    /// Times that a robot was lost within a run, and times that it was found again.
    pub lost: usize,
    pub recovered: usize,
    /// Means over runs; a run without figures covers nothing.
    pub coverage_time: f64,
    pub coverage_path: f64,
    /// Mean over runs of the share of time in which the robot was lost or missing.
    pub lost_share: f64,
    /// Null without headings, or without any run that has figures.
    pub weighted: Option<GroupError>,
    pub translation: Option<GroupError>,
    pub heading: Option<GroupError>,
    /// The same for the runs that did not fail: reported, never tested.
    pub of_others: SuccessfulRuns,
    /// Share of poses inside the 95 % ellipsoid, over the runs whose estimates carry covariances.
    pub inside_95: Option<f64>,
}

#[derive(Serialize, Default)]
pub struct SuccessfulRuns {
    pub weighted: Option<GroupError>,
    pub translation: Option<GroupError>,
    pub heading: Option<GroupError>,
}

/// The mean of the runs' means, with its 95 % interval (null for a single run); the other figures are over
/// all poses of all runs.
#[derive(Serialize, Clone, Copy)]
pub struct GroupError {
    pub mean: f64,
    pub ci95: Option<Interval>,
    pub median: f64,
    pub rmse: f64,
    pub max: f64,
}

/// A comparison of two groups by one measure.
#[derive(Serialize)]
pub struct Comparison {
    pub a: String,
    pub b: String,
    /// `weighted`, `translation` (m), `heading` (rad): means of runs; `failed`: shares of runs.
    pub measure: &'static str,
    /// The compared value of either group.
    pub of_a: f64,
    pub of_b: f64,
    /// `of_a` minus `of_b`, its 95 % interval, and the test's p; null where it could not be tested.
    pub difference: f64,
    pub ci95: Option<Interval>,
    pub p: Option<f64>,
    /// Adjusted for all tests of this call (Holm).
    pub p_holm: Option<f64>,
    pub test: &'static str,
    /// Runs of either group, or pairs.
    pub runs: [usize; 2],
    /// Why there is no p value.
    pub remark: Option<&'static str>,
}

/// The files of the runs of a group, in order of their names.
///
/// # Errors
/// When the pattern is invalid, or matches no file, and for a folder of other files.
pub fn files(group: &Group) -> Result<Vec<String>> {
    let Group { name, runs } = group;
    let path = Path::new(runs);
    let found: Vec<PathBuf> = if path.join(RUN_SUMMARY).is_file() {
        let is_run = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            name.starts_with("run-") && name.ends_with(".tum")
        };
        let entries = path.read_dir().with_context(|| format!("cannot read {runs}"))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.retain(is_run);
        files.sort();
        files
    } else if path.is_dir() && !is_bag_folder(path) {
        bail!(
            "--group {name}: {runs} is neither a bag nor a folder that `localize` wrote; name the files in it \
             by a pattern, such as '{}'",
            path.join("*.tum").display()
        );
    } else if path.exists() {
        vec![path.to_owned()]
    } else {
        let paths = glob::glob(runs).with_context(|| format!("--group {name}: {runs:?}"))?;
        paths.collect::<Result<_, _>>().with_context(|| format!("--group {name}"))?
    };
    if found.is_empty() {
        bail!("--group {name}: no file matches {runs:?}");
    }
    let text = |path: &PathBuf| {
        path.to_str().map(str::to_owned).with_context(|| format!("{}: not UTF-8", path.display()))
    };
    found.iter().map(text).collect()
}

/// The name of a run: that of its file, without the ending.
pub fn run_name(file: &str) -> &str {
    let name = Path::new(file).file_name().and_then(|name| name.to_str()).unwrap_or(file);
    name.split_once('.').map_or(name, |(stem, _)| stem)
}

type Samples = fn(&ErrorSamples) -> &[f64];

/// The measures of errors: name, whether they need headings, samples.
const MEASURES: [(&str, bool, Samples); 3] = [
    ("weighted", true, |samples| &samples.weighted),
    ("translation", false, |samples| &samples.translation),
    ("heading", true, |samples| &samples.heading),
];

impl GroupFigures {
    /// Summarizes the runs of a group, at least one.
    pub fn of(name: &str, runs: &[Run<'_>]) -> Result<Self> {
        let sampled: Vec<&Sampled> = runs.iter().filter_map(Run::sampled).collect();
        let others = runs.iter().filter(|run| !run.has_failed());
        let others: Vec<&Sampled> = others.filter_map(Run::sampled).collect();
        let figures: Vec<&RowFigures> =
            runs.iter().filter_map(|run| run.found.map(|(figures, _)| figures)).collect();
        let failed = runs.iter().filter(|run| run.has_failed()).count();
        let mean = |of: fn(&RowFigures) -> f64, missing: f64| {
            let of = |run: &Run<'_>| run.found.map_or(missing, |(figures, _)| of(figures));
            runs.iter().map(of).sum::<f64>() / runs.len() as f64
        };
        let sum = |of: fn(&RowFigures) -> usize| figures.iter().map(|run| of(run)).sum();
        let [weighted, translation, heading] = over_runs(&sampled)?;
        let of_others = over_runs(&others)?;
        let inside: Vec<f64> = figures
            .iter()
            .filter_map(|run| run.consistency.as_ref())
            .map(|consistency| consistency.inside_95)
            .collect();
        Ok(GroupFigures {
            name: name.to_owned(),
            runs: runs.len(),
            failed,
            failed_ci95: Rate::new(failed, runs.len())?.interval(0.95)?,
            without_figures: runs.len() - figures.len(),
            diverged: sum(|run| usize::from(run.diverged)),
            lost: sum(|run| run.lost),
            recovered: sum(|run| run.recovered),
            coverage_time: mean(|run| run.coverage.time, 0.0),
            coverage_path: mean(|run| run.coverage.path, 0.0),
            lost_share: mean(|run| run.with_missing.lost_share, 1.0),
            weighted,
            translation,
            heading,
            of_others: {
                let [weighted, translation, heading] = of_others;
                SuccessfulRuns { weighted, translation, heading }
            },
            inside_95: Summary::of(&inside).ok().map(|summary| summary.mean),
        })
    }
}

/// Errors over all runs, in the order of [`MEASURES`].
fn over_runs(runs: &[&Sampled]) -> Result<[Option<GroupError>; 3]> {
    let has_headings = runs.iter().all(|run| run.has_headings);
    let mut all = [None; 3];
    for (error, (_, needs_headings, samples)) in all.iter_mut().zip(MEASURES) {
        if runs.is_empty() || needs_headings && !has_headings {
            continue;
        }
        let of_runs: Vec<&[f64]> = runs.iter().map(|run| samples(&run.samples)).collect();
        let Summary { median, rmse, max, .. } = Summary::pooled(&of_runs)?;
        let means: Vec<f64> = of_runs
            .iter()
            .map(|samples| Summary::of(samples).map(|summary| summary.mean))
            .collect::<Result<_, _>>()?;
        let mean = Summary::of(&means)?.mean;
        let ci95 = mean_interval(&means).ok().map(|found| found.interval);
        *error = Some(GroupError { mean, ci95, median, rmse, max });
    }
    Ok(all)
}

/// Every pair of groups by every measure.
pub fn comparisons(groups: &[(&str, Vec<Run<'_>>)]) -> Result<Vec<Comparison>> {
    let mut all = Vec::new();
    for (place, a) in groups.iter().enumerate() {
        for b in &groups[place + 1..] {
            let mut sampled = a.1.iter().chain(&b.1).filter_map(Run::sampled);
            let has_headings = sampled.all(|sampled| sampled.has_headings);
            for (measure, needs_headings, samples) in MEASURES {
                if has_headings || !needs_headings {
                    all.extend(of_errors(a, b, measure, samples)?);
                }
            }
            all.push(of_failures(a, b)?);
        }
    }
    let p_values: Vec<f64> = all.iter().map(|tested| tested.p.unwrap_or(f64::NAN)).collect();
    for (tested, adjusted) in all.iter_mut().zip(holm(&p_values)) {
        tested.p_holm = tested.p.map(|_| adjusted);
    }
    Ok(all)
}

/// Means of runs; `None` where a group has none.
fn of_errors(
    (name_a, a): &(&str, Vec<Run<'_>>),
    (name_b, b): &(&str, Vec<Run<'_>>),
    measure: &'static str,
    samples: Samples,
) -> Result<Option<Comparison>> {
    // The same name is the same block in both groups.
    let names: BTreeMap<&str, u64> = a.iter().chain(b).map(|run| run.name).zip(0..).collect();
    let means = |runs: &[Run<'_>]| -> Result<Option<Blocked>> {
        let mut values = Vec::new();
        for run in runs {
            let Some(sampled) = run.sampled() else { continue };
            values.push((names[run.name], Summary::of(samples(&sampled.samples))?.mean));
        }
        Ok(if values.is_empty() { None } else { Some(Blocked::new(values)?) })
    };
    let (Some(of_a), Some(of_b)) = (means(a)?, means(b)?) else { return Ok(None) };
    let in_both = a.iter().filter(|run| b.iter().any(|other| other.name == run.name)).count();
    let are_paired = in_both == a.len() && in_both == b.len();
    let (test, effect) = match are_paired {
        true => ("paired t over runs", paired(&of_a, &of_b)),
        false => ("Welch's t over runs", two_sample(&of_a, &of_b)),
    };
    let effect: Option<Effect> = effect.ok();
    let is_whole = a.iter().chain(b).all(|run| run.found.is_some());
    let remark = match (&effect, is_whole) {
        (None, _) => Some("too few runs"),
        (_, false) => Some("runs without figures are missing, so it is not tested"),
        _ => None,
    };
    let (mean_a, mean_b) = (of_a.mean_of_blocks(), of_b.mean_of_blocks());
    Ok(Some(Comparison {
        a: (*name_a).to_owned(),
        b: (*name_b).to_owned(),
        measure,
        of_a: mean_a,
        of_b: mean_b,
        difference: effect.as_ref().map_or(mean_a - mean_b, |effect| effect.mean_difference),
        ci95: effect.as_ref().map(|effect| effect.interval),
        p: effect.as_ref().filter(|_| is_whole).map(|effect| effect.p_two_sided),
        p_holm: None,
        test,
        runs: effect.as_ref().map_or([of_a.blocks(), of_b.blocks()], |effect| effect.blocks),
        remark,
    }))
}

fn of_failures(
    (name_a, a): &(&str, Vec<Run<'_>>),
    (name_b, b): &(&str, Vec<Run<'_>>),
) -> Result<Comparison> {
    let rate = |runs: &[Run<'_>]| {
        Rate::new(runs.iter().filter(|run| run.has_failed()).count(), runs.len())
    };
    let (of_a, of_b) = (rate(a)?, rate(b)?);
    let difference = rate_difference(of_a, of_b);
    let share = |rate: Rate| rate.hits() as f64 / rate.trials() as f64;
    Ok(Comparison {
        a: (*name_a).to_owned(),
        b: (*name_b).to_owned(),
        measure: "failed",
        of_a: share(of_a),
        of_b: share(of_b),
        difference: difference.mean,
        ci95: Some(difference.interval),
        p: Some(fisher_exact(of_a, of_b)),
        p_holm: None,
        test: "Fisher's exact",
        runs: [a.len(), b.len()],
        remark: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_named_by_their_files() {
        for (file, name) in [
            ("runs/nav2/run-07.bag", "run-07"),
            ("run-07.tum", "run-07"),
            ("runs/run-07.mcap.zst", "run-07"),
            ("runs/run-07", "run-07"),
        ] {
            assert_eq!(run_name(file), name);
        }
    }
}
