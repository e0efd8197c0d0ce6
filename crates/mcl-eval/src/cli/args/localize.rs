use std::path::PathBuf;
use std::sync::LazyLock;

use clap::{Args, ValueEnum};
use mcl_filter::{Beams, FilterSettings, Proposal, Resampling};

use super::{LogArgs, deviations, numbers};

/// The filter's defaults, from the one place where they stand.
static FILTER: LazyLock<FilterSettings> = LazyLock::new(FilterSettings::default);
static ALPHA: LazyLock<String> = LazyLock::new(|| FILTER.alpha.map(|a| a.to_string()).join(","));

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Initial {
    /// Position tracking: about the log's first reference pose, or the one given.
    Known,
    /// Global localization: anywhere on the map, in any direction.
    Uniform,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Errors are taken at every scan against the log's reference poses; without \
    them (a raw log) the start must be given, and errors are null. With -o, DIR holds run-NNN.tum \
    and run-NNN.csv (estimated laser poses and error rows of run NNN, in scan order, also where \
    stamps step back in time), reference.tum and summary.json; an earlier call's are replaced. \
    Scans without a usable stamp are missing in the TUM files (told, exit code 3)."
)]
pub struct LocalizeArgs {
    #[command(flatten)]
    pub log: LogArgs,
    /// The map: .csv, .ply, .pcd or .yaml (map_server).
    #[arg(long, value_name = "MAP")]
    pub map: PathBuf,
    /// Number of particles.
    #[arg(long, default_value_t = FILTER.particles, value_name = "N")]
    pub particles: usize,
    /// Independent runs.
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..))]
    pub runs: u32,
    /// Seed of all runs; with the log's name and the run's number it decides every draw.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// Beams used of a scan, evenly spread.
    #[arg(long, default_value_t = FILTER.beams, value_name = "N|all")]
    pub beams: Beams,
    /// σ_hit: standard deviation of an endpoint about the nearest map point, in metres.
    #[arg(long, default_value_t = FILTER.sigma_hit, value_name = "M")]
    pub sigma_hit: f64,
    /// Probability of a random measurement.
    #[arg(long, default_value_t = FILTER.z_rand, value_name = "P")]
    pub z_rand: f64,
    /// Distances to the map are cut at this many metres.
    #[arg(long, default_value_t = FILTER.max_distance, value_name = "M")]
    pub max_distance: f64,
    /// α₁…α₄ of the odometry motion model; α·δ² are variances.
    #[arg(long, default_value = ALPHA.as_str(), value_name = "A1,A2,A3,A4", value_parser = numbers::<4>,
          allow_hyphen_values = true)]
    pub alpha: [f64; 4],
    /// Noise added to the odometry: standard deviations in metres and radians per increment
    /// [default: none].
    #[arg(long, value_name = "XY,THETA", value_parser = deviations)]
    pub odometry_noise: Option<[f64; 2]>,
    /// Where the noise of a motion is drawn from: motion (the motion model, as in the book) or
    /// adaptive (half of it from where the other half finds the scan likely; the same posterior).
    #[arg(long, default_value_t = FILTER.proposal, value_name = "KIND")]
    pub proposal: Proposal,
    /// How particles are drawn anew: systematic, stratified, residual or multinomial.
    #[arg(long, default_value_t = FILTER.resampling, value_name = "KIND")]
    pub resampling: Resampling,
    /// Draw anew when the effective sample size is below this fraction of the particles.
    #[arg(long, default_value_t = FILTER.ess_fraction, value_name = "F")]
    pub ess_fraction: f64,
    /// Exponent on the likelihood of a scan; below 1 beams count less.
    #[arg(long, default_value_t = FILTER.likelihood_exponent, value_name = "E")]
    pub likelihood_exponent: f64,
    /// Where the particles start.
    #[arg(long, default_value = "known")]
    pub initial: Initial,
    /// The laser's pose in the map at the first scan, in metres and radians [default: the log's
    /// reference].
    #[arg(long, value_name = "X,Y,THETA", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub initial_pose: Option<[f64; 3]>,
    /// Folder for trajectories, error rows and a summary.
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Record the first run (run 0) as a ROS 2 bag (MCAP), to be looked at: map, scans, particles, estimate,
    /// reference and errors.
    #[arg(long, value_name = "OUT.mcap")]
    pub replay: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}
