use std::f64::consts::{FRAC_PI_2, PI};

use mcl_core::{Pose2, math, wrap_angle};

use crate::proposal::Noise;

/// The sampled odometry motion model of *Probabilistic Robotics* (table 5.6): an increment is a
/// rotation, a translation and a second rotation, each with Gaussian noise whose variance grows with
/// the squares of all three.
///
/// The table is extended in two ways:
/// - *Backward motion*: if the first rotation would exceed a quarter turn, the robot is
///   assumed to drive backward. Both rotations are reduced by half a turn and the translation is
///   negative. The first rotation is then as small as AMCL's `min(|δ_rot1|, π − |δ_rot1|)`, and
///   reversing causes as much noise as driving forward. (AMCL also folds the second rotation by itself,
///   which leaves half a turn in place with almost no noise; here it keeps its size.)
/// - *Turning in place*: below a threshold
///   ([`FilterSettings::turning_in_place`](crate::FilterSettings::turning_in_place)) the direction of a translation is
///   encoder noise. Treated as a rotation, it would cause rotation noise that does not exist, so the noise is that of
///   a single rotation, the second. The increment itself is applied unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryModel {
    alpha: [f64; 4],
    turning_in_place: f64,
}

impl OdometryModel {
    /// Creates a model with α₁…α₄ (see [`FilterSettings::alpha`](crate::FilterSettings::alpha)), each finite
    /// and at least 0, and the translation (m) below which the robot turns in place.
    pub fn new(alpha: [f64; 4], turning_in_place: f64) -> Self {
        OdometryModel { alpha, turning_in_place }
    }

    /// The motion for an odometry increment (the pose of the robot in its previous frame), which can be sampled for
    /// every particle.
    pub fn motion(&self, increment: &Pose2) -> NoisyMotion {
        let parts = rotations_and_translation(increment);
        let [rotation1, translation, rotation2] = parts;
        let [a1, a2, a3, a4] = self.alpha;
        let [square1, square, square2] = self.squares(parts, increment.theta);
        NoisyMotion {
            rotation1,
            translation,
            rotation2,
            rotation1_variance: a1 * square1 + a2 * square,
            translation_variance: a3 * square + a4 * (square1 + square2),
            rotation2_variance: a1 * square2 + a2 * square,
        }
    }

    /// Squares of the first rotation, the translation and the second rotation that cause noise, given those of an
    /// increment that rotates the robot by `turn` (rad).
    fn squares(&self, [rotation1, translation, rotation2]: [f64; 3], turn: f64) -> [f64; 3] {
        let (turn1, turn2) = match translation.abs() < self.turning_in_place {
            true => (0.0, wrap_angle(turn)),
            false => (rotation1, rotation2),
        };
        [turn1, translation, turn2].map(|value| value * value)
    }

    /// Differences between the true motion of the robot and the odometry, each with the factors of α₁ and α₂ (α₃ and
    /// α₄ for the translation) in its variance; all 0 for a difference that does not exist.
    ///
    /// If the robot turns in place, both rotations are one.
    pub(super) fn differences(&self, odometry: &Pose2, truth: &Pose2) -> Differences {
        let parts = rotations_and_translation(odometry);
        let [rotation1, translation, rotation2] = parts;
        let [square1, square, square2] = self.squares(parts, odometry.theta);
        let distance = math::hypot(truth.x, truth.y);
        // Of the two motions to the same position, forward and backward, uses the one with the smaller rotation.
        let first = wrap_angle(math::atan2(truth.y, truth.x) - rotation1);
        let (first, along) = match first.abs() > FRAC_PI_2 {
            true => (wrap_angle(first - PI), -distance),
            false => (first, distance),
        };
        let both = wrap_angle(truth.theta - odometry.theta);
        let rotations = match translation.abs() < self.turning_in_place {
            true => [(both, [square2, 2.0 * square]), (0.0, [0.0; 2])],
            false => {
                let second = wrap_angle(truth.theta - rotation1 - first - rotation2);
                [(first, [square1, square]), (second, [square2, square])]
            }
        };
        Differences { rotations, translation: (along - translation, [square, square1 + square2]) }
    }
}

/// δ_rot1 (rad), at most a quarter turn either way, δ_trans (m), negative if the robot drives backward, and δ_rot2
/// (rad) of an increment.
fn rotations_and_translation(increment: &Pose2) -> [f64; 3] {
    let distance = math::hypot(increment.x, increment.y);
    let direction = math::atan2(increment.y, increment.x);
    let (rotation1, translation) = match direction.abs() > FRAC_PI_2 {
        true => (wrap_angle(direction - PI), -distance),
        false => (direction, distance),
    };
    [rotation1, translation, wrap_angle(increment.theta - rotation1)]
}

/// Result of [`OdometryModel::differences`], in rad and m.
pub(super) struct Differences {
    pub(super) rotations: [(f64, [f64; 2]); 2],
    pub(super) translation: (f64, [f64; 2]),
}

/// An odometry increment as rotation, translation and second rotation, with their noise variances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisyMotion {
    /// δ_rot1 (rad), at most a quarter turn either way.
    pub rotation1: f64,
    /// δ_trans (m), negative if the robot drives backward.
    pub translation: f64,
    /// δ_rot2 (rad).
    pub rotation2: f64,
    /// Variance of the noise on δ_rot1 (rad²).
    pub rotation1_variance: f64,
    /// Variance of the noise on δ_trans (m²).
    pub translation_variance: f64,
    /// Variance of the noise on δ_rot2 (rad²).
    pub rotation2_variance: f64,
}

impl NoisyMotion {
    /// Returns a function that moves a pose, given as x, y (m) and heading (rad), by this motion with standard normal
    /// noise on rotation 1, translation and rotation 2.
    pub(super) fn mover(&self) -> impl Fn([f64; 3], Noise) -> [f64; 3] {
        let NoisyMotion { rotation1, translation, rotation2, .. } = *self;
        let std1 = self.rotation1_variance.sqrt();
        let std_translation = self.translation_variance.sqrt();
        let std2 = self.rotation2_variance.sqrt();
        move |[x, y, theta], [noise1, noise, noise2]| {
            let rotation1 = rotation1 + std1 * noise1;
            let translation = translation + std_translation * noise;
            let rotation2 = rotation2 + std2 * noise2;
            let (sin, cos) = math::sin_cos(theta + rotation1);
            [x + translation * cos, y + translation * sin, theta + rotation1 + rotation2]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use mcl_core::Seed;
    use proptest::prelude::*;

    const ALPHA: [f64; 4] = [0.02, 0.03, 0.05, 0.04];

    fn sample(model: OdometryModel, increment: &Pose2, start: Pose2, n: usize) -> Vec<Pose2> {
        let (mut x, mut y, mut theta) = (vec![start.x; n], vec![start.y; n], vec![start.theta; n]);
        let mut rng = Seed::new(11).rng();
        let motion = Motion::Book(model.motion(increment));
        motion.sample(&mut x, &mut y, &mut theta, &mut rng);
        (0..n).map(|i| Pose2::new(x[i], y[i], theta[i])).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> (f64, f64) {
        let values: Vec<f64> = values.collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        (mean, (variance / n).sqrt())
    }

    /// With noise of variance v₁ on the first rotation and v_t on the translation, the
    /// sampled position has, in the previous frame:
    ///   E[x] = t·e^(−v₁/2)·cos δ_rot1 (the mean of a cosine with a Gaussian angle),
    ///   E[x² + y²] = t² + v_t,
    ///   E[(x cos δ + y sin δ)²] = (t² + v_t)·(1 + e^(−2v₁))/2,
    /// and the heading has mean Δθ and variance v₁ + v₂.
    #[test]
    fn moments_agree_with_the_formulas() {
        let increments = [
            Pose2::new(0.5, 0.2, 0.4),
            Pose2::new(-0.5, 0.2, -0.3),
            Pose2::new(0.003, -0.002, 2.0),
            Pose2::new(0.3, 0.0, -3.0),
        ];
        for increment in increments {
            let motion = OdometryModel::new(ALPHA, 0.01).motion(&increment);
            let (v1, vt, v2) =
                (motion.rotation1_variance, motion.translation_variance, motion.rotation2_variance);
            let samples =
                sample(OdometryModel::new(ALPHA, 0.01), &increment, Pose2::IDENTITY, 100_000);
            let turned = |p: &Pose2| wrap_angle(p.theta - increment.theta);
            let squared = increment.x.powi(2) + increment.y.powi(2) + vt;
            let (sin, cos) = increment.y.atan2(increment.x).sin_cos();
            let damped = (-v1 / 2.0).exp();
            let checks: [(&str, (f64, f64), f64); 6] = [
                ("x", mean(samples.iter().map(|p| p.x)), increment.x * damped),
                ("y", mean(samples.iter().map(|p| p.y)), increment.y * damped),
                (
                    "squared distance",
                    mean(samples.iter().map(|p| p.x.powi(2) + p.y.powi(2))),
                    squared,
                ),
                (
                    "squared advance",
                    mean(samples.iter().map(|p| (p.x * cos + p.y * sin).powi(2))),
                    squared * (1.0 + (-2.0 * v1).exp()) / 2.0,
                ),
                ("turn", mean(samples.iter().map(turned)), 0.0),
                ("squared turn", mean(samples.iter().map(|p| turned(p).powi(2))), v1 + v2),
            ];
            for (what, (found, standard_error), expected) in checks {
                let off = (found - expected).abs();
                assert!(off < 4.5 * standard_error, "{increment:?} {what}: {found} for {expected}");
            }
        }
    }

    /// Worked out by hand from table 5.6 for (δ_rot1, δ_trans, δ_rot2) = (atan 4/3, 0.5, −0.2).
    #[test]
    fn variances_are_those_of_the_table() {
        let rotation1 = (4.0f64 / 3.0).atan();
        let motion = OdometryModel::new(ALPHA, 0.01).motion(&Pose2::new(0.3, 0.4, rotation1 - 0.2));
        assert!((motion.rotation1 - rotation1).abs() < 1e-15);
        assert!((motion.translation - 0.5).abs() < 1e-15);
        assert!((motion.rotation2 + 0.2).abs() < 1e-15);
        let square = rotation1 * rotation1;
        assert!((motion.rotation1_variance - (0.02 * square + 0.03 * 0.25)).abs() < 1e-15);
        assert!(
            (motion.translation_variance - (0.05 * 0.25 + 0.04 * (square + 0.04))).abs() < 1e-15
        );
        assert!((motion.rotation2_variance - (0.02 * 0.04 + 0.03 * 0.25)).abs() < 1e-15);
    }

    #[test]
    fn reversing_is_as_noisy_as_advancing() {
        let model = OdometryModel::new(ALPHA, 0.01);
        let ahead = model.motion(&Pose2::new(0.4, 0.1, 0.2));
        let back = model.motion(&Pose2::new(-0.4, -0.1, 0.2));
        assert_eq!(back.translation, -ahead.translation);
        assert!((back.rotation1 - ahead.rotation1).abs() < 1e-15);
        assert!((back.rotation1_variance - ahead.rotation1_variance).abs() < 1e-15);
        assert!((back.translation_variance - ahead.translation_variance).abs() < 1e-15);
        assert!((back.rotation2_variance - ahead.rotation2_variance).abs() < 1e-15);
        let straight_back = model.motion(&Pose2::new(-1.0, 0.0, 0.0));
        assert_eq!(straight_back.rotation1_variance, ALPHA[1]);
        assert_eq!(straight_back.translation_variance, ALPHA[2]);
    }

    #[test]
    fn turning_in_place_is_one_rotation() {
        let model = OdometryModel::new([0.02, 0.0, 0.0, 0.04], 0.01);
        // A millimetre to the left would be a quarter turn if treated as the direction of travel.
        let motion = model.motion(&Pose2::new(0.0, 0.001, 1.0));
        assert_eq!(motion.rotation1_variance, 0.0);
        assert_eq!(motion.rotation2_variance, 0.02);
        assert_eq!(motion.translation_variance, 0.04);
        let half_turn = model.motion(&Pose2::new(0.0, 0.0, PI));
        assert!((half_turn.rotation2_variance - 0.02 * PI * PI).abs() < 1e-15);
    }

    #[test]
    fn standing_still_moves_nothing() {
        let start = Pose2::new(1.0, -2.0, 3.0);
        let moved = sample(OdometryModel::new([1.0; 4], 0.01), &Pose2::IDENTITY, start, 10);
        assert!(moved.iter().all(|pose| *pose == start));
    }

    proptest! {
        /// Without noise the model is the composition of poses, whatever the direction of travel.
        #[test]
        fn without_noise_it_composes(
            (x, y, theta) in (-2.0..2.0f64, -2.0..2.0f64, -PI..PI),
            (sx, sy, st) in (-9.0..9.0f64, -9.0..9.0f64, -PI..PI),
            scale in prop::sample::select(vec![1.0, 1e-3, 1e-6]),
        ) {
            let increment = Pose2::new(scale * x, scale * y, theta);
            let start = Pose2::new(sx, sy, st);
            let moved = sample(OdometryModel::new([0.0; 4], 0.01), &increment, start, 1)[0];
            let expected = start.compose(&increment);
            prop_assert!(moved.distance(&expected) < 1e-12);
            prop_assert!(wrap_angle(moved.theta - expected.theta).abs() < 1e-12);
        }
    }
}
