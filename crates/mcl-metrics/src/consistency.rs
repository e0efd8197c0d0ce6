//! Consistency of an estimate: agreement of its covariance with its error.

use mcl_core::math;
use nalgebra::{Matrix3, Vector3};

/// Smallest fraction of the variance of a component that remains given the components before it; less is
/// rounding, as for collinear particles.
const SINGULAR_BELOW: f64 = 1e-12;

/// The 0.95 quantile of χ² with three degrees of freedom.
const LIMIT_95: f64 = 7.814_727_903_251_179;

/// Normalized estimation error squared (NEES), eᵀ C⁻¹ e (Bar-Shalom, Li & Kirubarajan 2001, section 5.4): the
/// squared distance of the reference from the estimate in standard deviations of the estimate. Its
/// mean is 3 for a consistent pose estimate, and larger if the covariance is too small.
///
/// `error` is x, y in metres and the heading in radians, wrapped to (−π, π]; `covariance` is that of the
/// estimate, for the same components in the same frame (only its lower triangle is used). `None` if the
/// covariance is not positive definite, up to rounding, or a number is not finite.
///
/// # Example
/// ```
/// let covariance = [[0.04, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0025]];
/// let nees = mcl_metrics::nees([0.2, -0.1, 0.1], covariance).unwrap();
/// assert!((nees - (1.0 + 1.0 + 4.0)).abs() < 1e-12);
/// assert!(mcl_metrics::inside_ellipsoid_95(nees));
/// assert_eq!(mcl_metrics::nees([0.2, -0.1, 0.1], [[0.0; 3]; 3]), None);
/// ```
pub fn nees(error: [f64; 3], covariance: [[f64; 3]; 3]) -> Option<f64> {
    let covariance = Matrix3::from_fn(|row, column| covariance[row][column]);
    let factor = covariance.cholesky()?.l();
    // The squared diagonal entries are the conditional variances, given the components before.
    let is_singular = |i| math::square(factor[(i, i)]) <= SINGULAR_BELOW * covariance[(i, i)];
    if (0..3).any(is_singular) {
        return None;
    }
    let standardized = factor.solve_lower_triangular(&Vector3::from(error))?;
    Some(standardized.norm_squared()).filter(|nees| nees.is_finite())
}

/// Whether a reference with this [`nees`] is in the 95 % ellipsoid of the estimate, taken as a Gaussian:
/// `nees` is at most the 0.95 quantile of χ² with three
/// degrees of freedom. For a consistent estimate this is the case for 95 % of all scans.
pub fn inside_ellipsoid_95(nees: f64) -> bool {
    nees <= LIMIT_95
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The length of a standard normal vector in space has the density √(2/π)·r²·exp(−r²/2).
    #[test]
    fn the_limit_holds_95_percent() {
        const STEPS: u32 = 1000;
        let step = LIMIT_95.sqrt() / f64::from(STEPS);
        let density = |r: f64| (2.0 / std::f64::consts::PI).sqrt() * r * r * (-0.5 * r * r).exp();
        // Simpson's rule.
        let weight = |i: u32| if i == 0 || i == STEPS { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
        let sum: f64 = (0..=STEPS).map(|i| weight(i) * density(f64::from(i) * step)).sum();
        assert!((sum * step / 3.0 - 0.95).abs() < 1e-12, "{}", sum * step / 3.0);
        assert!(inside_ellipsoid_95(7.8147) && !inside_ellipsoid_95(7.8148));
        assert!(!inside_ellipsoid_95(f64::NAN));
    }

    /// C = [[2, 1, 0], [1, 2, 0], [0, 0, 4]]: C⁻¹ = [[2, −1, 0], [−1, 2, 0], [0, 0, ¾]] / 3.
    #[test]
    fn correlated_components_by_hand() {
        let covariance = [[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 4.0]];
        for (error, expected) in [
            ([1.0, 0.0, 0.0], 2.0 / 3.0),
            ([1.0, 1.0, 0.0], 2.0 / 3.0),
            ([1.0, -1.0, 0.0], 2.0),
            ([3.0, 0.0, 2.0], 7.0),
            ([0.0, 0.0, 0.0], 0.0),
        ] {
            let found = nees(error, covariance).unwrap();
            assert!((found - expected).abs() < 1e-14, "{error:?}: {found}");
        }
    }

    #[test]
    fn a_covariance_without_an_inverse_has_no_nees() {
        let diagonal = |d: [f64; 3]| [[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]];
        // Particles on the line y = x/3, up to rounding.
        let third = 0.1 / 3.0;
        let line = [[0.1, third, 0.0], [third, third / 3.0 + 1e-17, 0.0], [0.0, 0.0, 0.01]];
        for covariance in [
            diagonal([0.0; 3]),
            diagonal([1.0, 1.0, 0.0]),
            diagonal([1.0, -1.0, 1.0]),
            diagonal([1.0, f64::NAN, 1.0]),
            diagonal([f64::INFINITY, 1.0, 1.0]),
            line,
        ] {
            assert_eq!(nees([0.1; 3], covariance), None, "{covariance:?}");
        }
        assert_eq!(nees([f64::NAN, 0.0, 0.0], diagonal([1.0; 3])), None);
        // Small but not singular: a millimetre, and a micrometre across.
        assert!(nees([1e-3; 3], diagonal([1e-6, 1e-12, 1e-6])).is_some());
    }

    proptest! {
        /// Rotating error and covariance changes nothing, and neither do other units.
        #[test]
        fn frames_and_units_do_not_matter(
            root in prop::array::uniform9(-1.0..1.0f64),
            error in prop::array::uniform3(-1.0..1.0f64),
            angle in -3.0..3.0f64,
            scale in 1e-3..1e3f64,
        ) {
            let root = Matrix3::from_row_slice(&root);
            let covariance = root * root.transpose() + Matrix3::identity() * 0.01;
            let (sin, cos) = angle.sin_cos();
            let change = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, scale);
            let rows = |m: Matrix3<f64>| std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]));
            let found = nees(error, rows(covariance)).unwrap();
            let changed = change * Vector3::from(error);
            let elsewhere =
                nees(changed.into(), rows(change * covariance * change.transpose())).unwrap();
            prop_assert!((found - elsewhere).abs() < 1e-9 * (1.0 + found), "{found} {elsewhere}");
            prop_assert!(found >= 0.0);
        }
    }
}
