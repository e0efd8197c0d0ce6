use mcl_core::{Pose2, Seed, StandardNormal, wrap_angle};
use rand_distr::Distribution;
use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::check::check_std;

/// Gaussian noise that an experiment adds to the odometry of a log, so that its result does not depend
/// on how well the wheels of one robot were calibrated (Meyer-Delius and Burgard, section V-B). The default is no
/// noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OdometryNoise {
    /// Standard deviation along each of x and y of an increment (m).
    pub xy: f64,
    /// Standard deviation of the rotation of an increment (rad).
    pub theta: f64,
}

/// Adds independent Gaussian noise to x, y and θ of each increment; headings are wrapped.
///
/// The noise of increment `k` depends only on `seed` and `k`: it is the same for every map, and independent of which
/// other increments exist. `None` stays `None`.
///
/// # Errors
/// [`FilterError::Setting`] unless both standard deviations are finite and at least 0.
pub fn noisy_increments(
    increments: &[Option<Pose2>],
    noise: OdometryNoise,
    seed: Seed,
) -> Result<Vec<Option<Pose2>>, FilterError> {
    check_std("odometry_noise.xy", noise.xy)?;
    check_std("odometry_noise.theta", noise.theta)?;
    let seed = seed.derive("odometry-noise");
    let add = |(step, increment): (usize, &Option<Pose2>)| {
        increment.map(|increment| {
            let mut rng = seed.derive_index(step as u64).rng();
            let [x, y, theta]: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
            Pose2::new(
                increment.x + noise.xy * x,
                increment.y + noise.xy * y,
                wrap_angle(increment.theta + noise.theta * theta),
            )
        })
    };
    Ok(increments.iter().enumerate().map(add).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: OdometryNoise = OdometryNoise { xy: 0.2, theta: 0.1 };

    #[test]
    fn no_noise_changes_no_bit() {
        let increments = [None, Some(Pose2::new(0.1, -0.7, 0.3)), Some(Pose2::IDENTITY)];
        let noisy = noisy_increments(&increments, OdometryNoise::default(), Seed::new(1)).unwrap();
        assert_eq!(noisy, increments);
    }

    #[test]
    fn the_draw_of_a_step_depends_on_seed_and_step_only() {
        let one = [Some(Pose2::new(1.0, 0.0, 0.0)); 5];
        let other = [None, None, Some(Pose2::new(1.0, 0.0, 0.0)), None];
        let draw = |increments: &[Option<Pose2>], seed| {
            noisy_increments(increments, NOISE, Seed::new(seed)).unwrap()[2]
        };
        assert_eq!(draw(&one, 3), draw(&other, 3));
        assert_ne!(draw(&one, 3), draw(&one, 4));
        let all = noisy_increments(&one, NOISE, Seed::new(3)).unwrap();
        assert_ne!(all[1], all[2]);
    }

    /// Pinned values, so that no dependency can silently change results.
    #[test]
    fn draws_are_stable() {
        let increments = [Some(Pose2::IDENTITY); 2];
        let unit = OdometryNoise { xy: 1.0, theta: 1.0 };
        let noisy = noisy_increments(&increments, unit, Seed::new(1)).unwrap();
        assert_eq!(
            noisy[1],
            Some(Pose2::new(0.5844890906873869, -0.31570124432349195, -0.030547462399977302))
        );
    }

    #[test]
    fn moments_are_the_requested_ones() {
        const N: usize = 50_000;
        let increments = vec![Some(Pose2::new(1.0, 2.0, 3.1)); N];
        let noisy = noisy_increments(&increments, NOISE, Seed::new(5)).unwrap();
        type Axis = fn(Pose2) -> f64;
        let axes: [(Axis, f64); 3] = [
            (|p| p.x - 1.0, NOISE.xy),
            (|p| p.y - 2.0, NOISE.xy),
            // The headings are on both sides of π, so their differences must be wrapped.
            (|p| wrap_angle(p.theta - 3.1), NOISE.theta),
        ];
        for (axis, std) in axes {
            let values: Vec<f64> = noisy.iter().map(|p| axis(p.unwrap())).collect();
            let mean = values.iter().sum::<f64>() / N as f64;
            let variance = values.iter().map(|v| v * v).sum::<f64>() / N as f64;
            // Standard errors are σ/√N and σ²·√(2/N); deviations beyond 4.5 of them occur once in 150,000 runs.
            assert!(mean.abs() < 4.5 * std / (N as f64).sqrt(), "{mean}");
            let error = variance / (std * std) - 1.0;
            assert!(error.abs() < 4.5 * (2.0 / N as f64).sqrt(), "{error}");
        }
        assert!(noisy.iter().flatten().all(|p| p.theta.abs() <= std::f64::consts::PI));
    }

    #[test]
    fn impossible_noise_is_refused() {
        for noise in
            [OdometryNoise { xy: -1.0, ..NOISE }, OdometryNoise { theta: f64::NAN, ..NOISE }]
        {
            assert!(noisy_increments(&[], noise, Seed::new(1)).is_err());
        }
    }
}
