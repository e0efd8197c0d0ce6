use mcl_core::{Pose2, Rng, StandardNormal, math};
use rand::RngExt;
use rand_distr::Distribution;

use super::obstacles::Material;
use super::ray::RayCaster;
use super::settings::LaserSettings;

impl LaserSettings {
    /// One scan from `map_from_laser`: readings in m, one per beam.
    pub(super) fn scan(
        &self,
        map_from_laser: &Pose2,
        caster: &RayCaster,
        rng: &mut Rng,
    ) -> Vec<f64> {
        let geometry = self.geometry();
        (0..geometry.beams)
            .map(|i| self.reading(map_from_laser, geometry.angle(i), caster, rng))
            .collect()
    }

    fn reading(
        &self,
        map_from_laser: &Pose2,
        beam_angle: f64,
        caster: &RayCaster,
        rng: &mut Rng,
    ) -> f64 {
        if rng.random_bool(self.dropout_probability) {
            return self.no_return;
        }
        let Some(mut range) = self.echo(map_from_laser, beam_angle, caster, rng) else {
            return self.no_return;
        };
        if rng.random_bool(self.short_probability) {
            range *= rng.random::<f64>();
        }
        self.logged(range, rng)
    }

    /// Updates the readings of a scan for people in front of it: a beam that meets somebody before its
    /// current reading gets a new one.
    pub(super) fn stand_before(
        &self,
        ranges: &mut [f64],
        map_from_laser: &Pose2,
        people: &RayCaster,
        rng: &mut Rng,
    ) {
        let geometry = self.geometry();
        for (beam, range) in ranges.iter_mut().enumerate() {
            let angle = map_from_laser.theta + geometry.angle(beam);
            let hit = people.first_hit([map_from_laser.x, map_from_laser.y], angle, 0.0);
            // A missing return counts as farther than anybody.
            let Some(hit) = hit.filter(|hit| hit.distance < *range) else { continue };
            *range = match rng.random_bool(self.dropout_probability) {
                true => self.no_return,
                false => self.logged(hit.distance, rng),
            };
        }
    }

    /// The reading for a true distance: noise, rounding, and the limit of the range.
    fn logged(&self, distance: f64, rng: &mut Rng) -> f64 {
        let mut range = distance + self.range_noise * StandardNormal.sample(rng);
        if self.resolution > 0.0 {
            range = (range / self.resolution).round() * self.resolution;
        }
        // Noise and rounding may reduce the shortest ranges to zero or less, which scanners do not log.
        if range > 0.0 && range <= self.max_range { decimal(range) } else { self.no_return }
    }

    /// True distance to the surface that returns the beam, in m.
    fn echo(
        &self,
        map_from_laser: &Pose2,
        beam_angle: f64,
        caster: &RayCaster,
        rng: &mut Rng,
    ) -> Option<f64> {
        let origin = [map_from_laser.x, map_from_laser.y];
        let angle = map_from_laser.theta + beam_angle;
        let mut hit = caster.first_hit(origin, angle, 0.0)?;
        while hit.material == Material::Glass {
            let answer =
                self.glass_return * math::powf(hit.incidence_cos.min(1.0), self.glass_exponent);
            if rng.random_bool(answer) {
                break;
            }
            hit = caster.first_hit(origin, angle, hit.distance)?;
        }
        Some(hit.distance)
    }
}

/// The float nearest to a decimal with six places: a text log holds it exactly.
pub(super) fn decimal(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::Obstacles;
    use mcl_core::Seed;
    use std::f64::consts::FRAC_PI_2;

    /// What a perfect scanner with beams to the right, ahead and to the left reads.
    fn perfect() -> LaserSettings {
        LaserSettings {
            beams: 3,
            start_angle: -FRAC_PI_2,
            angle_step: FRAC_PI_2,
            range_noise: 0.0,
            dropout_probability: 0.0,
            short_probability: 0.0,
            ..LaserSettings::default()
        }
    }

    /// A room of 4 m × 3 m with a pillar of radius 0.5 m at (3, 1).
    fn room() -> Obstacles {
        let mut room = Obstacles::default();
        room.add_box([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]);
        room.add_circle([3.0, 1.0], 0.5);
        room
    }

    fn scan(laser: &LaserSettings, room: &Obstacles, pose: Pose2, seed: u64) -> Vec<f64> {
        laser.scan(&pose, &RayCaster::new(room), &mut Seed::new(seed).rng())
    }

    #[test]
    fn a_perfect_scanner_reads_the_drawing() {
        let room = room();
        // Facing the pillar: wall 1 m to the right, pillar 0.5 m ahead, wall 2 m to the left.
        let ranges = scan(&perfect(), &room, Pose2::new(2.0, 1.0, 0.0), 1);
        assert_eq!(ranges, [1.0, 0.5, 2.0]);
        // Facing north, 0.3 m beside the pillar's axis: it is 3 − 0.4 − 2 m to the right.
        let ranges = scan(&perfect(), &room, Pose2::new(2.0, 1.3, FRAC_PI_2), 1);
        assert_eq!(ranges, [0.6, 1.7, 2.0]);
        // Rounded to centimetres, or not at all.
        let pose = Pose2::new(2.0, 2.1234, 0.0);
        assert_eq!(scan(&perfect(), &room, pose, 1), [2.12, 2.0, 0.88]);
        let exact = LaserSettings { resolution: 0.0, ..perfect() };
        assert_eq!(scan(&exact, &room, pose, 1), [2.1234, 2.0, 0.8766]);
        // Out of range, and out of the building.
        let short = LaserSettings { max_range: 1.5, ..perfect() };
        assert_eq!(scan(&short, &room, Pose2::new(2.0, 1.0, 0.0), 1), [1.0, 0.5, 81.83]);
        assert_eq!(scan(&perfect(), &room, Pose2::new(9.0, 1.0, 0.0), 1), [81.83; 3]);
    }

    #[test]
    fn glass_answers_as_often_as_its_angle_allows() {
        let mut room = room();
        room.add_glass([1.0, 0.0], [1.0, 3.0]);
        let caster = RayCaster::new(&room);
        let laser = LaserSettings { beams: 1, start_angle: 0.0, ..perfect() };
        let share = |heading: f64, on_glass: f64, behind: f64| {
            let mut rng = Seed::new(5).rng();
            let pose = Pose2::new(2.0, 1.5, heading);
            let readings: Vec<f64> =
                (0..4000).map(|_| laser.scan(&pose, &caster, &mut rng)[0]).collect();
            assert!(readings.iter().all(|&r| r == on_glass || r == behind), "{readings:?}");
            readings.iter().filter(|&&r| r == on_glass).count() as f64 / 4000.0
        };
        // Head on: 0.9. At 45°, cos⁴ = 1/4; √2 m to the pane, 1.5·√2 m to the wall beside it.
        // Four standard errors over 4000 draws.
        let pi = std::f64::consts::PI;
        assert!((share(pi, 1.0, 2.0) - 0.9).abs() < 0.02);
        assert!((share(0.75 * pi, 1.41, 2.12) - 0.225).abs() < 0.027);
    }

    #[test]
    fn noise_and_losses_have_the_stated_rates() {
        let room = room();
        let caster = RayCaster::new(&room);
        let mut rng = Seed::new(6).rng();
        let laser = LaserSettings {
            beams: 1,
            start_angle: FRAC_PI_2,
            range_noise: 0.02,
            resolution: 0.0,
            dropout_probability: 0.1,
            short_probability: 0.2,
            ..perfect()
        };
        let pose = Pose2::new(2.0, 1.0, 0.0);
        let readings: Vec<f64> =
            (0..20_000).map(|_| laser.scan(&pose, &caster, &mut rng)[0]).collect();
        let rate = |count: usize| count as f64 / readings.len() as f64;
        assert!((rate(readings.iter().filter(|&&r| r == 81.83).count()) - 0.1).abs() < 0.012);
        // Short readings are uniform over the 2 m: 95 % of them fall below 1.9 m.
        let short = rate(readings.iter().filter(|&&r| r < 1.9).count());
        assert!((short - 0.9 * 0.2 * 0.95).abs() < 0.012, "{short}");
        let near: Vec<f64> = readings.into_iter().filter(|r| (1.9..3.0).contains(r)).collect();
        let deviation =
            (near.iter().map(|r| (r - 2.0).powi(2)).sum::<f64>() / near.len() as f64).sqrt();
        assert!((deviation - 0.02).abs() < 2e-3, "{deviation}");
    }
}
