//! Criteria for the size of a map of K of N points (docs/refinement.md), in nats per point; smaller is better.

use std::f64::consts::{E, TAU};

use mcl_core::{Bounds, PointMap, math};

use crate::{LogLikelihood, MapError, PointSet, mixture_log_likelihood};

/// The Bayesian information criterion (Schwarz 1978), halved and per point: `−ln p(D|Θ)/N + K·D·ln N/2N`,
/// for K means of D coordinates (`dimensions`) each. `log_likelihood` is ln p(D|Θ)/N.
pub fn bic(log_likelihood: f64, points: usize, map_points: usize, dimensions: usize) -> f64 {
    let points = points as f64;
    map_points as f64 * dimensions as f64 * math::ln(points) / (2.0 * points) - log_likelihood
}

/// The description length (Rissanen 1978) of the set of points of which `map` is a subset, per point and
/// without the terms that are equal for all maps. It encodes K, the K points of the map (each uniform in a box around
/// the data), and the N − K other points by the mixture of standard deviation `sigma` (m):
/// `[ln N + ln C(N, K) + K·ln V − Σ ln p(x|Θ)]/N`, with the sum over the other points. `log_likelihood` is that of
/// all N points under the mixture. ln C(N, K) appears because neither set has an order. V is the volume of the
/// bounding box of the data, enlarged by σ·√(2πe) on each axis (the box with the entropy of the Gaussian).
///
/// # Errors
/// Those of [`mixture_log_likelihood`] and [`PointSet::new`].
pub fn description_length<const D: usize>(
    data: &PointSet<D>,
    map: &PointMap<D>,
    sigma: f64,
    log_likelihood: LogLikelihood,
) -> Result<f64, MapError> {
    let own = PointSet::new(map.points().to_vec())?;
    let others = log_likelihood.total - mixture_log_likelihood(&own, map, sigma)?.total;
    let width = sigma * (TAU * E).sqrt();
    let bounds = Bounds::of(data.points()).unwrap_or(map.bounds());
    let ln_volume: f64 = (0..D).map(|axis| math::ln(bounds.extent(axis) + width)).sum();
    let (points, map_points) = (data.len(), map.len().min(data.len()));
    let [n, k, rest] =
        [points, map_points, points - map_points].map(|count| math::ln_gamma(count as f64 + 1.0));
    let count = points as f64;
    Ok((math::ln(count) + n - k - rest + map_points as f64 * ln_volume - others) / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worked_by_hand() {
        assert!((bic(-3.0, 100, 7, 2) - (3.0 + 7.0 * 100_f64.ln() / 100.0)).abs() < 1e-12);
        // 2 of 5 points: 10 subsets, in a box of 3 m by 4 m and a little more.
        let points = vec![[0.0, 0.0], [3.0, 0.0], [3.0, 4.0], [1.0, 1.0], [2.0, 3.0]];
        let sigma = 0.5;
        let map = PointMap::new(vec![points[1], points[3]]).unwrap();
        let others: f64 = [0, 2, 4]
            .iter()
            .map(|&i: &usize| {
                let powers = map.points().iter().map(|mean| {
                    let squared: f64 =
                        (0..2).map(|axis| (points[i][axis] - mean[axis]).powi(2)).sum();
                    (-squared / (2.0 * sigma * sigma)).exp()
                });
                (powers.sum::<f64>() / (2.0 * TAU * sigma * sigma)).ln()
            })
            .sum();
        let wider = sigma * (TAU * E).sqrt();
        let volume = (3.0 + wider) * (4.0 + wider);
        let expected = (5f64.ln() + 10f64.ln() + 2.0 * volume.ln() - others) / 5.0;
        let data = PointSet::new(points).unwrap();
        let all = mixture_log_likelihood(&data, &map, sigma).unwrap();
        let length = description_length(&data, &map, sigma, all).unwrap();
        assert!((length - expected).abs() < 1e-12, "{length} for {expected}");
    }

    /// Encoding every point as a map point leaves nothing to the mixture, so it is never short.
    #[test]
    fn all_points_are_not_a_short_description() {
        let points: Vec<[f64; 2]> = (0..400)
            .map(|i| [f64::from(i % 4) + 0.01 * f64::from(i % 7), 0.01 * f64::from(i % 11)])
            .collect();
        let data = PointSet::new(points.clone()).unwrap();
        let length = |map: Vec<[f64; 2]>| {
            let map = PointMap::new(map).unwrap();
            let all = mixture_log_likelihood(&data, &map, 0.05).unwrap();
            description_length(&data, &map, 0.05, all).unwrap()
        };
        assert!(length(points[..4].to_vec()) < length(points.clone()));
    }
}
