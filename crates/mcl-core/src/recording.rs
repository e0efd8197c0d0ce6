use crate::math;
use crate::memory::with_room;
use crate::{CoreError, LaserScan, Point, Pose2, Trajectory};

/// Axis-aligned bounding box, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<const D: usize> {
    /// Smallest coordinate per axis.
    pub min: Point<D>,
    /// Largest coordinate per axis.
    pub max: Point<D>,
}

impl<const D: usize> Bounds<D> {
    /// Bounding box of `points`; `None` if there are none.
    pub fn of(points: &[Point<D>]) -> Option<Self> {
        Self::around(points.iter().copied())
    }

    /// Bounding box of the points of an iterator; `None` if there are none.
    pub fn around(points: impl IntoIterator<Item = Point<D>>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = points.next()?;
        let mut bounds = Bounds { min: first, max: first };
        for point in points {
            for axis in 0..D {
                bounds.min[axis] = bounds.min[axis].min(point[axis]);
                bounds.max[axis] = bounds.max[axis].max(point[axis]);
            }
        }
        Some(bounds)
    }

    /// Edge length along one axis, in metres.
    pub fn extent(&self, axis: usize) -> f64 {
        self.max[axis] - self.min[axis]
    }

    /// Squared distance (m²) from a point to the box; 0 inside.
    pub fn squared_distance(&self, place: &Point<D>) -> f64 {
        let outside = |axis: usize| {
            f64::max(self.min[axis] - place[axis], place[axis] - self.max[axis]).max(0.0)
        };
        (0..D).map(|axis| outside(axis) * outside(axis)).sum()
    }

    /// Centre of the box.
    pub fn center(&self) -> Point<D> {
        std::array::from_fn(|axis| 0.5 * (self.min[axis] + self.max[axis]))
    }
}

/// A laser log: scans in log order (never sorted), each with its stamp, reference pose and odometry
/// increment where the log has them. All poses are poses of the laser.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Scans in log order.
    pub scans: Vec<LaserScan>,
    /// Pose of the laser on the robot: transforms coordinates in the laser frame to the robot frame.
    pub robot_from_laser: Pose2,
}

impl Recording {
    /// Number of range readings, usable or not.
    pub fn readings(&self) -> usize {
        self.scans.iter().map(|scan| scan.ranges.len()).sum()
    }

    /// The point set D: endpoints of the readings with `0 < r ≤ max_range` (metres, inclusive),
    /// projected with the reference poses, in log order.
    ///
    /// # Errors
    /// [`CoreError::MaxRange`] unless `max_range` is positive; [`CoreError::NoReference`] with the
    /// index of the first scan without a reference pose; [`CoreError::Memory`].
    pub fn points(&self, max_range: f64) -> Result<Vec<Point<2>>, CoreError> {
        if !max_range.is_finite() || max_range <= 0.0 {
            return Err(CoreError::MaxRange(max_range));
        }
        let usable = self.scans.iter().map(|scan| scan.usable_beams(max_range)).sum();
        let mut points = with_room(usable, "points")?;
        for (index, scan) in self.scans.iter().enumerate() {
            let pose = scan.map_from_laser.ok_or(CoreError::NoReference { scan: index })?;
            points.extend(scan.endpoints(pose, max_range));
        }
        Ok(points)
    }

    /// Whether every scan has a reference pose.
    pub fn has_reference(&self) -> bool {
        !self.scans.is_empty() && self.scans.iter().all(|scan| scan.map_from_laser.is_some())
    }

    /// Whether every scan after the first has an odometry increment.
    pub fn has_odometry(&self) -> bool {
        self.scans.len() > 1 && self.scans[1..].iter().all(|scan| scan.odometry.is_some())
    }

    /// Seconds from the first to the last stamped scan, in log order; 0 with fewer than two stamps.
    pub fn duration_s(&self) -> f64 {
        let mut stamps = self.scans.iter().filter_map(|scan| scan.stamp);
        match (stamps.next(), stamps.next_back()) {
            (Some(first), Some(last)) => last.seconds_since(first),
            _ => 0.0,
        }
    }

    /// Number of stamps that are earlier than the stamp before them in log order.
    pub fn backward_stamps(&self) -> usize {
        let stamps: Vec<_> = self.scans.iter().filter_map(|scan| scan.stamp).collect();
        stamps.windows(2).filter(|pair| pair[1] < pair[0]).count()
    }

    /// Length of the path in metres, from the reference poses or, without any, from the odometry increments.
    pub fn path_length_m(&self) -> f64 {
        if self.has_reference() {
            let poses: Vec<Pose2> =
                self.scans.iter().filter_map(|scan| scan.map_from_laser).collect();
            poses.windows(2).map(|pair| pair[0].distance(&pair[1])).sum()
        } else {
            self.scans
                .iter()
                .filter_map(|scan| scan.odometry)
                .map(|step| math::hypot(step.x, step.y))
                .sum()
        }
    }

    /// The reference pose of every scan, in log order, with or without stamps: the pose at index i is that of scan i, as
    /// the estimates of a run over all scans are.
    ///
    /// # Errors
    /// [`CoreError::NoReference`] with the index of the first scan without a reference pose; [`CoreError::Memory`].
    pub fn reference(&self) -> Result<Vec<Pose2>, CoreError> {
        let mut poses = with_room(self.scans.len(), "reference poses")?;
        for (scan, found) in self.scans.iter().enumerate() {
            poses.push(found.map_from_laser.ok_or(CoreError::NoReference { scan })?);
        }
        Ok(poses)
    }

    /// Stamps and reference poses of the scans that have both, in log order: what a file of a trajectory holds, and what is
    /// matched by stamp. Scans that lack one of them are left out, so that its length may differ from that of
    /// [`scans`](Recording::scans); [`reference`](Recording::reference) goes by scans.
    pub fn stamped_reference(&self) -> Trajectory {
        self.scans.iter().filter_map(|scan| Some((scan.stamp?, scan.map_from_laser?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ScanGeometry, Stamp};
    use std::f64::consts::FRAC_PI_2;

    fn scan(stamp: i64, pose: Option<Pose2>, ranges: &[f64]) -> LaserScan {
        let geometry =
            ScanGeometry { start_angle: -FRAC_PI_2, angle_step: FRAC_PI_2, beams: ranges.len() };
        LaserScan {
            stamp: Some(Stamp::from_nanoseconds(stamp)),
            geometry,
            ranges: ranges.to_vec(),
            map_from_laser: pose,
            odometry: None,
            sweep: Default::default(),
        }
    }

    fn recording(scans: Vec<LaserScan>) -> Recording {
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    #[test]
    fn points_keep_readings_up_to_and_including_the_limit() {
        let pose = Pose2::new(1.0, 2.0, FRAC_PI_2);
        let log = recording(vec![scan(0, Some(pose), &[10.0, 0.0, f64::NAN]), {
            scan(1, Some(pose), &[10.1, 3.0, f64::INFINITY])
        }]);
        let points = log.points(10.0).unwrap();
        // Beam 0 points to the robot's right, which is +x in the map; beam 1 straight ahead, +y.
        assert_eq!(points.len(), 2);
        assert!((points[0][0] - 11.0).abs() < 1e-12 && (points[0][1] - 2.0).abs() < 1e-12);
        assert!((points[1][0] - 1.0).abs() < 1e-12 && (points[1][1] - 5.0).abs() < 1e-12);
        assert_eq!(log.readings(), 6);
    }

    #[test]
    fn a_scan_without_reference_is_reported_by_its_index() {
        let log = recording(vec![scan(0, Some(Pose2::IDENTITY), &[1.0]), scan(1, None, &[1.0])]);
        assert_eq!(log.points(10.0), Err(CoreError::NoReference { scan: 1 }));
        assert!(matches!(log.points(f64::NAN), Err(CoreError::MaxRange(_))));
        assert!(!log.has_reference());
    }

    #[test]
    fn backward_stamps_are_counted_and_order_is_kept() {
        let pose = Some(Pose2::IDENTITY);
        let log = recording(vec![
            scan(3_000_000_000, pose, &[1.0]),
            scan(2_000_000_000, pose, &[2.0]),
            scan(5_500_000_000, pose, &[3.0]),
        ]);
        assert_eq!(log.backward_stamps(), 1);
        assert_eq!(log.duration_s(), 2.5);
        assert_eq!(log.stamped_reference().len(), 3);
    }

    /// `reference` gave stamps with poses, and so dropped scans without a stamp: errors of estimates, one per scan, could
    /// not be computed by it, or were computed between poses of different scans.
    #[test]
    fn the_reference_of_a_log_without_stamps_has_a_pose_per_scan() {
        let poses = [Pose2::IDENTITY, Pose2::new(1.0, 0.0, 0.0), Pose2::new(2.0, 0.0, 0.0)];
        let mut log = recording(poses.iter().map(|&pose| scan(0, Some(pose), &[1.0])).collect());
        log.scans[1].stamp = None;
        assert_eq!(log.reference().unwrap(), poses);
        assert_eq!(log.stamped_reference().poses(), [poses[0], poses[2]]);
        log.scans.iter_mut().for_each(|scan| scan.stamp = None);
        assert_eq!(log.reference().unwrap(), poses);
        assert!(log.stamped_reference().is_empty());
        log.scans[2].map_from_laser = None;
        assert_eq!(log.reference(), Err(CoreError::NoReference { scan: 2 }));
    }
}
