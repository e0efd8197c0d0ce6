use mcl_core::math;
use serde::Serialize;

use crate::beta;
use crate::error::MetricsError;
use crate::interval::{Interval, MeanInterval};

/// Rate of an event in independent trials. Runs on the same map are not independent: see
/// [`BlockedRate`](crate::BlockedRate).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Rate {
    hits: u64,
    trials: u64,
}

impl Rate {
    /// Creates a rate of `hits` in `trials`.
    ///
    /// # Errors
    /// If there is no trial, or there are more hits than trials.
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

    /// Upper confidence bound of the true rate: the exact one-sided bound of Clopper &
    /// Pearson (1934), a quantile of the beta distribution.
    ///
    /// # Errors
    /// If the confidence is not between 0 and 1.
    pub fn upper_bound(&self, confidence: f64) -> Result<f64, MetricsError> {
        check_confidence(confidence)?;
        Ok(upper_bound(self.hits as f64, self.trials as f64, confidence))
    }

    /// Confidence interval of the true rate: the exact two-sided interval of Clopper & Pearson
    /// (1934), with equal tails.
    ///
    /// # Errors
    /// If the confidence is not between 0 and 1.
    ///
    /// # Example
    /// ```
    /// let interval = mcl_metrics::Rate::new(0, 10)?.interval(0.95)?;
    /// assert_eq!(interval.low, 0.0);
    /// assert!((interval.high - (1.0 - 0.025f64.powf(0.1))).abs() < 1e-12);
    /// # Ok::<(), mcl_metrics::MetricsError>(())
    /// ```
    pub fn interval(&self, confidence: f64) -> Result<Interval, MetricsError> {
        clopper_pearson(self.hits as f64, self.trials as f64, confidence)
    }
}

/// The interval for hits from 0 to trials, which need not be integers.
pub(crate) fn clopper_pearson(
    hits: f64,
    trials: f64,
    confidence: f64,
) -> Result<Interval, MetricsError> {
    check_confidence(confidence)?;
    let one_sided = 0.5 + 0.5 * confidence;
    Ok(Interval {
        low: 1.0 - upper_bound(trials - hits, trials, one_sided),
        high: upper_bound(hits, trials, one_sided),
    })
}

fn upper_bound(hits: f64, trials: f64, confidence: f64) -> f64 {
    if hits >= trials {
        return 1.0;
    }
    beta::quantile(hits + 1.0, trials - hits, confidence)
}

fn check_confidence(found: f64) -> Result<(), MetricsError> {
    if found > 0.0 && found < 1.0 {
        return Ok(());
    }
    Err(MetricsError::Setting { name: "confidence", found, expected: "a number between 0 and 1" })
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
    // Given the total number of hits, the number of those of a is hypergeometric.
    let [of_a, of_b, hits_of_a, hits] =
        [a.trials, b.trials, a.hits, a.hits + b.hits].map(|count| count as f64);
    at_least(hits_of_a, hits, of_a, of_b)
}

/// Fisher's exact test, two-sided: p for "the rates are the same", the probability of all tables that are no more
/// likely than the observed one.
///
/// # Example
/// ```
/// use mcl_metrics::{Rate, fisher_exact};
///
/// // 5 of 38 runs failed here, none of 20 there.
/// let p = fisher_exact(Rate::new(5, 38)?, Rate::new(0, 20)?);
/// assert!((p - 0.153107).abs() < 1e-6);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn fisher_exact(a: Rate, b: Rate) -> f64 {
    /// Relative tolerance for tables that are as likely as the observed one.
    const TIES: f64 = 1e-7;
    let [of_a, of_b, hits_of_a, hits] =
        [a.trials, b.trials, a.hits, a.hits + b.hits].map(|count| count as f64);
    let ln_probability = |of_a_hits: f64| {
        ln_choose(of_a, of_a_hits) + ln_choose(of_b, hits - of_a_hits)
            - ln_choose(of_a + of_b, hits)
    };
    let found = ln_probability(hits_of_a);
    let (least, most) = ((hits - of_b).max(0.0) as u64, hits.min(of_a) as u64);
    let probabilities = (least..=most).map(|count| ln_probability(count as f64));
    let rare = probabilities.filter(|probability| *probability <= found + TIES);
    rare.map(math::exp).sum::<f64>().min(1.0)
}

/// Difference of two rates, a minus b, with the 95 % interval of Newcombe (1998, method 10), which combines the
/// score intervals of both.
///
/// # Example
/// ```
/// use mcl_metrics::{Rate, rate_difference};
///
/// let found = rate_difference(Rate::new(56, 70)?, Rate::new(48, 80)?);
/// assert!((found.mean - 0.2).abs() < 1e-12);
/// assert!((found.interval.low - 0.0524).abs() < 1e-4 && (found.interval.high - 0.3339).abs() < 1e-4);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn rate_difference(a: Rate, b: Rate) -> MeanInterval {
    let share = |rate: Rate| rate.hits as f64 / rate.trials as f64;
    let (of_a, of_b) = (share(a), share(b));
    let ([low_a, high_a], [low_b, high_b]) = (score_interval(a), score_interval(b));
    let mean = of_a - of_b;
    let interval = Interval {
        low: mean - math::hypot(of_a - low_a, high_b - of_b),
        high: mean + math::hypot(high_a - of_a, of_b - low_b),
    };
    MeanInterval { mean, interval }
}

/// Wilson's 95 % interval.
fn score_interval(rate: Rate) -> [f64; 2] {
    /// The 0.975 quantile of the standard normal distribution.
    const Z: f64 = 1.959_963_984_540_054;
    let (hits, trials) = (rate.hits as f64, rate.trials as f64);
    let squared = Z * Z;
    let middle = (hits + 0.5 * squared) / (trials + squared);
    let variance = hits * (trials - hits) / trials + 0.25 * squared;
    let half = Z * variance.sqrt() / (trials + squared);
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

fn ln_choose(n: f64, k: f64) -> f64 {
    math::ln_gamma(n + 1.0) - math::ln_gamma(k + 1.0) - math::ln_gamma(n - k + 1.0)
}

/// The probability that at least `least` of the `hits`, drawn without replacement from all trials, are those of a.
fn at_least(least: f64, hits: f64, of_a: f64, of_b: f64) -> f64 {
    if least > hits.min(of_a) {
        return 0.0;
    }
    // Below the mean, the complement has the smaller terms.
    if least * (of_a + of_b) <= hits * of_a {
        return 1.0 - at_least(hits - least + 1.0, hits, of_b, of_a);
    }
    let ln_first =
        ln_choose(of_a, least) + ln_choose(of_b, hits - least) - ln_choose(of_a + of_b, hits);
    // In units of the first term, which is the largest; after the last possible number the terms are 0.
    let (mut number, mut term, mut sum) = (least, 1.0, 0.0);
    while term > f64::EPSILON * sum {
        sum += term;
        let (left, others) = (of_a - number, of_b - hits + number);
        number += 1.0;
        term *= left * (hits + 1.0 - number) / (number * (others + 1.0));
    }
    (math::exp(ln_first) * sum).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(hits: usize, trials: usize) -> Rate {
        Rate::new(hits, trials).unwrap()
    }

    /// Source: SciPy 1.17.1, `fisher_exact([[a, n_a - a], [b, n_b - b]], alternative='greater')`;
    /// the last three are exact sums of fractions.
    #[test]
    fn fisher_agrees_with_scipy() {
        for (a, b, expected) in [
            (rate(8, 10), rate(1, 6), 0.024475524475524483),
            (rate(3, 80), rate(1, 640), 0.004877719523030609),
            (rate(40, 80), rate(3, 640), 1.3910839253319456e-39),
            (rate(0, 10), rate(0, 10), 1.0),
            (rate(0, 10), rate(5, 15), 1.0),
            (rate(10, 10), rate(10, 10), 1.0),
            (rate(2, 40), rate(30, 50), 0.9999999994861632),
            (rate(3, 40), rate(4, 50), 0.6803607072323373),
            (rate(200, 2000), rate(300, 1000), 1.0),
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

    /// Source: SciPy 1.17.1, `beta.ppf(0.025, x, n - x + 1)` and `beta.isf(0.025, x + 1, n - x)`; whole
    /// numbers are also those of `binomtest(x, n).proportion_ci()`.
    #[test]
    fn intervals_agree_with_scipy() {
        for (hits, trials, low, high) in [
            (0.0, 10.0, 0.0, 0.30849710781876083),
            (1.0, 10.0, 0.0025285785444617848, 0.4450161170281953),
            (3.0, 10.0, 0.06673951117773447, 0.6524528500599973),
            (10.0, 10.0, 0.6915028921812392, 1.0),
            (3.0, 640.0, 0.0009677203547355173, 0.013637262668160857),
            (0.5, 7.2, 6.587150100131404e-05, 0.49065305942589915),
            (9.95, 10.0, 0.6836428666698025, 1.0),
        ] {
            let found = clopper_pearson(hits, trials, 0.95).unwrap();
            assert!((found.low - low).abs() < 1e-12, "{hits} of {trials}: {found:?}");
            assert!((found.high - high).abs() < 1e-12, "{hits} of {trials}: {found:?}");
        }
        assert_eq!(rate(3, 10).interval(0.95), clopper_pearson(3.0, 10.0, 0.95));
    }

    /// Source: SciPy 1.17.1, `fisher_exact([[x, n - x], [y, m - y]])`.
    #[test]
    fn two_sided_fisher_agrees_with_scipy() {
        for (a, b, expected) in [
            (rate(8, 10), rate(1, 6), 0.034965034965034975),
            (rate(5, 38), rate(0, 20), 0.15310742896949792),
            (rate(0, 5), rate(0, 7), 1.0),
            (rate(3, 3), rate(0, 4), 0.028571428571428567),
            (rate(12, 40), rate(25, 60), 0.2924968225902455),
            (rate(5, 5), rate(5, 5), 1.0),
            (rate(2, 9), rate(7, 11), 0.09228387711359848),
        ] {
            for found in [fisher_exact(a, b), fisher_exact(b, a)] {
                assert!((found - expected).abs() < 1e-12, "{a:?} {b:?}: {found}");
            }
        }
    }

    /// Without any failure, the interval is as wide as the score intervals.
    #[test]
    fn differences_of_rates_at_the_ends() {
        let none = rate_difference(rate(0, 20), rate(0, 20));
        assert!(none.mean == 0.0 && (none.interval.high + none.interval.low).abs() < 1e-15);
        assert!((none.interval.high - 0.1611).abs() < 1e-4, "{none:?}");
        let all = rate_difference(rate(20, 20), rate(0, 20));
        assert!(all.interval.high == 1.0 && all.interval.low < 0.8, "{all:?}");
    }

    #[test]
    fn impossible_rates_are_refused() {
        assert!(Rate::new(0, 0).is_err() && Rate::new(3, 2).is_err());
        assert!(rate(1, 2).upper_bound(1.0).is_err() && rate(1, 2).upper_bound(f64::NAN).is_err());
    }
}
