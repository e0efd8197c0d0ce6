//! Pose errors of a run, and the four figures reported of them.

use std::fmt::Write;

use mcl_core::Pose2;
use mcl_metrics::{MetricsError, Summary, WeightedPoseError, pose_errors};
use serde::Serialize;

/// Errors of estimated poses, one entry per pose.
pub struct ErrorSamples {
    /// Weighted error (equation 7), radians and metres.
    pub weighted: Vec<f64>,
    /// Distance of the positions in metres.
    pub translation: Vec<f64>,
    /// |δθ| in radians.
    pub heading: Vec<f64>,
}

impl ErrorSamples {
    /// Errors of the estimate, pose by pose.
    pub fn of(
        reference: &[Pose2],
        estimate: &[Pose2],
        metric: &WeightedPoseError,
    ) -> Result<Self, MetricsError> {
        let errors = pose_errors(reference, estimate)?;
        Ok(ErrorSamples {
            weighted: errors.iter().map(|error| metric.of(error)).collect(),
            translation: errors.iter().map(|error| error.translation()).collect(),
            heading: errors.iter().map(|error| error.heading()).collect(),
        })
    }
}

/// The figures of a set of errors, in the unit of the errors.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Figures {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Root mean square.
    pub rmse: f64,
    /// Largest error.
    pub max: f64,
}

impl Figures {
    /// From the samples of one run.
    pub fn of(samples: &[f64]) -> Result<Self, MetricsError> {
        Ok(Summary::of(samples)?.into())
    }
}

impl From<Summary> for Figures {
    fn from(summary: Summary) -> Self {
        let Summary { mean, median, rmse, max, .. } = summary;
        Figures { mean, median, rmse, max }
    }
}

/// Figures of all three errors.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ErrorFigures {
    /// Weighted error (equation 7), radians and metres.
    pub weighted: Figures,
    /// Distance of the positions in metres.
    pub translation: Figures,
    /// |δθ| in radians.
    pub heading: Figures,
}

impl ErrorFigures {
    /// From the errors of all runs together; at least one run.
    pub fn pooled(runs: &[&ErrorSamples]) -> Result<Self, MetricsError> {
        let pooled = |samples: fn(&ErrorSamples) -> &[f64]| {
            let runs: Vec<&[f64]> = runs.iter().map(|run| samples(run)).collect();
            Summary::pooled(&runs).map(Figures::from)
        };
        Ok(ErrorFigures {
            weighted: pooled(|run| &run.weighted)?,
            translation: pooled(|run| &run.translation)?,
            heading: pooled(|run| &run.heading)?,
        })
    }

    /// [`figures_table`] of all three.
    pub fn table(&self) -> String {
        figures_table(Some(self.weighted), self.translation, Some(self.heading))
    }
}

/// A table of up to four lines, the heading in radians and in degrees.
pub fn figures_table(
    weighted: Option<Figures>,
    translation: Figures,
    heading: Option<Figures>,
) -> String {
    let mut text = table_head();
    for (name, figures) in [
        ("weighted error", weighted),
        ("translation, m", Some(translation)),
        ("heading, rad", heading),
        ("heading, °", heading.map(|heading| heading.map(f64::to_degrees))),
    ] {
        text.extend(figures.map(|figures| table_line(name, &figures)));
    }
    text
}

impl Figures {
    fn map(&self, change: fn(f64) -> f64) -> Figures {
        let Figures { mean, median, rmse, max } = *self;
        Figures { mean: change(mean), median: change(median), rmse: change(rmse), max: change(max) }
    }
}

/// The header line for [`table_line`].
fn table_head() -> String {
    format!("  {:<18}{:>10}{:>10}{:>10}{:>10}\n", "", "mean", "median", "rmse", "max")
}

/// The figures, aligned with the header.
pub fn table_line(name: &str, figures: &Figures) -> String {
    let mut line = format!("  {name:<18}");
    for value in [figures.mean, figures.median, figures.rmse, figures.max] {
        write!(line, "{value:>10.4}").expect("writing to a string does not fail");
    }
    line + "\n"
}
