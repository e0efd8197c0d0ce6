//! Walls of a square office of rooms with doors between them, and what a scanner reads there.
//! Shared by benches of several crates.

use mcl_core::{LaserScan, Point, Pose2, Rng, ScanGeometry};
use rand::RngExt;

/// Distance between walls (m) and half the width of the gaps in them.
const ROOM: f64 = 5.0;
const DOOR: f64 = 0.5;
const BEAMS: usize = 171;

/// An office with a corner at the origin.
#[derive(Clone, Copy)]
pub struct Office {
    /// Rooms along each side.
    pub rooms: u8,
}

impl Office {
    /// Length of a side in metres.
    pub fn side(self) -> f64 {
        ROOM * f64::from(self.rooms)
    }

    fn is_outer(self, wall: f64) -> bool {
        wall == 0.0 || wall == self.side()
    }

    /// A point on a wall, with a centimetre or two of noise.
    pub fn wall_point(self, rng: &mut Rng) -> Point<2> {
        loop {
            let along = self.side() * rng.random::<f64>();
            let wall = ROOM * f64::from(rng.random_range(0..=self.rooms));
            if !self.is_outer(wall) && (along % ROOM - 0.5 * ROOM).abs() < DOOR {
                continue;
            }
            let noise = 0.02 * (0..4).map(|_| rng.random::<f64>() - 0.5).sum::<f64>();
            let across = wall + noise;
            return if rng.random() { [along, across] } else { [across, along] };
        }
    }

    /// What a scanner in the middle of a room reads: ray by ray the nearest wall that has no door
    /// there.
    pub fn scan(self, map_from_laser: &Pose2) -> LaserScan {
        let geometry = ScanGeometry {
            start_angle: -std::f64::consts::FRAC_PI_2,
            angle_step: 1f64.to_radians(),
            beams: BEAMS,
        };
        let ranges = (0..BEAMS).map(|beam| {
            let (sin, cos) = (map_from_laser.theta + geometry.angle(beam)).sin_cos();
            let reading = |wall: f64, from: f64, step: f64, other: f64, other_step: f64| {
                let range = (wall - from) / step;
                let along = other + range * other_step;
                let is_door =
                    !self.is_outer(wall) && (along.rem_euclid(ROOM) - 0.5 * ROOM).abs() < DOOR;
                if range > 0.0 && !is_door { range } else { f64::INFINITY }
            };
            (0..=self.rooms)
                .flat_map(|i| {
                    let wall = ROOM * f64::from(i);
                    [
                        reading(wall, map_from_laser.x, cos, map_from_laser.y, sin),
                        reading(wall, map_from_laser.y, sin, map_from_laser.x, cos),
                    ]
                })
                .fold(f64::INFINITY, f64::min)
        });
        LaserScan {
            stamp: None,
            geometry,
            ranges: ranges.collect(),
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        }
    }
}
