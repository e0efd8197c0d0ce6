use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use mcl_maps::MapSize;

use super::{DataArgs, non_negative, number, numbers, positive};
use mcl_study::recipe::criterion::Criterion;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Init {
    /// Each non-empty cell of a grid keeps the point nearest to the mean of its points; gbs in studies.
    #[value(alias = "gbs")]
    Grid,
    /// Points at random, without replacement; rnd in studies.
    #[value(alias = "rnd")]
    Random,
    /// Every point.
    All,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Refine {
    /// Fuzzy k-means (EM).
    Fkm,
    /// Fuzzy k-means by longer steps (SQUAREM): fewer updates, at times another local maximum.
    FkmAccelerated,
    /// Fuzzy k-means from the map and from random ones; the likeliest is kept.
    Restarts,
    /// Fuzzy k-means with a sigma that falls to the wanted one.
    Annealed,
    /// Fuzzy k-means that adds points where they are missed and removes others.
    SplitMerge,
    /// Fuzzy k-means, then exchanges of kept points for data points nearby.
    Exchange,
    /// Split and merge, then exchanges: the likeliest map, in a few times fkm's time.
    Best,
}

/// A number that is given, or chosen by the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Auto<T> {
    Given(T),
    Auto,
}

impl std::str::FromStr for Auto<MapSize> {
    type Err = mcl_maps::ParseMapSizeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.trim() {
            "auto" => Ok(Auto::Auto),
            text => text.parse().map(Auto::Given),
        }
    }
}

fn sigma(text: &str) -> Result<Auto<f64>, String> {
    match text.trim() {
        "auto" => Ok(Auto::Auto),
        text => number(text, |value| value > 0.0, "a positive number or auto").map(Auto::Given),
    }
}

#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    pub data: DataArgs,
    /// How to choose the points.
    #[arg(long)]
    pub init: Init,
    /// Points of the map: a number (389), a percentage of the log's points (0.25%), or auto.
    #[arg(long, value_name = "K|P%|auto", conflicts_with = "cell")]
    pub size: Option<Auto<MapSize>>,
    /// What decides an automatic size or sigma.
    #[arg(long, value_name = "CRITERION", default_value = "held-out", value_parser = criterion())]
    pub auto_by: Criterion,
    /// Edge length of a grid cell in metres.
    #[arg(long, value_name = "M", value_parser = positive)]
    pub cell: Option<f64>,
    /// A corner of a grid cell in metres, in three dimensions X,Y,Z; or random: drawn from the seed, as
    /// studies do, whose rows give the seed of each map [default: 0,0].
    #[arg(long, value_name = "X,Y|random", value_parser = offset, allow_hyphen_values = true)]
    pub offset: Option<Offset>,
    /// Seed of a random map or offset, and of what a refinement draws.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// Improve the map.
    #[arg(long)]
    pub refine: Option<Refine>,
    /// Rounds of split and merge (--refine split-merge or best) [default: 12].
    #[arg(long, value_name = "N")]
    pub rounds: Option<usize>,
    /// Random maps to start from (--refine restarts) [default: 5].
    #[arg(long, value_name = "N")]
    pub restarts: Option<usize>,
    /// A refinement stops looking further after so many seconds; the map then depends on the machine.
    #[arg(long, value_name = "S", value_parser = non_negative, requires = "refine")]
    pub refine_seconds: Option<f64>,
    /// Standard deviation of a map point's Gaussian in metres, or auto.
    #[arg(long, default_value = "0.05", value_name = "M|auto", value_parser = sigma)]
    pub sigma: Auto<f64>,
    /// Fuzzy k-means stops when an update gains less (nats per point).
    #[arg(long, default_value_t = 1e-4, value_name = "T", value_parser = non_negative)]
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    #[arg(long, default_value_t = 1000, value_name = "N")]
    pub max_iterations: usize,
    /// Keep the fitted means instead of replacing each by its nearest data point.
    #[arg(long, requires = "refine")]
    pub no_snap: bool,
    /// Edge length of a cell of a grid map (.yaml) in metres [default: 0.05].
    #[arg(long, value_name = "M", value_parser = positive)]
    pub resolution: Option<f64>,
    /// Write PLY and PCD files as text.
    #[arg(long)]
    pub ascii: bool,
    /// The map's file: .csv, .ply, .pcd, or .yaml: a map_server grid with its image beside it, free where
    /// beams of the log crossed.
    #[arg(long, short, value_name = "MAP")]
    pub output: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// A corner of a grid cell, of two or three coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Offset {
    Planar([f64; 2]),
    Spatial([f64; 3]),
    /// Drawn from the seed.
    Random,
}

fn offset(text: &str) -> Result<Offset, String> {
    match text.matches(',').count() {
        0 if text == "random" => Ok(Offset::Random),
        2 => numbers(text).map(Offset::Spatial),
        _ => numbers(text).map(Offset::Planar),
    }
}

/// Names of criteria, each with what it means.
fn criterion() -> impl TypedValueParser<Value = Criterion> {
    let value = |criterion: Criterion| {
        PossibleValue::new(criterion.name()).help(match criterion {
            Criterion::HeldOut => "The likelihood of blocks of scans left out in turn",
            Criterion::Bic => "The Bayesian information criterion (size)",
            Criterion::Mdl => "The description length of data and map (size)",
            Criterion::Likelihood => {
                "The likelihood of the points that the map is built from, as EM would estimate it (sigma)"
            }
        })
    };
    PossibleValuesParser::new(Criterion::ALL.map(value)).try_map(|name| name.parse())
}
