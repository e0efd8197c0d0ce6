use std::fmt;

use mcl_core::Recording;
use serde::Deserialize;

/// Facts of a log that do not depend on its header lines: copies of one log differ in comments and
/// parameters, and so in their digests, but not in these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// Number of scans or clouds.
    pub scans: usize,
    /// Number of readings, or of points of a cloud, usable or not.
    pub readings: usize,
    /// Number of points: readings with `0 < r ≤ max_range` of scans with a reference pose; for a cloud,
    /// points in that range from the origin of its frame.
    pub points: usize,
}

/// One fact that a recording does not agree with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FactMismatch {
    /// Name of the fact as in `dataset.toml`.
    pub fact: &'static str,
    /// The number recorded in the registry.
    pub expected: usize,
    /// The number found.
    pub found: usize,
}

impl fmt::Display for FactMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}, expected {}", self.found, self.fact, self.expected)
    }
}

impl Facts {
    /// The facts of a recording; `max_range` in metres, inclusive.
    pub fn of(recording: &Recording, max_range: f64) -> Facts {
        let projectable = recording.scans.iter().filter(|scan| scan.map_from_laser.is_some());
        Facts {
            scans: recording.scans.len(),
            readings: recording.readings(),
            points: projectable.map(|scan| scan.usable_beams(max_range)).sum(),
        }
    }

    /// The facts that differ from those found; empty when all agree.
    pub fn check(&self, found: &Facts) -> Vec<FactMismatch> {
        [
            ("scans", self.scans, found.scans),
            ("readings", self.readings, found.readings),
            ("points", self.points, found.points),
        ]
        .into_iter()
        .filter(|(_, expected, found)| expected != found)
        .map(|(fact, expected, found)| FactMismatch { fact, expected, found })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{LaserScan, Pose2, ScanGeometry};

    #[test]
    fn only_the_facts_that_differ_are_named() {
        let scan = |pose, ranges: &[f64]| LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 0.1, beams: ranges.len() },
            ranges: ranges.to_vec(),
            map_from_laser: pose,
            odometry: None,
            sweep: Default::default(),
        };
        let pose = Some(Pose2::IDENTITY);
        let recording = Recording {
            scans: vec![scan(pose, &[1.0, 10.0, 10.5]), scan(None, &[1.0])],
            robot_from_laser: Pose2::IDENTITY,
        };
        let facts = Facts { scans: 2, readings: 4, points: 2 };
        assert_eq!(facts.check(&Facts::of(&recording, 10.0)), []);
        let mismatches = facts.check(&Facts::of(&recording, 9.0));
        assert_eq!(mismatches, [FactMismatch { fact: "points", expected: 2, found: 1 }]);
        assert_eq!(mismatches[0].to_string(), "1 points, expected 2");
        assert_eq!(Facts { scans: 1, readings: 5, points: 0 }.check(&facts).len(), 3);
    }
}
