use mcl_core::{LaserScan, Point, Pose2, is_usable_range, math};

use crate::{Beams, FilterError};

/// Endpoints of the used beams of one scan in the robot frame. Computed once per scan for all particles; the buffers
/// are reused.
#[derive(Debug, Clone, Default)]
pub struct ScanEndpoints {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl ScanEndpoints {
    /// Replaces the endpoints by those of a scan: of the beams selected by `beams`, those whose reading
    /// satisfies `0 < r ≤ max_range` (m).
    ///
    /// n beams spread over B are those in the middle of n equal parts of the scan,
    /// ⌊(2i + 1)·B / 2n⌋. They are selected by direction only, before unusable readings are dropped,
    /// so that the selection does not depend on the readings.
    ///
    /// # Errors
    /// [`FilterError::ScanGeometry`] if the beam directions are not finite.
    pub fn load(
        &mut self,
        scan: &LaserScan,
        robot_from_laser: &Pose2,
        beams: Beams,
        max_range: f64,
    ) -> Result<(), FilterError> {
        let (start_angle, angle_step) = (scan.geometry.start_angle, scan.geometry.angle_step);
        if !(start_angle.is_finite() && angle_step.is_finite()) {
            return Err(FilterError::ScanGeometry { start_angle, angle_step });
        }
        self.x.clear();
        self.y.clear();
        let all = scan.ranges.len();
        let n = match beams {
            Beams::All => all,
            Beams::Spread(n) => n.min(all),
            Beams::Degrees(step) => {
                let view = all as f64 * angle_step.abs().to_degrees();
                ((view / step).round() as usize).clamp(1.min(all), all)
            }
        };
        // Each beam is in the middle of its part.
        (0..n).for_each(|i| {
            self.push(scan, (2 * i + 1) * all / (2 * n), robot_from_laser, max_range);
        });
        Ok(())
    }

    /// Keeps the beams for whose index `keep` returns true.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        for coordinates in [&mut self.x, &mut self.y] {
            let mut place = 0..;
            coordinates.retain(|_| place.next().is_some_and(&keep));
        }
    }

    fn push(&mut self, scan: &LaserScan, beam: usize, robot_from_laser: &Pose2, max_range: f64) {
        let range = scan.ranges[beam];
        if is_usable_range(range, max_range) {
            let (sin, cos) = math::sin_cos(robot_from_laser.theta + scan.direction(beam));
            self.x.push(robot_from_laser.x + range * cos);
            self.y.push(robot_from_laser.y + range * sin);
        }
    }

    /// The endpoints in the robot frame (m).
    pub(crate) fn iter(&self) -> impl Iterator<Item = Point<2>> + '_ {
        self.x.iter().zip(&self.y).map(|(&x, &y)| [x, y])
    }

    /// x coordinates in the robot frame (m).
    pub fn x(&self) -> &[f64] {
        &self.x
    }

    /// y coordinates in the robot frame (m).
    pub fn y(&self) -> &[f64] {
        &self.y
    }

    /// Distance of the farthest endpoint from the robot (m); 0 without endpoints.
    pub fn reach(&self) -> f64 {
        let squares = self.x.iter().zip(&self.y).map(|(x, y)| x * x + y * y);
        squares.fold(0.0, f64::max).sqrt()
    }

    /// Number of used beams.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether no beam is used.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::ScanGeometry;
    use std::f64::consts::FRAC_PI_2;

    fn scan(ranges: &[f64]) -> LaserScan {
        LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 0.01, beams: ranges.len() },
            ranges: ranges.to_vec(),
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        }
    }

    /// The indices of the used beams, recognized by their range: beam i reads i + 1 m.
    fn used(beams: usize, choice: Beams) -> Vec<usize> {
        let ranges: Vec<f64> = (1..=beams).map(|i| i as f64).collect();
        let mut endpoints = ScanEndpoints::default();
        endpoints.load(&scan(&ranges), &Pose2::IDENTITY, choice, 1e6).unwrap();
        let index = |(x, y): (&f64, &f64)| x.hypot(*y).round() as usize - 1;
        endpoints.x().iter().zip(endpoints.y()).map(index).collect()
    }

    #[test]
    fn beams_are_spread_evenly() {
        assert_eq!(used(9, Beams::Spread(3)), [1, 4, 7]);
        assert_eq!(used(10, Beams::Spread(4)), [1, 3, 6, 8]);
        assert_eq!(used(5, Beams::Spread(1)), [2]);
        assert_eq!(used(5, Beams::Spread(5)), [0, 1, 2, 3, 4]);
        assert_eq!(used(5, Beams::Spread(usize::MAX)), [0, 1, 2, 3, 4]);
        assert_eq!(used(5, Beams::All), [0, 1, 2, 3, 4]);
        assert!(used(0, Beams::Spread(3)).is_empty());
        // 0.01 rad is 0.573°: one beam per 5.73° gives ten of 100 beams, and at least one.
        assert_eq!(used(100, Beams::Degrees(5.73)), used(100, Beams::Spread(10)));
        assert_eq!(used(5, Beams::Degrees(0.001)), [0, 1, 2, 3, 4]);
        assert_eq!(used(5, Beams::Degrees(360.0)), [2]);
        assert!(used(0, Beams::Degrees(3.0)).is_empty());
        let many = used(180, Beams::Spread(171));
        assert!(many.len() == 171 && many.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn unusable_readings_are_dropped_after_the_choice() {
        let ranges = [1.0, f64::NAN, 3.0, 10.0, 0.0, 10.01, -1.0, f64::INFINITY];
        let mut endpoints = ScanEndpoints::default();
        endpoints.load(&scan(&ranges), &Pose2::IDENTITY, Beams::All, 10.0).unwrap();
        assert_eq!(endpoints.len(), 3);
        // Beams 1, 3, 5 and 7: only beam 3 has a usable reading.
        endpoints.load(&scan(&ranges), &Pose2::IDENTITY, Beams::Spread(4), 10.0).unwrap();
        assert_eq!(endpoints.len(), 1);
    }

    #[test]
    fn the_mount_carries_endpoints_into_the_robots_frame() {
        let mount = Pose2::new(0.2, 0.1, FRAC_PI_2);
        let mut endpoints = ScanEndpoints::default();
        endpoints.load(&scan(&[2.0]), &mount, Beams::All, 10.0).unwrap();
        assert!((endpoints.x()[0] - 0.2).abs() < 1e-15 && (endpoints.y()[0] - 2.1).abs() < 1e-15);
    }

    #[test]
    fn beams_without_direction_are_refused() {
        let mut scan = scan(&[1.0]);
        scan.geometry.angle_step = f64::NAN;
        let error = ScanEndpoints::default().load(&scan, &Pose2::IDENTITY, Beams::All, 10.0);
        assert!(matches!(error, Err(FilterError::ScanGeometry { .. })));
    }
}
