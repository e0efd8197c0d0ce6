//! Line segment extraction: the walls seen in the scans, each stored as its two ends.
//!
//! The algorithm is split and merge (iterative end point fit), the first of those compared by V. Nguyen,
//! A. Martinelli, N. Tomatis and R. Siegwart in *A Comparison of Line Extraction Algorithms using 2D Laser
//! Rangefinder for Indoor Mobile Robotics*, IROS 2005: each scan is split into pieces, and pieces on one line are
//! merged. Here the pieces of all scans are merged together, so that a wall seen in many scans is one segment. Lines
//! are fitted by total least squares to all points of their pieces.
//!
//! # Example
//! ```
//! use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry};
//! use mcl_maps::segments::{SegmentSettings, line_segments};
//!
//! // A wall along y, 2 m ahead, seen from two positions.
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

/// Settings of [`line_segments`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentSettings {
    /// Largest distance of the points of a scan from the line through the ends of their piece, and of the ends of a
    /// piece from the line that it is merged into (m).
    pub tolerance: f64,
    /// A segment ends at a gap without points that is longer than this (m).
    pub max_gap: f64,
    /// Shorter segments are left out (m).
    pub min_length: f64,
    /// Segments with fewer points, of all scans together, are left out.
    pub min_points: usize,
}

impl SegmentSettings {
    /// Settings with this tolerance (m), for segments of at least 0.3 m and 10 points, with gaps of up to 0.3 m. On
    /// the logs of the data sets, gaps of 0.5 m would cover 1 % more of the points, but several times as much length
    /// without points.
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

/// Extracts the line segments of a recording, longest first.
///
/// Points are those of [`Recording::points`], with readings of up to `max_range` metres. The result does not depend on
/// the order of the scans, not even in the last bit.
///
/// # Errors
/// [`MapError::Setting`] for settings out of range, [`MapError::Points`] for a recording without usable points
/// (see [`Recording::points`]), [`MapError::NoSegment`] if no segment is found.
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
