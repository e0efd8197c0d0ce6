//! Mixture likelihood and fuzzy k-means against a brute force over all pairs, and their invariants.

use std::f64::consts::TAU;

use mcl_core::{Point, PointMap, Seed};
use mcl_maps::refine::RefineReport;
use mcl_maps::{
    FkmSettings, InitialMap, MapSettings, MapSize, PointSet, RefineSettings,
    accelerated_fuzzy_k_means, build_map, fuzzy_k_means, mixture_log_likelihood, snap_to_data,
};
use proptest::prelude::*;
use rand::RngExt;

fn trace(report: &RefineReport) -> Vec<f64> {
    report.steps.iter().map(|step| step.log_likelihood).collect()
}

fn distance_squared<const D: usize>(a: &Point<D>, b: &Point<D>) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Log-likelihood and one EM update over all N·K pairs.
fn brute_force<const D: usize>(
    points: &[Point<D>],
    means: &[Point<D>],
    sigma: f64,
) -> (f64, Vec<Point<D>>) {
    let mut total = 0.0;
    let mut weights = vec![0.0; means.len()];
    let mut sums = vec![[0.0; D]; means.len()];
    for x in points {
        let exponents: Vec<f64> =
            means.iter().map(|m| -distance_squared(x, m) / (2.0 * sigma * sigma)).collect();
        let largest = exponents.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = exponents.iter().map(|e| (e - largest).exp()).sum();
        total += largest + sum.ln()
            - (means.len() as f64).ln()
            - 0.5 * D as f64 * (TAU * sigma * sigma).ln();
        for (j, exponent) in exponents.iter().enumerate() {
            let responsibility = (exponent - largest).exp() / sum;
            weights[j] += responsibility;
            for axis in 0..D {
                sums[j][axis] += responsibility * x[axis];
            }
        }
    }
    let updated = (0..means.len())
        .map(|j| if weights[j] > 1e-12 { sums[j].map(|sum| sum / weights[j]) } else { means[j] })
        .collect();
    (total, updated)
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-10 * a.abs().max(b.abs())
}

/// Points around a few centres, K of them the means.
fn problem<const D: usize>(
    seed: u64,
    count: usize,
    components: usize,
) -> (Vec<Point<D>>, Vec<Point<D>>) {
    let mut rng = Seed::new(seed).rng();
    let places: Vec<Point<D>> =
        (0..5).map(|_| std::array::from_fn(|_| rng.random_range(-3.0..3.0))).collect();
    let points: Vec<Point<D>> =
        (0..count).map(|i| places[i % 5].map(|c| c + rng.random_range(-0.3..0.3))).collect();
    let means = points[..components].to_vec();
    (points, means)
}

fn check_against_brute_force<const D: usize>(
    points: Vec<Point<D>>,
    means: Vec<Point<D>>,
    sigma: f64,
) {
    let map = PointMap::new(means.clone()).unwrap();
    let (total, updated) = brute_force(&points, &means, sigma);
    let data = PointSet::new(points).unwrap();
    let found = mixture_log_likelihood(&data, &map, sigma).unwrap();
    assert!(close(found.total, total), "log-likelihood {} instead of {total}", found.total);
    assert_eq!(found.per_point, found.total / data.len() as f64);
    let settings = FkmSettings { sigma, tolerance: 0.0, max_iterations: 1 };
    let (fitted, report) = fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
    assert_eq!(report.iterations, 1);
    assert!(close(report.log_likelihood_trace[0] * data.len() as f64, total));
    for (found, expected) in fitted.iter().zip(&updated) {
        for axis in 0..D {
            assert!(
                (found[axis] - expected[axis]).abs() <= 1e-10,
                "mean {found:?} instead of {expected:?}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn agrees_with_all_pairs_in_the_plane(
        seed in any::<u64>(), count in 1..400usize, part in 0.0..1.0f64, sigma in 0.02..2.0f64,
    ) {
        let components = 1 + (part * (count - 1) as f64) as usize;
        let (points, means) = problem::<2>(seed, count, components);
        check_against_brute_force(points, means, sigma);
    }

    #[test]
    fn agrees_with_all_pairs_in_space_and_on_a_line(
        seed in any::<u64>(), count in 1..200usize, sigma in 0.05..1.0f64,
    ) {
        let (points, means) = problem::<3>(seed, count, count.div_ceil(7));
        check_against_brute_force(points, means, sigma);
        let (points, means) = problem::<1>(seed, count, count.div_ceil(7));
        check_against_brute_force(points, means, sigma);
    }

    #[test]
    fn an_update_never_lowers_the_likelihood(
        seed in any::<u64>(), count in 2..300usize, part in 0.0..1.0f64, sigma in 0.01..1.0f64,
    ) {
        let (points, _) = problem::<2>(seed, count, 1);
        let data = PointSet::new(points).unwrap();
        let size = MapSize::Points(1 + (part * (count - 1) as f64) as usize);
        let initial = InitialMap::Random { size, seed: Seed::new(seed) };
        let settings = FkmSettings { sigma, tolerance: 0.0, max_iterations: 30 };
        let built =
            build_map(&data, &MapSettings { initial, refinement: Some(RefineSettings::fkm(settings)) }).unwrap();
        let trace = trace(&built.refinement.unwrap());
        for pair in trace.windows(2) {
            // The only loss is the rounding of the sum over the points.
            prop_assert!(pair[1] >= pair[0] - 1e-12 * pair[0].abs().max(1.0), "{trace:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn acceleration_never_lowers_the_likelihood_and_ends_at_a_maximum(
        seed in any::<u64>(), count in 2..300usize, part in 0.0..1.0f64, sigma in 0.01..1.0f64,
    ) {
        let (points, means) = problem::<2>(seed, count, 1 + (part * (count - 1) as f64) as usize);
        let data = PointSet::new(points).unwrap();
        let map = PointMap::new(means).unwrap();
        let settings = FkmSettings { sigma, tolerance: 1e-6, max_iterations: 300 };
        let (means, report) =
            accelerated_fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
        let trace = &report.log_likelihood_trace;
        prop_assert_eq!(trace.len(), report.iterations + 1);
        for pair in trace.windows(2) {
            prop_assert!(pair[1] >= pair[0] - 1e-12 * pair[0].abs().max(1.0), "{trace:?}");
        }
        // The means are those of the trace's last entry, and a plain update gains next to nothing.
        let last = trace[report.iterations];
        let one = FkmSettings { max_iterations: 1, ..settings };
        let (_, after) = fuzzy_k_means(&data, &PointMap::new(means).unwrap(), &one, |_, _| {}).unwrap();
        prop_assert!(close(after.log_likelihood_trace[0], last));
        prop_assert!(!report.converged || after.log_likelihood_trace[1] - last < 1e-6);
    }
}

/// Two overlapping clusters and as many components: EM converges slowly along the line between them.
#[test]
fn acceleration_reaches_the_same_maximum_in_fewer_updates() {
    let mut rng = Seed::new(19).rng();
    let points: Vec<Point<2>> = (0..2000)
        .map(|i| [f64::from(i % 2) + rng.random_range(-0.6..0.6), rng.random_range(-0.1..0.1)])
        .collect();
    let map = PointMap::new(vec![[0.4, 0.0], [0.5, 0.01]]).unwrap();
    let data = PointSet::new(points).unwrap();
    let settings = FkmSettings { sigma: 0.58, tolerance: 1e-9, max_iterations: 1000 };
    let (plain, slow) = fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
    let (fast, quick) = accelerated_fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
    assert!(slow.converged && quick.converged);
    assert!(2 * quick.iterations < slow.iterations, "{} of {}", quick.iterations, slow.iterations);
    for (a, b) in plain.iter().zip(&fast) {
        assert!(distance_squared(a, b).sqrt() < 1e-3, "{plain:?} and {fast:?}");
    }
}

/// The limit on updates includes jumps, and reaching it is reported.
#[test]
fn acceleration_keeps_to_the_limit() {
    let (points, means) = problem::<2>(23, 300, 20);
    let data = PointSet::new(points).unwrap();
    let map = PointMap::new(means).unwrap();
    for max_iterations in 0..12 {
        let settings = FkmSettings { sigma: 0.1, tolerance: 0.0, max_iterations };
        let mut observed = Vec::new();
        let (_, report) =
            accelerated_fuzzy_k_means(&data, &map, &settings, |updates, per_point| {
                observed.push((updates, per_point));
            })
            .unwrap();
        assert_eq!((report.iterations, report.converged), (max_iterations, false));
        let trace: Vec<_> = report.log_likelihood_trace.into_iter().enumerate().collect();
        assert_eq!(observed, trace);
    }
}

/// Every point is tens of σ from the only component: no term of a sum is a normal float.
#[test]
fn far_points_have_a_finite_likelihood() {
    let points = vec![[0.0, 0.0], [3.0, 4.0], [1e4, 0.0]];
    let data = PointSet::new(points.clone()).unwrap();
    let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
    let found = mixture_log_likelihood(&data, &map, 0.05).unwrap();
    // −(0 + 25 + 10⁸)/(2·0.05²) − 3·ln(2π·0.05²)
    let expected = -(25.0 + 1e8) / 0.005 - 3.0 * (TAU * 0.0025).ln();
    assert!(close(found.total, expected));
    check_against_brute_force(points, vec![[0.0, 0.0], [3.0, 4.0]], 0.05);
}

/// Squared distances of 10²⁴ units, whose rounding errors are themselves thousands of units: the
/// exponent of the nearest component is exactly 0 all the same.
#[test]
fn far_points_of_a_sharp_mixture_have_a_finite_likelihood() {
    let points: Vec<Point<2>> = (0..40).map(|i| [1e4 + f64::from(i) * 0.1, 777.7]).collect();
    let data = PointSet::new(points.clone()).unwrap();
    let (sigma, means) = (1e-8, vec![[0.1, 0.3], [0.1, 0.7]]);
    let map = PointMap::new(means.clone()).unwrap();
    let found = mixture_log_likelihood(&data, &map, sigma).unwrap();
    let (expected, _) = brute_force(&points, &means, sigma);
    assert!(close(found.total, expected), "{} instead of {expected}", found.total);
    let settings = FkmSettings { sigma, tolerance: 0.0, max_iterations: 3 };
    let (means, report) = fuzzy_k_means(&data, &map, &settings, |_, _| {}).unwrap();
    assert!(means.iter().flatten().all(|c| c.is_finite()), "{means:?}");
    assert!(report.log_likelihood_trace.iter().all(|ll| ll.is_finite()), "{report:?}");
}

#[test]
fn one_component_moves_to_the_mean_and_all_points_stay() {
    let (points, _) = problem::<2>(3, 100, 1);
    let data = PointSet::new(points.clone()).unwrap();
    let settings = FkmSettings { sigma: 0.5, ..FkmSettings::default() };
    let one = PointMap::new(vec![points[7]]).unwrap();
    let (means, report) = fuzzy_k_means(&data, &one, &settings, |_, _| {}).unwrap();
    let mean = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / 100.0);
    assert!(distance_squared(&means[0], &mean).sqrt() < 1e-12);
    assert_eq!((report.iterations, report.converged), (2, true));

    let all = MapSettings { initial: InitialMap::All, refinement: None };
    assert_eq!(build_map(&data, &all).unwrap().map.points(), points);
}

#[test]
fn duplicates_and_collinear_points() {
    let mut points = vec![[1.0, 1.0]; 500];
    points.extend((0..500).map(|i| [f64::from(i) * 0.01, 2.0]));
    check_against_brute_force(points.clone(), points[490..520].to_vec(), 0.05);
    let data = PointSet::new(points).unwrap();
    let initial = InitialMap::Random { size: MapSize::Points(200), seed: Seed::new(5) };
    let settings =
        MapSettings { initial, refinement: Some(RefineSettings::fkm(FkmSettings::default())) };
    let built = build_map(&data, &settings).unwrap();
    // About a hundred components share one position; as a subset they are one point.
    let at_place = built.map.points().iter().filter(|&&p| p == [1.0, 1.0]).count();
    assert_eq!(at_place, 1);
    let mut distinct = built.indices.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), built.map.len());
}

/// The point 10 km away attracts a component wherever it starts, because nothing gains more likelihood. All values
/// stay finite on the way.
#[test]
fn a_point_ten_kilometres_away() {
    let (mut points, _) = problem::<2>(11, 300, 1);
    points.push([1e4, 0.0]);
    for components in [vec![points[3], points[4]], vec![points[3], points[300]]] {
        check_against_brute_force(points.clone(), components.clone(), 0.05);
        let data = PointSet::new(points.clone()).unwrap();
        let map = PointMap::new(components).unwrap();
        let (means, report) =
            fuzzy_k_means(&data, &map, &FkmSettings::default(), |_, _| {}).unwrap();
        assert!(report.log_likelihood_trace.iter().all(|ll| ll.is_finite()));
        assert!(means.iter().flatten().all(|c| c.is_finite()));
        assert!(snap_to_data(&data, &means).contains(&300), "{means:?}");
    }
}

/// At UTM coordinates EM gives the same map by the same steps, bit for bit.
#[test]
fn far_from_the_origin() {
    let (near, _) = problem::<2>(13, 2000, 1);
    // Multiples of 2⁻²⁰ m are exact in both frames.
    let near: Vec<Point<2>> =
        near.iter().map(|p| p.map(|c| (c * 1_048_576.0).round() / 1_048_576.0)).collect();
    let offset = [524_288.0, 4_194_304.0];
    let far: Vec<Point<2>> = near.iter().map(|p| [p[0] + offset[0], p[1] + offset[1]]).collect();
    let initial = InitialMap::Random { size: MapSize::Percent(5.0), seed: Seed::new(5) };
    let settings =
        MapSettings { initial, refinement: Some(RefineSettings::fkm(FkmSettings::default())) };
    let near = build_map(&PointSet::new(near).unwrap(), &settings).unwrap();
    let far = build_map(&PointSet::new(far).unwrap(), &settings).unwrap();
    assert_eq!(near.indices, far.indices);
    let (near, far) = (near.refinement.unwrap(), far.refinement.unwrap());
    assert_eq!(near.evaluations, far.evaluations);
    assert_eq!(trace(&near), trace(&far));
}

/// A component between points that always have a nearer component: it is not responsible for any point.
#[test]
fn a_component_without_points_stays_where_it_is() {
    let data = PointSet::new(vec![[0.0, 0.0], [0.01, 0.0], [10.0, 0.0], [10.01, 0.0]]).unwrap();
    let map = PointMap::new(vec![[0.0, 0.0], [5.0, 1.0], [10.0, 0.0]]).unwrap();
    let (means, _) = fuzzy_k_means(&data, &map, &FkmSettings::default(), |_, _| {}).unwrap();
    assert_eq!(means[1], [5.0, 1.0]);
    assert!((means[0][0] - 0.005).abs() < 1e-12 && (means[2][0] - 10.005).abs() < 1e-12);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let (points, _) = problem::<2>(17, 30_000, 1);
    let data = PointSet::new(points).unwrap();
    let initial = InitialMap::Random { size: MapSize::Percent(2.0), seed: Seed::new(5) };
    let fkm = FkmSettings { max_iterations: 5, ..FkmSettings::default() };
    let settings = MapSettings { initial, refinement: Some(RefineSettings::fkm(fkm)) };
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let built = build_map(&data, &settings).unwrap();
            let accelerated = accelerated_fuzzy_k_means(&data, &built.map, &fkm, |_, _| {});
            (built.indices, trace(&built.refinement.unwrap()), accelerated.unwrap())
        })
    };
    let one = build(1);
    assert_eq!(one, build(2));
    assert_eq!(one, build(7));
}

#[test]
fn settings_out_of_range_are_refused() {
    let data = PointSet::new(vec![[0.0, 0.0]]).unwrap();
    let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
    for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300] {
        assert!(mixture_log_likelihood(&data, &map, sigma).is_err(), "{sigma}");
    }
    for tolerance in [-1.0, f64::NAN] {
        let settings = FkmSettings { tolerance, ..FkmSettings::default() };
        assert!(fuzzy_k_means(&data, &map, &settings, |_, _| {}).is_err(), "{tolerance}");
    }
}
