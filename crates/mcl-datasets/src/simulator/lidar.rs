//! The office in three dimensions, as seen by a spinning lidar of several beams.
//!
//! Every surface of the floor plan is upright: walls, doors and pillars from the floor to the ceiling,
//! furniture up to its own height. The lidar is mounted lower than all furniture, so that no beam looks over
//! a piece and down behind it, and no piece needs a top.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use mcl_core::{Point, Pose2, Rng, Seed, StandardNormal, math};
use rand::RngExt;
use rand_distr::Distribution;

use super::floor_plan::structure;
use super::laser::decimal;
use super::obstacles::Material;
use super::office::Office;
use super::ray::RayCaster;
use super::settings::{LaserSettings, OfficeSettings, SimulationError};

/// Heights of furniture (m): tables, counters, cupboards, shelves.
const FURNITURE: [f64; 4] = [0.75, 1.1, 1.6, 2.0];

/// The lidar, and how often it scans; the default is the data set `simulated-office-3d`.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarSettings {
    /// Number of beams, one above the other.
    pub beams: usize,
    /// Elevation of the lowest beam, in rad.
    pub lowest: f64,
    /// Elevation of the highest beam, in rad; the others lie between at equal angles.
    pub highest: f64,
    /// Number of directions (azimuths) in which each beam measures.
    pub columns: usize,
    /// Height of the lidar above the floor, in m, less than that of all furniture.
    pub height: f64,
    /// Height of the ceiling above the floor, in m.
    pub ceiling: f64,
    /// Longest range it measures, in m.
    pub max_range: f64,
    /// Standard deviation of the Gaussian range noise, in m.
    pub range_noise: f64,
    /// A sweep is taken at this distance driven since the last one, in m.
    pub scan_distance: f64,
}

impl Default for LidarSettings {
    /// A short-range lidar of 32 beams over 90°, on a low robot.
    fn default() -> Self {
        LidarSettings {
            beams: 32,
            lowest: -FRAC_PI_4,
            highest: FRAC_PI_4,
            columns: 90,
            height: 0.5,
            ceiling: 2.6,
            max_range: 20.0,
            range_noise: 0.02,
            scan_distance: 10.0,
        }
    }
}

/// Drives a lidar through the office: the points in the map's frame, z = 0 on the floor, sweep by sweep.
///
/// # Errors
/// [`SimulationError::Setting`] names a setting that is out of range.
pub fn simulate_cloud(
    office: &OfficeSettings,
    lidar: &LidarSettings,
    seed: Seed,
) -> Result<Vec<Point<3>>, SimulationError> {
    lidar.validate()?;
    let office = Office::new(office, seed)?;
    let scene = Scene::new(&office, lidar);
    let mut points = Vec::new();
    for (index, pose) in office.poses_every(lidar.scan_distance).iter().enumerate() {
        let mut rng = office.seed().derive("lidar").derive_index(index as u64).rng();
        scene.sweep(pose, &mut rng, &mut points);
    }
    Ok(points)
}

impl LidarSettings {
    /// Checks every setting against its range.
    ///
    /// # Errors
    /// [`SimulationError::Setting`] with the first one that is out of range.
    pub fn validate(&self) -> Result<(), SimulationError> {
        let within = |field, value: f64, low: f64, high: f64, expected| match (low..=high)
            .contains(&value)
        {
            true => Ok(()),
            false => Err(SimulationError::Setting { field, value, expected }),
        };
        within("lidar.beams", self.beams as f64, 1.0, 1000.0, "1 to 1000")?;
        within("lidar.columns", self.columns as f64, 1.0, 10_000.0, "1 to 10000")?;
        let upright = FRAC_PI_2 - 0.01;
        within("lidar.lowest", self.lowest, -upright, upright, "between −π/2 and π/2 rad")?;
        within(
            "lidar.highest",
            self.highest,
            self.lowest,
            upright,
            "from lidar.lowest to π/2 rad",
        )?;
        within(
            "lidar.height",
            self.height,
            0.01,
            FURNITURE[0],
            "0.01 to 0.75 m, beneath all furniture",
        )?;
        within(
            "lidar.ceiling",
            self.ceiling,
            FURNITURE[3],
            100.0,
            "2 to 100 m, above all furniture",
        )?;
        within("lidar.max_range", self.max_range, 0.1, 1000.0, "0.1 to 1000 m")?;
        within("lidar.range_noise", self.range_noise, 0.0, 10.0, "0 to 10 m")?;
        within("lidar.scan_distance", self.scan_distance, 0.01, 1000.0, "0.01 to 1000 m")
    }
}

/// The furnished building with the heights of its surfaces.
struct Scene<'a> {
    lidar: &'a LidarSettings,
    /// The reflection of glass.
    laser: &'a LaserSettings,
    caster: RayCaster<'a>,
    /// Height of each surface (m), in the order of the ray caster.
    heights: Vec<f64>,
}

impl<'a> Scene<'a> {
    fn new(office: &'a Office, lidar: &'a LidarSettings) -> Self {
        let (building, all) = (structure(), office.obstacles());
        let mut rng = office.seed().derive("heights").rng();
        let mut draw = || FURNITURE[rng.random_range(0..FURNITURE.len())];
        let walls = building.segments().len();
        let mut heights = vec![lidar.ceiling; walls];
        // The four sides of a box are consecutive.
        let mut box_height = 0.0;
        for side in 0..all.segments().len() - walls {
            if side % 4 == 0 {
                box_height = draw();
            }
            heights.push(box_height);
        }
        let pillars = building.circles().len();
        heights.extend(vec![lidar.ceiling; pillars]);
        heights.extend((pillars..all.circles().len()).map(|_| draw()));
        let laser = &office.settings().laser;
        Scene { lidar, laser, caster: RayCaster::new(all), heights }
    }

    /// One turn of the lidar.
    fn sweep(&self, pose: &Pose2, rng: &mut Rng, points: &mut Vec<Point<3>>) {
        let lidar = self.lidar;
        for column in 0..lidar.columns {
            let azimuth = pose.theta + TAU * column as f64 / lidar.columns as f64;
            for beam in 0..lidar.beams {
                let part = beam as f64 / (lidar.beams - 1).max(1) as f64;
                let elevation = lidar.lowest + part * (lidar.highest - lidar.lowest);
                let Some(range) = self.echo([pose.x, pose.y], azimuth, elevation, rng) else {
                    continue;
                };
                let range = range + lidar.range_noise * StandardNormal.sample(rng);
                if range > 0.0 && range <= lidar.max_range {
                    let across = range * math::cos(elevation);
                    points.push([
                        decimal(pose.x + across * math::cos(azimuth)),
                        decimal(pose.y + across * math::sin(azimuth)),
                        decimal(lidar.height + range * math::sin(elevation)),
                    ]);
                }
            }
        }
    }

    /// True distance along a beam to the surface that returns it, in m; `None` when the beam leaves the
    /// building.
    fn echo(&self, origin: Point<2>, azimuth: f64, elevation: f64, rng: &mut Rng) -> Option<f64> {
        let LidarSettings { height, ceiling, .. } = *self.lidar;
        let (slope, cos) = (math::tan(elevation), math::cos(elevation));
        // Distance over the ground at which the beam meets the floor or the ceiling.
        let level = match slope {
            slope if slope < 0.0 => height / -slope,
            slope if slope > 0.0 => (ceiling - height) / slope,
            _ => f64::INFINITY,
        };
        let mut beyond = 0.0;
        // Past the last surface lies the open: floor and ceiling end with the building.
        while let Some(hit) = self.caster.first_hit(origin, azimuth, beyond) {
            if hit.distance >= level {
                return Some(level / cos);
            }
            let stands = height + slope * hit.distance <= self.heights[hit.surface];
            let answer = match hit.material {
                Material::Opaque => 1.0,
                Material::Glass => {
                    let incidence = (hit.incidence_cos * cos).min(1.0);
                    self.laser.glass_return * math::powf(incidence, self.laser.glass_exponent)
                }
            };
            if stands && rng.random_bool(answer) {
                return Some(hit.distance / cos);
            }
            beyond = hit.distance;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Bounds;

    fn cloud(lidar: &LidarSettings, seed: u64) -> Vec<Point<3>> {
        simulate_cloud(&OfficeSettings::default(), lidar, Seed::new(seed)).unwrap()
    }

    /// Pinned: experiments on the data set are comparable only as long as these numbers do not change.
    #[test]
    fn the_default_cloud_is_pinned() {
        let points = cloud(&LidarSettings::default(), 1);
        let micro = |value: f64| (value * 1e6).round() as i64;
        let sum: i64 =
            points.iter().map(|[x, y, z]| micro(*x) + 3 * micro(*y) + 7 * micro(*z)).sum();
        assert_eq!((points.len(), sum), (146_528, 9_691_430_578_893));
        let thread = std::thread::spawn(|| cloud(&LidarSettings::default(), 1));
        assert_eq!(thread.join().unwrap(), points);
        assert_ne!(cloud(&LidarSettings::default(), 2)[..100], points[..100]);
    }

    #[test]
    fn without_noise_every_point_lies_on_floor_ceiling_or_a_surface() {
        let lidar = LidarSettings { range_noise: 0.0, ..LidarSettings::default() };
        let office = Office::new(&OfficeSettings::default(), Seed::new(1)).unwrap();
        let scene = Scene::new(&office, &lidar);
        let obstacles = office.obstacles();
        let (mut floor, mut ceiling, mut upright) = (0, 0, 0);
        for [x, y, z] in cloud(&lidar, 1).into_iter().step_by(7) {
            if z.abs() < 1e-5 {
                floor += 1;
            } else if (z - lidar.ceiling).abs() < 1e-5 {
                ceiling += 1;
            } else {
                upright += 1;
                let near = |distance: f64| distance < 1e-5;
                let segments = obstacles.segments().iter().map(|s| near(s.distance([x, y])));
                let circles = obstacles.circles().iter().map(|c| {
                    // The outline: inside of the disc, the distance is 0.
                    let from_center = (x - c.center[0]).hypot(y - c.center[1]);
                    near((from_center - c.radius).abs())
                });
                let tallest = segments
                    .chain(circles)
                    .zip(&scene.heights)
                    .filter_map(|(near, height)| near.then_some(*height))
                    .fold(f64::NEG_INFINITY, f64::max);
                assert!(z > 0.0 && z <= tallest + 1e-5, "({x}, {y}, {z}) under {tallest}");
            }
        }
        assert!(floor > 2000 && ceiling > 1000 && upright > 5000, "{floor} {ceiling} {upright}");
    }

    #[test]
    fn noise_moves_points_along_their_beams_by_its_deviation() {
        // A single horizontal beam per direction, so that the ranges depend on the floor plan only.
        let exact = LidarSettings {
            beams: 1,
            lowest: 0.0,
            highest: 0.0,
            range_noise: 0.0,
            ..LidarSettings::default()
        };
        let clear = OfficeSettings {
            // Glass returns beams at random, which would shift the random draws against each other.
            laser: LaserSettings {
                glass_return: 1.0,
                glass_exponent: 0.0,
                ..LaserSettings::default()
            },
            ..OfficeSettings::default()
        };
        let noisy = LidarSettings { range_noise: 0.02, ..exact.clone() };
        let [a, b] =
            [&exact, &noisy].map(|lidar| simulate_cloud(&clear, lidar, Seed::new(3)).unwrap());
        assert_eq!(a.len(), b.len());
        let squares = a.iter().zip(&b).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2));
        let deviation = (squares.sum::<f64>() / a.len() as f64).sqrt();
        // Four standard errors.
        let error = 4.0 * 0.02 / (2.0 * a.len() as f64).sqrt();
        assert!((deviation - 0.02).abs() < error, "{deviation} of {}", a.len());
        assert!(b.iter().all(|point| point[2] == exact.height));
    }

    #[test]
    fn the_cloud_fills_the_building() {
        let bounds = Bounds::of(&cloud(&LidarSettings::default(), 1)).unwrap();
        for (axis, extent) in [(0, 30.15), (1, 30.15), (2, 2.6)] {
            assert!((bounds.extent(axis) - extent).abs() < 0.25, "{bounds:?}");
        }
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let refused = |change: fn(&mut LidarSettings)| {
            let mut lidar = LidarSettings::default();
            change(&mut lidar);
            simulate_cloud(&OfficeSettings::default(), &lidar, Seed::new(1))
                .unwrap_err()
                .to_string()
        };
        assert!(refused(|l| l.beams = 0).contains("lidar.beams is 0"));
        assert!(refused(|l| l.height = 1.0).contains("beneath all furniture"));
        assert!(refused(|l| l.highest = -1.0).contains("lidar.highest"));
        assert!(refused(|l| l.range_noise = f64::NAN).contains("lidar.range_noise is NaN"));
    }
}
