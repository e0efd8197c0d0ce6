use std::convert::Infallible;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use mcl_metrics::{DEFAULT_TOLERANCE_S, DEFAULT_XI, Delta};

use super::{fraction, non_negative, number, numbers, positive};

/// Whose poses are meant: the robot's, the laser's, or those of a frame of a bag.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Whose {
    Robot,
    Laser,
    Frame(String),
}

impl FromStr for Whose {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "robot" => Whose::Robot,
            "laser" => Whose::Laser,
            frame => Whose::Frame(frame.trim_start_matches('/').to_owned()),
        })
    }
}

impl fmt::Display for Whose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Whose::Robot => f.write_str("the robot"),
            Whose::Laser => f.write_str("the laser"),
            Whose::Frame(name) => write!(f, "{name:?}"),
        }
    }
}

/// How an estimate is moved onto the reference before absolute errors are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AlignTo {
    None,
    Origin,
    #[value(alias = "se2")]
    Rigid,
}

/// Which poses are of one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MatchBy {
    /// Pairs of recorded poses, nearest in time first.
    Nearest,
    /// The poses of the sparser side, and the other side interpolated to their times.
    Interpolate,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RpePairs {
    /// Each pair begins where the one before ended.
    Consecutive,
    /// A pair begins at every pose.
    All,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RpePath {
    /// The same distances for all estimates.
    Reference,
    /// As evo does by default.
    Estimate,
}

/// What is added to the stamps of estimates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TimeOffset {
    Seconds(f64),
    /// The offset that brings the positions closest to the reference.
    Auto,
}

impl FromStr for TimeOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => Ok(TimeOffset::Auto),
            text => number(text, |_| true, "a number of seconds, or auto").map(TimeOffset::Seconds),
        }
    }
}

/// Runs of one localizer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    pub name: String,
    /// A pattern of paths, or a folder that `localize` wrote.
    pub runs: String,
}

impl FromStr for Group {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once('=') {
            Some((name, runs)) if !name.is_empty() && !runs.is_empty() => {
                Ok(Group { name: name.to_owned(), runs: runs.to_owned() })
            }
            _ => Err("expected NAME=RUNS, as nav2='runs/nav2/*.bag'".to_owned()),
        }
    }
}

/// Lengths over which relative errors are taken: metres without a unit.
fn delta(text: &str) -> Result<Delta, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let above_0 = |expected| number(digits, |value| value > 0.0, expected);
    match &text[digits.len()..] {
        "" | "m" => above_0("a positive number of metres").map(Delta::Metres),
        "s" => above_0("a positive number of seconds").map(Delta::Seconds),
        "rad" => angle(digits, 1.0),
        "deg" => angle(digits, std::f64::consts::PI / 180.0),
        "f" => match digits.parse() {
            Ok(frames) if frames > 0 => Ok(Delta::Frames(frames)),
            _ => Err("expected a number of frames, at least 1".to_owned()),
        },
        unit => Err(format!("{unit:?} is not a unit, expected m, s, f (frames), deg or rad")),
    }
}

fn angle(digits: &str, unit: f64) -> Result<Delta, String> {
    let within = |value: f64| value > 0.0 && value * unit <= std::f64::consts::PI;
    number(digits, within, "an angle up to half a turn").map(|value| Delta::Radians(value * unit))
}

#[derive(Debug, Args)]
#[command(
    after_help = "Errors are those of pairs of poses at the same time. The share of the reference's time \
    and path that an estimate covers is a figure of its own: if it is below 99 %, or anything had to be \
    guessed, stderr says so and the exit code is 3. An estimate that cannot be evaluated is a row with \
    the reason, and the other estimates are evaluated.\n\n\
    A run of a group counts as failed if it cannot be evaluated, if it ends lost (its last 50 poses are off by more \
    than 1 m on average), or if it covers less than 90 % of the reference's path."
)]
pub struct EvaluateArgs {
    /// Reference trajectory: TUM, KITTI, EuRoC or CSV file, the reference poses of a CARMEN log, a topic of a bag, or the
    /// name of a data set. Each estimate has its own where {run} (name of the estimate's file, without its extension)
    /// or {file} (its path) is part of it.
    #[arg(long, value_name = "REF")]
    pub reference: String,
    /// Estimated trajectories: files as the reference, also raw odometry of CARMEN logs.
    #[arg(value_name = "EST", required_unless_present = "groups")]
    pub estimates: Vec<String>,
    /// Runs of a localizer, to be summarized and compared with those of other groups: a pattern in quotes, or a
    /// folder that localize wrote. Runs of one name in two groups are compared in pairs.
    #[arg(long = "group", value_name = "NAME=RUNS")]
    pub groups: Vec<Group>,
    /// Topic of the reference in a bag: PoseStamped, PoseWithCovarianceStamped, TransformStamped, Odometry or
    /// Path, or two frames as /tf:map.base_link [default: the only topic of poses but estimates, or the one
    /// named as ground truth].
    #[arg(long, value_name = "TOPIC")]
    pub reference_topic: Option<String>,
    /// Whose poses the reference has, if its file does not say so: robot, laser, or a frame of the bag.
    #[arg(long, value_name = "WHOSE")]
    pub reference_frame: Option<Whose>,
    /// Whose poses the estimates have, if their files do not say so: robot, laser, or a frame of the bag.
    #[arg(long, value_name = "WHOSE")]
    pub estimate_frame: Option<Whose>,
    /// Topic of the estimate in a bag; may be given several times, for a row each [default: the only
    /// one].
    #[arg(long = "topic", value_name = "TOPIC")]
    pub topics: Vec<String>,
    /// Whose poses are compared: robot, laser, or a frame of a bag [default: those that both sides have; if they
    /// differ, the laser's].
    #[arg(long, value_name = "WHOSE")]
    pub frame: Option<Whose>,
    /// Where the laser is on the robot, in metres and radians, if no file says so.
    #[arg(long, value_name = "X,Y,THETA", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub mount: Option<[f64; 3]>,
    /// ξ of the weighted error √(ξ·δθ² + (1 − ξ)(δx² + δy²)).
    #[arg(long, default_value_t = DEFAULT_XI, value_name = "XI", value_parser = fraction)]
    pub xi: f64,
    /// How poses of both sides are matched in time.
    #[arg(long = "match", default_value = "nearest", value_name = "HOW")]
    pub match_by: MatchBy,
    /// Recorded poses form a pair if their stamps differ by at most this many seconds.
    #[arg(long, visible_alias = "max-difference", default_value_t = DEFAULT_TOLERANCE_S, value_name = "S", value_parser = non_negative)]
    pub tolerance: f64,
    /// The longest time between two poses to be interpolated over, and that counts as covered, in seconds
    /// [default: five usual intervals, at least 0.2].
    #[arg(long, value_name = "S", value_parser = positive)]
    pub longest_gap: Option<f64>,
    /// Seconds to be added to the estimates' stamps; auto searches for what brings the positions closest to the
    /// reference.
    #[arg(long, value_name = "S|auto")]
    pub offset: Option<TimeOffset>,
    /// Leave out what comes earlier than this many seconds after the reference's first pose.
    #[arg(long, value_name = "S", value_parser = non_negative)]
    pub start: Option<f64>,
    /// Leave out what comes later than this many seconds after the reference's first pose.
    #[arg(long, value_name = "S", value_parser = positive)]
    pub end: Option<f64>,
    /// Relative errors over these lengths, separated by commas: metres along the path, or 2s, 10f (frames), 30deg,
    /// 0.5rad.
    #[arg(long, visible_aliases = ["rpe-distance", "delta"], default_value = "1,5,10",
          value_delimiter = ',', value_name = "DELTA", value_parser = delta)]
    pub rpe: Vec<Delta>,
    /// The pairs of poses over which relative errors are taken.
    #[arg(long, default_value = "consecutive", value_name = "PAIRS")]
    pub rpe_pairs: RpePairs,
    /// The path along which these lengths are measured.
    #[arg(long, default_value = "reference", value_name = "PATH")]
    pub rpe_path: RpePath,
    /// Drop height, roll and pitch instead of refusing poses that are not in the plane.
    #[arg(long)]
    pub project: bool,
    /// Files have positions only: no heading errors, whatever stands in place of the headings.
    #[arg(long)]
    pub positions: bool,
    /// Read the quaternions of TUM files as w x y z where the robot would be upside down as x y z w.
    #[arg(long)]
    pub wxyz: bool,
    /// Move each estimate onto the reference before its absolute errors are taken: by the rigid motion that brings
    /// the positions closest (rigid, which --align alone means, or se2), or by its first pose (origin)
    /// [default: none].
    #[arg(long, value_name = "HOW", num_args = 0..=1, require_equals = true, default_value = "none",
          default_missing_value = "rigid", hide_default_value = true)]
    pub align: AlignTo,
    /// Write the error of every pair of poses into this file.
    #[arg(long, value_name = "FILE.csv")]
    pub errors: Option<PathBuf>,
    /// Write a table: .csv has a row per estimate with all figures, .md and .tex what is printed.
    #[arg(long, value_name = "FILE.csv|md|tex")]
    pub table: Option<PathBuf>,
    /// Draw the errors over time; for groups, the spread over runs and a box for each.
    #[arg(long, value_name = "FILE.svg|png|pdf")]
    pub plot: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        assert_eq!(delta("5"), Ok(Delta::Metres(5.0)));
        assert_eq!(delta("2.5s"), Ok(Delta::Seconds(2.5)));
        assert_eq!(delta("10f"), Ok(Delta::Frames(10)));
        assert_eq!(delta("180deg"), Ok(Delta::Radians(std::f64::consts::PI)));
        for text in ["", "m", "0", "-1", "1.5f", "181deg", "4rad", "1km", "nan"] {
            assert!(delta(text).is_err(), "{text}");
        }
    }

    #[test]
    fn offsets_and_groups() {
        assert_eq!("-0.5".parse(), Ok(TimeOffset::Seconds(-0.5)));
        assert_eq!("auto".parse(), Ok(TimeOffset::Auto));
        assert!("later".parse::<TimeOffset>().is_err());
        let group: Group = "nav2=runs/a=b/*.tum".parse().unwrap();
        assert_eq!((group.name.as_str(), group.runs.as_str()), ("nav2", "runs/a=b/*.tum"));
        assert!("nav2".parse::<Group>().is_err() && "=x".parse::<Group>().is_err());
    }
}
