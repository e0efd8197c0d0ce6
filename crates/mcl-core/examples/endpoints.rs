//! A scan of three beams, and where its readings end in the map.

use std::f64::consts::{FRAC_PI_2, PI};

use mcl_core::{LaserScan, NearestNeighbors, PointMap, Pose2, Recording, ScanGeometry, Stamp};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scan = LaserScan {
        stamp: Some(Stamp::parse_seconds("12.5")?),
        geometry: ScanGeometry { start_angle: -FRAC_PI_2, angle_step: FRAC_PI_2, beams: 3 },
        // To the right, ahead, and nothing within range to the left.
        ranges: vec![1.0, 2.5, f64::INFINITY],
        map_from_laser: Some(Pose2::new(10.0, 5.0, PI)),
        odometry: None,
        sweep: Default::default(),
    };
    let log = Recording { scans: vec![scan], robot_from_laser: Pose2::IDENTITY };

    let points = log.points(10.0)?;
    for [x, y] in &points {
        println!("({x:.2}, {y:.2})");
    }
    let map = PointMap::new(points)?;
    let nearest = NearestNeighbors::new(map.points())?.nearest(&[7.0, 5.0]);
    println!("{:.2} m from (7, 5) to the map", nearest.distance_squared.sqrt());
    Ok(())
}
