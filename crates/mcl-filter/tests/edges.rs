//! Numbers at the limits of floating point give an error or finite results.

use mcl_core::{LaserScan, PointMap, Pose2, Recording, ScanGeometry, Seed};
use mcl_filter::sensor::DistanceField;
use mcl_filter::{
    FilterError, FilterSettings, InitialPose, MapDistances, ParticleFilter, Preset, Proposal,
    Recovery, Replay, Resampling, Run, SigmaHit, localize,
};
use proptest::prelude::*;

fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0f64,
        1 => Just(0.0),
        1 => -1e-310..1e-310f64,
        1 => 1e8..1e8 + 10.0,
        1 => prop::sample::select(vec![1e12, -1e12, f64::MAX]),
    ]
}

fn map() -> impl Strategy<Value = PointMap<2>> {
    let any = prop::collection::vec((coordinate(), coordinate()), 1..60);
    let room = (0..60usize, prop::sample::select(vec![0.0, 1e6, 1e8])).prop_map(|(n, middle)| {
        (0..=n)
            .map(|i| (middle + (i as f64 * 0.3).cos() * 5.0, (i as f64 * 0.3).sin() * 3.0))
            .collect()
    });
    let equal = (coordinate(), coordinate(), 1..60usize).prop_map(|(x, y, n)| vec![(x, y); n]);
    // Coordinates beyond 1e12 m are refused.
    prop_oneof![any, room, equal].prop_filter_map("no map", |points: Vec<(f64, f64)>| {
        PointMap::new(points.into_iter().map(|(x, y)| [x, y]).collect()).ok()
    })
}

fn length() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => prop::sample::select(vec![1e-9, 0.01, 0.3, 2.0, 1e9]),
        1 => prop::sample::select(vec![0.0, -1.0, 5e-324, 1e-200, 1e200, f64::NAN, f64::INFINITY]),
    ]
}

fn settings() -> impl Strategy<Value = FilterSettings> {
    (
        prop::sample::select(vec![0, 1, 2, 3, 17, 300]),
        length(),
        prop::sample::select(vec![0.0, 5e-324, 1e-30, 0.5, 1.0, -0.1, 1.1, f64::NAN]),
        length(),
        length(),
        prop::sample::select(vec![0.0, 0.05, 1e9, 1e300, -1.0, f64::NAN]),
        prop::sample::select(vec![
            InitialPose::Uniform {},
            InitialPose::Known { std_x: 0.1, std_y: 0.0, std_theta: 1e3 },
        ]),
        prop::sample::select(Proposal::ALL.to_vec()),
        prop::sample::select(Resampling::ALL.to_vec()),
        prop::sample::select(vec![1.0, 1e-9, 0.1]),
        prop::sample::select(vec![
            (None, 1.0),
            (Some(0.45), 0.9),
            (Some(1.0), 0.0),
            (Some(1e-300), 0.5),
            (None, 0.5),
        ]),
        prop::sample::select(vec![0.0, 0.2, 1e300]),
    )
        .prop_map(
            |(
                particles,
                sigma_hit,
                z_rand,
                max_distance,
                max_range,
                alpha,
                initial_pose,
                proposal,
                resampling,
                likelihood_exponent,
                (beam_floor, outlier_fraction),
                resample_distance,
            )| {
                FilterSettings {
                    particles: particles.into(),
                    sigma_hit: SigmaHit::Metres(sigma_hit),
                    z_rand,
                    max_distance,
                    max_range,
                    alpha: [alpha, 0.05, alpha, 0.05],
                    initial_pose,
                    proposal,
                    resampling,
                    likelihood_exponent,
                    beam_floor,
                    outlier_fraction,
                    resample_distance,
                    resample_angle: resample_distance,
                    ..FilterSettings::default()
                }
            },
        )
}

fn scans() -> impl Strategy<Value = Vec<LaserScan>> {
    let range = prop_oneof![
        4 => 0.1..9.0f64,
        1 => prop::sample::select(vec![0.0, -1.0, 5e-324, 1e9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
    ];
    let geometry = (
        prop::sample::select(vec![-1.5, 0.0, 1e300, f64::NAN]),
        prop::sample::select(vec![0.02, -0.02, 0.0, f64::MAX]),
    );
    let increment = prop_oneof![
        6 => (-0.5..0.5f64, -0.1..0.1f64, -1.0..1.0f64).prop_map(|(x, y, theta)| Some(Pose2::new(x, y, theta))),
        1 => Just(Some(Pose2::IDENTITY)),
        1 => Just(Some(Pose2::new(1e300, -1e300, 1e9))),
        1 => Just(None),
    ];
    (geometry, prop::collection::vec((prop::collection::vec(range, 0..30), increment), 0..6))
        .prop_map(|((start_angle, angle_step), scans)| {
            let scan = |(ranges, odometry): (Vec<f64>, Option<Pose2>)| LaserScan {
                stamp: None,
                geometry: ScanGeometry { start_angle, angle_step, beams: ranges.len() },
                ranges,
                map_from_laser: None,
                odometry,
                sweep: Default::default(),
            };
            scans.into_iter().map(scan).collect()
        })
}

/// A run over all of these scans with their odometry.
fn run(
    map: &PointMap<2>,
    settings: &FilterSettings,
    scans: Vec<LaserScan>,
    start: Option<Pose2>,
) -> Result<Run, FilterError> {
    let checked = settings.clone().check()?;
    let distances = MapDistances::grid(map, settings.max_distance)?;
    let recording = Recording { scans, robot_from_laser: Pose2::IDENTITY };
    let increments: Vec<_> = recording.scans.iter().map(|scan| scan.odometry).collect();
    let all: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &all };
    localize(&replay, &distances, &checked, start, Seed::new(7))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// With all settings that change the number of particles, or when and where they are drawn.
    #[test]
    fn starts_and_recoveries_are_finite_or_errors(
        map in map(),
        settings in settings(),
        scans in scans(),
        particles in prop::sample::select(vec!["1..1", "1..40", "30..300"]),
        update_distance in prop::sample::select(vec![0.0, 0.3, 1e300]),
        tolerance in prop::sample::select(vec![0.01, 1.5]),
    ) {
        let settings = FilterSettings {
            particles: particles.parse().unwrap(),
            initial_pose: InitialPose::scan(),
            recover: Some(Recovery { tolerance, fast: 0.9, ..Recovery::default() }),
            update_distance,
            ..settings
        };
        let number = scans.len();
        let Ok(run) = run(&map, &settings, scans, None) else { return Ok(()) };
        prop_assert_eq!(run.map_from_laser.len(), number);
        let within = settings.particles.least..=settings.particles.most;
        for (pose, report) in run.map_from_laser.iter().zip(&run.reports) {
            prop_assert!(pose.is_finite(), "{pose:?}");
            prop_assert!(within.contains(&report.particles), "{report:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn poses_are_finite_or_errors(
        map in map(),
        settings in settings(),
        scans in scans(),
        start in (coordinate(), coordinate(), -1e3..1e3f64),
    ) {
        let start = Some(Pose2::new(start.0, start.1, start.2));
        let number = scans.len();
        let Ok(run) = run(&map, &settings, scans, start) else { return Ok(()) };
        prop_assert_eq!(run.map_from_laser.len(), number);
        for (pose, report) in run.map_from_laser.iter().zip(&run.reports) {
            prop_assert!(pose.is_finite(), "{pose:?}");
            prop_assert!(report.log_evidence.is_finite(), "{report:?}");
            let ess = report.effective_sample_size;
            prop_assert!(ess >= 1.0 - 1e-9 && ess <= settings.particles.most as f64 + 1e-6, "{ess}");
        }
    }

    #[test]
    fn distances_are_those_of_the_tree(
        map in map(),
        max_distance in length(),
        places in prop::collection::vec((coordinate(), coordinate()), 1..40),
    ) {
        let Ok(field) = DistanceField::build(&map, max_distance) else { return Ok(()) };
        let places: Vec<[f64; 2]> = places.into_iter().map(|(x, y)| [x, y]).collect();
        let mut squared = Vec::new();
        field.distances_squared(&places, &mut squared);
        for (place, squared) in places.iter().zip(&squared) {
            let nearest = map
                .points()
                .iter()
                .map(|point| (point[0] - place[0]).hypot(point[1] - place[1]))
                .fold(f64::INFINITY, f64::min)
                .min(max_distance);
            let found = squared.sqrt();
            prop_assert!((found - nearest).abs() <= 1e-5 + 1e-12 * nearest, "{found} for {nearest} at {place:?}");
        }
    }
}

/// Found by the property above: the weighted mean of such positions overflowed.
#[test]
fn a_start_beyond_all_maps_is_refused() {
    let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
    let settings = FilterSettings::default().check().unwrap();
    let distances = MapDistances::grid(&map, settings.values().max_distance).unwrap();
    for x in [1e13, f64::MAX] {
        let start = Some(Pose2::new(x, 0.0, 0.0));
        let filter =
            ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, start, Seed::new(1));
        let Err(error) = filter else { panic!("accepted {x}") };
        assert!(matches!(error, FilterError::NonFiniteParticle { .. }), "{error}");
    }
}

/// Sums over this many weights lose no accuracy: on average over runs, the posterior is that of fewer particles (the
/// first scan leaves only 200 of 10,000, so the evidence of a single run varies by 0.1).
#[test]
fn a_million_particles_agree_with_ten_thousand() {
    let walls = (0..400).map(|i| f64::from(i) * 0.02).flat_map(|s| [[s, 0.0], [0.0, 0.7 * s]]);
    let map = PointMap::new(walls.collect()).unwrap();
    let geometry = ScanGeometry { start_angle: 2.0, angle_step: 0.26, beams: 12 };
    let scan = |ranges| LaserScan {
        stamp: None,
        geometry,
        ranges,
        map_from_laser: None,
        odometry: Some(Pose2::IDENTITY),
        sweep: Default::default(),
    };
    let recording = Recording {
        scans: vec![scan(vec![3.0; 12]), scan(vec![2.9; 12]), scan(vec![f64::NAN; 12])],
        robot_from_laser: Pose2::IDENTITY,
    };
    let initial_pose = InitialPose::Known { std_x: 0.3, std_y: 0.3, std_theta: 0.2 };
    for proposal in Proposal::ALL {
        let run = |particles: usize, seed: u64| {
            let book = Preset::Book.settings();
            let settings =
                FilterSettings { particles: particles.into(), initial_pose, proposal, ..book };
            let settings = settings.check().unwrap();
            let distances = MapDistances::grid(&map, settings.values().max_distance).unwrap();
            let increments = [None, Some(Pose2::IDENTITY), Some(Pose2::IDENTITY)];
            let scans = [0, 1, 2];
            let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
            let start = Some(Pose2::new(3.0, 2.0, 0.4));
            localize(&replay, &distances, &settings, start, Seed::new(seed)).unwrap()
        };
        let many = run(1_000_000, 3);
        let few: Vec<_> = (0..16).map(|seed| run(10_000, seed)).collect();
        let mean = |of: &dyn Fn(&Run) -> f64| few.iter().map(of).sum::<f64>() / 16.0;
        for (i, pose) in many.map_from_laser.iter().enumerate() {
            let of_few = Pose2::new(
                mean(&|run| run.map_from_laser[i].x),
                mean(&|run| run.map_from_laser[i].y),
                mean(&|run| run.map_from_laser[i].theta),
            );
            let missed = (pose.distance(&of_few), (pose.theta - of_few.theta).abs());
            assert!(missed.0 < 0.02 && missed.1 < 0.02, "{proposal:?}: {pose:?} {of_few:?}");
        }
        for (i, report) in many.reports.iter().enumerate() {
            let evidence = mean(&|run| run.reports[i].log_evidence);
            assert!(
                (report.log_evidence - evidence).abs() < 0.1,
                "{proposal:?}: {report:?} {evidence}"
            );
            let of_few = mean(&|run| run.reports[i].effective_sample_size) / 1e4;
            let shares = (report.effective_sample_size / 1e6, of_few);
            assert!((shares.0 / shares.1 - 1.0).abs() < 0.2, "{proposal:?}: {shares:?}");
        }
    }
}
