use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};
use statrs::stats_tests::Alternative;
use statrs::stats_tests::fisher::fishers_exact;

use crate::MetricsError;

/// How often something happened in independent trials: diverged runs of all runs, say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Rate {
    hits: u64,
    trials: u64,
}

impl Rate {
    /// `hits` of `trials`.
    ///
    /// # Errors
    /// When there is no trial, or there are more hits than trials.
    ///
    /// # Example
    /// ```
    /// let none = mcl_metrics::Rate::new(0, 100)?;
    /// // Nothing seen in 100 trials: at most 1 − 0.01^(1/100) = 4.5 % with 99 % confidence.
    /// assert!((none.upper_bound(0.99)? - 0.045007).abs() < 1e-6);
    /// # Ok::<(), mcl_metrics::MetricsError>(())
    /// ```
    pub fn new(hits: usize, trials: usize) -> Result<Self, MetricsError> {
        if trials == 0 {
            return Err(MetricsError::TooFew { what: "trials", found: 0, needed: 1 });
        }
        if hits > trials {
            let expected = "at most the number of trials";
            return Err(MetricsError::Setting { name: "hits", found: hits as f64, expected });
        }
        Ok(Rate { hits: hits as u64, trials: trials as u64 })
    }

    /// Number of hits.
    pub fn hits(&self) -> u64 {
        self.hits
    }

    /// Number of trials, at least 1.
    pub fn trials(&self) -> u64 {
        self.trials
    }

    /// What the true rate is at most, with this confidence: the exact one-sided bound of Clopper &
    /// Pearson (1934), a quantile of the beta distribution.
    ///
    /// # Errors
    /// When the confidence is not between 0 and 1.
    pub fn upper_bound(&self, confidence: f64) -> Result<f64, MetricsError> {
        if !(confidence > 0.0 && confidence < 1.0) {
            let expected = "a number between 0 and 1";
            return Err(MetricsError::Setting { name: "confidence", found: confidence, expected });
        }
        if self.hits == self.trials {
            return Ok(1.0);
        }
        let shapes = ((self.hits + 1) as f64, (self.trials - self.hits) as f64);
        let beta = Beta::new(shapes.0, shapes.1).expect("shapes of at least 1");
        Ok(beta.inverse_cdf(confidence))
    }
}

/// Fisher's exact test (Fisher 1922), one-sided: p for "the rate of a is greater than that of b".
///
/// # Example
/// ```
/// use mcl_metrics::{Rate, fisher_exact_greater};
///
/// let p = fisher_exact_greater(Rate::new(8, 10)?, Rate::new(1, 6)?);
/// assert!((p - 0.024476).abs() < 1e-6);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn fisher_exact_greater(a: Rate, b: Rate) -> f64 {
    let table = [a.hits, a.trials - a.hits, b.hits, b.trials - b.hits];
    fishers_exact(&table, Alternative::Greater).expect("a rate's hits are among its trials")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(hits: usize, trials: usize) -> Rate {
        Rate::new(hits, trials).unwrap()
    }

    /// Source: SciPy 1.17.1, `fisher_exact([[a, n_a - a], [b, n_b - b]], alternative='greater')`.
    #[test]
    fn fisher_agrees_with_scipy() {
        for (a, b, expected) in [
            (rate(8, 10), rate(1, 6), 0.024475524475524483),
            (rate(3, 80), rate(1, 640), 0.004877719523030609),
            (rate(40, 80), rate(3, 640), 1.3910839253319456e-39),
            (rate(0, 10), rate(0, 10), 1.0),
            (rate(0, 10), rate(5, 15), 1.0),
            (rate(10, 10), rate(10, 10), 1.0),
        ] {
            let found = fisher_exact_greater(a, b);
            assert!((found / expected - 1.0).abs() < 1e-9, "{a:?} {b:?}: {found:e}");
        }
    }

    /// Source: SciPy 1.17.1, `beta.ppf(0.99, hits + 1, trials - hits)`.
    #[test]
    fn bounds_agree_with_scipy() {
        for (rate, expected) in [
            (rate(0, 640), 0.0071697522231626825),
            (rate(3, 640), 0.015609333017812137),
            (rate(1, 4), 0.859132457305454),
            (rate(0, 1), 0.99),
            (rate(50, 100), 0.6192825330930475),
            (rate(4, 4), 1.0),
        ] {
            let found = rate.upper_bound(0.99).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-9, "{rate:?}: {found}");
        }
    }

    #[test]
    fn impossible_rates_are_refused() {
        assert!(Rate::new(0, 0).is_err() && Rate::new(3, 2).is_err());
        assert!(rate(1, 2).upper_bound(1.0).is_err() && rate(1, 2).upper_bound(f64::NAN).is_err());
    }
}
