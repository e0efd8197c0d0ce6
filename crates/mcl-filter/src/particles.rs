use std::f64::consts::PI;

use mcl_core::memory::with_room;
use mcl_core::{Bounds, MAX_COORDINATE, Pose2, Rng, StandardNormal, math, wrap_angle};
use rand::RngExt;
use rand_distr::Distribution;

use crate::sensor::FreeSpace;
use crate::{FilterError, InitialPose};

/// What out-of-memory errors call the memory of particles.
pub(crate) const PARTICLES: &str = "particles";

/// Weighted poses of the robot in the map frame, as a structure of arrays.
#[derive(Debug, Clone, PartialEq)]
pub struct Particles {
    /// x (m).
    pub(crate) x: Vec<f64>,
    /// y (m).
    pub(crate) y: Vec<f64>,
    /// Heading (rad), wrapped to (−π, π].
    pub(crate) theta: Vec<f64>,
    /// Natural logarithm of the weight.
    pub(crate) log_weight: Vec<f64>,
}

impl Particles {
    /// Draws `number` particles of equal weight: for [`InitialPose::Known`] from a Gaussian around
    /// `map_from_robot`, otherwise uniformly over the free space (over `bounds` if no free space is known) and all
    /// headings, for [`InitialPose::Scan`] until the first scan.
    ///
    /// # Errors
    /// [`FilterError::NoInitialPose`] if a pose is needed and `None`;
    /// [`FilterError::NonFinitePose`] if it is not finite; [`FilterError::Memory`].
    pub fn draw(
        number: usize,
        initial: InitialPose,
        map_from_robot: Option<Pose2>,
        bounds: &Bounds<2>,
        free: Option<&FreeSpace>,
        rng: &mut Rng,
    ) -> Result<Self, FilterError> {
        let mut particles = Particles {
            x: with_room(number, PARTICLES)?,
            y: with_room(number, PARTICLES)?,
            theta: with_room(number, PARTICLES)?,
            log_weight: with_room(number, PARTICLES)?,
        };
        particles.log_weight.resize(number, -math::ln(number as f64));
        match initial {
            InitialPose::Known { std_x, std_y, std_theta } => {
                let mean = map_from_robot.ok_or(FilterError::NoInitialPose)?;
                if !mean.is_finite() {
                    return Err(FilterError::NonFinitePose { what: "initial pose", pose: mean });
                }
                for _ in 0..number {
                    let [x, y, theta]: [f64; 3] =
                        std::array::from_fn(|_| StandardNormal.sample(rng));
                    particles.push(Pose2::new(
                        mean.x + std_x * x,
                        mean.y + std_y * y,
                        mean.theta + std_theta * theta,
                    ));
                }
            }
            InitialPose::Uniform {} | InitialPose::Scan { .. } => {
                for _ in 0..number {
                    let [x, y] = match free {
                        Some(free) => free.draw(rng),
                        None => [0, 1].map(|axis| {
                            bounds.min[axis] + rng.random::<f64>() * bounds.extent(axis)
                        }),
                    };
                    let turn: f64 = rng.random();
                    particles.push(Pose2::new(x, y, PI * (1.0 - 2.0 * turn)));
                }
            }
        }
        particles.check_places()?;
        Ok(particles)
    }

    /// Appends a pose; the caller sets its weight.
    pub(crate) fn push(&mut self, pose: Pose2) {
        self.x.push(pose.x);
        self.y.push(pose.y);
        self.theta.push(wrap_angle(pose.theta));
    }

    /// Number of particles, at least 1.
    #[allow(clippy::len_without_is_empty)] // A filter always has particles.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// The poses with the natural logarithms of their normalized weights.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Pose2, f64)> + '_ {
        (0..self.len()).map(|i| (self.pose(i), self.log_weight[i]))
    }

    pub(crate) fn pose(&self, i: usize) -> Pose2 {
        Pose2::new(self.x[i], self.y[i], self.theta[i])
    }

    /// Returns an error for particles with coordinates that are not finite or too large for a map.
    pub(crate) fn check_places(&self) -> Result<(), FilterError> {
        let is_place =
            |pose: Pose2| pose.is_finite() && pose.x.abs().max(pose.y.abs()) <= MAX_COORDINATE;
        match (0..self.len()).find(|&i| !is_place(self.pose(i))) {
            Some(particle) => {
                Err(FilterError::NonFiniteParticle { particle, pose: self.pose(particle) })
            }
            None => Ok(()),
        }
    }

    /// Normalizes the weights to sum to one and writes them, not as logarithms, to `weights`. Returns
    /// the logarithm of their previous sum: ln Σ exp(l) = m + ln Σ exp(l − m), with m the largest l, so that the
    /// largest term is 1, nothing overflows and not everything underflows.
    ///
    /// # Errors
    /// [`FilterError::DegenerateWeights`] if no weight is above 0, or one is NaN or infinite.
    pub(crate) fn normalize(&mut self, weights: &mut Vec<f64>) -> Result<f64, FilterError> {
        let largest = self.log_weight.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        weights.clear();
        weights.extend(self.log_weight.iter().map(|l| math::exp(l - largest)));
        let sum: f64 = weights.iter().sum();
        // Also NaN if the largest is −∞ or any is NaN, which `f64::max` ignores.
        let log_sum = largest + math::ln(sum);
        if !log_sum.is_finite() {
            return Err(FilterError::DegenerateWeights { log_sum });
        }
        self.log_weight.iter_mut().for_each(|l| *l -= log_sum);
        weights.iter_mut().for_each(|w| *w /= sum);
        Ok(log_sum)
    }

    /// Replaces the particles by the selected ones, with equal weights; `buffer` is overwritten.
    pub(crate) fn choose(&mut self, chosen: &[usize], buffer: &mut Vec<f64>) {
        self.reorder(chosen, buffer);
        self.make_equal();
    }

    /// Gives all particles the same weight.
    pub(crate) fn make_equal(&mut self) {
        let equal = -math::ln(self.len() as f64);
        self.log_weight.clear();
        self.log_weight.resize(self.len(), equal);
    }

    /// Creates an empty set.
    #[cfg(test)]
    pub(crate) fn empty() -> Self {
        Particles { x: Vec::new(), y: Vec::new(), theta: Vec::new(), log_weight: Vec::new() }
    }

    /// Removes all particles.
    pub(crate) fn clear(&mut self) {
        for component in [&mut self.x, &mut self.y, &mut self.theta, &mut self.log_weight] {
            component.clear();
        }
    }

    /// Replaces particle i by particle `order[i]`, with its weight; `buffer` is overwritten.
    pub(crate) fn reorder(&mut self, order: &[usize], buffer: &mut Vec<f64>) {
        for component in [&mut self.x, &mut self.y, &mut self.theta, &mut self.log_weight] {
            buffer.clear();
            buffer.extend(order.iter().map(|&i| component[i]));
            std::mem::swap(component, buffer);
        }
    }
}

/// The effective sample size 1/Σw², between 1 and N: the number of equally weighted particles with the same
/// information (Kong, Liu and Wong 1994). The weights must sum to one.
pub fn effective_sample_size(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::ObstacleGrid;
    use mcl_core::Seed;
    use proptest::prelude::*;

    const BOUNDS: Bounds<2> = Bounds { min: [-1.0, 2.0], max: [3.0, 4.0] };
    const KNOWN: InitialPose = InitialPose::Known { std_x: 0.1, std_y: 0.2, std_theta: 0.05 };

    fn weighted(log_weight: &[f64]) -> Particles {
        let zeros = vec![0.0; log_weight.len()];
        Particles {
            x: zeros.clone(),
            y: zeros.clone(),
            theta: zeros,
            log_weight: log_weight.to_vec(),
        }
    }

    #[test]
    fn a_known_pose_is_surrounded() {
        const N: usize = 20_000;
        let mean = Pose2::new(5.0, -6.0, 3.1);
        let particles =
            Particles::draw(N, KNOWN, Some(mean), &BOUNDS, None, &mut Seed::new(1).rng()).unwrap();
        type Off = fn(Pose2, Pose2) -> f64;
        let components: [(f64, Off); 3] = [
            (0.1, |p, mean| p.x - mean.x),
            (0.2, |p, mean| p.y - mean.y),
            (0.05, |p, mean| wrap_angle(p.theta - mean.theta)),
        ];
        for (std, off) in components {
            let values: Vec<f64> = particles.iter().map(|(p, _)| off(p, mean)).collect();
            let average = values.iter().sum::<f64>() / N as f64;
            let variance = values.iter().map(|v| v * v).sum::<f64>() / N as f64;
            assert!(average.abs() < 4.5 * std / (N as f64).sqrt());
            assert!((variance / (std * std) - 1.0).abs() < 4.5 * (2.0 / N as f64).sqrt());
        }
        assert!(particles.iter().all(|(p, l)| p.theta.abs() <= PI && l == -(N as f64).ln()));
    }

    #[test]
    fn an_unknown_pose_is_anywhere_on_the_map() {
        const N: usize = 20_000;
        let particles = Particles::draw(
            N,
            InitialPose::Uniform {},
            None,
            &BOUNDS,
            None,
            &mut Seed::new(1).rng(),
        )
        .unwrap();
        let mean_x = particles.x.iter().sum::<f64>() / N as f64;
        let mean_theta = particles.theta.iter().sum::<f64>() / N as f64;
        // A uniform variable of width w has the variance w²/12.
        let bound = |width: f64| 4.5 * width / (12.0 * N as f64).sqrt();
        assert!((mean_x - 1.0).abs() < bound(4.0) && mean_theta.abs() < bound(2.0 * PI));
        assert!(particles.iter().all(|(p, _)| {
            (-1.0..=3.0).contains(&p.x) && (2.0..=4.0).contains(&p.y) && p.theta.abs() <= PI
        }));
        // Corners are reached, so the whole area is covered.
        assert!(particles.iter().any(|(p, _)| p.x < -0.9 && p.y > 3.9));
    }

    /// The bounding box of the map has eight cells, two of which are free.
    #[test]
    fn an_unknown_pose_is_in_free_space() {
        let grid = ObstacleGrid {
            width: 4,
            resolution: 1.0,
            map_from_grid: Pose2::new(-1.0, 2.0, 0.0),
            occupied: vec![false; 8],
            free: (0..8).map(|cell| cell == 1 || cell == 6).collect(),
        };
        let free = FreeSpace::of(&grid).unwrap();
        let draw = |initial| {
            Particles::draw(500, initial, None, &BOUNDS, free.as_ref(), &mut Seed::new(1).rng())
        };
        for initial in [InitialPose::Uniform {}, InitialPose::scan()] {
            let particles = draw(initial).unwrap();
            assert!(particles.iter().all(|(p, _)| free.as_ref().unwrap().holds([p.x, p.y])));
        }
    }

    #[test]
    fn a_missing_or_impossible_pose_is_refused() {
        let draw = |pose| Particles::draw(3, KNOWN, pose, &BOUNDS, None, &mut Seed::new(1).rng());
        assert_eq!(draw(None), Err(FilterError::NoInitialPose));
        let nowhere = Pose2::new(f64::NAN, 0.0, 0.0);
        assert!(matches!(draw(Some(nowhere)), Err(FilterError::NonFinitePose { .. })));
    }

    #[test]
    fn normalizing_survives_any_scale() {
        for shift in [0.0, 1e6, -1e6] {
            let logs = [shift, shift + 3.0f64.ln(), f64::NEG_INFINITY];
            let mut particles = weighted(&logs);
            let mut weights = Vec::new();
            let log_sum = particles.normalize(&mut weights).unwrap();
            assert!((log_sum - (shift + 4.0f64.ln())).abs() <= 1e-9);
            assert!((weights[0] - 0.25).abs() < 1e-9 && (weights[1] - 0.75).abs() < 1e-9);
            assert_eq!(weights[2], 0.0);
            assert!((particles.log_weight[1] - 0.75f64.ln()).abs() < 1e-9);
        }
    }

    #[test]
    fn invalid_weights_are_refused() {
        for logs in [
            [f64::NEG_INFINITY, f64::NEG_INFINITY],
            [0.0, f64::NAN],
            [f64::NAN, 0.0],
            [f64::INFINITY, 0.0],
        ] {
            let result = weighted(&logs).normalize(&mut Vec::new());
            assert!(matches!(result, Err(FilterError::DegenerateWeights { .. })), "{logs:?}");
        }
    }

    #[test]
    fn effective_sample_size_by_hand() {
        assert_eq!(effective_sample_size(&[1.0, 0.0, 0.0]), 1.0);
        assert_eq!(effective_sample_size(&[0.25; 4]), 4.0);
        // 1/(0.25 + 0.0625 + 0.0625)
        assert!((effective_sample_size(&[0.5, 0.25, 0.25]) - 8.0 / 3.0).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn weights_sum_to_one(logs in prop::collection::vec(-800.0..800.0f64, 1..50)) {
            let mut weights = Vec::new();
            let mut particles = weighted(&logs);
            particles.normalize(&mut weights).unwrap();
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let ess = effective_sample_size(&weights);
            prop_assert!((1.0 - 1e-9..=logs.len() as f64 + 1e-9).contains(&ess));
            // Normalizing again changes nothing.
            prop_assert!(particles.normalize(&mut weights).unwrap().abs() < 1e-12);
        }
    }
}
