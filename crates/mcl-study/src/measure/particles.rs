//! The number of particles of the filter.

use anyhow::Result;

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// The mean over the run's scans.
pub const PARTICLES: RunMeasure =
    RunMeasure { name: "particles", columns: &["mean_particles"], measure };

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let reports = context.tracked.reports();
    let sum: usize = reports.iter().map(|report| report.particles).sum();
    Ok(vec![(sum as f64 / reports.len() as f64).into()])
}
