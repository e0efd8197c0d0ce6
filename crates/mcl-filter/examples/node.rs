//! A node that feeds the filter scan by scan, as it would run on a robot: odometry and scans come through a channel, and a
//! pose goes out for each scan.

use std::f64::consts::TAU;
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use mcl_core::{LaserScan, PointMap, Pose2, ScanGeometry, Seed};
use mcl_filter::{FilterError, FilterSettings, InitialPose, MapDistances, ParticleFilter};

/// Edges of the room in which the robot drives (m).
const ROOM: [f64; 2] = [6.0, 4.0];

/// What the driver of the robot sends: the motion since the last scan, by the odometry, and a scan.
struct Measured {
    motion: Pose2,
    scan: LaserScan,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (sender, receiver) = channel();
    let start = Pose2::new(2.0, 2.0, 0.0);
    // In place of a robot: it drives forward and turns, and its odometry measures 5 % too much.
    let driver = thread::spawn(move || {
        let (step, mut pose) = (Pose2::new(0.1, 0.0, 0.1), start);
        for _ in 0..60 {
            pose = pose.compose(&step);
            let motion = Pose2::new(1.05 * step.x, step.y, 1.05 * step.theta);
            if sender.send(Measured { motion, scan: scan_from(pose) }).is_err() {
                break;
            }
        }
        pose
    });
    let estimate = node(&receiver, start)?;
    let truth = driver.join().map_err(|_| "the driver ended early")?;
    println!(
        "robot at ({:.2}, {:.2}), estimated ({:.2}, {:.2})",
        truth.x, truth.y, estimate.x, estimate.y
    );
    if truth.distance(&estimate) > 0.2 {
        return Err("the robot was lost".into());
    }
    Ok(())
}

/// Localizes until the driver ends, and returns the last pose.
fn node(measured: &Receiver<Measured>, start: Pose2) -> Result<Pose2, FilterError> {
    let settings = FilterSettings {
        particles: 500.into(),
        initial_pose: InitialPose::Known { std_x: 0.1, std_y: 0.1, std_theta: 0.05 },
        ..FilterSettings::default()
    };
    let settings = settings.check()?;
    let distances = MapDistances::grid(&walls()?, settings.values().max_distance)?;
    let robot_from_laser = Pose2::IDENTITY;
    let mut filter =
        ParticleFilter::new(&settings, &distances, robot_from_laser, Some(start), Seed::new(1))?;
    let mut pose = start;
    for Measured { motion, scan } in measured {
        let report = filter.step(&motion, &scan)?;
        pose = report.estimate.map_from_robot;
    }
    Ok(pose)
}

/// The map: a point every 5 cm of the walls.
fn walls() -> Result<PointMap<2>, mcl_core::CoreError> {
    let along = |length: f64| (0..=(length / 0.05) as u32).map(|i| 0.05 * f64::from(i));
    let [width, height] = ROOM;
    let horizontal = along(width).flat_map(|x| [[x, 0.0], [x, height]]);
    let vertical = along(height).flat_map(|y| [[0.0, y], [width, y]]);
    PointMap::new(horizontal.chain(vertical).collect())
}

/// What a laser with 36 beams all around measures in the room.
fn scan_from(pose: Pose2) -> LaserScan {
    let geometry = ScanGeometry { start_angle: 0.0, angle_step: TAU / 36.0, beams: 36 };
    let range = |beam: u32| {
        let angle = pose.theta + f64::from(beam) * geometry.angle_step;
        let (sine, cosine) = angle.sin_cos();
        let to = |place: f64, length: f64, direction: f64| match direction {
            d if d > 1e-9 => (length - place) / d,
            d if d < -1e-9 => -place / d,
            _ => f64::INFINITY,
        };
        to(pose.x, ROOM[0], cosine).min(to(pose.y, ROOM[1], sine))
    };
    LaserScan {
        stamp: None,
        geometry,
        ranges: (0..36).map(range).collect(),
        map_from_laser: None,
        odometry: None,
        sweep: Default::default(),
    }
}
