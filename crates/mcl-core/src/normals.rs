use rand_distr::{Distribution, UnitDisc};

use crate::math;
use crate::seed::Rng;

/// Independent standard normal numbers, two at a time by the polar method (G. Marsaglia & T. A. Bray 1964):
/// of a point in the unit disc at the squared distance s from the middle, each coordinate times √(−2·ln s/s).
/// Keeps the second of a pair for the next number.
///
/// Unlike `rand_distr::StandardNormal`, whose tail takes the C library's exponentials and logarithms,
/// with the same bits on every processor.
///
/// # Example
/// ```
/// use mcl_core::{Normals, Seed};
///
/// let (mut normals, mut rng) = (Normals::default(), Seed::new(1).rng());
/// let squares: f64 = (0..1000).flat_map(|_| normals.draw::<3>(&mut rng)).map(|z| z * z).sum();
/// assert!((squares / 3000.0 - 1.0).abs() < 0.1);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Normals {
    kept: Option<f64>,
}

impl Normals {
    /// The next `N` numbers.
    #[inline]
    pub fn draw<const N: usize>(&mut self, rng: &mut Rng) -> [f64; N] {
        std::array::from_fn(|_| {
            self.kept.take().unwrap_or_else(|| {
                let [now, kept] = pair(rng);
                self.kept = Some(kept);
                now
            })
        })
    }
}

fn pair(rng: &mut Rng) -> [f64; 2] {
    loop {
        let [x, y]: [f64; 2] = UnitDisc.sample(rng);
        let squared = x * x + y * y;
        // The middle, of probability 2⁻¹⁰⁴, has no logarithm.
        if squared > 0.0 {
            let scale = (-2.0 * math::ln(squared) / squared).sqrt();
            return [scale * x, scale * y];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Seed;

    /// Pinned, so that no dependency can silently move results.
    #[test]
    fn stream_is_stable() {
        let (mut normals, mut rng) = (Normals::default(), Seed::new(1).rng());
        let drawn: [f64; 5] = normals.draw(&mut rng);
        assert_eq!(
            drawn.map(f64::to_bits),
            [
                0xbfd8_2ef7_1258_b4be,
                0xbfe5_e441_8a03_3118,
                0xbfe2_2ce5_e301_2f16,
                0xbff2_d0b1_ad96_283c,
                0x3ff6_d854_1c91_f9e8
            ]
        );
        // The sixth is the other of the fifth's pair.
        let before = rng.clone();
        let [_]: [f64; 1] = normals.draw(&mut rng);
        assert_eq!(rng, before);
    }

    /// Moments of the normal distribution, singly, of the two of a pair, and out in the tail.
    #[test]
    fn moments_are_those_of_the_normal_distribution() {
        const N: usize = 400_000;
        let (mut normals, mut rng) = (Normals::default(), Seed::new(2).rng());
        let drawn: Vec<[f64; 2]> = (0..N / 2).map(|_| normals.draw(&mut rng)).collect();
        let mean = |of: &dyn Fn(f64) -> f64| {
            drawn.iter().flatten().map(|&z| of(z)).sum::<f64>() / N as f64
        };
        // Each with the variance of one number; 4.5 standard errors miss once in 150,000.
        let tail = 6.334_248_366_623_973e-5;
        for (found, expected, variance) in [
            (mean(&|z| z), 0.0, 1.0),
            (mean(&|z| z * z), 1.0, 2.0),
            (mean(&|z| z.powi(3)), 0.0, 15.0),
            (mean(&|z| z.powi(4)), 3.0, 96.0),
            (mean(&|z| f64::from(z.abs() > 4.0)), tail, tail),
            (drawn.iter().map(|[a, b]| a * b).sum::<f64>() * 2.0 / N as f64, 0.0, 2.0),
            (
                drawn.iter().map(|[a, b]| a * a * b * b).sum::<f64>() * 2.0 / N as f64,
                1.0,
                2.0 * 8.0,
            ),
        ] {
            let error = (variance / N as f64).sqrt();
            assert!((found - expected).abs() < 4.5 * error, "{found} for {expected}");
        }
    }
}
