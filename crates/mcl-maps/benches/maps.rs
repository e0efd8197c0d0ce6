//! Map building and likelihood on the walls of a building, with as many points as the Intel log.
//!
//! `cargo bench -p mcl-maps`; rayon uses all cores, or one with `RAYON_NUM_THREADS=1`.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use mcl_core::{NearestNeighbors, Point, PointMap, Seed};
use mcl_maps::sampling::{GridOffset, sample_grid, sample_grid_of_size};
use mcl_maps::{
    FkmSettings, InitialMap, MapSize, PointSet, fuzzy_k_means, initial_map, mixture_log_likelihood,
};
use rand::RngExt;

const POINTS: usize = 155_648;
const PERCENT: [f64; 4] = [0.25, 1.0, 10.0, 50.0];
const SIGMA: f64 = 0.05;

fn main() {
    divan::main();
}

/// Points on walls every 3 m in a building of 30 m × 30 m, with 2 cm of noise.
fn walls(count: usize) -> Vec<Point<2>> {
    let mut rng = Seed::new(1).rng();
    (0..count)
        .map(|_| {
            let along = rng.random_range(0.0..30.0);
            let wall = f64::from(rng.random_range(0..11)) * 3.0 + rng.random_range(-0.02..0.02);
            if rng.random() { [along, wall] } else { [wall, along] }
        })
        .collect()
}

fn grid_map(data: &PointSet<2>, percent: f64) -> PointMap<2> {
    let initial =
        InitialMap::GridSize { size: MapSize::Percent(percent), offset: GridOffset::ORIGIN };
    initial_map(data, &initial).unwrap().map
}

#[divan::bench(sample_count = 10)]
fn arrange_points(bencher: Bencher) {
    let points = walls(POINTS);
    bencher.with_inputs(|| points.clone()).bench_values(|points| PointSet::new(points).unwrap());
}

#[divan::bench(args = [POINTS, 10 * POINTS], sample_count = 10)]
fn sample_by_cell(bencher: Bencher, count: usize) {
    let points = walls(count);
    bencher.bench(|| sample_grid(black_box(&points), 0.5, GridOffset::ORIGIN).unwrap());
}

#[divan::bench(args = PERCENT, sample_count = 5)]
fn sample_by_size(bencher: Bencher, percent: f64) {
    let points = walls(POINTS);
    let size = MapSize::Percent(percent).resolve(POINTS).unwrap();
    bencher.bench(|| sample_grid_of_size(black_box(&points), size, GridOffset::ORIGIN).unwrap());
}

/// Number of relevant pairs of a point and a component: those with d² ≤ d₁² + 2σ²·ln(K/ε), d₁ the
/// distance to the nearest component and ε = 10⁻¹². The program evaluates somewhat more.
fn pairs(data: &PointSet<2>, map: &PointMap<2>) -> usize {
    let reach = 2.0 * SIGMA * SIGMA * (map.len() as f64 / 1e-12).ln();
    let components = NearestNeighbors::new(map.points()).unwrap();
    let mut count = 0;
    for point in data.points() {
        let nearest = components.nearest(point).distance_squared;
        components.for_each_within(point, (nearest + reach).sqrt(), |_| count += 1);
    }
    count
}

/// One update of fuzzy k-means: two E steps with their sums for the M step, of which the first is
/// shared by a run, and one M step. Counts relevant pairs.
#[divan::bench(args = PERCENT, sample_count = 10)]
fn one_update(bencher: Bencher, percent: f64) {
    let data = PointSet::new(walls(POINTS)).unwrap();
    let map = grid_map(&data, percent);
    let settings = FkmSettings { sigma: SIGMA, max_iterations: 1, ..FkmSettings::default() };
    bencher
        .counter(ItemsCount::new(2 * pairs(&data, &map)))
        .bench(|| fuzzy_k_means(&data, black_box(&map), &settings, |_, _| {}).unwrap());
}

/// An E step without the sums for the M step. Counts relevant pairs.
#[divan::bench(args = PERCENT, sample_count = 10)]
fn likelihood(bencher: Bencher, percent: f64) {
    let data = PointSet::new(walls(POINTS)).unwrap();
    let map = grid_map(&data, percent);
    bencher
        .counter(ItemsCount::new(pairs(&data, &map)))
        .bench(|| mixture_log_likelihood(&data, black_box(&map), SIGMA).unwrap());
}

/// An E step at 1 % of a building that grows with the data.
#[divan::bench(args = [1, 4, 16], sample_count = 10)]
fn likelihood_of_buildings(bencher: Bencher, buildings: usize) {
    let points = (0..buildings)
        .flat_map(|building| {
            walls(POINTS / 4).into_iter().map(move |[x, y]| [x + 40.0 * building as f64, y])
        })
        .collect();
    let data = PointSet::new(points).unwrap();
    let map = grid_map(&data, 1.0);
    bencher
        .counter(ItemsCount::new(data.len()))
        .bench(|| mixture_log_likelihood(&data, black_box(&map), SIGMA).unwrap());
}
