//! A planar scan from a point cloud: the nearest point in each direction, among those between two heights.

use std::f64::consts::{PI, TAU};

use mcl_core::{Pose2, ScanGeometry, math};
use nalgebra::{Isometry3, Point3};

use super::cdr::View;
use super::messages::{MessageError, ScanMessage, planar};
use super::point_cloud::CloudMessage;

/// Directions per turn, a quarter of a degree apart.
const BEAMS: usize = 1440;

/// Makes a scan of a `sensor_msgs/PointCloud2` from the points whose height in the robot's frame lies in
/// `heights` (m), seen from the scanner's position in the plane. `robot_from_frame` is the pose of the
/// cloud's frame on the robot.
pub(super) fn scan(
    view: &View<'_>,
    robot_from_frame: impl Fn(&str) -> Isometry3<f64>,
    heights: (f64, f64),
) -> Result<ScanMessage, MessageError> {
    let cloud = CloudMessage::new(view, None)?;
    let robot_from_lidar = robot_from_frame(&cloud.header.frame);
    let geometry = ScanGeometry { start_angle: -PI, angle_step: TAU / BEAMS as f64, beams: BEAMS };
    let laser_from_robot: Pose2 = planar(&robot_from_lidar).inverse();
    let mut ranges = vec![f64::INFINITY; BEAMS];
    for &[x, y, z] in &cloud.points {
        let point = robot_from_lidar * Point3::new(x, y, z);
        if !(heights.0..=heights.1).contains(&point.z) {
            continue;
        }
        let seen = laser_from_robot.compose(&Pose2::new(point.x, point.y, 0.0));
        let range = math::hypot(seen.x, seen.y);
        if range > 0.0 {
            let step = (math::atan2(seen.y, seen.x) - geometry.start_angle) / geometry.angle_step;
            let nearest = &mut ranges[step.round() as usize % BEAMS];
            *nearest = nearest.min(range);
        }
    }
    let last_angle = geometry.angle(BEAMS - 1);
    let header = cloud.header;
    let (time_increment, scan_time) = (0.0, 0.0);
    Ok(ScanMessage { header, geometry, ranges, at_max: 0, last_angle, time_increment, scan_time })
}
