//! The beta distribution, used for Student's t and the exact intervals of rates.

use std::f64::consts::PI;

use mcl_core::math;

/// P(X ≤ x) of a beta distribution with positive shape parameters: the regularized incomplete beta function Iₓ(a, b).
/// Source: F. W. J. Olver et al., *NIST Handbook of Mathematical Functions* (2010), equation 8.17.22, a
/// continued fraction that converges quickly below the mean; above the mean, 1 − I₁₋ₓ(b, a) is used.
pub(crate) fn probability(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        0.0
    } else if x >= 1.0 {
        1.0
    } else if x > (a + 1.0) / (a + b + 2.0) {
        1.0 - below_mean(b, a, 1.0 - x)
    } else {
        below_mean(a, b, x)
    }
}

fn below_mean(a: f64, b: f64, x: f64) -> f64 {
    let ln_front = a * math::ln(x) + b * math::ln_1p(-x) - ln_beta(a, b);
    math::exp(ln_front) / (a * continued_fraction(a, b, x))
}

/// 1 + d₁/(1 + d₂/(1 + ...)) by the modified method of Lentz: C and D are the ratios of successive
/// numerators and denominators of the convergents.
fn continued_fraction(a: f64, b: f64, x: f64) -> f64 {
    /// O(√max(a, b)) terms are needed.
    const TERMS: u32 = 100_000;
    let nonzero = |value: f64| if value == 0.0 { f64::MIN_POSITIVE } else { value };
    let (mut fraction, mut c, mut d) = (1.0, 1.0, 0.0);
    for pair in 0..TERMS {
        let m = f64::from(pair);
        let n = m + 1.0;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let even = n * (b - n) * x / ((a + 2.0 * n - 1.0) * (a + 2.0 * n));
        let before = fraction;
        for term in [odd, even] {
            d = 1.0 / nonzero(1.0 + term * d);
            c = nonzero(1.0 + term / c);
            fraction *= c * d;
        }
        if (fraction - before).abs() <= f64::EPSILON * fraction.abs() {
            break;
        }
    }
    fraction
}

/// ln B(a, b). If a is large and b small, ln Γ(a) and ln Γ(a + b) are nearly equal, so their difference is
/// computed from Stirling's formula, term by term.
fn ln_beta(a: f64, b: f64) -> f64 {
    /// From here on, the remainder below is accurate to 10⁻¹⁵.
    const LARGE: f64 = 20.0;
    let (small, large) = (a.min(b), a.max(b));
    let sum = small + large;
    if large < LARGE {
        return math::ln_gamma(small) + math::ln_gamma(large) - math::ln_gamma(sum);
    }
    // ln Γ(x) = (x − ½)·ln x − x + ½·ln 2π + remainder
    let remainder = |x: f64| {
        let squared = x * x;
        (1.0 / 12.0 - (1.0 / 360.0 - (1.0 / 1260.0 - 1.0 / (1680.0 * squared)) / squared) / squared)
            / x
    };
    let difference = remainder(large)
        - remainder(sum)
        - (large - 0.5) * math::ln_1p(small / large)
        - small * (math::ln(sum) - 1.0);
    let of_small = if small < LARGE {
        math::ln_gamma(small)
    } else {
        (small - 0.5) * math::ln(small) - small + 0.5 * math::ln(2.0 * PI) + remainder(small)
    };
    of_small + difference
}

/// The x with P(X ≤ x) = `probability`, by bisection, to the last bit.
pub(crate) fn quantile(a: f64, b: f64, probability: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if self::probability(a, b, middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// For integer shape parameters, the probability is that of at least `a` hits in a + b − 1 trials of rate x.
        #[test]
        fn sums_of_binomials(a in 1..60u32, b in 1..60u32, x in 0.01..0.99f64) {
            let trials = a + b - 1;
            let mut coefficient = 1.0;
            let mut sum = 0.0;
            for hits in 0..=trials {
                if hits >= a {
                    sum += coefficient * x.powi(hits as i32) * (1.0 - x).powi((trials - hits) as i32);
                }
                coefficient *= f64::from(trials - hits) / f64::from(hits + 1);
            }
            let found = probability(f64::from(a), f64::from(b), x);
            prop_assert!((found - sum).abs() < 1e-12, "{found} for {sum}");
            if sum < 0.5 {
                prop_assert!((found / sum - 1.0).abs() < 1e-11, "{found:e} for {sum:e}");
            }
        }

        /// Where the density is steep (near 1, with small `b`), the probabilities of adjacent floats are
        /// farther apart than the bound.
        #[test]
        fn quantiles_have_their_probability(a in 0.1..500.0f64, b in 0.1..500.0f64, p in 0.001..0.999f64) {
            let x = quantile(a, b, p);
            let [below, at, above] = [x.next_down(), x, x.next_up()].map(|x| probability(a, b, x));
            let is_between_neighbours = below <= p && p <= above;
            prop_assert!(
                (at - p).abs() < 1e-10 || is_between_neighbours || !(1e-300..1.0 - 1e-12).contains(&x)
            );
        }
    }
}
