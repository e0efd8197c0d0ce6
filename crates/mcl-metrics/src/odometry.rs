use mcl_core::{Pose2, Recording, math};

/// Steps shorter than this (m) have no reliable direction: for a robot that stands still, odometry and reference are
/// off by centimetres.
const SHORTEST_STEP: f64 = 0.03;

/// Agreement of the odometry of a log with its reference poses from scan to scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryError {
    /// Number of steps with both.
    pub steps: usize,
    /// Root mean square of the relative pose error per step: translation (m).
    pub translation_rmse: f64,
    /// Root mean square of the relative pose error per step: rotation (rad).
    pub rotation_rmse: f64,
    /// Number of steps in opposite directions: both of at least 3 cm, more than 120° apart. They occur in odometry
    /// that records backward motion as forward.
    pub opposed_steps: usize,
    /// Path length of the reference on these steps (m).
    pub opposed_m: f64,
}

impl OdometryError {
    /// Compares the odometry increment of each scan with that of the reference poses; `None`
    /// if no step has both.
    pub fn of(recording: &Recording) -> Option<Self> {
        let steps = recording.scans.windows(2).filter_map(|pair| {
            let reference = pair[0].map_from_laser?.between(&pair[1].map_from_laser?);
            Some((reference, pair[1].odometry?))
        });
        let mut error = OdometryError {
            steps: 0,
            translation_rmse: 0.0,
            rotation_rmse: 0.0,
            opposed_steps: 0,
            opposed_m: 0.0,
        };
        for (reference, odometry) in steps {
            let difference = reference.between(&odometry);
            error.steps += 1;
            error.translation_rmse += math::square(difference.x) + math::square(difference.y);
            error.rotation_rmse += math::square(difference.theta);
            if are_opposed(&reference, &odometry) {
                error.opposed_steps += 1;
                error.opposed_m += math::hypot(reference.x, reference.y);
            }
        }
        if error.steps == 0 {
            return None;
        }
        let rms = |sum: f64| (sum / error.steps as f64).sqrt();
        error.translation_rmse = rms(error.translation_rmse);
        error.rotation_rmse = rms(error.rotation_rmse);
        Some(error)
    }
}

fn are_opposed(a: &Pose2, b: &Pose2) -> bool {
    let (a_length, b_length) = (math::hypot(a.x, a.y), math::hypot(b.x, b.y));
    let is_directed = a_length.min(b_length) >= SHORTEST_STEP;
    is_directed && a.x * b.x + a.y * b.y < -0.5 * a_length * b_length
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{LaserScan, ScanGeometry};

    fn recording(steps: &[(Pose2, Option<Pose2>)]) -> Recording {
        let scan = |pose, odometry| LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 0.1, beams: 1 },
            ranges: vec![1.0],
            map_from_laser: Some(pose),
            odometry,
            sweep: Default::default(),
        };
        let mut pose = Pose2::new(3.0, -2.0, 2.5);
        let mut scans = vec![scan(pose, None)];
        for (reference, odometry) in steps {
            pose = pose.compose(reference);
            scans.push(scan(pose, *odometry));
        }
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    #[test]
    fn steps_are_compared_where_both_are_known() {
        let error = OdometryError::of(&recording(&[
            (Pose2::new(0.1, 0.0, 0.2), Some(Pose2::new(0.1, 0.06, 0.1))),
            (Pose2::new(0.1, 0.0, 0.0), None),
            (Pose2::new(-0.2, 0.01, 0.0), Some(Pose2::new(0.1, 0.0, 0.0))),
            // Too short to have a direction.
            (Pose2::new(-0.02, 0.0, 0.0), Some(Pose2::new(0.02, 0.0, 0.0))),
        ]))
        .unwrap();
        assert_eq!((error.steps, error.opposed_steps), (3, 1));
        let squares: f64 = 0.06f64.powi(2) + 0.3f64.powi(2) + 0.01f64.powi(2) + 0.04f64.powi(2);
        assert!((error.translation_rmse - (squares / 3.0).sqrt()).abs() < 1e-12);
        assert!((error.rotation_rmse - (0.01f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((error.opposed_m - 0.2f64.hypot(0.01)).abs() < 1e-12);
        assert_eq!(OdometryError::of(&recording(&[])), None);
    }
}
