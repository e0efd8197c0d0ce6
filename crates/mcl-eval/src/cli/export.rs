use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_core::files::create_folder;
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::DataSource;
use mcl_study::localizer::input::Input;
use mcl_study::recipe::localizer::{Formats, LogFormat, MapFormat, Whose};
use mcl_study::recipe::run::RunRecipe;
use mcl_study::study::definition::Study;
use mcl_study::trial::course::Course;
use mcl_study::trial::division::{Division, StudyData};
use mcl_study::trial::map::Dimension;
use mcl_study::trial::maps::Maps;
use mcl_study::trial::run::Trial;
use mcl_study::trial::tracking::seed_of;
use serde::Serialize;

use super::Outcome;
use super::args::{ExportArgs, ExportLog, ExportMap, Global};
use super::output::{print, refuse, report_data_losses};
use crate::progress::tell;
use crate::studies;
use mcl_core::text::printable;

/// Default edge of a cell (m).
const RESOLUTION: f64 = 0.05;

/// A run of the plan.
struct Planned<'p> {
    trial: &'p Trial,
    run: &'p RunRecipe,
}

#[derive(Serialize)]
struct Runs {
    runs: Vec<ListedRun>,
}

#[derive(Serialize)]
struct WrittenRuns {
    exported: Vec<Exported>,
}

#[derive(Serialize)]
struct ListedRun {
    run: usize,
    trial: String,
    localizer: String,
}

#[derive(Serialize)]
struct Exported {
    run: usize,
    trial: String,
    folder: PathBuf,
    reference: PathBuf,
    scans: usize,
    made_stamps: usize,
}

/// Writes the input folders of external localizers for runs of a study.
pub fn run(args: &ExportArgs, global: &Global) -> Result<Outcome> {
    let study = studies::read(&args.study)?;
    let dataset = dataset_of(args, &study)?;
    let options = SourceOptions { ..args.read.options(args.max_range) };
    let source = DataSource::open(&dataset, &options, false)?;
    let scans = study.listed(source.name()).and_then(|listed| listed.scans);
    let source = match (scans, source) {
        (Some(scans), DataSource::Log(log)) => DataSource::Log(log.first_scans(scans)),
        (_, source) => source,
    };
    let outcome = report_data_losses(&dataset, &source);
    let data = StudyData::new(source);
    let plan = study.plan(&data.log()?.name)?;
    let planned: Vec<Planned<'_>> = plan
        .trials
        .iter()
        .flat_map(|trial| trial.runs.iter().map(move |run| Planned { trial, run }))
        .collect();
    if planned.is_empty() {
        bail!("{}: the study has no runs on {dataset}", args.study.display());
    }
    let Some(output) = args.output.as_deref().filter(|_| !args.list) else {
        let runs = planned.iter().enumerate().map(ListedRun::of).collect();
        print(args.json, &Runs { runs }, |listed| {
            let line = |listed: &ListedRun| format!("{}: {}", listed.run, printable(&listed.trial));
            listed.runs.iter().map(line).collect::<Vec<_>>().join("\n")
        })?;
        return Ok(outcome);
    };
    if args.runs.is_empty() {
        return refuse(
            "no run is given: --list shows the runs with their numbers, and --run K exports one",
        );
    }
    if let Some(wrong) = args.runs.iter().find(|&&run| run == 0 || run > planned.len()) {
        return refuse(&format!("--run {wrong}: the study has runs 1 to {}", planned.len()));
    }
    let maps = Maps::<2>::new(&data, args.runs.iter().map(|run| &planned[run - 1].trial.map))?;
    let mut exported = Vec::new();
    for &number in &args.runs {
        exported.push(export(args, &data, &maps, number, &planned[number - 1], output)?);
    }
    if exported.iter().any(|run| run.made_stamps > 0) && !global.quiet {
        let sum: usize = exported.iter().map(|run| run.made_stamps).sum();
        tell!("note: {sum} stamps are not those of the log, which do not increase there");
    }
    print(args.json, &WrittenRuns { exported }, |written| {
        let line = |run: &Exported| {
            let Exported { trial, folder, reference, scans, .. } = run;
            let [folder, reference] = [folder, reference].map(|path| path.display().to_string());
            let [folder, reference] = [&folder, &reference].map(|path| printable(path));
            format!("{folder}: {}, {scans} scans; reference: {reference}", printable(trial))
        };
        written.exported.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    Ok(outcome)
}

impl ListedRun {
    fn of((place, planned): (usize, &Planned<'_>)) -> Self {
        let localizer = planned.run.localizer.as_ref();
        ListedRun {
            run: place + 1,
            trial: planned.name(),
            localizer: localizer.map_or("own", |localizer| localizer.name()).to_owned(),
        }
    }
}

impl Planned<'_> {
    fn name(&self) -> String {
        format!("{} {}", self.trial, self.run)
    }
}

fn dataset_of(args: &ExportArgs, study: &Study) -> Result<String> {
    if let Some(dataset) = &args.dataset {
        return Ok(dataset.clone());
    }
    let names: Vec<&str> = study.dataset_names().collect();
    match names[..] {
        [only] => Ok(only.to_owned()),
        [] => bail!("the study lists no data set; --dataset NAME|PATH names one"),
        _ => bail!("the study lists {}; choose one with --dataset", names.join(", ")),
    }
}

/// The requested formats, else those of the run's localizer.
fn formats_of(args: &ExportArgs, run: &RunRecipe) -> (Formats, Whose) {
    let (formats, poses) = match run.program() {
        Some(program) => (program.formats, program.poses),
        None => {
            let formats = Formats { log: LogFormat::Mcap, map: MapFormat::Csv, resolution: None };
            (formats, Whose::Robot)
        }
    };
    let log = args.log.map_or(formats.log, |log| match log {
        ExportLog::Mcap => LogFormat::Mcap,
        ExportLog::Bag => LogFormat::Bag,
        ExportLog::Db3 => LogFormat::Db3,
        ExportLog::Carmen => LogFormat::Carmen,
    });
    let map = args.map.map_or(formats.map, |map| match map {
        ExportMap::Csv => MapFormat::Csv,
        ExportMap::Ply => MapFormat::Ply,
        ExportMap::Pcd => MapFormat::Pcd,
        ExportMap::Grid => MapFormat::Grid,
    });
    let resolution = args.resolution.or(formats.resolution).unwrap_or(RESOLUTION);
    (Formats { log, map, resolution: Some(resolution) }, poses)
}

fn export(
    args: &ExportArgs,
    data: &StudyData,
    maps: &Maps<'_, 2>,
    number: usize,
    planned: &Planned<'_>,
    output: &Path,
) -> Result<Exported> {
    let Planned { trial, run } = planned;
    let name = format!("run-{number}");
    let (folder, reference) = (output.join(&name), output.join(format!("{name}.tum")));
    let log = data.log()?;
    let map = maps.get(&trial.map)?;
    let division = maps.division(&trial.map)?;
    let (division, map) =
        Division::plane(&division, &map).context("robots are localized in the plane")?;
    let seed = |purpose: &str| seed_of(purpose, trial.map.seed, trial.map.split, log, run);
    let course = Course::of(run, log, division, seed)?;
    let input = Input::of(&course, run, log, seed("localizer"))?;
    let (formats, poses) = formats_of(args, run);
    let time_limit = run.program().map(|program| program.limits.time_limit);
    if [&folder, &reference].iter().any(|path| path.exists()) {
        bail!(
            "{} already exists, perhaps with poses beside the log; expected a new folder",
            folder.display()
        );
    }
    create_folder(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    input.write(&folder, &formats, poses, map, (division, log), time_limit)?;
    input.write_reference(&reference, poses)?;
    Ok(Exported {
        run: number,
        trial: planned.name(),
        folder,
        reference,
        scans: input.stamps.all.len(),
        made_stamps: input.stamps.made,
    })
}
