//! Invariants of the statistics over blocks, and their behaviour on simulated experiments.

use mcl_core::Seed;
use mcl_metrics::{
    Blocked, BlockedRate, Effect, holm, mean_interval, paired, paired_t_test, two_sample,
    welch_t_test,
};
use proptest::prelude::*;
use rand::RngExt;
use rand_distr::StandardNormal;

/// Block, unit, value of a and of b.
type Pairs = Vec<(u64, u64, f64, f64)>;

/// Up to six blocks of up to five units.
fn pairs() -> impl Strategy<Value = Pairs> {
    let block = prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64), 1..6);
    prop::collection::vec(block, 2..7).prop_map(|blocks| {
        let mut unit = 0;
        let mut pairs = Vec::new();
        for (block, values) in (0..).zip(blocks) {
            for (a, b) in values {
                pairs.push((block, unit, a, b));
                unit += 1;
            }
        }
        pairs
    })
}

fn sides(pairs: &Pairs) -> [Blocked; 2] {
    let a = pairs.iter().map(|&(block, unit, a, _)| (block, unit, a));
    let b = pairs.iter().map(|&(block, unit, _, b)| (block, unit, b));
    [Blocked::with_units(a).unwrap(), Blocked::with_units(b).unwrap()]
}

/// Up to rounding, everything that is reported.
fn assert_same(found: &Effect, expected: &Effect) -> Result<(), TestCaseError> {
    let numbers = |effect: &Effect| {
        [
            effect.mean_difference,
            effect.standard_error,
            effect.degrees_of_freedom,
            effect.p_two_sided,
            effect.p_less,
            effect.p_greater,
            effect.interval.low,
            effect.interval.high,
        ]
    };
    for (found, expected) in numbers(found).into_iter().zip(numbers(expected)) {
        prop_assert!(
            (found - expected).abs() < 1e-9 * (1.0 + expected.abs()),
            "{found} {expected}"
        );
    }
    prop_assert_eq!(found.blocks, expected.blocks);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// Twice as many runs on the same maps once made p a hundred times smaller.
    #[test]
    fn duplicating_every_run_within_its_block_changes_no_p_value(once in pairs(), copies in 2..5u64) {
        let copy = |copy: u64| {
            once.iter().map(move |&(block, unit, a, b)| (block, 1000 * copy + unit, a, b))
        };
        let often: Pairs = (0..copies).flat_map(copy).collect();
        let ([a, b], [many_a, many_b]) = (sides(&once), sides(&often));
        assert_same(&paired(&many_a, &many_b).unwrap(), &paired(&a, &b).unwrap())?;
        assert_same(&two_sample(&many_a, &many_b).unwrap(), &two_sample(&a, &b).unwrap())?;
        let (found, expected) = (many_a.mean_interval().unwrap(), a.mean_interval().unwrap());
        prop_assert!((found.interval.high - expected.interval.high).abs() < 1e-9, "{found:?}");
        let seed = Seed::new(1);
        let found = many_a.bootstrap_interval(200, seed).unwrap();
        let expected = a.bootstrap_interval(200, seed).unwrap();
        prop_assert!((found.interval.low - expected.interval.low).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn nothing_differs_from_itself(once in pairs()) {
        let [a, _] = sides(&once);
        let effect = paired(&a, &a).unwrap();
        prop_assert_eq!((effect.mean_difference, effect.p_two_sided), (0.0, 1.0));
        prop_assert_eq!((effect.interval.low, effect.interval.high), (0.0, 0.0));
    }

    #[test]
    fn names_of_blocks_do_not_matter(once in pairs(), factor in 1..1000u64, flip in any::<u64>()) {
        // An odd factor and an exclusive or map different numbers to different numbers.
        let named = |block: u64| block.wrapping_mul(2 * factor + 1) ^ flip;
        let renamed: Pairs =
            once.iter().map(|&(block, unit, a, b)| (named(block), unit, a, b)).collect();
        let ([a, b], [other_a, other_b]) = (sides(&once), sides(&renamed));
        assert_same(&paired(&other_a, &other_b).unwrap(), &paired(&a, &b).unwrap())?;
        assert_same(&two_sample(&other_a, &other_b).unwrap(), &two_sample(&a, &b).unwrap())?;
        let [found, expected] =
            [&other_a, &a].map(|side| side.bootstrap_interval(200, Seed::new(1)).unwrap());
        prop_assert!((found.interval.low - expected.interval.low).abs() < 1e-9);
        prop_assert!((found.interval.high - expected.interval.high).abs() < 1e-9);
        let [found, expected] = [&other_a, &a].map(Blocked::intraclass_correlation);
        prop_assert_eq!(found.is_some(), expected.is_some());
        if let (Some(found), Some(expected)) = (found, expected) {
            prop_assert!((found - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn the_order_of_values_does_not_matter(once in pairs(), with_units in any::<bool>(), seed in 0..99u64) {
        let mut shuffled = once.clone();
        let mut rng = Seed::new(seed).rng();
        for last in (1..shuffled.len()).rev() {
            shuffled.swap(last, rng.random_range(0..=last));
        }
        let blocked = |pairs: &Pairs| {
            let values = pairs.iter().map(|&(block, unit, a, _)| (block, unit, a));
            match with_units {
                true => Blocked::with_units(values).unwrap(),
                false => Blocked::new(values.map(|(block, _, a)| (block, a))).unwrap(),
            }
        };
        // Equal bit for bit, and so is everything computed from it.
        prop_assert_eq!(blocked(&shuffled), blocked(&once));
        let interval = |pairs| blocked(pairs).bootstrap_interval(100, Seed::new(seed)).unwrap();
        prop_assert_eq!(interval(&shuffled), interval(&once));
    }

    #[test]
    fn swapping_the_sides_mirrors_the_effect(once in pairs()) {
        let [a, b] = sides(&once);
        for (ab, ba) in [(paired(&a, &b), paired(&b, &a)), (two_sample(&a, &b), two_sample(&b, &a))] {
            let (ab, ba) = (ab.unwrap(), ba.unwrap());
            prop_assert!((ab.mean_difference + ba.mean_difference).abs() < 1e-12);
            prop_assert!((ab.interval.low + ba.interval.high).abs() < 1e-9);
            prop_assert!((ab.p_less - ba.p_greater).abs() < 1e-9);
            prop_assert!((ab.p_two_sided - ba.p_two_sided).abs() < 1e-9);
            prop_assert!((ab.equivalence_p(0.5).unwrap() - ba.equivalence_p(0.5).unwrap()).abs() < 1e-9);
        }
    }

    /// With one value per block, the tests equal the textbook tests of independent samples.
    #[test]
    fn blocks_of_one_are_single_samples(values in prop::collection::vec((-5.0..5.0f64, -5.0..5.0f64), 2..12)) {
        let (a, b): (Vec<f64>, Vec<f64>) = values.into_iter().unzip();
        let [blocked_a, blocked_b] =
            [&a, &b].map(|side| Blocked::new((0..).zip(side.iter().copied())).unwrap());
        prop_assert_eq!(paired(&blocked_a, &blocked_b).unwrap(), paired_t_test(&a, &b).unwrap());
        prop_assert_eq!(two_sample(&blocked_a, &blocked_b).unwrap(), welch_t_test(&a, &b).unwrap());
        prop_assert_eq!(blocked_a.mean_interval().unwrap(), mean_interval(&a).unwrap());
        prop_assert_eq!(blocked_a.mean(), blocked_a.mean_of_blocks());
    }

    #[test]
    fn holm_only_raises_and_keeps_the_order(
        p_values in prop::collection::vec(prop_oneof![9 => 0.0..=1.0f64, 1 => Just(f64::NAN)], 0..12),
    ) {
        let adjusted = holm(&p_values);
        prop_assert_eq!(adjusted.len(), p_values.len());
        let family = p_values.iter().filter(|p| !p.is_nan()).count() as f64;
        for (&p, &adjusted_p) in p_values.iter().zip(&adjusted) {
            prop_assert_eq!(p.is_nan(), adjusted_p.is_nan());
            if p.is_nan() {
                continue;
            }
            // Never above Bonferroni.
            prop_assert!(p <= adjusted_p && adjusted_p <= (family * p).min(1.0));
            for (&other, &adjusted_other) in p_values.iter().zip(&adjusted) {
                prop_assert!(p.is_nan() || other.is_nan() || p > other || adjusted_p <= adjusted_other);
            }
        }
    }
}

/// Weighted errors (eq. 7) on the simulated office's maps of 1 %: run r is on the map of draw r mod 10.
const GBS: [f64; 20] = [
    0.0277495, 0.0280479, 0.0264665, 0.0289759, 0.0261265, 0.0282589, 0.0277706, 0.0272268,
    0.0268351, 0.0271522, 0.0274598, 0.0273210, 0.0265702, 0.0292306, 0.0266185, 0.0281660,
    0.0282880, 0.0270120, 0.0273142, 0.0275693,
];
const GBS_FKM: [f64; 20] = [
    0.0249377, 0.0259231, 0.0252679, 0.0249252, 0.0250897, 0.0252657, 0.0246739, 0.0252319,
    0.0249069, 0.0255780, 0.0250036, 0.0255550, 0.0247996, 0.0249502, 0.0253487, 0.0253058,
    0.0247897, 0.0258695, 0.0249313, 0.0251866,
];
const RND_FKM: [f64; 20] = [
    0.0248915, 0.0245019, 0.0251044, 0.0244648, 0.0240754, 0.0258694, 0.0254142, 0.0247007,
    0.0245991, 0.0245761, 0.0243499, 0.0248320, 0.0250160, 0.0242570, 0.0246953, 0.0255930,
    0.0251648, 0.0241475, 0.0248272, 0.0246327,
];

/// Twenty runs on ten maps are ten samples: a difference that is significant over runs is not over maps.
/// Source of the numbers per map: SciPy 1.17.1, `ttest_rel` of the means per map.
#[test]
fn runs_on_the_same_map_are_one_sample() {
    let [gbs, gbs_fkm, rnd_fkm] = [GBS, GBS_FKM, RND_FKM].map(|errors| {
        let runs = (0..).zip(errors).map(|(run, error)| (run % 10, run, error));
        Blocked::with_units(runs).unwrap()
    });
    let by_run = |a: &[f64; 20], b: &[f64; 20]| paired_t_test(a, b).unwrap().p_two_sided;
    let close = |found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 1e-9, "{found:e} is not {expected:e}");
    };
    close(by_run(&GBS_FKM, &GBS), 9.27043623720157e-10);
    let effect = paired(&gbs_fkm, &gbs).unwrap();
    close(effect.p_two_sided, 2.32398318436621e-05);
    close(effect.interval.low, -0.0029941380979982106);
    close(gbs_fkm.minus(&gbs).unwrap().intraclass_correlation().unwrap(), 0.8666677777760633);

    close(by_run(&GBS_FKM, &RND_FKM), 0.013912812374259927);
    let effect = paired(&gbs_fkm, &rnd_fkm).unwrap();
    close(effect.p_two_sided, 0.06758978407394044);
    assert_eq!((effect.degrees_of_freedom, effect.blocks), (9.0, [10, 10]));
}

const EXPERIMENTS: usize = 2000;

/// Whether the fraction of experiments agrees with a rate, within four standard errors.
fn assert_rate(count: usize, rate: f64) {
    let found = count as f64 / EXPERIMENTS as f64;
    let standard_error = (rate * (1.0 - rate) / EXPERIMENTS as f64).sqrt();
    assert!((found - rate).abs() < 4.0 * standard_error, "{found} is not {rate}");
}

/// Two equally good builders, two runs on each of ten maps. The map explains 87 % of the variance
/// of an error, as in the office; a run has the same noise on the maps of both.
#[test]
fn equal_builders_differ_in_5_percent_of_experiments() {
    let (of_map, of_run) = (0.87f64.sqrt(), 0.13f64.sqrt());
    let mut rng = Seed::new(15).derive("equal builders").rng();
    let [mut by_map, mut by_run, mut covered] = [0; 3];
    for _ in 0..EXPERIMENTS {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let noise: [f64; 20] = std::array::from_fn(|_| normal());
        let mut errors = || -> [f64; 20] {
            let maps: [f64; 10] = std::array::from_fn(|_| normal());
            std::array::from_fn(|run| noise[run] + of_map * maps[run % 10] + of_run * normal())
        };
        let (a, b) = (errors(), errors());
        let [blocked_a, blocked_b] = [a, b].map(|errors| {
            let runs = (0..).zip(errors).map(|(run, error)| (run % 10, run, error));
            Blocked::with_units(runs).unwrap()
        });
        by_map += usize::from(paired(&blocked_a, &blocked_b).unwrap().p_two_sided < 0.05);
        by_run += usize::from(paired_t_test(&a, &b).unwrap().p_two_sided < 0.05);
        let interval = blocked_a.mean_interval().unwrap().interval;
        covered += usize::from(interval.low <= 0.0 && 0.0 <= interval.high);
    }
    assert_rate(by_map, 0.05);
    assert_rate(covered, 0.95);
    assert!(by_run > EXPERIMENTS / 10, "by run only {by_run} of {EXPERIMENTS} differ");
}

/// The interval of a rate contains the true one in at least 95 % of experiments, however similar the runs on a map
/// are; an interval with runs as trials does not.
#[test]
fn rates_are_covered_whatever_runs_share() {
    let mut rng = Seed::new(15).derive("rates").rng();
    let mut coverage = |rate: f64, copied: f64, sizes: [u64; 10]| {
        let [mut covered, mut by_run] = [0; 2];
        for _ in 0..EXPERIMENTS {
            let mut units = Vec::new();
            for (block, size) in (0..).zip(sizes) {
                let shared = rng.random_bool(rate);
                for _ in 0..size {
                    let own = rng.random_bool(rate);
                    units.push((block, if rng.random_bool(copied) { shared } else { own }));
                }
            }
            let found = BlockedRate::new(units).unwrap();
            let holds = |interval: mcl_metrics::Interval| {
                usize::from(interval.low <= rate && rate <= interval.high)
            };
            covered += holds(found.interval(0.95).unwrap());
            by_run += holds(found.of_units().interval(0.95).unwrap());
        }
        [covered, by_run].map(|count| count as f64 / EXPERIMENTS as f64)
    };
    for rate in [0.02, 0.1, 0.3, 0.5, 0.9] {
        for copied in [0.0, 0.5, 0.95, 1.0] {
            for sizes in [[1; 10], [2; 10], [5; 10], [2, 2, 2, 2, 2, 2, 2, 3, 1, 4]] {
                let [covered, _] = coverage(rate, copied, sizes);
                assert!(covered > 0.95, "{rate}, {copied}, {sizes:?}: {covered}");
            }
        }
    }
    let [_, by_run] = coverage(0.3, 0.95, [5; 10]);
    assert!(by_run < 0.8, "{by_run}");
}
