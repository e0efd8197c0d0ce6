use std::sync::LazyLock;

use rand::{Rng, RngExt};
use rand_distr::Distribution;

use crate::math;

/// The standard normal distribution, sampled by the ziggurat method (G. Marsaglia & W. W. Tsang, *The Ziggurat
/// Method for Generating Random Variables*, 2000): layers of equal area cover the density f(x) = exp(−x²/2), and
/// all but one draw in 80 fall in the part of a layer that lies entirely under it.
///
/// The sampler of `rand_distr` uses the C library's exponentials and logarithms; this one gives the same bits on
/// every processor.
///
/// # Example
/// ```
/// use mcl_core::{Seed, StandardNormal};
/// use rand_distr::Distribution;
///
/// let squares: f64 =
///     StandardNormal.sample_iter(Seed::new(1).rng()).take(3000).map(|z: f64| z * z).sum();
/// assert!((squares / 3000.0 - 1.0).abs() < 0.1);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct StandardNormal;

const LAYERS: usize = 256;
/// x at which the tail of the lowest layer begins.
const TAIL: f64 = 3.654_152_885_361_009;
/// Area of each layer; that of the lowest includes the tail.
const AREA: f64 = 0.004_928_673_233_974_658;

struct Layers {
    /// Layer i spans 0 to `x[i]` and lies under f up to `x[i + 1]`. The lowest has the width it would have
    /// without a tail.
    x: [f64; LAYERS + 1],
    /// f(x): the lower edges of the layers.
    f: [f64; LAYERS + 1],
}

static LAYERS_UNDER_F: LazyLock<Layers> = LazyLock::new(|| {
    let mut x = [0.0; LAYERS + 1];
    x[0] = AREA / f(TAIL);
    x[1] = TAIL;
    for i in 2..LAYERS {
        x[i] = (-2.0 * math::ln(f(x[i - 1]) + AREA / x[i - 1])).sqrt();
    }
    Layers { x, f: x.map(f) }
});

fn f(x: f64) -> f64 {
    math::exp(-0.5 * x * x)
}

impl Distribution<f64> for StandardNormal {
    #[inline]
    fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> f64 {
        let layers = &*LAYERS_UNDER_F;
        loop {
            // Eight bits choose the layer, 53 others the position in it, from −1 to 1.
            let bits: u64 = rng.random();
            let layer = bits as usize % LAYERS;
            let place = (bits as i64 >> 11) as f64 / (1_u64 << 52) as f64;
            let x = place * layers.x[layer];
            if x.abs() < layers.x[layer + 1] {
                return x;
            }
            if layer == 0 {
                return tail(rng).copysign(x);
            }
            let [below, above] = [layers.f[layer], layers.f[layer + 1]];
            if below + (above - below) * rng.random::<f64>() < f(x) {
                return x;
            }
        }
    }
}

/// Samples the tail beyond the layers (G. Marsaglia 1964).
#[cold]
fn tail<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    loop {
        // In (0, 1], so that the logarithm is finite.
        let [a, b] = [0, 1].map(|_| -math::ln(1.0 - rng.random::<f64>()));
        let beyond = a / TAIL;
        if 2.0 * b >= beyond * beyond {
            return TAIL + beyond;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Seed;

    /// Pinned values, so that no processor or dependency can silently change results.
    #[test]
    fn stream_is_stable() {
        let mut rng = Seed::new(1).rng();
        let drawn: [f64; 5] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
        assert_eq!(
            drawn.map(f64::to_bits),
            [
                0x3ff7_2cfd_eba1_c9cc,
                0x3fe2_626a_6df7_21ba,
                0x3fee_ee84_6ebe_b686,
                0xbf7f_2b93_8acd_abc4,
                0x3fe7_2c1b_b0ff_19b2
            ]
        );
        let sum: f64 = StandardNormal.sample_iter(rng).take(100_000).map(f64::abs).sum();
        assert_eq!(sum.to_bits(), 0x40f3_8e52_e9f0_478a);
    }

    /// The highest layer, which follows from the areas of the others, has the same area.
    #[test]
    fn layers_fill_the_area_under_the_density() {
        let Layers { x, f } = &*LAYERS_UNDER_F;
        assert!(x.is_sorted_by(|a, b| a > b) && f[LAYERS] == 1.0);
        let area = x[LAYERS - 1] * (1.0 - f[LAYERS - 1]);
        assert!((area / AREA - 1.0).abs() < 1e-9, "{area}");
    }

    #[test]
    fn moments_and_tails_are_those_of_the_distribution() {
        const N: usize = 4_000_000;
        let rng = Seed::new(2).rng();
        let drawn: Vec<f64> = StandardNormal.sample_iter(rng).take(N).collect();
        let mean = |of: &dyn Fn(f64) -> f64| drawn.iter().map(|&z| of(z)).sum::<f64>() / N as f64;
        let pairs = |of: &dyn Fn(f64, f64) -> f64| {
            drawn.chunks(2).map(|pair| of(pair[0], pair[1])).sum::<f64>() / (N / 2) as f64
        };
        let share = |low: f64, high: f64| mean(&|z| f64::from(low < z && z <= high));
        // Each with the variance of one term; deviations beyond 4.5 standard errors occur once in 150,000 runs.
        for (found, expected, variance) in [
            (mean(&|z| z), 0.0, 1.0),
            (mean(&|z| z * z), 1.0, 2.0),
            (mean(&|z| z.powi(3)), 0.0, 15.0),
            (mean(&|z| z.powi(4)), 3.0, 96.0),
            (pairs(&|a, b| a * b), 0.0, 2.0),
            (pairs(&|a, b| a * a * b * b), 1.0, 16.0),
            // Φ(0.5) − Φ(0), Φ(2) − Φ(1), and the tails, the last one beyond all layers.
            (share(0.0, 0.5), 0.191_462_461, 0.191),
            (share(1.0, 2.0), 0.135_905_122, 0.136),
            (share(-9.0, -3.0), 1.349_898e-3, 1.35e-3),
            (share(TAIL, 9.0), 1.290_33e-4, 1.29e-4),
            (share(-9.0, -4.0), 3.167_124e-5, 3.17e-5),
        ] {
            let error = (variance / N as f64).sqrt();
            assert!((found - expected).abs() < 4.5 * error, "{found} for {expected}");
        }
    }
}
