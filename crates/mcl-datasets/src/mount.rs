//! The mount of the laser on the robot, as needed by writers: poses in recordings are the laser's, those in
//! logs the robot's.

use mcl_core::Pose2;

/// Converts poses and increments of the laser to those of the robot; exactly, where the two frames are the
/// same.
pub(crate) struct MountConversion {
    robot_from_laser: Pose2,
    laser_from_robot: Pose2,
    is_identity: bool,
}

impl MountConversion {
    pub fn new(robot_from_laser: Pose2) -> Self {
        MountConversion {
            robot_from_laser,
            laser_from_robot: robot_from_laser.inverse(),
            is_identity: robot_from_laser == Pose2::IDENTITY,
        }
    }

    pub fn robot_pose(&self, laser: Pose2) -> Pose2 {
        if self.is_identity { laser } else { laser.compose(&self.laser_from_robot) }
    }

    pub fn laser_pose(&self, robot: Pose2) -> Pose2 {
        if self.is_identity { robot } else { robot.compose(&self.robot_from_laser) }
    }

    pub fn robot_increment(&self, laser_increment: Pose2) -> Pose2 {
        if self.is_identity {
            return laser_increment;
        }
        self.robot_from_laser.compose(&laser_increment).compose(&self.laser_from_robot)
    }
}
