//! Tests over blocks: the sample is always one number per block.

use crate::blocked::Blocked;
use crate::error::TooFew;
use crate::hypothesis::{Effect, of_differences, welch};

/// Paired t test of "the means of a and b are the same" over the blocks that both have. Within a block
/// a − b is the mean difference of the values with the same unit or, if a side has no units, the
/// difference of the means ([`Blocked::minus`]).
///
/// # Errors
/// If fewer than two blocks have a pair.
///
/// # Example
/// ```
/// use mcl_metrics::{Blocked, paired};
///
/// // Draw, run, error: two runs on each map.
/// let gbs = [(0, 0, 0.05), (0, 1, 0.04), (1, 2, 0.06), (1, 3, 0.07), (2, 4, 0.05), (2, 5, 0.05)];
/// let fkm = [(0, 0, 0.04), (0, 1, 0.03), (1, 2, 0.04), (1, 3, 0.05), (2, 4, 0.02), (2, 5, 0.02)];
/// let effect = paired(&Blocked::with_units(fkm)?, &Blocked::with_units(gbs)?)?;
/// assert!((effect.mean_difference + 0.02).abs() < 1e-15);
/// assert_eq!((effect.blocks, effect.degrees_of_freedom), ([3, 3], 2.0));
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn paired(a: &Blocked, b: &Blocked) -> Result<Effect, TooFew> {
    one_sample(&a.minus(b).map_err(|few| TooFew { needed: 2, ..few })?)
}

/// Welch's t test of "the means of a and b are the same" over block means, for sides whose blocks are
/// independent of each other; they may differ in number and variance.
///
/// # Errors
/// If a side has fewer than two blocks.
pub fn two_sample(a: &Blocked, b: &Blocked) -> Result<Effect, TooFew> {
    let smaller = if a.blocks() <= b.blocks() { a } else { b };
    smaller.at_least_two()?;
    Ok(welch(&a.sample(), &b.sample()))
}

/// t test of "the mean of the block means is 0", for the differences from [`Blocked::minus`] or
/// those of several comparisons together.
///
/// # Errors
/// If there are fewer than two blocks.
///
/// # Example
/// ```
/// use mcl_metrics::{Blocked, one_sample};
///
/// // Draw 0 to 2 at two sizes of a map: differences of each size, tested as one.
/// let small = Blocked::new([(0, -0.03), (1, -0.05), (2, -0.04)])?;
/// let large = Blocked::new([(0, -0.01), (1, -0.02), (2, 0.00)])?;
/// let effect = one_sample(&Blocked::new(small.values().chain(large.values()))?)?;
/// assert_eq!(effect.blocks, [3, 3]);
/// assert!(effect.p_less < 0.05);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn one_sample(differences: &Blocked) -> Result<Effect, TooFew> {
    Ok(of_differences(&differences.at_least_two()?))
}

/// Adjusts the p values of a family of tests (Holm 1979): if adjusted values below α count as significant, the
/// probability of any false positive is at most α, whatever the dependence between the tests. In ascending order, the
/// k-th of m p values is multiplied by m + 1 − k, limited to at most 1 and to at least the one before. The result
/// has the order of the input. Values outside [0, 1], such as NaN for a test that could not be computed, are not
/// counted in m, and their result is NaN.
///
/// # Example
/// ```
/// assert_eq!(mcl_metrics::holm(&[0.5, 0.01, 0.3]), [0.6, 0.03, 0.6]);
/// ```
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let is_p = |index: &usize| (0.0..=1.0).contains(&p_values[*index]);
    let mut order: Vec<usize> = (0..p_values.len()).filter(is_p).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut adjusted = vec![f64::NAN; p_values.len()];
    let mut largest: f64 = 0.0;
    for (rank, &index) in order.iter().enumerate() {
        largest = largest.max((order.len() - rank) as f64 * p_values[index]).min(1.0);
        adjusted[index] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::MetricsError;
    use crate::hypothesis::{paired_t_test, welch_equivalence_p, welch_t_test};

    fn blocked(values: &[(u64, u64, f64)]) -> Blocked {
        Blocked::with_units(values.iter().copied()).unwrap()
    }

    /// The block means of the differences are 1, 2 and 6: t = 3 / √(7/3) with two degrees of freedom,
    /// for which P(T > t) = ½ − t / (2 √(2 + t²)).
    #[test]
    fn paired_by_hand() {
        let a = blocked(&[(0, 0, 5.0), (0, 1, 6.0), (1, 2, 3.0), (2, 3, 9.0), (2, 4, 9.0)]);
        let b = blocked(&[(0, 0, 5.0), (0, 1, 4.0), (1, 2, 1.0), (2, 3, 4.0), (2, 4, 2.0)]);
        let effect = paired(&a, &b).unwrap();
        let t = 3.0 / (7.0f64 / 3.0).sqrt();
        assert!((effect.mean_difference - 3.0).abs() < 1e-15);
        assert!((effect.standard_error - (7.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((effect.t - t).abs() < 1e-14);
        assert!((effect.p_greater - (0.5 - t / (2.0 * (2.0 + t * t).sqrt()))).abs() < 1e-14);
        assert!((effect.p_two_sided - 2.0 * effect.p_greater).abs() < 1e-15);
        assert_eq!((effect.degrees_of_freedom, effect.blocks), (2.0, [3, 3]));
        assert_eq!(one_sample(&a.minus(&b).unwrap()).unwrap(), effect);
    }

    /// Blocks, and runs in a block, that only one side has are ignored.
    #[test]
    fn only_common_units_count() {
        let a = blocked(&[(0, 0, 5.0), (0, 9, 900.0), (1, 2, 3.0), (8, 3, 700.0)]);
        let b = blocked(&[(0, 0, 4.0), (1, 2, 1.0), (1, 7, -800.0), (6, 3, 4.0)]);
        let effect = paired(&a, &b).unwrap();
        assert_eq!((effect.mean_difference, effect.blocks), (1.5, [2, 2]));
    }

    #[test]
    fn two_samples_are_block_means() {
        let a = Blocked::new([(0, 1.0), (0, 3.0), (1, 4.0), (2, 4.0), (2, 8.0)]).unwrap();
        let b = Blocked::new([(0, 7.0), (5, 9.0), (5, 10.0), (6, 8.0), (7, 7.0)]).unwrap();
        let effect = two_sample(&a, &b).unwrap();
        assert_eq!(effect, welch_t_test(&[2.0, 4.0, 6.0], &[7.0, 9.5, 8.0, 7.0]).unwrap());
        assert_eq!(effect.blocks, [3, 4]);
    }

    #[test]
    fn equivalence_is_over_blocks() {
        let a = [(0, 4.10), (0, 4.12), (1, 4.11), (2, 4.09), (2, 4.09)];
        let b = [(0, 4.12), (1, 4.13), (1, 4.13), (2, 4.16)];
        let (a, b) = (Blocked::new(a).unwrap(), Blocked::new(b).unwrap());
        let (means_a, means_b) = ([4.11, 4.11, 4.09], [4.12, 4.13, 4.16]);
        for margin in [0.01, 0.04, 0.1] {
            let found = two_sample(&a, &b).unwrap().equivalence_p(margin).unwrap();
            let expected = welch_equivalence_p(&means_a, &means_b, margin).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-9, "{margin}: {found}");
            let found = paired(&a, &b).unwrap().equivalence_p(margin).unwrap();
            let lifted = |by: f64| paired_t_test(&means_a.map(|mean| mean + by), &means_b).unwrap();
            let expected = lifted(margin).p_greater.max(lifted(-margin).p_less);
            assert!((found / expected - 1.0).abs() < 1e-9, "{margin}: {found}");
        }
        let refused = paired(&a, &b).unwrap().equivalence_p(f64::NAN).unwrap_err().to_string();
        assert_eq!(refused, "margin is NaN, expected a positive number");
    }

    #[test]
    fn too_few_blocks_are_reported() {
        let one = Blocked::new([(3, 1.0), (3, 2.0), (3, 4.0)]).unwrap();
        let two = Blocked::new([(3, 1.0), (4, 2.0)]).unwrap();
        let elsewhere = Blocked::new([(8, 1.0), (9, 2.0)]).unwrap();
        for result in [paired(&one, &two), two_sample(&one, &two), two_sample(&two, &one)] {
            assert_eq!(result, Err(TooFew { blocks: 1, needed: 2 }));
        }
        assert_eq!(paired(&two, &elsewhere), Err(TooFew { blocks: 0, needed: 2 }));
        assert_eq!(
            MetricsError::from(one_sample(&one).unwrap_err()).to_string(),
            "too few to tell: 1 independent block, at least 2 needed"
        );
    }

    #[test]
    fn holm_by_hand() {
        let close = |found: Vec<f64>, expected: &[f64]| {
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(expected) {
                let same = (found - expected).abs() < 1e-15 || found.is_nan() && expected.is_nan();
                assert!(same, "{found} is not {expected}");
            }
        };
        // 0.005 · 4, 0.01 · 3, 0.03 · 2; 0.04 · 1 is below the one before.
        close(holm(&[0.01, 0.04, 0.03, 0.005]), &[0.03, 0.06, 0.06, 0.02]);
        close(holm(&[0.6, 0.7]), &[1.0, 1.0]);
        // Tests that could not be computed are not in the family.
        close(holm(&[0.02, f64::NAN, 0.03, -1.0]), &[0.04, f64::NAN, 0.04, f64::NAN]);
        close(holm(&[0.02]), &[0.02]);
        close(holm(&[]), &[]);
    }
}
