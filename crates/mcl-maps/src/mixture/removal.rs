//! The loss of likelihood when a component is removed.

use std::f64::consts::LN_2;

use mcl_core::{Point, math};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::components::Components;
use super::exp::exp2_bounded;
use super::expectation::{Scratch, Task, Walk};
use super::kernel::{Row, centred_leaf, squared_distance};
use crate::PointSet;
use crate::point_set::{LEAF_POINTS, LeafPoints, Node, NodeKind};

/// Removal costs of the components of a mixture, at least two, on the data.
pub(crate) struct Removal {
    /// Σᵢ −ln(1 − pᵢⱼ): by how many nats Σᵢ ln Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²) falls when component j alone is
    /// removed and the others are unchanged; relative error at most 2·10⁻⁶.
    pub cost: Vec<f64>,
    /// The nearest and the second nearest component of each point, in the order of
    /// [`Tree::order`](crate::point_set::Tree).
    pub nearest: Vec<[u32; 2]>,
}

/// Computes the removal costs of two or more components of standard deviation `sigma` (m) at `means`, relative to
/// the centre of the data.
pub(crate) fn removal<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
) -> Removal {
    removal_on(Arch::new(), data, means, sigma)
}

/// [`removal`] with the instructions of `arch`.
fn removal_on<const D: usize>(
    arch: Arch,
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
) -> Removal {
    // Every point needs its two nearest components: without the nearest, the second one dominates.
    let walk = Walk::<D, 2>::new(arch, data, means.len(), sigma);
    let tasks = walk.tasks(means);
    let parts: Vec<TaskRemoval> = tasks
        .par_iter()
        .map_init(Scratch::default, |scratch, task| {
            let mut part =
                TaskRemoval { cost: vec![0.0; task.components.len()], nearest: Vec::new() };
            let mut add = |node, components: &Components<D>, rows: &mut Vec<Row>| {
                walk.removal_of_leaf(node, components, task, rows, &mut part);
            };
            walk.for_each_leaf(task.node, &task.components, 0, scratch, &mut add);
            part
        })
        .collect();
    let mut all = Removal { cost: vec![0.0; means.len()], nearest: Vec::with_capacity(data.len()) };
    for (task, part) in tasks.iter().zip(parts) {
        for (&place, cost) in task.places.iter().zip(&part.cost) {
            all.cost[place as usize] += cost;
        }
        all.nearest.extend(part.nearest);
    }
    all
}

/// The removal costs of the components of a task, and the components nearest to its points.
struct TaskRemoval {
    cost: Vec<f64>,
    nearest: Vec<[u32; 2]>,
}

impl<const D: usize> Walk<'_, D, 2> {
    fn removal_of_leaf(
        &self,
        node: usize,
        components: &Components<D>,
        task: &Task<D>,
        rows: &mut Vec<Row>,
        part: &mut TaskRemoval,
    ) {
        let Node { bounds, points: count, kind, .. } = &self.tree.nodes[node];
        let NodeKind::Leaf(index) = *kind else { return };
        let nearest = self.arch.dispatch(Leaf {
            points: &self.tree.leaves[index],
            count: *count,
            center: bounds.center(),
            components,
            inverse_unit: self.inverse_unit,
            rows,
            cost: &mut part.cost,
        });
        let among_all = |local: u32| task.places[components.places[local as usize] as usize];
        part.nearest.extend(nearest[..*count].iter().map(|pair| pair.map(among_all)));
    }
}

/// Adds the removal costs of the components for the points of one leaf to `cost[components.places[j]]`;
/// returns the two components nearest to each point.
struct Leaf<'a, const D: usize> {
    points: &'a LeafPoints<D>,
    count: usize,
    center: [f64; D],
    components: &'a Components<D>,
    inverse_unit: f64,
    rows: &'a mut Vec<Row>,
    cost: &'a mut [f64],
}

impl<const D: usize> NullaryFnOnce for Leaf<'_, D> {
    type Output = [[u32; 2]; LEAF_POINTS];

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Leaf { count, center, components, inverse_unit: scale, .. } = self;
        let points = centred_leaf(self.points, &center, scale);
        let mean = |j: usize| -> [f64; D] {
            std::array::from_fn(|axis| (components.coordinates(axis)[j] - center[axis]) * scale)
        };
        let len = components.len();
        if self.rows.len() < len {
            self.rows.resize(len, [0.0; LEAF_POINTS]);
        }
        let rows = &mut self.rows[..len];
        // Squared distances to the nearest and the second nearest component, and their indices.
        let (mut first, mut second) = ([f64::INFINITY; LEAF_POINTS], [f64::INFINITY; LEAF_POINTS]);
        let (mut first_at, mut second_at) = ([0.0; LEAF_POINTS], [0.0; LEAF_POINTS]);
        for (j, row) in rows.iter_mut().enumerate() {
            let (mean, at) = (mean(j), j as f64);
            for i in 0..LEAF_POINTS {
                let squared = squared_distance(&points, i, &mean);
                row[i] = squared;
                let (is_first, is_second) = (squared < first[i], squared < second[i]);
                second[i] = if is_first {
                    first[i]
                } else if is_second {
                    squared
                } else {
                    second[i]
                };
                second_at[i] = if is_first {
                    first_at[i]
                } else if is_second {
                    at
                } else {
                    second_at[i]
                };
                first[i] = if is_first { squared } else { first[i] };
                first_at[i] = if is_first { at } else { first_at[i] };
            }
        }
        // All but the nearest, in units of the second nearest: 1 or more, however far away it is.
        let mut rest = [0.0; LEAF_POINTS];
        for (j, row) in rows.iter_mut().enumerate() {
            let at = j as f64;
            for i in 0..LEAF_POINTS {
                let power = exp2_bounded(second[i] - row[i]);
                row[i] = if first_at[i] == at { 0.0 } else { power };
                rest[i] += row[i];
            }
        }
        // In units of the nearest, the others are q, and each of them q·row/rest.
        let (mut to_share, mut own) = ([0.0; LEAF_POINTS], [0.0; LEAF_POINTS]);
        for i in 0..LEAF_POINTS {
            let near = exp2_bounded(first[i] - second[i]);
            let q = near * rest[i];
            to_share[i] = if i < count { near / (1.0 + q) } else { 0.0 };
            own[i] = (1.0 + q) / rest[i];
        }
        for (j, row) in rows.iter().enumerate() {
            let mut sum = 0.0;
            for i in 0..LEAF_POINTS {
                // −ln(1 − p) = 2·artanh(p/(2 − p)), with p of at most ½.
                let p = row[i] * to_share[i];
                let t = p / (2.0 - p);
                let t2 = t * t;
                sum += t * (1.0 + t2 * (1.0 / 3.0 + t2 * (0.2 + t2 * (1.0 / 7.0 + t2 / 9.0))));
            }
            self.cost[components.places[j] as usize] += 2.0 * sum;
        }
        let mut nearest = [[0; 2]; LEAF_POINTS];
        for i in 0..count {
            nearest[i] = [first_at[i] as u32, second_at[i] as u32];
            let cost = LN_2 * (second[i] - first[i]) + math::ln(own[i]);
            self.cost[components.places[nearest[i][0] as usize] as usize] += cost;
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mixture::expectation;
    use crate::mixture::expectation::{crowds, instruction_sets};
    use mcl_core::Seed;
    use proptest::prelude::*;
    use rand::RngExt;

    proptest! {
        #[test]
        fn is_what_the_likelihood_loses(seed in 0..500u64, count in 2..40usize, sigma in 0.02..0.3f64) {
            let mut rng = Seed::new(seed).rng();
            let mut points: Vec<Point<2>> = (0..400)
                .map(|i| [0, 1].map(|_| f64::from(i % 5) + rng.random_range(-0.4..0.4)))
                .collect();
            points.push([30.0, 1.0]);
            let data = PointSet::new(points).unwrap();
            let mut means = data.centred(&data.points()[..count]);
            // Two components at the same position share their points.
            means.push(means[0]);
            let found = removal(&data, &means, sigma);
            let all = expectation(&data, &means, sigma, false).log_sum;
            for j in 0..means.len() {
                let mut others = means.clone();
                others.remove(j);
                let lost = all - expectation(&data, &others, sigma, false).log_sum;
                let slack = 1e-9 * all.abs() + 3e-6 * lost;
                prop_assert!((found.cost[j] - lost).abs() <= slack, "{} for {lost}", found.cost[j]);
            }
            for (point, [first, second]) in data.tree().leaf_points().zip(&found.nearest) {
                let mut squared: Vec<f64> = means
                    .iter()
                    .map(|mean| (mean[0] - point[0]).powi(2) + (mean[1] - point[1]).powi(2))
                    .collect();
                prop_assert!(first != second);
                let found = [first, second].map(|&index| squared[index as usize]);
                squared.sort_by(f64::total_cmp);
                for (found, expected) in found.iter().zip(&squared) {
                    prop_assert!((found - expected).abs() <= 1e-12 * (1.0 + expected));
                }
            }
        }
    }

    #[test]
    fn the_same_bits_for_every_instruction_set() {
        let data = PointSet::new(crowds(3000)).unwrap();
        let means = data.centred(&data.points()[..50]);
        let plain = removal_on(Arch::Scalar, &data, &means, 0.05);
        for arch in instruction_sets() {
            let wide = removal_on(arch, &data, &means, 0.05);
            assert_eq!(plain.cost, wide.cost, "{arch:?}");
            assert_eq!(plain.nearest, wide.nearest, "{arch:?}");
        }
    }
}
