//! The grid gives the distances of a search through all points, whatever the map looks like: up to the
//! last bits for single points, within 10⁻⁵ m for many at a time.

use std::f64::consts::TAU;

use mcl_core::{NearestNeighbors, Point, PointMap, Rng, Seed};
use mcl_filter::sensor::{DistanceField, ExactDistances};
use proptest::prelude::*;
use rand::RngExt;

/// Largest relative difference of squared distances: none in builds without fused multiply-add, and
/// with it (in the tree or in the grid) its different rounding.
const TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// Largest error of distances (m) for many points at a time.
const TOLERANCE_OF_MANY: f64 = 1e-5;

/// Panics unless the field and the reference return the truncated distance of the nearest neighbour.
fn compare(map: &PointMap<2>, max_distance: f64, queries: impl Iterator<Item = Point<2>>) {
    let field = DistanceField::build(map, max_distance).unwrap();
    let exact = ExactDistances::build(map, max_distance).unwrap();
    let tree = NearestNeighbors::new(map.points()).unwrap();
    let queries: Vec<Point<2>> = queries.collect();
    let mut many = Vec::new();
    field.distances_squared(&queries, &mut many);
    assert_eq!(many.len(), queries.len());
    for (&query, many) in queries.iter().zip(many) {
        let expected = tree.nearest(&query).distance_squared.min(max_distance * max_distance);
        let off = (many.sqrt() - expected.sqrt()).abs();
        assert!(off <= TOLERANCE_OF_MANY, "{query:?}: {many} for {expected}");
        for found in [field.distance_squared(query), exact.distance_squared(query)] {
            let off = (found - expected).abs();
            assert!(off <= TOLERANCE * expected, "{query:?}: {found} for {expected}");
        }
    }
}

/// Query points around a map: anywhere in its bounding box and a little beyond, close to its points, on them, and
/// half way between two of them.
fn queries(map: &PointMap<2>, number: usize, seed: u64) -> impl Iterator<Item = Point<2>> {
    let (points, bounds) = (map.points().to_vec(), map.bounds());
    let mut rng = Seed::new(seed).rng();
    let beyond = 3.0;
    (0..number).map(move |i| {
        let point = points[rng.random_range(0..points.len())];
        let other = points[rng.random_range(0..points.len())];
        let u: [f64; 2] = [rng.random(), rng.random()];
        let axis = |axis: usize| match i % 5 {
            0 => bounds.min[axis] - beyond + u[axis] * (bounds.extent(axis) + 2.0 * beyond),
            1 => point[axis] + 0.2 * (u[axis] - 0.5),
            2 => point[axis] + 4.2 * (u[axis] - 0.5),
            3 => 0.5 * (point[axis] + other[axis]),
            _ => point[axis],
        };
        [axis(0), axis(1)]
    })
}

fn map_of(number: usize, mut point: impl FnMut(usize) -> Point<2>) -> PointMap<2> {
    PointMap::new((0..number).map(&mut point).collect()).unwrap()
}

fn uniform(rng: &mut Rng, width: f64) -> f64 {
    width * (rng.random::<f64>() - 0.5)
}

/// Noisy walls of rooms on a 30 m × 30 m floor, like the points of a log.
fn floor(number: usize, seed: u64) -> PointMap<2> {
    let mut rng = Seed::new(seed).rng();
    map_of(number, |_| {
        let along = uniform(&mut rng, 30.0);
        let across = 5.0 * f64::from(rng.random_range(-3..=3)) + uniform(&mut rng, 0.06);
        if rng.random() { [along, across] } else { [across, along] }
    })
}

#[test]
fn floors_of_all_sizes() {
    for (number, asked) in
        [(1, 1_000), (2, 1_000), (30, 10_000), (1_556, 200_000), (155_648, 200_000)]
    {
        let map = floor(number, 1);
        compare(&map, 2.0, queries(&map, asked, 2));
    }
}

#[test]
fn other_cuts() {
    let map = floor(500, 3);
    for max_distance in [1e-6, 1e-3, 0.05, 20.0, 1e6] {
        compare(&map, max_distance, queries(&map, 10_000, 4));
    }
}

#[test]
fn degenerate_maps() {
    let mut rng = Seed::new(5).rng();
    let maps = [
        ("equal points", map_of(5_000, |_| [1.0, 2.0])),
        ("nearly equal points", map_of(5_000, |i| [1.0 + 1e-13 * i as f64, 2.0])),
        ("a horizontal line", map_of(2_000, |i| [0.01 * i as f64, 7.0])),
        ("a vertical line", map_of(2_000, |i| [-3.0, 0.01 * i as f64])),
        ("a diagonal line", map_of(2_000, |i| [0.01 * i as f64, 0.02 * i as f64])),
        (
            "a lattice full of ties",
            map_of(2_500, |i| [(i % 50) as f64 / 4.0, (i / 50) as f64 / 4.0]),
        ),
        // At the centre all points are equally near.
        (
            "a circle",
            map_of(3_000, |i| {
                let (sin, cos) = (i as f64 / 3_000.0 * TAU).sin_cos();
                [cos, sin]
            }),
        ),
        ("a dense disc", map_of(20_000, |_| [uniform(&mut rng, 0.01), uniform(&mut rng, 0.01)])),
        (
            "far from the origin",
            map_of(1_000, |_| [1e6 + uniform(&mut rng, 10.0), -1e6 + uniform(&mut rng, 10.0)]),
        ),
        (
            "so far that coordinates are coarse",
            map_of(1_000, |_| [1e12 - 500.0 + uniform(&mut rng, 10.0), uniform(&mut rng, 10.0)]),
        ),
        (
            "an outlier 10 km away",
            map_of(5_000, |i| {
                if i == 77 {
                    [10_000.0, 3_000.0]
                } else {
                    [uniform(&mut rng, 30.0), uniform(&mut rng, 30.0)]
                }
            }),
        ),
        (
            "two ends of the world",
            map_of(2_000, |i| {
                let side = if i % 2 == 0 { -1e12 } else { 1e12 };
                [side, uniform(&mut rng, 10.0)]
            }),
        ),
    ];
    for (name, map) in &maps {
        eprintln!("{name}");
        for max_distance in [2.0, 1e-6] {
            compare(map, max_distance, queries(map, 20_000, 6));
        }
    }
}

/// The cells of the grid are not known here, but these queries cross each of their borders.
#[test]
fn fine_steps_across_cells() {
    let map = floor(1_000, 7);
    for y in [-1.3, 0.0, 4.99] {
        compare(&map, 2.0, (0..60_000).map(|i| [-18.0 + 0.000_6 * f64::from(i), y]));
        compare(&map, 2.0, (0..60_000).map(|i| [y, -18.0 + 0.000_6 * f64::from(i)]));
    }
}

#[test]
fn nowhere_is_as_far_as_can_be() {
    let field = DistanceField::build(&floor(10, 8), 2.0).unwrap();
    for place in [[1e300, 0.0], [0.0, -1e300], [f64::INFINITY, 0.0], [f64::NAN, 0.0]] {
        assert_eq!(field.distance_squared(place), 4.0);
        let mut many = Vec::new();
        field.distances_squared(&[place], &mut many);
        assert!((many[0] - 4.0).abs() < 1e-6, "{many:?}");
    }
}

#[test]
fn a_truncation_that_is_not_a_length_is_refused() {
    let map = floor(10, 9);
    for cut in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(DistanceField::build(&map, cut).is_err());
        assert!(ExactDistances::build(&map, cut).is_err());
    }
}

proptest! {
    /// Coarse coordinates, so that duplicates, collinear points and ties are common.
    #[test]
    fn small_maps(
        points in prop::collection::vec((-20..20i32, -20..20i32), 1..120),
        scale in prop::sample::select(vec![0.25, 0.1, 1e-3, 1e3]),
        asked in prop::collection::vec((-30..30i32, -30..30i32), 50),
        max_distance in 0.01..5.0f64,
        seed in any::<u64>(),
    ) {
        let place = |&(x, y): &(i32, i32)| [scale * f64::from(x), scale * f64::from(y)];
        let map = PointMap::new(points.iter().map(place).collect()).unwrap();
        compare(&map, max_distance, asked.iter().map(place));
        compare(&map, max_distance, queries(&map, 200, seed));
    }
}
