use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use mcl_datasets::log::ReferencePoses;
use mcl_maps::MapSize;

use crate::source::SourceOptions;

/// Monte Carlo localization evaluation on sample-based maps.
///
/// LOG is a CARMEN log (.log, .clf, plain or .gz) or the name of a data set (`mcl-eval datasets list`).
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
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub threads: usize,
    /// No progress bars and no notes on stderr; errors and losses are still told.
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// What is in a log.
    Inspect(InspectArgs),
    /// Build a sample-based map of a log.
    Map(MapArgs),
    /// How likely the points of a log are under a map.
    Likelihood(LikelihoodArgs),
    /// Run an experiment; an interrupted run goes on where it stopped.
    Run(RunArgs),
    /// Draw the figures again from saved rows.
    Plot(PlotArgs),
    /// Write the simulated office, with exact ground truth, as a CARMEN log.
    Simulate(SimulateArgs),
    /// The registry of public data sets.
    Datasets(DatasetsArgs),
}

#[derive(Debug, Args)]
pub struct LogArgs {
    /// CARMEN log or name of a data set.
    pub log: String,
    /// Readings beyond this many metres are not used [default: the data set's, else 10].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    /// Whether the laser poses in the log are ground truth: auto (told from the log), recorded, none.
    #[arg(long, value_name = "WHICH")]
    pub reference: Option<ReferencePoses>,
}

impl LogArgs {
    pub fn options(&self) -> SourceOptions {
        SourceOptions { max_range: self.max_range, reference: self.reference }
    }
}

#[derive(Debug, Args)]
pub struct InspectArgs {
    #[command(flatten)]
    pub log: LogArgs,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Init {
    /// Each non-empty cell of a grid keeps the point nearest to the mean of its points.
    Grid,
    /// Points at random, without replacement.
    Random,
    /// Every point.
    All,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Refine {
    /// Fuzzy k-means (EM).
    Fkm,
}

#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    pub log: LogArgs,
    /// How to choose the points.
    #[arg(long)]
    pub init: Init,
    /// Points of the map: a number (389) or a percentage of the log's points (0.25%).
    #[arg(long, value_name = "K|P%", conflicts_with = "cell")]
    pub size: Option<MapSize>,
    /// Edge length of a grid cell in metres.
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub cell: Option<f64>,
    /// A corner of a grid cell in metres [default: 0,0].
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    pub offset: Option<[f64; 2]>,
    /// Seed of a random map.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// Improve the map.
    #[arg(long)]
    pub refine: Option<Refine>,
    /// Standard deviation of a map point's Gaussian in metres.
    #[arg(long, default_value_t = 0.05, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub sigma: f64,
    /// Fuzzy k-means stops when an update gains less (nats per point).
    #[arg(long, default_value_t = 1e-4, value_name = "T", value_parser = non_negative, allow_negative_numbers = true)]
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    #[arg(long, default_value_t = 1000, value_name = "N")]
    pub max_iterations: usize,
    /// Keep the fitted means instead of replacing each by its nearest data point.
    #[arg(long, requires = "refine")]
    pub no_snap: bool,
    /// Write PLY and PCD files as text.
    #[arg(long)]
    pub ascii: bool,
    /// The map's file: .csv, .ply or .pcd.
    #[arg(long, short, value_name = "MAP")]
    pub output: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct LikelihoodArgs {
    #[command(flatten)]
    pub log: LogArgs,
    /// The map: .csv, .ply or .pcd.
    #[arg(long, value_name = "MAP")]
    pub map: PathBuf,
    /// Standard deviation of a map point's Gaussian in metres.
    #[arg(long, default_value_t = 0.05, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub sigma: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct RunArgs {
    /// Definition of the experiment.
    #[arg(value_name = "EXPERIMENT.toml")]
    pub experiment: PathBuf,
    /// Run on this data set or log; may be given several times [default: those of the definition
    /// that are at hand].
    #[arg(long = "dataset", value_name = "NAME|PATH")]
    pub datasets: Vec<String>,
    /// Readings beyond this many metres are not used [default: each data set's, else 10].
    #[arg(long, value_name = "M", value_parser = positive, allow_negative_numbers = true)]
    pub max_range: Option<f64>,
    /// Folder that holds <experiment>/<data set>/.
    #[arg(long, short, default_value = "results", value_name = "ROOT")]
    pub output: PathBuf,
    /// Forget the rows of an earlier run.
    #[arg(long)]
    pub fresh: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct PlotArgs {
    /// Folder that holds <experiment>/<data set>/.
    #[arg(default_value = "results", value_name = "ROOT")]
    pub root: PathBuf,
}

#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// The log to write; with .gz compressed.
    #[arg(long, short, value_name = "LOG")]
    pub output: PathBuf,
    /// Seed of the simulation; 1 is the data set `simulated-office`.
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
    /// Download, unpack and check; goes on after an interruption.
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

fn pair(text: &str) -> Result<[f64; 2], String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|part| number(part.trim(), |_| true, "two numbers X,Y"))
        .collect::<Result<_, _>>()?;
    parts.try_into().map_err(|_| "expected two numbers X,Y".to_owned())
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
    fn pairs() {
        assert_eq!(pair("1.5,-2"), Ok([1.5, -2.0]));
        assert!(pair("1").is_err() && pair("1,2,3").is_err() && pair("1,inf").is_err());
    }
}
