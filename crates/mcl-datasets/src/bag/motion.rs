//! Poses of frames in space over time, from `/tf_static`, `/tf` and odometry.

use std::collections::{BTreeMap, BTreeSet};

use mcl_core::Pose2;
use nalgebra::{Isometry3, Translation3};

use super::error::BagError;
use super::laser::LaserMount;
use super::messages::{TransformMessage, planar};
use super::moment::Moment;
use super::track::longest_interval;

/// Frames that are fixed in the world (REP 105), and the usual names of map frames.
const FIXED_FRAMES: [&str; 5] = ["map", "odom", "earth", "world", "camera_init"];
/// The usual names of the robot's frame.
const BASE_FRAMES: [&str; 2] = ["base_link", "base_footprint"];
/// A transform on `/tf` that varies by less than this (metres, quaternion components) is fixed.
const FIXED: f64 = 1e-6;
/// One that varies by less than this (metres, degrees) sways: a base that follows the IMU, a soft suspension.
const SWAY: (f64, f64) = (0.05, 3.0);
/// A frame in its parent, over time.
#[derive(Debug)]
struct Edge {
    parent: String,
    /// In order of time once sorted; a static one has a single sample.
    samples: Vec<(Moment, Isometry3<f64>)>,
    is_static: bool,
    /// The topic that it was published on.
    topic: String,
    /// The longest time interpolated over, in nanoseconds.
    longest: i64,
    /// Largest deviation from its first sample: metres and degrees.
    spread: (f64, f64),
}

/// The tree of frames over time.
#[derive(Debug, Default)]
pub(super) struct Motion {
    edges: BTreeMap<String, Edge>,
    /// Edges of frames that move in several parents, by child: all but the one in `edges`.
    others: Vec<(String, Edge)>,
    /// Children for which two topics disagree.
    conflicts: BTreeMap<String, Conflict>,
}

/// How two topics disagree about a frame.
#[derive(Debug)]
struct Conflict {
    topics: [String; 2],
    parents: [String; 2],
    /// Where both have the same parent, how far they are apart: metres and degrees.
    apart: (f64, f64),
}

/// The frames from one up to its root.
pub(super) struct Chain<'a> {
    edges: Vec<(&'a str, &'a Edge)>,
    /// The frame at the top.
    pub root: &'a str,
}

/// Two frames with a common ancestor.
pub(super) struct Link<'a> {
    /// The frames from each of the two up to the ancestor.
    parent: Vec<(&'a str, &'a Edge)>,
    child: Vec<(&'a str, &'a Edge)>,
}

impl Motion {
    /// Adds a transform at a time. One on `/tf_static` takes precedence over those on `/tf`, and the last one
    /// of a frame counts; a frame that moves in several parents has a track in each.
    pub fn insert(&mut self, message: TransformMessage, at: Moment, is_static: bool, topic: &str) {
        let TransformMessage { header, child, parent_from_child } = message;
        let sample = (at, parent_from_child);
        let parent = header.frame;
        if let Some(known) = self.edges.get_mut(&child) {
            if known.topic != topic
                && let Some(found) = known.conflict(&parent, &parent_from_child, is_static, topic)
            {
                let worst = self.conflicts.get(&child);
                if worst.is_none_or(|worst| {
                    found.apart.0 + found.apart.1 > worst.apart.0 + worst.apart.1
                }) {
                    self.conflicts.insert(child.clone(), found);
                }
            }
            if !is_static && known.parent == parent {
                if !known.is_static {
                    known.samples.push(sample);
                }
                return;
            }
            let mut others = self.others.iter_mut();
            if !is_static
                && let Some((_, other)) =
                    others.find(|(of, other)| *of == child && other.parent == parent)
            {
                other.samples.push(sample);
                return;
            }
        }
        let edge = Edge {
            parent,
            samples: vec![sample],
            is_static,
            topic: topic.to_owned(),
            longest: i64::MAX,
            spread: (0.0, 0.0),
        };
        match self.edges.get_mut(&child) {
            Some(known) if known.is_static && !is_static => self.others.push((child, edge)),
            Some(known) if !known.is_static => {
                let before = std::mem::replace(known, edge);
                self.others.push((child, before));
            }
            _ => drop(self.edges.insert(child, edge)),
        }
    }

    /// The transforms by child, with all parents of a frame.
    fn all(&self) -> impl Iterator<Item = (&str, &Edge)> {
        let others = self.others.iter().map(|(child, edge)| (child.as_str(), edge));
        self.edges.iter().map(|(child, edge)| (child.as_str(), edge)).chain(others)
    }

    pub fn contains(&self, child: &str) -> bool {
        self.edges.contains_key(child)
    }

    /// Whether a frame is part of the tree.
    pub fn knows(&self, frame: &str) -> bool {
        self.contains(frame) || self.all().any(|(_, edge)| edge.parent == frame)
    }

    /// The contradictions found.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts = Vec::new();
        let contradictions: Vec<String> = self.conflicts.iter().take(10).map(|(child, found)| {
            let Conflict { topics: [first, second], parents: [one, other], apart } = found;
            match one == other {
                true => format!(
                    "{child} ({second} has it {:.3} m and {:.1}° from where {first} has it in {one:?})",
                    apart.0, apart.1
                ),
                false => format!("{child} (in {one:?} by {first}, in {other:?} by {second})"),
            }
        }).collect();
        if !contradictions.is_empty() {
            doubts.push(format!(
                "transforms: two topics contradict each other on {}; that of static transforms is used, else the last one",
                contradictions.join(", ")
            ));
        }
        doubts.extend(self.several_parents(|edge| !edge.is_of_odometry()).map(|frame| {
            format!("transforms: {frame} (--odom-frame NAME takes the odometry from another frame)")
        }));
        doubts
    }

    /// Remarks on frames that move in several parents.
    pub fn notes(&self) -> Vec<String> {
        self.several_parents(Edge::is_of_odometry)
            .map(|frame| format!("transforms: {frame}"))
            .collect()
    }

    /// Frames that move in several parents, restricted to those whose chosen track is `wanted`.
    fn several_parents(&self, wanted: impl Fn(&Edge) -> bool) -> impl Iterator<Item = String> {
        let mut parents: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (child, edge) in self.others.iter().filter(|(_, edge)| edge.is_moving()) {
            parents.entry(child).or_default().push(format!("{:?}", edge.parent));
        }
        let note = |(child, others): (&str, Vec<String>)| {
            let edge = self.edges.get(child).filter(|edge| edge.is_moving() && wanted(edge))?;
            Some(format!(
                "{child:?} moves in {:?} and also in {} on {}; the first is used unless an option names another",
                edge.parent,
                others.join(", "),
                edge.topic
            ))
        };
        parents.into_iter().filter_map(note).take(10).collect::<Vec<_>>().into_iter()
    }

    /// Sorts all samples by time; to be called before any query. `longest` is the longest time to interpolate
    /// over (ns), where requested.
    pub fn sort(&mut self, longest: Option<i64>) {
        // Of several parents, prefer the odometry: it is what a robot moves in.
        for (child, other) in &mut self.others {
            if let Some(edge) = self.edges.get_mut(child)
                && !edge.is_static
                && other.is_of_odometry()
                && !edge.is_of_odometry()
            {
                std::mem::swap(edge, other);
            }
        }
        let others = self.others.iter_mut().map(|(_, edge)| edge);
        for edge in self.edges.values_mut().chain(others) {
            edge.samples.sort_by_key(|&(at, _)| at);
            edge.longest = longest_interval(edge.samples.iter().map(|&(at, _)| at), longest);
            let Some(&(_, first)) = edge.samples.first() else { continue };
            for (_, sample) in &edge.samples {
                let metres = (first.translation.vector - sample.translation.vector).amax();
                let degrees = first.rotation.angle_to(&sample.rotation).to_degrees();
                edge.spread = (edge.spread.0.max(metres), edge.spread.1.max(degrees));
            }
        }
    }

    /// The chain of frames above `frame`.
    pub fn chain<'a>(&'a self, frame: &'a str) -> Chain<'a> {
        self.chain_by(frame, None)
    }

    /// [`Motion::chain`] with this transform of a child instead of the chosen one.
    fn chain_by<'a>(&'a self, frame: &'a str, by: Option<&'a (String, Edge)>) -> Chain<'a> {
        let mut chain = Chain { edges: Vec::new(), root: frame };
        let mut seen = BTreeSet::new();
        let edge = |child: &str| match by {
            Some((of, edge)) if of == child => Some(edge),
            _ => self.edges.get(child),
        };
        while let Some(edge) = edge(chain.root)
            && seen.insert(chain.root)
        {
            chain.edges.push((chain.root, edge));
            chain.root = &edge.parent;
        }
        chain
    }

    /// Whether a frame is fixed in the world: by its name, or because others move in it.
    pub fn is_fixed(&self, frame: &str) -> bool {
        FIXED_FRAMES.contains(&frame)
            || self.all().any(|(_, edge)| !edge.is_static && edge.parent == frame)
    }

    /// The link between two frames; `None` when no transforms lead from one to the other.
    pub fn link<'a>(&'a self, parent: &'a str, child: &'a str) -> Option<Link<'a>> {
        let by_others = || self.others.iter().find_map(|by| self.link_by(parent, child, Some(by)));
        self.link_by(parent, child, None).or_else(by_others)
    }

    fn link_by<'a>(
        &'a self,
        parent: &'a str,
        child: &'a str,
        by: Option<&'a (String, Edge)>,
    ) -> Option<Link<'a>> {
        let (mut up_parent, mut up_child) = (self.chain_by(parent, by), self.chain_by(child, by));
        let frames = |chain: &Chain<'a>| -> Vec<&'a str> {
            let below = chain.edges.iter().map(|&(frame, _)| frame);
            below.chain(std::iter::once(chain.root)).collect()
        };
        let of_child = frames(&up_child);
        let (from_parent, from_child) =
            frames(&up_parent).iter().enumerate().find_map(|(up, frame)| {
                of_child.iter().position(|other| other == frame).map(|other| (up, other))
            })?;
        up_parent.edges.truncate(from_parent);
        up_child.edges.truncate(from_child);
        Some(Link { parent: up_parent.edges, child: up_child.edges })
    }

    /// The frames of the robot and of its odometry, by how the laser moves: of the changing transforms above
    /// it, the one from a frame named after odometry, else the lowest. Where no transform leads to the laser,
    /// the only one from a frame named after odometry.
    pub fn robot(&self, laser: &str) -> Option<(String, String)> {
        let mut chain = self.chain(laser);
        if chain.edges.is_empty() {
            let all = self.edges.iter().filter(|(_, edge)| edge.is_of_odometry());
            chain.edges = all.map(|(child, edge)| (child.as_str(), edge)).collect();
            if chain.edges.len() != 1 {
                return None;
            }
        }
        let moving = || chain.edges.iter().filter(|(_, edge)| edge.is_moving());
        let is_odometry = |(_, edge): &&(&str, &Edge)| edge.is_of_odometry();
        // A robot that stands still all the time has odometry, too.
        let still = || chain.edges.iter().filter(|(_, edge)| !edge.is_static);
        let (child, edge) = moving()
            .find(is_odometry)
            .or_else(|| still().find(is_odometry))
            .or_else(|| moving().next())?;
        Some(((*child).to_owned(), edge.parent.clone()))
    }

    /// The first of the usual robot frames that the laser is fixed to.
    pub fn base_of(&self, laser: &str) -> Option<&'static str> {
        BASE_FRAMES.into_iter().find(|base| matches!(self.mount(base, laser), Ok(Some(_))))
    }

    /// The mount of `laser` on `base`; `None` when no transforms lead from one to the other. Where it sways,
    /// the first one.
    ///
    /// # Errors
    /// When the transforms between them change, or tilt the laser out of the plane.
    pub fn mount(&self, base: &str, laser: &str) -> Result<Option<LaserMount>, BagError> {
        let mount = self.any_mount(base, laser)?;
        mount.map(|mount| mount.checked(base, laser)).transpose()
    }

    /// [`Motion::mount`] with any tilt.
    ///
    /// # Errors
    /// When the transforms between them change.
    pub fn any_mount(&self, base: &str, laser: &str) -> Result<Option<LaserMount>, BagError> {
        if base == laser {
            return Ok(Some(LaserMount::IDENTITY));
        }
        let Some(link) = self.link(base, laser) else { return Ok(None) };
        if let Some((child, edge)) = link.edges().find(|(_, edge)| edge.is_moving()) {
            let (parent, child) = (edge.parent.clone(), (*child).to_owned());
            return Err(BagError::MovingLaser { parent, child });
        }
        Ok(link.first().map(|first| LaserMount::of(&first)))
    }

    /// The first pose of a frame on the robot in space; the identity where it is not known.
    pub fn mount_in_space(&self, base: &str, frame: &str) -> Isometry3<f64> {
        self.link(base, frame).and_then(|link| link.first()).unwrap_or_else(Isometry3::identity)
    }

    /// Mounts of all frames that are fixed to `base`, seen from above, by name.
    pub fn mounts(&self, base: &str) -> BTreeMap<String, Pose2> {
        let parents = self.all().map(|(_, edge)| edge.parent.as_str());
        let names: BTreeSet<&str> = self.edges.keys().map(String::as_str).chain(parents).collect();
        let mount = |name: &str| {
            let link = self.link(base, name)?;
            let is_fixed = !link.edges().any(|(_, edge)| edge.is_moving());
            let mount = link.first().filter(|_| is_fixed)?;
            Some((name.to_owned(), planar(&mount)))
        };
        names.into_iter().filter_map(mount).collect()
    }

    /// The names of all frames, at most a hundred.
    pub fn frames(&self) -> String {
        let parents = self.all().map(|(_, edge)| edge.parent.as_str());
        let names: BTreeSet<&str> = self.edges.keys().map(String::as_str).chain(parents).collect();
        names.into_iter().take(100).collect::<Vec<_>>().join(", ")
    }

    /// The planar poses of `child` in `parent` over time; `None` when no changing transforms lead from one to
    /// the other.
    pub fn poses(&self, parent: &str, child: &str) -> Option<Vec<(Moment, Pose2)>> {
        let poses = self.poses_in_space(parent, child)?;
        Some(poses.iter().map(|(at, pose)| (*at, planar(pose))).collect())
    }

    /// [`Motion::poses`] in space.
    pub fn poses_in_space(
        &self,
        parent: &str,
        child: &str,
    ) -> Option<Vec<(Moment, Isometry3<f64>)>> {
        let link = self.link(parent, child)?;
        let changing = link.edges().filter(|(_, edge)| !edge.is_static);
        let mut moments: Vec<Moment> =
            changing.flat_map(|(_, edge)| edge.samples.iter().map(|&(at, _)| at)).collect();
        if let ([], [(_, only)]) = (link.parent.as_slice(), link.child.as_slice()) {
            // Unchanged, including several of the same time.
            return (!only.is_static).then(|| only.samples.clone());
        }
        moments.sort_unstable();
        moments.dedup();
        let poses: Vec<_> = moments.into_iter().filter_map(|at| Some((at, link.at(at)?))).collect();
        (!poses.is_empty()).then_some(poses)
    }

    /// [`Motion::pairs`] of the frames that move and in which no other moves.
    pub fn moving_pairs(&self) -> Vec<String> {
        let moving = || self.all().filter(|(_, edge)| !edge.is_static);
        let is_lowest = |child: &str| moving().all(|(_, edge)| edge.parent != child);
        moving()
            .filter(|(child, _)| is_lowest(child))
            .map(|(child, _)| child)
            .collect::<BTreeSet<_>>()
            .into_iter()
            .flat_map(|child| self.pairs(child))
            .collect()
    }

    /// Pairs of frames above `frame`, with `frame`, that can be requested as a topic.
    pub fn pairs(&self, frame: &str) -> Vec<String> {
        let chain = self.chain(frame);
        let moves = chain.edges.iter().skip_while(|(_, edge)| edge.is_static);
        let topic = |edge: &Edge| format!("{}:{}.{frame}", edge.topic, edge.parent);
        let mut pairs: Vec<String> =
            moves.filter(|(_, edge)| !edge.is_of_odometry()).map(|(_, edge)| topic(edge)).collect();
        let above = |child: &str| chain.edges.iter().any(|(known, _)| *known == child);
        let others = self.others.iter().filter(|(child, _)| above(child));
        pairs
            .extend(others.filter(|(_, edge)| !edge.is_of_odometry()).map(|(_, edge)| topic(edge)));
        pairs
    }
}

impl Chain<'_> {
    /// Whether the lowest frame can move relative to the root.
    pub fn moves(&self) -> bool {
        self.edges.iter().any(|(_, edge)| !edge.is_static)
    }

    /// Maps coordinates of the lowest frame to the root at a time; `None` where part of the chain is not
    /// known: nothing is extrapolated.
    pub fn root_from_frame(&self, at: Moment) -> Option<Isometry3<f64>> {
        product(&self.edges, |edge| edge.at(at))
    }
}

/// Maps coordinates of the lowest frame to the parent of the highest.
fn product(
    edges: &[(&str, &Edge)],
    transform: impl Fn(&Edge) -> Option<Isometry3<f64>>,
) -> Option<Isometry3<f64>> {
    let mut product: Option<Isometry3<f64>> = None;
    for (_, edge) in edges {
        let transform = transform(edge)?;
        product = Some(match product {
            Some(below) => transform * below,
            None => transform,
        });
    }
    Some(product.unwrap_or_else(Isometry3::identity))
}

impl Link<'_> {
    fn edges(&self) -> impl Iterator<Item = &(&str, &Edge)> {
        self.parent.iter().chain(&self.child)
    }

    /// Whether it changes, within the bounds of swaying.
    pub fn sways(&self) -> bool {
        self.edges().any(|(_, edge)| edge.varies())
    }

    /// Maps coordinates of the child to the parent by these transforms.
    fn by(&self, edge: impl Fn(&Edge) -> Option<Isometry3<f64>>) -> Option<Isometry3<f64>> {
        let ancestor_from_child = product(&self.child, &edge)?;
        Some(match self.parent.is_empty() {
            true => ancestor_from_child,
            false => product(&self.parent, &edge)?.inverse() * ancestor_from_child,
        })
    }

    fn first(&self) -> Option<Isometry3<f64>> {
        // Of a static one, only the last sample is kept.
        self.by(|edge| edge.samples.first().map(|&(_, transform)| transform))
    }

    /// Maps coordinates of the child to the parent at a time; `None` where it is not known.
    pub fn at(&self, at: Moment) -> Option<Isometry3<f64>> {
        self.by(|edge| edge.at(at))
    }

    /// The mount at a time, where it is known.
    pub fn mount_at(&self, at: Moment) -> Option<LaserMount> {
        self.at(at).map(|transform| LaserMount::of(&transform))
    }
}

impl Edge {
    /// How another topic disagrees about its child.
    fn conflict(
        &self,
        parent: &str,
        parent_from_child: &Isometry3<f64>,
        is_static: bool,
        topic: &str,
    ) -> Option<Conflict> {
        let (_, last) = self.samples.last()?;
        let is_elsewhere = self.parent != parent;
        let is_fixed = self.is_static || is_static;
        if !is_elsewhere && (!is_fixed || is_close(last, parent_from_child)) {
            return None;
        }
        let metres = (last.translation.vector - parent_from_child.translation.vector).norm();
        let degrees = last.rotation.angle_to(&parent_from_child.rotation).to_degrees();
        Some(Conflict {
            topics: [self.topic.clone(), topic.to_owned()],
            parents: [self.parent.clone(), parent.to_owned()],
            apart: if is_elsewhere { (0.0, 0.0) } else { (metres, degrees) },
        })
    }

    /// Whether its parent is named after odometry: `odom`, `robot1/odom`, `odom_combined`.
    fn is_of_odometry(&self) -> bool {
        let name = self.parent.rsplit('/').next();
        !self.is_static && name.is_some_and(|name| name.starts_with("odom"))
    }

    fn varies(&self) -> bool {
        let (metres, degrees) = self.spread;
        metres > FIXED || degrees.to_radians() > 2.0 * (2.0 * FIXED).sqrt()
    }

    fn is_moving(&self) -> bool {
        self.spread.0 > SWAY.0 || self.spread.1 > SWAY.1
    }

    /// Interpolated between the two neighbours: positions linearly, orientations along the shorter arc.
    fn at(&self, moment: Moment) -> Option<Isometry3<f64>> {
        if self.is_static {
            return self.samples.last().map(|&(_, transform)| transform);
        }
        let next = self.samples.partition_point(|&(other, _)| other < moment);
        let &(after, to) = self.samples.get(next)?;
        if after == moment {
            return Some(to);
        }
        let &(before, from) = self.samples.get(next.checked_sub(1)?)?;
        let gap = i128::from(after.at) - i128::from(before.at);
        if before.stretch != after.stretch || gap > i128::from(self.longest) {
            return None;
        }
        let part = (i128::from(moment.at) - i128::from(before.at)) as f64 / gap as f64;
        let line = from.translation.vector.lerp(&to.translation.vector, part);
        // Half a turn has no shorter arc: take the nearer neighbour's orientation.
        let nearer = if part < 0.5 { from.rotation } else { to.rotation };
        let rotation = from.rotation.try_slerp(&to.rotation, part, 1e-9).unwrap_or(nearer);
        Some(Isometry3::from_parts(Translation3::from(line), rotation))
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
    use mcl_core::ScanGeometry;
    use nalgebra::{Point3, UnitQuaternion};
    use std::f64::consts::{FRAC_PI_2, PI};

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

    const fn at(at: i64) -> Moment {
        Moment { stretch: 0, at }
    }

    fn insert(motion: &mut Motion, message: TransformMessage, time: i64, is_static: bool) {
        let topic = if is_static { "/tf_static" } else { "/tf" };
        motion.insert(message, at(time), is_static, topic);
    }

    #[test]
    fn a_scanner_on_a_moving_robot() {
        let mut motion = Motion::default();
        // Out of order, as when topics are merged.
        insert(&mut motion, edge("odom", "base", 2.0, FRAC_PI_2), 100, false);
        insert(&mut motion, edge("odom", "base", 0.0, 0.0), 0, false);
        insert(&mut motion, edge("base", "lidar", 0.5, 0.0), 7, true);
        motion.sort(None);
        let chain = motion.chain("lidar");
        assert_eq!((chain.root, chain.moves()), ("odom", true));
        let place = |time| chain.root_from_frame(at(time)).map(|t| t * Point3::new(1.0, 0.0, 0.0));
        assert!((place(0).unwrap() - Point3::new(1.5, 0.0, 2.0)).norm() < 1e-12);
        assert!((place(100).unwrap() - Point3::new(2.0, 1.5, 2.0)).norm() < 1e-12);
        let half = 1.5 * 0.5_f64.sqrt();
        assert!((place(50).unwrap() - Point3::new(1.0 + half, half, 2.0)).norm() < 1e-12);
        assert_eq!((place(-1), place(101)), (None, None));
        assert!(motion.is_fixed("odom") && motion.is_fixed("map") && !motion.is_fixed("base"));
        assert!(!motion.chain("elsewhere").moves());
    }

    #[test]
    fn frames_that_go_in_circles_have_an_end() {
        let mut motion = Motion::default();
        insert(&mut motion, edge("a", "b", 0.0, 0.0), 0, true);
        insert(&mut motion, edge("b", "a", 0.0, 0.0), 0, true);
        assert!(motion.chain("b").root_from_frame(at(0)).is_some());
    }

    fn spatial(parent: &str, child: &str, xyz: [f64; 3], rpy: [f64; 3]) -> TransformMessage {
        TransformMessage {
            header: Header { stamp: 0, frame: parent.to_owned() },
            child: child.to_owned(),
            parent_from_child: Isometry3::from_parts(
                Translation3::new(xyz[0], xyz[1], xyz[2]),
                UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
            ),
        }
    }

    fn tree(edges: &[TransformMessage]) -> Motion {
        let mut tree = Motion::default();
        edges.iter().for_each(|edge| insert(&mut tree, edge.clone(), 0, true));
        tree.sort(None);
        tree
    }

    fn assert_pose(found: Pose2, expected: Pose2) {
        assert!(found.distance(&expected) < 1e-12, "{found:?}");
        assert!(mcl_core::wrap_angle(found.theta - expected.theta).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_chain_of_static_transforms() {
        let tree = tree(&[
            spatial("base_link", "mast", [0.1, 0.0, 0.5], [0.0, 0.0, FRAC_PI_2]),
            spatial("mast", "laser", [0.2, 0.0, 0.0], [0.0, 0.0, FRAC_PI_2]),
            spatial("base_footprint", "base_link", [0.0, 0.0, 0.1], [0.0; 3]),
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
        // Roll by π: x still points ahead, y and z are reversed.
        let down = tree(&[spatial("base_link", "laser", [0.0; 3], [PI, 0.0, 0.25])]);
        let mount = down.mount("base_link", "laser").unwrap().unwrap();
        assert!(mount.is_upside_down);
        assert_pose(mount.robot_from_laser, Pose2::new(0.0, 0.0, 0.25));
        let geometry = ScanGeometry { start_angle: -1.0, angle_step: 0.5, beams: 5 };
        let seen = mount.seen_from_above(geometry);
        assert_eq!((seen.angle(0), seen.angle(4)), (1.0, -1.0));
        let tilted = tree(&[spatial("base_link", "laser", [0.0; 3], [0.0, FRAC_PI_2, 0.0])]);
        let error = tilted.mount("base_link", "laser").unwrap_err();
        assert!(matches!(error, BagError::Tilted { degrees, .. } if (degrees - 90.0).abs() < 1e-6));
    }

    #[test]
    fn frames_that_move_or_go_in_circles() {
        let mut tree = Motion::default();
        let at = |x| spatial("base_link", "laser", [x, 0.0, 0.0], [0.0; 3]);
        insert(&mut tree, at(0.1), 1, false);
        insert(&mut tree, at(0.1), 2, false);
        tree.sort(None);
        assert!(tree.mount("base_link", "laser").unwrap().is_some());
        insert(&mut tree, at(0.2), 3, false);
        tree.sort(None);
        assert!(matches!(tree.mount("base_link", "laser"), Err(BagError::MovingLaser { .. })));
        insert(&mut tree, at(0.3), 4, true);
        tree.sort(None);
        let mount = tree.mount("base_link", "laser").unwrap().unwrap();
        assert_eq!(mount.robot_from_laser.x, 0.3);

        let circle = self::tree(&[
            spatial("a", "b", [0.0; 3], [0.0; 3]),
            spatial("b", "a", [0.0; 3], [0.0; 3]),
        ]);
        assert_eq!(circle.mount("a", "c").unwrap(), None);
    }
}
