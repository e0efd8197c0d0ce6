//! Mathematical functions that give the same bits on every processor.
//!
//! IEEE 754 does not fix the last digit of sines, logarithms and powers. The standard library calls the system's C
//! library for them, which chooses an implementation by processor, with or without fused multiply-add. One different
//! last digit makes a filter draw different particles and, after some scans, report different errors. The functions
//! here are pure arithmetic from the crate `libm`. Square roots, rounding, remainders and `mul_add` are exact
//! everywhere, so the methods of `f64` are used for them.

/// sin x.
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// cos x.
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// sin x and cos x, with the bits of [`sin`] and [`cos`].
pub fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}

/// tan x.
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// arcsin x, in [−π/2, π/2]; NaN outside [−1, 1].
pub fn asin(x: f64) -> f64 {
    libm::asin(x)
}

/// arccos x, in [0, π]; NaN outside [−1, 1].
pub fn acos(x: f64) -> f64 {
    libm::acos(x)
}

/// The angle of the point (x, y), in [−π, π].
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// √(x² + y²), without overflow in between.
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}

/// eˣ.
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// The natural logarithm; −∞ at 0, NaN below.
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// ln(1 + x).
pub fn ln_1p(x: f64) -> f64 {
    libm::log1p(x)
}

/// The logarithm to base 2; −∞ at 0, NaN below.
pub fn log2(x: f64) -> f64 {
    libm::log2(x)
}

/// The logarithm to base 10; −∞ at 0, NaN below.
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}

/// ln |Γ(x)|.
pub fn ln_gamma(x: f64) -> f64 {
    libm::lgamma(x)
}

/// xʸ.
pub fn powf(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// x².
#[inline(always)]
pub fn square(x: f64) -> f64 {
    x * x
}

/// xⁿ by repeated squaring (the order of the standard library's products is not specified).
pub fn powi(x: f64, n: u32) -> f64 {
    let (mut power, mut square, mut rest) = (1.0, x, n);
    while rest > 0 {
        if rest % 2 == 1 {
            power *= square;
        }
        square *= square;
        rest /= 2;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Pinned values, so that a processor or a release of libm with different results is noticed.
    #[test]
    fn bits_are_those_of_every_processor() {
        type Function = fn(f64) -> f64;
        let functions: [(&str, Function, [u64; 3]); 16] = [
            (
                "asin",
                |x| asin(x / 100.0),
                [0x3f68_9377_26e4_cfc8, 0x3f9d_b33d_f215_2384, 0x3fe9_956a_03de_6b68],
            ),
            ("sin", sin, [0x3fd2_e9cd_95ba_ba33, 0x3fce_9fb8_d648_30e3, 0x3fe0_e811_d432_653e]),
            ("cos", cos, [0x3fee_921d_d42f_09ba, 0xbfef_1216_dba3_40c9, 0xbfeb_2b55_9dc8_1ffd]),
            (
                "sin of both",
                |x| sin_cos(x).0,
                [0x3fd2_e9cd_95ba_ba33, 0x3fce_9fb8_d648_30e3, 0x3fe0_e811_d432_653e],
            ),
            (
                "cos of both",
                |x| sin_cos(x).1,
                [0x3fee_921d_d42f_09ba, 0xbfef_1216_dba3_40c9, 0xbfeb_2b55_9dc8_1ffd],
            ),
            ("tan", tan, [0x3fd3_cc2a_44e2_9998, 0xbfcf_8a36_4255_739f, 0xbfe3_e99a_d708_e1c8]),
            (
                "acos",
                |x| acos(x / 100.0),
                [0x3ff9_15b1_98b0_bab0, 0x3ff8_ab2e_5c7b_d88a, 0x3fe8_ae8c_a4a9_eec9],
            ),
            (
                "atan2",
                |x| atan2(x, -1.1),
                [0x4007_00b2_9327_680f, 0x3ffe_eef6_83ea_a536, 0x3ff9_60d1_01db_7e6c],
            ),
            (
                "hypot",
                |x| hypot(x, 0.7),
                [0x3fe8_5ed7_614b_038c, 0x4007_ddc5_7552_0155, 0x4051_ed04_c875_a9bb],
            ),
            (
                "exp",
                |x| exp(-x),
                [0x3fe7_b4c8_69c3_7c05, 0x3fac_2c00_e553_650e, 0x3977_9171_2914_36ba],
            ),
            ("ln", ln, [0xbff3_4378_fcbd_a721, 0x3ff1_090e_2031_5212, 0x4011_1707_d085_b6d2]),
            ("ln_1p", ln_1p, [0x3fd0_ca93_7be1_b9dc, 0x3ff5_c68f_59a5_7181, 0x4011_2536_ad08_5a85]),
            ("log2", log2, [0xbffb_ca9c_6f53_897b, 0x3ff8_93ac_34b7_528a, 0x4018_a7d5_b844_6ec2]),
            ("log10", log10, [0xbfe0_bb6c_34d8_1502, 0x3fdd_97ed_c5ad_8fa8, 0x3ffd_b034_daab_1da2]),
            (
                "ln_gamma",
                ln_gamma,
                [0x3ff1_8863_7a6c_4196, 0x3fe3_4ab5_3578_bce6, 0x406d_2d7c_73f1_bde3],
            ),
            (
                "powf",
                |x| powf(x, 1.3),
                [0x3fca_c244_9f53_f2b0, 0x400f_ee3d_4556_4480, 0x4070_2547_d284_2420],
            ),
        ];
        for (name, function, expected) in functions {
            assert_eq!([0.3, 2.9, 71.7].map(|x| function(x).to_bits()), expected, "{name}");
        }
    }

    proptest! {
        /// The standard library's results depend on the machine, hence the tolerance.
        #[test]
        fn functions_are_those_of_the_standard_library(x in 1e-3..30.0f64, y in -3.0..3.0f64, n in 0..40u32) {
            let close = |found: f64, expected: f64| (found - expected).abs() <= 1e-15 * expected.abs();
            prop_assert!(close(sin(x), x.sin()) && close(cos(x), x.cos()) && close(tan(x), x.tan()));
            prop_assert_eq!(sin_cos(x), (sin(x), cos(x)));
            prop_assert!(close(acos(y / 3.0), (y / 3.0).acos()) && close(asin(y / 3.0), (y / 3.0).asin()));
            prop_assert!(close(atan2(x, y), x.atan2(y)));
            prop_assert!(close(hypot(x, y), x.hypot(y)) && close(exp(y), y.exp()) && close(ln(x), x.ln()));
            prop_assert!(close(log2(x), x.log2()) && close(log10(x), x.log10()));
            prop_assert!(close(powf(x, y), x.powf(y)) && square(y) == y * y);
            prop_assert!((powi(x, n) / x.powi(n as i32) - 1.0).abs() < 1e-14);
            // Γ(x + 1) = x·Γ(x)
            prop_assert!((ln_gamma(x + 1.0) - ln_gamma(x) - ln(x)).abs() < 1e-13);
        }
    }
}
