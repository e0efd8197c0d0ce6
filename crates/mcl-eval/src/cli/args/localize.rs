use std::path::PathBuf;
use std::sync::LazyLock;

use clap::{Args, ValueEnum};
use mcl_filter::{
    Beams, FilterSettings, MotionKind, ParticleNumber, Preset, Proposal, Resampling, SigmaHit,
};

use super::{LogArgs, deviations, numbers};

/// What stands below the options: the presets, from the one place where their values are.
static AFTER_HELP: LazyLock<String> = LazyLock::new(|| {
    let of = Preset::ALL.map(Preset::settings);
    let row = |name: &str, value: fn(&FilterSettings) -> String| {
        let [a, b, c] = of.each_ref().map(value);
        format!("  {name:<27} {a:<20} {b:<20} {c}\n")
    };
    let [a, b, c] = Preset::ALL.map(Preset::name);
    let rows = [
        format!("  {:<27} {a:<20} {b:<20} {c}\n", "Presets:"),
        row("--particles", |s| s.particles.to_string()),
        row("--beams", |s| s.beams.to_string()),
        row("--sigma-hit", |s| s.sigma_hit.to_string()),
        row("--z-rand", |s| match s.beam_floor {
            None => s.z_rand.to_string(),
            Some(_) => "-".into(),
        }),
        row("--beam-floor", |s| s.beam_floor.map_or_else(|| "-".into(), |floor| floor.to_string())),
        row("  (least of largest)", |s| match s.sigma_hit {
            SigmaHit::Metres(metres) => format!("{:.2}", s.relative_floor(metres)),
            SigmaHit::Auto => "by the map".into(),
        }),
        row("--outlier-fraction", |s| s.outlier_fraction.to_string()),
        row("--max-distance", |s| s.max_distance.to_string()),
        row("--motion", |s| s.motion.to_string()),
        row("--position-noise", |s| match s.motion {
            MotionKind::Gaussian => s.position_noise.map(|part| part.to_string()).join(","),
            MotionKind::Book => "-".into(),
        }),
        row("--heading-noise", |s| match s.motion {
            MotionKind::Gaussian => s.heading_noise.map(|part| part.to_string()).join(","),
            MotionKind::Book => "-".into(),
        }),
        row("--alpha", |s| match s.motion {
            MotionKind::Gaussian => "-".into(),
            MotionKind::Book => s.alpha.map(|a| a.to_string()).join(","),
        }),
        row("--proposal", |s| s.proposal.to_string()),
        row("--resampling", |s| s.resampling.to_string()),
        row("--ess-fraction", |s| s.ess_fraction.to_string()),
        row("--resample-after", |s| format!("{},{}", s.resample_distance, s.resample_angle)),
        row("--likelihood-exponent", |s| s.likelihood_exponent.to_string()),
    ];
    let sources = "  default: this program's own filter. book: Probabilistic Robotics, tables 8.2, 5.6 and \
        6.3. carmen: CARMEN's localize, with table 5.6 in place of its own motion model.\n\n";
    let files = "Errors are taken at every scan against the log's reference poses; without them (a raw \
        log) the start must be given, and errors are null. With -o, DIR holds run-NNN.tum and \
        run-NNN.csv (estimated laser poses and error rows of run NNN, in scan order, also where stamps \
        step back in time), run-NNN.watch.json (what `mcl-eval report DIR` plays), reference.tum and summary.json; an earlier call's are replaced. Scans \
        without a usable stamp are missing in the TUM files (reported, exit code 3).";
    rows.concat() + sources + files
});

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Initial {
    /// Position tracking: about the log's first reference pose, or the one given.
    Known,
    /// Global localization: anywhere on the map, in any direction. Finds the robot less often than scan.
    Uniform,
    /// Global localization: where the first scan is likely, tempered until the particles agree.
    Scan,
}

#[derive(Debug, Args)]
#[command(after_help = AFTER_HELP.as_str())]
pub struct LocalizeArgs {
    #[command(flatten)]
    pub log: LogArgs,
    /// The map: .csv, .ply, .pcd or .yaml (map_server).
    #[arg(long, value_name = "MAP")]
    pub map: PathBuf,
    /// The set of settings that the options below change (its values stand at the end).
    #[arg(long, default_value_t = Preset::Default, value_name = "default|book|carmen")]
    pub preset: Preset,
    /// Number of particles: fixed, or from MIN to MAX as KLD sampling asks for, MAX at the start [default: that of
    /// the preset; 250..10000 for an unknown start].
    #[arg(long, value_name = "N|MIN..MAX")]
    pub particles: Option<ParticleNumber>,
    /// Independent runs.
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..))]
    pub runs: u32,
    /// Seed of all runs; with the log's name and the run's number it decides every draw.
    #[arg(long, default_value_t = 1, value_name = "S")]
    pub seed: u64,
    /// Beams used per scan, evenly spread: all, a number, or degrees from one to the next, such as 3deg.
    #[arg(long, value_name = "N|Ddeg|all")]
    pub beams: Option<Beams>,
    /// σ_hit: standard deviation of an endpoint about the nearest map point, in metres; or auto: by the map's
    /// spacing.
    #[arg(long, value_name = "M|auto")]
    pub sigma_hit: Option<SigmaHit>,
    /// Probability of a random measurement (table 6.3).
    #[arg(long, value_name = "P", conflicts_with = "beam_floor")]
    pub z_rand: Option<f64>,
    /// The same as CARMEN expresses it: least likelihood of a beam as a fraction of the largest.
    #[arg(long, value_name = "F")]
    pub beam_floor: Option<f64>,
    /// Leave out beams that end at something the map does not know (people) for more than this share of the
    /// particles, for example 0.9.
    #[arg(long, value_name = "F")]
    pub outlier_fraction: Option<f64>,
    /// Distances to the map are cut at this many metres.
    #[arg(long, value_name = "M")]
    pub max_distance: Option<f64>,
    /// Motion model: gaussian (noise in the robot's frame with a floor per step) or book (table 5.6)
    /// [default: that of the preset, or the one whose noise is given].
    #[arg(long, value_name = "MODEL")]
    pub motion: Option<MotionKind>,
    /// Noise of the gaussian model along x and y: standard deviations per step (m), per metre (m/m) and per
    /// radian (m/rad), whose squares add up.
    #[arg(long, value_name = "S,M,R", value_parser = numbers::<3>)]
    pub position_noise: Option<[f64; 3]>,
    /// Noise of the heading in the gaussian model: standard deviations per step (rad), per metre (rad/m) and per
    /// radian (rad/rad).
    #[arg(long, value_name = "S,M,R", value_parser = numbers::<3>)]
    pub heading_noise: Option<[f64; 3]>,
    /// α₁…α₄ of the book's motion model; α·δ² are variances.
    #[arg(long, value_name = "A1,A2,A3,A4", value_parser = numbers::<4>, allow_hyphen_values = true,
          conflicts_with_all = ["position_noise", "heading_noise"])]
    pub alpha: Option<[f64; 4]>,
    /// Noise added to the odometry: standard deviations in metres and radians per increment
    /// [default: none].
    #[arg(long, value_name = "XY,THETA", value_parser = deviations)]
    pub odometry_noise: Option<[f64; 2]>,
    /// Where the noise of a motion is drawn from: motion (the motion model, as in the book) or
    /// adaptive (half of it from where the other half finds the scan likely; the same posterior).
    #[arg(long, value_name = "KIND")]
    pub proposal: Option<Proposal>,
    /// How particles are resampled: systematic, stratified, residual or multinomial.
    #[arg(long, value_name = "KIND")]
    pub resampling: Option<Resampling>,
    /// Resample when the effective sample size is below this fraction of the particles.
    #[arg(long, value_name = "F")]
    pub ess_fraction: Option<f64>,
    /// Resample no sooner than after a path of this many metres or turns of this many radians; until then
    /// likelihoods multiply.
    #[arg(long, value_name = "M,RAD", value_parser = deviations)]
    pub resample_after: Option<[f64; 2]>,
    /// Exponent on the likelihood of a scan; below 1 beams count less.
    #[arg(long, value_name = "E")]
    pub likelihood_exponent: Option<f64>,
    /// Where the particles start.
    #[arg(long, default_value = "known")]
    pub initial: Initial,
    /// Standard deviations of the known start along the map's axes, in metres, and of its heading, in radians.
    #[arg(long, value_name = "X,Y,THETA", value_parser = numbers::<3>)]
    pub initial_std: Option<[f64; 3]>,
    /// Use a scan only after the odometry has moved the robot this many metres or turned it this many radians
    /// since the last used one; estimates between are predicted.
    #[arg(long, value_name = "M,RAD", value_parser = deviations)]
    pub update_min: Option<[f64; 2]>,
    /// Look for the robot again when scans become much less likely than they used to be (augmented Monte Carlo
    /// localization, table 8.3).
    #[arg(long)]
    pub recover: bool,
    /// The laser's pose in the map at the first scan, in metres and radians [default: the log's
    /// reference].
    #[arg(long, value_name = "X,Y,THETA", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub initial_pose: Option<[f64; 3]>,
    /// Folder for trajectories, error rows and a summary.
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Record the first run (run 0) as a ROS 2 bag (MCAP), for viewing: map, scans, particles, estimate,
    /// reference and errors.
    #[arg(long, value_name = "OUT.mcap")]
    pub replay: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    /// The options as they were given, except those of the output.
    #[arg(skip)]
    pub given: Vec<String>,
}
