//! The tree of frames on `/tf_static` and `/tf`, and the mount of the laser in it.

use std::collections::{BTreeMap, BTreeSet};

use mcl_core::{Pose2, ScanGeometry};
use nalgebra::{Isometry3, Vector3};

use super::error::BagError;
use super::messages::{TransformMessage, planar};

/// Frames that robots call their own, where no odometry says which it is.
pub(super) const BASE_FRAMES: [&str; 2] = ["base_link", "base_footprint"];
/// A transform on `/tf` that varies by less (metres, parts of a quaternion) is fixed.
const FIXED: f64 = 1e-6;
/// Tilt accepted between the plane of the scan and that of the robot, in degrees. Lasers are mounted
/// slightly tilted by accident; one that looks down on purpose does not scan the plane.
const MAX_TILT_DEGREES: f64 = 30.0;

/// How the laser sits on the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mount {
    pub robot_from_laser: Pose2,
    /// Mounted head down, so that its beams turn the other way.
    pub is_upside_down: bool,
}

impl Mount {
    pub const IDENTITY: Mount = Mount { robot_from_laser: Pose2::IDENTITY, is_upside_down: false };

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

#[derive(Debug, Clone)]
struct Edge {
    parent: String,
    parent_from_child: Isometry3<f64>,
    is_static: bool,
    is_moving: bool,
}

/// Each frame with its parent.
#[derive(Debug, Default)]
pub(super) struct Transforms {
    edges: BTreeMap<String, Edge>,
}

impl Transforms {
    /// Adds a transform. One on `/tf_static` stands above one on `/tf`; the last one counts.
    pub fn insert(&mut self, message: &TransformMessage, is_static: bool) {
        let edge = Edge {
            parent: message.header.frame.clone(),
            parent_from_child: message.parent_from_child,
            is_static,
            is_moving: false,
        };
        match self.edges.get_mut(&message.child) {
            Some(known) if known.is_static && !is_static => {}
            Some(known) if !is_static && known.parent == edge.parent => {
                known.is_moving |= !is_close(&known.parent_from_child, &edge.parent_from_child);
            }
            _ => drop(self.edges.insert(message.child.clone(), edge)),
        }
    }

    pub fn contains(&self, frame: &str) -> bool {
        self.edges.contains_key(frame) || self.edges.values().any(|edge| edge.parent == frame)
    }

    /// The frames from `frame` up to the root, each with its transform into the frame above it.
    fn chain(&self, frame: &str) -> Vec<(&str, &Edge)> {
        let mut chain = Vec::new();
        let mut seen = BTreeSet::new();
        let mut at = frame;
        while let Some((child, edge)) = self.edges.get_key_value(at)
            && seen.insert(at)
        {
            chain.push((child.as_str(), edge));
            at = &edge.parent;
        }
        chain
    }

    /// The first of the usual names of the robot's frame that the laser is fixed to.
    pub fn base_of(&self, laser: &str) -> Option<&'static str> {
        BASE_FRAMES.into_iter().find(|base| matches!(self.mount(base, laser), Ok(Some(_))))
    }

    /// How `laser` sits on `base`; `None` when no transforms lead from one to the other.
    ///
    /// # Errors
    /// When the transforms between them change, or tilt the laser out of the plane.
    pub fn mount(&self, base: &str, laser: &str) -> Result<Option<Mount>, BagError> {
        if base == laser {
            return Ok(Some(Mount::IDENTITY));
        }
        let (up_base, up_laser) = (self.chain(base), self.chain(laser));
        let above = |chain: &[(&str, &Edge)], start: &str| -> Vec<String> {
            let parents = chain.iter().map(|(_, edge)| edge.parent.clone());
            std::iter::once(start.to_owned()).chain(parents).collect()
        };
        let (base_frames, laser_frames) = (above(&up_base, base), above(&up_laser, laser));
        let meeting = base_frames.iter().enumerate().find_map(|(up, frame)| {
            laser_frames.iter().position(|other| other == frame).map(|other| (up, other))
        });
        let Some((base_steps, laser_steps)) = meeting else {
            return Ok(None);
        };
        let ancestor_from = |chain: &[(&str, &Edge)]| -> Result<Isometry3<f64>, BagError> {
            let mut transform = Isometry3::identity();
            for (child, edge) in chain {
                if edge.is_moving {
                    return Err(BagError::MovingLaser {
                        parent: edge.parent.clone(),
                        child: (*child).to_owned(),
                    });
                }
                transform = edge.parent_from_child * transform;
            }
            Ok(transform)
        };
        let ancestor_from_base = ancestor_from(&up_base[..base_steps])?;
        let ancestor_from_laser = ancestor_from(&up_laser[..laser_steps])?;
        let base_from_laser = match base_steps {
            0 => ancestor_from_laser,
            _ => ancestor_from_base.inverse() * ancestor_from_laser,
        };
        let up = (base_from_laser.rotation * Vector3::z()).z;
        let degrees = up.abs().min(1.0).acos().to_degrees();
        if degrees > MAX_TILT_DEGREES {
            return Err(BagError::Tilted {
                laser_frame: laser.to_owned(),
                base_frame: base.to_owned(),
                degrees,
            });
        }
        Ok(Some(Mount { robot_from_laser: planar(&base_from_laser), is_upside_down: up < 0.0 }))
    }
}

fn is_close(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let turn = a.rotation.coords.dot(&b.rotation.coords).abs();
    (a.translation.vector - b.translation.vector).amax() <= FIXED && 1.0 - turn <= FIXED
}

#[cfg(test)]
mod tests {
    use super::super::messages::Header;
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn edge(parent: &str, child: &str, xyz: [f64; 3], rpy: [f64; 3]) -> TransformMessage {
        TransformMessage {
            header: Header { stamp: 0, frame: parent.to_owned() },
            child: child.to_owned(),
            parent_from_child: Isometry3::from_parts(
                Translation3::new(xyz[0], xyz[1], xyz[2]),
                UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
            ),
        }
    }

    fn tree(edges: &[TransformMessage]) -> Transforms {
        let mut tree = Transforms::default();
        edges.iter().for_each(|edge| tree.insert(edge, true));
        tree
    }

    fn assert_pose(found: Pose2, expected: Pose2) {
        assert!(found.distance(&expected) < 1e-12, "{found:?}");
        assert!(mcl_core::wrap_angle(found.theta - expected.theta).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_chain_of_static_transforms() {
        let tree = tree(&[
            edge("base_link", "mast", [0.1, 0.0, 0.5], [0.0, 0.0, FRAC_PI_2]),
            edge("mast", "laser", [0.2, 0.0, 0.0], [0.0, 0.0, FRAC_PI_2]),
            edge("base_footprint", "base_link", [0.0, 0.0, 0.1], [0.0; 3]),
        ]);
        let mount = tree.mount("base_link", "laser").unwrap().unwrap();
        assert_pose(mount.robot_from_laser, Pose2::new(0.1, 0.2, PI));
        assert!(!mount.is_upside_down);
        assert_eq!(tree.mount("base_footprint", "laser").unwrap().unwrap(), mount);
        // Also down a branch beside the laser's.
        let back = tree.mount("laser", "base_link").unwrap().unwrap();
        assert_pose(back.robot_from_laser, mount.robot_from_laser.inverse());
        assert_eq!(tree.mount("base_link", "camera").unwrap(), None);
    }

    #[test]
    fn upside_down_and_tilted_lasers() {
        // Roll by π: x stays ahead, y and z are turned over.
        let down = tree(&[edge("base_link", "laser", [0.0; 3], [PI, 0.0, 0.25])]);
        let mount = down.mount("base_link", "laser").unwrap().unwrap();
        assert!(mount.is_upside_down);
        assert_pose(mount.robot_from_laser, Pose2::new(0.0, 0.0, 0.25));
        let geometry = ScanGeometry { start_angle: -1.0, angle_step: 0.5, beams: 5 };
        let seen = mount.seen_from_above(geometry);
        assert_eq!((seen.angle(0), seen.angle(4)), (1.0, -1.0));
        let tilted = tree(&[edge("base_link", "laser", [0.0; 3], [0.0, FRAC_PI_2, 0.0])]);
        let error = tilted.mount("base_link", "laser").unwrap_err();
        assert!(matches!(error, BagError::Tilted { degrees, .. } if (degrees - 90.0).abs() < 1e-6));
    }

    #[test]
    fn frames_that_move_or_go_in_circles() {
        let mut tree = Transforms::default();
        let at = |x| edge("base_link", "laser", [x, 0.0, 0.0], [0.0; 3]);
        tree.insert(&at(0.1), false);
        tree.insert(&at(0.1), false);
        assert!(tree.mount("base_link", "laser").unwrap().is_some());
        tree.insert(&at(0.2), false);
        assert!(matches!(tree.mount("base_link", "laser"), Err(BagError::MovingLaser { .. })));
        tree.insert(&at(0.3), true);
        let mount = tree.mount("base_link", "laser").unwrap().unwrap();
        assert_eq!(mount.robot_from_laser.x, 0.3);

        let circle =
            self::tree(&[edge("a", "b", [0.0; 3], [0.0; 3]), edge("b", "a", [0.0; 3], [0.0; 3])]);
        assert_eq!(circle.mount("a", "c").unwrap(), None);
    }
}
