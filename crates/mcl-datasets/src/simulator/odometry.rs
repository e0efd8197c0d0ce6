use mcl_core::{Pose2, Rng, StandardNormal};
use rand_distr::Distribution;

use super::settings::OdometrySettings;

impl OdometrySettings {
    /// The logged odometry increment for a true increment (metres, radians, in the frame of the laser at the
    /// previous scan).
    pub(super) fn measure(&self, increment: &Pose2, rng: &mut Rng) -> Pose2 {
        let [ahead, left, turned]: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(rng));
        let (forward, turn) = (increment.x, increment.theta);
        let error = Pose2::new(
            self.translation_scale * forward + self.noise_translation * ahead,
            self.sideways_drift * forward + self.turn_slip * turn + self.noise_translation * left,
            self.heading_drift * forward
                + self.rotation_scale * turn
                + self.noise_rotation * turned,
        );
        increment.compose(&error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;

    #[test]
    fn systematic_errors_are_those_of_the_equations() {
        let settings = OdometrySettings {
            translation_scale: 0.1,
            sideways_drift: 0.2,
            turn_slip: 0.0,
            heading_drift: 0.3,
            rotation_scale: 0.0,
            noise_translation: 0.0,
            noise_rotation: 0.0,
        };
        let mut rng = Seed::new(1).rng();
        let logged = settings.measure(&Pose2::new(2.0, 0.0, 0.0), &mut rng);
        assert!(logged.distance(&Pose2::new(2.2, 0.4, 0.0)) < 1e-12);
        assert!((logged.theta - 0.6).abs() < 1e-12);
        let settings = OdometrySettings { turn_slip: 0.5, rotation_scale: -0.25, ..settings };
        // Turning by 1 rad: the slip of 0.5 m to the left of the new heading, and 0.25 rad too few.
        let logged = settings.measure(&Pose2::new(0.0, 0.0, 1.0), &mut rng);
        let expected = Pose2::new(-0.5 * 1f64.sin(), 0.5 * 1f64.cos(), 0.0);
        assert!(logged.distance(&expected) < 1e-12 && (logged.theta - 0.75).abs() < 1e-12);
    }

    #[test]
    fn noise_has_the_stated_deviation() {
        let settings = OdometrySettings {
            translation_scale: 0.0,
            sideways_drift: 0.0,
            turn_slip: 0.0,
            heading_drift: 0.0,
            rotation_scale: 0.0,
            noise_translation: 0.2,
            noise_rotation: 0.1,
        };
        let mut rng = Seed::new(2).rng();
        let draws: Vec<Pose2> =
            (0..20_000).map(|_| settings.measure(&Pose2::IDENTITY, &mut rng)).collect();
        let deviation = |part: fn(&Pose2) -> f64| {
            (draws.iter().map(|d| part(d).powi(2)).sum::<f64>() / draws.len() as f64).sqrt()
        };
        // Standard error of a deviation over 20,000 draws: σ/200.
        assert!((deviation(|d| d.x) - 0.2).abs() < 4e-3);
        assert!((deviation(|d| d.y) - 0.2).abs() < 4e-3);
        assert!((deviation(|d| d.theta) - 0.1).abs() < 2e-3);
    }
}
