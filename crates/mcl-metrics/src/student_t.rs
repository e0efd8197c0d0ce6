//! Student's t distribution, for at least one degree of freedom.

use crate::beta;

/// P(T ≥ |t|), accurate even far out in the tail, where 1 − P(T < |t|) would be 0.
pub(crate) fn upper_tail(t: f64, freedom: f64) -> f64 {
    0.5 * beta::probability(0.5 * freedom, 0.5, freedom / (freedom + t * t))
}

/// The t with P(|T| ≤ t) = 0.95, by bisection.
pub(crate) fn critical_value_95(freedom: f64) -> f64 {
    // 12.71 with one degree of freedom, 1.96 with infinitely many.
    let (mut low, mut high) = (1.9, 13.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if upper_tail(middle, freedom) > 0.025 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Source: SciPy 1.17.1, `scipy.stats.t.sf(t, df)`.
    #[test]
    fn tail_agrees_with_scipy() {
        for (t, freedom, expected, relative) in [
            (0.5, 1.0, 0.35241638234956674, 1e-14),
            (2.0, 4.7, 0.05278609110171963, 1e-13),
            (12.0, 29.0, 4.5303541665677275e-13, 1e-12),
            (40.0, 50.0, 6.206211892187336e-40, 1e-12),
            (30.0, 45500.0, 4.006589488616349e-196, 1e-12),
            (11.5, 1e6, 6.625108632900439e-31, 1e-9),
            (11.5, 1e8, 6.596064259875944e-31, 1e-7),
        ] {
            let found = upper_tail(t, freedom);
            assert!((found / expected - 1.0).abs() < relative, "t {t}, {freedom}: {found:e}");
            assert_eq!(found, upper_tail(-t, freedom));
        }
        assert_eq!(upper_tail(0.0, 7.0), 0.5);
        assert_eq!((upper_tail(f64::INFINITY, 7.0), upper_tail(1e200, 7.0)), (0.0, 0.0));
    }

    /// Source: SciPy 1.17.1, `scipy.stats.t.ppf(0.975, df)`.
    #[test]
    fn critical_values_agree_with_scipy() {
        for (freedom, expected, tolerance) in [
            (1.0, 12.706204736174694, 1e-12),
            (4.7, 2.62072607535317, 1e-12),
            (29.0, 2.045229642132703, 1e-12),
            (1e3, 1.9623390808264083, 1e-11),
            (1e5, 1.9599877075346095, 1e-9),
            (1e7, 1.959964221767205, 1e-7),
        ] {
            let found = critical_value_95(freedom);
            assert!((found - expected).abs() < tolerance, "{freedom}: {found}");
        }
    }
}
