//! The mount of the laser on the robot.

use mcl_core::{Pose2, ScanGeometry, math};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::error::BagError;
use super::messages::planar;
use crate::log::options::LaserPose;

/// Largest tilt accepted between the scan plane and the robot's plane, in degrees. A laser may be tilted
/// slightly by accident; one that looks down on purpose does not scan the plane.
const MAX_TILT_DEGREES: f64 = 30.0;
/// Tilt (degrees) from which endpoints are projected into the plane: below it, the error is at most about a
/// per mille of the range.
const PROJECTED_TILT: f64 = 3.0;

/// The requested mount, at height `z` (m).
pub(super) fn in_space(laser: LaserPose, z: f64) -> Isometry3<f64> {
    let LaserPose { robot_from_laser: Pose2 { x, y, theta }, roll } = laser;
    let rotation = UnitQuaternion::from_euler_angles(roll, 0.0, theta);
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

/// The mount of the laser on the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LaserMount {
    pub robot_from_laser: Pose2,
    /// Mounted upside down, so that its beams turn the other way.
    pub is_upside_down: bool,
    /// Angle between the scan plane and the robot's plane.
    pub tilt_degrees: f64,
    /// Maps coordinates in the scan plane to the laser's frame seen from above.
    pub plane: [[f64; 2]; 2],
}

impl LaserMount {
    pub const IDENTITY: LaserMount = LaserMount {
        robot_from_laser: Pose2::IDENTITY,
        is_upside_down: false,
        tilt_degrees: 0.0,
        plane: [[1.0, 0.0], [0.0, 1.0]],
    };

    /// The mount given by a transform in space.
    pub fn of(robot_from_laser: &Isometry3<f64>) -> Self {
        let up = (robot_from_laser.rotation * Vector3::z()).z;
        let seen = planar(robot_from_laser);
        let tilt_degrees = math::acos(up.abs().min(1.0)).to_degrees();
        let is_upside_down = up < 0.0;
        let plane = match tilt_degrees >= PROJECTED_TILT {
            false if is_upside_down => [[1.0, 0.0], [0.0, -1.0]],
            false => LaserMount::IDENTITY.plane,
            true => {
                let turned = robot_from_laser.rotation.to_rotation_matrix();
                let (sin, cos) = math::sin_cos(seen.theta);
                let column = |of: usize| {
                    let [x, y] = [turned[(0, of)], turned[(1, of)]];
                    [x * cos + y * sin, y * cos - x * sin]
                };
                let [ahead, left] = [column(0), column(1)];
                [[ahead[0], left[0]], [ahead[1], left[1]]]
            }
        };
        LaserMount { robot_from_laser: seen, is_upside_down, tilt_degrees, plane }
    }

    /// The requested mount.
    pub fn asked(laser: LaserPose) -> Self {
        let mount = LaserMount::of(&in_space(laser, 0.0));
        LaserMount { robot_from_laser: laser.robot_from_laser, ..mount }
    }

    /// Returns it unless the laser is tilted too far to scan the plane.
    pub fn checked(self, base: &str, laser: &str) -> Result<Self, BagError> {
        if self.tilt_degrees > MAX_TILT_DEGREES {
            return Err(BagError::Tilted {
                laser_frame: laser.to_owned(),
                base_frame: base.to_owned(),
                degrees: self.tilt_degrees,
            });
        }
        Ok(self)
    }

    /// The mount for scans that are level and seen from above already.
    pub fn level(self) -> Self {
        LaserMount { robot_from_laser: self.robot_from_laser, ..LaserMount::IDENTITY }
    }

    /// The pose of the laser for a pose of the robot, both in the same frame.
    pub fn laser(&self, robot: Pose2) -> Pose2 {
        match self.robot_from_laser == Pose2::IDENTITY {
            true => robot,
            false => robot.compose(&self.robot_from_laser),
        }
    }

    /// Whether endpoints are projected into the plane of the robot.
    pub fn is_tilted(&self) -> bool {
        self.tilt_degrees >= PROJECTED_TILT
    }

    /// Directions of the beams as seen from above.
    pub fn seen_from_above(&self, geometry: ScanGeometry) -> ScanGeometry {
        if !self.is_upside_down {
            return geometry;
        }
        ScanGeometry {
            start_angle: -geometry.start_angle,
            angle_step: -geometry.angle_step,
            ..geometry
        }
    }
}
