use serde::{Deserialize, Serialize};

use crate::math;
use crate::{Point, Pose2, Stamp};

/// Whether a range reading is usable: `0 < range ≤ max_range`, both in metres. NaN, infinities and a scanner's
/// no-return values are not.
#[inline]
pub fn is_usable_range(range: f64, max_range: f64) -> bool {
    range > 0.0 && range <= max_range && range.is_finite()
}

/// Beam directions of a scanner, in the laser frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScanGeometry {
    /// Direction of beam 0 in radians; 0 is straight ahead, counter-clockwise positive.
    pub start_angle: f64,
    /// Angle from one beam to the next in radians; negative if the scanner turns clockwise.
    pub angle_step: f64,
    /// Number of beams.
    pub beams: usize,
}

impl ScanGeometry {
    /// Direction of beam `i` in radians: `start_angle + i·angle_step`.
    #[inline]
    pub fn angle(&self, i: usize) -> f64 {
        self.start_angle + i as f64 * self.angle_step
    }
}

/// One scan of a planar laser range finder, with its stamp and poses where the log has them.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan {
    /// Time of the scan; `None` without a usable stamp in the log.
    pub stamp: Option<Stamp>,
    /// Directions of the beams.
    pub geometry: ScanGeometry,
    /// One reading per beam in metres, as logged, including no-return values;
    /// `ranges.len() == geometry.beams`.
    pub ranges: Vec<f64>,
    /// Reference pose of the laser in the map frame (ground truth); `None` if the log has none.
    pub map_from_laser: Option<Pose2>,
    /// Raw odometry: the pose of the laser at this scan in the frame of the laser at the previous scan.
    /// `None` for the first scan and where the log has no odometry.
    pub odometry: Option<Pose2>,
    /// Timing and directions of the beams, if they were not measured at once and at even angles.
    pub sweep: Sweep,
}

/// Timing and directions of a scan's beams; the default is all at once and at even angles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sweep {
    /// Seconds from one beam to the next; 0 if all beams count as measured at once.
    pub time_increment: f64,
    /// Direction of each beam in radians, one per reading: of its endpoint as seen from the laser's position at the
    /// stamp, in the laser's plane, for lasers that moved during the scan or are tilted. `None` if the geometry of
    /// the scan gives the directions.
    pub directions: Option<Vec<f64>>,
}

impl LaserScan {
    /// Direction of beam `i` in radians, in the laser frame.
    #[inline]
    pub fn direction(&self, i: usize) -> f64 {
        let own = self.sweep.directions.as_ref().and_then(|directions| directions.get(i));
        own.copied().unwrap_or_else(|| self.geometry.angle(i))
    }

    /// Endpoints of the usable readings in the map frame for a laser at `map_from_laser`, in beam
    /// order: `(x + r·cos(θ + a), y + r·sin(θ + a))`.
    pub fn endpoints(
        &self,
        map_from_laser: Pose2,
        max_range: f64,
    ) -> impl Iterator<Item = Point<2>> + '_ {
        self.ranges
            .iter()
            .enumerate()
            .filter(move |&(_, &range)| is_usable_range(range, max_range))
            .map(move |(i, &range)| {
                let (sin, cos) = math::sin_cos(map_from_laser.theta + self.direction(i));
                [map_from_laser.x + range * cos, map_from_laser.y + range * sin]
            })
    }

    /// Number of usable readings (`0 < r ≤ max_range`).
    pub fn usable_beams(&self, max_range: f64) -> usize {
        self.ranges.iter().filter(|&&range| is_usable_range(range, max_range)).count()
    }
}
