use serde::{Deserialize, Serialize};

use crate::math;
use crate::{Point, Pose2, Stamp};

/// Whether a reading counts as a measurement: `0 < range ≤ max_range`, both in metres. NaN,
/// infinities and the no-return values of a scanner do not.
#[inline]
pub fn is_usable_range(range: f64, max_range: f64) -> bool {
    range > 0.0 && range <= max_range && range.is_finite()
}

/// Directions of the beams of a scanner, in the laser's frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScanGeometry {
    /// Direction of beam 0 in radians; 0 is straight ahead, counter-clockwise positive.
    pub start_angle: f64,
    /// Angle from one beam to the next in radians; negative when the scanner turns clockwise.
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

/// One sweep of a planar laser range finder, with what the log knows about where it was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan {
    /// When the scan was taken, where the log has a usable stamp.
    pub stamp: Option<Stamp>,
    /// Directions of the beams.
    pub geometry: ScanGeometry,
    /// One reading per beam in metres, as logged (no-return values included);
    /// `ranges.len() == geometry.beams`.
    pub ranges: Vec<f64>,
    /// Reference pose of the laser in the map's frame (ground truth), where the log has one.
    pub map_from_laser: Option<Pose2>,
    /// Raw odometry: the pose of this scan's laser in the frame of the laser at the previous scan.
    /// `None` for the first scan, and where the log has no odometry.
    pub odometry: Option<Pose2>,
    /// How its beams were measured, where that was neither at once nor at even angles.
    pub sweep: Sweep,
}

/// How the beams of a scan were measured, where that was neither at once nor at even angles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sweep {
    /// Seconds from one beam to the next; 0 where the beams count as measured at once.
    pub time_increment: f64,
    /// Direction of each beam in radians, as many as there are readings: endpoints measured by a laser that
    /// moved meanwhile, or that is tilted, as seen from the place of the laser at the stamp, in its plane.
    /// `None` where the geometry of the scan says the directions.
    pub directions: Option<Vec<f64>>,
}

impl LaserScan {
    /// Direction of beam `i` in radians, in the laser's frame.
    #[inline]
    pub fn direction(&self, i: usize) -> f64 {
        let own = self.sweep.directions.as_ref().and_then(|directions| directions.get(i));
        own.copied().unwrap_or_else(|| self.geometry.angle(i))
    }

    /// Endpoints of the usable readings in the map's frame, seen from `map_from_laser`, in beam
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
