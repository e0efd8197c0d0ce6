use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::files::hold;
use mcl_core::text::{self, counted, printable};
use mcl_datasets::registry::{Origin, Registry, is_plain_name};
use mcl_study::data::facts::DataFacts;
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::{DataSource, name_of};
use mcl_study::localizer::process;
use mcl_study::localizer::program::commands;
use mcl_study::measure::program::ENDED;
use mcl_study::recipe::localizer::LOCALIZER;
use mcl_study::run::{Event, RunResult, run_study};
use mcl_study::share::Share;
use mcl_study::store::identity::{Build, Identity};
use mcl_study::store::parts::{FailedTrial, Parts};
use mcl_study::store::results::{FAILURES, Results};
use mcl_study::study::definition::Study;
use mcl_study::trial::cost::Costs;
use mcl_study::trial::division::StudyData;
use mcl_study::trial::tracking::bridge;
use serde::Serialize;

use super::Outcome;
use super::args::{Global, RunArgs, StudyArgs};
use super::output::{print, reference_of, report_bridged, report_data_losses};
use crate::figures;
use crate::progress::{StudyProgress, error_message, span, tell};
use crate::report::text::argument;
use crate::studies;

#[derive(Default, Serialize)]
struct Totals {
    trials: usize,
    done: usize,
    failed: usize,
    /// Runs of programs that ended abnormally; their rows have the reasons.
    failed_runs: usize,
    /// Where the results of each data set are.
    folders: Vec<String>,
    /// Data sets on which the study could not be run.
    lost: Vec<LostDataset>,
}

#[derive(Serialize)]
struct LostDataset {
    dataset: String,
    reason: String,
}

/// A trial that would be run.
#[derive(Serialize)]
struct ListedTrial {
    dataset: String,
    trial: String,
    runs: usize,
    is_done: bool,
    /// Estimated processor time.
    seconds: f64,
}

/// Exit code of a program ended by Ctrl-C: 128 + SIGINT.
const INTERRUPTED: i32 = 130;

/// Runs a study, summarizes its rows and draws its figures.
pub fn run(args: &RunArgs, global: &Global) -> Result<Outcome> {
    let (study, name, names) = read_study(&args.of, global)?;
    if args.list {
        return list(args, &study, &name, &names);
    }
    let share = share(args)?;
    let called: Vec<String> = names.iter().map(|name| name_of(name)).collect();
    if let Some((at, name)) =
        called.iter().enumerate().find(|(at, name)| called[..*at].contains(name))
    {
        bail!(
            "{}: {name} is listed twice; results are stored under the name, so each data set needs its own",
            names[at]
        );
    }
    if share != Share::Merge {
        list_programs(&study);
    }
    end_on_interrupt(&args.of.output)?;
    let mut complete = true;
    let mut totals = Totals::default();
    let mut all: Vec<Results> = Vec::new();
    for dataset in &names {
        let source = open(&args.of, &study, dataset)?;
        if let (DataSource::Log(log), false) = (&source, global.quiet) {
            tell!("note: {}: reference: {}", printable(dataset), reference_of(log));
        }
        complete &= report_data_losses(dataset, &source) == Outcome::Done;
        if let DataSource::Log(log) = &source
            && !study.measures.of_runs.is_empty()
            && let Ok(bridged) = bridge(log)
        {
            complete &= report_bridged(dataset, &bridged) == Outcome::Done;
        }
        let folder = args.of.output.join(&name).join(source.name());
        let ran = run_on(&study, &name, source, &folder, share, global)
            .with_context(|| format!("study {name} on {dataset}"));
        match ran {
            Ok(RunResult { results, asked, done, failed }) => {
                totals.trials += asked;
                totals.done += done;
                totals.failed += failed.len();
                complete &= done == asked;
                totals.failed_runs += results.as_ref().map_or(0, report_failed_runs);
                totals.folders.push(folder.display().to_string());
                all.extend(results);
            }
            // A file that cannot be written for one data set cannot be written for the others.
            Err(error) if names.len() == 1 || is_of_files(&error) => return Err(error),
            Err(error) => {
                let reason = error_message(&error);
                tell!("error: {}; continuing with the other data sets", printable(&reason));
                totals.lost.push(LostDataset { dataset: dataset.clone(), reason });
            }
        }
    }
    if totals.folders.is_empty() {
        bail!("study {name} has results on none of {} data sets", names.len());
    }
    let is_part = matches!(share, Share::Part(_));
    if !is_part
        && let Some(path) = figures::write_ranking(&args.of.output.join(&name), &all)?
        && !global.quiet
    {
        tell!("settings ranked over the data sets: {}", path.display());
    }
    complete &= totals.failed == 0 && totals.lost.is_empty();
    print(args.json, &totals, |totals| {
        let mut text = format!("{} done, {} failed", counted(totals.done, "trial"), totals.failed);
        if totals.failed_runs > 0 {
            text += &format!("; {} of programs failed", counted(totals.failed_runs, "run"));
        }
        for LostDataset { dataset, .. } in &totals.lost {
            text += &format!("\n{}: lost, see above", printable(dataset));
        }
        for folder in &totals.folders {
            text += &format!("\n{}", printable(folder));
        }
        text
    })?;
    if !is_part && !global.quiet {
        let root = argument(&args.of.output.to_string_lossy());
        tell!("next: `mcl-eval report {} -o report.html` shows them on a page", printable(&root));
    }
    Ok(Outcome::of(complete))
}

/// Opens a data set or log as a study lists it.
pub fn open(args: &StudyArgs, study: &Study, dataset: &str) -> Result<DataSource> {
    let StudyArgs { read, cloud, max_range, .. } = args;
    let options = SourceOptions {
        cloud_topic: cloud.cloud_topic.clone(),
        dimensions: cloud.dimensions.map(usize::from),
        ..read.options(*max_range)
    };
    let source = DataSource::open(dataset, &options, false)?;
    let scans = study.listed(source.name()).and_then(|listed| listed.scans);
    Ok(match (scans, source) {
        (Some(scans), DataSource::Log(log)) => DataSource::Log(log.first_scans(scans)),
        (_, source) => source,
    })
}

/// Runs the study on one data set, with a progress bar.
fn run_on(
    study: &Study,
    name: &str,
    source: DataSource,
    folder: &Path,
    share: Share,
    global: &Global,
) -> Result<RunResult> {
    let dataset = printable(source.name()).into_owned();
    let data = StudyData::new(source);
    let progress = StudyProgress::new(&dataset, global.quiet);
    let mut reasons: Vec<String> = Vec::new();
    let ran = run_study(study, name, &data, folder, share, |event| match event {
        Event::Started { done, asked, damage } => {
            for damage in damage {
                progress.print(format_args!("warning: {}", printable(damage)));
            }
            if done > 0 && !global.quiet {
                let of = match share {
                    Share::Part(part) => format!(" of {part}"),
                    Share::Whole { .. } | Share::Merge => String::new(),
                };
                progress.print(format_args!(
                    "{dataset}: {done} of {asked} trials{of} are there already"
                ));
            }
        }
        Event::Begins { trials, threads, expected } => {
            progress.begin(trials, expected);
            if !global.quiet {
                let (trials, threads) = (counted(trials, "trial"), counted(threads, "thread"));
                let span = span(expected.as_secs_f64());
                progress.print(format_args!(
                    "{dataset}: {trials} of {} on {threads}, about {span}",
                    printable(name)
                ));
            }
        }
        Event::Ended { ended: (ended, all), share, left, failed } => {
            progress.set(ended, all, share, left);
            // Often all fail for the same reason, which is reported once.
            if let Some(failed) = failed
                && !reasons.contains(&failed.reason)
            {
                let (trial, reason) = (printable(&failed.trial), printable(&failed.reason));
                progress.print(format_args!("{dataset}: trial {trial} failed: {reason}"));
                reasons.push(failed.reason.clone());
            }
        }
    });
    drop(progress);
    let ran = ran?;
    // Figures need memory, too, and are drawn from files.
    drop(data);
    let Some(results) = &ran.results else { return Ok(ran) };
    if !results.is_complete() {
        let Results { done, asked, .. } = results;
        let others = match share {
            Share::Merge => format!("missing: {}", missing(results, &ran.failed)),
            Share::Whole { .. } | Share::Part(_) => {
                "the same command runs the missing ones".to_owned()
            }
        };
        tell!("{dataset}: {done} of {asked} trials have rows; {others}");
    }
    figures::write(results)?;
    Ok(ran)
}

/// The trials without rows, each with the reason if known.
fn missing(results: &Results, failed: &[FailedTrial]) -> String {
    const MOST: usize = 10;
    let described = |name: &String| match failed.iter().find(|failed| failed.trial == *name) {
        Some(failed) => format!("{name} (failed: {})", printable(&failed.reason)),
        None => name.clone(),
    };
    let names: Vec<String> = results.without_rows.iter().take(MOST).map(described).collect();
    let others = match results.without_rows.len().saturating_sub(MOST) {
        0 => String::new(),
        others => format!(" and {others} others"),
    };
    format!("{}{others}; run parts again, and merge", names.join(", "))
}

/// The share of the trials that this process runs.
fn share(args: &RunArgs) -> Result<Share> {
    let variable = |name: &str| std::env::var(name).ok();
    Ok(match &args.part {
        Some(part) => Share::Part(part.part(variable).map_err(anyhow::Error::msg)?),
        None if args.merge => Share::Merge,
        None => Share::Whole { fresh: args.fresh },
    })
}

/// The trials that would be run, and their estimated cost, which is not known for external programs.
fn list(args: &RunArgs, study: &Study, name: &str, datasets: &[String]) -> Result<Outcome> {
    let mut listed = Vec::new();
    let mut measured = false;
    for dataset in datasets {
        let source = open(&args.of, study, dataset)?;
        let identity = Identity { build: Build::this(), data: DataFacts::of(&source)? };
        let plan = study.plan(&identity.data.name)?;
        let folder = args.of.output.join(name).join(&identity.data.name);
        let parts = match args.fresh {
            true => Parts::default(),
            false => Parts::read(&folder, &identity)?,
        };
        let costs = Costs::measured(&identity.data, &study.measures, &plan.trials, &parts);
        measured |= costs.are_measured();
        for trial in &plan.trials {
            let identities = trial.identities(&study.measures)?;
            listed.push(ListedTrial {
                dataset: identity.data.name.clone(),
                trial: trial.to_string(),
                runs: trial.runs.len(),
                is_done: identities.iter().all(|identity| parts.has(identity)),
                seconds: costs.of(trial),
            });
        }
    }
    print(args.json, &listed, |listed| {
        let mut text = String::new();
        for ListedTrial { dataset, trial, runs, is_done, seconds } in listed {
            let state = if *is_done { "done" } else { &format!("{seconds:.2} s") };
            let runs = if *runs == 0 { String::new() } else { format!(", runs: {runs}") };
            text += &format!("{}: {trial}{runs}: {state}\n", printable(dataset));
        }
        let pending = || listed.iter().filter(|trial| !trial.is_done);
        if pending().count() == 0 {
            return text + &format!("{}, all of them done", counted(listed.len(), "trial"));
        }
        let seconds: f64 = pending().map(|trial| trial.seconds).sum();
        text += &format!(
            "{} trials, {} to be run: about {:.1} minutes of processor time, {}",
            listed.len(),
            pending().count(),
            seconds / 60.0,
            if measured { "from the times of finished trials" } else { "from built-in costs" }
        );
        text
    })?;
    Ok(Outcome::Done)
}

/// Whether files could not be read or written.
fn is_of_files(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<std::io::Error>())
}

/// Ends the program on Ctrl-C or SIGTERM, along with the programs that it runs, but not while a file is
/// written.
fn end_on_interrupt(output: &Path) -> Result<()> {
    let output = output.display().to_string();
    let end = move |code: i32| {
        process::end_all();
        let _held = hold();
        tell!(
            "\ninterrupted: the rows of all finished trials are safe below {output}; the same command \
             continues from there"
        );
        std::process::exit(code);
    };
    #[cfg(unix)]
    end_on_termination(end.clone())?;
    ctrlc::set_handler(move || end(INTERRUPTED)).context("cannot listen to Ctrl-C")
}

/// The same on SIGTERM, which would leave programs running.
#[cfg(unix)]
fn end_on_termination(end: impl Fn(i32) + Send + 'static) -> Result<()> {
    use signal_hook::{consts::SIGTERM, iterator::Signals};
    let mut signals = Signals::new([SIGTERM]).context("cannot listen to SIGTERM")?;
    let listen = move || signals.forever().for_each(|signal| end(128 + signal));
    std::thread::Builder::new().spawn(listen).context("cannot listen to SIGTERM")?;
    Ok(())
}

/// Lists the programs that a study is about to run.
fn list_programs(study: &Study) {
    let programs = commands(study.programs());
    if !programs.is_empty() {
        tell!("this study runs programs with the rights of the user who runs mcl-eval:");
    }
    for (name, command) in programs {
        tell!("  {}: {}", printable(name), printable(&command));
    }
}

/// Reports how many runs of programs ended abnormally, and returns their number.
fn report_failed_runs(results: &Results) -> usize {
    let mut failed: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
    let mut runs: BTreeMap<&str, usize> = BTreeMap::new();
    for row in results.table.rows() {
        let (name, ended) = (row.text(LOCALIZER), row.text(ENDED));
        *runs.entry(name).or_default() += 1;
        if !matches!(ended, "" | "ok") {
            *failed.entry(name).or_default().entry(ended).or_default() += 1;
        }
    }
    let mut all = 0;
    for (name, reasons) in failed {
        let sum: usize = reasons.values().sum();
        all += sum;
        let reasons: Vec<String> =
            reasons.iter().map(|(reason, count)| format!("{reason}: {count}")).collect();
        tell!(
            "note: {}: {sum} of {} runs of {} failed ({}); {FAILURES} names the files with their stderr",
            printable(&results.facts.name),
            runs[name],
            printable(name),
            printable(&reasons.join(", "))
        );
    }
    all
}

/// The study, its name, and the names of its data sets or logs.
pub fn read_study(args: &StudyArgs, global: &Global) -> Result<(Study, String, Vec<String>)> {
    let study = studies::read(&args.study)?;
    let names = match args.datasets.is_empty() {
        false => args.datasets.clone(),
        true => at_hand(&study, global)?,
    };
    Ok((study, study_name(&args.study)?, names))
}

/// The available data sets of the study; reports how to get the others.
fn at_hand(study: &Study, global: &Global) -> Result<Vec<String>> {
    let registry = Registry::from_environment()?;
    let (mut names, mut missing) = (Vec::new(), Vec::new());
    for name in study.dataset_names() {
        let dataset = registry.get(name)?;
        let present = matches!(dataset.source, Origin::Simulated { .. });
        match registry.locate(dataset) {
            Err(_) if !present => missing.push(printable(name)),
            _ => names.push(name.to_owned()),
        }
    }
    if !missing.is_empty() && !global.quiet {
        tell!(
            "{} not at hand ({}): `make datasets` or `mcl-eval datasets fetch` gets those that can be downloaded",
            counted(missing.len(), "data set"),
            text::list(&missing)
        );
    }
    if names.is_empty() {
        bail!("none of the study's data sets is at hand; `mcl-eval datasets fetch` gets them");
    }
    Ok(names)
}

/// The study's name: that of its file, without the ending.
pub fn study_name(path: &Path) -> Result<String> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if !is_plain_name(&stem) {
        bail!(
            "{}: results are stored under the file's name, which cannot name a folder",
            path.display()
        );
    }
    Ok(stem)
}
