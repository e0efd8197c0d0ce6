use std::ops::Range;
use std::sync::OnceLock;

use mcl_core::memory::check_room;
use mcl_core::{Bounds, NearestNeighbors, Point, check_finite, math};

use crate::MapError;

/// Largest number of points per leaf of the tree. A constant power of two, so that the compiler vectorizes loops
/// over a leaf without a remainder.
pub(crate) const LEAF_POINTS: usize = 32;
/// Nodes with at most this many points are split at multiples of a leaf. Above that, it would cost more than the
/// saved leaves are worth.
const ROUNDED_POINTS: usize = 16 * LEAF_POINTS;
/// Memory used per 2-D point while the tree is built, including the spare capacity of growing lists.
const TREE_BYTES: usize = 112;
/// The coordinates of the points of a leaf, `[axis][point]`.
pub(crate) type LeafPoints<const D: usize> = [[f64; LEAF_POINTS]; D];

/// The measured points D, with a bounding-box tree over them that is built once, at first use, for all maps built from
/// them. Its leaves hold a few dozen neighbouring points each, coordinate by coordinate.
///
/// The tree keeps coordinates relative to the centre of the points, so that data far from the origin (such as UTM
/// coordinates) loses no digits.
pub struct PointSet<const D: usize> {
    points: Vec<Point<D>>,
    origin: Point<D>,
    tree: OnceLock<Tree<D>>,
    neighbors: OnceLock<NearestNeighbors<D>>,
}

impl<const D: usize> PointSet<D> {
    /// Creates the set from its points.
    ///
    /// # Errors
    /// [`MapError::Points`] if there is no point, or a coordinate is not finite.
    pub fn new(points: Vec<Point<D>>) -> Result<Self, MapError> {
        check_finite(&points)?;
        let origin = Bounds::of(&points).ok_or(mcl_core::CoreError::NoPoints)?.center();
        Ok(PointSet { points, origin, tree: OnceLock::new(), neighbors: OnceLock::new() })
    }

    /// The points in their original order.
    pub fn points(&self) -> &[Point<D>] {
        &self.points
    }

    /// Number of points, at least 1.
    #[allow(clippy::len_without_is_empty)] // Never empty.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Converts points to coordinates relative to the centre of the data.
    pub(crate) fn centred(&self, points: &[Point<D>]) -> Vec<Point<D>> {
        let origin = self.origin;
        points.iter().map(|p| std::array::from_fn(|axis| p[axis] - origin[axis])).collect()
    }

    /// The inverse of [`centred`](Self::centred).
    pub(crate) fn absolute(&self, centred: &[Point<D>]) -> Vec<Point<D>> {
        let origin = self.origin;
        centred.iter().map(|p| std::array::from_fn(|axis| p[axis] + origin[axis])).collect()
    }

    /// Checks that there is memory for the [tree](Self::tree), unless it is already built.
    ///
    /// # Errors
    /// [`MapError::Memory`].
    pub(crate) fn check_tree_fits(&self) -> Result<(), MapError> {
        match self.tree.get() {
            Some(_) => Ok(()),
            None => Ok(check_room(self.len(), TREE_BYTES * D / 2, "points in a tree")?),
        }
    }

    /// The tree over the points, built at first use; O(N log N).
    pub(crate) fn tree(&self) -> &Tree<D> {
        self.tree.get_or_init(|| Tree::new(self.centred(&self.points)))
    }

    /// Checks that there is memory for [`neighbors`](Self::neighbors), unless it is already built.
    ///
    /// # Errors
    /// [`MapError::Memory`].
    pub(crate) fn check_neighbors_fit(&self) -> Result<(), MapError> {
        match self.neighbors.get() {
            Some(_) => Ok(()),
            None => Ok(NearestNeighbors::<D>::check_room(self.len())?),
        }
    }

    /// Nearest-neighbour search over the points, built at first use.
    pub fn neighbors(&self) -> &NearestNeighbors<D> {
        self.neighbors.get_or_init(|| {
            NearestNeighbors::new(&self.points).expect("the points were checked to be finite")
        })
    }
}

/// A node of the tree: a box around the points of consecutive leaves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node<const D: usize> {
    pub bounds: Bounds<D>,
    /// Number of points below the node.
    pub points: usize,
    /// Their mean, relative to the centre of the data.
    pub mean: Point<D>,
    /// The sum of their squared distances (m²) from the mean.
    pub scatter: f64,
    pub kind: NodeKind,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum NodeKind {
    /// Indices of the two halves.
    Split(usize, usize),
    /// Index into [`Tree::leaves`].
    Leaf(usize),
}

/// A tree of nested boxes, split in the middle of the longest edge. An outlier far away is thus split off early and
/// does not stretch the boxes of many levels.
pub(crate) struct Tree<const D: usize> {
    /// Node 0 is the root.
    pub nodes: Vec<Node<D>>,
    /// Coordinates relative to the centre of the data, each leaf padded with its last point.
    pub leaves: Vec<LeafPoints<D>>,
    /// The index of each point in the data, leaf by leaf without padding.
    pub order: Vec<u32>,
}

/// A point and its index in the data.
type IndexedPoint<const D: usize> = (Point<D>, u32);

impl<const D: usize> Tree<D> {
    fn new(centred: Vec<Point<D>>) -> Self {
        let mut tree = Tree { nodes: Vec::new(), leaves: Vec::new(), order: Vec::new() };
        let mut placed: Vec<IndexedPoint<D>> = centred.into_iter().zip(0..).collect();
        let all = 0..placed.len();
        tree.build(&mut placed, all);
        tree.order = placed.into_iter().map(|(_, place)| place).collect();
        tree
    }

    /// All points in the order of the tree, relative to the centre of the data.
    pub fn leaf_points(&self) -> impl Iterator<Item = Point<D>> {
        // Leaves are numbered in the order of their nodes.
        let leaves = self.nodes.iter().filter_map(|node| match node.kind {
            NodeKind::Leaf(index) => Some((&self.leaves[index], node.points)),
            NodeKind::Split(..) => None,
        });
        leaves.flat_map(|(leaf, count)| {
            (0..count).map(move |i| std::array::from_fn(|axis| leaf[axis][i]))
        })
    }

    /// Builds the subtree over a range of points and returns its index.
    fn build(&mut self, points: &mut [IndexedPoint<D>], range: Range<usize>) -> usize {
        let part = &mut points[range.clone()];
        let bounds =
            Bounds::around(part.iter().map(|(point, _)| *point)).expect("a node has points");
        let index = self.nodes.len();
        let count = part.len();
        let kind = NodeKind::Leaf(self.leaves.len());
        self.nodes.push(Node { bounds, points: count, mean: [0.0; D], scatter: 0.0, kind });
        if count <= LEAF_POINTS {
            (self.nodes[index].mean, self.nodes[index].scatter) = moments(part);
            self.leaves.push(std::array::from_fn(|axis| {
                std::array::from_fn(|i| part[i.min(count - 1)].0[axis])
            }));
            return index;
        }
        let longest =
            (0..D).max_by(|&a, &b| bounds.extent(a).total_cmp(&bounds.extent(b))).unwrap_or(0);
        let middle = 0.5 * (bounds.min[longest] + bounds.max[longest]);
        let mut below = partition(part, |(point, _)| point[longest] < middle);
        let whole_leaves = (below + LEAF_POINTS / 2) / LEAF_POINTS * LEAF_POINTS;
        if below == 0 || below == count {
            // Equal points or adjacent floats: any split will do.
            below = count / 2;
        } else if (1..count).contains(&whole_leaves) && count <= ROUNDED_POINTS {
            // Full leaves need no padding; the boxes grow by a few points.
            let order =
                |a: &IndexedPoint<D>, b: &IndexedPoint<D>| a.0[longest].total_cmp(&b.0[longest]);
            part.select_nth_unstable_by(whole_leaves, order);
            below = whole_leaves;
        }
        let left = self.build(points, range.start..range.start + below);
        let right = self.build(points, range.start + below..range.end);
        let (mean, scatter) = moments_of_both(&self.nodes[left], &self.nodes[right]);
        self.nodes[index] =
            Node { bounds, points: count, mean, scatter, kind: NodeKind::Split(left, right) };
        index
    }
}

/// The mean of one or more points, and the sum of their squared distances from it.
fn moments<const D: usize>(points: &[IndexedPoint<D>]) -> (Point<D>, f64) {
    let mut mean = [0.0; D];
    let mut scatter = 0.0;
    for axis in 0..D {
        mean[axis] = points.iter().map(|(p, _)| p[axis]).sum::<f64>() / points.len() as f64;
        scatter += points.iter().map(|(p, _)| math::square(p[axis] - mean[axis])).sum::<f64>();
    }
    (mean, scatter)
}

/// The mean and the sum of squared distances of the points of two nodes together.
fn moments_of_both<const D: usize>(left: &Node<D>, right: &Node<D>) -> (Point<D>, f64) {
    let part = right.points as f64 / (left.points + right.points) as f64;
    let mut mean = left.mean;
    let mut scatter = left.scatter + right.scatter;
    for axis in 0..D {
        let between = right.mean[axis] - left.mean[axis];
        mean[axis] += part * between;
        scatter += part * left.points as f64 * between * between;
    }
    (mean, scatter)
}

/// Moves the items that satisfy `below` to the front and returns their number.
fn partition<T>(items: &mut [T], below: impl Fn(&T) -> bool) -> usize {
    let mut first = 0;
    for index in 0..items.len() {
        if below(&items[index]) {
            items.swap(first, index);
            first += 1;
        }
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn leaves_hold_every_point_once_within_their_boxes(
            points in prop::collection::vec((-9..9i32, -9..9i32), 1..600),
            far in any::<bool>(),
        ) {
            let mut points: Vec<Point<2>> =
                points.iter().map(|&(x, y)| [f64::from(x) + 1e6, f64::from(y) / 3.0]).collect();
            if far {
                points.push([1e6, 1e4]);
            }
            let set = PointSet::new(points.clone()).unwrap();
            let root = &set.tree().nodes[0];
            let middle = set.centred(&points);
            let (mean, scatter) = moments(&middle.iter().map(|&point| (point, 0)).collect::<Vec<_>>());
            prop_assert!((root.scatter - scatter).abs() <= 1e-12 * scatter);
            for axis in 0..2 {
                let extent = root.bounds.extent(axis);
                prop_assert!((root.mean[axis] - mean[axis]).abs() <= 1e-12 * extent);
            }
            let mut found = Vec::new();
            let mut order = set.tree().order.iter();
            for node in &set.tree().nodes {
                let NodeKind::Leaf(index) = node.kind else { continue };
                prop_assert!(node.points <= LEAF_POINTS);
                for i in 0..LEAF_POINTS {
                    let point: Point<2> =
                        std::array::from_fn(|axis| set.tree().leaves[index][axis][i]);
                    for axis in 0..2 {
                        prop_assert!(point[axis] >= node.bounds.min[axis]);
                        prop_assert!(point[axis] <= node.bounds.max[axis]);
                    }
                    if i < node.points {
                        prop_assert_eq!(point, middle[*order.next().unwrap() as usize]);
                        found.push(point.map(|c| (c * 1e6).round()));
                    }
                }
            }
            let origin = set.origin;
            let mut expected: Vec<Point<2>> = points
                .iter()
                .map(|p| [p[0] - origin[0], p[1] - origin[1]].map(|c| (c * 1e6).round()))
                .collect();
            found.sort_by(|a, b| a.partial_cmp(b).unwrap());
            expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn no_points_and_no_numbers_are_refused() {
        assert!(PointSet::<2>::new(Vec::new()).is_err());
        assert!(PointSet::new(vec![[0.0, f64::INFINITY]]).is_err());
    }
}
