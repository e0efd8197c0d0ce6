//! Numbers and stamps at the limits give an error or finite results.

use std::collections::HashSet;

use mcl_core::{Pose2, Stamp, Trajectory};
use mcl_metrics::tum::{self, NonPlanar};
use mcl_metrics::{
    Alignment, Blocked, Delta, DivergenceSettings, Effect, LossSettings, PairsFrom, RpeSettings,
    Side, Summary, WeightedPoseError, associate, ate, bootstrap_mean, diverged, interpolate,
    lost_episodes, mean_interval, nees, one_sample, paired, paired_t_test, pose_errors, rpe,
    standard_deviation, two_sample, welch_equivalence_p, welch_t_test,
};
use proptest::prelude::*;

/// Zeros, subnormals, everyday numbers, UTM coordinates, sizes whose squares overflow, and NaN and infinities.
fn number() -> impl Strategy<Value = f64> + Clone {
    prop_oneof![
        6 => -50.0..50.0f64,
        1 => prop::sample::select(vec![0.0, -0.0, 5e-324, -1e-310, 1e-160]),
        1 => 1e8..1e8 + 10.0,
        1 => prop::sample::select(vec![1e12, -1e100, 9e139, 1e150, 1e160, -1e200, f64::MAX, f64::MIN]),
    ]
}

fn samples() -> impl Strategy<Value = Vec<f64>> {
    let any = prop_oneof![
        40 => number(),
        1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
    ];
    let equal = (number(), 0..12usize).prop_map(|(value, n)| vec![value; n]);
    prop_oneof![3 => prop::collection::vec(-50.0..50.0f64, 0..12), 3 => prop::collection::vec(any, 0..12), 1 => equal]
}

fn pose() -> impl Strategy<Value = Pose2> {
    prop_oneof![
        12 => (-50.0..50.0, -50.0..50.0, -7.0..7.0f64).prop_map(|(x, y, theta)| (x, y, theta)),
        3 => (number(), number(), number()),
        1 => Just((1e8, -1e8, 0.5)),
    ]
    .prop_map(|(x, y, theta)| Pose2::new(x, y, theta))
}

/// Stamps that repeat, go backwards, and are at the limits of 64 bits.
fn stamp() -> impl Strategy<Value = Stamp> {
    let ends = vec![i64::MIN, i64::MIN + 1, -1, 0, i64::MAX - 1, i64::MAX];
    prop_oneof![
        6 => (0..12i64).prop_map(|step| step * 5_000_000),
        2 => 0..60_000_000i64,
        1 => prop::sample::select(ends),
    ]
    .prop_map(Stamp::from_nanoseconds)
}

fn trajectory() -> impl Strategy<Value = Trajectory> {
    prop::collection::vec((stamp(), pose()), 0..25).prop_map(|poses| poses.into_iter().collect())
}

fn setting() -> impl Strategy<Value = f64> {
    prop::sample::select(vec![
        0.0,
        5e-324,
        1e-9,
        0.01,
        0.1,
        1.0,
        30.0,
        1e9,
        1e300,
        -1.0,
        f64::NAN,
        f64::INFINITY,
    ])
}

fn finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// All values except t, which is infinite for a difference without spread; then p = 0.
fn check_test(test: &Effect) -> Result<(), TestCaseError> {
    let probabilities = [test.p_two_sided, test.p_less, test.p_greater];
    prop_assert!(probabilities.iter().all(|p| (0.0..=1.0).contains(p)), "{test:?}");
    prop_assert!(!test.t.is_nan() && test.degrees_of_freedom >= 1.0 - 1e-9, "{test:?}");
    prop_assert!(test.t.is_finite() || test.p_two_sided == 0.0, "{test:?}");
    prop_assert!(
        finite(&[test.mean_difference, test.interval.low, test.interval.high]),
        "{test:?}"
    );
    prop_assert!(test.interval.low <= test.mean_difference, "{test:?}");
    prop_assert!(test.mean_difference <= test.interval.high, "{test:?}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn stamps_match_one_to_one(a in trajectory(), b in trajectory(), tolerance in setting()) {
        let Ok(matched) = associate(&a, &b, tolerance) else { return Ok(()) };
        let of_reference = matched.reference_indices.unwrap();
        let of_estimate = matched.estimate_indices.unwrap();
        let pairs = of_reference.len();
        prop_assert!(pairs > 0 && of_estimate.len() == pairs);
        prop_assert_eq!(matched.unmatched_reference, a.len() - pairs);
        prop_assert_eq!(matched.unmatched_estimate, b.len() - pairs);
        prop_assert!(
            matched.sorted_by_time || of_estimate.windows(2).all(|pair| pair[0] < pair[1])
        );
        let used: HashSet<_> = of_reference.iter().collect();
        prop_assert_eq!(used.len(), pairs);
        for (&i, &j) in of_reference.iter().zip(&of_estimate) {
            let apart = a.stamps()[i].seconds_since(b.stamps()[j]).abs();
            prop_assert!(apart <= tolerance + 1e-9, "{apart} s apart");
        }
    }

    #[test]
    fn interpolated_poses_belong_to_the_samples(a in trajectory(), b in trajectory(), gap in setting()) {
        let Ok(matched) = interpolate(&a, &b, Some(gap)) else { return Ok(()) };
        prop_assert_eq!(matched.reference.stamps(), matched.estimate.stamps());
        let (samples, indices, whole) = match matched.sampled {
            Side::Reference => (&matched.reference, matched.reference_indices.unwrap(), &a),
            Side::Estimate => (&matched.estimate, matched.estimate_indices.unwrap(), &b),
        };
        prop_assert_eq!(samples.len(), indices.iter().collect::<HashSet<_>>().len());
        for (position, &index) in indices.iter().enumerate() {
            prop_assert_eq!(samples.stamps()[position], whole.stamps()[index]);
        }
    }

    #[test]
    fn pose_errors_are_finite_or_refused(
        poses in prop::collection::vec((pose(), pose()), 0..25),
        stamps in prop::collection::vec(stamp(), 25),
        xi in setting(),
        delta in prop_oneof![
            setting().prop_map(Delta::Metres),
            (0..30usize).prop_map(Delta::Frames),
            setting().prop_map(Delta::Seconds),
            setting().prop_map(Delta::Radians),
        ],
        all_pairs in any::<bool>(),
        relative_tolerance in setting(),
        from_reference in any::<bool>(),
    ) {
        let (reference, estimate): (Vec<_>, Vec<_>) = poses.into_iter().unzip();
        if let Ok(errors) = pose_errors(&reference, &estimate) {
            for error in &errors {
                prop_assert!(finite(&[error.dx, error.dy, error.longitudinal, error.lateral]), "{error:?}");
                prop_assert!(error.heading() <= std::f64::consts::PI, "{error:?}");
                prop_assert!(error.translation().is_finite(), "{error:?}");
                if let Ok(metric) = WeightedPoseError::new(xi) {
                    prop_assert!(metric.of(error).is_finite(), "{error:?}");
                }
            }
        }
        for alignment in [Alignment::None, Alignment::Origin, Alignment::Rigid] {
            let Ok(errors) = ate(&reference, &estimate, alignment) else { continue };
            prop_assert!(errors.reference_from_estimate.is_finite(), "{alignment:?} {errors:?}");
            for samples in [&errors.translation, &errors.rotation, &errors.full] {
                prop_assert!(finite(samples), "{alignment:?} {errors:?}");
            }
        }
        let pairs_from = if from_reference { PairsFrom::Reference } else { PairsFrom::Estimate };
        let settings = RpeSettings { all_pairs, relative_tolerance, pairs_from, ..RpeSettings::new(delta) };
        let stamped = |poses: &[Pose2]| -> Trajectory {
            stamps.iter().copied().zip(poses.iter().copied()).collect()
        };
        if let Ok(errors) = rpe(&stamped(&reference), &stamped(&estimate), &settings) {
            prop_assert!(errors.pairs.iter().all(|&(i, j)| i < j && j < reference.len()));
            for samples in [&errors.translation, &errors.rotation, &errors.full] {
                prop_assert!(finite(samples), "{errors:?}");
            }
        }
    }

    #[test]
    fn statistics_are_finite_or_refused(a in samples(), b in samples(), margin in setting()) {
        if let Ok(s) = Summary::of(&a) {
            let values = [s.mean, s.std, s.rmse, s.sse, s.min, s.p05, s.p25, s.median, s.p75, s.p95, s.max];
            prop_assert!(finite(&values), "{s:?}");
            prop_assert!([s.min, s.p05, s.p25, s.median, s.p75, s.p95, s.max].is_sorted(), "{s:?}");
            prop_assert!(s.std >= 0.0 && s.rmse >= 0.0, "{s:?}");
        }
        let intervals = [mean_interval(&a), bootstrap_mean(&[&a, &b], 20, mcl_core::Seed::new(1))];
        for found in intervals.into_iter().flatten() {
            prop_assert!(finite(&[found.mean, found.interval.low, found.interval.high]), "{found:?}");
            prop_assert!(found.interval.low <= found.interval.high, "{found:?}");
        }
        if let Ok(found) = standard_deviation(&a) {
            prop_assert!(found.is_finite() && found >= 0.0, "{found}");
        }
        for test in [welch_t_test(&a, &b), paired_t_test(&a, &b)].into_iter().flatten() {
            check_test(&test)?;
        }
        if let Ok(p) = welch_equivalence_p(&a, &b, margin) {
            prop_assert!((0.0..=1.0).contains(&p), "{p}");
        }
    }

    #[test]
    fn statistics_over_blocks_are_finite_or_refused(
        a in samples(),
        b in samples(),
        blocks in 1..6u64,
        margin in setting(),
    ) {
        let blocked = |samples: &[f64], with_units: bool| match with_units {
            true => Blocked::with_units((0..).zip(samples).map(|(i, &x)| (i % blocks, i, x))),
            false => Blocked::new((0..).zip(samples).map(|(i, &x)| (i % blocks, x))),
        };
        for with_units in [true, false] {
            let (Ok(a), Ok(b)) = (blocked(&a, with_units), blocked(&b, with_units)) else { continue };
            for test in [paired(&a, &b), two_sample(&a, &b), one_sample(&a)].into_iter().flatten() {
                check_test(&test)?;
                if let Ok(p) = test.equivalence_p(margin) {
                    prop_assert!((0.0..=1.0).contains(&p), "{p}");
                }
            }
            let bootstrap = a.bootstrap_interval(20, mcl_core::Seed::new(1)).ok();
            for found in [a.mean_interval().ok(), bootstrap].into_iter().flatten() {
                prop_assert!(finite(&[found.mean, found.interval.low, found.interval.high]), "{found:?}");
                prop_assert!(found.interval.low <= found.interval.high, "{found:?}");
            }
            if let Some(correlation) = a.intraclass_correlation() {
                prop_assert!(correlation.is_finite() && correlation <= 1.0 + 1e-9, "{correlation}");
            }
            if let Ok(logs) = a.map(f64::ln) {
                prop_assert!(a.values().all(|(_, value)| value > 0.0) && logs.mean().is_finite());
            }
        }
    }

    #[test]
    fn squared_errors_in_deviations_are_positive_or_refused(
        error in prop::array::uniform3(number()),
        covariance in prop::array::uniform3(prop::array::uniform3(number())),
    ) {
        if let Some(found) = nees(error, covariance) {
            prop_assert!(found.is_finite() && found >= 0.0, "{found}");
        }
    }

    #[test]
    fn outcomes_are_within_the_run(errors in samples(), scans in 0..30usize, above in setting(), below in setting()) {
        let _ = diverged(&errors, &DivergenceSettings { last_scans: scans, limit_m: above });
        let settings = LossSettings { lost_above_m: above, min_scans: scans, recovered_below_m: below };
        if let Ok(episodes) = lost_episodes(&errors, &settings) {
            let mut end = 0;
            for episode in episodes {
                prop_assert!(episode.start >= end, "{episode:?}");
                end = episode.recovered.unwrap_or(errors.len());
                prop_assert!(end > episode.start && end <= errors.len(), "{episode:?}");
            }
        }
    }

    #[test]
    fn tum_files_keep_every_pose_or_refuse(written in trajectory()) {
        let mut text = Vec::new();
        if tum::write(&mut text, &written).is_err() {
            return Ok(());
        }
        let read = match tum::read(&text[..], "written.tum", NonPlanar::Refuse) {
            Ok(read) => read,
            Err(error) => {
                prop_assert!(written.is_empty(), "{error}");
                return Ok(());
            }
        };
        prop_assert_eq!(read.trajectory.stamps(), written.stamps());
        for (a, b) in read.trajectory.poses().iter().zip(written.poses()) {
            prop_assert!(a.x == b.x && a.y == b.y, "{a:?} {b:?}");
            let turned = mcl_core::wrap_angle(a.theta - mcl_core::wrap_angle(b.theta)).abs();
            prop_assert!(turned < 1e-14, "{a:?} {b:?}");
        }
    }
}

/// Found by the property above: the square of such a distance overflowed.
#[test]
fn poses_beyond_all_maps_are_refused() {
    for far in
        [Pose2::new(0.0, f64::MAX, 0.0), Pose2::new(1.1e12, 0.0, 0.0), Pose2::new(0.0, 0.0, 1e300)]
    {
        let message = pose_errors(&[far], &[Pose2::IDENTITY]).unwrap_err().to_string();
        assert!(
            message.starts_with("reference pose 0 is") && message.ends_with("up to 1e12"),
            "{message}"
        );
    }
}
