//! Adaptive proposal: drawing the noise of a motion where the scan is likely.

use std::ops::Range;

use mcl_core::memory::with_room;
use mcl_core::{OutOfMemory, Rng, StandardNormal, math};
use nalgebra::{Matrix3, Vector3};
use rand_distr::Distribution;

use crate::particles::PARTICLES;

/// Number of folds of the particles; each draws from a proposal fitted to the pilots of the others. More folds
/// leave more pilots for each fit.
pub(crate) const FOLDS: usize = 4;
/// Smallest number of pilots for a fit.
const LEAST_PILOTS: usize = 20;
/// Effective sample size of the pilots required for the fit, as a fraction of their number. With a
/// tenth of 190 pilots, a mean and three variances are known to about a quarter of a standard deviation.
const FIT_FRACTION: f64 = 0.1;
/// Factor on the fitted variances: regions missed by a proposal are covered only by the pilots, while one that is
/// too wide only wastes draws.
const WIDENING: f64 = 2.0;
/// Factor on the variance of the fitted mean, which is added to the fitted variances.
const MEAN_WIDENING: f64 = 2.0;
/// Smallest fitted variance, relative to that of the noise; below it there is only rounding.
const LEAST_VARIANCE: f64 = 1e-8;

/// Standard normal noise of one motion, on its three parts.
pub(crate) type Noise = [f64; 3];

/// A Gaussian proposal q for the noise of a motion, used in place of the standard normal N.
///
/// Adaptive importance sampling with deterministic-mixture weights (Owen and Zhou, *Safe and effective
/// importance sampling*, JASA 2000; Veach and Guibas's balance heuristic, 1995), cross-fitted: the particles
/// are split at random into folds, and each fold into pilots, which draw their noise from N according to the motion
/// model, and others, which draw from the q of the fold. q is fitted to the noise of the pilots of the *other* folds,
/// weighted by the likelihood of the scan. With s the fraction of the particles of the fold that draw from q,
/// every particle is reweighted by
/// ```text
/// N(ε) / ((1 − s)·N(ε) + s·q(ε)) ≤ 1/(1 − s)
/// ```
/// times the likelihood of the scan. A particle of the fold is a pilot with probability 1 − s, whatever its pose and
/// weight, and q does not depend on it. So the expectation of its new weight, given the other folds, is
/// (1 − s)·∫N·N·L/(…) + s·∫q·N·L/(…) = ∫N·L, as if it had been drawn from N alone: evidence and unnormalized weights
/// are unbiased for any number of particles, any q and any previous weights. (If q were fitted to the same pilots that
/// it reweights, it would follow their chance positions and the evidence would be too small.) The factor is bounded,
/// so a bad q costs at most the draws from it.
pub(crate) struct NoiseProposal {
    mean: Vector3<f64>,
    /// Symmetric square root of the covariance.
    spread: Matrix3<f64>,
    /// Its inverse.
    whitening: Matrix3<f64>,
    /// ln det `spread`.
    log_det: f64,
}

/// Particles that drew their noise from N.
#[derive(Clone, Copy)]
pub(crate) struct Pilots<'a> {
    pub(crate) noise: &'a [Noise],
    /// Log-weights before the scan.
    pub(crate) log_weights: &'a [f64],
    /// Log-likelihoods of the scan.
    pub(crate) log_likelihoods: &'a [f64],
}

impl NoiseProposal {
    /// Fits q to all pilots except those left out; `None` if they are too few, or their previous weights differ too
    /// much. `scratch` provides buffers.
    pub(crate) fn fit(
        pilots: Pilots<'_>,
        left_out: Range<usize>,
        scratch: &mut FitBuffers,
    ) -> Option<Self> {
        let all = pilots.noise.len();
        if all - left_out.len() < LEAST_PILOTS {
            return None;
        }
        let others = || (0..left_out.start).chain(left_out.end..all);
        let Tempered { exponent, effective } =
            scratch.temper(others().map(|i| (pilots.log_weights[i], pilots.log_likelihoods[i])))?;
        let noises = || others().map(|i| Vector3::from(pilots.noise[i])).zip(&scratch.weights);
        let mean: Vector3<f64> = noises().map(|(noise, weight)| noise * *weight).sum();
        let covariance: Matrix3<f64> = noises()
            .map(|(noise, weight)| (noise - mean) * (noise - mean).transpose() * *weight)
            .sum();
        let eigen = covariance.symmetric_eigen();
        let rotation = &eigen.eigenvectors;
        let stretch = eigen.eigenvalues.map(|variance| untempering(variance, exponent));
        let mean = rotation * stretch.component_mul(&rotation.tr_mul(&mean));
        let std = eigen.eigenvalues.zip_map(&stretch, |tempered, stretch| {
            let variance = if tempered < 1.0 { tempered * exponent * stretch } else { tempered };
            let of_mean = stretch * stretch * tempered / effective;
            (WIDENING * variance + MEAN_WIDENING * of_mean).max(LEAST_VARIANCE).sqrt()
        });
        let square_root = |diagonal: Vector3<f64>| {
            rotation * Matrix3::from_diagonal(&diagonal) * rotation.transpose()
        };
        Some(NoiseProposal {
            mean,
            spread: square_root(std),
            whitening: square_root(std.map(|std| 1.0 / std)),
            log_det: std.map(math::ln).sum(),
        })
    }

    /// Draws from q.
    pub(crate) fn draw(&self, rng: &mut Rng) -> Noise {
        let standard: Noise = std::array::from_fn(|_| StandardNormal.sample(rng));
        (self.mean + self.spread * Vector3::from(standard)).into()
    }

    /// ln(N(ε) / ((1 − `share`)·N(ε) + `share`·q(ε))).
    pub(crate) fn log_correction(&self, noise: &Noise, share: f64) -> f64 {
        let noise = Vector3::from(*noise);
        let whitened = self.whitening * (noise - self.mean);
        // ln q(ε)/N(ε); far out it may overflow, and the correction is then −∞: the motion model would never make
        // such a draw.
        let log_ratio = 0.5 * (noise.norm_squared() - whitened.norm_squared()) - self.log_det;
        -math::ln(1.0 - share + share * math::exp(log_ratio))
    }
}

/// Buffers of a fit.
#[derive(Default)]
pub(crate) struct FitBuffers {
    /// Weights before the scan, powers of the likelihood, and the resulting weights.
    prior: Vec<f64>,
    power: Vec<f64>,
    weights: Vec<f64>,
}

/// An exponent of the likelihood that leaves enough effective pilots.
struct Tempered {
    exponent: f64,
    /// Effective sample size with this exponent.
    effective: f64,
}

impl FitBuffers {
    /// Allocates buffers for this many pilots.
    pub(crate) fn with_room(number: usize) -> Result<Self, OutOfMemory> {
        let room = || with_room(number, PARTICLES);
        Ok(FitBuffers { prior: room()?, power: room()?, weights: room()? })
    }

    /// Finds the largest of the exponents 1, ½, ¼, … on the likelihood with the required effective sample size for
    /// pilots with these log-weights and log-likelihoods, and leaves the normalized weights in `weights`. `None` if
    /// there is none: the previous weights differ too much, or are all 0.
    fn temper(&mut self, pilots: impl Iterator<Item = (f64, f64)> + Clone) -> Option<Tempered> {
        let wanted = FIT_FRACTION * pilots.clone().count() as f64;
        let largest =
            |values: &mut dyn Iterator<Item = f64>| values.fold(f64::NEG_INFINITY, f64::max);
        let most = largest(&mut pilots.clone().map(|(_, likelihood)| likelihood));
        let heaviest = largest(&mut pilots.clone().map(|(weight, _)| weight));
        self.prior.clear();
        self.prior.extend(pilots.clone().map(|(weight, _)| math::exp(weight - heaviest)));
        // Any likelihood above 0 in f64 is 1 to the power of 2⁻⁶⁰.
        let mut exponent = 1.0;
        let mut effective = f64::NAN;
        for _ in 0..6 {
            exponent /= 1024.0;
            self.power.clear();
            self.power.extend(pilots.clone().map(|(_, l)| math::exp(exponent * (l - most))));
            effective = effective_size(&self.prior, &self.power);
            if effective >= wanted {
                break;
            }
        }
        let is_enough = |size: f64| size >= wanted;
        if !is_enough(effective) {
            return None;
        }
        while exponent < 1.0 {
            self.weights.clear();
            self.weights.extend(self.power.iter().map(|power| power * power));
            let squared = effective_size(&self.prior, &self.weights);
            if !is_enough(squared) {
                break;
            }
            exponent *= 2.0;
            effective = squared;
            std::mem::swap(&mut self.power, &mut self.weights);
        }
        self.weights.clear();
        self.weights.extend(self.prior.iter().zip(&self.power).map(|(prior, power)| prior * power));
        let sum: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|weight| *weight /= sum);
        Some(Tempered { exponent, effective })
    }
}

/// Effective sample size (Σw)²/Σw² of the products.
fn effective_size(prior: &[f64], power: &[f64]) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for (prior, power) in prior.iter().zip(power) {
        let weight = prior * power;
        sum += weight;
        squares += weight * weight;
    }
    sum * sum / squares
}

/// Factor from the mean of the posterior of variance `tempered`, under a power of a Gaussian likelihood and a standard
/// normal prior, to the mean of the posterior under the likelihood itself. The variance of the latter is
/// tempered·exponent times this factor, as 1/tempered = 1 + exponent·λ and its variance is 1/(1 + λ).
fn untempering(tempered: f64, exponent: f64) -> f64 {
    if tempered >= 1.0 { 1.0 } else { 1.0 / (tempered * exponent + 1.0 - tempered) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;

    /// Log-likelihood of a Gaussian observation of the noise: mean and variance per axis.
    fn log_likelihood(noise: &Noise, means: Noise, variances: Noise) -> f64 {
        (0..3).map(|k| -0.5 * (noise[k] - means[k]).powi(2) / variances[k]).sum()
    }

    fn standard(number: usize, seed: u64) -> Vec<Noise> {
        let mut rng = Seed::new(seed).rng();
        (0..number).map(|_| std::array::from_fn(|_| StandardNormal.sample(&mut rng))).collect()
    }

    /// For a Gaussian likelihood the posterior is known in closed form: precision 1 + 1/v, mean (m/v)/(1 + 1/v).
    #[test]
    fn finds_a_gaussian_posterior_through_the_tempering() {
        let (means, variances) = ([0.8, -0.5, 0.0], [0.01, 0.04, 1e9]);
        let noise = standard(4000, 1);
        let log_likelihoods: Vec<f64> =
            noise.iter().map(|noise| log_likelihood(noise, means, variances)).collect();
        let log_weights = vec![-(4000f64.ln()); 4000];
        let pilots =
            Pilots { noise: &noise, log_weights: &log_weights, log_likelihoods: &log_likelihoods };
        let mut weighing = FitBuffers::default();
        let all = log_weights.iter().copied().zip(log_likelihoods.iter().copied());
        let Tempered { exponent, effective } = weighing.temper(all).unwrap();
        assert!(exponent < 1.0, "the likelihood is to be sharp: {exponent}");
        assert!((400.0..1600.0).contains(&effective), "{effective}");
        let proposal = NoiseProposal::fit(pilots, 0..0, &mut weighing).unwrap();
        for k in 0..3 {
            let variance = 1.0 / (1.0 + 1.0 / variances[k]);
            let mean = means[k] / variances[k] * variance;
            // Wider than the posterior, but not by much. Without information from the scan, a sample that is
            // narrow by chance looks informative, and undoing the tempering amplifies that.
            let found = (proposal.spread * proposal.spread)[(k, k)] / variance;
            assert!(found > 1.0 && found < 1.5 * WIDENING, "axis {k}: {found} of {variance}");
            let off = (proposal.mean[k] - mean).abs();
            assert!(off < 0.5 * variance.sqrt(), "axis {k}: mean off by {off}");
        }
    }

    /// The mean of the correction over draws from the mixture is ∫ N = 1, for good and bad proposals.
    #[test]
    fn corrections_make_any_proposal_right() {
        let proposal = |mean: Noise, std: f64| NoiseProposal {
            mean: Vector3::from(mean),
            spread: Matrix3::from_diagonal_element(std),
            whitening: Matrix3::from_diagonal_element(1.0 / std),
            log_det: 3.0 * std.ln(),
        };
        let mut rng = Seed::new(5).rng();
        for proposal in [proposal([0.5, -0.2, 0.1], 0.4), proposal([4.0, 0.0, 0.0], 0.1)] {
            for share in [0.5, 0.2] {
                let (pilots, drawn) = (standard(200_000, 6), 200_000);
                let of_pilots = pilots.iter().map(|noise| {
                    (1.0 - share) * proposal.log_correction(noise, share).exp()
                        / pilots.len() as f64
                });
                let of_drawn = (0..drawn).map(|_| {
                    let noise = proposal.draw(&mut rng);
                    share * proposal.log_correction(&noise, share).exp() / f64::from(drawn)
                });
                let integral: f64 = of_pilots.chain(of_drawn).sum();
                assert!((integral - 1.0).abs() < 0.005, "{integral}");
            }
        }
    }

    #[test]
    fn far_draws_have_no_weight_and_are_not_nan() {
        let proposal = NoiseProposal {
            mean: Vector3::new(1e4, 0.0, 0.0),
            spread: Matrix3::identity(),
            whitening: Matrix3::identity(),
            log_det: 0.0,
        };
        assert_eq!(proposal.log_correction(&[1e4, 0.0, 0.0], 0.5), f64::NEG_INFINITY);
        assert!(proposal.log_correction(&[0.0; 3], 0.5) > 0.0);
    }

    #[test]
    fn too_few_pilots_give_no_proposal() {
        let noise = standard(LEAST_PILOTS - 1, 2);
        let zeros = vec![0.0; noise.len()];
        let pilots = Pilots { noise: &noise, log_weights: &zeros, log_likelihoods: &zeros };
        assert!(NoiseProposal::fit(pilots, 0..0, &mut FitBuffers::default()).is_none());
        // Likewise for those that remain after leaving out a fold.
        let noise = standard(LEAST_PILOTS, 2);
        let zeros = vec![0.0; noise.len()];
        let pilots = Pilots { noise: &noise, log_weights: &zeros, log_likelihoods: &zeros };
        assert!(NoiseProposal::fit(pilots, 3..4, &mut FitBuffers::default()).is_none());
        assert!(NoiseProposal::fit(pilots, 3..3, &mut FitBuffers::default()).is_some());
    }
}
