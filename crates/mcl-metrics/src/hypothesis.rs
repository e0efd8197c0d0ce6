use serde::Serialize;

use crate::error::{MetricsError, check_samples};
use crate::interval::{Interval, Moments, student_interval};
use crate::student_t::upper_tail;

/// Result of a t test of "the means of a and b are the same": the difference of the means and its significance.
///
/// For samples without any spread, the test degenerates: with equal means t = 0, the two-sided p is
/// 1 and each one-sided p is ½; with different means t = ±∞, and p is 0 for the observed direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Effect {
    /// Mean of a minus mean of b (paired: mean of the differences a − b), in the unit of the samples.
    pub mean_difference: f64,
    /// Standard error of the mean difference.
    pub standard_error: f64,
    /// The test statistic: mean difference over its standard error.
    pub t: f64,
    /// Degrees of freedom; not an integer for Welch's test.
    pub degrees_of_freedom: f64,
    /// Probability of a |t| at least this large if the means are the same.
    pub p_two_sided: f64,
    /// One-sided p for "the mean of a is less than that of b": small when a is clearly less.
    pub p_less: f64,
    /// One-sided p for "the mean of a is greater than that of b": small when a is clearly greater.
    pub p_greater: f64,
    /// 95 % confidence interval of the mean difference.
    pub interval: Interval,
    /// Number of independent samples of a and of b; in a paired test twice the same number of pairs.
    pub blocks: [usize; 2],
}

impl Effect {
    /// Equivalence test by two one-sided tests (Schuirmann 1987) of "the means of a and b differ by less than
    /// `margin`": the larger p of "the difference is above −margin" and "below margin". Small if the means are
    /// practically equal; a large p of a t test does not show that.
    ///
    /// # Errors
    /// If the margin is not a positive number.
    ///
    /// # Example
    /// ```
    /// use mcl_metrics::{Blocked, two_sample};
    ///
    /// let draws = |values: [f64; 4]| Blocked::new((0..).zip(values));
    /// let a = draws([4.10, 4.11, 4.09, 4.10])?;
    /// let b = draws([4.12, 4.13, 4.12, 4.14])?;
    /// let effect = two_sample(&a, &b)?;
    /// assert!(effect.equivalence_p(0.1)? < 0.001);
    /// assert!(effect.equivalence_p(0.01)? > 0.5);
    /// # Ok::<(), mcl_metrics::MetricsError>(())
    /// ```
    pub fn equivalence_p(&self, margin: f64) -> Result<f64, MetricsError> {
        if !(margin.is_finite() && margin > 0.0) {
            let expected = "a positive number";
            return Err(MetricsError::Setting { name: "margin", found: margin, expected });
        }
        let moved = |by: f64| {
            effect(
                self.mean_difference + by,
                self.standard_error,
                self.degrees_of_freedom,
                self.blocks,
            )
        };
        Ok(moved(margin).p_greater.max(moved(-margin).p_less))
    }
}

/// Welch's t test of two independent samples, which may differ in size and variance (Welch 1947,
/// degrees of freedom by Satterthwaite 1946). Runs on one map are not independent: see
/// [`two_sample`](crate::two_sample).
///
/// # Errors
/// If a side has fewer than two samples, or a sample is not finite.
///
/// # Example
/// ```
/// use mcl_metrics::welch_t_test;
///
/// let random = [0.041, 0.043, 0.039, 0.044];
/// let grid = [0.025, 0.022, 0.024, 0.023, 0.025];
/// let test = welch_t_test(&grid, &random)?;
/// assert!(test.mean_difference < 0.0 && test.p_less < 1e-4);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn welch_t_test(a: &[f64], b: &[f64]) -> Result<Effect, MetricsError> {
    check_both(a, b)?;
    Ok(welch(a, b))
}

/// Welch's test of at least two samples each.
pub(crate) fn welch(a: &[f64], b: &[f64]) -> Effect {
    let counts = [a.len(), b.len()];
    let (a, b) = (Moments::of(a), Moments::of(b));
    let (var_a, var_b) = (a.squared_standard_error(), b.squared_standard_error());
    let squared_error = var_a + var_b;
    let freedom = if squared_error > 0.0 {
        // Satterthwaite's formula in shares of the variance, so that no square underflows.
        let (share_a, share_b) = (var_a / squared_error, var_b / squared_error);
        1.0 / (share_a * share_a / (a.count - 1.0) + share_b * share_b / (b.count - 1.0))
    } else {
        a.count + b.count - 2.0
    };
    effect(a.mean - b.mean, squared_error.sqrt(), freedom, counts)
}

/// Paired t test: a\[i\] and b\[i\] were measured under the same conditions, so their differences are
/// tested. The differences must be independent of each other. Those of runs on one map are not: see
/// [`paired`](crate::paired).
///
/// # Errors
/// If the numbers of samples differ or are below two, or a sample is not finite.
pub fn paired_t_test(a: &[f64], b: &[f64]) -> Result<Effect, MetricsError> {
    if a.len() != b.len() {
        return Err(MetricsError::LengthMismatch {
            left: "samples of a:",
            left_count: a.len(),
            right: "samples of b:",
            right_count: b.len(),
        });
    }
    check_both(a, b)?;
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    Ok(of_differences(&differences))
}

/// t test of "the mean of the differences is 0", for at least two differences.
pub(crate) fn of_differences(differences: &[f64]) -> Effect {
    let moments = Moments::of(differences);
    let standard_error = moments.squared_standard_error().sqrt();
    effect(moments.mean, standard_error, moments.count - 1.0, [differences.len(); 2])
}

/// [`Effect::equivalence_p`] of Welch's test.
///
/// # Errors
/// If the margin is not a positive number, a side has fewer than two samples, or a sample is not
/// finite.
pub fn welch_equivalence_p(a: &[f64], b: &[f64], margin: f64) -> Result<f64, MetricsError> {
    welch_t_test(a, b)?.equivalence_p(margin)
}

fn check_both(a: &[f64], b: &[f64]) -> Result<(), MetricsError> {
    check_samples(a, 2).map_err(|error| error.within("a"))?;
    check_samples(b, 2).map_err(|error| error.within("b"))
}

fn effect(mean_difference: f64, standard_error: f64, freedom: f64, blocks: [usize; 2]) -> Effect {
    // For 0/0, without any difference, there is nothing to reject.
    let t = if mean_difference == 0.0 { 0.0 } else { mean_difference / standard_error };
    let tail = upper_tail(t, freedom);
    let (p_less, p_greater) = if t < 0.0 { (tail, 1.0 - tail) } else { (1.0 - tail, tail) };
    Effect {
        mean_difference,
        standard_error,
        t,
        degrees_of_freedom: freedom,
        p_two_sided: 2.0 * tail,
        p_less,
        p_greater,
        interval: student_interval(mean_difference, standard_error, freedom),
        blocks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const A: [f64; 5] = [0.041, 0.043, 0.039, 0.044, 0.0405];
    const B: [f64; 7] = [0.0252, 0.0221, 0.0243, 0.0229, 0.0249, 0.0260, 0.0218];

    fn ramp(count: usize, offset: f64, step: f64, stride: usize, modulus: usize) -> Vec<f64> {
        (0..count).map(|i| offset + step * ((i * stride) % modulus) as f64).collect()
    }

    /// `expected`: t, df, two-sided p, p_less, p_greater, low, high; relative tolerance 10⁻¹⁰.
    fn assert_close(test: &Effect, expected: [f64; 7]) {
        let found = [
            test.t,
            test.degrees_of_freedom,
            test.p_two_sided,
            test.p_less,
            test.p_greater,
            test.interval.low,
            test.interval.high,
        ];
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() <= 1e-10 * expected.abs(),
                "{found} is not {expected}"
            );
        }
    }

    /// Source: SciPy 1.17.1, `ttest_ind(a, b, equal_var=False, alternative=…)` and its
    /// `confidence_interval()`.
    #[test]
    #[rustfmt::skip]
    fn welch_agrees_with_scipy() {
        assert_close(
            &welch_t_test(&A, &B).unwrap(),
            [
                16.223684210526322, 7.555315068096068, 3.8157458187389315e-07, 0.999999809212709,
                1.9078729093694657e-07, 0.015084740899194567, 0.020143830529376846,
            ],
        );
        let far = welch_t_test(&ramp(60, 0.0, 0.01, 7, 11), &ramp(40, 1.0, 0.013, 5, 13)).unwrap();
        assert_close(
            &far,
            [
                -114.58599225575811, 60.25306915641263, 3.212303429021756e-72, 1.606151714510878e-72,
                1.0, -1.0437903645405853, -1.0079763021260812,
            ],
        );
        // One side without spread needs no special case.
        assert_close(
            &welch_t_test(&[1.0, 2.0, 4.0], &[3.0; 4]).unwrap(),
            [
                -0.7559289460184544, 2.0, 0.5285954792089683, 0.26429773960448416,
                0.7357022603955159, -4.4612497002634255, 3.1279163669300925,
            ],
        );
    }

    /// Source: SciPy 1.17.1, `ttest_rel(a, b, alternative=…)` and its `confidence_interval()`.
    #[test]
    #[rustfmt::skip]
    fn paired_agrees_with_scipy() {
        assert_close(
            &paired_t_test(&A, &B[..5]).unwrap(),
            [
                12.65237945967256, 4.0, 0.0002246928400415711, 0.9998876535799792,
                0.00011234642002078555, 0.013753457512121505, 0.021486542487878495,
            ],
        );
        let far = paired_t_test(&ramp(40, 0.0, 0.01, 7, 11), &ramp(40, 1.0, 0.013, 5, 13)).unwrap();
        assert_close(
            &far,
            [
                -117.56039462797835, 39.0, 2.322315746863437e-51, 1.1611578734317185e-51,
                1.0, -1.0431951489432991, -1.0079048510567008,
            ],
        );
    }

    /// Source: SciPy 1.17.1, the larger p of `ttest_ind(a + margin, b, equal_var=False,
    /// alternative='greater')` and `ttest_ind(a - margin, b, equal_var=False, alternative='less')`.
    #[test]
    fn equivalence_agrees_with_scipy() {
        for (margin, expected) in [
            (0.02, 0.030592757726872925),
            (0.01, 0.9999269085379129),
            (0.1, 1.8123543910883694e-12),
        ] {
            let found = welch_equivalence_p(&A, &B, margin).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-9, "{margin}: {found:e}");
            let swapped = welch_equivalence_p(&B, &A, margin).unwrap();
            assert!((swapped / expected - 1.0).abs() < 1e-9, "{margin}: {swapped:e}");
        }
        assert!(welch_equivalence_p(&A, &B, 0.0).is_err());
        assert!(welch_equivalence_p(&A, &[1.0], 0.1).is_err());
    }

    #[test]
    fn samples_without_spread() {
        let equal = welch_t_test(&[0.1; 3], &[0.1; 7]).unwrap();
        assert_eq!(
            (equal.t, equal.p_two_sided, equal.p_less, equal.p_greater),
            (0.0, 1.0, 0.5, 0.5)
        );
        assert_eq!(equal.degrees_of_freedom, 8.0);
        let below = welch_t_test(&[0.1; 3], &[0.2; 3]).unwrap();
        assert_eq!(below.t, f64::NEG_INFINITY);
        assert_eq!((below.p_two_sided, below.p_less, below.p_greater), (0.0, 0.0, 1.0));
        assert_eq!(below.interval, Interval { low: -0.1, high: -0.1 });
        let above = paired_t_test(&[3.0, 2.0], &[2.0, 1.0]).unwrap();
        assert_eq!((above.t, above.p_two_sided), (f64::INFINITY, 0.0));
        assert_eq!((above.p_less, above.p_greater), (1.0, 0.0));
        assert_eq!(paired_t_test(&A, &A).unwrap().p_two_sided, 1.0);
    }

    #[test]
    fn what_cannot_be_tested_says_why() {
        let message = |result: Result<Effect, MetricsError>| result.unwrap_err().to_string();
        assert_eq!(message(welch_t_test(&A, &[1.0])), "b: samples: found 1, expected at least 2");
        assert!(message(welch_t_test(&[1.0, f64::NAN], &A)).starts_with("a: sample 1 is NaN"));
        assert_eq!(
            message(paired_t_test(&A, &B)),
            "samples of a: 5 but samples of b: 7, expected equal numbers, because they form pairs"
        );
        assert!(paired_t_test(&[1.0], &[2.0]).is_err());
    }

    proptest! {
        #[test]
        fn swapping_the_sides_mirrors_the_result(
            a in prop::collection::vec(-5.0..5.0f64, 2..20),
            b in prop::collection::vec(-5.0..5.0f64, 2..20),
        ) {
            let n = a.len().min(b.len());
            for (ab, ba) in [
                (welch_t_test(&a, &b).unwrap(), welch_t_test(&b, &a).unwrap()),
                (paired_t_test(&a[..n], &b[..n]).unwrap(), paired_t_test(&b[..n], &a[..n]).unwrap()),
            ] {
                prop_assert!((ab.t + ba.t).abs() <= 1e-9 * ab.t.abs());
                prop_assert!((ab.p_less - ba.p_greater).abs() < 1e-9);
                prop_assert!((ab.p_less + ab.p_greater - 1.0).abs() < 1e-12);
                // The interval excludes 0 exactly if the two-sided p is below 5 %.
                let excludes_zero = ab.interval.low > 0.0 || ab.interval.high < 0.0;
                prop_assert_eq!(excludes_zero, ab.p_two_sided < 0.05);
            }
        }
    }
}
