//! The likelihood field in a room small enough to work out by hand.
//!
//! ```text
//! y
//! 4  # # # # #      16 map points, one per #, a metre apart.
//! 3  # . . . #
//! 2  # . R . #      R: the robot at (2, 2), facing +x. Four beams, a quarter turn apart,
//! 1  # . . . #      each measuring 2 m: they end on the middles of the walls.
//! 0  # # # # #
//!    0 1 2 3 4  x
//! ```
//!
//! σ_hit = 0.5 m, z_rand = 0.2, z_max = 5 m, distances truncated at 1 m:
//!
//! p(d) = 0.8/(0.5·√2π)·exp(−d²/0.5) + 0.2/5 = 0.638308·exp(−2d²) + 0.04
//!
//! | pose | where the four beams end | d² | p | ln p, four beams |
//! |---|---|---|---|---|
//! | (2, 2), 0° | on map points | 0 | 0.678308 | −1.552617 |
//! | (2.5, 2), 0° | (0.5, 2) and three like it: half a metre from a point | 0.25 | 0.427154 | −3.402451 |
//! | (2, 2), 45° | (2 ± √2, 2 ± √2); nearest of (3.414, 3.414) is (4, 3) | (2 − √2)² + (√2 − 1)² = 0.514719 | 0.268008 | −5.266955 |
//! | (20, 20), 0° | far off the map | 1 (truncated) | 0.126386 | −8.273673 |

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use mcl_core::{
    LaserScan, LineSegment, NdtCell, NdtMap, PointMap, Pose2, ScanGeometry, Seed, SegmentMap,
};
use mcl_filter::sensor::{LikelihoodField, NdtReading, ObstacleGrid, ScanEndpoints};
use mcl_filter::{
    Beams, FilterError, FilterSettings, InitialPose, MapDistances, ParticleFilter, SigmaHit,
};

const ROOM: [&str; 5] = ["#####", "#...#", "#...#", "#...#", "#####"];
const POSES: [(Pose2, f64); 4] = [
    (Pose2::new(2.0, 2.0, 0.0), -1.552_617),
    (Pose2::new(2.5, 2.0, 0.0), -3.402_451),
    (Pose2::new(2.0, 2.0, FRAC_PI_4), -5.266_955),
    (Pose2::new(20.0, 20.0, 0.0), -8.273_673),
];

fn room() -> PointMap<2> {
    let rows = ROOM.iter().rev().enumerate();
    let points = rows.flat_map(|(y, row)| {
        let walls = row.chars().enumerate().filter(|&(_, cell)| cell == '#');
        walls.map(move |(x, _)| [x as f64, y as f64])
    });
    PointMap::new(points.collect()).unwrap()
}

fn scan(ranges: [f64; 4]) -> LaserScan {
    LaserScan {
        stamp: None,
        geometry: ScanGeometry { start_angle: -FRAC_PI_2, angle_step: FRAC_PI_2, beams: 4 },
        ranges: ranges.to_vec(),
        map_from_laser: None,
        odometry: None,
        sweep: Default::default(),
    }
}

fn settings() -> FilterSettings {
    FilterSettings {
        sigma_hit: SigmaHit::Metres(0.5),
        z_rand: 0.2,
        max_range: 5.0,
        max_distance: 1.0,
        ..FilterSettings::default()
    }
}

fn distances() -> [MapDistances; 2] {
    [MapDistances::grid(&room(), 1.0).unwrap(), MapDistances::reference(&room(), 1.0).unwrap()]
}

fn log_likelihood(
    distances: &MapDistances,
    settings: FilterSettings,
    ranges: [f64; 4],
    pose: Pose2,
) -> f64 {
    let settings = settings.check().unwrap();
    let field = LikelihoodField::new(distances, &settings).unwrap();
    let values = settings.values();
    let mut endpoints = ScanEndpoints::default();
    endpoints.load(&scan(ranges), &Pose2::IDENTITY, values.beams, values.max_range).unwrap();
    field.log_likelihood(&endpoints, pose)
}

#[test]
fn likelihoods_are_those_worked_out_by_hand() {
    for distances in &distances() {
        for (pose, expected) in POSES {
            let found = log_likelihood(distances, settings(), [2.0; 4], pose);
            assert!((found - expected).abs() < 1e-5, "{pose:?}: {found} for {expected}");
        }
    }
}

/// Walls without gaps. Half a metre to the right of the middle, two beams still end on them, where
/// points are half a metre away: 2·ln 0.678308 + 2·ln 0.427154. Rotated by 45°, they end 2 − √2 from a wall:
/// 4·ln(0.638308·exp(−0.686292) + 0.04).
#[test]
fn walls_are_near_between_their_ends() {
    let wall = |start, end| LineSegment { start, end };
    let (a, b, c, d) = ([0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]);
    let map = SegmentMap::new(vec![wall(a, b), wall(b, c), wall(d, c), wall(a, d)]).unwrap();
    let distances = MapDistances::segments(&map, 1.0).unwrap();
    for ((pose, _), expected) in POSES.iter().zip([-1.552_617, -2.477_534, -4.071_640, -8.273_673])
    {
        let found = log_likelihood(&distances, settings(), [2.0; 4], *pose);
        assert!((found - expected).abs() < 1e-5, "{pose:?}: {found} for {expected}");
    }
}

/// With a Gaussian of standard deviation σ_hit per map point, Mahalanobis distances equal those to points.
#[test]
fn an_ndt_map_of_round_gaussians_is_the_room() {
    let cell = |&[x, y]: &[f64; 2]| NdtCell {
        column: x as i64,
        row: y as i64,
        mean: [x, y],
        covariance: [0.25, 0.0, 0.25],
    };
    let map = NdtMap::new(1.0, room().points().iter().map(cell).collect()).unwrap();
    let reading = NdtReading { sigma_hit: 0.5, endpoint_std: 0.0 };
    let distances = MapDistances::ndt(&map, reading, 1.0).unwrap();
    for (pose, expected) in POSES {
        let found = log_likelihood(&distances, settings(), [2.0; 4], pose);
        assert!((found - expected).abs() < 1e-5, "{pose:?}: {found} for {expected}");
    }
    let other = FilterSettings { sigma_hit: SigmaHit::Metres(0.4), ..settings() }.check().unwrap();
    assert_eq!(
        LikelihoodField::new(&distances, &other).err(),
        Some(FilterError::SigmaHitMismatch { found: 0.5, expected: 0.4 })
    );
}

/// The points of the room as cells of one metre around them: wherever a beam ends in a cell, the distance of the cell
/// is used. 0.6 m to the right of the middle, two beams end on cells of a wall, one beside those of a wall (1 m), and
/// one outside the grid (truncated at 1 m): 2·ln 0.678308 + 2·ln 0.126386.
#[test]
fn an_occupancy_grid_has_a_distance_per_cell() {
    let occupied: Vec<bool> =
        ROOM.iter().rev().flat_map(|row| row.chars().map(|cell| cell == '#')).collect();
    let map_from_grid = Pose2::new(-0.5, -0.5, 0.0);
    let free = Vec::new();
    let grid = ObstacleGrid { width: 5, resolution: 1.0, map_from_grid, occupied, free };
    let distances = MapDistances::cells(&grid, 1.0).unwrap();
    for (x, expected) in [(2.0, -1.552_617), (2.4, -1.552_617), (2.6, -4.913_145)] {
        let pose = Pose2::new(x, 2.0, 0.0);
        let found = log_likelihood(&distances, settings(), [2.0; 4], pose);
        assert!((found - expected).abs() < 1e-5, "{x}: {found} for {expected}");
    }
}

/// A wall 2 m ahead that is 0.5 m thick, in cells of 5 cm. With all of its cells in the field, poses up to 0.5 m too far
/// ahead are as likely as the true one, and the estimate is a quarter of a metre off; with only the cells that a
/// beam can see, two cells deep, it is 5 cm off.
#[test]
fn thick_walls_do_not_swallow_the_robot() {
    let (width, height) = (80, 40);
    let of_columns = |range: std::ops::Range<usize>| -> Vec<bool> {
        (0..width * height).map(|cell| range.contains(&(cell % width))).collect()
    };
    let seen = ObstacleGrid {
        width,
        resolution: 0.05,
        map_from_grid: Pose2::new(-1.0, -1.0, 0.0),
        occupied: of_columns(60..70),
        free: of_columns(0..60),
    };
    let solid = ObstacleGrid { free: Vec::new(), ..seen.clone() };
    // The mean of poses along the beam, weighted by the likelihood of one beam ahead.
    let settings = FilterSettings { sigma_hit: SigmaHit::Metres(0.1), ..settings() };
    let mean = |distances: &MapDistances| {
        let ranges = [f64::NAN, 2.0, f64::NAN, f64::NAN];
        let (mut sum, mut total) = (0.0, 0.0);
        for step in -800..=800 {
            let x = 1e-3 * f64::from(step);
            let pose = Pose2::new(x, 0.0, 0.0);
            let weight = log_likelihood(distances, settings.clone(), ranges, pose).exp();
            (sum, total) = (sum + weight * x, total + weight);
        }
        sum / total
    };
    let cut = settings.max_distance;
    let points =
        |grid: &ObstacleGrid| MapDistances::grid(&grid.surface_points().unwrap(), cut).unwrap();
    for [thick, thin] in [
        [points(&solid), points(&seen)],
        [MapDistances::cells(&solid, cut).unwrap(), MapDistances::cells(&seen, cut).unwrap()],
    ] {
        let [thick, thin] = [mean(&thick), mean(&thin)];
        assert!((thick - 0.25).abs() < 0.06, "{thick}");
        assert!((thin - 0.05).abs() < 0.02, "{thin}");
    }
}

#[test]
fn readings_beyond_the_limit_do_not_count() {
    for distances in &distances() {
        // A reading of exactly z_max is used: it ends 3 m behind the wall, so its distance is truncated.
        let ranges = [5.0, 2.0, 5.1, f64::NAN];
        let found = log_likelihood(distances, settings(), ranges, POSES[0].0);
        assert!((found - (-8.273_673 - 1.552_617) / 4.0).abs() < 1e-5, "{found}");
        assert_eq!(log_likelihood(distances, settings(), [0.0; 4], POSES[0].0), 0.0);
    }
}

#[test]
fn beams_and_exponent_do_what_they_say() {
    for distances in &distances() {
        let halved = FilterSettings { likelihood_exponent: 0.5, ..settings() };
        let found = log_likelihood(distances, halved, [2.0; 4], POSES[1].0);
        assert!((found - 0.5 * POSES[1].1).abs() < 1e-5);
        // Two of four beams: those to the front and to the back.
        let two = FilterSettings { beams: Beams::Spread(2), ..settings() };
        let found = log_likelihood(distances, two, [0.5, 2.0, 0.5, 2.0], POSES[1].0);
        assert!((found - 0.5 * POSES[1].1).abs() < 1e-5);
    }
}

/// Without random measurements the log-likelihood is −Σd²/2σ² up to a constant: ln(1/(0.5·√2π)) =
/// −0.225791 per beam. With a σ_hit of 1 cm a factor of e^−5000 would be 0 in floating point.
#[test]
fn without_random_measurements_nothing_underflows() {
    for distances in &distances() {
        let pure = FilterSettings { z_rand: 0.0, ..settings() };
        let found = log_likelihood(distances, pure.clone(), [2.0; 4], POSES[1].0);
        assert!((found - 4.0 * (-0.225_791 - 0.5)).abs() < 1e-5, "{found}");
        let sharp = FilterSettings { sigma_hit: SigmaHit::Metres(0.01), ..pure };
        let found = log_likelihood(distances, sharp, [2.0; 4], POSES[3].0);
        // ln(1/(0.01·√2π)) = 3.686232; d²/2σ² = 1/0.0002. An error of d of 10⁻⁷ m, a unit in the
        // last place of the fast path's f32, gives an error of d/σ²·10⁻⁷ = 10⁻³ per beam.
        let tolerance = match distances {
            MapDistances::Grid(_) => 4e-3,
            _ => 1e-4,
        };
        assert!((found - 4.0 * (3.686_232 - 5_000.0)).abs() < tolerance, "{found}");
    }
}

#[test]
fn distances_of_another_cut_are_refused() {
    let settings = FilterSettings { max_distance: 2.0, ..settings() }.check().unwrap();
    for distances in &distances() {
        let error = LikelihoodField::new(distances, &settings).err();
        assert_eq!(error, Some(FilterError::MaxDistanceMismatch { found: 1.0, expected: 2.0 }));
    }
}

/// The filter's weights are the products worked out above, normalized: the scan is explained with
/// ln Σ p(scan)/N, and the weights of two particles differ by their log-likelihoods.
#[test]
fn the_filter_weighs_by_the_product_of_likelihoods() {
    let [grid, _] = &distances();
    let known = InitialPose::Known { std_x: 0.3, std_y: 0.3, std_theta: 0.1 };
    let settings = FilterSettings {
        particles: 50.into(),
        initial_pose: known,
        ess_fraction: 0.0,
        ..settings()
    };
    let checked = settings.clone().check().unwrap();
    let start = Some(POSES[0].0);
    let mut filter =
        ParticleFilter::new(&checked, grid, Pose2::IDENTITY, start, Seed::new(1)).unwrap();
    let before: Vec<Pose2> = filter.particles().iter().map(|(pose, _)| pose).collect();
    let report = filter.update(&scan([2.0; 4])).unwrap();
    let logs: Vec<f64> =
        before.iter().map(|&pose| log_likelihood(grid, settings.clone(), [2.0; 4], pose)).collect();
    let evidence = (logs.iter().map(|l| l.exp()).sum::<f64>() / 50.0).ln();
    assert!((report.log_evidence - evidence).abs() < 1e-12);
    for ((pose, log_weight), (before, log)) in
        filter.particles().iter().zip(before.iter().zip(&logs))
    {
        assert_eq!(pose, *before);
        assert!((log_weight - (log - evidence - 50f64.ln())).abs() < 1e-12);
    }
    let sum: f64 = filter.particles().iter().map(|(_, l)| l.exp()).sum();
    let squares: f64 = filter.particles().iter().map(|(_, l)| (2.0 * l).exp()).sum();
    assert!((sum - 1.0).abs() < 1e-12);
    assert!((report.effective_sample_size - 1.0 / squares).abs() < 1e-9);
    assert!(!report.resampled && report.used_beams == 4);
}

/// CARMEN's parametrization of the mixture: with a floor of f of the largest likelihood, logarithms are those of
/// f + (1 − f)·exp(−2d²) up to a constant. With f = 0.04/0.678308 it is the same mixture.
#[test]
fn a_floor_bounds_what_a_beam_can_cost() {
    for distances in &distances() {
        for (pose, expected) in POSES {
            let same = FilterSettings { beam_floor: Some(0.04 / 0.678_308), ..settings() };
            let found = log_likelihood(distances, same, [2.0; 4], pose);
            assert!((found - expected).abs() < 1e-5, "{pose:?}: {found} for {expected}");
        }
        // Against the first pose, d² = 0.25 and 1 cost 4·ln(0.45 + 0.55·exp(−2d²)).
        let carmen = FilterSettings { beam_floor: Some(0.45), ..settings() };
        let of = |pose: usize| log_likelihood(distances, carmen.clone(), [2.0; 4], POSES[pose].0);
        assert!((of(1) - of(0) + 0.975_468).abs() < 1e-5, "{}", of(1) - of(0));
        assert!((of(3) - of(0) + 2.581_740).abs() < 1e-5, "{}", of(3) - of(0));
    }
}

/// Likelihoods multiply until the robot has moved or turned far enough; then the weights are reset.
#[test]
fn particles_are_resampled_after_a_distance_or_an_angle() {
    let [grid, _] = &distances();
    let settings = FilterSettings {
        ess_fraction: 1.0,
        resample_distance: 0.5,
        resample_angle: 1.0,
        ..settings()
    };
    let settings = settings.check().unwrap();
    let resampled = |increment: Pose2| -> Vec<bool> {
        let start = Some(POSES[0].0);
        let mut filter =
            ParticleFilter::new(&settings, grid, Pose2::IDENTITY, start, Seed::new(1)).unwrap();
        (0..6).map(|_| filter.step(&increment, &scan([2.0; 4])).unwrap().resampled).collect()
    };
    let every = |n: usize| (1..=6).map(|step| step % n == 0).collect::<Vec<bool>>();
    assert_eq!(resampled(Pose2::new(0.3, 0.0, 0.0)), every(2));
    assert_eq!(resampled(Pose2::new(0.0, 0.2, 0.0)), every(3));
    assert_eq!(resampled(Pose2::new(0.0, 0.0, -0.4)), every(3));
    assert_eq!(resampled(Pose2::new(0.01, 0.0, 0.0)), [false; 6]);
}
