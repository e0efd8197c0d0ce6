//! Whether the filter knows how sure it may be.

use anyhow::Result;
use mcl_core::Pose2;
use mcl_filter::StepReport;
use mcl_metrics::{PoseError, inside_ellipsoid_95, nees};
use serde::Serialize;

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Mean normalized estimation error squared (3 for a filter that is right about itself), the share of scans whose
/// reference lies in the 95 % ellipsoid of the estimate, mean ln evidence of a scan, and mean share of beams
/// that the map explains. Scans whose covariance is singular have neither of the first two, those without
/// used beams none of the last two.
pub const CONSISTENCY: RunMeasure = RunMeasure {
    name: "consistency",
    columns: &["nees", "inside_95", "log_evidence", "explained_beams"],
    measure,
};

/// What the filter said of itself, as means over scans; `None` over none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Normalized estimation error squared.
    pub nees: Option<f64>,
    /// Share of scans whose reference lies in the 95 % ellipsoid.
    pub inside_95: Option<f64>,
    /// ln of the evidence of a scan.
    pub log_evidence: Option<f64>,
    /// Share of the beams that the map explains.
    pub explained_beams: Option<f64>,
}

/// Sums that [`Consistency`] is the means of.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    nees: Sum,
    inside: Sum,
    log_evidence: Sum,
    explained_beams: Sum,
}

impl Tally {
    /// Takes in a scan, with its [`scan_nees`] if it has one.
    pub fn add(&mut self, report: &StepReport, nees: Option<f64>) {
        if let Some(nees) = nees {
            self.nees.add(nees);
            self.inside.add(f64::from(u8::from(inside_ellipsoid_95(nees))));
        }
        if report.used_beams > 0 {
            self.log_evidence.add(report.log_evidence);
        }
        if let Some(share) = report.explained_beams {
            self.explained_beams.add(share);
        }
    }

    /// Takes in the scans of another run.
    pub fn merge(&mut self, other: &Tally) {
        let Tally { nees, inside, log_evidence, explained_beams } = self;
        nees.merge(&other.nees);
        inside.merge(&other.inside);
        log_evidence.merge(&other.log_evidence);
        explained_beams.merge(&other.explained_beams);
    }

    /// The means so far.
    pub fn means(&self) -> Consistency {
        Consistency {
            nees: self.nees.mean(),
            inside_95: self.inside.mean(),
            log_evidence: self.log_evidence.mean(),
            explained_beams: self.explained_beams.mean(),
        }
    }
}

/// Values summed up.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    number: u64,
    sum: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        self.number += 1;
        self.sum += value;
    }

    fn merge(&mut self, other: &Sum) {
        self.number += other.number;
        self.sum += other.sum;
    }

    fn mean(&self) -> Option<f64> {
        (self.number > 0).then(|| self.sum / self.number as f64)
    }
}

/// Normalized estimation error squared of a scan, from the reference pose of the laser; `None` where the
/// covariance is singular.
pub fn scan_nees(reference: &Pose2, report: &StepReport, laser_from_robot: &Pose2) -> Option<f64> {
    // The filter's covariance is of the robot, the reference of the laser.
    let map_from_robot = reference.compose(laser_from_robot);
    let error = PoseError::between(&map_from_robot, &report.estimate.map_from_robot);
    let covariance = &report.estimate.covariance;
    let rows = std::array::from_fn(|row| std::array::from_fn(|c| covariance[(row, c)]));
    nees([error.dx, error.dy, error.dtheta], rows)
}

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let RunContext { tracked, laser_from_robot, .. } = context;
    let mut tally = Tally::default();
    for (reference, report) in tracked.reference.iter().zip(&tracked.run.reports) {
        tally.add(report, scan_nees(reference, report, laser_from_robot));
    }
    let Consistency { nees, inside_95, log_evidence, explained_beams } = tally.means();
    Ok([nees, inside_95, log_evidence, explained_beams].map(Value::from).to_vec())
}
