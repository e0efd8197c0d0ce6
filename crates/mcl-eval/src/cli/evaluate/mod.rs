//! `evaluate`: how far estimated trajectories are from a reference.

mod figure;
mod text;
mod trajectory;

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::{
    Alignment, Delta, Matched, MetricsError, PoseError, RpeSettings, Summary, WeightedPoseError,
    associate, ate, pose_errors, rpe,
};
use serde::Serialize;

use super::Outcome;
use super::args::{AlignTo, EvaluateArgs, Global};
use super::errors::{ErrorFigures, ErrorSamples, Figures};
use super::output::{input_files, prepare, print, write_rows};
use crate::progress::tell;
use mcl_figures::check_figure_ending;
use trajectory::{Named, Source};

#[derive(Serialize)]
struct Evaluation<'a> {
    /// What the errors are taken against, and whose poses it has.
    reference: String,
    estimates: Vec<&'a Row>,
}

#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    of: Named,
    pairs: usize,
    /// Poses of either trajectory without a partner.
    unmatched: usize,
    unmatched_reference: usize,
    unmatched_estimate: usize,
    #[serde(flatten)]
    errors: ErrorFigures,
    axes: Axes,
    /// Of the distances between positions, in metres.
    ate: Figures,
    rpe: Vec<RpeFigures>,
    /// The rigid motion of `--align`; null without.
    reference_from_estimate: Option<Pose2>,
}

/// Signed errors, estimate minus reference, in metres and radians.
#[derive(Serialize)]
struct Axes {
    x: AxisFigures,
    y: AxisFigures,
    yaw: AxisFigures,
    /// Along and across the heading of the reference.
    longitudinal: AxisFigures,
    lateral: AxisFigures,
}

#[derive(Serialize)]
struct AxisFigures {
    /// The bias.
    mean: f64,
    std: f64,
    rmse: f64,
    /// Largest magnitude.
    max: f64,
}

#[derive(Serialize)]
struct RpeFigures {
    distance_m: f64,
    /// Pairs of poses that far apart; with none there are no figures.
    pairs: usize,
    translation: Option<Figures>,
    heading: Option<Figures>,
}

/// A row of `--errors`, a pair of poses: metres and radians, estimate minus reference.
#[derive(Serialize)]
struct ErrorRow<'a> {
    file: &'a str,
    /// Of the estimate, in seconds, exact.
    stamp: String,
    dx: f64,
    dy: f64,
    dtheta: f64,
    weighted: f64,
    translation: f64,
    heading: f64,
    longitudinal: f64,
    lateral: f64,
    reference_stamp: String,
}

/// An estimate's figures and the samples they are of, one per pair.
struct Evaluated {
    row: Row,
    stamps: Vec<Stamp>,
    reference_stamps: Vec<Stamp>,
    errors: Vec<PoseError>,
    samples: ErrorSamples,
}

pub fn run(args: &EvaluateArgs, global: &Global) -> Result<Outcome> {
    let metric = WeightedPoseError::new(args.xi)?;
    if let Some(path) = &args.plot {
        check_figure_ending(path)?;
    }
    let read = args.estimates.iter().chain([&args.reference]).map(String::as_str);
    prepare(args.errors.iter().chain(&args.plot), &input_files(read))?;
    let reference = trajectory::reference(args, global)?;
    let sources = trajectory::estimates(args, global)?;
    let mut is_complete = reference.is_complete;
    let mut estimates = Vec::new();
    for source in &sources {
        let estimate = evaluate(&reference, source, &metric, args)
            .with_context(|| format!("{} against {}", source.of.label(), reference.of.label()))?;
        let row = &estimate.row;
        if row.unmatched > 0 {
            tell!(
                "warning: {}: {} of {} poses, and {} of the reference's {}, match none of the other \
                 within {} s: the errors are those of {} pairs",
                source.of.label(),
                row.unmatched_estimate,
                source.trajectory.len(),
                row.unmatched_reference,
                reference.trajectory.len(),
                args.tolerance,
                row.pairs
            );
        }
        let is_told_apart = stamps_tell(&reference, source);
        is_complete &= source.is_complete && row.unmatched == 0 && is_told_apart;
        estimates.push(estimate);
    }
    if let Some(path) = &args.errors {
        let labels: Vec<String> =
            estimates.iter().map(|estimate| estimate.row.of.label()).collect();
        let rows: Vec<ErrorRow<'_>> =
            estimates.iter().zip(&labels).flat_map(|(e, label)| e.rows(label)).collect();
        write_rows(path, &rows)?;
    }
    if let Some(path) = &args.plot {
        figure::draw(path, &reference.of.label(), &estimates)?;
    }
    let rows = estimates.iter().map(|estimate| &estimate.row).collect();
    let found = Evaluation { reference: reference.describe(), estimates: rows };
    print(args.json, &found, |found| {
        format!("{}\nreference: {}", text::text(&found.estimates).trim_end(), found.reference)
    })?;
    Ok(Outcome::of(is_complete))
}

/// Whether stamps tell which poses are of one time. Poses of one stamp are paired in their order, which is right only
/// where both trajectories have the same number of them.
fn stamps_tell(reference: &Source, source: &Source) -> bool {
    let counts = |source: &Source| {
        let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
        for stamp in source.trajectory.stamps() {
            *counts.entry(stamp.nanoseconds()).or_default() += 1;
        }
        counts
    };
    let (of_reference, of_estimate) = (counts(reference), counts(source));
    let differs = |(stamp, &count): (&i64, &usize)| {
        let there = of_reference.get(stamp).copied().unwrap_or(0);
        there > 0 && there != count && there.max(count) > 1
    };
    let doubtful = of_estimate.iter().filter(|&(stamp, count)| differs((stamp, count))).count();
    if doubtful > 0 {
        let poses = |source: &Source, counts: &BTreeMap<i64, usize>| {
            format!("{} poses at {} stamps", source.trajectory.len(), counts.len())
        };
        tell!(
            "warning: {}: stamps cannot tell its poses apart, and the reference has other numbers of poses at {} of them: they are paired in their order, which may shift them all ({}; the reference {})",
            source.of.label(),
            doubtful,
            poses(source, &of_estimate),
            poses(reference, &of_reference)
        );
    }
    doubtful == 0
}

fn evaluate(
    reference: &Source,
    source: &Source,
    metric: &WeightedPoseError,
    args: &EvaluateArgs,
) -> Result<Evaluated> {
    let mount = source.robot_from_laser.or(reference.robot_from_laser);
    let of_reference = reference.poses_of(args.frame, mount)?;
    let of_estimate = source.poses_of(args.frame, mount)?;
    let matched = associate(&of_reference, &of_estimate, args.tolerance)?;
    let Matched { reference, estimate, .. } = &matched;
    let alignment = match args.align {
        AlignTo::None => Alignment::None,
        AlignTo::Origin => Alignment::Origin,
        AlignTo::Rigid => Alignment::Rigid,
    };
    let absolute = ate(reference.poses(), estimate.poses(), alignment)?;
    let motion = absolute.reference_from_estimate;
    let aligned: Vec<Pose2> = match alignment {
        Alignment::None => estimate.poses().to_vec(),
        _ => estimate.poses().iter().map(|pose| motion.compose(pose)).collect(),
    };
    let errors = pose_errors(reference.poses(), &aligned)?;
    let samples = ErrorSamples::of(reference.poses(), &aligned, metric)?;
    let relative = |&distance: &f64| relative_errors(reference, estimate, distance);
    let row = Row {
        of: source.of.clone(),
        pairs: matched.estimate.len(),
        unmatched: matched.unmatched_reference + matched.unmatched_estimate,
        unmatched_reference: matched.unmatched_reference,
        unmatched_estimate: matched.unmatched_estimate,
        errors: ErrorFigures::pooled(&[&samples])?,
        axes: Axes {
            x: AxisFigures::of(&errors, |error| error.dx)?,
            y: AxisFigures::of(&errors, |error| error.dy)?,
            yaw: AxisFigures::of(&errors, |error| error.dtheta)?,
            longitudinal: AxisFigures::of(&errors, |error| error.longitudinal)?,
            lateral: AxisFigures::of(&errors, |error| error.lateral)?,
        },
        ate: Figures::of(&absolute.translation)?,
        rpe: args.rpe_distances.iter().map(relative).collect::<Result<_, _>>()?,
        reference_from_estimate: (alignment != Alignment::None).then_some(motion),
    };
    let (stamps, reference_stamps) = (estimate.stamps().to_vec(), reference.stamps().to_vec());
    Ok(Evaluated { row, stamps, reference_stamps, errors, samples })
}

/// Relative errors over a distance along the path. A path that is shorter has none; that is no error.
fn relative_errors(
    reference: &Trajectory,
    estimate: &Trajectory,
    distance_m: f64,
) -> Result<RpeFigures, MetricsError> {
    match rpe(reference, estimate, &RpeSettings::new(Delta::Metres(distance_m))) {
        Ok(found) => Ok(RpeFigures {
            distance_m,
            pairs: found.pairs.len(),
            translation: Some(Figures::of(&found.translation)?),
            heading: Some(Figures::of(&found.rotation)?),
        }),
        Err(MetricsError::NoPairs { .. }) => {
            Ok(RpeFigures { distance_m, pairs: 0, translation: None, heading: None })
        }
        Err(error) => Err(error),
    }
}

impl AxisFigures {
    fn of(errors: &[PoseError], axis: fn(&PoseError) -> f64) -> Result<Self, MetricsError> {
        let samples: Vec<f64> = errors.iter().map(axis).collect();
        let Summary { mean, std, rmse, min, max, .. } = Summary::of(&samples)?;
        Ok(AxisFigures { mean, std, rmse, max: max.abs().max(min.abs()) })
    }
}

impl Evaluated {
    fn rows<'a>(&'a self, file: &'a str) -> impl Iterator<Item = ErrorRow<'a>> {
        (0..self.errors.len()).map(move |pair| {
            let PoseError { dx, dy, dtheta, longitudinal, lateral } = self.errors[pair];
            ErrorRow {
                file,
                stamp: self.stamps[pair].to_string(),
                dx,
                dy,
                dtheta,
                weighted: self.samples.weighted[pair],
                translation: self.samples.translation[pair],
                heading: self.samples.heading[pair],
                longitudinal,
                lateral,
                reference_stamp: self.reference_stamps[pair].to_string(),
            }
        })
    }
}
