//! Resampling: drawing particles in proportion to their weights.

use mcl_core::Rng;
use rand::RngExt;

use crate::Resampling;

impl Resampling {
    /// Fills `chosen` with `number` indices, such that the expected number of copies of index i is number·wᵢ for
    /// weights that sum to one. The weights are at least 0 and not all 0; they need not be normalized. An index of
    /// weight 0 is never drawn. `scratch` is a buffer.
    pub fn draw(
        self,
        weights: &[f64],
        number: usize,
        rng: &mut Rng,
        scratch: &mut Vec<f64>,
        chosen: &mut Vec<usize>,
    ) {
        chosen.clear();
        let n = number;
        if weights.is_empty() {
            return;
        }
        match self {
            Resampling::Systematic => {
                let offset: f64 = rng.random();
                at_increasing(weights, (0..n).map(|i| (i as f64 + offset) / n as f64), chosen);
            }
            Resampling::Stratified => {
                let positions = (0..n).map(|i| (i as f64 + rng.random::<f64>()) / n as f64);
                at_increasing(weights, positions, chosen);
            }
            Resampling::Multinomial => {
                scratch.clear();
                scratch.extend(weights);
                multinomial(scratch, n, rng, chosen);
            }
            Resampling::Residual => {
                let per_weight = n as f64 / weights.iter().sum::<f64>();
                scratch.clear();
                for (i, weight) in weights.iter().enumerate() {
                    let copies = (weight * per_weight).floor();
                    scratch.push(weight * per_weight - copies);
                    // Rounding of the sum could give one copy too many.
                    let room = n - chosen.len();
                    chosen.extend(std::iter::repeat_n(i, (copies as usize).min(room)));
                }
                multinomial(scratch, n - chosen.len(), rng, chosen);
            }
        }
    }
}

/// Appends the index at each of the increasing positions, fractions in [0, 1) of the sum of the
/// weights.
///
/// Positions are scaled by the final value of the running total, and the last index of positive weight takes
/// positions left over by rounding, so weights that sum to a little less than one are safe.
fn at_increasing(weights: &[f64], positions: impl Iterator<Item = f64>, chosen: &mut Vec<usize>) {
    let sum: f64 = weights.iter().sum();
    let last = last_positive(weights);
    let mut index = 0;
    let mut total = weights[0];
    for position in positions {
        while total <= position * sum && index < last {
            index += 1;
            total += weights[index];
        }
        chosen.push(index);
    }
}

/// Appends `draws` independent draws; replaces the weights by their running totals.
fn multinomial(weights: &mut [f64], draws: usize, rng: &mut Rng, chosen: &mut Vec<usize>) {
    let last = last_positive(weights);
    let mut sum = 0.0;
    for weight in weights.iter_mut() {
        sum += *weight;
        *weight = sum;
    }
    for _ in 0..draws {
        let position = rng.random::<f64>() * sum;
        chosen.push(weights.partition_point(|&total| total <= position).min(last));
    }
}

/// The last index of positive weight, 0 if there is none.
fn last_positive(weights: &[f64]) -> usize {
    weights.iter().rposition(|&weight| weight > 0.0).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{Rng, Seed};
    use proptest::prelude::*;

    fn copies(kind: Resampling, weights: &[f64], rng: &mut Rng) -> Vec<usize> {
        let mut chosen = Vec::new();
        kind.draw(weights, weights.len(), rng, &mut Vec::new(), &mut chosen);
        assert_eq!(chosen.len(), weights.len());
        let mut copies = vec![0; weights.len()];
        chosen.iter().for_each(|&i| copies[i] += 1);
        copies
    }

    /// The number of copies of index i has mean N·wᵢ, and at most the variance of multinomial resampling,
    /// N·wᵢ·(1 − wᵢ).
    #[test]
    fn every_kind_is_unbiased() {
        const REPEATS: usize = 20_000;
        let weights = [0.05, 0.3, 0.0, 0.2, 0.13, 0.02, 0.3];
        for kind in Resampling::ALL {
            let mut rng = Seed::new(3).derive(kind.name()).rng();
            let mut total = [0; 7];
            for _ in 0..REPEATS {
                let copies = copies(kind, &weights, &mut rng);
                total.iter_mut().zip(copies).for_each(|(sum, c)| *sum += c);
            }
            for (i, (&total, &weight)) in total.iter().zip(&weights).enumerate() {
                let mean = total as f64 / REPEATS as f64;
                let variance = 7.0 * weight * (1.0 - weight) / REPEATS as f64;
                let off = (mean - 7.0 * weight).abs();
                assert!(off <= 4.5 * variance.sqrt(), "{kind} {i}: {mean}");
            }
        }
    }

    /// The schemes differ: the variances of their numbers of copies have the order
    /// known from the literature (Douc, Cappé and Moulines 2005).
    #[test]
    fn variance_falls_from_multinomial_to_stratified() {
        let weights = [0.35, 0.05, 0.3, 0.1, 0.2];
        let variance = |kind: Resampling| {
            let mut rng = Seed::new(4).rng();
            let squares = (0..20_000).map(|_| {
                let copies = copies(kind, &weights, &mut rng);
                let off = |(c, w): (&usize, &f64)| (*c as f64 - 5.0 * w).powi(2);
                copies.iter().zip(&weights).map(off).sum::<f64>()
            });
            squares.sum::<f64>() / 20_000.0
        };
        let of = Resampling::ALL.map(variance);
        let [systematic, stratified, residual, multinomial] = of;
        assert!(systematic < multinomial && stratified < multinomial, "{of:?}");
        assert!(residual < multinomial, "{of:?}");
        // Multinomial: Σ N·w(1 − w) = 5·(1 − Σw²) = 5·(1 − 0.265).
        assert!((multinomial / 3.675 - 1.0).abs() < 0.05, "{multinomial}");
    }

    #[test]
    fn weights_that_sum_to_less_or_more_than_one_are_safe() {
        for sum in [1.0 - 1e-9, 1.0 - f64::EPSILON, 1.0 + 1e-9, 1e-200, 1e200, 0.5] {
            let mut weights = vec![sum / 1000.0; 1000];
            weights.extend([0.0; 5]);
            for kind in Resampling::ALL {
                for seed in 0..20 {
                    let copies = copies(kind, &weights, &mut Seed::new(seed).rng());
                    assert!(copies[1000..].iter().all(|&c| c == 0), "{kind} {sum}");
                }
            }
        }
    }

    /// Pinned values, so that no dependency can silently change results.
    #[test]
    fn draws_are_stable() {
        let drawn = Resampling::ALL
            .map(|kind| copies(kind, &[0.1, 0.4, 0.2, 0.05, 0.25], &mut Seed::new(2).rng()));
        assert_eq!(drawn, [[0, 2, 1, 1, 1], [0, 2, 2, 0, 1], [0, 2, 1, 1, 1], [0, 2, 3, 0, 0]]);
    }

    #[test]
    fn one_heavy_particle_takes_all() {
        for kind in Resampling::ALL {
            for heavy in 0..4 {
                let mut weights = [0.0; 4];
                weights[heavy] = 0.7;
                let copies = copies(kind, &weights, &mut Seed::new(1).rng());
                assert_eq!(copies[heavy], 4, "{kind}");
            }
            assert_eq!(copies(kind, &[1.0], &mut Seed::new(1).rng()), [1]);
        }
    }

    proptest! {
        #[test]
        fn copies_stay_near_their_expectation(
            weights in prop::collection::vec(prop_oneof![Just(0.0), 0.0..1.0f64], 1..60),
            seed in any::<u64>(),
        ) {
            let sum: f64 = weights.iter().sum();
            prop_assume!(sum > 0.0);
            let n = weights.len() as f64;
            let mut rng = Seed::new(seed).rng();
            for kind in Resampling::ALL {
                let copies = copies(kind, &weights, &mut rng);
                for (&copies, weight) in copies.iter().zip(&weights) {
                    let (copies, expected) = (copies as f64, n * weight / sum);
                    match kind {
                        Resampling::Systematic => {
                            prop_assert!((copies - expected).abs() < 1.0 + 1e-9)
                        }
                        // At most two ends of a particle's interval fall in a stratum.
                        Resampling::Stratified => {
                            prop_assert!((copies - expected).abs() < 2.0 + 1e-9)
                        }
                        Resampling::Residual => prop_assert!(copies > expected - 1.0 - 1e-9),
                        Resampling::Multinomial => {}
                    }
                    prop_assert!(*weight > 0.0 || copies == 0.0);
                }
            }
        }
    }
}
