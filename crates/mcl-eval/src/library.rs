//! Commands as functions, for programs that call them: options by their names on the command line, results as
//! values. With the same options and seeds the results have the same digits as those of the commands.

use mcl_core::{Point, PointMap, Pose2};
use mcl_filter::sensor::FreeSpace;
use mcl_filter::{Bridge, CheckedSettings, MapDistances, Run};
use mcl_study::data::source::{DEFAULT_MAX_RANGE, DataSource, LogSource};
use mcl_study::trial::tracking::bridge;
use rayon::prelude::*;
use serde_json::Value;

use anyhow::{Context, Result, bail};
use clap::Parser;

use crate::cli::args::{Cli, Command, LocalizeArgs};
pub use crate::cli::localize::grid_map;
use crate::cli::localize::{Watchers, checked_settings, first_pose, one_run};
pub use crate::cli::map::Folds;
use crate::cli::map::{Watch, build, check_arguments};
use crate::localization::{FinishedRun, Localization, run_seed};
use crate::progress::error_message;

/// Called repeatedly during long work; an error ends it.
pub type End<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// The text of an error as the command line writes it, without the advice to try --help.
pub fn words(error: &anyhow::Error) -> String {
    let Some(usage) = error.downcast_ref::<clap::Error>() else { return error_message(error) };
    let text = usage.to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let end =
        ["\n\nUsage:", "\n\nFor more information"].iter().filter_map(|tail| text.find(tail)).min();
    text[..end.unwrap_or(text.len())].trim_end().to_owned()
}

/// Parses the options of a command; `name` is the log, and `needed` are options that the command requires and
/// the caller does not use.
fn parse(command: &str, name: &str, needed: &[&str], options: &[String]) -> Result<Command> {
    let words = ["mcl-eval", command].into_iter().chain(needed.iter().copied());
    let words = words.chain(options.iter().map(String::as_str)).chain(["--", name]);
    Ok(Cli::try_parse_from(words)?.command)
}

/// Opens a log, point cloud, bag or data set; the options are those of `inspect`.
///
/// # Errors
/// Usage errors, and as [`DataSource::open`].
pub fn open(name: &str, options: &[String]) -> Result<DataSource> {
    match parse("inspect", name, &[], options)? {
        Command::Inspect(args) => DataSource::open(name, &args.data.options(), false),
        _ => bail!("inspect was parsed as another command"),
    }
}

/// Builds a map of points; the options are those of `map`, and the second value is the output of `map
/// --json`. Only scans have `folds` ([`StudyData::folds`](mcl_study::trial::division::StudyData::folds)). If
/// `end` returns an error during a refinement, the thread unwinds with it.
///
/// # Errors
/// Usage errors, and points or settings from which no map can be built.
pub fn build_map<const D: usize>(
    points: Vec<Point<D>>,
    folds: Option<Folds<'_, D>>,
    options: &[String],
    end: End<'_>,
) -> Result<(PointMap<D>, Value)> {
    let Command::Map(args) = parse("map", "points", &["--output", "map.csv", "--json"], options)?
    else {
        bail!("map was parsed as another command");
    };
    check_arguments(&args)?;
    let watch = Watch { quiet: true, end };
    let (map, _, built) = build(points, folds, |_| Ok(None), &args, &watch)?;
    Ok((map, serde_json::to_value(built)?))
}

/// The options of `localize`.
pub struct FilterOptions(Box<LocalizeArgs>);

impl FilterOptions {
    /// Parses them.
    ///
    /// # Errors
    /// Usage errors.
    pub fn parse(options: &[String]) -> Result<Self> {
        match parse("localize", "log", &["--map", "map.csv"], options)? {
            Command::Localize(args) => Ok(FilterOptions(args)),
            _ => bail!("localize was parsed as another command"),
        }
    }

    /// The settings of the filter.
    ///
    /// # Errors
    /// Usage errors: values out of range, and invalid combinations.
    pub fn settings(&self) -> Result<CheckedSettings> {
        checked_settings(&self.0, self.0.log.max_range.unwrap_or(DEFAULT_MAX_RANGE))
    }

    /// The pose of the laser at the first scan, if it is given.
    pub fn initial_pose(&self) -> Option<Pose2> {
        self.0.initial_pose.map(|[x, y, theta]| Pose2::new(x, y, theta))
    }

    /// The seed of all runs.
    pub fn seed(&self) -> u64 {
        self.0.seed
    }
}

/// Runs of the filter over a log.
pub struct Localized {
    /// The runs.
    pub runs: Vec<Run>,
    /// The errors of each run.
    pub finished: Vec<FinishedRun>,
    /// The output of `localize --json`.
    pub figures: Localization,
    /// Steps with unknown odometry.
    pub bridged: Bridge,
}

/// Localizes the robot of a log on a map, with the map's free space where known. The limit of readings is
/// that of the log.
///
/// # Errors
/// Usage errors, a [`LogSource`] without the required data, and errors of the filter.
pub fn localize(
    source: &LogSource,
    map: &PointMap<2>,
    free: Option<FreeSpace>,
    options: &FilterOptions,
    end: End<'_>,
) -> Result<Localized> {
    let args = &options.0;
    let settings = checked_settings(args, args.log.max_range.unwrap_or(source.max_range))?;
    let start = first_pose(args, source)?;
    let bridged = bridge(source)?;
    let distances = MapDistances::grid(map, settings.values().max_distance)?.with_free_space(free);
    let run = |number| {
        let seed = run_seed(args.seed, &source.name, number);
        let filter = (&distances, &settings, start);
        let (run, elapsed, _) =
            one_run(source, filter, args.odometry_noise, seed, Watchers::only(end))
                .with_context(|| format!("run {number}"))?;
        let finished = FinishedRun::of(&run, source, elapsed)?;
        anyhow::Ok((run, finished))
    };
    let found = (0..args.runs).into_par_iter().map(run).collect::<Result<Vec<_>>>()?;
    let (runs, finished): (Vec<Run>, Vec<FinishedRun>) = found.into_iter().unzip();
    let figures = Localization::of(&finished, source, bridged.scans.len(), args.seed)?;
    Ok(Localized { runs, finished, figures, bridged })
}
