//! Which scans build maps, and which scans rate them.

use std::fmt;

use anyhow::{Context, Result, bail};
use mcl_core::{LaserScan, Pose2, Recording};
use mcl_maps::PointSet;
use serde::{Deserialize, Serialize};

use crate::data::source::{LogSource, placed};

/// Which scans build maps, and which are localized or rate the map. One name, one meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// All scans do both, as in the paper.
    Same,
    /// Even scans build the map, odd ones are localized: nothing is tested on what it was built from,
    /// but neighbouring scans see nearly the same.
    Alternate,
    /// Blocks of [`BLOCK_SCANS`] scans in time are held out; a draw holds out the blocks of fold
    /// `draw mod` [`FOLDS`].
    Blocks,
}

/// Number of scans in a block. In the logs used here the robot travels some metres meanwhile: far enough that
/// the scans of other blocks differ, near enough that they cover the same place.
pub const BLOCK_SCANS: usize = 10;
/// One in this many blocks is held out.
pub const FOLDS: usize = 5;

impl Split {
    /// All of them.
    pub const ALL: [Split; 3] = [Split::Same, Split::Alternate, Split::Blocks];

    /// The name in files and figures.
    pub fn name(self) -> &'static str {
        match self {
            Split::Same => "same",
            Split::Alternate => "alternate",
            Split::Blocks => "blocks",
        }
    }

    /// The name in the derivation of seeds: `alternate` was called `held-out` in version 0.1, and its draws
    /// must not change.
    pub fn seed_name(self) -> &'static str {
        match self {
            Split::Alternate => "held-out",
            other => other.name(),
        }
    }

    /// What it means, for captions.
    pub fn describe(self) -> &'static str {
        match self {
            Split::Same => "Map and runs use the same scans, as in the paper",
            Split::Alternate => "Maps are built from even scans, the runs are on odd ones",
            Split::Blocks => {
                "Maps are built from four fifths of the log and rated by blocks of ten scans held out"
            }
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Indices of a log's scans, divided.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DividedScans {
    /// Those that build the map, ascending in time.
    pub building: Vec<usize>,
    /// Those that are localized or rate the map, ascending in time.
    pub rating: Vec<usize>,
}

/// Divides the scans of a recording. Without a split all scans do both.
///
/// # Errors
/// For [`Split::Blocks`] when there are fewer blocks than folds.
pub fn divide(recording: &Recording, split: Option<Split>, fold: usize) -> Result<DividedScans> {
    let scans = recording.scans.len();
    let all = || (0..scans).collect::<Vec<_>>();
    Ok(match split {
        None | Some(Split::Same) => DividedScans { building: all(), rating: all() },
        Some(Split::Alternate) => {
            let (building, rating) = (0..scans).partition(|index| index.is_multiple_of(2));
            DividedScans { building, rating }
        }
        Some(Split::Blocks) => {
            if scans.div_ceil(BLOCK_SCANS) < FOLDS {
                bail!(
                    "{scans} scans, expected at least {}: {FOLDS} blocks of {BLOCK_SCANS}",
                    (FOLDS - 1) * BLOCK_SCANS + 1
                );
            }
            // By time, where the log has stamps: a log may step back.
            let mut order = all();
            if recording.scans.iter().all(|scan| scan.stamp.is_some()) {
                order.sort_by_key(|&index| recording.scans[index].stamp);
            }
            let is_held_out = |place: &usize| place / BLOCK_SCANS % FOLDS == fold % FOLDS;
            let (rating, building): (Vec<usize>, Vec<usize>) = (0..scans).partition(is_held_out);
            let scans_at = |places: Vec<usize>| places.into_iter().map(|p| order[p]).collect();
            DividedScans { building: scans_at(building), rating: scans_at(rating) }
        }
    })
}

/// These scans of a recording, in this order.
pub fn select(recording: &Recording, scans: &[usize]) -> Recording {
    let scans: Vec<LaserScan> = scans.iter().map(|&scan| recording.scans[scan].clone()).collect();
    Recording { scans, robot_from_laser: recording.robot_from_laser }
}

/// The points of these scans (m, in the map's frame).
///
/// # Errors
/// When a scan has no reference pose, or none has a usable reading.
pub fn points_of(log: &LogSource, scans: &[usize]) -> Result<PointSet<2>> {
    let points = placed(&select(&log.recording, scans)).points(log.max_range)?;
    if points.is_empty() {
        bail!("{}: {} scans of a split have no usable reading", log.name, scans.len());
    }
    Ok(PointSet::new(points)?)
}

/// Reference poses of these scans (poses of the laser in the map's frame).
///
/// # Errors
/// When a scan has none, or there are fewer than two.
pub fn reference_of(log: &LogSource, scans: &[usize]) -> Result<Vec<Pose2>> {
    if scans.len() < 2 {
        bail!("{} scans to localize, expected at least 2", scans.len());
    }
    let pose = |&scan: &usize| {
        let pose = log.recording.scans[scan].map_from_laser;
        pose.with_context(|| format!("scan {scan} has no reference pose"))
    };
    scans.iter().map(pose).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{ScanGeometry, Stamp};

    fn recording(stamps: &[Option<i64>]) -> Recording {
        let geometry = ScanGeometry { start_angle: 0.0, angle_step: 0.1, beams: 1 };
        let scan = |stamp: &Option<i64>| LaserScan {
            stamp: stamp.map(Stamp::from_nanoseconds),
            geometry,
            ranges: vec![1.0],
            map_from_laser: Some(Pose2::IDENTITY),
            odometry: None,
            sweep: Default::default(),
        };
        Recording { scans: stamps.iter().map(scan).collect(), robot_from_laser: Pose2::IDENTITY }
    }

    #[test]
    fn blocks_are_cut_by_time_whatever_the_order_of_scans() {
        // 60 stamps out of order.
        let stamps: Vec<Option<i64>> = (0..60).map(|index| Some(index * 37 % 60)).collect();
        let log = recording(&stamps);
        let found = divide(&log, Some(Split::Blocks), 2).unwrap();
        let times: Vec<i64> = found.rating.iter().map(|&scan| stamps[scan].unwrap()).collect();
        assert_eq!(times, (20..30).collect::<Vec<i64>>());
        assert_eq!(found.building.len(), 50);
        // The sixth block belongs to the first fold, too; a log without stamps.
        let found = divide(&recording(&[None; 55]), Some(Split::Blocks), 0).unwrap();
        assert_eq!(found.rating, (0..10).chain(50..55).collect::<Vec<usize>>());
        let error = divide(&recording(&[None; 40]), Some(Split::Blocks), 0).unwrap_err();
        assert!(error.to_string().starts_with("40 scans, expected at least 41"), "{error}");
    }

    #[test]
    fn alternate_scans_share_none() {
        let found = divide(&recording(&[None; 5]), Some(Split::Alternate), 0).unwrap();
        assert_eq!((found.building, found.rating), (vec![0, 2, 4], vec![1, 3]));
        let found = divide(&recording(&[None; 2]), None, 0).unwrap();
        assert_eq!(found.building, found.rating);
    }
}
