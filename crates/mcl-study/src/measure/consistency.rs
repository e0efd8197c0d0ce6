//! Whether the filter's covariance agrees with its errors.

use anyhow::Result;
use mcl_core::Pose2;
use mcl_filter::StepReport;
use mcl_metrics::{PoseError, inside_ellipsoid_95, nees};
use serde::Serialize;

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Mean and median of the normalized estimation error squared (3 and 2.37 for a consistent filter), the share
/// of scans whose reference lies in the 95 % ellipsoid of the estimate, mean ln evidence of a scan, and mean
/// share of beams that the map explains. Scans with a singular covariance do not count for the first three,
/// those without used beams not for the last two. A single scan after which one particle has all the weight
/// dominates the mean, but not the median.
/// mean, not the median.
pub const CONSISTENCY: RunMeasure = RunMeasure {
    name: "consistency",
    columns: &["nees", "median_nees", "inside_95", "log_evidence", "explained_beams"],
    measure,
};

/// The filter's consistency over scans; `None` without any.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean normalized estimation error squared.
    pub nees: Option<f64>,
    /// Its median.
    pub median_nees: Option<f64>,
    /// Share of scans whose reference lies in the 95 % ellipsoid.
    pub inside_95: Option<f64>,
    /// Mean ln of the evidence of a scan.
    pub log_evidence: Option<f64>,
    /// Mean share of the beams that the map explains.
    pub explained_beams: Option<f64>,
}

/// The sums behind [`Consistency`].
#[derive(Debug, Clone, Default)]
pub struct Tally {
    nees: Vec<f64>,
    log_evidence: Vec<f64>,
    explained_beams: Vec<f64>,
}

impl Tally {
    /// Adds a scan, with its [`scan_nees`] if it has one.
    pub fn add(&mut self, report: &StepReport, nees: Option<f64>) {
        self.nees.extend(nees);
        self.log_evidence.extend((report.used_beams > 0).then_some(report.log_evidence));
        self.explained_beams.extend(report.explained_beams);
    }

    /// Adds the scans of another run.
    pub fn merge(&mut self, other: &Tally) {
        self.nees.extend(&other.nees);
        self.log_evidence.extend(&other.log_evidence);
        self.explained_beams.extend(&other.explained_beams);
    }

    /// Means, median and share so far.
    pub fn summary(&self) -> Consistency {
        let mean = |values: &[f64]| match values {
            [] => None,
            values => Some(values.iter().sum::<f64>() / values.len() as f64),
        };
        let mut sorted = self.nees.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let inside: Vec<f64> =
            sorted.iter().map(|&nees| f64::from(u8::from(inside_ellipsoid_95(nees)))).collect();
        Consistency {
            nees: mean(&self.nees),
            median_nees: sorted.get(sorted.len() / 2).copied(),
            inside_95: mean(&inside),
            log_evidence: mean(&self.log_evidence),
            explained_beams: mean(&self.explained_beams),
        }
    }
}

/// Normalized estimation error squared of a scan, from the reference pose of the laser; `None` where the
/// covariance is singular.
pub fn scan_nees(reference: &Pose2, report: &StepReport, laser_from_robot: &Pose2) -> Option<f64> {
    // The filter's covariance is that of the robot, the reference that of the laser.
    let map_from_robot = reference.compose(laser_from_robot);
    let error = PoseError::between(&map_from_robot, &report.estimate.map_from_robot);
    let covariance = &report.estimate.covariance;
    let rows = std::array::from_fn(|row| std::array::from_fn(|c| covariance[(row, c)]));
    nees([error.dx, error.dy, error.dtheta], rows)
}

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let RunContext { tracked, laser_from_robot, .. } = context;
    let mut tally = Tally::default();
    for (reference, report) in tracked.reference.iter().zip(tracked.reports()) {
        tally.add(report, scan_nees(reference, report, laser_from_robot));
    }
    let Consistency { nees, median_nees, inside_95, log_evidence, explained_beams } =
        tally.summary();
    Ok([nees, median_nees, inside_95, log_evidence, explained_beams].map(Value::from).to_vec())
}
