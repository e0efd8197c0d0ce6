//! The figures of one estimate.

use std::collections::HashSet;

use anyhow::{Context, Result, bail};
use mcl_core::text::{counted, thousands};
use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::{
    Alignment, Delta, DivergenceSettings, LossSettings, LostEpisode, Matched, MetricsError,
    OffsetFound, PairsFrom, PoseError, RpeSettings, Side, Summary, TimeDifference,
    WeightedPoseError, associate, ate, coverage, diverged, find_offset, inside_ellipsoid_95,
    interpolate, lost_episodes, nees, pose_errors, rpe, shifted,
};
use serde::Serialize;

use super::frames::{self, compared};
use super::mounts::{Mounts, SideFrames, name_of};
use super::source::{TrajectoryInput, TrajectorySource};
use crate::cli::args::{AlignTo, EvaluateArgs, MatchBy, RpePairs, RpePath, TimeOffset};
use crate::pose_errors::{ErrorSamples, Figures};
use crate::progress::tell;

/// Smallest share of the reference's time and path that a complete estimate covers.
const WHOLE: f64 = 0.99;
/// An average time difference of pairs above this (s) is reported.
const FAR_IN_TIME: f64 = 1e-3;
/// The best offset is doubtful if another has an error of at most this many times its error.
const AS_GOOD: f64 = 1.5;

/// An estimate, with its figures or the reason why there are none.
#[derive(Serialize)]
pub struct Row {
    #[serde(flatten)]
    pub of: TrajectorySource,
    /// The group of the run; null outside of groups.
    pub group: Option<String>,
    /// Why there are no figures, with the name of the file; null where there are.
    pub failure: Option<String>,
    #[serde(flatten)]
    pub figures: Option<RowFigures>,
}

#[derive(Serialize)]
pub struct RowFigures {
    pub pairs: usize,
    /// Poses of either trajectory without a partner.
    pub unmatched: usize,
    unmatched_reference: usize,
    unmatched_estimate: usize,
    frames: FramesFigures,
    /// Offset added to the estimate's stamps (s).
    pub offset_s: f64,
    /// Time difference between the poses of a pair (s); null where one side was interpolated.
    time_difference: Option<TimeDifference>,
    pub coverage: CoverageFigures,
    /// Whether the mean error of the last 50 poses is above 1 m.
    pub diverged: bool,
    /// Times that the robot was lost, and times that it was found again.
    pub lost: usize,
    pub recovered: usize,
    pub with_missing: WithMissing,
    /// Null without headings.
    pub weighted: Option<Figures>,
    pub translation: Figures,
    /// Null without headings.
    pub heading: Option<Figures>,
    pub axes: Axes,
    /// Absolute trajectory error: distances between positions, in metres.
    pub ate: Summary,
    /// Relative pose errors; empty without headings.
    pub rpe: Vec<RpeFigures>,
    /// The rigid motion of `--align`; null without.
    pub reference_from_estimate: Option<Pose2>,
    /// Null where the estimate has no covariances.
    pub consistency: Option<ConsistencyFigures>,
}

#[derive(Serialize)]
struct FramesFigures {
    /// Whose poses were compared; null if not known.
    compared: Option<String>,
    reference: SideFrames,
    estimate: SideFrames,
}

/// Shares of the reference, from 0 to 1.
#[derive(Serialize)]
pub struct CoverageFigures {
    pub time: f64,
    pub path: f64,
}

/// Figures in which time not covered by the estimate counts as time in which the robot is lost.
#[derive(Serialize)]
pub struct WithMissing {
    /// Share of the reference's time.
    pub lost_share: f64,
    /// Percentiles of the distance between positions (m); null where they fall into missing time.
    pub median: Option<f64>,
    pub p95: Option<f64>,
}

/// Whether the estimate's covariances agree with its errors.
#[derive(Serialize)]
pub struct ConsistencyFigures {
    /// Poses with a covariance.
    pub poses: usize,
    pub median_nees: f64,
    /// Share of them whose reference lies in the 95 % ellipsoid.
    pub inside_95: f64,
}

/// Signed errors, estimate minus reference, in metres and radians.
#[derive(Serialize)]
pub struct Axes {
    pub x: AxisFigures,
    pub y: AxisFigures,
    /// Null without headings, as those along and across the heading of the reference.
    pub yaw: Option<AxisFigures>,
    pub longitudinal: Option<AxisFigures>,
    pub lateral: Option<AxisFigures>,
}

#[derive(Serialize)]
pub struct AxisFigures {
    /// The bias.
    pub mean: f64,
    pub std: f64,
    pub rmse: f64,
    /// Largest magnitude.
    pub max: f64,
}

#[derive(Serialize)]
pub struct RpeFigures {
    /// Distance between the poses of a pair, in its unit: m, s, frames, rad.
    pub delta: f64,
    pub unit: &'static str,
    /// `delta`, if it is in metres.
    distance_m: Option<f64>,
    /// Number of pairs of poses that far apart; without any there are no figures.
    pub pairs: usize,
    pub translation: Option<Figures>,
    pub heading: Option<Figures>,
}

/// A row of `--errors` for a pair of poses: metres and radians, estimate minus reference; empty without
/// headings.
#[derive(Serialize)]
pub struct ErrorRow<'a> {
    file: &'a str,
    /// Stamp of the estimate, in seconds, exact.
    stamp: String,
    dx: f64,
    dy: f64,
    dtheta: Option<f64>,
    weighted: Option<f64>,
    translation: f64,
    heading: Option<f64>,
    longitudinal: Option<f64>,
    lateral: Option<f64>,
    reference_stamp: String,
}

/// An estimate's figures, and the samples that they were computed from.
pub struct Evaluated {
    pub figures: RowFigures,
    pub sampled: Sampled,
    /// Whether nothing was assumed or left out.
    pub is_complete: bool,
}

/// Errors of an estimate, one per pair of poses.
pub struct Sampled {
    pub stamps: Vec<Stamp>,
    reference_stamps: Vec<Stamp>,
    errors: Vec<PoseError>,
    pub samples: ErrorSamples,
    pub has_headings: bool,
    /// The time of the first pose of the reference.
    pub begins: Stamp,
}

/// Compares an estimate with the reference.
pub fn evaluate(
    reference: &TrajectoryInput,
    source: &TrajectoryInput,
    metric: &WeightedPoseError,
    args: &EvaluateArgs,
    quiet: bool,
) -> Result<Evaluated> {
    let label = source.of.label();
    let given = args.mount.map(|[x, y, theta]| Mounts::of_laser(Pose2::new(x, y, theta)));
    let sides = compared(reference, source, args.frame.as_ref(), &given.unwrap_or_default())?;
    let alignment = match args.align {
        AlignTo::None => Alignment::None,
        AlignTo::Origin => Alignment::Origin,
        AlignTo::Rigid => Alignment::Rigid,
    };
    let mut is_complete = reference.is_complete && source.is_complete && sides.is_certain;
    if alignment == Alignment::None {
        is_complete &= frames::are_in_one_world(reference, source);
    }
    let offset_s = match args.offset {
        None => 0.0,
        Some(TimeOffset::Seconds(seconds)) => seconds,
        Some(TimeOffset::Auto) => {
            let found = find_offset(&sides.reference, &sides.estimate, alignment)
                .context("--offset auto")?;
            is_complete &= report_offset(&label, &found);
            found.offset_s
        }
    };
    let begins = first_stamp(&sides.reference).context("the reference has no pose")?;
    let (in_reference, _) = part(&sides.reference, begins, args);
    let (in_estimate, places) = match args.offset {
        None => part(&sides.estimate, begins, args),
        Some(_) => part(&shifted(&sides.estimate, offset_s)?, begins, args),
    };
    let matched = match args.match_by {
        MatchBy::Nearest => associate(&in_reference, &in_estimate, args.tolerance),
        MatchBy::Interpolate => interpolate(&in_reference, &in_estimate, args.longest_gap),
    }?;
    let has_headings = reference.has_headings && source.has_headings;
    let covered = coverage(&in_reference, &in_estimate, args.longest_gap)?;
    is_complete &= report_matched(&label, &matched, &in_reference, &in_estimate, quiet);
    is_complete &= report_covered(&label, [covered.time, covered.path], &covered.gaps, begins);

    let Matched { reference: in_reference, estimate: in_estimate, .. } = &matched;
    let absolute = ate(in_reference.poses(), in_estimate.poses(), alignment)?;
    let motion = absolute.reference_from_estimate;
    let aligned: Vec<Pose2> = match alignment {
        Alignment::None => in_estimate.poses().to_vec(),
        _ => in_estimate.poses().iter().map(|pose| motion.compose(pose)).collect(),
    };
    let errors = pose_errors(in_reference.poses(), &aligned)?;
    let samples = ErrorSamples::of(in_reference.poses(), &aligned, metric)?;
    let episodes = lost_episodes(&samples.translation, &LossSettings::default())?;
    let relative = |delta: &Delta| RpeFigures::of(&matched, *delta, args);
    let with_headings = |samples: &[f64]| match has_headings {
        true => Figures::of(samples).map(Some),
        false => Ok(None),
    };
    let figures = RowFigures {
        pairs: in_estimate.len(),
        unmatched: matched.unmatched_reference + matched.unmatched_estimate,
        unmatched_reference: matched.unmatched_reference,
        unmatched_estimate: matched.unmatched_estimate,
        frames: FramesFigures {
            compared: sides.whose.as_ref().map(name_of),
            reference: reference.frames(),
            estimate: source.frames(),
        },
        offset_s,
        time_difference: matched.time_difference,
        coverage: CoverageFigures { time: covered.time, path: covered.path },
        diverged: diverged(&samples.translation, &DivergenceSettings::default())?,
        lost: episodes.len(),
        recovered: episodes.iter().filter(|episode| episode.recovered.is_some()).count(),
        with_missing: WithMissing::of(&samples.translation, &episodes, covered.time),
        weighted: with_headings(&samples.weighted)?,
        translation: Figures::of(&samples.translation)?,
        heading: with_headings(&samples.heading)?,
        axes: Axes::of(&errors, has_headings)?,
        ate: Summary::of(&absolute.translation)?,
        rpe: match has_headings {
            true => args.rpe.iter().map(relative).collect::<Result<_, _>>()?,
            false => Vec::new(),
        },
        reference_from_estimate: (alignment != Alignment::None).then_some(motion),
        consistency: consistency(&matched, source, &places, sides.to_estimated, motion),
    };
    let (stamps, reference_stamps) =
        (in_estimate.stamps().to_vec(), in_reference.stamps().to_vec());
    let sampled = Sampled { stamps, reference_stamps, errors, samples, has_headings, begins };
    Ok(Evaluated { figures, sampled, is_complete })
}

fn first_stamp(trajectory: &Trajectory) -> Option<Stamp> {
    trajectory.stamps().iter().min().copied()
}

/// The requested part of a trajectory, and the indices of its poses.
fn part(trajectory: &Trajectory, begins: Stamp, args: &EvaluateArgs) -> (Trajectory, Vec<usize>) {
    let is_asked = |(_, (stamp, _)): &(usize, (Stamp, Pose2))| {
        let at = stamp.seconds_since(begins);
        args.start.is_none_or(|start| at >= start) && args.end.is_none_or(|end| at <= end)
    };
    let poses = trajectory.iter().enumerate().filter(is_asked);
    let (places, poses): (Vec<usize>, Vec<(Stamp, Pose2)>) = poses.unzip();
    (poses.into_iter().collect(), places)
}

/// Reports the offset found, and returns whether it is unambiguous.
fn report_offset(label: &str, found: &OffsetFound) -> bool {
    let OffsetFound { offset_s, rmse_m, pairs, runner_up } = found;
    tell!(
        "note: {label}: {offset_s:+.4} s are added to its stamps, which brings {} within \
         {rmse_m:.4} m of the reference (RMS)",
        counted(*pairs, "position")
    );
    let Some((other_s, other_m)) = runner_up.filter(|(_, other)| *other <= AS_GOOD * rmse_m) else {
        return true;
    };
    tell!(
        "warning: {label}: {other_s:+.4} s are about as good ({other_m:.4} m), as the path repeats itself; give the offset with --offset S if it is known"
    );
    false
}

/// Reports remarkable facts about the matching; returns false if stamps do not identify poses.
fn report_matched(
    label: &str,
    matched: &Matched,
    reference: &Trajectory,
    estimate: &Trajectory,
    quiet: bool,
) -> bool {
    let backward = |trajectory: &Trajectory| {
        trajectory.stamps().windows(2).filter(|pair| pair[1] < pair[0]).count()
    };
    let (of_reference, of_estimate) = (backward(reference), backward(estimate));
    if of_reference + of_estimate > 0 && !quiet {
        let order = match matched.sorted_by_time || of_estimate == 0 {
            true => "of time",
            false => "of the files, which is the same in both",
        };
        tell!(
            "note: {label}: {of_estimate} of its stamps and {of_reference} of the reference's step back in time; poses are taken in the order {order}"
        );
    }
    if let Some(apart) = matched.time_difference
        && apart.mean_s > FAR_IN_TIME
        && !quiet
    {
        tell!(
            "note: {label}: the poses of a pair are {:.1} ms apart on average, {:.1} ms at most; --match interpolate takes both sides at the same times",
            1e3 * apart.mean_s,
            1e3 * apart.max_s
        );
    }
    let (sampled, other, indices) = match matched.sampled {
        Side::Reference => (reference, estimate, &matched.reference_indices),
        Side::Estimate => (estimate, reference, &matched.estimate_indices),
    };
    // Poses before or after the other side cannot be matched; coverage reports what is missing of the
    // reference.
    let span = other.stamps().iter().min().zip(other.stamps().iter().max());
    let partners: HashSet<usize> = indices.iter().flatten().copied().collect();
    let is_within = |stamp: &Stamp| span.is_some_and(|(from, to)| (from..=to).contains(&stamp));
    let within: Vec<usize> =
        (0..sampled.len()).filter(|&place| is_within(&sampled.stamps()[place])).collect();
    let samples = within.len();
    let unmatched = within.iter().filter(|place| !partners.contains(place)).count();
    let is_matched = unmatched as f64 <= (1.0 - WHOLE) * samples as f64;
    if !is_matched {
        tell!(
            "warning: {label}: {} of {} that lie in the time of the other side have no match there: the errors \
             are those of {}",
            thousands(unmatched),
            match matched.sampled {
                Side::Reference => format!("the reference's {}", counted(samples, "pose")),
                Side::Estimate => format!("its {}", counted(samples, "pose")),
            },
            counted(matched.estimate.len(), "pair")
        );
    }
    let repeats = |trajectory: &Trajectory| {
        let mut stamps = trajectory.stamps().to_vec();
        stamps.sort_unstable();
        stamps.windows(2).filter(|pair| pair[0] == pair[1]).count()
    };
    let (repeated, repeated_reference) = (repeats(estimate), repeats(reference));
    if repeated == 0 && repeated_reference == 0 || has_same_stamps(reference, estimate) {
        return is_matched;
    }
    tell!(
        "warning: {label}: its stamps do not identify its poses: {repeated} of its {} stamps and \
         {repeated_reference} of the reference's {} repeat another one. Poses of one stamp are paired in \
         their order, which may be wrong by the time that the stamps leave open",
        estimate.len(),
        reference.len()
    );
    false
}

/// Whether both sides have the same number of poses at every stamp, so that they can be matched in order.
fn has_same_stamps(reference: &Trajectory, estimate: &Trajectory) -> bool {
    let sorted = |trajectory: &Trajectory| {
        let mut stamps = trajectory.stamps().to_vec();
        stamps.sort_unstable();
        stamps
    };
    sorted(reference) == sorted(estimate)
}

/// Reports which part of the reference is not covered; returns whether that is negligible.
fn report_covered(
    label: &str,
    [time, path]: [f64; 2],
    gaps: &[(Stamp, Stamp)],
    begins: Stamp,
) -> bool {
    if time >= WHOLE && path >= WHOLE {
        return true;
    }
    let at = |stamp: Stamp| format!("{:.1}", stamp.seconds_since(begins));
    let length = |(from, to): &&(Stamp, Stamp)| to.seconds_since(*from);
    let longest = gaps.iter().max_by(|a, b| length(a).total_cmp(&length(b)));
    let missing = longest.map(|(from, to)| {
        format!("; the longest part that is missing lasts from {} s to {} s", at(*from), at(*to))
    });
    tell!(
        "warning: {label}: it covers {:.1} % of the reference's time and {:.1} % of its path{}: errors \
         refer to the covered part",
        100.0 * time,
        100.0 * path,
        missing.unwrap_or_default()
    );
    false
}

/// Agreement of the errors with the estimate's covariances, in the estimate's own frames.
fn consistency(
    matched: &Matched,
    source: &TrajectoryInput,
    places: &[usize],
    to_estimated: Pose2,
    reference_from_estimate: Pose2,
) -> Option<ConsistencyFigures> {
    let indices = matched.estimate_indices.as_ref()?;
    let estimate_from_reference = reference_from_estimate.inverse();
    let mut values = Vec::new();
    let pairs = matched.reference.poses().iter().zip(matched.estimate.poses());
    for ((reference, estimate), &index) in pairs.zip(indices) {
        let Some(Some(covariance)) = source.covariances.get(places[index]) else { continue };
        let reference = estimate_from_reference.compose(reference).compose(&to_estimated);
        let PoseError { dx, dy, dtheta, .. } =
            PoseError::between(&reference, &estimate.compose(&to_estimated));
        values.extend(nees([dx, dy, dtheta], *covariance));
    }
    let summary = Summary::of(&values).ok()?;
    let inside = values.iter().filter(|value| inside_ellipsoid_95(**value)).count();
    Some(ConsistencyFigures {
        poses: values.len(),
        median_nees: summary.median,
        inside_95: inside as f64 / values.len() as f64,
    })
}

impl WithMissing {
    fn of(translation: &[f64], episodes: &[LostEpisode], covered: f64) -> Self {
        let poses = translation.len();
        let lost = |episode: &LostEpisode| episode.recovered.unwrap_or(poses) - episode.start;
        let lost: usize = episodes.iter().map(lost).sum();
        let mut sorted = translation.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        // Missing time counts as farther off than everything else.
        let percentile = |share: f64| {
            let place = (share / covered * poses as f64).ceil() as usize;
            (share <= covered).then(|| sorted[place.clamp(1, poses) - 1])
        };
        WithMissing {
            lost_share: 1.0 - covered * (1.0 - lost as f64 / poses as f64),
            median: percentile(0.5),
            p95: percentile(0.95),
        }
    }
}

impl Axes {
    fn of(errors: &[PoseError], has_headings: bool) -> Result<Self, MetricsError> {
        let of = |axis: fn(&PoseError) -> f64| AxisFigures::of(errors, axis);
        let with_headings = |axis: fn(&PoseError) -> f64| match has_headings {
            true => of(axis).map(Some),
            false => Ok(None),
        };
        Ok(Axes {
            x: of(|error| error.dx)?,
            y: of(|error| error.dy)?,
            yaw: with_headings(|error| error.dtheta)?,
            longitudinal: with_headings(|error| error.longitudinal)?,
            lateral: with_headings(|error| error.lateral)?,
        })
    }
}

impl AxisFigures {
    fn of(errors: &[PoseError], axis: fn(&PoseError) -> f64) -> Result<Self, MetricsError> {
        let samples: Vec<f64> = errors.iter().map(axis).collect();
        let Summary { mean, std, rmse, min, max, .. } = Summary::of(&samples)?;
        Ok(AxisFigures { mean, std, rmse, max: max.abs().max(min.abs()) })
    }
}

impl RpeFigures {
    /// Relative errors over a length. A shorter path has none; that is not an error.
    fn of(matched: &Matched, delta: Delta, args: &EvaluateArgs) -> Result<Self> {
        let settings = RpeSettings {
            all_pairs: args.rpe_pairs == RpePairs::All,
            pairs_from: match args.rpe_path {
                RpePath::Reference => PairsFrom::Reference,
                RpePath::Estimate => PairsFrom::Estimate,
            },
            ..RpeSettings::new(delta)
        };
        let (value, unit) = match delta {
            Delta::Metres(metres) => (metres, "m"),
            Delta::Seconds(seconds) => (seconds, "s"),
            Delta::Frames(frames) => (frames as f64, "frames"),
            Delta::Radians(radians) => (radians, "rad"),
        };
        let distance_m = matches!(delta, Delta::Metres(_)).then_some(value);
        let mut figures = RpeFigures {
            delta: value,
            unit,
            distance_m,
            pairs: 0,
            translation: None,
            heading: None,
        };
        match rpe(&matched.reference, &matched.estimate, &settings) {
            Ok(found) => {
                figures.pairs = found.pairs.len();
                figures.translation = Some(Figures::of(&found.translation)?);
                figures.heading = Some(Figures::of(&found.rotation)?);
            }
            Err(MetricsError::NoPairs { .. }) => {}
            Err(error) => bail!(error),
        }
        Ok(figures)
    }
}

impl Sampled {
    /// A row per pair.
    pub fn rows<'a>(&'a self, file: &'a str) -> impl Iterator<Item = ErrorRow<'a>> {
        let with_headings = |value: f64| self.has_headings.then_some(value);
        (0..self.errors.len()).map(move |pair| {
            let PoseError { dx, dy, dtheta, longitudinal, lateral } = self.errors[pair];
            ErrorRow {
                file,
                stamp: self.stamps[pair].to_string(),
                dx,
                dy,
                dtheta: with_headings(dtheta),
                weighted: with_headings(self.samples.weighted[pair]),
                translation: self.samples.translation[pair],
                heading: with_headings(self.samples.heading[pair]),
                longitudinal: with_headings(longitudinal),
                lateral: with_headings(lateral),
                reference_stamp: self.reference_stamps[pair].to_string(),
            }
        })
    }
}
