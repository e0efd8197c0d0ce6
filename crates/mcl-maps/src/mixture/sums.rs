//! The mixture sums of the individual points, and their update when one component moves.

use mcl_core::Point;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::components::Components;
use super::exp::exp2_bounded;
use super::expectation::{Scratch, Walk};
use super::kernel::{Row, centred_leaf, inverse_unit, squared_distance};
use super::log_product::LogProduct;
use crate::PointSet;
use crate::point_set::{LEAF_POINTS, LeafPoints, NodeKind, Tree};

/// A component adds less than 2⁻⁴⁰ of the sum of any point farther away than this allows.
const NEGLIGIBLE: f64 = 40.0;
/// Powers of two are clamped to this, because LogProduct takes normal numbers.
const LARGEST: f64 = 900.0;

/// Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²) of every point, in units of the term of its nearest component at the last
/// [`new`](Self::new).
pub(crate) struct Sums<'a, const D: usize> {
    arch: Arch,
    tree: &'a Tree<D>,
    inverse_unit: f64,
    /// By leaf.
    leaves: Vec<LeafSums>,
    /// For each node the largest squared distance (in units of 1/`inverse_unit`²) of its points
    /// from their nearest component.
    furthest: Vec<f64>,
}

#[derive(Clone, Copy)]
struct LeafSums {
    /// Index of the leaf's node.
    node: usize,
    /// Squared distances to the nearest component, in units of 1/`inverse_unit`².
    shift: Row,
    sum: Row,
}

impl<'a, const D: usize> Sums<'a, D> {
    /// Computes the sums over components of standard deviation `sigma` (m) at `means`, one or more, relative to
    /// the centre of the data.
    pub fn new(data: &'a PointSet<D>, means: &[Point<D>], sigma: f64) -> Self {
        Self::on(Arch::new(), data, means, sigma)
    }

    /// [`new`](Self::new) with the instructions of `arch`.
    fn on(arch: Arch, data: &'a PointSet<D>, means: &[Point<D>], sigma: f64) -> Self {
        let tree = data.tree();
        let inverse_unit = inverse_unit(sigma);
        let walk = Walk::<D, 1>::new(arch, data, means.len(), sigma);
        let leaves: Vec<Vec<LeafSums>> = walk
            .tasks(means)
            .par_iter()
            .map_init(Scratch::default, |scratch, task| {
                let mut leaves = Vec::new();
                let mut add = |node: usize, components: &Components<D>, _: &mut Vec<Row>| {
                    let NodeKind::Leaf(index) = tree.nodes[node].kind else { return };
                    let center = tree.nodes[node].bounds.center();
                    let points = &tree.leaves[index];
                    let (shift, sum) =
                        arch.dispatch(LeafSum { points, center, components, inverse_unit });
                    leaves.push(LeafSums { node, shift, sum });
                };
                walk.for_each_leaf(task.node, &task.components, 0, scratch, &mut add);
                leaves
            })
            .collect();
        let leaves = leaves.concat();
        let mut furthest = vec![0.0; tree.nodes.len()];
        // Children come after their parent.
        for node in (0..tree.nodes.len()).rev() {
            furthest[node] = match tree.nodes[node].kind {
                NodeKind::Leaf(index) => leaves[index].shift.iter().copied().fold(0.0, f64::max),
                NodeKind::Split(left, right) => furthest[left].max(furthest[right]),
            };
        }
        Sums { arch, tree, inverse_unit, leaves, furthest }
    }

    /// Finds the indices of the leaves with points to whose sums a component at one of `places` contributes.
    pub fn near(&self, places: &[Point<D>], found: &mut Vec<usize>) {
        found.clear();
        let mut open = vec![0];
        while let Some(node) = open.pop() {
            let bounds = &self.tree.nodes[node].bounds;
            let limit = self.furthest[node] + NEGLIGIBLE;
            let is_near = |place: &Point<D>| {
                let squared = bounds.squared_distance(place);
                squared * self.inverse_unit * self.inverse_unit <= limit
            };
            if !places.iter().any(is_near) {
                continue;
            }
            match self.tree.nodes[node].kind {
                NodeKind::Leaf(index) => found.push(index),
                NodeKind::Split(left, right) => open.extend([right, left]),
            }
        }
    }

    /// The mean of the points of some leaves, weighted by the responsibility of a component at `place`
    /// (to where EM would move it); `None` if its total responsibility is 0.
    pub fn pulled(&self, place: &Point<D>, leaves: &[usize]) -> Option<Point<D>> {
        let (weight, displacement) = self.arch.dispatch(PulledFrom { sums: self, place, leaves });
        (weight > 0.0)
            .then(|| std::array::from_fn(|axis| place[axis] + displacement[axis] / weight))
    }

    /// The rise of Σᵢ ln Σⱼ … over the points of some leaves, in nats, when the component at `from` moves
    /// to each of `candidates`. The component's term is subtracted from the sum of each point, so the loss of a point
    /// is exact to 10⁻¹⁶·e^loss: enough to recognize good moves, but not to rank very bad ones.
    pub fn gains(&self, from: &Point<D>, candidates: &[Point<D>], leaves: &[usize]) -> Vec<f64> {
        let mut places = vec![*from];
        places.extend(candidates);
        let mut products = vec![LogProduct::ONE; places.len()];
        self.arch.dispatch(Moved { sums: self, places: &places, leaves, products: &mut products });
        let before = products[0].ln();
        products[1..].iter().map(|product| product.ln() - before).collect()
    }

    /// Moves a component. `leaves` are those to which it contributes at either position.
    pub fn shift(&mut self, from: &Point<D>, to: &Point<D>, leaves: &[usize]) {
        let (tree, inverse_unit) = (self.tree, self.inverse_unit);
        for &leaf in leaves {
            let sums = &mut self.leaves[leaf];
            let points = &tree.leaves[leaf];
            let center = tree.nodes[sums.node].bounds.center();
            self.arch.dispatch(Shift { points, center, inverse_unit, sums, from, to });
        }
    }
}

/// The contribution of a component at `place` to the sum of a point, in the unit of the point.
#[inline(always)]
fn power<const D: usize>(points: &LeafPoints<D>, i: usize, place: &[f64; D], shift: f64) -> f64 {
    let x = shift - squared_distance(points, i, place);
    exp2_bounded(if x < LARGEST { x } else { LARGEST })
}

/// A position in the unit of length, relative to the centre of a box.
#[inline(always)]
fn scaled<const D: usize>(place: &Point<D>, center: &[f64; D], scale: f64) -> [f64; D] {
    std::array::from_fn(|axis| (place[axis] - center[axis]) * scale)
}

struct LeafSum<'a, const D: usize> {
    points: &'a LeafPoints<D>,
    center: [f64; D],
    components: &'a Components<D>,
    inverse_unit: f64,
}

impl<const D: usize> NullaryFnOnce for LeafSum<'_, D> {
    type Output = (Row, Row);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let LeafSum { points, center, components, inverse_unit } = self;
        let points = centred_leaf(points, &center, inverse_unit);
        let place = |j: usize| {
            scaled(
                &std::array::from_fn(|axis| components.coordinates(axis)[j]),
                &center,
                inverse_unit,
            )
        };
        let mut shift = [f64::INFINITY; LEAF_POINTS];
        for j in 0..components.len() {
            let place = place(j);
            for i in 0..LEAF_POINTS {
                let squared = squared_distance(&points, i, &place);
                shift[i] = if squared < shift[i] { squared } else { shift[i] };
            }
        }
        let mut sum = [0.0; LEAF_POINTS];
        for j in 0..components.len() {
            let place = place(j);
            for i in 0..LEAF_POINTS {
                sum[i] += power(&points, i, &place, shift[i]);
            }
        }
        (shift, sum)
    }
}

struct PulledFrom<'a, 'b, const D: usize> {
    sums: &'a Sums<'b, D>,
    place: &'a Point<D>,
    leaves: &'a [usize],
}

impl<const D: usize> NullaryFnOnce for PulledFrom<'_, '_, D> {
    type Output = (f64, [f64; D]);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let PulledFrom { sums, place, leaves } = self;
        let mut weight = 0.0;
        let mut displacement = [0.0; D];
        for &leaf in leaves {
            let LeafSums { node, shift, sum } = &sums.leaves[leaf];
            let center = sums.tree.nodes[*node].bounds.center();
            let points = centred_leaf(&sums.tree.leaves[leaf], &center, sums.inverse_unit);
            let place = scaled(place, &center, sums.inverse_unit);
            let mut shares = [0.0; LEAF_POINTS];
            for i in 0..LEAF_POINTS {
                shares[i] = power(&points, i, &place, shift[i]) / sum[i];
            }
            for i in 0..sums.tree.nodes[*node].points {
                weight += shares[i];
                for axis in 0..D {
                    displacement[axis] += shares[i] * (points[axis][i] - place[axis]);
                }
            }
        }
        (weight, displacement.map(|sum| sum / sums.inverse_unit))
    }
}

/// Multiplies each product by the sums of the points, with the component moved from the first position to another.
struct Moved<'a, 'b, const D: usize> {
    sums: &'a Sums<'b, D>,
    places: &'a [Point<D>],
    leaves: &'a [usize],
    products: &'a mut [LogProduct],
}

impl<const D: usize> NullaryFnOnce for Moved<'_, '_, D> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Moved { sums, places, leaves, products } = self;
        for &leaf in leaves {
            let LeafSums { node, shift, sum } = &sums.leaves[leaf];
            let center = sums.tree.nodes[*node].bounds.center();
            let count = sums.tree.nodes[*node].points;
            let points = centred_leaf(&sums.tree.leaves[leaf], &center, sums.inverse_unit);
            let from = scaled(&places[0], &center, sums.inverse_unit);
            let mut others = [0.0; LEAF_POINTS];
            for i in 0..LEAF_POINTS {
                others[i] = without(sum[i], power(&points, i, &from, shift[i]));
            }
            for (place, product) in places.iter().zip(products.iter_mut()) {
                let place = scaled(place, &center, sums.inverse_unit);
                let mut moved = [0.0; LEAF_POINTS];
                for i in 0..LEAF_POINTS {
                    moved[i] = others[i] + power(&points, i, &place, shift[i]);
                }
                product.multiply(&moved, &[0.0; LEAF_POINTS], count);
            }
        }
    }
}

struct Shift<'a, const D: usize> {
    points: &'a LeafPoints<D>,
    center: [f64; D],
    inverse_unit: f64,
    sums: &'a mut LeafSums,
    from: &'a Point<D>,
    to: &'a Point<D>,
}

impl<const D: usize> NullaryFnOnce for Shift<'_, D> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Shift { points, center, inverse_unit, sums, from, to } = self;
        let points = centred_leaf(points, &center, inverse_unit);
        let (from, to) = (scaled(from, &center, inverse_unit), scaled(to, &center, inverse_unit));
        for i in 0..LEAF_POINTS {
            let shift = sums.shift[i];
            let others = without(sums.sum[i], power(&points, i, &from, shift));
            sums.sum[i] = others + power(&points, i, &to, shift);
        }
    }
}

/// The difference `sum − part`, at least 0 despite rounding.
#[inline(always)]
fn without(sum: f64, part: f64) -> f64 {
    let rest = sum - part;
    if rest > 0.0 { rest } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mixture::expectation::{crowds, instruction_sets};
    use crate::mixture::{Expectation, expectation};
    use mcl_core::Seed;
    use proptest::prelude::*;
    use rand::RngExt;

    proptest! {
        #[test]
        fn moves_gain_what_the_likelihood_gains(seed in 0..500u64, count in 1..40usize, sigma in 0.02..0.3f64) {
            let mut rng = Seed::new(seed).rng();
            let points: Vec<Point<2>> = (0..600)
                .map(|i| [0, 1].map(|_| f64::from(i % 5) + rng.random_range(-0.4..0.4)))
                .collect();
            let data = PointSet::new(points).unwrap();
            let mut means = data.centred(&data.points()[..count]);
            let mut sums = Sums::new(&data, &means, sigma);
            let mut leaves = Vec::new();
            for j in 0..means.len() {
                let Expectation { log_sum: before, pulls } = expectation(&data, &means, sigma, true);
                let near = |_| [0, 1].map(|axis| means[j][axis] + sigma * rng.random_range(-0.2..0.2));
                let candidates: Vec<Point<2>> = (0..3).map(near).collect();
                let mut places = candidates.clone();
                places.push(means[j]);
                sums.near(&places, &mut leaves);
                let target = sums.pulled(&means[j], &leaves).unwrap();
                for axis in 0..2 {
                    let expected = means[j][axis] + pulls[j].displacement[axis] / pulls[j].weight;
                    prop_assert!((target[axis] - expected).abs() < 1e-9, "{target:?}");
                }
                let gains = sums.gains(&means[j], &candidates, &leaves);
                let from = means[j];
                for (gain, candidate) in gains.iter().zip(&candidates) {
                    means[j] = *candidate;
                    let expected = expectation(&data, &means, sigma, false).log_sum - before;
                    let slack = 1e-8 * (1.0 + before.abs());
                    prop_assert!((gain - expected).abs() < slack, "{gain} for {expected}");
                }
                // The last move is kept.
                sums.shift(&from, &means[j], &leaves);
            }
        }
    }

    #[test]
    fn the_same_bits_for_every_instruction_set() {
        let data = PointSet::new(crowds(3000)).unwrap();
        let means = data.centred(&data.points()[..50]);
        let (from, to) = (means[3], [means[3][0] + 0.03, means[3][1] - 0.02]);
        let found = instruction_sets().into_iter().map(|arch| {
            let mut sums = Sums::on(arch, &data, &means, 0.05);
            let mut leaves = Vec::new();
            sums.near(&[from, to], &mut leaves);
            let pulled = sums.pulled(&from, &leaves).unwrap();
            let gains = sums.gains(&from, &[to, pulled], &leaves);
            sums.shift(&from, &to, &leaves);
            let bits = |row: Row| row.map(f64::to_bits);
            let all: Vec<_> = sums.leaves.iter().map(|l| (bits(l.shift), bits(l.sum))).collect();
            (leaves.len(), pulled.map(f64::to_bits), gains, all)
        });
        let found: Vec<_> = found.collect();
        assert!(found[0].0 > 0 && found.iter().all(|of_set| *of_set == found[0]));
    }
}
