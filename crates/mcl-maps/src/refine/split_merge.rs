use mcl_core::{Point, Rng, Seed, math};
use rand::RngExt;

use super::split::{Split, splits};
use super::{Progress, RefineSettings, Stage, relax};
use crate::PointSet;
use crate::fkm::Model;
use crate::mixture::removal;

/// One in so many components is split in a round, at first.
const PART: usize = 10;
/// Evaluations of EM before the first round.
const EVALUATIONS_FIRST: usize = 8;
/// Evaluations of EM after components were split.
const EVALUATIONS_SPLIT: usize = 3;
/// Evaluations of EM after components were merged.
const EVALUATIONS_MERGED: usize = 5;
/// A round that gains less than this (nats per point) is followed by a smaller one.
const SMALL_GAIN: f64 = 1e-3;
/// Once stuck, what decides is disturbed by factors of up to e to the power of this, either way.
const DISTURBANCE: f64 = 0.3;

/// Replaces the model by likelier ones with as many components.
pub(super) fn search<const D: usize>(
    data: &PointSet<D>,
    model: &mut Model<D>,
    settings: &RefineSettings,
    rounds: usize,
    progress: &mut Progress,
) {
    let components = model.means.len();
    if components < 2 {
        // Nothing to merge with.
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
        let mut choice = effort.next();
        let mut means = model.means.clone();
        for Split { component, halves: [first, second] } in split(data, &means, sigma, &mut choice)
        {
            means[component] = first;
            means.push(second);
        }
        let more = relax(data, means, sigma, EVALUATIONS_SPLIT, progress).means;
        let is_kept = merge(data, &more, sigma, components, &mut choice);
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

/// How many components a round splits: fewer when rounds gain little, and a small random number once
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

    /// The next round's.
    fn next(&mut self) -> Choice {
        let mut rng = self.seed.derive(&self.round.to_string()).rng();
        self.round += 1;
        if self.is_stuck {
            self.moved = rng.random_range(1..=(self.largest / 3).max(1));
        }
        Choice { number: self.moved, disturbance: self.is_stuck.then_some(rng) }
    }

    /// What the round gained (nats per point).
    fn rate(&mut self, gain: f64) {
        if gain < SMALL_GAIN {
            self.is_stuck |= self.moved <= self.largest / 4;
            self.moved = (self.moved / 2).max(1);
        }
    }
}

/// The number of components that a round splits and merges, and whether other ones than those that
/// seem best.
struct Choice {
    number: usize,
    disturbance: Option<Rng>,
}

impl Choice {
    fn disturbed(&mut self, value: f64) -> f64 {
        match &mut self.disturbance {
            Some(rng) => value * math::exp(rng.random_range(-DISTURBANCE..DISTURBANCE)),
            None => value,
        }
    }
}

/// The splits that the points profit most from.
fn split<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    choice: &mut Choice,
) -> Vec<Split<D>> {
    let nearest = removal(data, means, sigma).nearest;
    let mut splits = splits(data, means.len(), nearest.iter().map(|&[first, _]| first));
    for (gain, _) in &mut splits {
        *gain = choice.disturbed(*gain);
    }
    splits.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    splits.into_iter().take(choice.number).map(|(_, split)| split).collect()
}

/// Which `components` of the means are left when those go that the data misses least.
fn merge<const D: usize>(
    data: &PointSet<D>,
    means: &[Point<D>],
    sigma: f64,
    components: usize,
    choice: &mut Choice,
) -> Vec<bool> {
    let removal = removal(data, means, sigma);
    let cost: Vec<f64> = removal.cost.into_iter().map(|cost| choice.disturbed(cost)).collect();
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|&a, &b| cost[a].total_cmp(&cost[b]));
    // Costs hold as long as those stay that take over the points: they are kept, while others are left.
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
