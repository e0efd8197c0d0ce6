//! The filter against exact Bayes filtering in a tiny world: the posterior of two scans with a noisy
//! motion between them, integrated over a grid of start poses and of motion noise. Nothing here
//! shares code with the filter.

use std::f64::consts::{FRAC_PI_4, PI};

use mcl_core::{LaserScan, PointMap, Pose2, ScanGeometry, Seed};
use mcl_filter::{
    FilterSettings, InitialPose, MapDistances, MotionKind, ParticleFilter, Proposal, Resampling,
    SigmaHit,
};

const WORLD: [[f64; 2]; 12] = [
    [0.0, 0.0],
    [0.6, 0.1],
    [1.2, 0.0],
    [1.9, 0.0],
    [2.5, 0.4],
    [2.5, 1.0],
    [2.4, 1.6],
    [1.7, 2.1],
    [1.0, 1.8],
    [0.4, 2.0],
    [-0.2, 1.3],
    [-0.1, 0.6],
];
const START: Pose2 = Pose2::new(1.0, 1.0, 0.3);
const STD: [f64; 3] = [0.15, 0.15, 0.15];
const INCREMENT: Pose2 = Pose2::new(0.35, 0.1, 0.25);
const ALPHA: [f64; 4] = [0.1, 0.05, 0.08, 0.04];
const FIRST: [f64; 6] = [0.85, 1.1, 1.35, 1.0, 0.95, 1.2];
const SECOND: [f64; 6] = [0.8, 1.0, 1.0, 0.9, 1.3, 1.6];
const SIGMA_HIT: f64 = 0.25;
const Z_RAND: f64 = 0.2;
const MAX_RANGE: f64 = 4.0;
const MAX_DISTANCE: f64 = 1.0;

fn beam_angle(beam: usize) -> f64 {
    -0.6 * PI + beam as f64 * FRAC_PI_4
}

fn likelihood(ranges: &[f64; 6], [x, y, theta]: [f64; 3]) -> f64 {
    let beam = |(i, range): (usize, &f64)| {
        let angle = theta + beam_angle(i);
        let (ex, ey) = (x + range * angle.cos(), y + range * angle.sin());
        let squares = WORLD.iter().map(|p| (p[0] - ex).powi(2) + (p[1] - ey).powi(2));
        let d = squares.fold(f64::INFINITY, f64::min).sqrt().min(MAX_DISTANCE);
        let normal = (-0.5 * (d / SIGMA_HIT).powi(2)).exp() / (SIGMA_HIT * (2.0 * PI).sqrt());
        (1.0 - Z_RAND) * normal + Z_RAND / MAX_RANGE
    };
    ranges.iter().enumerate().map(beam).product()
}

/// Nodes of a standard normal for the midpoint rule, with weights that sum to one; the rule
/// converges faster than any power of the step for smooth integrands.
fn normal_nodes(number: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| -4.5 + 9.0 * (i as f64 + 0.5) / number as f64;
    let sum: f64 = (0..number).map(|i| (-0.5 * node(i).powi(2)).exp()).sum();
    (0..number).map(|i| (node(i), (-0.5 * node(i).powi(2)).exp() / sum)).collect()
}

/// Posterior means of (x, y, θ) after the first and after the second scan, and the logarithms of the
/// likelihood of each scan given what came before.
fn exact() -> ([f64; 3], [f64; 3], [f64; 2]) {
    let (poses, noises) = (normal_nodes(19), normal_nodes(7));
    // Table 5.6 by hand: the robot drives forward, so the rotations are not reduced.
    let rotation1 = INCREMENT.y.atan2(INCREMENT.x);
    let translation = INCREMENT.x.hypot(INCREMENT.y);
    let rotation2 = INCREMENT.theta - rotation1;
    let [a1, a2, a3, a4] = ALPHA;
    let std1 = (a1 * rotation1.powi(2) + a2 * translation.powi(2)).sqrt();
    let std2 = (a1 * rotation2.powi(2) + a2 * translation.powi(2)).sqrt();
    let spread = a4 * (rotation1.powi(2) + rotation2.powi(2));
    let std_translation = (a3 * translation.powi(2) + spread).sqrt();

    let (mut before, mut after) = ([0.0; 4], [0.0; 4]);
    let add = |sums: &mut [f64; 4], weight: f64, pose: [f64; 3]| {
        sums[0] += weight;
        (0..3).for_each(|i| sums[i + 1] += weight * pose[i]);
    };
    for &(nx, wx) in &poses {
        for &(ny, wy) in &poses {
            for &(nt, wt) in &poses {
                let pose =
                    [START.x + STD[0] * nx, START.y + STD[1] * ny, START.theta + STD[2] * nt];
                let weight = wx * wy * wt * likelihood(&FIRST, pose);
                add(&mut before, weight, pose);
                // Skips poses that cannot affect the fourth digit.
                if weight < 1e-9 {
                    continue;
                }
                for &(n1, w1) in &noises {
                    for &(n, w) in &noises {
                        for &(n2, w2) in &noises {
                            let heading = pose[2] + rotation1 + std1 * n1;
                            let length = translation + std_translation * n;
                            let moved = [
                                pose[0] + length * heading.cos(),
                                pose[1] + length * heading.sin(),
                                heading + rotation2 + std2 * n2,
                            ];
                            let weight = weight * w1 * w * w2 * likelihood(&SECOND, moved);
                            add(&mut after, weight, moved);
                        }
                    }
                }
            }
        }
    }
    let mean = |sums: [f64; 4]| [sums[1] / sums[0], sums[2] / sums[0], sums[3] / sums[0]];
    (mean(before), mean(after), [before[0].ln(), (after[0] / before[0]).ln()])
}

fn scan(ranges: [f64; 6]) -> LaserScan {
    LaserScan {
        stamp: None,
        geometry: ScanGeometry { start_angle: beam_angle(0), angle_step: FRAC_PI_4, beams: 6 },
        ranges: ranges.to_vec(),
        map_from_laser: None,
        odometry: None,
        sweep: Default::default(),
    }
}

#[test]
fn agrees_with_exact_filtering_for_every_resampling() {
    const RUNS: usize = 32;
    let (first, second, evidence) = exact();
    eprintln!("exact means {first:.4?} {second:.4?}, log-evidence {evidence:.4?}");
    let map = PointMap::new(WORLD.to_vec()).unwrap();
    let distances = MapDistances::grid(&map, MAX_DISTANCE).unwrap();
    // Never resampling, and resampling after the first scan in each of the ways; noise from the motion
    // model, and from where the scan is likely.
    let kinds = Resampling::ALL.map(|kind| (Proposal::Motion, kind, 1.0)).into_iter();
    let never = Proposal::ALL.map(|proposal| (proposal, Resampling::Systematic, 0.0));
    let adaptive = (Proposal::Adaptive, Resampling::Systematic, 1.0);
    for (proposal, resampling, ess_fraction) in kinds.chain(never).chain([adaptive]) {
        let settings = FilterSettings {
            particles: 10_000.into(),
            initial_pose: InitialPose::Known { std_x: STD[0], std_y: STD[1], std_theta: STD[2] },
            motion: MotionKind::Book,
            alpha: ALPHA,
            sigma_hit: SigmaHit::Metres(SIGMA_HIT),
            z_rand: Z_RAND,
            max_distance: MAX_DISTANCE,
            max_range: MAX_RANGE,
            proposal,
            resampling,
            ess_fraction,
            ..FilterSettings::default()
        };
        let settings = settings.check().unwrap();
        let mut found: Vec<[f64; 8]> = Vec::new();
        for run in 0..RUNS {
            let seed = Seed::new(17).derive_index(run as u64);
            let mut filter =
                ParticleFilter::new(&settings, &distances, Pose2::IDENTITY, Some(START), seed)
                    .unwrap();
            let one = filter.update(&scan(FIRST)).unwrap();
            let two = filter.step(&INCREMENT, &scan(SECOND)).unwrap();
            assert_eq!(one.resampled, ess_fraction > 0.0);
            let (a, b) = (one.estimate.map_from_robot, two.estimate.map_from_robot);
            let evidence = [one.log_evidence, two.log_evidence];
            found.push([a.x, a.y, a.theta, b.x, b.y, b.theta, evidence[0], evidence[1]]);
        }
        let expected = [first.as_slice(), second.as_slice(), evidence.as_slice()].concat();
        for (quantity, expected) in expected.iter().enumerate() {
            let values = found.iter().map(|run| run[quantity]);
            let mean = values.clone().sum::<f64>() / RUNS as f64;
            let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (RUNS - 1) as f64;
            let standard_error = (variance / RUNS as f64).sqrt();
            let off = (mean - expected).abs();
            // With 31 degrees of freedom, 4.5 standard errors are exceeded once in 11,000. The mean
            // heading here is the direction of a mean vector, which is the mean of the angles up to
            // their skewness: below 0.001 rad for this spread.
            let skew = if quantity % 3 == 2 && quantity < 6 { 1e-3 } else { 0.0 };
            assert!(
                off < 4.5 * standard_error + skew,
                "{proposal} {resampling} {ess_fraction}, quantity {quantity}: {mean} ± {standard_error} for {expected}"
            );
            assert!(standard_error < 0.01, "the comparison is too blunt: {standard_error}");
        }
    }
}
