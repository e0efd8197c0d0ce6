use std::f64::consts::LN_2;

use mcl_core::{Point, math};
use pulp::Arch;
use rayon::prelude::*;

use super::components::{Components, Filter, FilterScratch};
use super::kernel::{Leaf, Pull, PullLanes, Row, inverse_unit};
use super::log_product::LogProduct;
use crate::PointSet;
use crate::point_set::{Node, NodeKind, Tree};

/// ε: the terms omitted from the sum of a point are below this fraction of it.
const TRUNCATION: f64 = 1e-12;
/// Subtrees with at most this many points are one unit of parallel work. The number is fixed, so that sums are
/// combined in the same order for any number of threads.
const TASK_POINTS: usize = 4096;

/// Result of the E step of EM.
pub(crate) struct Expectation<const D: usize> {
    /// Σᵢ ln Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²).
    pub log_sum: f64,
    /// The pull of the points on each component; empty unless requested.
    pub pulls: Vec<Pull<D>>,
}

/// Runs the E step over all points of `data` for the mixture of equal Gaussians of standard deviation `sigma`
/// (m) at `means`, one or more, relative to the centre of the data ([`PointSet::centred`]).
pub(crate) fn expectation<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    with_pulls: bool,
) -> Expectation<D> {
    expectation_on(Arch::new(), data, means, sigma, with_pulls)
}

/// [`expectation`] with the instructions of `arch`.
fn expectation_on<const D: usize>(
    arch: Arch,
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    with_pulls: bool,
) -> Expectation<D> {
    let walk = Walk::<D, 1>::new(arch, data, means.len(), sigma);
    let tasks = walk.tasks(means);
    let results: Vec<(f64, Vec<Pull<D>>)> = tasks
        .par_iter()
        .map_init(Scratch::default, |scratch, task| walk.run(task, with_pulls, scratch))
        .collect();

    let mut log_sum = 0.0;
    let mut pulls = vec![Pull::NONE; if with_pulls { means.len() } else { 0 }];
    for (task, (task_log_sum, task_pulls)) in tasks.iter().zip(&results) {
        log_sum += task_log_sum;
        for (&place, pull) in task.places.iter().zip(task_pulls) {
            pulls[place as usize].add(pull);
        }
    }
    Expectation { log_sum, pulls }
}

/// A subtree and the components that its points may need, identified by their index in this list.
pub(super) struct Task<const D: usize> {
    pub node: usize,
    pub components: Components<D>,
    /// The indices of these components among all.
    pub places: Vec<u32>,
}

/// Traversal of the tree with the components that points need, for sums from which the `NEAREST` largest terms may be
/// left out.
pub(super) struct Walk<'a, const D: usize, const NEAREST: usize> {
    pub arch: Arch,
    pub tree: &'a Tree<D>,
    pub inverse_unit: f64,
    /// 2σ²·ln(2K/ε): how much further (m²) than the nearest a component still matters.
    reach: f64,
    /// 2σ²·ln(2⁰/(ε/2)), 2σ²·ln(2¹/(ε/2)), ...: the same for up to 2⁰, 2¹, ... components.
    reach_among: [f64; 33],
}

/// Working memory of a thread.
pub(super) struct Scratch<const D: usize> {
    filter: FilterScratch,
    pub rows: Vec<Row>,
    /// Component lists of the nodes on the path from a task's node to the current one.
    levels: Vec<Components<D>>,
}

impl<const D: usize> Default for Scratch<D> {
    fn default() -> Self {
        Scratch { filter: FilterScratch::default(), rows: Vec::new(), levels: Vec::new() }
    }
}

impl<'a, const D: usize, const NEAREST: usize> Walk<'a, D, NEAREST> {
    pub fn new(arch: Arch, data: &'a PointSet<D>, components: usize, sigma: f64) -> Self {
        let square = 2.0 * sigma * sigma;
        Walk {
            arch,
            tree: data.tree(),
            inverse_unit: inverse_unit(sigma),
            reach: square * math::ln(2.0 * components as f64 / TRUNCATION),
            reach_among: std::array::from_fn(|log2| {
                square * (LN_2 * (log2 + 1) as f64 - math::ln(TRUNCATION))
            }),
        }
    }

    /// The units of parallel work.
    pub fn tasks(&self, means: &[Point<D>]) -> Vec<Task<D>> {
        let mut tasks = Vec::new();
        let all = Components::new(means);
        self.collect_tasks(0, all, &mut FilterScratch::default(), &mut tasks);
        tasks
    }

    fn collect_tasks(
        &self,
        node: usize,
        mut components: Components<D>,
        scratch: &mut FilterScratch,
        tasks: &mut Vec<Task<D>>,
    ) {
        match self.tree.nodes[node].kind {
            NodeKind::Split(left, right) if self.tree.nodes[node].points > TASK_POINTS => {
                for child in [left, right] {
                    let mut kept = Components::default();
                    self.filter(child, &components, scratch, &mut kept);
                    self.collect_tasks(child, kept, scratch, tasks);
                }
            }
            _ => {
                let local = (0..components.len() as u32).collect();
                let places = std::mem::replace(&mut components.places, local);
                tasks.push(Task { node, components, places });
            }
        }
    }

    /// Keeps the components that the points of a node may need. Returns the squared distance within
    /// which each point has a component.
    pub fn filter(
        &self,
        node: usize,
        components: &Components<D>,
        scratch: &mut FilterScratch,
        kept: &mut Components<D>,
    ) -> f64 {
        let Node { bounds, kind, .. } = &self.tree.nodes[node];
        // Half of ε bounds the components omitted on the way to a leaf, at most K in total; the other half those
        // omitted at the leaf, fewer than its list has.
        let reach = match kind {
            NodeKind::Split(..) => self.reach,
            NodeKind::Leaf(_) => {
                self.reach_among[components.len().next_power_of_two().trailing_zeros() as usize]
            }
        };
        self.arch.dispatch(Filter::<D, NEAREST> { components, bounds, reach, scratch, kept })
    }
}

impl<const D: usize, const NEAREST: usize> Walk<'_, D, NEAREST> {
    /// Calls `visit` for every leaf below a node, in their order, with the index of its node and the
    /// components that its points may need.
    pub fn for_each_leaf(
        &self,
        node: usize,
        components: &Components<D>,
        level: usize,
        scratch: &mut Scratch<D>,
        visit: &mut impl FnMut(usize, &Components<D>, &mut Vec<Row>),
    ) {
        if scratch.levels.len() <= level {
            scratch.levels.resize(level + 1, Components::default());
        }
        let mut kept = std::mem::take(&mut scratch.levels[level]);
        self.filter(node, components, &mut scratch.filter, &mut kept);
        match self.tree.nodes[node].kind {
            NodeKind::Split(left, right) => {
                for child in [left, right] {
                    self.for_each_leaf(child, &kept, level + 1, scratch, visit);
                }
            }
            NodeKind::Leaf(_) => visit(node, &kept, &mut scratch.rows),
        }
        scratch.levels[level] = kept;
    }
}

impl<const D: usize> Walk<'_, D, 1> {
    fn run(
        &self,
        task: &Task<D>,
        with_pulls: bool,
        scratch: &mut Scratch<D>,
    ) -> (f64, Vec<Pull<D>>) {
        let mut pulls = vec![PullLanes::NONE; if with_pulls { task.components.len() } else { 0 }];
        let mut sums = LogProduct::ONE;
        let pulls_of = with_pulls.then_some(pulls.as_mut_slice());
        self.descend(task.node, &task.components, 0, scratch, &mut sums, pulls_of);
        (sums.ln(), pulls.iter().map(PullLanes::total).collect())
    }

    /// Multiplies `sums` by those of the points of a node, and adds to `pulls`. The node is `level` levels
    /// below that of its task, and its points need only these `components`.
    fn descend(
        &self,
        node: usize,
        components: &Components<D>,
        level: usize,
        scratch: &mut Scratch<D>,
        sums: &mut LogProduct,
        mut pulls: Option<&mut [PullLanes<D>]>,
    ) {
        let Node { bounds, points: count, kind, .. } = &self.tree.nodes[node];
        // Lists shrink little from one level to the next, so they are filtered at every second level.
        if let NodeKind::Split(left, right) = *kind
            && level.is_multiple_of(2)
        {
            for child in [left, right] {
                self.descend(child, components, level + 1, scratch, sums, pulls.as_deref_mut());
            }
            return;
        }
        if scratch.levels.len() <= level {
            scratch.levels.resize(level + 1, Components::default());
        }
        let mut kept = std::mem::take(&mut scratch.levels[level]);
        let covered = self.filter(node, components, &mut scratch.filter, &mut kept);
        match *kind {
            _ if kept.len() == 1 => self.alone(node, &kept, sums, pulls),
            NodeKind::Leaf(index) => self.arch.dispatch(Leaf {
                points: &self.tree.leaves[index],
                count: *count,
                center: bounds.center(),
                components: &kept,
                covered,
                inverse_unit: self.inverse_unit,
                rows: &mut scratch.rows,
                sums,
                pulls,
            }),
            NodeKind::Split(left, right) => {
                for child in [left, right] {
                    self.descend(child, &kept, level + 1, scratch, sums, pulls.as_deref_mut());
                }
            }
        }
        scratch.levels[level] = kept;
    }

    /// The case of a single component, whose sums follow from the moments of the points.
    fn alone(
        &self,
        node: usize,
        component: &Components<D>,
        sums: &mut LogProduct,
        pulls: Option<&mut [PullLanes<D>]>,
    ) {
        let Node { points, mean, scatter, .. } = &self.tree.nodes[node];
        let count = *points as f64;
        let displacement: [f64; D] =
            std::array::from_fn(|axis| mean[axis] - component.coordinates(axis)[0]);
        let squared: f64 = displacement.iter().map(|d| d * d).sum();
        sums.divide((scatter + count * squared) * self.inverse_unit * self.inverse_unit);
        if let Some(pulls) = pulls {
            pulls[component.places[0] as usize].add(count, displacement);
        }
    }
}

/// The instruction sets that the machine supports.
#[cfg(test)]
pub(super) fn instruction_sets() -> Vec<Arch> {
    let mut sets = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    sets.extend(pulp::x86::V3::try_new().map(Arch::V3));
    #[cfg(all(target_arch = "x86_64", feature = "avx512"))]
    sets.extend(pulp::x86::V4::try_new().map(Arch::V4));
    sets
}

/// This many points around seven centres.
#[cfg(test)]
pub(super) fn crowds(number: u32) -> Vec<Point<2>> {
    use rand::RngExt;

    let mut rng = mcl_core::Seed::new(1).rng();
    (0..number).map(|i| [0, 1].map(|_| f64::from(i % 7) + rng.random_range(-0.4..0.4))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Covers isolated and clustered components, short and long lists, near and far points.
    #[test]
    fn the_same_bits_for_every_instruction_set() {
        let mut points = crowds(5000);
        points.push([1e4, 0.0]);
        let data = PointSet::new(points).unwrap();
        for count in [1, 7, 40, 5001] {
            let means = data.centred(&data.points()[..count]);
            let plain = expectation_on(Arch::Scalar, &data, &means, 0.05, true);
            for arch in instruction_sets() {
                let wide = expectation_on(arch, &data, &means, 0.05, true);
                assert_eq!(plain.log_sum.to_bits(), wide.log_sum.to_bits(), "{arch:?}");
                assert_eq!(plain.pulls, wide.pulls, "{arch:?}");
            }
        }
    }
}
