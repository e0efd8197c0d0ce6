use mcl_core::math;
use serde::Serialize;

use crate::error::{MetricsError, check_runs, check_samples};

/// Summary statistics of samples; all except the count and `sse` are in the unit of the samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Number of samples.
    pub count: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation of the samples (divided by n, as in numpy and evo, not by n − 1).
    pub std: f64,
    /// Root mean square.
    pub rmse: f64,
    /// Sum of squares.
    pub sse: f64,
    /// Smallest sample.
    pub min: f64,
    /// 5th percentile. Percentiles are interpolated linearly between neighbouring samples (numpy's default;
    /// type 7 of Hyndman & Fan 1996).
    pub p05: f64,
    /// 25th percentile.
    pub p25: f64,
    /// 50th percentile; for an even number of samples the mean of the middle two.
    pub median: f64,
    /// 75th percentile.
    pub p75: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest sample.
    pub max: f64,
}

impl Summary {
    /// Summarizes samples in any order.
    ///
    /// # Errors
    /// If there is no sample, or one is not finite (or not below 10¹⁴⁰ in magnitude).
    ///
    /// # Example
    /// ```
    /// let summary = mcl_metrics::Summary::of(&[3.0, 1.0, 2.0, 6.0])?;
    /// assert_eq!((summary.mean, summary.median, summary.max), (3.0, 2.5, 6.0));
    /// # Ok::<(), mcl_metrics::MetricsError>(())
    /// ```
    pub fn of(samples: &[f64]) -> Result<Self, MetricsError> {
        check_samples(samples, 1)?;
        Ok(summarize(samples.to_vec()))
    }

    /// Summarizes the samples of all runs together, so that a long run has more weight than a short one.
    ///
    /// # Errors
    /// If there is no run, or a run has no sample or one that is not finite.
    pub fn pooled<R: AsRef<[f64]>>(runs: &[R]) -> Result<Self, MetricsError> {
        check_runs(runs, 1)?;
        Ok(summarize(runs.iter().flat_map(|run| run.as_ref()).copied().collect()))
    }
}

fn summarize(mut samples: Vec<f64>) -> Summary {
    let count = samples.len() as f64;
    let sum = |of: &dyn Fn(f64) -> f64| samples.iter().map(|&sample| of(sample)).sum::<f64>();
    let mean = sum(&|sample| sample) / count;
    let sse = sum(&|sample| sample * sample);
    let std = (sum(&|sample| math::square(sample - mean)) / count).sqrt();
    samples.sort_unstable_by(f64::total_cmp);
    Summary {
        count: samples.len(),
        mean,
        std,
        rmse: (sse / count).sqrt(),
        sse,
        min: samples[0],
        p05: percentile(&samples, 5.0),
        p25: percentile(&samples, 25.0),
        median: percentile(&samples, 50.0),
        p75: percentile(&samples, 75.0),
        p95: percentile(&samples, 95.0),
        max: samples[samples.len() - 1],
    }
}

/// Percentile of ascending samples, at least one.
pub(crate) fn percentile(sorted: &[f64], percent: f64) -> f64 {
    let position = percent / 100.0 * (sorted.len() - 1) as f64;
    let below = sorted[position.floor() as usize];
    let above = sorted[position.ceil() as usize];
    below + (above - below) * position.fract()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Source: NumPy 2.4.6, `np.percentile(a, [5, 25, 50, 75, 95])`, `np.std(a)`.
    #[test]
    fn agrees_with_numpy() {
        let summary = Summary::of(&[0.3, -1.2, 4.5, 2.2, 0.9, 7.1, 3.3]).unwrap();
        let expected = [-0.75, 0.6000000000000001, 2.2, 3.9, 6.3199999999999985];
        let found = [summary.p05, summary.p25, summary.median, summary.p75, summary.p95];
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() < 1e-14, "{a} {b}");
        }
        assert!((summary.std - 2.5900122133507635).abs() < 1e-14, "{}", summary.std);
        assert_eq!((summary.min, summary.max, summary.count), (-1.2, 7.1, 7));
    }

    #[test]
    fn samples_that_are_not_numbers_are_named() {
        let message = Summary::of(&[1.0, f64::NAN]).unwrap_err().to_string();
        assert_eq!(message, "sample 1 is NaN, expected a finite number of magnitude below 1e140");
        let runs = [vec![1.0], vec![2.0, 3.0, f64::INFINITY]];
        let message = Summary::pooled(&runs).unwrap_err().to_string();
        assert!(message.starts_with("run 1: sample 2 is inf, expected"), "{message}");
        assert!(Summary::of(&[1e200]).is_err());
        assert_eq!(
            Summary::of(&[]).unwrap_err().to_string(),
            "samples: found 0, expected at least 1"
        );
        let message = Summary::pooled(&[vec![1.0], vec![]]).unwrap_err().to_string();
        assert_eq!(message, "run 1: samples: found 0, expected at least 1");
    }

    #[test]
    fn a_long_run_counts_more() {
        assert_eq!(Summary::pooled(&[vec![1.0, 1.0, 1.0], vec![5.0]]).unwrap().mean, 2.0);
    }

    proptest! {
        #[test]
        fn pooled_is_the_summary_of_all_samples(
            runs in prop::collection::vec(prop::collection::vec(-10.0..10.0f64, 1..20), 1..8),
        ) {
            let pooled = Summary::pooled(&runs).unwrap();
            prop_assert_eq!(pooled, Summary::of(&runs.concat()).unwrap());
            let s = pooled;
            prop_assert!([s.min, s.p05, s.p25, s.median, s.p75, s.p95, s.max].is_sorted());
            let mean_square = s.mean * s.mean + s.std * s.std;
            prop_assert!((s.rmse * s.rmse - mean_square).abs() < 1e-12);
        }
    }
}
