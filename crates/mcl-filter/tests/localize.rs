//! Runs of the filter over a recording of a simulated room, whose ground truth is exact.

use std::f64::consts::{FRAC_PI_2, PI};

use mcl_core::{LaserScan, PointMap, Pose2, Recording, ScanGeometry, Seed, wrap_angle};
use mcl_filter::{
    Bridge, CheckedSettings, FilterError, FilterSettings, InitialPose, MapDistances, MotionKind,
    OdometryNoise, ParticleFilter, Proposal, Replay, Run, SigmaHit, localize, localize_with,
    noisy_increments,
};

/// Corners of the room (m): no symmetry turns it into itself.
const CORNERS: [[f64; 2]; 8] = [
    [0.0, 0.0],
    [7.0, 0.0],
    [7.0, 2.0],
    [5.5, 2.0],
    [5.5, 3.5],
    [3.0, 3.5],
    [3.0, 5.0],
    [0.0, 5.0],
];

fn walls() -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
    (0..CORNERS.len()).map(|i| (CORNERS[i], CORNERS[(i + 1) % CORNERS.len()]))
}

/// A point every 5 cm of wall.
fn map() -> PointMap<2> {
    let points = walls().flat_map(|(a, b)| {
        let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / 0.05).round();
        (0..steps as usize).map(move |i| {
            let part = i as f64 / steps;
            [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
        })
    });
    PointMap::new(points.collect()).unwrap()
}

/// Distance to the nearest wall in a direction, by intersection with every wall.
fn range(from: Pose2, angle: f64) -> f64 {
    let (sin, cos) = (from.theta + angle).sin_cos();
    let hits = walls().filter_map(|(a, b)| {
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        let (ax, ay) = (a[0] - from.x, a[1] - from.y);
        let determinant = cos * ey - sin * ex;
        let (along, part) =
            ((ax * ey - ay * ex) / determinant, (ax * sin - ay * cos) / determinant);
        (along > 0.0 && (0.0..=1.0).contains(&part)).then_some(along)
    });
    hits.fold(f64::INFINITY, f64::min)
}

/// Forward on an arc, a turn in place, and backward again.
fn drive(robot_from_laser: Pose2) -> Recording {
    let mut increments = vec![Pose2::IDENTITY];
    increments.extend([Pose2::new(0.15, 0.0, 0.05); 14]);
    increments.extend([Pose2::new(0.0, 0.0, 0.3); 6]);
    increments.extend([Pose2::new(-0.12, 0.01, -0.02); 15]);
    let mut map_from_robot = Pose2::new(1.0, 1.0, 0.2);
    let mut before = None;
    let mut scans = Vec::new();
    for increment in increments {
        map_from_robot = map_from_robot.compose(&increment);
        let map_from_laser = map_from_robot.compose(&robot_from_laser);
        let geometry = ScanGeometry { start_angle: -PI, angle_step: PI / 18.0, beams: 36 };
        scans.push(LaserScan {
            stamp: None,
            geometry,
            ranges: (0..36).map(|i| range(map_from_laser, geometry.angle(i))).collect(),
            map_from_laser: Some(map_from_laser),
            odometry: before.map(|before: Pose2| before.between(&map_from_laser)),
            sweep: Default::default(),
        });
        before = Some(map_from_laser);
    }
    Recording { scans, robot_from_laser }
}

fn odometry(recording: &Recording) -> Vec<Option<Pose2>> {
    recording.scans.iter().map(|scan| scan.odometry).collect()
}

fn settings() -> FilterSettings {
    FilterSettings {
        motion: MotionKind::Book,
        sigma_hit: SigmaHit::Metres(0.1),
        ..FilterSettings::default()
    }
}

fn checked() -> CheckedSettings {
    settings().check().unwrap()
}

fn run_all(recording: &Recording, distances: &MapDistances, seed: u64) -> Run {
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let increments = odometry(recording);
    let replay = Replay { recording, increments: &increments, scans: &scans };
    let start = recording.scans[0].map_from_laser;
    localize(&replay, distances, &checked(), start, Seed::new(seed)).unwrap()
}

fn worst(run: &Run, recording: &Recording, scans: impl Iterator<Item = usize>) -> (f64, f64) {
    let errors = run.map_from_laser.iter().zip(scans).map(|(estimate, scan)| {
        let truth = recording.scans[scan].map_from_laser.unwrap();
        (estimate.distance(&truth), wrap_angle(estimate.theta - truth.theta).abs())
    });
    errors.fold((0.0, 0.0), |worst, error| (worst.0.max(error.0), worst.1.max(error.1)))
}

#[test]
fn tracks_the_robot_wherever_its_laser_is_mounted() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let mounts = [Pose2::IDENTITY, Pose2::new(0.2, 0.0, 0.0), Pose2::new(-0.1, 0.05, FRAC_PI_2)];
    for mount in mounts {
        let recording = drive(mount);
        let run = run_all(&recording, &distances, 1);
        // Without the first scans, in which the uncertainty of the start is still there.
        let late = Run { map_from_laser: run.map_from_laser[5..].to_vec(), reports: Vec::new() };
        let (position, heading) = worst(&late, &recording, 5..recording.scans.len());
        assert!(position < 0.06 && heading < 0.03, "{mount:?}: {position} m, {heading} rad");
        assert!(run.reports.iter().all(|report| report.used_beams == 36));
    }
}

/// Places within a cell are `f32` on the fast path: log-likelihoods differ in the seventh digit, and
/// so do trajectories, as long as no resampling falls between two particles.
#[test]
fn grid_and_reference_agree() {
    let recording = drive(Pose2::IDENTITY);
    let grid = run_all(&recording, &MapDistances::grid(&map(), 2.0).unwrap(), 2);
    let reference = run_all(&recording, &MapDistances::reference(&map(), 2.0).unwrap(), 2);
    assert_ne!(grid, reference, "the fast path was not taken");
    for (found, expected) in grid.map_from_laser.iter().zip(&reference.map_from_laser) {
        assert!(found.distance(expected) < 1e-6, "{found:?} for {expected:?}");
    }
    for (found, expected) in grid.reports.iter().zip(&reference.reports) {
        let off = (found.log_evidence - expected.log_evidence).abs();
        assert!(off < 1e-5, "{} for {}", found.log_evidence, expected.log_evidence);
        assert_eq!(found.resampled, expected.resampled);
    }
}

#[test]
fn observing_changes_nothing_and_shows_every_step() {
    let recording = drive(Pose2::new(0.2, 0.0, 0.1));
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let scans = [0, 3, 4, 9, 20];
    let increments = odometry(&recording);
    let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
    let start = recording.scans[0].map_from_laser;
    let run = localize(&replay, &distances, &checked(), start, Seed::new(3)).unwrap();
    let mut steps = Vec::new();
    let watched = localize_with(&replay, &distances, &checked(), start, Seed::new(3), |step| {
        let equal = -(step.particles.len() as f64).ln();
        assert_eq!(step.particles.len(), settings().particles.most);
        assert!(!step.report.resampled || step.particles.iter().all(|(_, l)| l == equal));
        steps.push((step.scan, *step.report));
        Ok::<(), FilterError>(())
    });
    assert_eq!(watched, Ok(run.clone()));
    assert_eq!(steps, scans.into_iter().zip(run.reports).collect::<Vec<_>>());
}

#[test]
fn an_observer_can_end_the_run() {
    #[derive(Debug, PartialEq)]
    enum Ended {
        Enough(usize),
        Failed(FilterError),
    }
    impl From<FilterError> for Ended {
        fn from(error: FilterError) -> Self {
            Ended::Failed(error)
        }
    }
    let recording = drive(Pose2::IDENTITY);
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let mut increments = odometry(&recording);
    let run = |increments: &[Option<Pose2>], last: usize| {
        let scans = [0, 1, 2, 3];
        let replay = Replay { recording: &recording, increments, scans: &scans };
        let start = recording.scans[0].map_from_laser;
        localize_with(&replay, &distances, &checked(), start, Seed::new(1), |step| {
            if step.scan == last { Err(Ended::Enough(last)) } else { Ok(()) }
        })
    };
    assert_eq!(run(&increments, 2), Err(Ended::Enough(2)));
    increments[1] = None;
    let missing = FilterError::MissingOdometry { scan: 1, unknown: 1, steps: 3 };
    assert_eq!(run(&increments, 2), Err(Ended::Failed(missing)));
}

#[test]
fn the_seed_decides_the_run() {
    let recording = drive(Pose2::IDENTITY);
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let run = run_all(&recording, &distances, 3);
    assert_eq!(run, run_all(&recording, &distances, 3));
    assert_ne!(run, run_all(&recording, &distances, 4));
    // Also from another thread, while others run.
    let from_threads: Vec<Run> = std::thread::scope(|scope| {
        let handles: Vec<_> =
            (0..3).map(|_| scope.spawn(|| run_all(&recording, &distances, 3))).collect();
        handles.into_iter().map(|handle| handle.join().unwrap()).collect()
    });
    assert!(from_threads.iter().all(|other| *other == run));
}

#[test]
fn left_out_scans_are_bridged_by_their_increments() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let increments = odometry(&recording);
    let scans: Vec<usize> = (2..recording.scans.len()).step_by(3).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
    let start = recording.scans[2].map_from_laser;
    let run = localize(&replay, &distances, &checked(), start, Seed::new(1)).unwrap();
    assert_eq!(run.map_from_laser.len(), scans.len());
    let (position, heading) = worst(&run, &recording, scans.iter().copied());
    assert!(position < 0.15 && heading < 0.06, "{position} m, {heading} rad");

    // With neither noise nor usable beams, the estimate is the composition of the increments.
    let still = InitialPose::Known { std_x: 0.0, std_y: 0.0, std_theta: 0.0 };
    let blind =
        FilterSettings { alpha: [0.0; 4], initial_pose: still, max_range: 1e-6, ..settings() };
    let run = localize(&replay, &distances, &blind.check().unwrap(), start, Seed::new(1)).unwrap();
    let (position, heading) = worst(&run, &recording, scans.iter().copied());
    assert!(position < 1e-12 && heading < 1e-12, "{position} m, {heading} rad");
    for report in &run.reports {
        assert_eq!((report.used_beams, report.log_evidence, report.resampled), (0, 0.0, false));
        assert!((report.effective_sample_size - 500.0).abs() < 1e-9);
    }
}

#[test]
fn a_lost_robot_finds_itself() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let increments = odometry(&recording);
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
    let lost = FilterSettings {
        particles: 5_000.into(),
        initial_pose: InitialPose::Uniform {},
        sigma_hit: SigmaHit::Metres(0.2),
        ..settings()
    };
    let run = localize(&replay, &distances, &lost.check().unwrap(), None, Seed::new(1)).unwrap();
    let (last, truth) = (run.map_from_laser.last().unwrap(), recording.scans.last().unwrap());
    let off = last.distance(&truth.map_from_laser.unwrap());
    assert!(off < 0.1, "{off} m");
    // The covariance shows that the robot is no longer lost.
    let spread = run.reports.last().unwrap().estimate.covariance.trace().sqrt();
    assert!(spread < 0.2, "{spread}");
}

#[test]
fn a_scan_without_usable_beams_keeps_the_weights() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let settings = FilterSettings { ess_fraction: 0.0, ..settings() }.check().unwrap();
    let start = recording.scans[0].map_from_laser;
    let mut filter =
        ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, start, Seed::new(1)).unwrap();
    filter.update(&recording.scans[0]).unwrap();
    // The order of particles may change when they move.
    let sorted = |filter: &ParticleFilter| {
        let mut weights: Vec<f64> = filter.particles().iter().map(|(_, weight)| weight).collect();
        weights.sort_unstable_by(f64::total_cmp);
        weights
    };
    let before = sorted(&filter);
    let mut blind = recording.scans[1].clone();
    blind.ranges.fill(f64::INFINITY);
    let report = filter.step(&Pose2::new(0.1, 0.0, 0.0), &blind).unwrap();
    assert_eq!((report.used_beams, report.log_evidence), (0, 0.0));
    for (after, before) in sorted(&filter).iter().zip(before) {
        assert!((after - before).abs() < 1e-12);
    }
}

#[test]
fn what_is_missing_is_named() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let start = recording.scans[0].map_from_laser;
    let attempt = |increments: &[Option<Pose2>], scans: &[usize], start: Option<Pose2>| {
        let replay = Replay { recording: &recording, increments, scans };
        localize(&replay, &distances, &checked(), start, Seed::new(1)).err()
    };
    let good = odometry(&recording);
    assert_eq!(attempt(&good, &[0, 1, 5], start), None);
    assert_eq!(attempt(&good, &[], start), None);
    assert_eq!(attempt(&good, &[0, 1], None), Some(FilterError::NoInitialPose));
    let mut holes = good.clone();
    holes[3] = None;
    assert_eq!(
        attempt(&holes, &[2, 3, 5], start),
        Some(FilterError::MissingOdometry { scan: 3, unknown: 1, steps: 3 })
    );
    // The motion to the first used scan need not be known.
    assert_eq!(attempt(&holes, &[3, 4], start), None);
    holes[3] = Some(Pose2::new(f64::NAN, 0.0, 0.0));
    assert!(matches!(
        attempt(&holes, &[0, 5], start),
        Some(FilterError::NonFiniteOdometry { scan: 3, .. })
    ));
    assert_eq!(
        attempt(&good[1..], &[0], start),
        Some(FilterError::IncrementCount { increments: 35, scans: 36 })
    );
    for (scans, entry) in [([0, 36], 1), ([2, 2], 1), ([36, 37], 0)] {
        match attempt(&good, &scans, start) {
            Some(FilterError::ScanList { entry: found, .. }) => assert_eq!(found, entry),
            other => panic!("{scans:?}: {other:?}"),
        }
    }
}

/// As in the Seattle log, where the robot turned by 81° on a step without odometry: treated as no motion, the robot was
/// lost.
#[test]
fn a_turn_that_the_odometry_does_not_know_is_bridged() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    for proposal in [Proposal::Motion, Proposal::Adaptive] {
        let recording = drive(Pose2::new(0.2, 0.0, 0.1));
        let mut increments = odometry(&recording);
        // The turn in place, by 103°.
        let scans: Vec<usize> = (0..=14).chain(20..36).collect();
        increments[15..=20].fill(None);
        let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
        let bridge = Bridge::over(&replay).unwrap();
        assert_eq!((bridge.scans, bridge.steps), ((15..=20).collect(), 35));
        let settings = FilterSettings { proposal, ..settings() }.check().unwrap();
        let start = recording.scans[0].map_from_laser;
        let mut lost = 0;
        for seed in 1..=20 {
            let run = localize(&replay, &distances, &settings, start, Seed::new(seed)).unwrap();
            let late = Run { map_from_laser: run.map_from_laser[25..].to_vec(), reports: vec![] };
            let (position, heading) = worst(&late, &recording, scans[25..].iter().copied());
            lost += usize::from(position > 0.1 || heading > 0.05);
        }
        assert_eq!(lost, 0, "{proposal}");
        // As if the robot had stood still.
        increments[15..=20].fill(Some(Pose2::IDENTITY));
        let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
        let run = localize(&replay, &distances, &settings, start, Seed::new(1)).unwrap();
        let end = run.map_from_laser.last().unwrap();
        assert!(end.distance(&recording.scans[35].map_from_laser.unwrap()) > 0.5, "{end:?}");
    }
}

/// Fault: while a robot had not been found yet and few particles were left, a step without odometry started a new
/// search with more particles than the buffers had room for, and the program panicked.
#[test]
fn a_robot_that_is_looked_for_may_lose_its_odometry() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let mut increments = odometry(&recording);
    increments[4] = None;
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
    let settings = FilterSettings {
        particles: "100..2000".parse().unwrap(),
        proposal: Proposal::Adaptive,
        // So close that the search continues.
        initial_pose: InitialPose::Scan { beams: 5.0, agreement: 1e-9 },
        ..settings()
    };
    let run =
        localize(&replay, &distances, &settings.check().unwrap(), None, Seed::new(1)).unwrap();
    let particles: Vec<usize> = run.reports.iter().map(|report| report.particles).collect();
    assert!(particles[3] < 2000, "{particles:?}");
    assert_eq!(particles[4], 2000);
    let (last, truth) = (run.map_from_laser.last().unwrap(), recording.scans.last().unwrap());
    assert!(last.distance(&truth.map_from_laser.unwrap()) < 0.2);
}

#[test]
fn particles_that_leave_the_plane_are_an_error() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let settings = FilterSettings { alpha: [f64::MAX; 4], ..settings() }.check().unwrap();
    let start = Some(Pose2::IDENTITY);
    let mut filter =
        ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, start, Seed::new(1)).unwrap();
    let error = filter.predict(&Pose2::new(1e160, 0.0, 0.0));
    assert!(matches!(error, Err(FilterError::NonFiniteParticle { .. })), "{error:?}");
    let error = filter.predict(&Pose2::new(f64::INFINITY, 0.0, 0.0));
    assert!(matches!(error, Err(FilterError::NonFiniteOdometry { .. })), "{error:?}");
}

#[test]
fn noise_makes_runs_differ_but_not_lose_the_robot() {
    let distances = MapDistances::grid(&map(), 2.0).unwrap();
    let recording = drive(Pose2::IDENTITY);
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let start = recording.scans[0].map_from_laser;
    let run = |seed: u64| {
        let noise = OdometryNoise { xy: 0.02, theta: 0.01 };
        let increments = noisy_increments(&odometry(&recording), noise, Seed::new(seed)).unwrap();
        let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
        localize(&replay, &distances, &checked(), start, Seed::new(9)).unwrap()
    };
    assert_ne!(run(1), run(2));
    let (position, heading) = worst(&run(1), &recording, scans.iter().copied());
    assert!(position < 0.2 && heading < 0.1, "{position} m, {heading} rad");
}
