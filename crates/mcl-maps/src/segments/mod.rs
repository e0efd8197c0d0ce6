//! Line segments: the walls that scans show, each kept as its two ends.
//!
//! Split and merge (the iterative end point fit), the first of those that V. Nguyen, A. Martinelli, N. Tomatis
//! and R. Siegwart compare in *A Comparison of Line Extraction Algorithms using 2D Laser Rangefinder for Indoor
//! Mobile Robotics*, IROS 2005: each scan is split into pieces, and pieces on one line become one. Here
//! those of all scans are merged at once, so that a wall that many scans saw is one segment.
//! Lines are those of total least squares through every point of their pieces.
//!
//! # Example
//! ```
//! use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry};
//! use mcl_maps::segments::{SegmentSettings, line_segments};
//!
//! // A wall along y, 2 m ahead, seen from two places.
//! let geometry = ScanGeometry { start_angle: -0.5, angle_step: 0.01, beams: 101 };
//! let scan = |y: f64| LaserScan {
//!     stamp: None,
//!     geometry,
//!     ranges: (0..101).map(|beam| 2.0 / geometry.angle(beam).cos()).collect(),
//!     map_from_laser: Some(Pose2::new(0.0, y, 0.0)),
//!     odometry: None,
//!     sweep: Default::default(),
//! };
//! let log = Recording { scans: vec![scan(0.0), scan(1.0)], robot_from_laser: Pose2::IDENTITY };
//! let map = line_segments(&log, 10.0, &SegmentSettings::of_tolerance(0.05))?;
//! assert_eq!(map.segments().len(), 1);
//! assert!((map.segments()[0].length() - (1.0 + 4.0 * 0.5f64.tan())).abs() < 1e-9);
//! # Ok::<(), mcl_maps::MapError>(())
//! ```

mod merge;
mod piece;
mod split;

use mcl_core::{LineSegment, Recording, SegmentMap, check_finite};

use crate::MapError;
use piece::Piece;

/// What counts as a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentSettings {
    /// How far points of a scan may be from the line through the ends of their piece, and the ends of a piece
    /// from the line that it becomes a part of (m).
    pub tolerance: f64,
    /// A wall ends where nothing was seen for longer than this (m).
    pub max_gap: f64,
    /// Shorter segments are left out (m).
    pub min_length: f64,
    /// Segments of fewer points, of all scans together, are left out.
    pub min_points: usize,
}

impl SegmentSettings {
    /// Walls of this tolerance (m), of at least 0.3 m and 10 points, with gaps of up to 0.3 m: on the logs at
    /// hand, 0.5 m brings several times as much line where no points are, for 1 % more of the points.
    pub fn of_tolerance(tolerance: f64) -> Self {
        SegmentSettings { tolerance, max_gap: 0.3, min_length: 0.3, min_points: 10 }
    }

    fn check(&self) -> Result<(), MapError> {
        let check = |setting, value: f64, good: bool, expected| match value.is_finite() && good {
            true => Ok(()),
            false => Err(MapError::Setting { setting, value, expected }),
        };
        let SegmentSettings { tolerance, max_gap, min_length, min_points } = *self;
        check("tolerance (m)", tolerance, tolerance > 0.0, "a positive number")?;
        check("longest gap (m)", max_gap, max_gap > 0.0, "a positive number")?;
        check("smallest length (m)", min_length, min_length >= 0.0, "a number, at least 0")?;
        check("smallest number of points", min_points as f64, min_points > 0, "at least 1")
    }
}

/// The walls that a recording shows, longest first.
///
/// Points are those of [`Recording::points`], with readings of up to `max_range` metres. The order of the
/// scans does not matter, not even to the last bit.
///
/// # Errors
/// [`MapError::Setting`] for settings out of range, [`MapError::Points`] for a recording without points in the
/// plane (see [`Recording::points`]), [`MapError::NoSegment`] when nothing in it is a wall.
pub fn line_segments(
    recording: &Recording,
    max_range: f64,
    settings: &SegmentSettings,
) -> Result<SegmentMap, MapError> {
    settings.check()?;
    let points = recording.points(max_range)?;
    check_finite(&points)?;
    let mut pieces = Vec::new();
    let mut rest = points.as_slice();
    for scan in &recording.scans {
        let (of_scan, after) = rest.split_at(scan.usable_beams(max_range));
        rest = after;
        pieces.extend(split::split(of_scan, settings));
    }
    let SegmentSettings { min_length, min_points, .. } = *settings;
    let segments: Vec<LineSegment> = merge::merge(pieces, settings)
        .iter()
        .filter(|piece| piece.points() >= min_points as f64)
        .map(Piece::segment)
        .filter(|segment| segment.length() >= min_length)
        .collect();
    if segments.is_empty() {
        return Err(MapError::NoSegment { min_length, min_points });
    }
    Ok(SegmentMap::new(segments)?)
}
