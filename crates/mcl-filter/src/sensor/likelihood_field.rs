use std::f64::consts::LOG2_E;

use mcl_core::{Point, Pose2, math};

use super::fetch::dispatch;
use super::lookup::{CHUNK, Lookup};
use super::pass::{Chunk, Pass, Product, Sum};
use super::{DistanceField, MapDistances, ScanEndpoints};
use crate::{CheckedSettings, FilterError};

/// Largest |ln| of a product of factors: e^690 ≈ 10^299 leaves room for rounding below the largest and above the
/// smallest normal number (10^±308).
const LARGEST_LOG: f64 = 690.0;

/// Number of poses from which beams are checked for unknown obstacles, the length checked before and behind their ends
/// (m), and the distance beside them within which the map must have something: in metres and in map spacings, whose
/// squares add up.
const LOOKING: usize = 16;
const ALONG: f64 = 0.3;
const BESIDE: f64 = 0.05;
const BESIDE_OF_SPACING: f64 = 0.6;

/// |log₂| of the smallest product of `f32` factors up to 1: six bits above the smallest normal number.
const F32_LOG2: f64 = 120.0;
/// Number of squared distances summed in `f32` before their sum is added in `f64`.
const FEW_SUMMED: usize = 16;

/// Number of factors, each with a logarithm of magnitude at most `log`, whose product has a logarithm of magnitude at
/// most `most`; at least one.
fn factors(most: f64, log: f64) -> usize {
    ((most / log.abs()) as usize).clamp(1, 1 << 20)
}

/// The likelihood field model of *Probabilistic Robotics* (table 6.3) on a map. Each used beam has
/// the likelihood
///
/// p(z) = z_hit·N(d; 0, σ_hit) + z_rand/z_max,  z_hit = 1 − z_rand,
///
/// with N the normalized one-dimensional Gaussian and d the distance from the endpoint of the beam to the
/// nearest map point (for other maps see [`MapDistances`]), truncated at `max_distance`. The likelihood of a scan
/// is the product over its beams, to the power of `likelihood_exponent` (default 1).
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
    /// Number of beams multiplied before taking a logarithm.
    group: usize,
    exponent: f64,
}

impl<'a> LikelihoodField<'a> {
    /// Creates the model from the distances of a map.
    ///
    /// # Errors
    /// [`FilterError::MaxDistanceMismatch`] if the distances are not truncated at the `max_distance` of the settings,
    /// [`FilterError::SigmaHitMismatch`] if those of an NDT map are for another σ_hit.
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
        let sigma = settings.sigma_hit.metres(distances.spacing());
        if let MapDistances::Ndt(ndt) = distances
            && ndt.sigma_hit() != sigma
        {
            return Err(FilterError::SigmaHitMismatch { found: ndt.sigma_hit(), expected: sigma });
        }
        let [hit, random] = settings.mixture(sigma);
        // Every factor is in [random, hit + random], so the logarithm of a product of n factors is
        // within ±n·max(|ln random|, |ln(hit + random)|): below LARGEST_LOG a product can neither
        // underflow nor overflow. A single factor cannot either, as random > 0 where it is used.
        let largest = math::ln(random).abs().max(math::ln(hit + random).abs());
        let group = factors(LARGEST_LOG, largest);
        Ok(LikelihoodField {
            distances,
            hit,
            ln_hit: math::ln(hit),
            decay: 1.0 / (2.0 * sigma * sigma),
            random,
            group,
            exponent: settings.likelihood_exponent,
        })
    }

    /// σ_hit (m), as set or computed from the spacing of the map.
    pub fn sigma_hit(&self) -> f64 {
        (0.5 / self.decay).sqrt()
    }

    /// The map distances.
    pub fn distances(&self) -> &'a MapDistances {
        self.distances
    }

    /// The parameters of the beam likelihood: z_hit/(σ_hit·√2π), z_rand/z_max, and σ_hit (m).
    pub(crate) fn parts(&self) -> [f64; 3] {
        [self.hit, self.random, self.sigma_hit()]
    }

    /// Log-likelihood of a scan at a finite pose of the robot, tempered by the exponent; 0 for
    /// a scan without usable beams.
    pub fn log_likelihood(&self, endpoints: &ScanEndpoints, map_from_robot: Pose2) -> f64 {
        let (sin, cos) = math::sin_cos(map_from_robot.theta);
        let mut log_likelihood = [0.0];
        let poses =
            Poses { x: &[map_from_robot.x], y: &[map_from_robot.y], sin: &[sin], cos: &[cos] };
        self.add_log_likelihoods(endpoints, poses, &mut Scratch::default(), &mut log_likelihood);
        log_likelihood[0]
    }

    /// Adds the log-likelihood of the scan at each of the poses to `log_weights`.
    pub(crate) fn add_log_likelihoods(
        &self,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        scratch: &mut Scratch,
        log_weights: &mut [f64],
    ) {
        match self.distances {
            MapDistances::Grid(field) if self.is_fast(field) => {
                self.add_fast(field, endpoints, poses, &mut scratch.chunk, log_weights);
            }
            _ => self.add_exact(endpoints, poses, scratch, log_weights),
        }
    }

    /// Leaves out the beams that end at something unknown for more than this fraction of the poses, or of 16 of them.
    /// `origin` is the position of the laser in the robot frame.
    ///
    /// A person in a corridor is always close to a wall, so the distance of the endpoint from the map is not
    /// conclusive. Instead, a beam counts as ending at something unknown if the map has nothing along its last 0.3 m
    /// and the 0.3 m beyond. Fox, Burgard and Thrun (*Markov localization for mobile robots in dynamic
    /// environments*, 1999) compare readings with expected ones, which a point map does not provide.
    pub(crate) fn leave_out_unknown(
        &self,
        endpoints: &mut ScanEndpoints,
        origin: Point<2>,
        poses: Poses<'_>,
        share: f64,
        scratch: &mut Scratch,
    ) {
        let Scratch { points, squared, .. } = scratch;
        let number = poses.x.len().min(LOOKING);
        let beside = math::hypot(BESIDE, BESIDE_OF_SPACING * self.distances.spacing());
        let steps = (2.0 * ALONG / beside).ceil();
        let is_known: Vec<bool> = endpoints
            .iter()
            .map(|endpoint| {
                let ray = [0, 1].map(|axis| endpoint[axis] - origin[axis]);
                let range = math::hypot(ray[0], ray[1]);
                let unknown = (0..number).map(|i| i * poses.x.len() / number).filter(|&i| {
                    points.clear();
                    points.extend((0..=steps as usize).map(|step| {
                        let at = range - ALONG + 2.0 * ALONG * step as f64 / steps;
                        let part = at.max(0.0) / range;
                        poses.place(i, [0, 1].map(|axis| origin[axis] + part * ray[axis]))
                    }));
                    self.distances.all_squared(points, squared);
                    squared.iter().all(|&squared| squared > beside * beside)
                });
                unknown.count() as f64 <= share * number as f64
            })
            .collect();
        endpoints.retain(|beam| is_known[beam]);
    }

    /// Number of beams that the map explains at a finite pose of the robot: those for which the Gaussian term of the
    /// likelihood exceeds z_rand/z_max; without random measurements all.
    pub(crate) fn explained(
        &self,
        endpoints: &ScanEndpoints,
        map_from_robot: Pose2,
        scratch: &mut Scratch,
    ) -> usize {
        let (sin, cos) = math::sin_cos(map_from_robot.theta);
        let pose =
            Poses { x: &[map_from_robot.x], y: &[map_from_robot.y], sin: &[sin], cos: &[cos] };
        let Scratch { points, squared, .. } = scratch;
        points.clear();
        points.extend(endpoints.iter().map(|endpoint| pose.place(0, endpoint)));
        self.distances.all_squared(points, squared);
        // Solves hit·exp(−d²·decay) > random; infinite without random measurements.
        let most = math::ln(self.hit / self.random) / self.decay;
        squared.iter().filter(|&&squared| squared < most).count()
    }
    /// Whether `f32` is accurate enough for distances and for the Gaussian, which is truncated at
    /// 2⁻¹²⁶ ≈ 10⁻³⁸ of its peak: negligible beside a random part of 10⁻³⁰ of it.
    fn is_fast(&self, field: &DistanceField) -> bool {
        let gaussian = self.random == 0.0 || self.random >= 1e-30 * self.hit;
        gaussian && field.is_single_precise()
    }

    /// Loops over beams outside and particles inside, in chunks that stay in the first-level cache: the endpoints
    /// of one beam are close together, and so are the records that they need.
    fn add_fast(
        &self,
        field: &DistanceField,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        particles: &mut Chunk,
        log_weights: &mut [f64],
    ) {
        let lookup = Lookup::new(field);
        let grid = &field.grid;
        let decay = self.decay * grid.cell * grid.cell;
        let near = field.is_near(endpoints.reach());
        let beams =
            || endpoints.x().iter().zip(endpoints.y()).map(|(x, y)| [x / grid.cell, y / grid.cell]);
        let neutral = if self.random == 0.0 { 0.0 } else { 1.0 };
        // Likelihoods divided by their maximum are between this and 1.
        let whole = self.hit + self.random;
        let smallest = self.random / whole;
        let (few, group) =
            (factors(F32_LOG2, math::log2(smallest)), factors(LARGEST_LOG, math::ln(smallest)));
        let update = Product {
            decay: (-decay * LOG2_E) as f32,
            hit: (self.hit / whole) as f32,
            random: smallest as f32,
        };
        for (chunk, log_weights) in log_weights.chunks_mut(CHUNK).enumerate() {
            let first = chunk * CHUNK;
            particles.load(grid, &poses, first..first + log_weights.len(), neutral);
            if self.random == 0.0 {
                let few = FEW_SUMMED;
                dispatch(Pass { lookup, particles, beams: beams(), near, few, update: Sum });
                let constant = endpoints.len() as f64 * self.ln_hit;
                particles.take_values(log_weights, neutral, |sum| {
                    self.exponent * (constant - sum * decay)
                });
                continue;
            }
            let mut beams = beams();
            let mut left = endpoints.len();
            while left > 0 {
                let group = left.min(group);
                left -= group;
                let beams = beams.by_ref().take(group);
                dispatch(Pass { lookup, particles, beams, near, few, update });
                let constant = group as f64 * math::ln(whole);
                particles.take_values(log_weights, neutral, |product| {
                    self.exponent * (constant + math::ln(product))
                });
            }
        }
    }

    fn add_exact(
        &self,
        endpoints: &ScanEndpoints,
        poses: Poses<'_>,
        scratch: &mut Scratch,
        log_weights: &mut [f64],
    ) {
        let Scratch { points, squared, .. } = scratch;
        for (i, log_weight) in log_weights.iter_mut().enumerate() {
            points.clear();
            points.extend(endpoints.iter().map(|endpoint| poses.place(i, endpoint)));
            self.distances.distances_squared(points, squared);
            *log_weight += self.exponent * self.log_likelihood_of(squared);
        }
    }

    /// Σ ln p(z) over beams with these squared distances (m²).
    fn log_likelihood_of(&self, distances_squared: &[f64]) -> f64 {
        if self.random == 0.0 {
            // ln(a·exp(−d²·decay)) without evaluating exp, which would underflow to 0 far from the map.
            let sum: f64 = distances_squared.iter().sum();
            return distances_squared.len() as f64 * self.ln_hit - sum * self.decay;
        }
        // One logarithm for as many factors as fit in a product.
        let factor = |&squared: &f64| self.hit * math::exp(-squared * self.decay) + self.random;
        distances_squared
            .chunks(self.group)
            .map(|group| math::ln(group.iter().map(factor).product::<f64>()))
            .sum()
    }
}

/// Buffers, reused from scan to scan.
#[derive(Default)]
pub(crate) struct Scratch {
    chunk: Chunk,
    points: Vec<Point<2>>,
    squared: Vec<f64>,
}

/// Poses of particles: positions (m), sines and cosines of their headings.
#[derive(Clone, Copy)]
pub(crate) struct Poses<'a> {
    pub(crate) x: &'a [f64],
    pub(crate) y: &'a [f64],
    pub(crate) sin: &'a [f64],
    pub(crate) cos: &'a [f64],
}

impl Poses<'_> {
    /// Transforms an endpoint to the map by pose `i`.
    fn place(&self, i: usize, [x, y]: Point<2>) -> Point<2> {
        let (sin, cos) = (self.sin[i], self.cos[i]);
        [self.x[i] + cos * x - sin * y, self.y[i] + sin * x + cos * y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Beams, FilterSettings, SigmaHit};
    use mcl_core::{LaserScan, PointMap, ScanGeometry, Seed};
    use proptest::prelude::*;
    use rand::RngExt;
    use std::f64::consts::{FRAC_PI_2, TAU};

    proptest! {
        /// Grouped products give the sum of logarithms, also at the limits of the settings.
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
                FilterSettings { z_rand, sigma_hit: SigmaHit::Metres(sigma_hit), max_range, ..FilterSettings::default() };
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

    /// The fast path against the reference path, on both sides of every switch between them: for many
    /// poses, on small and large maps, with and without random measurements.
    #[test]
    fn fast_and_reference_agree() {
        let mut rng = Seed::new(2).rng();
        for (width, z_rand, sigma_hit, max_distance, longest, is_near) in [
            (20.0, 0.1, 0.2, 2.0, 10.0, true),
            (20.0, 0.0, 0.2, 2.0, 10.0, true),
            (20.0, 1.0, 0.2, 2.0, 10.0, true),
            (20.0, 1e-28, 0.1, 2.0, 10.0, true),
            (20.0, 1e-300, 0.1, 2.0, 10.0, true),
            (100.0, 0.1, 0.2, 2.0, 80.0, false),
            (100.0, 0.0, 0.2, 2.0, 80.0, false),
            (20_000.0, 0.1, 0.2, 2.0, 10.0, false),
            (20.0, 0.1, 0.2, 100.0, 10.0, false),
        ] {
            let mut uniform = |width: f64| width * (rng.random::<f64>() - 0.5);
            let points = (0..2_000).map(|_| [1e4 + uniform(width), uniform(width)]);
            let map = PointMap::new(points.collect()).unwrap();
            let settings = FilterSettings {
                z_rand,
                sigma_hit: SigmaHit::Metres(sigma_hit),
                max_distance,
                max_range: longest,
                ..FilterSettings::default()
            };
            let settings = settings.check().unwrap();
            let grid = MapDistances::grid(&map, max_distance).unwrap();
            let reference = MapDistances::reference(&map, max_distance).unwrap();
            let scan = LaserScan {
                stamp: None,
                geometry: ScanGeometry { start_angle: -1.5, angle_step: 0.01, beams: 300 },
                ranges: (0..300).map(|_| 0.5 * longest + uniform(0.99 * longest)).collect(),
                map_from_laser: None,
                odometry: None,
                sweep: Default::default(),
            };
            let mut endpoints = ScanEndpoints::default();
            endpoints.load(&scan, &Pose2::IDENTITY, Beams::All, longest).unwrap();
            let MapDistances::Grid(field) = &grid else { panic!("no grid") };
            assert_eq!(field.is_near(endpoints.reach()), is_near);
            // More than a chunk, and not a multiple of the vector length.
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
            // The logarithm of a beam changes by at most d/σ² per metre of d, here with an error of less
            // than 1e-6 m and that of the position (DistanceField::is_near), and by the relative errors of
            // the exponential and five more roundings, 2⁻²³ + 5·2⁻²⁴ < 5e-7.
            let error = 1e-6 + if is_near { 6.5 * longest / 16_777_216.0 } else { 0.0 };
            let steepest = max_distance.min(10.0 * sigma_hit) / (sigma_hit * sigma_hit);
            let steepest =
                if z_rand == 0.0 { max_distance / (sigma_hit * sigma_hit) } else { steepest };
            let tolerance = 300.0 * (error * steepest + 5e-7);
            for (found, expected) in found.iter().zip(&expected) {
                let off = (found - expected).abs();
                assert!(
                    off <= tolerance,
                    "{width} m, z_rand {z_rand}, {longest} m: {found} for {expected}"
                );
            }
        }
    }

    /// A wall, beams that end 0, 0.3, 0.6 and 1.5 m before it, and σ_hit = 0.3 m. Both terms are equal at
    /// d = σ·√(2·ln(hit/random)), so three beams are explained at this pose, and one half a metre behind it.
    #[test]
    fn explained_beams_by_hand() {
        let wall = (-300..=300).map(|i| [5.0, 0.01 * f64::from(i)]);
        let map = PointMap::new(wall.collect()).unwrap();
        let distances = MapDistances::grid(&map, 2.0).unwrap();
        let scan = LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 1e-6, beams: 4 },
            ranges: vec![5.0, 4.7, 4.4, 3.5],
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        };
        let mut endpoints = ScanEndpoints::default();
        endpoints.load(&scan, &Pose2::IDENTITY, Beams::All, 10.0).unwrap();
        let explained = |z_rand, x| {
            let settings = FilterSettings {
                sigma_hit: SigmaHit::Metres(0.3),
                z_rand,
                beam_floor: None,
                max_range: 10.0,
                ..FilterSettings::default()
            };
            let field = LikelihoodField::new(&distances, &settings.check().unwrap()).unwrap();
            let [hit, random, sigma] = field.parts();
            let most = sigma * (2.0 * (hit / random).ln()).sqrt();
            let scratch = &mut Scratch::default();
            (most, field.explained(&endpoints, Pose2::new(x, 0.0, 0.0), scratch))
        };
        let (most, number) = explained(0.5, 0.0);
        assert!((0.6..1.5).contains(&most) && number == 3, "{most} {number}");
        assert_eq!(explained(0.5, -0.5).1, 1);
        assert_eq!(explained(1.0, 0.0).1, 0);
        assert_eq!(explained(0.0, 0.0).1, 4);
    }

    /// A wall ahead, one to the left, and four poses. Points are 1 cm apart, so beams are checked within 5 cm to
    /// each side.
    #[test]
    fn beams_that_end_at_something_unknown_are_left_out() {
        let ahead = (-300..=300).map(|i| [5.0, 0.01 * f64::from(i)]);
        let left = (-200..=500).map(|i| [0.01 * f64::from(i), 3.0]);
        let map = PointMap::new(ahead.chain(left).collect()).unwrap();
        let grid = MapDistances::grid(&map, 2.0).unwrap();
        let reference = MapDistances::reference(&map, 2.0).unwrap();
        let scan = LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: 0.0, angle_step: FRAC_PI_2, beams: 2 },
            // Ahead, the beam ends 0.2 m before the wall; to the left, a person stands 0.5 m before the wall.
            ranges: vec![4.8, 2.5],
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        };
        // At the last two poses there is an unknown obstacle ahead too, and at the last one the left beam ends at the
        // wall.
        let (x, y) = ([0.0, 0.02, -1.0, -1.0], [0.0, 0.02, 0.0, 0.4]);
        let poses = Poses { x: &x, y: &y, sin: &[0.0; 4], cos: &[1.0; 4] };
        let settings = FilterSettings::default().check().unwrap();
        for distances in [&grid, &reference] {
            let field = LikelihoodField::new(distances, &settings).unwrap();
            for (share, left) in [(0.0, 0), (0.25, 0), (0.5, 1), (0.74, 1), (0.75, 2), (1.0, 2)] {
                let mut endpoints = ScanEndpoints::default();
                endpoints.load(&scan, &Pose2::IDENTITY, Beams::All, 10.0).unwrap();
                let mut scratch = Scratch::default();
                field.leave_out_unknown(&mut endpoints, [0.0; 2], poses, share, &mut scratch);
                assert_eq!(endpoints.len(), left, "{share}");
                assert!(left == 0 || (endpoints.x()[0] - 4.8).abs() < 1e-12);
            }
        }
    }
}
