use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::{Pose2, Trajectory};
use mcl_metrics::tum::{self, NonPlanar};
use mcl_metrics::{
    Alignment, Delta, MetricsError, RpeSettings, Summary, WeightedPoseError, associate, ate, rpe,
};
use serde::Serialize;

use super::Outcome;
use super::args::{EvaluateArgs, Global};
use super::errors::{ErrorFigures, ErrorSamples, Figures, table_line};
use super::output::{print, thousands};

#[derive(Serialize)]
struct Evaluation {
    estimates: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    file: String,
    pairs: usize,
    /// Poses of either trajectory without a partner.
    unmatched: usize,
    unmatched_reference: usize,
    unmatched_estimate: usize,
    #[serde(flatten)]
    errors: ErrorFigures,
    ate: AteFigures,
    rpe: Vec<RpeFigures>,
    /// The rigid motion of `--align`; null without.
    reference_from_estimate: Option<Pose2>,
}

/// Of the distances between positions, in metres.
#[derive(Serialize)]
struct AteFigures {
    rmse: f64,
    mean: f64,
    median: f64,
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

pub fn run(args: &EvaluateArgs, global: &Global) -> Result<Outcome> {
    let metric = WeightedPoseError::new(args.xi)?;
    let non_planar = if args.project { NonPlanar::Project } else { NonPlanar::Refuse };
    let read = |path: &Path| tum::read_file(path, non_planar);
    let reference = read(&args.reference)?;
    if reference.backward_stamps > 0 && !global.quiet {
        eprintln!(
            "note: {}: {} stamps step back in time; poses are taken in the order of the file",
            args.reference.display(),
            reference.backward_stamps
        );
    }
    let mut estimates = Vec::new();
    for file in &args.estimates {
        let estimate = read(file)?;
        let row = evaluate(&reference.trajectory, &estimate.trajectory, &metric, args, file)
            .with_context(|| format!("{} against {}", file.display(), args.reference.display()))?;
        if row.unmatched > 0 {
            eprintln!(
                "warning: {}: {} of {} poses, and {} of the reference's {}, match none of the other \
                 within {} s: the errors are those of {} pairs",
                row.file,
                row.unmatched_estimate,
                estimate.trajectory.len(),
                row.unmatched_reference,
                reference.trajectory.len(),
                args.tolerance,
                row.pairs
            );
        }
        estimates.push(row);
    }
    let complete = estimates.iter().all(|row| row.unmatched == 0);
    print(args.json, &Evaluation { estimates }, text)?;
    Ok(Outcome::of(complete))
}

fn evaluate(
    reference: &Trajectory,
    estimate: &Trajectory,
    metric: &WeightedPoseError,
    args: &EvaluateArgs,
    file: &Path,
) -> Result<Row, MetricsError> {
    let matched = associate(reference, estimate, args.tolerance)?;
    let (reference, estimate) = (matched.reference.poses(), matched.estimate.poses());
    let alignment = if args.align { Alignment::Rigid } else { Alignment::None };
    let absolute = ate(reference, estimate, alignment)?;
    let errors = match args.align {
        false => ErrorSamples::of(reference, estimate, metric)?,
        true => {
            let motion = absolute.reference_from_estimate;
            let aligned: Vec<Pose2> = estimate.iter().map(|pose| motion.compose(pose)).collect();
            ErrorSamples::of(reference, &aligned, metric)?
        }
    };
    let Summary { rmse, mean, median, max, .. } = Summary::of(&absolute.translation)?;
    let relative = |&distance: &f64| relative_errors(reference, estimate, distance);
    Ok(Row {
        file: file.display().to_string(),
        pairs: matched.estimate.len(),
        unmatched: matched.unmatched_reference + matched.unmatched_estimate,
        unmatched_reference: matched.unmatched_reference,
        unmatched_estimate: matched.unmatched_estimate,
        errors: ErrorFigures::pooled(&[&errors])?,
        ate: AteFigures { rmse, mean, median, max },
        rpe: args.rpe_distances.iter().map(relative).collect::<Result<_, _>>()?,
        reference_from_estimate: args.align.then_some(absolute.reference_from_estimate),
    })
}

/// Relative errors over a distance along the path. A path that is shorter has none; that is no error.
fn relative_errors(
    reference: &[Pose2],
    estimate: &[Pose2],
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

fn text(found: &Evaluation) -> String {
    let rows: Vec<String> = found.estimates.iter().map(row_text).collect();
    rows.join("\n")
}

fn row_text(row: &Row) -> String {
    let mut text = format!(
        "{}: {} pairs, {} poses unmatched\n",
        row.file,
        thousands(row.pairs),
        thousands(row.unmatched)
    );
    if let Some(motion) = row.reference_from_estimate {
        text += &format!(
            "  aligned: moved by ({:.4}, {:.4}) m, turned by {:.3}°\n",
            motion.x,
            motion.y,
            motion.theta.to_degrees()
        );
    }
    text += &row.errors.table();
    for relative in &row.rpe {
        let distance = relative.distance_m;
        match (&relative.translation, &relative.heading) {
            (Some(translation), Some(heading)) => {
                text += &table_line(&format!("over {distance} m, m"), translation);
                text += &table_line(&format!("over {distance} m, rad"), heading);
            }
            _ => text += &format!("  over {distance} m: the path is shorter\n"),
        }
    }
    text
}
