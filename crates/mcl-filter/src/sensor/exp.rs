use std::f32::consts::LOG2_E;

/// Below this, [`exp_nonpositive`] is 0: the smallest exponent whose scale is a normal float.
pub(super) const UNDERFLOW: f32 = -87.0;
/// 1.5·2²³: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f32 = 12_582_912.0;
/// ln 2 in two parts; the first has enough trailing zeros that its product with k is exact.
const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;
/// exp(r) = 1 + r + r²·Σ cₙ·rⁿ for |r| ≤ ln(2)/2, interpolated at Chebyshev nodes in 60 digits; the
/// largest relative error is 1.1e-8.
const COEFFICIENTS: [f32; 5] = [0.5, 0.166_665_76, 0.041_666_556, 0.008_363_179, 0.001_392_618_4];

/// exp(x) for x ≤ 0, within two units in the last place; 0 below −87. Without branches or table
/// look-ups, so that a loop over it becomes vector instructions, and without fused operations, so
/// that every instruction set gives the same bits.
#[inline(always)]
pub(super) fn exp_nonpositive(x: f32) -> f32 {
    let clamped = if x < UNDERFLOW { UNDERFLOW } else { x };
    let shifted = clamped * LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = clamped - k * LN2_HIGH - k * LN2_LOW;
    let c = &COEFFICIENTS;
    let r2 = r * r;
    let series = (c[0] + c[1] * r) + ((c[2] + c[3] * r) + c[4] * r2) * r2;
    let mantissa = 1.0 + (r + r2 * series);
    let scale = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
    if x < UNDERFLOW { 0.0 } else { mantissa * scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn within_two_units_in_the_last_place(x in -87.0..0.0f32, small in -1e-3..0.0f32) {
            for x in [x, small] {
                let expected = f64::from(x).exp();
                let error = (f64::from(exp_nonpositive(x)) - expected).abs() / expected;
                prop_assert!(error <= 2.0 * f64::from(f32::EPSILON), "exp({x}): {error:e}");
            }
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(exp_nonpositive(0.0), 1.0);
        assert_eq!(exp_nonpositive(-0.0), 1.0);
        assert_eq!(exp_nonpositive(-1e30), 0.0);
        assert_eq!(exp_nonpositive(f32::NEG_INFINITY), 0.0);
        assert!(exp_nonpositive(UNDERFLOW) > 0.0);
    }
}
