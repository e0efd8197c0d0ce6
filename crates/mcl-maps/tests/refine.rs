//! Invariants of the refinements, on random problems.

use std::collections::HashSet;

use mcl_core::{Point, PointMap, Seed};
use mcl_maps::refine::{Refined, Stage, refine};
use mcl_maps::{FkmSettings, PointSet, RefineSettings, Refinement, mixture_log_likelihood};
use proptest::prelude::*;
use rand::RngExt;

fn settings(method: Refinement, sigma: f64) -> RefineSettings {
    let fkm = FkmSettings { sigma, tolerance: 1e-4, max_iterations: 50 };
    RefineSettings { method, fkm, seed: Seed::new(3), budget_s: None }
}

/// Points in clusters, some of them equal.
fn heaps<const D: usize>(seed: u64, points: usize) -> Vec<Point<D>> {
    let mut rng = Seed::new(seed).rng();
    (0..points)
        .map(|_| {
            let heap = rng.random_range(0..7);
            std::array::from_fn(|axis| match rng.random_range(0..5) {
                0 => f64::from(heap * (axis as i32 + 1)),
                _ => f64::from(heap * (axis as i32 + 1)) + rng.random_range(-0.3..0.3),
            })
        })
        .collect()
}

/// The log-likelihood per point under a subset.
fn per_point<const D: usize>(data: &PointSet<D>, indices: &[usize], sigma: f64) -> f64 {
    let points = indices.iter().map(|&index| data.points()[index]).collect();
    mixture_log_likelihood(data, &PointMap::new(points).unwrap(), sigma).unwrap().per_point
}

fn obeys_the_laws<const D: usize>(
    points: Vec<Point<D>>,
    kept: usize,
    sigma: f64,
) -> Result<(), TestCaseError> {
    let data = PointSet::new(points).unwrap();
    let initial = PointMap::new(data.points()[..kept].to_vec()).unwrap();
    for method in Refinement::ALL {
        let settings = settings(method, sigma);
        let Refined { indices, means, report } =
            refine(&data, &initial, &settings, |_| {}).unwrap();
        let distinct: HashSet<_> = indices.iter().collect();
        prop_assert_eq!(distinct.len(), indices.len(), "{:?}", method);
        prop_assert!(indices.iter().all(|&index| index < data.len()));
        prop_assert!(!indices.is_empty() && indices.len() <= kept && means.len() == kept);
        prop_assert!(means.iter().flatten().all(|coordinate| coordinate.is_finite()));

        prop_assert_eq!(report.steps[0].stage, Stage::Initial);
        for pair in report.steps.windows(2) {
            prop_assert!(
                pair[1].evaluations >= pair[0].evaluations && pair[1].seconds >= pair[0].seconds
            );
            let (before, after) = (pair[0].log_likelihood, pair[1].log_likelihood);
            prop_assert!(
                pair[1].stage == Stage::Snap || after >= before - 1e-9 * (1.0 + before.abs()),
                "{:?}: {:?}",
                method,
                pair
            );
        }
        prop_assert!(report.evaluations >= report.steps[report.steps.len() - 1].evaluations);
        if let Refinement::Exchange { .. } | Refinement::Best { .. } = method {
            // The map has as many points as the initial map, and the trace ends with the value of the map.
            prop_assert_eq!(indices.len(), kept);
            let last = report.steps[report.steps.len() - 1].log_likelihood;
            let own = per_point(&data, &indices, sigma);
            prop_assert!((last - own).abs() <= 1e-9 * (1.0 + own.abs()), "{last} {own}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn accepted_steps_never_lower_the_likelihood(
        seed in 0..1000u64,
        points in 1..400usize,
        share in 0.0..1.0f64,
        sigma in prop::sample::select(vec![0.01, 0.1, 1.0]),
    ) {
        let kept = 1 + (share * share * (points - 1) as f64) as usize;
        obeys_the_laws(heaps::<1>(seed, points), kept, sigma)?;
        obeys_the_laws(heaps::<2>(seed, points), kept, sigma)?;
        obeys_the_laws(heaps::<3>(seed, points), kept, sigma)?;
    }
}

/// 25 clusters of 60 points, and an initial map with nearly all its points in one of them: a local maximum that
/// plain EM cannot leave.
#[test]
fn split_and_merge_finds_the_planted_heaps() {
    let mut rng = Seed::new(5).rng();
    let centers: Vec<[f64; 2]> =
        (0..25).map(|heap| [f64::from(heap % 5), f64::from(heap / 5)]).collect();
    let points: Vec<[f64; 2]> = centers
        .iter()
        .flat_map(|center| vec![*center; 60])
        .map(|center| center.map(|c| c + rng.random_range(-0.1..0.1)))
        .collect();
    let data = PointSet::new(points).unwrap();
    let initial = PointMap::new(data.points()[40..65].to_vec()).unwrap();
    let missed = |method: Refinement| {
        let found = refine(&data, &initial, &settings(method, 0.05), |_| {}).unwrap();
        let is_found = |center: &&[f64; 2]| {
            let near = |&index: &usize| {
                let point = data.points()[index];
                (point[0] - center[0]).hypot(point[1] - center[1]) < 0.1
            };
            found.indices.iter().any(near)
        };
        25 - centers.iter().filter(is_found).count()
    };
    assert!(missed(Refinement::Fkm {}) > 10);
    assert_eq!(missed(Refinement::SPLIT_MERGE), 0);
    assert_eq!(missed(Refinement::BEST), 0);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let data = PointSet::new(heaps::<2>(1, 20_000)).unwrap();
    let initial = PointMap::new(data.points()[..300].to_vec()).unwrap();
    for method in Refinement::ALL {
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| refine(&data, &initial, &settings(method, 0.02), |_| {}).unwrap())
        });
        assert_eq!(one.indices, three.indices, "{method:?}");
        assert_eq!(one.means, three.means, "{method:?}");
    }
}

#[test]
fn a_spent_budget_leaves_a_map() {
    let data = PointSet::new(heaps::<2>(2, 2000)).unwrap();
    let initial = PointMap::new(data.points()[..50].to_vec()).unwrap();
    for method in Refinement::ALL {
        let settings = RefineSettings { budget_s: Some(0.0), ..settings(method, 0.05) };
        let mut seen = 0;
        let found = refine(&data, &initial, &settings, |_| seen += 1).unwrap();
        assert!(!found.indices.is_empty() && seen == found.report.steps.len());
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let data = PointSet::new(heaps::<2>(2, 20)).unwrap();
    let initial = PointMap::new(data.points()[..5].to_vec()).unwrap();
    let good = settings(Refinement::ANNEALED, 0.05);
    for (bad, message) in [
        (
            RefineSettings { method: Refinement::Annealed { start: 0, steps: 3 }, ..good },
            "annealing start",
        ),
        (RefineSettings { budget_s: Some(-1.0), ..good }, "time budget"),
        (RefineSettings { budget_s: Some(f64::NAN), ..good }, "time budget"),
        (settings(Refinement::BEST, 0.0), "sigma"),
    ] {
        let error = refine(&data, &initial, &bad, |_| {}).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}
