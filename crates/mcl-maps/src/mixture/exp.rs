use std::f64::consts::LOG2_E;

/// Below this, [`exp_nonpositive`] is 0: the smallest exponent whose scale is a normal float.
const UNDERFLOW: f64 = -708.0;
/// 1.5·2⁵²: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts; the first has enough trailing zeros that its product with k is exact.
const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// exp(r) = 1 + r + r²·Σ cₙ·rⁿ for |r| ≤ ln(2)/2, interpolated at Chebyshev nodes in 60 digits; the
/// largest relative error is 1.6e-17.
const COEFFICIENTS: [f64; 10] = [
    0.500_000_000_000_000_1,
    0.166_666_666_666_666_69,
    0.041_666_666_666_624_13,
    0.008_333_333_333_330_062,
    0.001_388_888_891_721_371_7,
    0.000_198_412_698_630_536_18,
    2.480_152_129_595_437_6e-5,
    2.755_726_845_999_706_4e-6,
    2.762_008_844_540_974_6e-7,
    2.510_038_549_551_032e-8,
];

/// exp(x) for x ≤ 0, within two units in the last place; 0 below −708. Without branches or table
/// look-ups, so that a loop over it becomes vector instructions, and without fused operations, so
/// that every instruction set gives the same bits.
#[inline(always)]
pub(super) fn exp_nonpositive(x: f64) -> f64 {
    let clamped = if x < UNDERFLOW { UNDERFLOW } else { x };
    let shifted = clamped * LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = clamped - k * LN2_HIGH - k * LN2_LOW;
    // Estrin's scheme: short dependency chains keep the units busy.
    let c = &COEFFICIENTS;
    let (r2, r4) = (r * r, (r * r) * (r * r));
    let low = (c[0] + c[1] * r) + (c[2] + c[3] * r) * r2;
    let high = (c[4] + c[5] * r) + (c[6] + c[7] * r) * r2;
    let series = low + (high + (c[8] + c[9] * r) * r4) * r4;
    let mantissa = 1.0 + (r + r2 * series);
    let scale = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    if x < UNDERFLOW { 0.0 } else { mantissa * scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn within_two_units_in_the_last_place(x in -707.0..0.0f64, small in -1e-3..0.0f64) {
            for x in [x, small] {
                let expected = x.exp();
                let error = (exp_nonpositive(x) - expected).abs() / expected;
                prop_assert!(error <= 2.0 * f64::EPSILON, "exp({x}): relative error {error:e}");
            }
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(exp_nonpositive(0.0), 1.0);
        assert_eq!(exp_nonpositive(-0.0), 1.0);
        assert_eq!(exp_nonpositive(-1e300), 0.0);
        assert_eq!(exp_nonpositive(f64::NEG_INFINITY), 0.0);
        assert!(exp_nonpositive(UNDERFLOW) > 0.0);
    }
}
