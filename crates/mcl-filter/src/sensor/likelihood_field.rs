use std::f64::consts::TAU;
use std::ops::Range;

use mcl_core::{Point, Pose2};
use pulp::{Arch, NullaryFnOnce};

use super::exp::exp_nonpositive;
use super::grid::Grid;
use super::lookup::{CHUNK, Lookup, Workspace};
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
                self.add_fast(field, endpoints, poses, &mut scratch.chunk, log_weights);
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
        particles: &mut Chunk,
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
        let neutral = if self.random == 0.0 { 0.0 } else { 1.0 };
        for (chunk, log_weights) in log_weights.chunks_mut(CHUNK).enumerate() {
            let first = chunk * CHUNK;
            particles.load(grid, &poses, first..first + log_weights.len(), neutral);
            if self.random == 0.0 {
                arch.dispatch(Pass { lookup, particles, beams: beams(), update: Sum });
                let constant = endpoints.len() as f64 * self.ln_hit;
                particles.take_values(log_weights, neutral, |sum| {
                    self.exponent * (constant - sum * decay)
                });
                continue;
            }
            let update = Product { decay: decay as f32, hit: self.hit, random: self.random };
            let mut beams = beams();
            let mut left = endpoints.len();
            while left > 0 {
                let group = left.min(self.group);
                left -= group;
                let beams = beams.by_ref().take(group);
                arch.dispatch(Pass { lookup, particles, beams, update });
                particles.take_values(log_weights, neutral, |product| self.exponent * product.ln());
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

/// Buffers, reused from scan to scan.
#[derive(Default)]
pub(crate) struct Scratch {
    chunk: Chunk,
    squared: Vec<f64>,
}

/// Some particles: positions in cells of the grid, sines and cosines of their headings, and the sum
/// or product over beams so far.
#[derive(Default)]
struct Chunk {
    x: Vec<f64>,
    y: Vec<f64>,
    sin: Vec<f64>,
    cos: Vec<f64>,
    value: Vec<f64>,
    endpoint_x: Vec<f64>,
    endpoint_y: Vec<f64>,
    workspace: Box<Workspace>,
}

impl Chunk {
    fn load(&mut self, grid: &Grid, poses: &Poses<'_>, range: Range<usize>, neutral: f64) {
        let fill = |to: &mut Vec<f64>, from: &[f64]| {
            to.clear();
            to.extend_from_slice(&from[range.clone()]);
        };
        fill(&mut self.x, poses.x);
        fill(&mut self.y, poses.y);
        fill(&mut self.sin, poses.sin);
        fill(&mut self.cos, poses.cos);
        self.x.iter_mut().for_each(|x| *x = grid.in_cells(0, *x));
        self.y.iter_mut().for_each(|y| *y = grid.in_cells(1, *y));
        for buffer in [&mut self.value, &mut self.endpoint_x, &mut self.endpoint_y] {
            buffer.clear();
            buffer.resize(range.len(), neutral);
        }
    }

    /// Adds what the values stand for to the particles' log-weights and makes the values neutral
    /// again.
    fn take_values(
        &mut self,
        log_weights: &mut [f64],
        neutral: f64,
        log_likelihood: impl Fn(f64) -> f64,
    ) {
        for (log_weight, value) in log_weights.iter_mut().zip(&mut self.value) {
            *log_weight += log_likelihood(*value);
            *value = neutral;
        }
    }
}

/// What a beam does to the value of a particle.
trait Update: Copy {
    /// What counts of a squared distance, in `f32`.
    fn term(self, squared: f32) -> f32;
    fn next(self, value: f64, term: f32) -> f64;
}

/// Without random measurements: the sum of squared distances.
#[derive(Clone, Copy)]
struct Sum;

impl Update for Sum {
    #[inline(always)]
    fn term(self, squared: f32) -> f32 {
        squared
    }

    #[inline(always)]
    fn next(self, value: f64, term: f32) -> f64 {
        value + f64::from(term)
    }
}

/// The product of likelihoods.
#[derive(Clone, Copy)]
struct Product {
    /// 1/(2σ_hit²) in cells.
    decay: f32,
    hit: f64,
    random: f64,
}

impl Update for Product {
    #[inline(always)]
    fn term(self, squared: f32) -> f32 {
        exp_nonpositive(-squared * self.decay)
    }

    #[inline(always)]
    fn next(self, value: f64, term: f32) -> f64 {
        value * (self.hit * f64::from(term) + self.random)
    }
}

/// Updates the value of every particle by the squared distances (in cells) of the beams' endpoints
/// (in cells, in the robot's frame) from the map.
struct Pass<'a, I, U> {
    lookup: Lookup<'a>,
    particles: &'a mut Chunk,
    beams: I,
    update: U,
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
impl<I, U> NullaryFnOnce for Pass<'_, I, U>
where
    I: Iterator<Item = (f64, f64)>,
    U: Update,
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Chunk { x, y, sin, cos, value, endpoint_x, endpoint_y, workspace } = self.particles;
        let number = x.len();
        let (x, y) = (&x[..number], &y[..number]);
        let (sin, cos) = (&sin[..number], &cos[..number]);
        let (endpoint_x, endpoint_y) = (&mut endpoint_x[..number], &mut endpoint_y[..number]);
        for (ex, ey) in self.beams {
            for i in 0..number {
                endpoint_x[i] = x[i] + cos[i] * ex - sin[i] * ey;
                endpoint_y[i] = y[i] + sin[i] * ex + cos[i] * ey;
            }
            let squared = self.lookup.distances_squared(endpoint_x, endpoint_y, workspace);
            squared.iter_mut().for_each(|squared| *squared = self.update.term(*squared));
            for (value, &term) in value.iter_mut().zip(&*squared) {
                *value = self.update.next(*value, term);
            }
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
    use crate::{Beams, FilterSettings};
    use mcl_core::{LaserScan, PointMap, ScanGeometry, Seed};
    use proptest::prelude::*;
    use rand::RngExt;

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

    /// The fast path against the reference, on both sides of every switch between them: from many
    /// poses, on small and wide maps, with and without random measurements.
    #[test]
    fn fast_and_reference_agree() {
        let mut rng = Seed::new(2).rng();
        for (width, z_rand, sigma_hit, max_distance) in [
            (20.0, 0.1, 0.2, 2.0),
            (20.0, 0.0, 0.2, 2.0),
            (20.0, 1.0, 0.2, 2.0),
            (20.0, 1e-28, 0.1, 2.0),
            (20.0, 1e-300, 0.1, 2.0),
            (20_000.0, 0.1, 0.2, 2.0),
            (20.0, 0.1, 0.2, 100.0),
        ] {
            let mut uniform = |width: f64| width * (rng.random::<f64>() - 0.5);
            let points = (0..2_000).map(|_| [1e4 + uniform(width), uniform(width)]);
            let map = PointMap::new(points.collect()).unwrap();
            let settings =
                FilterSettings { z_rand, sigma_hit, max_distance, ..FilterSettings::default() };
            let settings = settings.check().unwrap();
            let grid = MapDistances::grid(&map, max_distance).unwrap();
            let reference = MapDistances::reference(&map, max_distance).unwrap();
            let scan = LaserScan {
                stamp: None,
                geometry: ScanGeometry { start_angle: -1.5, angle_step: 0.01, beams: 300 },
                ranges: (0..300).map(|_| 5.0 + uniform(9.9)).collect(),
                map_from_laser: None,
                odometry: None,
            };
            let mut endpoints = ScanEndpoints::default();
            endpoints.load(&scan, &Pose2::IDENTITY, Beams::All, 10.0).unwrap();
            // More than a chunk, and no multiple of anything.
            let n = 2 * CHUNK + 13;
            let x: Vec<f64> = (0..n).map(|_| 1e4 + uniform(1.2 * width)).collect();
            let y: Vec<f64> = (0..n).map(|_| uniform(1.2 * width)).collect();
            let (sin, cos): (Vec<f64>, Vec<f64>) = (0..n).map(|_| uniform(6.3).sin_cos()).unzip();
            let poses = Poses { x: &x, y: &y, sin: &sin, cos: &cos };
            let [found, expected] = [&grid, &reference].map(|distances| {
                let field = LikelihoodField::new(distances, &settings).unwrap();
                let mut log_weights = vec![-1.0; n];
                let mut scratch = Scratch::default();
                field.add_log_likelihoods(&endpoints, poses, &mut scratch, &mut log_weights);
                log_weights
            });
            // A beam's logarithm changes by at most d/σ² per metre of d, here with an error of less
            // than 1e-6 m, and by the relative error of the exponential, 2e-7.
            let steepest = max_distance.min(10.0 * sigma_hit) / (sigma_hit * sigma_hit);
            let steepest =
                if z_rand == 0.0 { max_distance / (sigma_hit * sigma_hit) } else { steepest };
            let tolerance = 300.0 * (1e-6 * steepest + 2e-7);
            for (found, expected) in found.iter().zip(&expected) {
                let off = (found - expected).abs();
                assert!(off <= tolerance, "{width} m, z_rand {z_rand}: {found} for {expected}");
            }
        }
    }
}
