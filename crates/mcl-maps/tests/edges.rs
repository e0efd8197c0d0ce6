//! Numbers at the limits of floating point give an error or finite results.

use mcl_core::{Point, Seed};
use mcl_maps::refine::Stage;
use mcl_maps::{
    FkmSettings, GridOffset, InitialMap, MapSettings, MapSize, PointSet, RefineSettings,
    Refinement, accelerated_fuzzy_k_means, build_map, mixture_log_likelihood,
};
use proptest::prelude::*;

/// Zeros, subnormals, everyday numbers, UTM coordinates, and sizes whose squares overflow.
fn coordinate() -> impl Strategy<Value = f64> + Clone {
    prop_oneof![
        3 => -50.0..50.0f64,
        1 => Just(0.0),
        1 => Just(5e-324),
        1 => -1e-310..1e-310f64,
        1 => 1e8..1e8 + 10.0,
        1 => prop::sample::select(vec![1e12, -1e12, 1e150, -1e154, f64::MAX]),
        1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
    ]
}

fn cloud() -> impl Strategy<Value = Vec<Point<2>>> {
    let any = prop::collection::vec((coordinate(), coordinate()), 0..80);
    let far_but_close_together = (prop::sample::select(vec![0.0, 5e5, 1e8, -1e8]), 1..80usize)
        .prop_map(|(middle, n)| (0..n).map(|i| (middle + 0.1 * i as f64, -middle)).collect());
    let equal = (coordinate(), coordinate(), 1..80usize).prop_map(|(x, y, n)| vec![(x, y); n]);
    prop_oneof![2 => any, 2 => far_but_close_together, 1 => equal]
        .prop_map(|points: Vec<(f64, f64)>| points.into_iter().map(|(x, y)| [x, y]).collect())
}

fn initial() -> impl Strategy<Value = InitialMap<2>> {
    let size = prop_oneof![
        (0..90usize).prop_map(MapSize::Points),
        prop::sample::select(vec![1e-9, 1.0, 50.0, 100.0, 101.0, -1.0, f64::NAN])
            .prop_map(MapSize::Percent),
    ];
    let length = prop::sample::select(vec![1e-300, 1e-9, 0.3, 1e9, 1e308, 0.0, -1.0, f64::NAN]);
    let offset = (coordinate(), coordinate()).prop_map(|(x, y)| GridOffset::Metres([x, y]));
    prop_oneof![
        Just(InitialMap::All),
        size.clone().prop_map(|size| InitialMap::Random { size, seed: Seed::new(1) }),
        (size, offset.clone()).prop_map(|(size, offset)| InitialMap::GridSize { size, offset }),
        (length, offset).prop_map(|(cell, offset)| InitialMap::GridCell { cell, offset }),
    ]
}

fn sigma() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => prop::sample::select(vec![1e-9, 1e-3, 0.05, 1.0, 1e9]),
        1 => prop::sample::select(vec![0.0, -1.0, 5e-324, 1e-200, 1e200, f64::NAN, f64::INFINITY]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn maps_are_subsets_or_errors(points in cloud(), initial in initial(), sigma in sigma()) {
        // The largest coordinate that is accepted.
        let finite = points.iter().flatten().all(|coordinate| coordinate.abs() <= 1e12);
        let data = match PointSet::new(points.clone()) {
            Ok(data) => data,
            Err(error) => {
                prop_assert!(points.is_empty() || !finite, "{error} for {points:?}");
                return Ok(());
            }
        };
        prop_assert!(finite);
        let fkm = FkmSettings { sigma, tolerance: 1e-6, max_iterations: 30 };
        let fkm = RefineSettings { seed: Seed::new(2), ..RefineSettings::fkm(fkm) };
        let methods = Refinement::ALL.map(|method| Some(RefineSettings { method, ..fkm }));
        for refinement in methods.into_iter().chain([None]) {
            let Ok(built) = build_map(&data, &MapSettings { initial, refinement }) else { continue };
            let known = |point: &Point<2>| points.contains(point);
            prop_assert!(built.map.points().iter().all(known));
            if let Some(report) = &built.refinement {
                let steps = &report.steps;
                prop_assert!(steps.iter().all(|step| step.log_likelihood.is_finite()), "{steps:?}");
                for pair in steps.windows(2) {
                    let (before, after) = (pair[0].log_likelihood, pair[1].log_likelihood);
                    let is_up = after >= before - 1e-9 * (1.0 + before.abs());
                    prop_assert!(is_up || pair[1].stage == Stage::Snap, "{refinement:?} {steps:?}");
                }
            }
            if let Ok(found) = mixture_log_likelihood(&data, &built.map, sigma) {
                prop_assert!(found.total.is_finite() && found.per_point.is_finite(), "{found:?}");
            }
            if let Ok((means, report)) = accelerated_fuzzy_k_means(&data, &built.map, &fkm.fkm, |_, _| {}) {
                prop_assert!(means.iter().flatten().all(|coordinate| coordinate.is_finite()));
                prop_assert!(report.log_likelihood_trace.iter().all(|entry| entry.is_finite()));
            }
        }
    }
}
