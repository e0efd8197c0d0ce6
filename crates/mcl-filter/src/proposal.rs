//! Drawing the noise of a motion where the scan is likely.

use mcl_core::Rng;
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};

/// Fewer particles than this in the first half say too little about where the scan is likely.
const LEAST_PILOTS: usize = 20;
/// Effective sample size of the pilots that the fit asks for, as a fraction of their number. At a
/// tenth, a mean and three variances are known to a quarter of a standard deviation or so for 250.
const FIT_FRACTION: f64 = 0.1;
/// Factor on the fitted variances: what a proposal leaves out is left to the pilots, while one that is
/// too wide only wastes draws.
const WIDENING: f64 = 2.0;
/// Fitted variances are not below this (of the noise's): rounding would be all there is.
const LEAST_VARIANCE: f64 = 1e-8;

/// Standard normal noise of one motion: of rotation 1, translation and rotation 2.
pub(crate) type Noise = [f64; 3];

/// A Gaussian q over the noise of a motion, to draw from in place of the standard normal N.
///
/// Adaptive importance sampling with deterministic-mixture weights (Owen and Zhou, *Safe and effective
/// importance sampling*, JASA 2000; Veach and Guibas's balance heuristic, 1995): the first half of the
/// particles, the pilots, draw their noise from N, as the motion model says; q is fitted to the noise
/// that the scan found likely; the second half draws from q. With s the share of the weight that the
/// second half has, every particle is weighed by
/// ```text
/// N(ε) / ((1 − s)·N(ε) + s·q(ε)) ≤ 1/(1 − s)
/// ```
/// times the likelihood of the scan. That is importance sampling from the mixture of both halves, so the
/// weighted particles stand for the same posterior as those of the motion model alone, whatever q is;
/// and as the weight is bounded, a bad q costs at most the second half.
pub(crate) struct NoiseProposal {
    mean: Vector3<f64>,
    /// Symmetric square root of the covariance.
    spread: Matrix3<f64>,
    /// Its inverse.
    whitening: Matrix3<f64>,
    /// ln det `spread`.
    log_det: f64,
}

impl NoiseProposal {
    /// Fits q to pilots with this noise, these log-weights before the scan and these log-likelihoods of
    /// the scan; `None` when they are too few. `scratch` is a buffer.
    pub(crate) fn fit(
        noise: &[Noise],
        log_weights: &[f64],
        log_likelihoods: &[f64],
        scratch: &mut Vec<f64>,
    ) -> Option<Self> {
        if noise.len() < LEAST_PILOTS {
            return None;
        }
        let temper = temper(log_weights, log_likelihoods, scratch)?;
        let weights = &*scratch;
        let noises = || noise.iter().map(|noise| Vector3::from(*noise)).zip(weights);
        let mean: Vector3<f64> = noises().map(|(noise, weight)| noise * *weight).sum();
        let covariance: Matrix3<f64> = noises()
            .map(|(noise, weight)| (noise - mean) * (noise - mean).transpose() * *weight)
            .sum();
        let eigen = covariance.symmetric_eigen();
        let std = eigen
            .eigenvalues
            .map(|variance| (WIDENING * untempered(variance, temper)).max(LEAST_VARIANCE).sqrt());
        let rotation = &eigen.eigenvectors;
        let square_root = |diagonal: Vector3<f64>| {
            rotation * Matrix3::from_diagonal(&diagonal) * rotation.transpose()
        };
        Some(NoiseProposal {
            mean,
            spread: square_root(std),
            whitening: square_root(std.map(|std| 1.0 / std)),
            log_det: std.map(f64::ln).sum(),
        })
    }

    /// A draw from q.
    pub(crate) fn draw(&self, rng: &mut Rng) -> Noise {
        let standard: Noise = std::array::from_fn(|_| StandardNormal.sample(rng));
        (self.mean + self.spread * Vector3::from(standard)).into()
    }

    /// ln(N(ε) / ((1 − `share`)·N(ε) + `share`·q(ε))).
    pub(crate) fn log_correction(&self, noise: &Noise, share: f64) -> f64 {
        let noise = Vector3::from(*noise);
        let whitened = self.whitening * (noise - self.mean);
        // ln q(ε)/N(ε); far out it may overflow, and the correction is then −∞: a draw that the motion
        // model would not make.
        let log_ratio = 0.5 * (noise.norm_squared() - whitened.norm_squared()) - self.log_det;
        -(1.0 - share + share * log_ratio.exp()).ln()
    }
}

/// The largest of the exponents 1, ½, ¼, … on the likelihood that leaves the wanted effective sample
/// size, with the normalized weights under it in `weights`. `None` when there is none: weights that
/// differ by themselves, or are none.
fn temper(log_weights: &[f64], log_likelihoods: &[f64], weights: &mut Vec<f64>) -> Option<f64> {
    let wanted = FIT_FRACTION * log_weights.len() as f64;
    let mut exponent = 1.0;
    // 2⁻⁶⁰ of any likelihood that f64 can tell from 0 is 1.
    for _ in 0..60 {
        weights.clear();
        weights.extend(log_weights.iter().zip(log_likelihoods).map(|(w, l)| w + exponent * l));
        let largest = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        weights.iter_mut().for_each(|weight| *weight = (*weight - largest).exp());
        let sum: f64 = weights.iter().sum();
        let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
        if sum * sum >= wanted * squares {
            weights.iter_mut().for_each(|weight| *weight /= sum);
            return Some(exponent);
        }
        exponent *= 0.5;
    }
    None
}

/// The posterior variance of a standard normal prior under a Gaussian likelihood whose power
/// `exponent` left the variance `tempered`: 1/v = 1 + λ, where 1/tempered = 1 + exponent·λ.
fn untempered(tempered: f64, exponent: f64) -> f64 {
    if tempered >= 1.0 {
        return tempered;
    }
    tempered * exponent / (tempered * exponent + 1.0 - tempered)
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

    /// For a Gaussian likelihood the posterior is known: precision 1 + 1/v, mean (m/v)/(1 + 1/v).
    #[test]
    fn finds_a_gaussian_posterior_through_the_tempering() {
        let (means, variances) = ([0.8, -0.5, 0.0], [0.01, 0.04, 1e9]);
        let noise = standard(4000, 1);
        let log_likelihoods: Vec<f64> =
            noise.iter().map(|noise| log_likelihood(noise, means, variances)).collect();
        let log_weights = vec![-(4000f64.ln()); 4000];
        let mut scratch = Vec::new();
        let exponent = temper(&log_weights, &log_likelihoods, &mut scratch).unwrap();
        assert!(exponent < 1.0, "the likelihood is to be sharp: {exponent}");
        let proposal =
            NoiseProposal::fit(&noise, &log_weights, &log_likelihoods, &mut scratch).unwrap();
        for k in 0..3 {
            let variance = 1.0 / (1.0 + 1.0 / variances[k]);
            let mean = means[k] / variances[k] * variance;
            // Wider than the posterior, but not much: where the scan says nothing, a sample that is
            // narrow by chance looks as if it did, and untempering enlarges that.
            let found = (proposal.spread * proposal.spread)[(k, k)] / variance;
            assert!(found > 1.0 && found < 1.5 * WIDENING, "axis {k}: {found} of {variance}");
            // Tempering pulls the mean towards the prior's: within one standard deviation.
            let off = (proposal.mean[k] - mean).abs();
            assert!(off < variance.sqrt(), "axis {k}: mean off by {off}");
        }
    }

    /// ∫ N = 1: the mean of the correction over draws from the mixture, for a bad proposal as for a
    /// good one.
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
    fn far_draws_have_no_weight_and_are_no_nan() {
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
        assert!(NoiseProposal::fit(&noise, &zeros, &zeros, &mut Vec::new()).is_none());
    }
}
