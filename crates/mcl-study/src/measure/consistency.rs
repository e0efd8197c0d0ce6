//! Whether the filter knows how sure it may be.

use anyhow::Result;
use mcl_metrics::{PoseError, inside_ellipsoid_95, nees};

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Mean normalized estimation error squared (3 for a filter that is right about itself), and the share
/// of scans whose reference lies in the 95 % ellipsoid of the estimate. Scans whose covariance is
/// singular have neither.
pub const CONSISTENCY: RunMeasure =
    RunMeasure { name: "consistency", columns: &["nees", "inside_95"], measure };

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let RunContext { tracked, laser_from_robot, .. } = context;
    // The filter's covariance is of the robot, the reference of the laser.
    let of_scans =
        tracked.reference.iter().zip(&tracked.run.reports).filter_map(|(reference, report)| {
            let map_from_robot = reference.compose(laser_from_robot);
            let error = PoseError::between(&map_from_robot, &report.estimate.map_from_robot);
            let covariance = &report.estimate.covariance;
            let rows = std::array::from_fn(|row| std::array::from_fn(|c| covariance[(row, c)]));
            nees([error.dx, error.dy, error.dtheta], rows)
        });
    let of_scans: Vec<f64> = of_scans.collect();
    let share = |number: usize| number as f64 / of_scans.len() as f64;
    let inside = of_scans.iter().filter(|&&nees| inside_ellipsoid_95(nees)).count();
    Ok(vec![(of_scans.iter().sum::<f64>() / of_scans.len() as f64).into(), share(inside).into()])
}
