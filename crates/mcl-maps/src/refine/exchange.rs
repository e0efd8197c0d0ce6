use mcl_core::{Point, math};

use super::{Progress, Stage};
use crate::mixture::{Sums, expectation, log_likelihood};
use crate::point_set::{LEAF_POINTS, NodeKind, Tree};
use crate::{FkmSettings, PointSet};

/// Number of data points that a kept one may be exchanged for: those nearest to where EM would move it.
const CANDIDATES: usize = 8;

/// Replaces the means by distinct data points, and exchanges these for others nearby as long as the likelihood of the
/// data under the subset rises. Returns the indices of the kept points, in the order of the means, and whether the
/// last sweep gained at most the tolerance.
pub(super) fn search<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    settings: &FkmSettings,
    sweeps: usize,
    progress: &mut Progress,
) -> (Vec<usize>, bool) {
    let tree = data.tree();
    let mut search = Nearest::new(tree);
    let mut kept: Vec<Slot> = Vec::with_capacity(means.len());
    for mean in means {
        // There are no more means than points, so a free point is left for each.
        let [slot] = search.nearest_free::<1>(mean).map(|found| found.expect("a free point").0);
        search.take(slot, true);
        kept.push(slot);
    }
    let per_point = |kept: &[Slot], progress: &mut Progress| {
        let log_sum = expectation(data, &places(kept, tree), settings.sigma, false).log_sum;
        progress.evaluations += 1;
        log_likelihood(data.len(), log_sum, D, kept.len(), settings.sigma).per_point
    };
    let mut best = per_point(&kept, progress);
    progress.step(Stage::Snap, best);
    let mut settled = false;
    for _ in 0..sweeps {
        if settled || progress.is_over() {
            break;
        }
        let before = kept.clone();
        sweep(data, &mut kept, &mut search, settings.sigma);
        progress.evaluations += 1;
        let found = per_point(&kept, progress);
        settled = found - best < settings.tolerance;
        if found > best {
            best = found;
            progress.step(Stage::Exchange, best);
        } else {
            // The sums carry rounding errors of their updates, and the last gains were below these.
            kept = before;
            break;
        }
    }
    let indices = kept.iter().map(|slot| slot.index(&search.starts, tree)).collect();
    (indices, settled)
}

fn places<const D: usize>(kept: &[Slot], tree: &Tree<D>) -> Vec<Point<D>> {
    kept.iter().map(|slot| slot.point(tree)).collect()
}

/// Tries to exchange each kept point once.
fn sweep<const D: usize>(
    data: &PointSet<D>,
    kept: &mut [Slot],
    search: &mut Nearest<D>,
    sigma: f64,
) {
    let tree = data.tree();
    let places = places(kept, tree);
    let mut sums = Sums::new(data, &places, sigma);
    let mut leaves = Vec::new();
    for (slot, from) in kept.iter_mut().zip(&places) {
        sums.near(&[*from], &mut leaves);
        let Some(target) = sums.pulled(from, &leaves) else { continue };
        let candidates: Vec<Slot> = search
            .nearest_free::<CANDIDATES>(&target)
            .into_iter()
            .flatten()
            .map(|(s, _)| s)
            .collect();
        let mut around: Vec<Point<D>> = candidates.iter().map(|slot| slot.point(tree)).collect();
        around.push(*from);
        sums.near(&around, &mut leaves);
        around.pop();
        let gains = sums.gains(from, &around, &leaves);
        let Some(best) = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])) else {
            continue;
        };
        if gains[best] > 0.0 {
            sums.shift(from, &around[best], &leaves);
            search.take(*slot, false);
            search.take(candidates[best], true);
            *slot = candidates[best];
        }
    }
}

/// A data point, identified by its position in the tree.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Slot {
    leaf: usize,
    place: usize,
}

impl Slot {
    /// The point, relative to the centre of the data.
    fn point<const D: usize>(&self, tree: &Tree<D>) -> Point<D> {
        std::array::from_fn(|axis| tree.leaves[self.leaf][axis][self.place])
    }

    /// Its index in the data.
    fn index<const D: usize>(&self, starts: &[usize], tree: &Tree<D>) -> usize {
        tree.order[starts[self.leaf] + self.place] as usize
    }
}

/// Search for the nearest data points that are not in the subset.
struct Nearest<'a, const D: usize> {
    tree: &'a Tree<D>,
    /// Index of the first point of each leaf in the order of the tree.
    starts: Vec<usize>,
    counts: Vec<usize>,
    is_taken: Vec<[bool; LEAF_POINTS]>,
}

impl<'a, const D: usize> Nearest<'a, D> {
    fn new(tree: &'a Tree<D>) -> Self {
        let mut starts = Vec::with_capacity(tree.leaves.len());
        let mut counts = Vec::with_capacity(tree.leaves.len());
        let mut total = 0;
        for node in &tree.nodes {
            if let NodeKind::Leaf(_) = node.kind {
                starts.push(total);
                counts.push(node.points);
                total += node.points;
            }
        }
        let is_taken = vec![[false; LEAF_POINTS]; tree.leaves.len()];
        Nearest { tree, starts, counts, is_taken }
    }

    fn take(&mut self, slot: Slot, is_taken: bool) {
        self.is_taken[slot.leaf][slot.place] = is_taken;
    }

    /// The `N` free points nearest to a position with their squared distances, nearest first; of equally
    /// near ones the first in the tree.
    fn nearest_free<const N: usize>(&self, place: &Point<D>) -> [Option<(Slot, f64)>; N] {
        let mut found: [Option<(Slot, f64)>; N] = [None; N];
        self.visit(0, place, &mut found);
        found
    }

    fn visit<const N: usize>(
        &self,
        node: usize,
        place: &Point<D>,
        found: &mut [Option<(Slot, f64)>; N],
    ) {
        let distance = |node: usize| self.tree.nodes[node].bounds.squared_distance(place);
        match self.tree.nodes[node].kind {
            NodeKind::Split(left, right) => {
                let mut children = [(distance(left), left), (distance(right), right)];
                if children[1].0 < children[0].0 {
                    children.swap(0, 1);
                }
                for (near, child) in children {
                    if found[N - 1].is_none_or(|(_, furthest)| near < furthest) {
                        self.visit(child, place, found);
                    }
                }
            }
            NodeKind::Leaf(leaf) => {
                for i in (0..self.counts[leaf]).filter(|&i| !self.is_taken[leaf][i]) {
                    let slot = Slot { leaf, place: i };
                    let point = slot.point(self.tree);
                    let squared: f64 =
                        (0..D).map(|axis| math::square(point[axis] - place[axis])).sum();
                    let rank = found.partition_point(|other| {
                        other.is_some_and(|(_, distance)| distance <= squared)
                    });
                    if rank < N {
                        found[rank..].rotate_right(1);
                        found[rank] = Some((slot, squared));
                    }
                }
            }
        }
    }
}
