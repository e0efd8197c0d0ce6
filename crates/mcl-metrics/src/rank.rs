use serde::Serialize;
use statrs::statistics::{Data, OrderStatistics, RankTieBreaker};

use crate::error::{MetricsError, check_samples};
use crate::student_t::upper_tail;

/// Rank correlation of pairs of values; see [`spearman`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RankCorrelation {
    /// Spearman's ρ, from −1 (the one falls wherever the other rises) to 1.
    pub rho: f64,
    /// One-sided p for "ρ is negative".
    pub p_less: f64,
    /// One-sided p for "ρ is positive".
    pub p_greater: f64,
}

/// Spearman's rank correlation (Spearman 1904): Pearson's correlation of the ranks, equal values
/// sharing their mean rank. The p values take `ρ √((n − 2)/(1 − ρ²))` for Student's t with n − 2
/// degrees of freedom, an approximation that is good from about ten pairs.
///
/// # Errors
/// When the numbers of values differ or are below three, a value is not finite, or all values of a
/// side are the same.
///
/// # Example
/// ```
/// let found = mcl_metrics::spearman(&[1.0, 2.0, 5.0, 10.0], &[9.1, 3.2, 3.1, 0.4])?;
/// assert_eq!((found.rho, found.p_less), (-1.0, 0.0));
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn spearman(a: &[f64], b: &[f64]) -> Result<RankCorrelation, MetricsError> {
    if a.len() != b.len() {
        return Err(MetricsError::LengthMismatch {
            left: "values of a:",
            left_count: a.len(),
            right: "values of b:",
            right_count: b.len(),
        });
    }
    let (ranks_a, ranks_b) = (centred_ranks(a, "a")?, centred_ranks(b, "b")?);
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let squares = product(&ranks_a, &ranks_a) * product(&ranks_b, &ranks_b);
    let rho = (product(&ranks_a, &ranks_b) / squares.sqrt()).clamp(-1.0, 1.0);
    let freedom = (a.len() - 2) as f64;
    let tail = upper_tail(rho * (freedom / ((1.0 - rho) * (1.0 + rho))).sqrt(), freedom);
    let (p_less, p_greater) = if rho < 0.0 { (tail, 1.0 - tail) } else { (1.0 - tail, tail) };
    Ok(RankCorrelation { rho, p_less, p_greater })
}

/// Ranks minus their mean; halves of small integers, so exact.
fn centred_ranks(values: &[f64], name: &'static str) -> Result<Vec<f64>, MetricsError> {
    check_samples(values, 3).map_err(|error| error.within(name))?;
    if values.iter().all(|value| *value == values[0]) {
        return Err(MetricsError::NoSpread { value: values[0] }.within(name));
    }
    let ranks = Data::new(values.to_vec()).ranks(RankTieBreaker::Average);
    let mean = (values.len() + 1) as f64 / 2.0;
    Ok(ranks.into_iter().map(|rank| rank - mean).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [f64; 10] = [0.1, 0.1, 0.1, 0.25, 0.25, 0.5, 0.5, 1.0, 1.0, 2.0];

    /// Source: SciPy 1.17.1, `spearmanr(a, b, alternative=…)`.
    #[test]
    fn agrees_with_scipy() {
        let gains = [31.5, 29.1, 33.0, 7.1, 7.4, 3.05, 3.05, 1.27, 1.3, 1.31];
        let mixed = [3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0, 5.0, 3.0];
        for (values, expected) in [
            (gains, [-0.9442633213938101, 1.9731705363982563e-05, 0.999980268294636]),
            (mixed, [0.3969060094933473, 0.8719493989557229, 0.12805060104427712]),
        ] {
            let found = spearman(&SIZES, &values).unwrap();
            for (found, expected) in [found.rho, found.p_less, found.p_greater].iter().zip(expected)
            {
                assert!((found / expected - 1.0).abs() < 1e-10, "{found} is not {expected}");
            }
        }
    }

    #[test]
    fn order_is_all_that_counts() {
        let falling: Vec<f64> = (0..9).map(|i| (-f64::from(i)).exp()).collect();
        let rising: Vec<f64> = (0..9).map(f64::from).collect();
        let found = spearman(&rising, &falling).unwrap();
        assert_eq!((found.rho, found.p_less, found.p_greater), (-1.0, 0.0, 1.0));
        assert_eq!(spearman(&rising, &rising).unwrap().p_greater, 0.0);
    }

    #[test]
    fn what_cannot_be_correlated_says_why() {
        let message = |a: &[f64], b: &[f64]| spearman(a, b).unwrap_err().to_string();
        assert_eq!(
            message(&[1.0, 2.0, 3.0], &[2.0; 3]),
            "b: all values are 2, expected at least two different ones"
        );
        assert!(message(&[1.0, 2.0], &[2.0, 1.0]).starts_with("a: samples: found 2"));
        assert!(message(&[1.0], &[2.0, 1.0]).contains("expected as many"));
        assert!(message(&[1.0, 2.0, 3.0], &[1.0, f64::NAN, 2.0]).starts_with("b: sample 1 is NaN"));
    }
}
