//! Whether the filter knows how sure it may be.

use anyhow::Result;
use mcl_metrics::{PoseError, inside_ellipsoid_95, nees};

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Mean and median of the normalized estimation error squared (3 and 2.37 for a filter that is right about itself),
/// and the share of scans whose reference lies in the 95 % ellipsoid of the estimate. Scans whose covariance is
/// singular have none of them. A single scan after which one particle has all the weight decides the mean, not the
/// median.
pub const CONSISTENCY: RunMeasure =
    RunMeasure { name: "consistency", columns: &["nees", "median_nees", "inside_95"], measure };

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
    let mut of_scans: Vec<f64> = of_scans.collect();
    of_scans.sort_unstable_by(f64::total_cmp);
    let median = of_scans.get(of_scans.len() / 2).copied();
    let share = |number: usize| number as f64 / of_scans.len() as f64;
    let inside = of_scans.iter().filter(|&&nees| inside_ellipsoid_95(nees)).count();
    let mean = of_scans.iter().sum::<f64>() / of_scans.len() as f64;
    Ok(vec![mean.into(), median.into(), share(inside).into()])
}
