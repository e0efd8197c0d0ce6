use mcl_core::{Point, Rng, Seed, math};
use rand::RngExt;

use super::split::{Split, splits};
use super::{Progress, RefineSettings, Stage, relax};
use crate::PointSet;
use crate::fkm::Model;
use crate::mixture::removal;

/// At first, one in this many components is split in a round.
const PART: usize = 10;
/// Evaluations of EM before the first round.
const EVALUATIONS_FIRST: usize = 8;
/// Evaluations of EM after components were split.
const EVALUATIONS_SPLIT: usize = 3;
/// Evaluations of EM after components were merged.
const EVALUATIONS_MERGED: usize = 5;
/// A round that gains less than this (nats per point) is followed by a smaller one.
const SMALL_GAIN: f64 = 1e-3;
/// Once stuck, both criteria are disturbed by random factors of up to e to the power of ± this.
const DISTURBANCE: f64 = 0.3;

/// Replaces the model by ones with a larger likelihood and as many components.
pub(super) fn search<const D: usize>(
    data: &PointSet<D>,
    model: &mut Model<D>,
    settings: &RefineSettings,
    rounds: usize,
    progress: &mut Progress,
) {
    let components = model.means.len();
    if components < 2 {
        // A single component cannot be merged.
        return;
    }
    let sigma = settings.fkm.sigma;
    let relaxed = relax(data, model.means.clone(), sigma, EVALUATIONS_FIRST, progress);
    if relaxed.per_point > model.per_point {
        *model = relaxed;
        progress.step(Stage::Em, model.per_point);
    }
    let mut effort = Effort::new(components, settings.seed.derive("split and merge"));
    for _ in 0..rounds {
        if progress.is_over() {
            break;
        }
        let mut plan = effort.next();
        let mut means = model.means.clone();
        for Split { component, halves: [first, second] } in split(data, &means, sigma, &mut plan) {
            means[component] = first;
            means.push(second);
        }
        let more = relax(data, means, sigma, EVALUATIONS_SPLIT, progress).means;
        let is_kept = merge(data, &more, sigma, components, &mut plan);
        let kept =
            more.into_iter().zip(is_kept).filter_map(|(mean, is_kept)| is_kept.then_some(mean));
        let fewer = relax(data, kept.collect(), sigma, EVALUATIONS_MERGED, progress);
        let gain = fewer.per_point - model.per_point;
        effort.rate(gain);
        if gain > 0.0 {
            *model = fewer;
            progress.step(Stage::SplitMerge, model.per_point);
        }
    }
}

/// Determines how many components a round splits: fewer if rounds gain little, and a small random number once
/// that does not help either.
struct Effort {
    largest: usize,
    moved: usize,
    is_stuck: bool,
    round: usize,
    seed: Seed,
}

impl Effort {
    fn new(components: usize, seed: Seed) -> Self {
        let largest = (components / PART).max(1);
        Effort { largest, moved: largest, is_stuck: false, round: 0, seed }
    }

    /// The plan of the next round.
    fn next(&mut self) -> RoundPlan {
        let mut rng = self.seed.derive(&self.round.to_string()).rng();
        self.round += 1;
        if self.is_stuck {
            self.moved = rng.random_range(1..=(self.largest / 3).max(1));
        }
        RoundPlan { number: self.moved, disturbance: self.is_stuck.then_some(rng) }
    }

    /// Records the gain of the round (nats per point).
    fn rate(&mut self, gain: f64) {
        if gain < SMALL_GAIN {
            self.is_stuck |= self.moved <= self.largest / 4;
            self.moved = (self.moved / 2).max(1);
        }
    }
}

/// The number of components that a round splits and merges, and the random disturbance of the criteria that
/// select them, if any.
struct RoundPlan {
    number: usize,
    disturbance: Option<Rng>,
}

impl RoundPlan {
    fn disturbed(&mut self, value: f64) -> f64 {
        match &mut self.disturbance {
            Some(rng) => value * math::exp(rng.random_range(-DISTURBANCE..DISTURBANCE)),
            None => value,
        }
    }
}

/// Splits the components whose points gain most.
fn split<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    plan: &mut RoundPlan,
) -> Vec<Split<D>> {
    let nearest = removal(data, means, sigma).nearest;
    let mut splits = splits(data, means.len(), nearest.iter().map(|&[first, _]| first));
    for (gain, _) in &mut splits {
        *gain = plan.disturbed(*gain);
    }
    splits.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    splits.into_iter().take(plan.number).map(|(_, split)| split).collect()
}

/// Selects the `components` means that are kept when those with the smallest removal costs are removed.
fn merge<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    components: usize,
    plan: &mut RoundPlan,
) -> Vec<bool> {
    let removal = removal(data, means, sigma);
    let cost: Vec<f64> = removal.cost.into_iter().map(|cost| plan.disturbed(cost)).collect();
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|&a, &b| cost[a].total_cmp(&cost[b]));
    // Costs are valid as long as the components that take over the points stay; these are kept as long as others are
    // left to remove.
    let mut heirs = vec![Vec::new(); means.len()];
    for [first, second] in removal.nearest {
        let known: &mut Vec<u32> = &mut heirs[first as usize];
        if known.last() != Some(&second) {
            known.push(second);
        }
    }
    let mut is_kept = vec![true; means.len()];
    let mut is_heir = vec![false; means.len()];
    let mut left = means.len() - components;
    for respects_heirs in [true, false] {
        for &component in &order {
            if left > 0 && is_kept[component] && !(respects_heirs && is_heir[component]) {
                is_kept[component] = false;
                left -= 1;
                for &heir in &heirs[component] {
                    is_heir[heir as usize] = true;
                }
            }
        }
    }
    is_kept
}
