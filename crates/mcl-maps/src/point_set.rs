use std::ops::Range;
use std::sync::OnceLock;

use mcl_core::{Bounds, NearestNeighbors, Point, check_finite};

use crate::MapError;

/// Points per leaf of the tree, at most; a multiple of [`LANES`].
const LEAF_POINTS: usize = 48;
/// Width of the vectors that the inner loops are written in.
pub(crate) const LANES: usize = 8;

/// The measured points D, arranged once for all the maps that are built from them: a bounding-box tree
/// whose leaves hold a few dozen neighbouring points each, coordinate by coordinate.
///
/// Coordinates are kept relative to the middle of the points, so that data far from the origin (UTM
/// coordinates, say) loses no digits.
pub struct PointSet<const D: usize> {
    points: Vec<Point<D>>,
    pub(crate) tree: Tree<D>,
    neighbors: OnceLock<NearestNeighbors<D>>,
}

impl<const D: usize> PointSet<D> {
    /// Arranges the points; O(N log N).
    ///
    /// # Errors
    /// [`MapError::Points`] when there is no point, or a coordinate is not finite.
    pub fn new(points: Vec<Point<D>>) -> Result<Self, MapError> {
        check_finite(&points)?;
        let bounds = Bounds::of(&points).ok_or(mcl_core::CoreError::NoPoints)?;
        let tree = Tree::new(&points, bounds);
        Ok(PointSet { points, tree, neighbors: OnceLock::new() })
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

    /// Points relative to the middle of the data.
    pub(crate) fn centred(&self, points: &[Point<D>]) -> Vec<Point<D>> {
        let origin = self.tree.origin;
        points.iter().map(|p| std::array::from_fn(|axis| p[axis] - origin[axis])).collect()
    }

    /// The reverse of [`centred`](Self::centred).
    pub(crate) fn absolute(&self, centred: &[Point<D>]) -> Vec<Point<D>> {
        let origin = self.tree.origin;
        centred.iter().map(|p| std::array::from_fn(|axis| p[axis] + origin[axis])).collect()
    }

    /// Nearest-neighbour search over the points, built at first use.
    pub fn neighbors(&self) -> &NearestNeighbors<D> {
        self.neighbors.get_or_init(|| {
            NearestNeighbors::new(&self.points).expect("the points were checked to be finite")
        })
    }
}

/// A node of the tree: a box around the points of a run of leaves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node<const D: usize> {
    pub bounds: Bounds<D>,
    /// Number of points below the node.
    pub points: usize,
    pub kind: NodeKind,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum NodeKind {
    /// Indices of the two halves.
    Split(usize, usize),
    /// Offset of the leaf's coordinates in [`Tree::coordinates`].
    Leaf(usize),
}

/// Boxes within boxes, split in the middle of the longest edge. A lone point far away is split off
/// early, so it never stretches the box of a leaf that others share for long.
pub(crate) struct Tree<const D: usize> {
    /// Node 0 is the root.
    pub nodes: Vec<Node<D>>,
    /// Per leaf: for each axis the coordinates of its points relative to `origin`, padded to a
    /// multiple of [`LANES`] with the last point.
    pub coordinates: Vec<f64>,
    pub origin: Point<D>,
}

impl<const D: usize> Tree<D> {
    fn new(points: &[Point<D>], bounds: Bounds<D>) -> Self {
        let origin = bounds.center();
        let mut centred: Vec<Point<D>> =
            points.iter().map(|p| std::array::from_fn(|axis| p[axis] - origin[axis])).collect();
        let mut tree = Tree {
            nodes: Vec::new(),
            coordinates: Vec::with_capacity(points.len() * D * 5 / 4),
            origin,
        };
        tree.build(&mut centred, 0..points.len());
        tree
    }

    /// Builds the subtree over a range of points and returns its index.
    fn build(&mut self, points: &mut [Point<D>], range: Range<usize>) -> usize {
        let part = &mut points[range.clone()];
        let bounds = Bounds::of(part).expect("a node has points");
        let index = self.nodes.len();
        let count = part.len();
        self.nodes.push(Node {
            bounds,
            points: count,
            kind: NodeKind::Leaf(self.coordinates.len()),
        });
        if count <= LEAF_POINTS {
            for axis in 0..D {
                self.coordinates.extend(part.iter().map(|point| point[axis]));
                let last = part[count - 1][axis];
                self.coordinates.extend(std::iter::repeat_n(last, padded(count) - count));
            }
            return index;
        }
        let longest =
            (0..D).max_by(|&a, &b| bounds.extent(a).total_cmp(&bounds.extent(b))).unwrap_or(0);
        let middle = 0.5 * (bounds.min[longest] + bounds.max[longest]);
        let mut below = partition(part, |point| point[longest] < middle);
        if below == 0 || below == count {
            // Equal points, or neighbouring floats: any split is as good as another.
            below = count / 2;
        }
        let left = self.build(points, range.start..range.start + below);
        let right = self.build(points, range.start + below..range.end);
        self.nodes[index].kind = NodeKind::Split(left, right);
        index
    }
}

/// The length of a leaf's coordinate runs in memory.
pub(crate) fn padded(count: usize) -> usize {
    count.next_multiple_of(LANES)
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
            let mut found = Vec::new();
            for node in &set.tree.nodes {
                let NodeKind::Leaf(offset) = node.kind else { continue };
                prop_assert!(node.points <= LEAF_POINTS);
                let stride = padded(node.points);
                for i in 0..stride {
                    let point: Point<2> =
                        std::array::from_fn(|axis| set.tree.coordinates[offset + axis * stride + i]);
                    for axis in 0..2 {
                        prop_assert!(point[axis] >= node.bounds.min[axis]);
                        prop_assert!(point[axis] <= node.bounds.max[axis]);
                    }
                    if i < node.points {
                        found.push(point.map(|c| (c * 1e6).round()));
                    }
                }
            }
            let origin = set.tree.origin;
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
