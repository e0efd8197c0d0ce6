use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_datasets::registry::{Registry, Source, is_plain_name};
use serde::Serialize;

use super::Outcome;
use super::args::{Global, RunArgs};
use super::output::{print, tell_data_losses, told_once};
use crate::experiment::{Experiment, RankedSetting, TrialOutcome, pause_saving};
use crate::progress::tell;
use crate::results::{self, RunOptions};
use mcl_study::data::source::{DataSource, SourceOptions};

#[derive(Serialize)]
struct Ran {
    trials: usize,
    done: usize,
    failed: usize,
    /// Where the results of each data set are.
    folders: Vec<PathBuf>,
    /// Data sets that the experiment could not be run on.
    lost: Vec<Lost>,
}

#[derive(Serialize)]
struct Lost {
    dataset: String,
    reason: String,
}

/// Exit code of a program that Ctrl-C ended: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

pub fn run(args: &RunArgs, global: &Global) -> Result<Outcome> {
    end_on_interrupt(&args.output)?;
    let experiment = Experiment::read(&args.experiment)?;
    let name = experiment_name(&args.experiment)?;
    let names = match args.datasets.is_empty() {
        false => args.datasets.clone(),
        true => at_hand(&experiment, global)?,
    };
    let options = SourceOptions {
        max_range: args.max_range,
        topics: args.topics.choice(),
        cloud_topic: args.cloud.cloud_topic.clone(),
        dimensions: args.cloud.dimensions.map(usize::from),
        ..SourceOptions::default()
    };
    let mut total = TrialOutcome { done: 0, failed: 0 };
    let mut complete = true;
    let mut folders: Vec<PathBuf> = Vec::new();
    let mut lost = Vec::new();
    for dataset in &names {
        let source = DataSource::open(dataset, &options, false)?;
        complete &= tell_data_losses(dataset, &source) == Outcome::Done;
        let folder = args.output.join(&name).join(source.name());
        if folders.contains(&folder) {
            bail!("{dataset}: the results of another log of this name are in {}", folder.display());
        }
        let run = RunOptions { fresh: args.fresh, quiet: global.quiet };
        let outcome = results::run_experiment(&experiment, &name, &source, &folder, &run)
            .with_context(|| format!("experiment {name} on {dataset}"));
        match outcome {
            Ok(outcome) => {
                total.done += outcome.done;
                total.failed += outcome.failed;
                folders.push(folder);
            }
            // What cannot be written for one data set cannot be written for the others.
            Err(error) if names.len() == 1 || is_of_files(&error) => return Err(error),
            Err(error) => {
                let reason = told_once(&error);
                tell!("error: {reason}; going on with the other data sets");
                lost.push(Lost { dataset: dataset.clone(), reason });
            }
        }
    }
    if folders.is_empty() {
        bail!("experiment {name} has results on none of {} data sets", names.len());
    }
    if let Experiment::Sensitivity(definition) = &experiment
        && let Some(ranking) = results::write_ranking(definition, &args.output.join(&name))?
        && !global.quiet
    {
        tell!("settings ranked over {}: {}", ranking.datasets.join(", "), ranking.path.display());
        for (sweep, rank) in ranking.best {
            tell!("{}", describe_best(&sweep, &rank));
        }
    }
    complete &= total.failed == 0 && lost.is_empty();
    let TrialOutcome { done, failed } = total;
    let ran = Ran { trials: done + failed, done, failed, folders, lost };
    print(args.json, &ran, |ran| {
        let mut text = format!("{} trials done, {} failed", ran.done, ran.failed);
        for Lost { dataset, .. } in &ran.lost {
            text += &format!("\n{dataset}: lost, see above");
        }
        for folder in &ran.folders {
            text += &format!("\n{}", folder.display());
        }
        text
    })?;
    Ok(Outcome::of(complete))
}

/// Whether files could not be read or written.
fn is_of_files(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<std::io::Error>())
}

/// Ends the program on Ctrl-C, but not in the middle of a row.
fn end_on_interrupt(output: &Path) -> Result<()> {
    let output = output.display().to_string();
    ctrlc::set_handler(move || {
        let _saving = pause_saving();
        tell!(
            "\ninterrupted: the rows of all finished trials are safe below {output}; the same command \
             goes on from there"
        );
        std::process::exit(INTERRUPTED);
    })
    .context("cannot listen to Ctrl-C")
}

/// "tracking: best with σ_hit 0.3 m, z_rand 0.1, …: mean weighted error 0.0273 (0 of 12 runs diverged)".
fn describe_best(sweep: &str, rank: &RankedSetting) -> String {
    let setting = rank.setting;
    let [a1, a2, a3, a4] = setting.alpha();
    format!(
        "{sweep}: best with σ_hit {} m, z_rand {}, α {a1}, {a2}, {a3}, {a4}, exponent {}, {} proposal, noise \
         {} m and {} rad: mean weighted error {:.4} ({} of {} runs diverged)",
        setting.sigma_hit,
        setting.z_rand,
        setting.likelihood_exponent,
        setting.proposal,
        setting.noise_xy,
        setting.noise_theta,
        rank.score,
        rank.diverged,
        rank.runs
    )
}

/// The data sets of the definition that are at hand; says how to get the others.
fn at_hand(experiment: &Experiment, global: &Global) -> Result<Vec<String>> {
    let registry = Registry::from_environment()?;
    let mut names = Vec::new();
    for name in experiment.dataset_names() {
        let dataset = registry.get(name)?;
        let present = matches!(dataset.source, Source::Simulated { .. });
        match registry.locate(dataset) {
            Err(error) if !present => {
                if !global.quiet {
                    tell!("leaving out {name}: {error}");
                }
            }
            _ => names.push(name.to_owned()),
        }
    }
    if names.is_empty() {
        bail!("none of the experiment's data sets is at hand; `mcl-eval datasets fetch` gets them");
    }
    Ok(names)
}

/// The experiment's name: that of its file, without the ending.
fn experiment_name(path: &Path) -> Result<String> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if !is_plain_name(&stem) {
        bail!(
            "{}: results are kept under the file's name, which is no name of a folder",
            path.display()
        );
    }
    Ok(stem)
}
