//! `evaluate`: errors of estimated trajectories against a reference.

mod figure;
mod frames;
mod group;
mod mounts;
mod row;
mod source;
mod table;
mod text;

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, anyhow};
use mcl_core::text::{as_cell, printable};
use mcl_figures::check_figure_ending;
use mcl_metrics::WeightedPoseError;
use serde::Serialize;

use super::Outcome;
use super::args::{EvaluateArgs, Global};
use super::output::{input_files, prepare, print, refuse, write_rows};
use crate::progress::{error_message, tell};
use figure::DrawnGroup;
use group::{Comparison, GroupFigures, Run, run_name};
use row::{ErrorRow, Evaluated, Row, Sampled};
use source::{TrajectoryInput, TrajectorySource};

#[derive(Serialize)]
struct Evaluation<'a> {
    /// The reference of the errors, and whose poses it has; where there are several, all of them.
    reference: String,
    estimates: Vec<&'a Row>,
    /// Groups of runs, and their comparisons; empty without groups.
    groups: Vec<GroupFigures>,
    comparisons: Vec<Comparison>,
}

/// An estimate to be evaluated.
struct Job {
    of: TrajectorySource,
    /// The index of its group.
    group: Option<usize>,
}

/// The result for an estimate.
struct JobResult {
    row: Row,
    /// The samples that the row's figures were computed from.
    sampled: Option<Sampled>,
}

impl JobResult {
    fn as_run(&self) -> Run<'_> {
        let found = self.row.figures.as_ref().zip(self.sampled.as_ref());
        Run { name: run_name(&self.row.of.file), found }
    }
}

/// The references of a call: a single one, or one for each estimate.
struct References<'a> {
    args: &'a EvaluateArgs,
    global: &'a Global,
    read: BTreeMap<String, TrajectoryInput>,
}

impl References<'_> {
    /// The reference for an estimate.
    fn of(&mut self, estimate: &str) -> Result<&TrajectoryInput> {
        let name =
            self.args.reference.replace("{run}", run_name(estimate)).replace("{file}", estimate);
        if !self.read.contains_key(&name) {
            let source = source::reference(&name, self.args, self.global)?;
            self.read.insert(name.clone(), source);
        }
        self.read.get(&name).with_context(|| format!("{name}: no reference"))
    }
}

pub fn run(args: &EvaluateArgs, global: &Global) -> Result<Outcome> {
    let metric = WeightedPoseError::new(args.xi)?;
    if let Some(path) = &args.plot {
        check_figure_ending(path)?;
    }
    if let Some(path) = &args.table {
        table::kind_of(path)?;
    }
    let jobs = jobs(args)?;
    let mut references = References { args, global, read: BTreeMap::new() };
    let read = jobs.iter().map(|job| job.of.file.as_str()).chain([args.reference.as_str()]);
    prepare(args.errors.iter().chain(&args.plot).chain(&args.table), &input_files(read))?;

    let is_only = jobs.len() == 1;
    let mut is_complete = true;
    let mut all: Vec<JobResult> = Vec::new();
    for job in jobs {
        let reference = match references.of(&job.of.file) {
            // Without the common reference nothing can be evaluated.
            Err(error) if !args.reference.contains('{') => return Err(error),
            reference => reference.with_context(|| format!("{}: its reference", job.of.label())),
        };
        let mut of = job.of;
        let found = reference.and_then(|reference| {
            let topic = of.topic.as_deref();
            let source = source::estimate(&of.file, topic, reference, args, global)?;
            of = source.of.clone();
            row::evaluate(reference, &source, &metric, args, global.quiet)
                .with_context(|| format!("{} against {}", of.label(), reference.of.label()))
        });
        let group = job.group.map(|place| args.groups[place].name.clone());
        is_complete &= found.as_ref().is_ok_and(|found| found.is_complete);
        all.push(match found {
            Ok(Evaluated { figures, sampled, .. }) => {
                let row = Row { of, group, failure: None, figures: Some(figures) };
                JobResult { row, sampled: Some(sampled) }
            }
            Err(error) if is_only => return Err(error),
            Err(error) => {
                let failure = error_message(&error);
                tell!("warning: no figures: {}", printable(&failure));
                let row = Row { of, group, failure: Some(failure), figures: None };
                JobResult { row, sampled: None }
            }
        });
    }
    put_out(args, &references, &all)?;
    if all.iter().all(|done| done.sampled.is_none()) {
        return Err(anyhow!("none of {} estimates could be evaluated", all.len()));
    }
    Ok(Outcome::of(is_complete))
}

/// The estimates, then the runs of the groups; for a bag a row for each requested topic.
fn jobs(args: &EvaluateArgs) -> Result<Vec<Job>> {
    let mut jobs = Vec::new();
    let mut add = |file: String, group: Option<usize>| {
        let job = |topic: Option<&String>| Job {
            of: TrajectorySource { file: file.clone(), topic: topic.cloned() },
            group,
        };
        if args.topics.is_empty() || !source::has_topics(&file) {
            jobs.push(job(None));
        } else {
            jobs.extend(args.topics.iter().map(|topic| job(Some(topic))));
        }
    };
    args.estimates.iter().for_each(|file| add(file.clone(), None));
    for (place, group) in args.groups.iter().enumerate() {
        if args.groups[..place].iter().any(|other| other.name == group.name) {
            return refuse(&format!("--group {}: the name is given twice", group.name));
        }
        group::files(group)?.into_iter().for_each(|file| add(file, Some(place)));
    }
    if !args.topics.is_empty() && jobs.iter().all(|job| job.of.topic.is_none()) {
        return refuse("--topic applies to bags only, and none of the estimates is a bag");
    }
    if args.topics.len() > 1 && !args.groups.is_empty() {
        return refuse("--group takes one --topic: a run of a group is one trajectory");
    }
    Ok(jobs)
}

/// Writes and prints the results.
fn put_out(args: &EvaluateArgs, references: &References<'_>, all: &[JobResult]) -> Result<()> {
    let rows: Vec<&Row> = all.iter().map(|done| &done.row).collect();
    let groups: Vec<(&str, Vec<Run<'_>>)> = args
        .groups
        .iter()
        .map(|group| {
            let of_group = all.iter().filter(|done| done.row.group.as_ref() == Some(&group.name));
            let mut runs: Vec<Run<'_>> = of_group.clone().map(JobResult::as_run).collect();
            let names: BTreeSet<&str> = runs.iter().map(|run| run.name).collect();
            if names.len() < runs.len() {
                // It is not known which runs of two groups belong together.
                runs.iter_mut().zip(of_group).for_each(|(run, done)| run.name = &done.row.of.file);
            }
            (group.name.as_str(), runs)
        })
        .collect();
    let of_groups = groups
        .iter()
        .map(|(name, runs)| GroupFigures::of(name, runs))
        .collect::<Result<Vec<_>>>()?;
    let comparisons = group::comparisons(&groups)?;
    let mut tables = vec![text::of_estimates(&rows)];
    if !groups.is_empty() {
        tables.push(text::of_groups(&of_groups));
    }
    if !comparisons.is_empty() {
        tables.push(text::of_comparisons(&comparisons));
    }
    if let Some(path) = &args.table {
        table::write(path, &tables, &rows)?;
    }
    if let Some(path) = &args.errors {
        let labels: Vec<String> =
            rows.iter().map(|row| as_cell(&row.of.label()).into_owned()).collect();
        let pairs: Vec<ErrorRow<'_>> = all
            .iter()
            .zip(&labels)
            .flat_map(|(done, label)| done.sampled.iter().flat_map(|sampled| sampled.rows(label)))
            .collect();
        write_rows(path, &pairs)?;
    }
    let reference = described(references);
    if let Some(path) = &args.plot
        && all.iter().any(|done| done.sampled.is_some())
    {
        let of_none = all.iter().filter(|done| done.row.group.is_none());
        let drawn: Vec<(String, &Sampled)> = of_none
            .filter_map(|done| Some((done.row.of.label(), done.sampled.as_ref()?)))
            .collect();
        let groups: Vec<DrawnGroup<'_>> = groups
            .iter()
            .map(|(name, runs)| DrawnGroup {
                name,
                runs: runs.iter().filter_map(Run::sampled).collect(),
                asked: runs.len(),
            })
            .collect();
        figure::draw(path, &args.reference, &drawn, &groups)?;
    }
    let found = Evaluation { reference, estimates: rows, groups: of_groups, comparisons };
    print(args.json, &found, |found| {
        let text = text::text(&found.estimates, &tables);
        format!("{}\nreference: {}", text.trim_end(), found.reference)
    })
}

/// A description of the reference.
fn described(references: &References<'_>) -> String {
    let mut read = references.read.values();
    match (read.next(), read.next()) {
        (Some(only), None) => only.describe(),
        _ => format!("{}, {} of them", references.args.reference, references.read.len()),
    }
}
