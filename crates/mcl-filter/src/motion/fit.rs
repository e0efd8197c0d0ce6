use mcl_core::{Pose2, Recording, Seed, math, wrap_angle};
use rand::RngExt;

use super::odometry_model::OdometryModel;
use crate::FilterError;

/// Smallest number of steps to fit a motion model.
const LEAST_STEPS: usize = 100;
/// Number of blocks of consecutive steps.
const BLOCKS: usize = 40;
/// Number of bootstrap resamples: (1 + this) · 2.5 % is a whole number.
const RESAMPLES: usize = 399;
/// Degrees of freedom ν of Student's t.
const FREEDOM: f64 = 4.0;
/// κ: the ratio of the squared scale of the t distribution that fits Gaussian noise best to the variance of that
/// noise. It solves E[(ν + 1)·z²/(ν·κ + z²)] = 1 for standard normal z.
const SCALE: f64 = 0.690_566_806_670_893_4;
/// Steps on which odometry and reference both move by less than this (m, rad) are left out.
const STILL: f64 = 1e-6;
/// A standard deviation below this (m, rad) is rounding.
const ROUNDING: f64 = 1e-5;

/// Motion of a robot from one scan to the next: its pose in its previous frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionStep {
    /// According to the odometry.
    pub odometry: Pose2,
    /// According to the reference.
    pub reference: Pose2,
}

impl MotionStep {
    /// The steps of a recording that have both odometry and reference, in log order.
    pub fn of(recording: &Recording) -> Vec<Self> {
        let robot_from_laser = recording.robot_from_laser;
        let laser_from_robot = robot_from_laser.inverse();
        let of_robot = |motion| robot_from_laser.compose(&motion).compose(&laser_from_robot);
        let steps = recording.scans.windows(2).filter_map(|pair| {
            let reference = pair[0].map_from_laser?.between(&pair[1].map_from_laser?);
            let odometry = pair[1].odometry?;
            Some(MotionStep { odometry: of_robot(odometry), reference: of_robot(reference) })
        });
        steps.collect()
    }

    /// Whether the robot stands still according to both.
    fn is_still(&self) -> bool {
        let moves =
            |pose: &Pose2| math::hypot(pose.x, pose.y) >= STILL || pose.theta.abs() >= STILL;
        !moves(&self.odometry) && !moves(&self.reference)
    }
}

/// A parameter with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// The estimate.
    pub value: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// The best-fitting parameters of both motion models for the odometry of a log, each in the unit of its setting.
///
/// *Estimate.* The differences between odometry and reference are modelled by Student's t distribution with 4 degrees
/// of freedom, so that occasional corrections of the reference or wheel slip have little influence. The
/// likelihood is maximized over the components of the variance, each at least 0. The scale of the t distribution is
/// chosen such that for Gaussian noise, as assumed by the motion models, the estimate is its variance.
///
/// *Intervals* are percentiles of a bootstrap over 40 blocks of consecutive steps, because odometry errors are
/// correlated: successive steps are not independent, but blocks nearly are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionFit {
    /// Number of steps used.
    pub steps: usize,
    /// Number of steps left out because the robot stands still according to odometry and reference (less than 10⁻⁶ m
    /// and rad). Such steps are often copies of the step before and carry no information about the noise.
    pub still: usize,
    /// [`FilterSettings::position_noise`](crate::FilterSettings::position_noise).
    pub position_noise: [Fitted; 3],
    /// [`FilterSettings::heading_noise`](crate::FilterSettings::heading_noise).
    pub heading_noise: [Fitted; 3],
    /// [`FilterSettings::alpha`](crate::FilterSettings::alpha).
    pub alpha: [Fitted; 4],
}

impl MotionFit {
    /// Fits both models; `turning_in_place` (m) is the threshold of table 5.6
    /// ([`FilterSettings::turning_in_place`](crate::FilterSettings::turning_in_place)).
    ///
    /// # Errors
    /// [`FilterError::FewSteps`] for fewer than 100 steps, [`FilterError::ExactOdometry`] if the odometry
    /// equals the reference.
    pub fn of(
        steps: &[MotionStep],
        turning_in_place: f64,
        seed: Seed,
    ) -> Result<Self, FilterError> {
        let moving: Vec<MotionStep> =
            steps.iter().filter(|step| !step.is_still()).copied().collect();
        if moving.len() < LEAST_STEPS {
            return Err(FilterError::FewSteps { steps: moving.len(), least: LEAST_STEPS });
        }
        let seed = seed.derive("motion-fit");
        let [mut position, mut heading] = [const { Vec::new() }; 2];
        let [mut rotations, mut translations] = [const { Vec::new() }; 2];
        let book = OdometryModel::new([0.0; 4], turning_in_place);
        for (index, MotionStep { odometry, reference }) in moving.iter().enumerate() {
            let block = index * BLOCKS / moving.len();
            let [length, turn] =
                [math::hypot(odometry.x, odometry.y), odometry.theta].map(|v| v * v);
            let parts = [1.0, length, turn];
            let add = |rows: &mut Vec<Difference<3>>, off: f64| {
                rows.push(Difference { parts, square: off * off, block });
            };
            add(&mut position, reference.x - odometry.x);
            add(&mut position, reference.y - odometry.y);
            add(&mut heading, wrap_angle(reference.theta - odometry.theta));

            let book = book.differences(odometry, reference);
            let add = |rows: &mut Vec<Difference<2>>, (off, parts): (f64, [f64; 2])| {
                // The model has no noise if the odometry stands still.
                if parts != [0.0; 2] {
                    rows.push(Difference { parts, square: off * off, block });
                }
            };
            book.rotations.into_iter().for_each(|rotation| add(&mut rotations, rotation));
            add(&mut translations, book.translation);
        }
        let std = |Fitted { value, low, high }: Fitted| Fitted {
            value: value.sqrt(),
            low: low.sqrt(),
            high: high.sqrt(),
        };
        let position_noise = fit_with_intervals(&position, seed).map(std);
        let heading_noise = fit_with_intervals(&heading, seed).map(std);
        if position_noise.iter().chain(&heading_noise).all(|part| part.value < ROUNDING) {
            return Err(FilterError::ExactOdometry { steps: moving.len() });
        }
        let [[a1, a2], [a3, a4]] =
            [&rotations, &translations].map(|rows| fit_with_intervals(rows, seed));
        Ok(MotionFit {
            steps: moving.len(),
            still: steps.len() - moving.len(),
            position_noise,
            heading_noise,
            alpha: [a1, a2, a3, a4],
        })
    }
}

/// A squared difference, whose variance is Σ wₖ·partsₖ.
struct Difference<const K: usize> {
    parts: [f64; K],
    square: f64,
    block: usize,
}

/// The maximum likelihood components of the variance, with bootstrap intervals over blocks.
fn fit_with_intervals<const K: usize>(rows: &[Difference<K>], seed: Seed) -> [Fitted; K] {
    // Starts with equal components, so that none is missed.
    let mean = |value: &dyn Fn(&Difference<K>) -> f64| rows.iter().map(value).sum::<f64>();
    let square = mean(&|row| row.square);
    let equal = std::array::from_fn(|k| {
        let part = mean(&|row| row.parts[k]);
        if part > 0.0 { square / (K as f64 * part) } else { 0.0 }
    });
    let value = fit(rows, &[1.0; BLOCKS], equal);
    let mut rng = seed.rng();
    let mut resampled: [Vec<f64>; K] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    for _ in 0..RESAMPLES {
        let mut times = [0.0; BLOCKS];
        for _ in 0..BLOCKS {
            times[rng.random_range(0..BLOCKS)] += 1.0;
        }
        let found = fit(rows, &times, value);
        resampled.iter_mut().zip(found).for_each(|(values, found)| values.push(found));
    }
    std::array::from_fn(|k| {
        let values = &mut resampled[k];
        values.sort_by(f64::total_cmp);
        // All ranks of the true value among the resamples are equally likely; 95 % lie between these.
        let tail = (RESAMPLES + 1) / 40;
        Fitted { value: value[k], low: values[tail - 1], high: values[RESAMPLES - tail] }
    })
}

/// Finds the w ≥ 0 that maximizes the likelihood of the differences, each counted as often as its block, from a start
/// above 0.
///
/// At the maximum Σ partsₖ·(z − v)/v² is 0, or below 0 if wₖ is 0; v = Σ wₖ·partsₖ is the variance and
/// z = (ν + 1)·v·r²/(ν·κ·v + r²) the squared difference r², downweighted for outliers. With z and the
/// weights 1/v² of the previous iteration, this is a least-squares problem (Fisher scoring).
fn fit<const K: usize>(rows: &[Difference<K>], times: &[f64; BLOCKS], start: [f64; K]) -> [f64; K] {
    let mut w = start;
    for _ in 0..200 {
        let mut matrix = [[0.0; K]; K];
        let mut right = [0.0; K];
        for row in rows {
            let variance: f64 = w.iter().zip(&row.parts).map(|(w, part)| w * part).sum();
            if variance <= 0.0 || times[row.block] == 0.0 {
                continue;
            }
            let square =
                (FREEDOM + 1.0) * variance * row.square / (FREEDOM * SCALE * variance + row.square);
            let weight = times[row.block] / (variance * variance);
            for k in 0..K {
                right[k] += weight * row.parts[k] * square;
                for j in 0..K {
                    matrix[k][j] += weight * row.parts[k] * row.parts[j];
                }
            }
        }
        let mut next = w;
        // Coordinate descent on a problem of two or three unknowns.
        for _ in 0..100 {
            for k in 0..K {
                let others: f64 = (0..K).filter(|&j| j != k).map(|j| matrix[k][j] * next[j]).sum();
                // A component that no difference depends on stays 0.
                let best =
                    if matrix[k][k] > 0.0 { (right[k] - others) / matrix[k][k] } else { 0.0 };
                // Decreases towards 0 in steps, so that no variance vanishes at once.
                next[k] = best.max(0.1 * w[k]);
            }
        }
        // Approximately in standard errors.
        let moved = |k: usize| (next[k] - w[k]).abs() * matrix[k][k].sqrt();
        let is_done = (0..K).all(|k| moved(k) <= 1e-4);
        w = next;
        if is_done {
            break;
        }
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{GaussianModel, Motion};
    use rand_distr::{Distribution, StandardNormal};

    const POSITION: [f64; 3] = [0.02, 0.05, 0.08];
    const HEADING: [f64; 3] = [0.01, 0.0, 0.1];
    const ALPHA: [f64; 4] = [0.02, 0.03, 0.005, 0.01];

    /// Steps forward, backward, in curves and in place; the true motion has the noise of a model.
    fn simulated(number: usize, seed: u64, motion: impl Fn(&Pose2) -> Motion) -> Vec<MotionStep> {
        let mut rng = Seed::new(seed).rng();
        let step = |_| {
            let kind = rng.random_range(0..4);
            let [length, turn]: [f64; 2] = [rng.random(), rng.random()];
            let odometry = match kind {
                0 => Pose2::new(0.6 * length, 0.0, 0.1 * (turn - 0.5)),
                1 => Pose2::new(-0.3 * length, 0.02, 0.3 * (turn - 0.5)),
                2 => Pose2::new(0.5 * length, 0.1 * turn, turn),
                _ => Pose2::new(0.002, 0.0, 1.2 * (turn - 0.5)),
            };
            let [mut x, mut y, mut theta] = [[0.0]; 3];
            motion(&odometry).sample(&mut x, &mut y, &mut theta, &mut rng);
            MotionStep { odometry, reference: Pose2::new(x[0], y[0], theta[0]) }
        };
        (0..number).map(step).collect()
    }

    fn gaussian(increment: &Pose2) -> Motion {
        Motion::Gaussian(GaussianModel::new(POSITION, HEADING).motion(increment))
    }

    fn book(increment: &Pose2) -> Motion {
        Motion::Book(OdometryModel::new(ALPHA, 0.01).motion(increment))
    }

    fn fitted(steps: &[MotionStep]) -> MotionFit {
        MotionFit::of(steps, 0.01, Seed::new(1)).unwrap()
    }

    #[test]
    fn parameters_of_simulated_robots_are_recovered() {
        let fit = fitted(&simulated(15_000, 1, gaussian));
        let found = fit.position_noise.iter().chain(&fit.heading_noise);
        for (part, truth) in found.zip(POSITION.iter().chain(&HEADING)) {
            let is_near = (part.value - truth).abs() < 0.05 * truth;
            assert!(is_near || *truth == 0.0 && part.low < 1e-4, "{part:?}, not {truth}");
            assert!(part.low <= part.value && part.value <= part.high);
        }
        let fit = fitted(&simulated(15_000, 2, book));
        for (part, truth) in fit.alpha.iter().zip(ALPHA) {
            assert!((part.value - truth).abs() < 0.1 * truth, "{part:?}, not {truth}");
        }
    }

    /// 95 % of the intervals should contain the parameter. Fewer than 15 of 20 robots have a probability of 3 · 10⁻⁴,
    /// and fewer than 178 of all 200 intervals are 4 standard deviations off.
    #[test]
    fn intervals_hold_the_parameters() {
        let robots = 20;
        let mut holding = [0; 10];
        for robot in 0..robots {
            let of_gaussian = fitted(&simulated(500, 100 + robot, gaussian));
            let of_book = fitted(&simulated(500, 200 + robot, book));
            let found = of_gaussian.position_noise.into_iter().chain(of_gaussian.heading_noise);
            let found = found.chain(of_book.alpha);
            let truths = POSITION.iter().chain(&HEADING).chain(&ALPHA);
            for ((part, truth), holding) in found.zip(truths).zip(&mut holding) {
                // An interval contains a parameter of 0 if its lower bound rounds to 0.
                *holding += u32::from(part.low <= truth + 1e-3 && *truth <= part.high);
            }
        }
        assert!(holding.iter().all(|&number| number >= 15), "{holding:?}");
        assert!(holding.iter().sum::<u32>() >= 178, "{holding:?}");
    }

    /// A tenth of the steps is off by a metre, as if the reference had been corrected: with a Gaussian likelihood the
    /// noise would be 0.3 m.
    #[test]
    fn outliers_hardly_count() {
        let mut steps = simulated(4_000, 3, gaussian);
        steps.iter_mut().step_by(10).for_each(|step| step.reference.x += 1.0);
        let [step, ..] = fitted(&steps).position_noise;
        assert!(step.value < 2.0 * POSITION[0], "{step:?}");
    }

    /// Correlated errors make intervals wider, because steps are not independent samples.
    #[test]
    fn lasting_errors_widen_the_intervals() {
        let steps = simulated(2_000, 4, gaussian);
        let mut lasting = steps.clone();
        let mut rng = Seed::new(5).rng();
        for stretch in lasting.chunks_mut(50) {
            let scale: f64 = StandardNormal.sample(&mut rng);
            for step in stretch {
                let off = step.odometry.between(&step.reference);
                let off = Pose2::new(scale * off.x, scale * off.y, scale * off.theta);
                step.reference = step.odometry.compose(&off);
            }
        }
        let width = |steps: &[MotionStep]| {
            let [step, ..] = fitted(steps).position_noise;
            (step.high - step.low) / step.value
        };
        assert!(width(&lasting) > 2.0 * width(&steps));
    }

    #[test]
    fn what_cannot_be_fitted_is_refused() {
        let steps = simulated(99, 6, gaussian);
        let error = MotionFit::of(&steps, 0.01, Seed::new(1)).unwrap_err();
        assert_eq!(error, FilterError::FewSteps { steps: 99, least: 100 });
        let exact: Vec<MotionStep> = simulated(200, 6, gaussian)
            .into_iter()
            .map(|step| MotionStep { reference: step.odometry, ..step })
            .collect();
        let error = MotionFit::of(&exact, 0.01, Seed::new(1)).unwrap_err();
        assert_eq!(error, FilterError::ExactOdometry { steps: 200 });
    }

    /// A robot that stands still gives no information, and one that never turns gives none about rotations.
    #[test]
    fn standing_still_is_left_out() {
        let straight = |increment: &Pose2| gaussian(&Pose2 { theta: 0.0, ..*increment });
        let mut steps = simulated(1_000, 7, straight);
        steps.iter_mut().for_each(|step| step.odometry.theta = 0.0);
        let before = fitted(&steps);
        assert_eq!(before.position_noise[2].value, 0.0);
        steps.extend([MotionStep { odometry: Pose2::IDENTITY, reference: Pose2::IDENTITY }; 500]);
        let after = fitted(&steps);
        assert_eq!((after.steps, after.still), (1_000, 500));
        assert_eq!(MotionFit { still: 0, ..after }, before);
    }
}
