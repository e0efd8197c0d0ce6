use anyhow::{Result, bail};
use mcl_core::{LaserScan, Recording};
use mcl_maps::PointSet;

/// Points divided by time.
pub struct HeldOut<const D: usize> {
    /// What maps are built from.
    pub building: PointSet<D>,
    /// What they are rated by.
    pub held_out: PointSet<D>,
}

/// Scans of a block. In the logs used here the robot travels some metres meanwhile: far enough that the
/// scans of other blocks are others, near enough that they see the place.
pub const BLOCK_SCANS: usize = 10;
/// One in so many blocks is held out.
pub const FOLDS: usize = 5;

/// Leaves out blocks of [`BLOCK_SCANS`] scans that follow one another in time, not single scans:
/// neighbours see nearly the same. Scans are taken by stamp (in log order where there are none); of the
/// blocks every [`FOLDS`]-th is held out, from the one numbered `fold` on.
///
/// # Errors
/// When there are fewer blocks than folds, or a part has no points.
pub fn hold_out(recording: &Recording, max_range: f64, fold: usize) -> Result<HeldOut<2>> {
    let scans = &recording.scans;
    let blocks = scans.len().div_ceil(BLOCK_SCANS);
    if blocks < FOLDS {
        bail!(
            "{} scans, expected at least {}: {FOLDS} blocks of {BLOCK_SCANS}",
            scans.len(),
            (FOLDS - 1) * BLOCK_SCANS + 1
        );
    }
    let mut order: Vec<usize> = (0..scans.len()).collect();
    if scans.iter().all(|scan| scan.stamp.is_some()) {
        order.sort_by_key(|&index| scans[index].stamp);
    }
    let part = |is_held_out: bool| -> Result<PointSet<2>> {
        let is_of_part =
            |place: &usize| (place / BLOCK_SCANS % FOLDS == fold % FOLDS) == is_held_out;
        let scans: Vec<LaserScan> =
            (0..scans.len()).filter(is_of_part).map(|place| scans[order[place]].clone()).collect();
        let part = Recording { scans, robot_from_laser: recording.robot_from_laser };
        let points = part.points(max_range)?;
        if points.is_empty() {
            bail!(
                "the scans that are {} have no usable reading",
                if is_held_out { "held out" } else { "left" }
            );
        }
        Ok(PointSet::new(points)?)
    };
    Ok(HeldOut { building: part(false)?, held_out: part(true)? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{Pose2, ScanGeometry, Stamp};

    fn recording(stamps: &[Option<i64>]) -> Recording {
        let geometry = ScanGeometry { start_angle: 0.0, angle_step: 0.1, beams: 1 };
        let scan = |(index, stamp): (usize, &Option<i64>)| LaserScan {
            stamp: stamp.map(Stamp::from_nanoseconds),
            geometry,
            // The reading tells the scan's place in time.
            ranges: vec![stamp.unwrap_or(index as i64) as f64 + 1.0],
            map_from_laser: Some(Pose2::IDENTITY),
            odometry: None,
        };
        let scans = stamps.iter().enumerate().map(scan).collect();
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    fn places(points: &PointSet<2>) -> Vec<f64> {
        points.points().iter().map(|point| point[0] - 1.0).collect()
    }

    #[test]
    fn blocks_are_cut_by_time_whatever_the_order_of_scans() {
        // 60 stamps in a wild order.
        let shuffled: Vec<Option<i64>> = (0..60).map(|index| Some(index * 37 % 60)).collect();
        let found = hold_out(&recording(&shuffled), 80.0, 2).unwrap();
        let expected: Vec<f64> = (20..30).map(f64::from).collect();
        assert_eq!(places(&found.held_out), expected);
        assert_eq!(found.building.len(), 50);
        // The sixth block belongs to the first fold, too; a log without stamps.
        let found = hold_out(&recording(&[None; 55]), 80.0, 0).unwrap();
        let expected: Vec<f64> = (0..10).chain(50..55).map(f64::from).collect();
        assert_eq!(places(&found.held_out), expected);
    }

    #[test]
    fn parts_without_scans_or_points_are_refused() {
        let error = hold_out(&recording(&[None; 40]), 80.0, 0).err().unwrap().to_string();
        assert!(error.starts_with("40 scans, expected at least 41"), "{error}");
        assert!(hold_out(&recording(&[None; 50]), 0.5, 0).is_err());
    }
}
