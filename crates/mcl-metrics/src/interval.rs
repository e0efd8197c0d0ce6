use mcl_core::{Seed, math};
use rand::RngExt;
use serde::Serialize;

use crate::error::{MetricsError, check_runs, check_samples};
use crate::student_t::critical_value_95;
use crate::summary::percentile;

/// A confidence interval, in the unit of the samples; 95 %, unless a function has a confidence argument.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

/// A mean and its 95 % confidence interval, in the unit of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeanInterval {
    /// Mean of the samples.
    pub mean: f64,
    /// 95 % confidence interval of the true mean.
    pub interval: Interval,
}

/// Mean of independent samples with Student's t interval, `mean ± t₀.₉₇₅ · s/√n`, for example one likelihood per
/// map. Runs on one map are not independent; for them see
/// [`Blocked::mean_interval`](crate::Blocked::mean_interval).
///
/// # Errors
/// If there are fewer than two samples, or one is not finite.
///
/// # Example
/// ```
/// let found = mcl_metrics::mean_interval(&[1.0, 2.0, 3.0])?;
/// assert_eq!(found.mean, 2.0);
/// // t₀.₉₇₅ = 4.3027 with 2 degrees of freedom, s/√n = 1/√3
/// assert!((found.interval.high - (2.0 + 4.302_652_729_8 / 3_f64.sqrt())).abs() < 1e-9);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn mean_interval(samples: &[f64]) -> Result<MeanInterval, MetricsError> {
    check_samples(samples, 2)?;
    Ok(student_mean(samples))
}

/// Student's t interval of at least two samples.
pub(crate) fn student_mean(samples: &[f64]) -> MeanInterval {
    let moments = Moments::of(samples);
    let standard_error = moments.squared_standard_error().sqrt();
    let interval = student_interval(moments.mean, standard_error, moments.count - 1.0);
    MeanInterval { mean: moments.mean, interval }
}

/// Estimated standard deviation of the population: the sum of squares divided by n − 1
/// (that of the samples, divided by n, is [`Summary::std`](crate::Summary)).
///
/// # Errors
/// If there are fewer than two samples, or one is not finite.
pub fn standard_deviation(samples: &[f64]) -> Result<f64, MetricsError> {
    check_samples(samples, 2)?;
    Ok(Moments::of(samples).variance.sqrt())
}

pub(crate) fn student_interval(center: f64, standard_error: f64, freedom: f64) -> Interval {
    let half = critical_value_95(freedom) * standard_error;
    Interval { low: center - half, high: center + half }
}

/// Mean of at least one sample. Samples are summed relative to the first, so that the mean of equal samples
/// is exact.
pub(crate) fn mean(samples: &[f64]) -> f64 {
    let offsets: f64 = samples.iter().map(|sample| sample - samples[0]).sum();
    samples[0] + offsets / samples.len() as f64
}

/// Mean and unbiased variance of samples.
pub(crate) struct Moments {
    pub count: f64,
    pub mean: f64,
    /// Sum of squares divided by n − 1.
    pub variance: f64,
}

impl Moments {
    /// Computes the moments of at least two samples. The variance of equal samples is exactly 0.
    pub fn of(samples: &[f64]) -> Self {
        let (mean, count) = (mean(samples), samples.len() as f64);
        let squares: f64 = samples.iter().map(|sample| math::square(sample - mean)).sum();
        Moments { count, mean, variance: squares / (count - 1.0) }
    }

    pub fn squared_standard_error(&self) -> f64 {
        self.variance / self.count
    }
}

/// Mean of the pooled samples of all runs, with the percentile interval of a bootstrap over runs
/// (Efron & Tibshirani 1993, ch. 13): `resamples` times, whole runs are drawn with replacement, as many as there are,
/// and their samples pooled. The runs must be independent of each other. Runs on one map are not; for them see
/// [`Blocked::bootstrap_interval`](crate::Blocked::bootstrap_interval).
/// The draws depend only on `seed`, not on the number of threads.
///
/// # Errors
/// If there are fewer than two runs, a run has no sample or one that is not finite, or `resamples`
/// is 0.
///
/// # Example
/// ```
/// use mcl_core::Seed;
/// use mcl_metrics::bootstrap_mean;
///
/// let runs = [vec![0.02, 0.03], vec![0.03, 0.05, 0.04], vec![0.02]];
/// let found = bootstrap_mean(&runs, 1000, Seed::new(1).derive("bootstrap"))?;
/// assert!(found.interval.low <= found.mean && found.mean <= found.interval.high);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn bootstrap_mean<R: AsRef<[f64]>>(
    runs: &[R],
    resamples: usize,
    seed: Seed,
) -> Result<MeanInterval, MetricsError> {
    check_runs(runs, 2)?;
    let totals: Vec<(f64, f64)> = runs
        .iter()
        .map(|run| (run.as_ref().iter().sum::<f64>(), run.as_ref().len() as f64))
        .collect();
    resample_groups(&totals, resamples, seed)
}

/// The bootstrap over groups of samples, at least one, each given by its sum and its count.
pub(crate) fn resample_groups(
    totals: &[(f64, f64)],
    resamples: usize,
    seed: Seed,
) -> Result<MeanInterval, MetricsError> {
    if resamples == 0 {
        let expected = "at least 1 (1,000 or more for steady bounds)";
        return Err(MetricsError::Setting { name: "resamples", found: 0.0, expected });
    }
    let pooled_mean = |draws: &mut dyn Iterator<Item = usize>| {
        let (sum, count) = draws.fold((0.0, 0.0), |(sum, count), group| {
            (sum + totals[group].0, count + totals[group].1)
        });
        sum / count
    };
    let mut rng = seed.rng();
    let mut means: Vec<f64> = (0..resamples)
        .map(|_| pooled_mean(&mut (0..totals.len()).map(|_| rng.random_range(0..totals.len()))))
        .collect();
    means.sort_unstable_by(f64::total_cmp);
    Ok(MeanInterval {
        mean: pooled_mean(&mut (0..totals.len())),
        interval: Interval { low: percentile(&means, 2.5), high: percentile(&means, 97.5) },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn seed() -> Seed {
        Seed::new(3).derive("bootstrap")
    }

    #[test]
    fn standard_deviation_divides_by_one_less() {
        assert_eq!(standard_deviation(&[1.0, 3.0]), Ok(2.0f64.sqrt()));
        assert!(standard_deviation(&[1.0]).is_err());
    }

    /// Source: SciPy 1.17.1, `scipy.stats.ttest_1samp(a, 0).confidence_interval()`.
    #[test]
    fn student_interval_agrees_with_scipy() {
        let found = mean_interval(&[-2.31, -2.28, -2.35, -2.30, -2.27, -2.33]).unwrap();
        let expected = Interval { low: -2.3382661246863443, high: -2.275067208646988 };
        assert!((found.interval.low - expected.low).abs() < 1e-12, "{found:?}");
        assert!((found.interval.high - expected.high).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn equal_samples_leave_no_doubt() {
        let found = mean_interval(&[0.1; 7]).unwrap();
        assert_eq!((found.mean, found.interval), (0.1, Interval { low: 0.1, high: 0.1 }));
        let error = mean_interval(&[0.1]).unwrap_err();
        assert_eq!(error.to_string(), "samples: found 1, expected at least 2");
    }

    /// With two runs a resample is (a, a), (a, b) twice, or (b, b): the bounds are the runs' means.
    #[test]
    fn whole_runs_are_resampled() {
        let runs = [vec![0.0, 0.2], vec![0.9, 1.0, 1.1]];
        let found = bootstrap_mean(&runs, 2000, seed()).unwrap();
        assert!((found.mean - 0.64).abs() < 1e-15, "{found:?}");
        assert!((found.interval.low - 0.1).abs() < 1e-15, "{found:?}");
        assert!((found.interval.high - 1.0).abs() < 1e-15, "{found:?}");
    }

    /// Of n standard normal means, the bootstrap interval is close to the normal ±1.96/√n.
    #[test]
    fn width_follows_the_spread_of_the_runs() {
        let runs: Vec<Vec<f64>> =
            (0..400).map(|i| vec![if i % 2 == 0 { 1.0 } else { -1.0 }; 3]).collect();
        let Interval { low, high } = bootstrap_mean(&runs, 4000, seed()).unwrap().interval;
        assert!(
            (low + 1.96 / 20.0).abs() < 0.006 && (high - 1.96 / 20.0).abs() < 0.006,
            "{low} {high}"
        );
    }

    /// Pinned values, so that no dependency can silently change results.
    #[test]
    fn draws_are_stable() {
        let runs: Vec<Vec<f64>> = (0..9).map(|i| vec![f64::from(i * i)]).collect();
        let found = bootstrap_mean(&runs, 101, seed()).unwrap().interval;
        assert_eq!(found, bootstrap_mean(&runs, 101, seed()).unwrap().interval);
        assert_ne!(found, bootstrap_mean(&runs, 101, Seed::new(4)).unwrap().interval);
        assert_eq!(found, Interval { low: 14.277777777777779, high: 35.0 });
    }

    #[test]
    fn what_cannot_be_resampled_says_why() {
        let error = bootstrap_mean(&[vec![1.0]], 100, seed()).unwrap_err();
        assert_eq!(error.to_string(), "runs: found 1, expected at least 2");
        let error = bootstrap_mean(&[vec![1.0], vec![2.0]], 0, seed()).unwrap_err();
        assert!(error.to_string().starts_with("resamples is 0, expected at least 1"), "{error}");
        assert!(bootstrap_mean(&[vec![1.0], vec![]], 100, seed()).is_err());
    }

    proptest! {
        /// A resampled mean lies on either side of the mean with probability at least 1/13
        /// (Feige 2006, SIAM J. Comput. 35(4), theorem 1), far more than 2.5 %.
        #[test]
        fn bootstrap_contains_the_mean(
            runs in prop::collection::vec(prop::collection::vec(-10.0..10.0f64, 1..6), 2..12),
        ) {
            let MeanInterval { mean, interval } = bootstrap_mean(&runs, 1000, seed()).unwrap();
            prop_assert!(interval.low <= mean + 1e-12 && mean <= interval.high + 1e-12);
            prop_assert!((mean - crate::summary::Summary::pooled(&runs).unwrap().mean).abs() < 1e-12);
        }
    }
}
