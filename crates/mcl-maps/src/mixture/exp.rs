/// Smaller exponents are clamped to this: its power is a normal number, and negligible beside 1.
const SMALLEST: f64 = -1000.0;
/// 1.5·2⁵²: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// 2ʳ = 1 + r·Σ cₙ·rⁿ for |r| ≤ ½, interpolated at Chebyshev nodes in 60 digits; the largest relative
/// error is 5.7e-16.
const COEFFICIENTS: [f64; 10] = [
    0.693_147_180_559_946_2,
    0.240_226_506_959_100_75,
    0.055_504_108_664_651_67,
    0.009_618_129_107_618_665,
    0.001_333_355_820_079_459_2,
    0.000_154_035_304_247_765_29,
    1.525_267_292_485_073_7e-5,
    1.321_545_163_322_143_4e-6,
    1.020_590_541_376_559_5e-7,
    7.070_977_866_508_138e-9,
];

/// 2ˣ for x ≤ 1000, within four units in the last place; 2⁻¹⁰⁰⁰ for all x below −1000. It has no branches
/// or table lookups, so that loops over it vectorize, and no fused operations, so that every
/// instruction set gives the same bits.
#[inline(always)]
pub(super) fn exp2_bounded(x: f64) -> f64 {
    let x = if x > SMALLEST { x } else { SMALLEST };
    let shifted = x + ROUND;
    let r = x - (shifted - ROUND);
    let r2 = r * r;
    let r4 = r2 * r2;
    // Estrin's scheme: short chains of dependent operations keep the units busy.
    let c = &COEFFICIENTS;
    let low = (c[0] + c[1] * r) + (c[2] + c[3] * r) * r2;
    let high = ((c[4] + c[5] * r) + (c[6] + c[7] * r) * r2) + (c[8] + c[9] * r) * r4;
    let mantissa = 1.0 + r * (low + high * r4);
    f64::from_bits(mantissa.to_bits().wrapping_add(shifted.to_bits() << 52))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn within_four_units_in_the_last_place(x in -1000.0..1000.0f64, small in -1e-3..1e-3f64) {
            for x in [x, small] {
                let expected = x.exp2();
                let error = (exp2_bounded(x) - expected).abs() / expected;
                prop_assert!(error <= 4.0 * f64::EPSILON, "2^{x}: relative error {error:e}");
            }
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(exp2_bounded(0.0), 1.0);
        assert_eq!(exp2_bounded(-0.0), 1.0);
        for x in [SMALLEST, -1000.1, -1e300, f64::NEG_INFINITY] {
            assert_eq!(exp2_bounded(x), SMALLEST.exp2());
        }
    }
}
