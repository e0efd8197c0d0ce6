//! Distances, whole steps and the build of the distance field on a synthetic office: the walls of a
//! 30 m × 30 m building, 155,648 points, and random subsets of them.
//!
//! The slowest and fastest times are printed with the rate of particle-beams or queries, of which
//! one million a second is 1 µs each.

mod office;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use mcl_core::{Point, PointMap, Pose2, Seed};
use mcl_filter::sensor::DistanceField;
use mcl_filter::{FilterSettings, InitialPose, MapDistances, ParticleFilter};
use office::Office;
use rand::RngExt;

const POINTS: usize = 155_648;
/// Map sizes in per mille of all points.
const SIZES: [usize; 4] = [1, 10, 100, 1000];
const MAX_DISTANCE: f64 = 2.0;
const PARTICLES: usize = 500;
/// 30 m × 30 m.
const OFFICE: Office = Office { rooms: 6 };

fn main() {
    divan::main();
}

fn office(per_mille: usize) -> PointMap<2> {
    let mut rng = Seed::new(1).rng();
    let number = POINTS * per_mille / 1000;
    PointMap::new((0..number).map(|_| OFFICE.wall_point(&mut rng)).collect()).unwrap()
}

#[divan::bench(args = SIZES, sample_count = 5)]
fn build(bencher: Bencher, per_mille: usize) {
    let map = office(per_mille);
    bencher.bench(|| DistanceField::build(black_box(&map), MAX_DISTANCE).unwrap());
}

/// Query points within half a metre of walls.
fn places() -> Vec<Point<2>> {
    let mut rng = Seed::new(2).rng();
    (0..10_000)
        .map(|_| {
            OFFICE.wall_point(&mut rng).map(|coordinate| coordinate + rng.random::<f64>() - 0.5)
        })
        .collect()
}

#[divan::bench(args = SIZES)]
fn distances_single(bencher: Bencher, per_mille: usize) {
    let field = DistanceField::build(&office(per_mille), MAX_DISTANCE).unwrap();
    let places = places();
    let mut squared = Vec::new();
    bencher
        .counter(ItemsCount::new(places.len()))
        .bench_local(|| field.distances_squared(black_box(&places), black_box(&mut squared)));
}

#[divan::bench(args = SIZES)]
fn distances_double(bencher: Bencher, per_mille: usize) {
    let field = DistanceField::build(&office(per_mille), MAX_DISTANCE).unwrap();
    let places = places();
    bencher.counter(ItemsCount::new(places.len())).bench_local(|| {
        black_box(&places).iter().map(|&place| field.distance_squared(place)).sum::<f64>()
    });
}

/// A step of tracking: the particles follow a robot that drives back and forth.
fn bench_step(bencher: Bencher, distances: &MapDistances) {
    let settings = FilterSettings {
        particles: PARTICLES.into(),
        initial_pose: InitialPose::Known { std_x: 0.1, std_y: 0.1, std_theta: 0.05 },
        max_distance: MAX_DISTANCE,
        ..FilterSettings::default()
    };
    let settings = settings.check().unwrap();
    let poses = [0.0, 0.1].map(|x| Pose2::new(12.0 + x, 13.0, 0.6));
    let scans = poses.map(|pose| OFFICE.scan(&pose));
    let mut filter =
        ParticleFilter::new(&settings, distances, Pose2::IDENTITY, Some(poses[0]), Seed::new(3))
            .unwrap();
    let mut at = 0;
    let beams = filter.update(&scans[0]).unwrap().used_beams;
    bencher.counter(ItemsCount::new(PARTICLES * beams)).bench_local(|| {
        let increment = poses[at].between(&poses[1 - at]);
        at = 1 - at;
        filter.step(black_box(&increment), black_box(&scans[at])).unwrap()
    });
}

#[divan::bench(args = SIZES)]
fn step(bencher: Bencher, per_mille: usize) {
    bench_step(bencher, &MapDistances::grid(&office(per_mille), MAX_DISTANCE).unwrap());
}

#[divan::bench(args = SIZES)]
fn step_reference(bencher: Bencher, per_mille: usize) {
    bench_step(bencher, &MapDistances::reference(&office(per_mille), MAX_DISTANCE).unwrap());
}
