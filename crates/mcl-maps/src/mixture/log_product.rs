use std::f64::consts::LN_2;

use crate::point_set::LEAF_POINTS;
use mcl_core::math;

const LANES: usize = 4;
const MANTISSA: u64 = (1 << 52) - 1;
const ONE: u64 = 1023 << 52;

/// The logarithm of a long product of positive normal numbers, computed from the product of their mantissas and the
/// sum of their exponents instead of a logarithm for each.
#[derive(Debug, Clone, Copy)]
pub(super) struct LogProduct {
    mantissa: f64,
    exponent: i64,
    shift: f64,
}

impl LogProduct {
    pub const ONE: Self = LogProduct { mantissa: 1.0, exponent: 0, shift: 0.0 };

    /// Multiplies by `2^−shift[i]·factors[i]` for i below `count`.
    #[inline(always)]
    pub fn multiply(
        &mut self,
        factors: &[f64; LEAF_POINTS],
        shift: &[f64; LEAF_POINTS],
        count: usize,
    ) {
        let mut mantissas = [1.0; LEAF_POINTS];
        let mut exponents = [0; LEAF_POINTS];
        for i in 0..LEAF_POINTS {
            let bits = if i < count { factors[i].to_bits() } else { ONE };
            mantissas[i] = f64::from_bits(bits & MANTISSA | ONE);
            exponents[i] = bits >> 52;
        }
        let exponents: u64 = exponents.iter().sum();
        self.exponent += exponents as i64 - 1023 * LEAF_POINTS as i64;
        // Each mantissa is below 2.
        let mut product = [1.0; LANES];
        let mut shift_sum = [0.0; LANES];
        for first in (0..LEAF_POINTS).step_by(LANES) {
            for lane in 0..LANES {
                product[lane] *= mantissas[first + lane];
                let counts = first + lane < count;
                shift_sum[lane] += if counts { shift[first + lane] } else { 0.0 };
            }
        }
        let [a, b, c, d] = product;
        let bits = (self.mantissa * ((a * c) * (b * d))).to_bits();
        self.mantissa = f64::from_bits(bits & MANTISSA | ONE);
        self.exponent += (bits >> 52) as i64 - 1023;
        let [a, b, c, d] = shift_sum;
        self.shift += (a + c) + (b + d);
    }

    /// Multiplies by `2^−exponent`.
    pub fn divide(&mut self, exponent: f64) {
        self.shift += exponent;
    }

    /// The natural logarithm.
    pub fn ln(&self) -> f64 {
        math::ln(self.mantissa) + LN_2 * (self.exponent as f64 - self.shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;
    use rand::RngExt;

    #[test]
    fn is_the_sum_of_logarithms() {
        let mut rng = Seed::new(1).rng();
        let mut product = LogProduct::ONE;
        let mut expected = 0.0;
        for count in [LEAF_POINTS, 1, LEAF_POINTS - 1, LEAF_POINTS] {
            let factors = std::array::from_fn(|_| rng.random_range(-600.0..40.0f64).exp2());
            let shift = std::array::from_fn(|_| rng.random_range(0.0..1e6));
            product.multiply(&factors, &shift, count);
            for i in 0..count {
                expected += factors[i].ln() - LN_2 * shift[i];
            }
        }
        assert!((product.ln() - expected).abs() <= 1e-14 * expected.abs());
    }
}
