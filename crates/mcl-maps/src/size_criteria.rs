//! What a map of K of N points costs and explains: criteria for its size (docs/refinement.md). All in nats
//! per point; smaller is better.

use statrs::function::factorial::ln_factorial;

/// The Bayesian information criterion (Schwarz 1978), halved and per point: `−ln p(D|Θ)/N + K·D·ln N/2N`,
/// for K means of D coordinates (`dimensions`) each. `log_likelihood` is ln p(D|Θ)/N.
pub fn bic(log_likelihood: f64, points: usize, map_points: usize, dimensions: usize) -> f64 {
    let points = points as f64;
    map_points as f64 * dimensions as f64 * points.ln() / (2.0 * points) - log_likelihood
}

/// The description length (Rissanen 1978) of data and map, per point, up to a constant: the data by the
/// mixture, the map as one of the subsets of K of the N points, and K itself: `−ln p(D|Θ)/N + (ln C(N, K) +
/// ln N)/N`.
pub fn description_length(log_likelihood: f64, points: usize, map_points: usize) -> f64 {
    let [n, k, rest] =
        [points, map_points, points - map_points].map(|count| ln_factorial(count as u64));
    let count = points as f64;
    (n - k - rest + count.ln()) / count - log_likelihood
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worked_by_hand() {
        // 2 of 5 points: 10 subsets.
        let length = description_length(-3.0, 5, 2);
        assert!((length - (3.0 + (10_f64.ln() + 5_f64.ln()) / 5.0)).abs() < 1e-12, "{length}");
        assert!((bic(-3.0, 100, 7, 2) - (3.0 + 7.0 * 100_f64.ln() / 100.0)).abs() < 1e-12);
    }
}
