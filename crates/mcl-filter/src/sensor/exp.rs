use std::f32::consts::LN_2;

/// The smallest exponent of [`exp2_nonpositive`]: that of the smallest normal float.
pub(super) const LEAST: f32 = -126.0;
/// 1.5·2²³: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f32 = 12_582_912.0;
/// 2ᶠ = 1 + f·Σ cₙ·fⁿ for |f| ≤ 1/2, interpolated at Chebyshev nodes in 60 digits; the largest relative
/// error is 9.2e-9.
const COEFFICIENTS: [f32; 6] =
    [LN_2, 0.240_226_5, 0.055_503_57, 0.009_618_083, 0.001_339_086_3, 0.000_154_531_63];

/// 2ᵗ for −126 ≤ t ≤ 0, within one unit in the last place. It has no branches or table lookups, so that
/// loops over it vectorize, and no fused operations, so that every instruction
/// set gives the same bits.
#[inline(always)]
pub(super) fn exp2_nonpositive(t: f32) -> f32 {
    let shifted = t + ROUND;
    let f = t - (shifted - ROUND);
    let c = &COEFFICIENTS;
    let f2 = f * f;
    let series = (c[0] + c[1] * f) + ((c[2] + c[3] * f) + (c[4] + c[5] * f) * f2) * f2;
    let mantissa = 1.0 + f * series;
    // The integer part is added to the exponent.
    f32::from_bits(mantissa.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn within_one_unit_in_the_last_place(t in LEAST..0.0f32, small in -1e-3..0.0f32) {
            for t in [t, small] {
                let expected = f64::from(t).exp2();
                let error = (f64::from(exp2_nonpositive(t)) - expected).abs() / expected;
                prop_assert!(error <= f64::from(f32::EPSILON), "2^{t}: {error:e}");
            }
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(exp2_nonpositive(0.0), 1.0);
        assert_eq!(exp2_nonpositive(-0.0), 1.0);
        assert_eq!(exp2_nonpositive(-3.0), 0.125);
        assert_eq!(exp2_nonpositive(LEAST), f32::MIN_POSITIVE);
    }
}
