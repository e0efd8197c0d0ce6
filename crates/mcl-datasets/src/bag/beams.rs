//! Beams where the laser was when it measured them, and in the plane of the robot.

use mcl_core::{Pose2, ScanGeometry, is_usable_range};

/// The beams of a scan as seen from above, from where the laser was at its stamp.
#[derive(Debug, Default)]
pub(super) struct Beams {
    pub ranges: Vec<f64>,
    pub directions: Vec<f64>,
    /// Readings that are left out, as nothing tells where they were measured.
    pub lost: usize,
    /// The farthest that an endpoint was carried, in metres.
    pub farthest: f64,
}

/// Places the beams of a scan. `plane` carries coordinates in the plane of the scan over to the robot's, seen
/// from above; `moved` says where the laser was at a beam, in the frame of the laser at the stamp.
pub(super) fn place(
    geometry: ScanGeometry,
    ranges: &[f64],
    plane: [[f64; 2]; 2],
    moved: impl Fn(usize) -> Option<Pose2>,
) -> Beams {
    let mut beams = Beams::default();
    for (beam, &range) in ranges.iter().enumerate() {
        let (sin, cos) = geometry.angle(beam).sin_cos();
        let level = plane.map(|[along, across]| along * cos + across * sin);
        let is_usable = is_usable_range(range, f64::INFINITY);
        let pose = moved(beam);
        let (range, [x, y]) = match (pose, is_usable) {
            (Some(pose), true) => {
                let end = pose.compose(&Pose2::new(range * level[0], range * level[1], 0.0));
                let carried = (end.x - range * level[0]).hypot(end.y - range * level[1]);
                beams.farthest = beams.farthest.max(carried);
                (end.x.hypot(end.y), [end.x, end.y])
            }
            (Some(pose), false) => {
                let (sin, cos) = pose.theta.sin_cos();
                let [x, y] = level;
                (range, [x * cos - y * sin, x * sin + y * cos])
            }
            (None, true) => {
                beams.lost += 1;
                (f64::NAN, level)
            }
            (None, false) => (range, level),
        };
        beams.ranges.push(range);
        beams.directions.push(y.atan2(x));
    }
    beams
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn endpoints_move_with_the_laser_and_into_the_plane() {
        let geometry = ScanGeometry { start_angle: 0.0, angle_step: FRAC_PI_2, beams: 4 };
        // Pitched by 60°: what is ahead is seen at half its distance.
        let plane = [[0.5, 0.0], [0.0, 1.0]];
        let moved = |beam| match beam {
            3 => None,
            beam => Some(Pose2::new(beam as f64, 0.0, 0.0)),
        };
        let beams = place(geometry, &[2.0, 2.0, f64::INFINITY, 1.0], plane, moved);
        assert!((beams.ranges[0] - 1.0).abs() < 1e-15 && beams.directions[0].abs() < 1e-15);
        assert!((beams.ranges[1] - 5.0_f64.sqrt()).abs() < 1e-15);
        assert!((beams.directions[1] - 2.0_f64.atan2(1.0)).abs() < 1e-15);
        assert_eq!((beams.ranges[2], beams.lost), (f64::INFINITY, 1));
        assert!(beams.ranges[3].is_nan() && (beams.directions[3] + FRAC_PI_2).abs() < 1e-15);
        assert!((beams.farthest - 1.0).abs() < 1e-15);
    }
}
