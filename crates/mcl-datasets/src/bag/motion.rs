//! Where frames were at a time, in space, by `/tf_static`, `/tf` and odometry.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, Translation3};

use super::messages::TransformMessage;

/// Frames that stand still in the world (REP 105), and the usual names of a map's.
const FIXED_FRAMES: [&str; 5] = ["map", "odom", "earth", "world", "camera_init"];

/// A frame in its parent, over time.
#[derive(Debug)]
struct Edge {
    parent: String,
    /// By time; a static one has a single sample.
    samples: Vec<(i64, Isometry3<f64>)>,
    is_static: bool,
}

/// The tree of frames over time.
#[derive(Debug, Default)]
pub(super) struct Motion {
    edges: BTreeMap<String, Edge>,
}

/// The frames from one up to its root.
pub(super) struct Chain<'a> {
    edges: Vec<&'a Edge>,
    /// The frame at the top.
    pub root: &'a str,
}

impl Motion {
    /// Adds a transform at a time. One on `/tf_static` stands above those on `/tf`; under a new parent, a
    /// frame begins anew.
    pub fn insert(&mut self, message: TransformMessage, at: i64, is_static: bool) {
        let TransformMessage { header, child, parent_from_child } = message;
        let sample = (at, parent_from_child);
        match self.edges.get_mut(&child) {
            Some(known) if known.is_static && !is_static => {}
            Some(known) if !is_static && known.parent == header.frame => known.samples.push(sample),
            _ => {
                let edge = Edge { parent: header.frame, samples: vec![sample], is_static };
                self.edges.insert(child, edge);
            }
        }
    }

    pub fn contains(&self, child: &str) -> bool {
        self.edges.contains_key(child)
    }

    /// Puts all samples in order of time; before any chain is asked.
    pub fn sort(&mut self) {
        for edge in self.edges.values_mut() {
            edge.samples.sort_by_key(|&(at, _)| at);
        }
    }

    /// The frames above `frame`.
    pub fn chain<'a>(&'a self, frame: &'a str) -> Chain<'a> {
        let mut chain = Chain { edges: Vec::new(), root: frame };
        let mut seen = BTreeSet::new();
        while let Some(edge) = self.edges.get(chain.root)
            && seen.insert(chain.root)
        {
            chain.edges.push(edge);
            chain.root = &edge.parent;
        }
        chain
    }

    /// Whether a frame stands still in the world: by its name, or because others move in it.
    pub fn is_fixed(&self, frame: &str) -> bool {
        FIXED_FRAMES.contains(&frame)
            || self.edges.values().any(|edge| !edge.is_static && edge.parent == frame)
    }
}

impl Chain<'_> {
    /// Whether the frame at its foot can move in its root.
    pub fn moves(&self) -> bool {
        self.edges.iter().any(|edge| !edge.is_static)
    }

    /// Carries coordinates of the frame at its foot into its root's, at a time; `None` where a part of it is
    /// not known: nothing is extrapolated.
    pub fn root_from_frame(&self, at: i64) -> Option<Isometry3<f64>> {
        let mut transform = Isometry3::identity();
        for edge in &self.edges {
            transform = edge.at(at)? * transform;
        }
        Some(transform)
    }
}

impl Edge {
    /// Between the two neighbours: on the line between the positions, on the shorter arc between the
    /// orientations.
    fn at(&self, at: i64) -> Option<Isometry3<f64>> {
        if self.is_static {
            return self.samples.last().map(|&(_, transform)| transform);
        }
        let next = self.samples.partition_point(|&(other, _)| other < at);
        let &(after, to) = self.samples.get(next)?;
        if after == at {
            return Some(to);
        }
        let &(before, from) = self.samples.get(next.checked_sub(1)?)?;
        let gap = i128::from(after) - i128::from(before);
        let part = (i128::from(at) - i128::from(before)) as f64 / gap as f64;
        let line = from.translation.vector.lerp(&to.translation.vector, part);
        // Half a turn has no shorter arc: the nearer neighbour's.
        let nearer = if part < 0.5 { from.rotation } else { to.rotation };
        let rotation = from.rotation.try_slerp(&to.rotation, part, 1e-9).unwrap_or(nearer);
        Some(Isometry3::from_parts(Translation3::from(line), rotation))
    }
}

#[cfg(test)]
mod tests {
    use super::super::messages::Header;
    use super::*;
    use nalgebra::{Point3, UnitQuaternion};
    use std::f64::consts::FRAC_PI_2;

    fn edge(parent: &str, child: &str, x: f64, yaw: f64) -> TransformMessage {
        TransformMessage {
            header: Header { stamp: 0, frame: parent.to_owned() },
            child: child.to_owned(),
            parent_from_child: Isometry3::from_parts(
                Translation3::new(x, 0.0, 1.0),
                UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
            ),
        }
    }

    #[test]
    fn a_scanner_on_a_moving_robot() {
        let mut motion = Motion::default();
        // Out of order, as topics are merged.
        motion.insert(edge("odom", "base", 2.0, FRAC_PI_2), 100, false);
        motion.insert(edge("odom", "base", 0.0, 0.0), 0, false);
        motion.insert(edge("base", "lidar", 0.5, 0.0), 7, true);
        motion.sort();
        let chain = motion.chain("lidar");
        assert_eq!((chain.root, chain.moves()), ("odom", true));
        let at = |time| chain.root_from_frame(time).map(|t| t * Point3::new(1.0, 0.0, 0.0));
        assert!((at(0).unwrap() - Point3::new(1.5, 0.0, 2.0)).norm() < 1e-12);
        assert!((at(100).unwrap() - Point3::new(2.0, 1.5, 2.0)).norm() < 1e-12);
        let half = 1.5 * 0.5_f64.sqrt();
        assert!((at(50).unwrap() - Point3::new(1.0 + half, half, 2.0)).norm() < 1e-12);
        assert_eq!((at(-1), at(101)), (None, None));
        assert!(motion.is_fixed("odom") && motion.is_fixed("map") && !motion.is_fixed("base"));
        assert!(!motion.chain("elsewhere").moves());
    }

    #[test]
    fn frames_that_go_in_circles_have_an_end() {
        let mut motion = Motion::default();
        motion.insert(edge("a", "b", 0.0, 0.0), 0, true);
        motion.insert(edge("b", "a", 0.0, 0.0), 0, true);
        assert!(motion.chain("b").root_from_frame(0).is_some());
    }
}
