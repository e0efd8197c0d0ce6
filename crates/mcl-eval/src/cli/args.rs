mod evaluate;
mod localize;
mod map;
mod parts;
mod read;

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Parser, Subcommand, ValueEnum};

use crate::studies;
pub use evaluate::{AlignTo, EvaluateArgs, Group, MatchBy, RpePairs, RpePath, TimeOffset, Whose};
pub use localize::{Initial, LocalizeArgs};
pub use map::{Auto, Init, MapArgs, Offset, Refine};
use mcl_figures::Medium;
use mcl_study::data::options::SourceOptions;
pub use parts::{Engine, PartOf, PlanArgs, StatusArgs};
pub use read::ReadArgs;

/// Monte Carlo localization evaluation on sample-based maps.
///
/// LOG is a CARMEN log, a bag of ROS 1 (.bag) or ROS 2 (.mcap, .db3, or the folder of a bag), plain or as
/// .gz, .bz2, .xz or .zst, recognized by its content, or the name of a data set (`mcl-eval datasets list`).
/// inspect, map and likelihood also take point clouds in two or three dimensions: .ply, .pcd, .csv, or a bag
/// with PointCloud2 messages.
#[derive(Debug, Parser)]
#[command(name = "mcl-eval", version, propagate_version = true, max_term_width = 100)]
pub struct Cli {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Args)]
pub struct Global {
    /// Worker threads; 0 for one per core. Results do not depend on it.
    #[arg(long, global = true, default_value_t = 0, value_name = "N",
        value_parser = RangedU64ValueParser::<u16>::new().range(..=1024))]
    pub threads: u16,
    /// No progress bars and no notes on stderr; errors and losses are still reported.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Describe the content of a log.
    Inspect(InspectArgs),
    /// Build a sample-based map of a log.
    // That of clap is longer than a terminal of 60 columns, and never broken.
    #[command(override_usage = "mcl-eval map [OPTIONS] --init <INIT> -o <MAP> <LOG>")]
    Map(MapArgs),
    /// Likelihood of the points of a log under a map.
    Likelihood(LikelihoodArgs),
    /// Localize the robot of a log on a map with a particle filter.
    Localize(Box<LocalizeArgs>),
    /// Errors of estimated trajectories (TUM files, logs, bags), one row each.
    #[command(
        override_usage = "mcl-eval evaluate [OPTIONS]\n                --reference <REF> <EST>..."
    )]
    Evaluate(EvaluateArgs),
    /// Run a study; an interrupted run continues where it stopped.
    Run(RunArgs),
    /// Write the input that an external localizer gets in a run of a study; runs nothing.
    Export(ExportArgs),
    /// Estimate the time and memory of a study in parts, and print the script that starts it on a cluster; starts
    /// nothing.
    Plan(PlanArgs),
    /// Progress of the studies in a result folder, over all processes that run parts of them.
    Status(StatusArgs),
    /// Draw the figures again from saved rows.
    Plot(PlotArgs),
    /// Compare recomputed results with those of an earlier run.
    Compare(CompareArgs),
    /// Each claim of the paper beside what was measured, with its test.
    Claims(ClaimsArgs),
    /// One HTML page of all results: answers, claims, charts, tables; it needs no server.
    Report(ReportArgs),
    /// Convert a log (CARMEN, bag of ROS 1 or 2) or a map into another format.
    Convert(ConvertArgs),
    /// Write the simulated office, with exact ground truth, as a CARMEN log.
    Simulate(SimulateArgs),
    /// The registry of public data sets.
    Datasets(DatasetsArgs),
}

#[derive(Debug, Args)]
pub struct LogArgs {
    /// CARMEN log, bag of ROS 1 or 2, or name of a data set.
    pub log: String,
    /// Readings beyond this many metres are not used [default: the data set's, else 10]. Of a point cloud:
    /// points so far from the origin of its frame, where the scanner is [default: the data set's, else all].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    #[command(flatten)]
    pub read: ReadArgs,
}

/// What only point clouds have.
#[derive(Debug, Args)]
pub struct CloudArgs {
    /// Topic of a bag's point clouds [default: the only PointCloud2 topic, or /points, of a bag without scans].
    #[arg(long, value_name = "TOPIC")]
    pub cloud_topic: Option<String>,
    /// Dimensions of a point cloud: 3, or 2 to drop its heights [default: 3 if its points differ in height].
    #[arg(long, value_name = "2|3", value_parser = clap::value_parser!(u8).range(2..=3))]
    pub dimensions: Option<u8>,
}

/// What maps are built of: a log, a point cloud or a data set.
#[derive(Debug, Args)]
pub struct DataArgs {
    #[command(flatten)]
    pub log: LogArgs,
    #[command(flatten)]
    pub cloud: CloudArgs,
}

impl DataArgs {
    pub fn options(&self) -> SourceOptions {
        SourceOptions {
            cloud_topic: self.cloud.cloud_topic.clone(),
            dimensions: self.cloud.dimensions.map(usize::from),
            ..self.log.options()
        }
    }
}

impl LogArgs {
    pub fn options(&self) -> SourceOptions {
        self.read.options(self.max_range)
    }

    /// The files to be read, as the user names them.
    pub fn named(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.log.as_str()).chain(self.read.reference_file())
    }
}

#[derive(Debug, Args)]
pub struct InspectArgs {
    #[command(flatten)]
    pub data: DataArgs,
    /// Fit the motion models of localize to the log's odometry against its reference: their parameters with
    /// 95 % intervals, as options.
    #[arg(long)]
    pub fit_motion: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct LikelihoodArgs {
    #[command(flatten)]
    pub data: DataArgs,
    /// The map: .csv, .ply, .pcd or .yaml (map_server).
    #[arg(long, value_name = "MAP")]
    pub map: PathBuf,
    /// Standard deviation of a map point's Gaussian in metres.
    #[arg(long, default_value_t = 0.05, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub sigma: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// A study, and what it is run on.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// The study: what is compared, on what, and how it is shown. A file, or the name of a built-in study if there is
    /// no file of that name.
    #[arg(value_name = "STUDY")]
    pub study: PathBuf,
    /// Run on this data set or log; may be given several times [default: those of the study that are at hand].
    #[arg(long = "dataset", value_name = "NAME|PATH")]
    pub datasets: Vec<String>,
    /// Readings beyond this many metres are not used [default: each data set's, else 10].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    #[command(flatten)]
    pub read: ReadArgs,
    #[command(flatten)]
    pub cloud: CloudArgs,
    /// Folder that holds <study>/<data set>/; the times of finished trials there give estimates for the others.
    #[arg(long, short, default_value = "results", value_name = "ROOT")]
    pub output: PathBuf,
}

/// The options of a command that the command line gives, as words of another one; without some, by their names here.
pub fn given<A: Args>(matches: &ArgMatches, without: &[&str]) -> Vec<String> {
    let known = A::augment_args(clap::Command::new("known"));
    let mut words = Vec::new();
    for option in known.get_arguments().filter(|option| !option.is_positional()) {
        let id = option.get_id().as_str();
        let is_given = matches.value_source(id) == Some(ValueSource::CommandLine);
        let Some(long) = option.get_long().filter(|_| is_given) else { continue };
        if without.contains(&id) {
            continue;
        }
        match option.get_action().takes_values() {
            true => words.extend(
                matches
                    .get_raw(id)
                    .into_iter()
                    .flatten()
                    .map(|value| format!("--{long}={}", value.to_string_lossy())),
            ),
            false => words.push(format!("--{long}")),
        }
    }
    words
}

#[derive(Debug, Args)]
#[command(after_help = studies::listed())]
pub struct RunArgs {
    #[command(flatten)]
    pub of: StudyArgs,
    /// Remove the rows of earlier runs first.
    #[arg(long)]
    pub fresh: bool,
    /// List the trials and the time they will take; run none.
    #[arg(long)]
    pub list: bool,
    /// Run one part of several, from 1, and make no tables; array/N takes the part from the variable that the array job
    /// of Slurm, Kubernetes, AWS Batch or Google Batch sets.
    #[arg(long, value_name = "I/N|array/N", conflicts_with_all = ["fresh", "list"])]
    pub part: Option<PartOf>,
    /// Run nothing: make the tables and figures of the rows that are there.
    #[arg(long, conflicts_with_all = ["fresh", "list", "part"])]
    pub merge: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "DIR/run-K/ holds the log with scans and the run's odometry (no reference poses), the map, \
    start.json and run.json, which describes all of it; DIR/run-K.tum the reference poses at the same stamps, to be \
    compared with by `mcl-eval evaluate --reference`."
)]
pub struct ExportArgs {
    /// The study: a file, or the name of a built-in one.
    #[arg(value_name = "STUDY")]
    pub study: PathBuf,
    /// Data set or log [default: the only one that the study lists].
    #[arg(long, value_name = "NAME|PATH")]
    pub dataset: Option<String>,
    /// Readings beyond this many metres are not used [default: the data set's, else 10].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    #[command(flatten)]
    pub read: ReadArgs,
    /// Number of a run in the list of --list, from 1; may be given several times.
    #[arg(long = "run", value_name = "K")]
    pub runs: Vec<usize>,
    /// List the runs with their numbers; write none.
    #[arg(long, conflicts_with_all = ["runs", "output"])]
    pub list: bool,
    /// Format of the log [default: that of the run's localizer, else mcap].
    #[arg(long, value_name = "FORMAT")]
    pub log: Option<ExportLog>,
    /// Format of the map; grid is one of map_server [default: that of the run's localizer, else csv].
    #[arg(long, value_name = "FORMAT")]
    pub map: Option<ExportMap>,
    /// Edge of the cells of a grid made of a map of points, in metres [default: that of the run's localizer, else
    /// 0.05].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub resolution: Option<f64>,
    /// The folder to write into.
    #[arg(long, short, value_name = "DIR", required_unless_present = "list")]
    pub output: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Formats of a log that is exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportLog {
    Mcap,
    Bag,
    Db3,
    Carmen,
}

/// Formats of a map that is exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportMap {
    Csv,
    Ply,
    Pcd,
    Grid,
}

#[derive(Debug, Args)]
pub struct PlotArgs {
    /// Folder that holds <study>/<data set>/.
    #[arg(default_value = "results", value_name = "ROOT")]
    pub root: PathBuf,
    /// What figures are made for.
    #[arg(long, value_enum, default_value_t = Style::Screen)]
    pub style: Style,
}

/// What figures are made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Style {
    /// For viewing: with captions, as SVG and PNG, into figures/.
    Screen,
    /// For a two-column paper: 3.5 inches wide, letters of 8 points, captions as text beside them, as PDF, SVG, PNG
    /// and all rows as CSV, into figures/paper/.
    Paper,
}

impl From<Style> for Medium {
    fn from(style: Style) -> Self {
        match style {
            Style::Screen => Medium::Screen,
            Style::Paper => Medium::Paper,
        }
    }
}

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Results as they are now.
    #[arg(value_name = "ROOT")]
    pub found: PathBuf,
    /// Results of an earlier run; they may hold only some of the files.
    #[arg(value_name = "EARLIER")]
    pub expected: PathBuf,
    /// Largest relative difference of numbers; with 0 every file is compared byte by byte.
    #[arg(long, value_name = "R", default_value_t = 0.0)]
    pub tolerance: f64,
}

#[derive(Debug, Args)]
pub struct ClaimsArgs {
    /// Folder that holds <study>/<data set>/.
    #[arg(default_value = "results", value_name = "ROOT")]
    pub root: PathBuf,
    /// Also write the tables into this file, as Markdown.
    #[arg(long, short, value_name = "FILE.md")]
    pub output: Option<PathBuf>,
    /// Every claim with its statement, what was measured, and its test.
    #[arg(long, short)]
    pub verbose: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folders that hold <study>/<data set>/, or runs that localize -o wrote.
    #[arg(default_value = "results", value_name = "ROOT")]
    pub roots: Vec<PathBuf>,
    /// A log that rows were computed from and no data set has, so that runs on it can be shown; may be given several
    /// times.
    #[arg(long = "log", value_name = "LOG")]
    pub logs: Vec<String>,
    /// The page to write.
    #[arg(long, short, default_value = "report.html", value_name = "FILE.html")]
    pub output: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "The extension of OUT decides the format.\n\
    Logs: .mcap or .db3 (bag of ROS 2), .bag (of ROS 1), with the topics /scan, /odom, /reference, /tf and \
    /tf_static; .log or .clf (CARMEN), also with .gz. A bag holds readings and directions of beams as 32-bit \
    floats, and CARMEN no infinite readings. Beams are written as they were measured (as with --no-deskew), with \
    the time between them where OUT is a bag.\n\
    Maps: .csv, .ply, .pcd, .yaml (map_server, with its image beside it; a grid map as a point map is the \
    centres of its occupied cells).")]
pub struct ConvertArgs {
    /// CARMEN log, bag of ROS 1 or 2, name of a data set, or map.
    #[arg(value_name = "IN")]
    pub input: String,
    /// The file to write.
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    #[command(flatten)]
    pub read: ReadArgs,
    /// To a grid map: the log whose beams say which cells are free [default: none is].
    #[arg(long, value_name = "LOG")]
    pub log: Option<String>,
    /// With --log: readings beyond this many metres are not used [default: the data set's, else 10].
    #[arg(long, value_name = "M", requires = "log", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    /// To a grid map: edge length of a cell in metres [default: that of a grid map, else 0.05].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub resolution: Option<f64>,
    /// Write PLY and PCD files as text.
    #[arg(long)]
    pub ascii: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// The log to write; with .gz compressed. In three dimensions a point cloud: .ply, .pcd or .csv.
    #[arg(long, short, value_name = "LOG")]
    pub output: PathBuf,
    /// The office in three dimensions, as a lidar of 32 beams sees it along the same path.
    #[arg(long)]
    pub three_dimensional: bool,
    /// People who walk through the office, whose legs the laser sees; office, route and all other readings are
    /// those of the same seed without people.
    #[arg(long, default_value_t = 0, value_name = "N", conflicts_with = "three_dimensional")]
    pub people: usize,
    /// Seed of the simulation; 1 is the data set `simulated-office`, and `simulated-office-3d`.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct DatasetsArgs {
    #[command(subcommand)]
    pub command: DatasetsCommand,
}

#[derive(Debug, Subcommand)]
pub enum DatasetsCommand {
    /// The data sets, and which of them are at hand.
    List(DatasetNames),
    /// Download, unpack and check; continues after an interruption.
    Fetch(DatasetNames),
    /// Check the files at hand against known digests and facts.
    Verify(DatasetNames),
}

#[derive(Debug, Args)]
pub struct DatasetNames {
    /// Data sets [default: all].
    #[arg(value_name = "NAME")]
    pub names: Vec<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, |value| value > 0.0, "a positive number")
}

fn non_negative(text: &str) -> Result<f64, String> {
    number(text, |value| value >= 0.0, "a number of at least 0")
}

fn number(text: &str, valid: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|&value: &f64| value.is_finite() && valid(value))
        .ok_or_else(|| format!("expected {expected}"))
}

fn fraction(text: &str) -> Result<f64, String> {
    number(text, |value| (0.0..=1.0).contains(&value), "a number from 0 to 1")
}

/// `N` numbers separated by commas.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let expected = || format!("expected {N} numbers separated by commas");
    let parts: Vec<f64> = text
        .split(',')
        .map(|part| number(part.trim(), |_| true, "").map_err(|_| expected()))
        .collect::<Result<_, _>>()?;
    let found = parts.len();
    parts.try_into().map_err(|_| format!("{}, found {found}", expected()))
}

fn deviations(text: &str) -> Result<[f64; 2], String> {
    let parts = numbers(text)?;
    match parts.iter().all(|&part| part >= 0.0) {
        true => Ok(parts),
        false => Err("expected standard deviations of at least 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn lists_of_numbers() {
        assert_eq!(numbers("1.5,-2"), Ok([1.5, -2.0]));
        assert_eq!(
            numbers::<3>("1, 2").unwrap_err(),
            "expected 3 numbers separated by commas, found 2"
        );
        for text in ["1", "1,2,3", "1,inf", "1,", ""] {
            assert!(numbers::<2>(text).is_err(), "{text}");
        }
        assert!(deviations("0.1,0").is_ok() && deviations("0.1,-1").is_err());
    }
}
