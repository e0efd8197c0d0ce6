//! Adaptive numbers of particles, skipped scans, global localization and recovery.

use std::f64::consts::PI;

use mcl_core::{LaserScan, PointMap, Pose2, Recording, ScanGeometry, Seed};
use mcl_filter::{
    FilterSettings, InitialPose, MapDistances, ParticleFilter, Recovery, Replay, Run, localize,
};

/// Walls of an office of 16 m by 8 m: two rooms that differ in size, and a corridor.
fn office() -> Vec<[f64; 2]> {
    let walls = [
        ([0.0, 0.0], [16.0, 0.0]),
        ([16.0, 0.0], [16.0, 8.0]),
        ([16.0, 8.0], [0.0, 8.0]),
        ([0.0, 8.0], [0.0, 0.0]),
        ([0.0, 3.0], [2.0, 3.0]),
        ([3.5, 3.0], [11.0, 3.0]),
        ([12.0, 3.0], [16.0, 3.0]),
        ([6.0, 3.0], [6.0, 8.0]),
        ([9.0, 6.0], [10.0, 6.5]),
    ];
    let points = |(from, to): ([f64; 2], [f64; 2])| {
        (0..=80).map(move |i| [0, 1].map(|k| from[k] + (to[k] - from[k]) * f64::from(i) / 80.0))
    };
    walls.into_iter().flat_map(points).collect()
}

fn scan(points: &[[f64; 2]], pose: Pose2) -> LaserScan {
    let angle_step = 2f64.to_radians();
    let ranges = (0..180).map(|beam| {
        let direction = pose.theta - PI + f64::from(beam) * angle_step;
        let seen = points.iter().filter_map(|p| {
            let (dx, dy) = (p[0] - pose.x, p[1] - pose.y);
            let off = mcl_core::wrap_angle(dy.atan2(dx) - direction).abs();
            (off < angle_step).then(|| dx.hypot(dy))
        });
        seen.fold(f64::INFINITY, f64::min)
    });
    LaserScan {
        stamp: None,
        geometry: ScanGeometry { start_angle: -PI, angle_step, beams: 180 },
        ranges: ranges.collect(),
        map_from_laser: Some(pose),
        odometry: None,
        sweep: Default::default(),
    }
}

/// A path along the corridor, in steps of 0.2 m.
fn path(from: f64, steps: usize) -> impl Iterator<Item = Pose2> {
    (0..steps).map(move |step| Pose2::new(from + 0.2 * step as f64, 1.5, 0.05))
}

fn run(poses: &[Pose2], settings: FilterSettings, start: Option<Pose2>, seed: u64) -> Run {
    let points = office();
    let scans: Vec<LaserScan> = poses.iter().map(|&pose| scan(&points, pose)).collect();
    let step = |two: &[Pose2]| match two[0].distance(&two[1]) < 1.0 {
        true => two[0].between(&two[1]),
        false => Pose2::IDENTITY,
    };
    let increments: Vec<Option<Pose2>> =
        [None].into_iter().chain(poses.windows(2).map(|two| Some(step(two)))).collect();
    let recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
    let all: Vec<usize> = (0..poses.len()).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &all };
    let map = PointMap::new(points).unwrap();
    let settings = settings.check().unwrap();
    let distances = MapDistances::grid(&map, settings.values().max_distance).unwrap();
    localize(&replay, &distances, &settings, start, Seed::new(seed)).unwrap()
}

/// Fault: with 2,000 uniform particles and one untempered scan, global localization selected a wrong pose.
#[test]
fn a_robot_is_found_that_starts_anywhere() {
    let poses: Vec<Pose2> = path(2.0, 40).collect();
    for seed in 0..5 {
        let settings = FilterSettings {
            particles: "100..2000".parse().unwrap(),
            initial_pose: InitialPose::scan(),
            ..FilterSettings::default()
        };
        let found = run(&poses, settings, None, seed);
        for (estimate, pose) in found.map_from_laser.iter().zip(&poses).skip(20) {
            assert!(estimate.distance(pose) < 0.3, "seed {seed}: {estimate:?} for {pose:?}");
        }
        let [first, last] = [&found.reports[0], &found.reports[39]];
        // 8 of 180 beams; later all are used.
        assert!((first.likelihood_exponent - 8.0 / first.used_beams as f64).abs() < 1e-12);
        assert_eq!(last.likelihood_exponent, 1.0);
        assert_eq!(first.particles, 2000);
        assert!(last.particles < 500, "{}", last.particles);
    }
}

/// Fault: a kidnapped robot stayed lost.
#[test]
fn a_kidnapped_robot_is_found_again() {
    let carried: Vec<Pose2> = path(1.0, 20).chain(path(9.0, 30)).collect();
    let recovering = |recover| FilterSettings { recover, ..FilterSettings::default() };
    let last = |settings, seed| {
        let found = run(&carried, settings, Some(carried[0]), seed);
        found.map_from_laser[49].distance(&carried[49])
    };
    for seed in 0..5 {
        let error = last(recovering(Some(Recovery::default())), seed);
        assert!(error < 0.3, "seed {seed}: {error}");
    }
    let lost = (0..5).filter(|&seed| last(recovering(None), seed) > 1.0).count();
    assert!(lost > 0, "the robot is found without recovery: this tests nothing");
}

/// As long as the likelihood of scans does not fall, recovery does nothing.
#[test]
fn recovery_leaves_a_tracked_robot_alone() {
    let poses: Vec<Pose2> = path(1.0, 40).collect();
    let with = FilterSettings { recover: Some(Recovery::default()), ..FilterSettings::default() };
    let without = FilterSettings::default();
    assert_eq!(run(&poses, with, Some(poses[0]), 1), run(&poses, without, Some(poses[0]), 1));
}

/// Scans 0.2 m apart, used every 0.5 m: the third, the sixth, … and the estimates between follow the odometry.
#[test]
fn scans_are_used_after_some_motion() {
    let poses: Vec<Pose2> = path(1.0, 13).collect();
    let settings =
        FilterSettings { update_distance: 0.5, update_angle: 0.5, ..FilterSettings::default() };
    let found = run(&poses, settings, Some(poses[0]), 1);
    for (step, report) in found.reports.iter().enumerate() {
        assert_eq!(report.used_beams > 0, step % 3 == 0, "{step}");
        assert!(found.map_from_laser[step].distance(&poses[step]) < 0.2, "{step}");
    }
    // A prediction is less certain than the estimate it starts from.
    let spread = |step: usize| found.reports[step].estimate.covariance.trace();
    assert!(spread(4) > spread(3) && spread(7) > spread(6));
}

/// Turning alone is motion too, and a robot that stands still is predicted to stand still.
#[test]
fn a_turn_makes_the_next_scan_count() {
    let points = office();
    let map = PointMap::new(points.clone()).unwrap();
    let settings =
        FilterSettings { update_distance: 0.5, update_angle: 0.2, ..FilterSettings::default() };
    let settings = settings.check().unwrap();
    let distances = MapDistances::grid(&map, settings.values().max_distance).unwrap();
    let start = Pose2::new(2.0, 1.5, 0.0);
    let mut filter =
        ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, Some(start), Seed::new(1))
            .unwrap();
    let still = scan(&points, start);
    assert!(filter.update(&still).unwrap().used_beams > 0);
    assert_eq!(filter.step(&Pose2::IDENTITY, &still).unwrap().used_beams, 0);
    let turned = |theta: f64| scan(&points, Pose2 { theta, ..start });
    let turn = Pose2::new(0.0, 0.0, 0.15);
    assert_eq!(filter.step(&turn, &turned(0.15)).unwrap().used_beams, 0);
    let report = filter.step(&turn, &turned(0.3)).unwrap();
    assert!(report.used_beams > 0);
    assert!((report.estimate.map_from_robot.theta - 0.3).abs() < 0.05);
}
