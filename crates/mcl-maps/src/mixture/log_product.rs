use std::f64::consts::LN_2;

use crate::point_set::LEAF_POINTS;

const MANTISSA: u64 = (1 << 52) - 1;
const ONE: u64 = 1023 << 52;

/// The logarithm of a long product of positive normal numbers, without a logarithm for each: the
/// product of their mantissas and the sum of their exponents.
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
        let mut lanes = [1.0; 4];
        for chunk in mantissas.chunks_exact(4) {
            for lane in 0..4 {
                lanes[lane] *= chunk[lane];
            }
        }
        let bits = (self.mantissa * ((lanes[0] * lanes[2]) * (lanes[1] * lanes[3]))).to_bits();
        self.mantissa = f64::from_bits(bits & MANTISSA | ONE);
        self.exponent += (bits >> 52) as i64 - 1023;
        let mut lanes = [0.0; 4];
        for (i, shift) in shift.iter().enumerate() {
            lanes[i % 4] += if i < count { *shift } else { 0.0 };
        }
        self.shift += (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
    }

    /// The natural logarithm.
    pub fn ln(&self) -> f64 {
        self.mantissa.ln() + LN_2 * (self.exponent as f64 - self.shift)
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
