use anyhow::{Result, bail};
use mcl_core::{LaserScan, Point, Recording};

/// Points of a recording divided by time.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOut {
    /// What maps are built from.
    pub building: Vec<Point<2>>,
    /// What they are rated by.
    pub held_out: Vec<Point<2>>,
}

/// Leaves out blocks of scans that follow one another in time, not single scans: neighbours see nearly
/// the same. The scans, by stamp (in log order where there are none), are cut into `blocks` equal blocks;
/// of these every `folds`-th is held out, from the one numbered `fold` on.
///
/// # Errors
/// When there are fewer scans than blocks, fewer blocks than folds, or a part has no points.
pub fn hold_out(
    recording: &Recording,
    max_range: f64,
    blocks: usize,
    folds: usize,
    fold: usize,
) -> Result<HeldOut> {
    let scans = &recording.scans;
    if !(2..=blocks).contains(&folds) || blocks > scans.len() {
        bail!(
            "{blocks} blocks in {folds} folds of {} scans: expected at least 2 folds, as many blocks, and as many scans",
            scans.len()
        );
    }
    let mut order: Vec<usize> = (0..scans.len()).collect();
    if scans.iter().all(|scan| scan.stamp.is_some()) {
        order.sort_by_key(|&index| scans[index].stamp);
    }
    let part = |is_held_out: bool| -> Result<Vec<Point<2>>> {
        let is_of_part =
            |place: &usize| (place * blocks / scans.len() % folds == fold % folds) == is_held_out;
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
        Ok(points)
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

    fn places(points: &[Point<2>]) -> Vec<f64> {
        points.iter().map(|point| point[0] - 1.0).collect()
    }

    #[test]
    fn blocks_are_cut_by_time_whatever_the_order_of_scans() {
        let shuffled = recording(&[7, 0, 3, 9, 4, 1, 8, 2, 6, 5].map(Some));
        let found = hold_out(&shuffled, 80.0, 5, 5, 2).unwrap();
        assert_eq!(places(&found.held_out), [4.0, 5.0]);
        assert_eq!(places(&found.building), [0.0, 1.0, 2.0, 3.0, 6.0, 7.0, 8.0, 9.0]);
        // Two folds of four blocks of a log without stamps.
        let found = hold_out(&recording(&[None; 8]), 80.0, 4, 2, 1).unwrap();
        assert_eq!(places(&found.held_out), [2.0, 3.0, 6.0, 7.0]);
    }

    #[test]
    fn parts_without_scans_are_refused() {
        for (blocks, folds) in [(11, 2), (5, 6), (5, 1), (5, 0)] {
            let error = hold_out(&recording(&[None; 10]), 80.0, blocks, folds, 0).unwrap_err();
            assert!(error.to_string().contains("10 scans"), "{error}");
        }
        assert!(hold_out(&recording(&[None; 10]), 0.5, 5, 5, 0).is_err());
    }
}
