use mcl_core::{LaserScan, Point, Pose2, Recording, Seed, Stamp, wrap_angle};

use super::floor_plan::{OPEN_AREAS, ROOMS, inside_walls, structure};
use super::furniture::furnish;
use super::laser::decimal;
use super::obstacles::Obstacles;
use super::path::Path;
use super::ray::RayCaster;
use super::route::route;
use super::settings::{OfficeSettings, SimulationError};

/// A furnished building and the robot's path through it.
#[derive(Debug, Clone)]
pub struct Office {
    settings: OfficeSettings,
    seed: Seed,
    obstacles: Obstacles,
    path: Path,
}

impl Office {
    /// Plans the drive, then furnishes the rooms around it.
    ///
    /// # Errors
    /// [`SimulationError::Setting`] names a setting that is out of range.
    pub fn new(settings: &OfficeSettings, seed: Seed) -> Result<Self, SimulationError> {
        settings.validate()?;
        let seed = seed.derive("simulated office");
        let (start, legs) = route(&mut seed.derive("route").rng());
        let path = Path::new(start, &legs, &settings.drive);
        let positions = path.positions(0.1);
        let mut obstacles = structure();
        let floors = ROOMS
            .iter()
            .map(|room| room.floor())
            .chain(OPEN_AREAS.iter().map(|&[min, max]| inside_walls(min, max)));
        for (index, floor) in floors.enumerate() {
            let mut rng = seed.derive("furniture").derive_index(index as u64).rng();
            let density = settings.furniture_density;
            let furniture = furnish(&floor, density, &positions, &obstacles, &mut rng);
            obstacles.add(furniture);
        }
        Ok(Office { settings: settings.clone(), seed, obstacles, path })
    }

    /// Every surface at the height of the laser, in the map's frame.
    pub fn obstacles(&self) -> &Obstacles {
        &self.obstacles
    }

    /// Positions along the robot's path in the map's frame, at most 2 cm apart.
    pub fn path(&self) -> Vec<Point<2>> {
        self.path.positions(0.02)
    }

    /// Drives through the office and records scans, exact reference poses of the laser, and
    /// odometry. The laser sits above the robot's turning centre, so laser and robot share a frame.
    pub fn record(&self) -> Recording {
        let caster = RayCaster::new(&self.obstacles);
        let mut scans: Vec<LaserScan> = Vec::new();
        let mut last: Option<Pose2> = None;
        for (stamp, map_from_laser) in self.logged_poses() {
            let index = scans.len() as u64;
            let mut laser_rng = self.seed.derive("laser").derive_index(index).rng();
            let mut odometry_rng = self.seed.derive("odometry").derive_index(index).rng();
            let odometry = last.map(|last| {
                let increment = last.between(&map_from_laser);
                rounded(&self.settings.odometry.measure(&increment, &mut odometry_rng))
            });
            scans.push(LaserScan {
                stamp: Some(stamp),
                geometry: self.settings.laser.geometry(),
                ranges: self.settings.laser.scan(&map_from_laser, &caster, &mut laser_rng),
                map_from_laser: Some(map_from_laser),
                odometry,
            });
            last = Some(map_from_laser);
        }
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    /// Stamps and poses of the sweeps that are logged: the first, and each that is far enough from
    /// the one logged before.
    fn logged_poses(&self) -> Vec<(Stamp, Pose2)> {
        let drive = &self.settings.drive;
        let milliseconds = |seconds: f64| (seconds * 1000.0).round() as i64;
        let start = milliseconds(drive.start_time);
        let period = milliseconds(drive.scan_period).max(1);
        let end = milliseconds(self.path.duration());
        let mut logged: Vec<(Stamp, Pose2)> = Vec::new();
        for time in (0..=end).step_by(period as usize) {
            let Some(pose) = self.path.pose(time as f64 / 1000.0) else { break };
            let pose = rounded(&pose);
            let far_enough = logged.last().is_none_or(|(_, last)| {
                last.distance(&pose) >= drive.scan_distance
                    || wrap_angle(pose.theta - last.theta).abs() >= drive.scan_angle
            });
            if far_enough {
                logged.push((Stamp::from_nanoseconds((start + time) * 1_000_000), pose));
            }
        }
        logged
    }
}

/// The pose in whole micrometres and microradians.
fn rounded(pose: &Pose2) -> Pose2 {
    Pose2::new(decimal(pose.x), decimal(pose.y), decimal(wrap_angle(pose.theta)))
}
