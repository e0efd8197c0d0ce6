use std::f64::consts::LN_2;

use mcl_core::Point;
use pulp::Arch;
use rayon::prelude::*;

use super::components::{Components, Filter, FilterScratch};
use super::kernel::{Leaf, Pull, PullLanes, inverse_unit};
use super::log_product::LogProduct;
use crate::PointSet;
use crate::point_set::{LEAF_POINTS, Node, NodeKind, Tree};

/// ε: what a point's sum leaves out is below this part of it.
const TRUNCATION: f64 = 1e-12;
/// Subtrees with at most this many points are one unit of parallel work. Fixed, so that sums are
/// combined in the same order for any number of threads.
const TASK_POINTS: usize = 4096;

/// The E step of EM.
pub(crate) struct Expectation<const D: usize> {
    /// Σᵢ ln Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²).
    pub log_sum: f64,
    /// What the points pull at each component; empty unless asked for.
    pub pulls: Vec<Pull<D>>,
}

/// Sums over all points of `data` and the mixture of equal Gaussians of standard deviation `sigma`
/// (m) at `means`, one or more, relative to the middle of the data ([`PointSet::centred`]).
pub(crate) fn expectation<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    with_pulls: bool,
) -> Expectation<D> {
    let tree = &data.tree;
    let walk = Walk {
        arch: Arch::new(),
        tree,
        inverse_unit: inverse_unit(sigma),
        reach: 2.0 * sigma * sigma * (2.0 * means.len() as f64 / TRUNCATION).ln(),
        reach_among: std::array::from_fn(|log2| {
            2.0 * sigma * sigma * (LN_2 * (log2 + 1) as f64 - TRUNCATION.ln())
        }),
    };
    let all = Components::new(means);
    let mut tasks = Vec::new();
    walk.collect_tasks(0, all, &mut FilterScratch::default(), &mut tasks);
    let results: Vec<(f64, Vec<Pull<D>>)> = tasks
        .par_iter()
        .map_init(Scratch::default, |scratch, task| walk.run(task, with_pulls, scratch))
        .collect();

    let mut log_sum = 0.0;
    let mut pulls = vec![Pull::NONE; if with_pulls { means.len() } else { 0 }];
    for (task, (task_log_sum, task_pulls)) in tasks.iter().zip(&results) {
        log_sum += task_log_sum;
        for (&place, pull) in task.components.places.iter().zip(task_pulls) {
            pulls[place as usize].add(pull);
        }
    }
    Expectation { log_sum, pulls }
}

/// A subtree and the components that its points may need.
struct Task<const D: usize> {
    node: usize,
    components: Components<D>,
}

struct Walk<'a, const D: usize> {
    arch: Arch,
    tree: &'a Tree<D>,
    inverse_unit: f64,
    /// 2σ²·ln(2K/ε): how much further (m²) than the nearest a component still matters.
    reach: f64,
    /// 2σ²·ln(2⁰/(ε/2)), 2σ²·ln(2¹/(ε/2)), ...: the same among up to 2⁰, 2¹, ... components.
    reach_among: [f64; 33],
}

/// Working memory of a thread.
struct Scratch<const D: usize> {
    filter: FilterScratch,
    rows: Vec<[f64; LEAF_POINTS]>,
    /// Component lists of the path from a task's node down to the current one.
    levels: Vec<Components<D>>,
}

impl<const D: usize> Default for Scratch<D> {
    fn default() -> Self {
        Scratch { filter: FilterScratch::default(), rows: Vec::new(), levels: Vec::new() }
    }
}

impl<const D: usize> Walk<'_, D> {
    fn collect_tasks(
        &self,
        node: usize,
        components: Components<D>,
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
            _ => tasks.push(Task { node, components }),
        }
    }

    /// Keeps the components that the points of a node may need. Returns the squared distance within
    /// which each of them has a component.
    fn filter(
        &self,
        node: usize,
        components: &Components<D>,
        scratch: &mut FilterScratch,
        kept: &mut Components<D>,
    ) -> f64 {
        let Node { bounds, kind, .. } = &self.tree.nodes[node];
        // Half of ε is for what is left out on the way to a leaf, in all at most K components; half is
        // for what is left out at the leaf, fewer than the list has.
        let reach = match kind {
            NodeKind::Split(..) => self.reach,
            NodeKind::Leaf(_) => {
                self.reach_among[components.len().next_power_of_two().trailing_zeros() as usize]
            }
        };
        self.arch.dispatch(Filter { components, bounds, reach, scratch, kept })
    }

    fn run(
        &self,
        task: &Task<D>,
        with_pulls: bool,
        scratch: &mut Scratch<D>,
    ) -> (f64, Vec<Pull<D>>) {
        let len = task.components.len();
        let mut pulls = vec![PullLanes::NONE; if with_pulls { len } else { 0 }];
        // Within a task, components are known by their place in the task's list.
        let mut local = task.components.clone();
        local.places = (0..len as u32).collect();
        let mut sums = LogProduct::ONE;
        let pulls_of = with_pulls.then_some(pulls.as_mut_slice());
        self.descend(task.node, &local, 0, scratch, &mut sums, pulls_of);
        (sums.ln(), pulls.iter().map(PullLanes::total).collect())
    }

    fn descend(
        &self,
        node: usize,
        components: &Components<D>,
        level: usize,
        scratch: &mut Scratch<D>,
        sums: &mut LogProduct,
        mut pulls: Option<&mut [PullLanes<D>]>,
    ) {
        if scratch.levels.len() <= level {
            scratch.levels.push(Components::default());
        }
        let Node { bounds, points: count, mean, scatter, kind } = &self.tree.nodes[node];
        if let NodeKind::Split(left, right) = *kind
            && level % 2 == 1
        {
            // Lists shrink little from one level to the next.
            for child in [left, right] {
                self.descend(child, components, level + 1, scratch, sums, pulls.as_deref_mut());
            }
            return;
        }
        let mut kept = std::mem::take(&mut scratch.levels[level]);
        let covered = self.filter(node, components, &mut scratch.filter, &mut kept);
        if let [place] = kept.places[..] {
            let displacement = std::array::from_fn(|axis| mean[axis] - kept.coordinates(axis)[0]);
            let squared: f64 = displacement.iter().map(|d| d * d).sum();
            let count = *count as f64;
            sums.divide((scatter + count * squared) * self.inverse_unit * self.inverse_unit);
            if let Some(pulls) = pulls {
                pulls[place as usize].add(count, displacement);
            }
            scratch.levels[level] = kept;
            return;
        }
        match *kind {
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
}
