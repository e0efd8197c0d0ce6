//! The evidence that the filter reports against a sum over all poses, and how much it varies.

use std::f64::consts::FRAC_PI_2;

use mcl_core::{LaserScan, PointMap, Pose2, ScanGeometry, Seed};
use mcl_filter::sensor::{LikelihoodField, ScanEndpoints};
use mcl_filter::{
    Beams, CheckedSettings, FilterSettings, InitialPose, MapDistances, MotionKind, ParticleFilter,
    Proposal, SigmaHit,
};

/// Standard deviations of the motion: along x and y (m), and of the heading (rad).
const POSITION: f64 = 0.2;
const HEADING: f64 = 0.01;

/// A wall at x = 2 m and one at y = 3 m, a point per centimetre.
fn corner() -> MapDistances {
    let wall = || (-300..=300).map(|i| 0.01 * f64::from(i));
    let points = wall().map(|y| [2.0, y]).chain(wall().map(|x| [x, 3.0]));
    MapDistances::grid(&PointMap::new(points.collect()).unwrap(), 2.0).unwrap()
}

/// The scan of a robot at `x` and `y` from the origin, with beams ahead and to the left.
fn scan(x: f64, y: f64) -> LaserScan {
    LaserScan {
        stamp: None,
        geometry: ScanGeometry { start_angle: 0.0, angle_step: FRAC_PI_2, beams: 2 },
        ranges: vec![2.0 - x, 3.0 - y],
        map_from_laser: None,
        odometry: None,
        sweep: Default::default(),
    }
}

fn settings(particles: usize, proposal: Proposal) -> CheckedSettings {
    let still = InitialPose::Known { std_x: 0.0, std_y: 0.0, std_theta: 0.0 };
    let settings = FilterSettings {
        particles: particles.into(),
        initial_pose: still,
        motion: MotionKind::Gaussian,
        position_noise: [POSITION, 0.0, 0.0],
        heading_noise: [HEADING, 0.0, 0.0],
        sigma_hit: SigmaHit::Metres(0.05),
        z_rand: 0.0,
        beams: Beams::All,
        proposal,
        ..FilterSettings::default()
    };
    settings.check().unwrap()
}

/// ∫ p(noise)·p(scan | noise): a sum over a grid of noise, spaced by a twentieth of a standard deviation.
fn evidence(distances: &MapDistances, scan: &LaserScan) -> f64 {
    let settings = settings(1, Proposal::Motion);
    let field = LikelihoodField::new(distances, &settings).unwrap();
    let mut endpoints = ScanEndpoints::default();
    endpoints.load(scan, &Pose2::IDENTITY, Beams::All, 10.0).unwrap();
    let grid = |places: i32, step: f64| {
        let density = |z: f64| (-0.5 * z * z).exp();
        let nodes = (-places..=places).map(move |i| step * f64::from(i));
        let total: f64 = nodes.clone().map(density).sum();
        nodes.map(move |z| (z, density(z) / total)).collect::<Vec<_>>()
    };
    let (fine, coarse) = (grid(100, 0.05), grid(8, 0.5));
    let mut sum = 0.0;
    for &(x, of_x) in &fine {
        for &(y, of_y) in &fine {
            for &(turn, of_turn) in &coarse {
                let pose = Pose2::new(POSITION * x, POSITION * y, HEADING * turn);
                sum += of_x * of_y * of_turn * field.log_likelihood(&endpoints, pose).exp();
            }
        }
    }
    sum
}

/// Evidence over its true value after one motion and one scan, for many seeds.
fn ratios(distances: &MapDistances, scan: &LaserScan, settings: &CheckedSettings) -> Vec<f64> {
    const SEEDS: u64 = 3000;
    let truth = evidence(distances, scan);
    let one = |seed| {
        let start = Some(Pose2::IDENTITY);
        let mut filter =
            ParticleFilter::new(settings, distances, Pose2::IDENTITY, start, Seed::new(seed))
                .unwrap();
        filter.step(&Pose2::IDENTITY, scan).unwrap().log_evidence.exp() / truth
    };
    (0..SEEDS).map(one).collect()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len() as f64
}

/// When it was fitted to the same pilots that it reweights, the adaptive proposal gave 0.77 of the evidence with 100
/// particles and 0.98 with 500.
#[test]
fn evidence_is_unbiased_for_any_number_of_particles() {
    let (distances, scan) = (corner(), scan(0.15, -0.1));
    for proposal in Proposal::ALL {
        for particles in [50, 55, 100, 500] {
            let ratios = ratios(&distances, &scan, &settings(particles, proposal));
            let average = mean(ratios.iter().copied());
            let variance = mean(ratios.iter().map(|ratio| (ratio - average).powi(2)));
            let error = (variance / ratios.len() as f64).sqrt();
            assert!(
                (average - 1.0).abs() < 4.0 * error,
                "{proposal}, {particles} particles: {average} ± {error}"
            );
            // Enough runs to detect a bias of a tenth.
            assert!(error < 0.025, "{proposal}, {particles} particles: ± {error}");
        }
    }
}

/// The root mean square error of the evidence: a quarter of that of the motion model if the odometry is right,
/// and no larger if it is off by 2.5 and 1.5 standard deviations.
#[test]
fn the_adaptive_proposal_varies_less_than_the_motion_model() {
    let distances = corner();
    for (scan, most) in [(scan(0.15, -0.1), 0.5), (scan(2.5 * POSITION, 1.5 * POSITION), 1.0)] {
        let [adaptive, motion] = [Proposal::Adaptive, Proposal::Motion].map(|proposal| {
            let ratios = ratios(&distances, &scan, &settings(500, proposal));
            mean(ratios.iter().map(|ratio| (ratio - 1.0).powi(2))).sqrt()
        });
        assert!(adaptive <= most * motion, "{adaptive} for {motion}");
    }
}
