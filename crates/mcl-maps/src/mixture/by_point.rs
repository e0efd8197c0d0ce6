use mcl_core::memory::with_room;
use mcl_core::{NearestNeighbors, Point, PointMap, check_finite, math};
use rayon::prelude::*;

use super::{check_sigma, log_likelihood};
use crate::MapError;

/// Components that contribute less than this part of a point's sum, all together, are omitted.
const EPSILON: f64 = 1e-12;

/// The log-likelihood of each point under a map (paper, equation 1), in nats, with `sigma` in metres. The sum over the
/// components of a point omits only components whose total contribution is below 10⁻¹² of the sum. Where only the total
/// is needed, [`mixture_log_likelihood`](crate::mixture_log_likelihood) is faster.
///
/// # Errors
/// [`MapError::Setting`] unless `sigma` is positive; [`MapError::Points`] for points that are not finite, and if
/// there is not enough memory.
///
/// # Example
/// ```
/// use mcl_core::PointMap;
/// use mcl_maps::mixture::point_log_likelihoods;
///
/// let map = PointMap::new(vec![[0.0, 0.0]])?;
/// let found = point_log_likelihoods(&[[0.0, 0.0], [2.0, 0.0]], &map, 1.0)?;
/// assert!((found[0] + std::f64::consts::TAU.ln()).abs() < 1e-12);
/// assert!((found[0] - found[1] - 2.0).abs() < 1e-12);
/// # Ok::<(), mcl_maps::MapError>(())
/// ```
pub fn point_log_likelihoods<const D: usize>(
    points: &[Point<D>],
    map: &PointMap<D>,
    sigma: f64,
) -> Result<Vec<f64>, MapError> {
    check_sigma(sigma)?;
    check_finite(points)?;
    let components = NearestNeighbors::new(map.points())?;
    let doubled = 2.0 * sigma * sigma;
    let beyond = doubled * math::ln(map.len() as f64 / EPSILON);
    let of_point = |point: &Point<D>| {
        let nearest = components.nearest(point).distance_squared;
        let mut sum = 0.0;
        components.for_each_within(point, (nearest + beyond).sqrt(), |component| {
            sum += math::exp((nearest - component.distance_squared) / doubled);
        });
        // The nearest component counts as 1; a radius that is rounded may leave it out.
        let log_sum = math::ln(f64::max(sum, 1.0)) - nearest / doubled;
        log_likelihood(1, log_sum, D, map.len(), sigma).total
    };
    let mut found = with_room(points.len(), "likelihoods of points")?;
    points.par_iter().map(of_point).collect_into_vec(&mut found);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PointSet, mixture_log_likelihood};

    /// Points on a spiral, among them some far off.
    fn points(count: u32) -> Vec<Point<2>> {
        let place = |i: u32| {
            let turn = f64::from(i) * 0.37;
            [turn * math::cos(turn) * 0.1, turn * math::sin(turn) * 0.1]
        };
        (0..count).map(place).chain([[1e4, -3.0]]).collect()
    }

    #[test]
    fn points_have_the_likelihood_of_the_whole_sum() {
        let data = points(300);
        let map = PointMap::new(data.iter().step_by(7).copied().collect()).unwrap();
        for sigma in [0.05, 0.5, 20.0] {
            let found = point_log_likelihoods(&data, &map, sigma).unwrap();
            for (point, found) in data.iter().zip(&found) {
                let exponent = |mean: &Point<2>| {
                    let [x, y] = [point[0] - mean[0], point[1] - mean[1]];
                    -(x * x + y * y) / (2.0 * sigma * sigma)
                };
                let exponents: Vec<f64> = map.points().iter().map(exponent).collect();
                let largest = exponents.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let sum: f64 = exponents.iter().map(|e| (e - largest).exp()).sum();
                let normalizer = (map.len() as f64 * std::f64::consts::TAU * sigma * sigma).ln();
                let expected = largest + sum.ln() - normalizer;
                assert!((found - expected).abs() <= 1e-10 * expected.abs().max(1.0));
            }
            let total = mixture_log_likelihood(&PointSet::new(data.clone()).unwrap(), &map, sigma);
            let (sum, total) = (found.iter().sum::<f64>(), total.unwrap().total);
            assert!((sum - total).abs() <= 1e-10 * total.abs(), "{sigma}: {sum} {total}");
        }
        assert!(point_log_likelihoods(&[[f64::NAN, 0.0]], &map, 1.0).is_err());
        assert!(point_log_likelihoods(&data, &map, 0.0).is_err());
    }
}
