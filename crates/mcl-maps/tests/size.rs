//! Criteria for the size of a map find the true number of components.

use std::cell::RefCell;

use mcl_core::{PointMap, Seed};
use mcl_maps::choice::{Search, best, minimize};
use mcl_maps::size_criteria::{bic, description_length};
use mcl_maps::{
    FkmSettings, InitialMap, MapError, MapSize, PointSet, RefineSettings, Refinement, initial_map,
    mixture_log_likelihood,
};
use rand::RngExt;
use rand_distr::Normal;

const SIGMA: f64 = 0.05;

/// Equally many points of each of `count` Gaussians, at random places far enough from each other.
fn planted(count: usize, seed: u64) -> (PointSet<2>, PointSet<2>) {
    let mut rng = Seed::new(seed).rng();
    let mut centers: Vec<[f64; 2]> = Vec::new();
    while centers.len() < count {
        let center = [0, 1].map(|_| rng.random_range(0.0..4.0));
        let is_apart = |other: &[f64; 2]| (center[0] - other[0]).hypot(center[1] - other[1]) > 0.35;
        if centers.iter().all(is_apart) {
            centers.push(center);
        }
    }
    let noise = Normal::new(0.0, SIGMA).unwrap();
    let mut points = || {
        let each = centers.iter().flat_map(|center| vec![*center; 120]);
        PointSet::new(each.map(|center| center.map(|c| c + rng.sample(noise))).collect()).unwrap()
    };
    (points(), points())
}

fn map(data: &PointSet<2>, size: usize) -> PointMap<2> {
    let initial = InitialMap::Random { size: MapSize::Points(size), seed: Seed::new(1) };
    let fkm = FkmSettings { sigma: SIGMA, ..FkmSettings::default() };
    let settings = RefineSettings { method: Refinement::BEST, ..RefineSettings::fkm(fkm) };
    initial_map(data, &initial).unwrap().refined(data, &settings, |_| {}).unwrap().map
}

#[test]
fn the_planted_size_is_found() {
    for (count, seed) in [(7, 1), (23, 2), (40, 3)] {
        let (data, other) = planted(count, seed);
        let per_point = |points: &PointSet<2>, map: &PointMap<2>| {
            mixture_log_likelihood(points, map, SIGMA).unwrap().per_point
        };
        let maps = RefCell::new(std::collections::BTreeMap::new());
        let search = Search { range: [2.0, 150.0], factor: 1.1, patience: 60, precision: 1.01 };
        let chosen = |score: &dyn Fn(&PointMap<2>) -> f64| {
            let rate = |size: f64| {
                let size = size.round() as usize;
                let mut maps = maps.borrow_mut();
                Ok::<_, MapError>(score(maps.entry(size).or_insert_with(|| map(&data, size))))
            };
            best(&minimize(&search, rate).unwrap()).unwrap().value.round()
        };
        let own = |map: &PointMap<2>| per_point(&data, map);
        let by_bic = chosen(&|map| bic(own(map), data.len(), map.len(), 2));
        let by_length = chosen(&|map| {
            let log_likelihood = mixture_log_likelihood(&data, map, SIGMA).unwrap();
            description_length(&data, map, SIGMA, log_likelihood).unwrap()
        });
        assert_eq!([by_bic, by_length], [count as f64; 2]);
        // Several components in place of one explain held-out points equally well, so their likelihood has
        // more than one maximum; this is one of them.
        let [fewer, planted, more] =
            [count - 1, count, count + 1].map(|size| per_point(&other, &map(&data, size)));
        assert!(planted > fewer && planted > more, "{fewer} {planted} {more}");
    }
}
