use std::f64::consts::TAU;

use mcl_core::{Point, Pose2};
use pulp::Arch;

use super::exp::exp_nonpositive;
use super::lookup::{LANES, Lanes, Lookup};
use super::{DistanceField, MapDistances, ScanEndpoints};
use crate::{CheckedSettings, FilterError};

/// ln of the largest and of 1/smallest magnitude that a product of factors may reach: e^690 ≈ 10^299
/// leaves room for rounding below the largest and above the smallest normal number (10^±308).
const LARGEST_LOG: f64 = 690.0;

/// The likelihood field of *Probabilistic Robotics* (table 6.3) on a point map: each used beam has
/// the likelihood
///
/// p(z) = z_hit·N(d; 0, σ_hit) + z_rand/z_max,  z_hit = 1 − z_rand,
///
/// N the normalized one-dimensional Gaussian and d the distance from the beam's endpoint to the
/// nearest map point, cut at `max_distance`. A scan's likelihood is the product over its beams, to
/// the power of `likelihood_exponent` (1 unless set).
pub struct LikelihoodField<'a> {
    distances: &'a MapDistances,
    /// z_hit/(σ_hit·√2π).
    hit: f64,
    /// ln of `hit`.
    ln_hit: f64,
    /// 1/(2σ_hit²).
    decay: f64,
    /// z_rand/z_max.
    random: f64,
    /// How many beams are multiplied before taking a logarithm.
    group: usize,
    exponent: f64,
}

impl<'a> LikelihoodField<'a> {
    /// The field over a map's distances.
    ///
    /// # Errors
    /// [`FilterError::MaxDistanceMismatch`] when the distances are cut elsewhere than the settings
    /// say.
    pub fn new(
        distances: &'a MapDistances,
        settings: &CheckedSettings,
    ) -> Result<Self, FilterError> {
        let settings = settings.values();
        if distances.max_distance() != settings.max_distance {
            return Err(FilterError::MaxDistanceMismatch {
                found: distances.max_distance(),
                expected: settings.max_distance,
            });
        }
        let sigma = settings.sigma_hit;
        let hit = (1.0 - settings.z_rand) / (sigma * TAU.sqrt());
        let random = settings.z_rand / settings.max_range;
        // Every factor is in [random, hit + random], so the logarithm of a product of n factors is
        // within ±n·max(|ln random|, |ln(hit + random)|): below LARGEST_LOG a product can neither
        // underflow nor overflow. A single factor cannot either, as random > 0 where it is used.
        let largest = random.ln().abs().max((hit + random).ln().abs());
        let group = ((LARGEST_LOG / largest) as usize).clamp(1, 1 << 20);
        Ok(LikelihoodField {
            distances,
            hit,
            ln_hit: hit.ln(),
            decay: 1.0 / (2.0 * sigma * sigma),
            random,
            group,
            exponent: settings.likelihood_exponent,
        })
    }

    /// The distances underneath.
    pub fn distances(&self) -> &'a MapDistances {
        self.distances
    }

    /// Log-likelihood of a scan seen from a finite pose of the robot, tempered by the exponent; 0 for
    /// a scan without usable beams.
    pub fn log_likelihood(&self, endpoints: &ScanEndpoints, map_from_robot: Pose2) -> f64 {
        let (sin, cos) = map_from_robot.theta.sin_cos();
        let mut log_likelihood = [0.0];
        let poses =
            Poses { x: &[map_from_robot.x], y: &[map_from_robot.y], sin: &[sin], cos: &[cos] };
        self.add_log_likelihoods(endpoints, poses, &mut Scratch::default(), &mut log_likelihood);
        log_likelihood[0]
    }

    /// Adds the scan's log-likelihood from each of the poses to `log_weights`.
    pub(crate) fn add_log_likelihoods(
        &self,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        scratch: &mut Scratch,
        log_weights: &mut [f64],
    ) {
        // The kind of distances is chosen once per scan, not per beam.
        match self.distances {
            MapDistances::Grid(field) if self.is_fast(field) => {
                self.add_fast(field, endpoints, poses, &mut scratch.blocks, log_weights);
            }
            MapDistances::Grid(field) => {
                let distance_squared = |point| field.distance_squared(point);
                self.add_with(distance_squared, endpoints, poses, scratch, log_weights);
            }
            MapDistances::Reference(exact) => {
                let distance_squared = |point| exact.distance_squared(point);
                self.add_with(distance_squared, endpoints, poses, scratch, log_weights);
            }
        }
    }

    /// Whether `f32` is good enough for distances and for the Gaussian, which it cuts at
    /// e⁻⁸⁷ ≈ 10⁻³⁸ of its height: nothing beside a random part of 10⁻³⁰ of it.
    fn is_fast(&self, field: &DistanceField) -> bool {
        let gaussian = self.random == 0.0 || self.random >= 1e-30 * self.hit;
        gaussian && field.is_single_precise()
    }

    /// Beams outside, particles inside, in chunks that stay in the first-level cache: the endpoints
    /// of one beam lie close together, and so do the records that they need.
    fn add_fast(
        &self,
        field: &DistanceField,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        blocks: &mut Vec<Block>,
        log_weights: &mut [f64],
    ) {
        let arch = Arch::new();
        let lookup = Lookup::new(field);
        let grid = &field.grid;
        let decay = self.decay * grid.cell * grid.cell;
        let beams = || {
            let scaled = |e: &f64| e / grid.cell;
            endpoints.x().iter().map(scaled).zip(endpoints.y().iter().map(scaled))
        };
        for first in (0..log_weights.len()).step_by(CHUNK) {
            let end = log_weights.len().min(first + CHUNK);
            let neutral = if self.random == 0.0 { 0.0 } else { 1.0 };
            blocks.clear();
            for start in (first..end).step_by(LANES) {
                // What is left of the last block repeats the last particle.
                let lanes = |of: &dyn Fn(usize) -> f64| -> Lanes {
                    std::array::from_fn(|lane| of((start + lane).min(end - 1)))
                };
                blocks.push(Block {
                    x: lanes(&|i| grid.in_cells(0, poses.x[i])),
                    y: lanes(&|i| grid.in_cells(1, poses.y[i])),
                    sin: lanes(&|i| poses.sin[i]),
                    cos: lanes(&|i| poses.cos[i]),
                    value: [neutral; LANES],
                });
            }
            let log_weights = &mut log_weights[first..end];
            if self.random == 0.0 {
                arch.dispatch(
                    #[inline(always)]
                    || {
                        for beam in beams() {
                            each_block(&lookup, blocks, beam, |value, squared| {
                                *value += f64::from(squared);
                            });
                        }
                    },
                );
                let constant = endpoints.len() as f64 * self.ln_hit;
                take_values(blocks, log_weights, neutral, |sum| {
                    self.exponent * (constant - sum * decay)
                });
                continue;
            }
            let (decay, hit, random) = (decay as f32, self.hit, self.random);
            let mut beams = beams();
            let mut left = endpoints.len();
            while left > 0 {
                let group = left.min(self.group);
                left -= group;
                arch.dispatch(
                    #[inline(always)]
                    || {
                        for beam in beams.by_ref().take(group) {
                            each_block(&lookup, blocks, beam, |value, squared| {
                                let gaussian = exp_nonpositive(-squared * decay);
                                *value *= hit * f64::from(gaussian) + random;
                            });
                        }
                    },
                );
                take_values(blocks, log_weights, neutral, |product| self.exponent * product.ln());
            }
        }
    }

    fn add_with(
        &self,
        distance_squared: impl Fn(Point<2>) -> f64,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        scratch: &mut Scratch,
        log_weights: &mut [f64],
    ) {
        let squared = &mut scratch.squared;
        for (i, log_weight) in log_weights.iter_mut().enumerate() {
            let (x, y, sin, cos) = (poses.x[i], poses.y[i], poses.sin[i], poses.cos[i]);
            squared.clear();
            squared.extend(endpoints.x().iter().zip(endpoints.y()).map(|(&ex, &ey)| {
                distance_squared([x + cos * ex - sin * ey, y + sin * ex + cos * ey])
            }));
            *log_weight += self.exponent * self.log_likelihood_of(squared);
        }
    }

    /// Σ ln p(z) over beams with these squared distances (m²).
    fn log_likelihood_of(&self, distances_squared: &[f64]) -> f64 {
        if self.random == 0.0 {
            // ln(a·exp(−d²·decay)) without the exp, which would underflow to 0 far from the map.
            let sum: f64 = distances_squared.iter().sum();
            return distances_squared.len() as f64 * self.ln_hit - sum * self.decay;
        }
        // One logarithm for as many factors as a product can hold.
        let factor = |&squared: &f64| self.hit * (-squared * self.decay).exp() + self.random;
        distances_squared
            .chunks(self.group)
            .map(|group| group.iter().map(factor).product::<f64>().ln())
            .sum()
    }
}

/// Particles whose state stays in the first-level cache.
const CHUNK: usize = 512;

/// Buffers, reused from scan to scan.
#[derive(Default)]
pub(crate) struct Scratch {
    blocks: Vec<Block>,
    squared: Vec<f64>,
}

/// Particles side by side: positions in cells of the grid, sines and cosines of their headings, and
/// the sum or product over beams so far.
struct Block {
    x: Lanes,
    y: Lanes,
    sin: Lanes,
    cos: Lanes,
    value: Lanes,
}

/// Updates the value of every particle by the squared distance (in cells) of a beam's endpoint (in
/// cells, in the robot's frame) from the map.
#[inline(always)]
fn each_block(
    lookup: &Lookup<'_>,
    blocks: &mut [Block],
    (ex, ey): (f64, f64),
    update: impl Fn(&mut f64, f32),
) {
    for block in blocks {
        let mut x = [0.0; LANES];
        let mut y = [0.0; LANES];
        for lane in 0..LANES {
            let (sin, cos) = (block.sin[lane], block.cos[lane]);
            x[lane] = block.x[lane] + cos * ex - sin * ey;
            y[lane] = block.y[lane] + sin * ex + cos * ey;
        }
        let squared = lookup.distances_squared(&x, &y);
        for lane in 0..LANES {
            update(&mut block.value[lane], squared[lane]);
        }
    }
}

/// Adds what the values stand for to the particles' log-weights and makes the values neutral again.
fn take_values(
    blocks: &mut [Block],
    log_weights: &mut [f64],
    neutral: f64,
    log_likelihood: impl Fn(f64) -> f64,
) {
    for (block, log_weights) in blocks.iter_mut().zip(log_weights.chunks_mut(LANES)) {
        for (log_weight, value) in log_weights.iter_mut().zip(&mut block.value) {
            *log_weight += log_likelihood(*value);
            *value = neutral;
        }
    }
}

/// Poses of particles: positions (m), sines and cosines of their headings.
#[derive(Clone, Copy)]
pub(crate) struct Poses<'a> {
    pub(crate) x: &'a [f64],
    pub(crate) y: &'a [f64],
    pub(crate) sin: &'a [f64],
    pub(crate) cos: &'a [f64],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FilterSettings;
    use mcl_core::PointMap;
    use proptest::prelude::*;

    proptest! {
        /// Products in groups are the sum of logarithms, at the ends of what settings allow too.
        #[test]
        fn grouping_changes_nothing(
            squared in prop::collection::vec(0.0..4.0f64, 0..400),
            z_rand in prop::sample::select(vec![0.0, 5e-324, 1e-300, 1e-12, 0.1, 0.999, 1.0]),
            sigma_hit in prop::sample::select(vec![1e-6, 0.01, 0.2, 5.0, 1e6]),
            max_range in prop::sample::select(vec![1e-6, 10.0, 1e6]),
        ) {
            let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
            let distances = MapDistances::reference(&map, 2.0).unwrap();
            let settings =
                FilterSettings { z_rand, sigma_hit, max_range, ..FilterSettings::default() };
            let field = LikelihoodField::new(&distances, &settings.check().unwrap()).unwrap();
            let (a, b) = ((1.0 - z_rand) / (sigma_hit * TAU.sqrt()), z_rand / max_range);
            let expected: f64 = squared
                .iter()
                .map(|d2| {
                    let exponent = -d2 / (2.0 * sigma_hit * sigma_hit);
                    if b == 0.0 { a.ln() + exponent } else { (a * exponent.exp() + b).ln() }
                })
                .sum();
            let found = field.log_likelihood_of(&squared);
            prop_assert!(found.is_finite());
            let scale = expected.abs().max(squared.len() as f64);
            prop_assert!((found - expected).abs() <= 1e-12 * scale, "{} for {}", found, expected);
        }
    }
}
