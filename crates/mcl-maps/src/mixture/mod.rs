//! The Gaussian mixture represented by a sample-based map (paper, equations 1, 2 and 4).
//!
//! A sum over the K components of a point omits only components whose total contribution is
//! below ε (10⁻¹²) of the sum. Points and components are matched by descending a tree of boxes over
//! the points: with U the largest distance from a position in the box to the nearest component, a
//! component farther than √(U² + 2σ²·ln(n/ε)) from the box is omitted for all its points, because n of them
//! give at most n·exp(−(U² + 2σ²·ln(n/ε))/2σ²) = ε·exp(−U²/2σ²), and the sum of each point is at least
//! exp(−U²/2σ²). On the way down n is K, at a leaf it is the length of the list it selects from; each gets
//! half of ε. The list of components shrinks on the way, so no index over components is needed, and
//! the method does not depend on how points or components are distributed. If only one component is left, the sums
//! over the points below follow from their number, mean and scatter.

mod by_point;
mod components;
mod exp;
mod expectation;
mod kernel;
mod log_product;
mod removal;
mod sums;

pub use by_point::point_log_likelihoods;
pub(crate) use expectation::{Expectation, expectation};
pub(crate) use kernel::Pull;
pub(crate) use removal::removal;
pub(crate) use sums::Sums;

use std::f64::consts::TAU;

use mcl_core::{PointMap, math};
use serde::{Deserialize, Serialize};

use crate::{MapError, PointSet};

/// Log-likelihood of a set of points under a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LogLikelihood {
    /// ln p(D | Θ) in nats (equation 2), the sum over all points, of a density per metre to the
    /// power of D.
    pub total: f64,
    /// The total divided by the number of points.
    pub per_point: f64,
}

/// Computes the mixture log-likelihood `Σᵢ [ln Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²) − ln K − D/2·ln(2πσ²)]` of the points
/// under a map (paper, equations 1 and 2), with `sigma` in metres. Finite for every finite point,
/// however far from the map.
///
/// # Errors
/// [`MapError::Setting`] unless `sigma` is positive; [`MapError::Memory`].
///
/// # Example
/// ```
/// use mcl_core::PointMap;
/// use mcl_maps::{PointSet, mixture_log_likelihood};
///
/// let data = PointSet::new(vec![[0.0, 0.0], [0.0, 0.1]])?;
/// let map = PointMap::new(vec![[0.0, 0.0]])?;
/// // Per point −ln(2πσ²), less the squared distance over 2σ²: 0 for the first point, 1/2 for the second.
/// let expected = -(std::f64::consts::TAU * 0.01).ln() - 0.25;
/// let found = mixture_log_likelihood(&data, &map, 0.1)?;
/// assert!((found.per_point - expected).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn mixture_log_likelihood<const D: usize>(
    data: &PointSet<D>,
    map: &PointMap<D>,
    sigma: f64,
) -> Result<LogLikelihood, MapError> {
    check_sigma(sigma)?;
    data.check_tree_fits()?;
    let expectation = expectation(data, &data.centred(map.points()), sigma, false);
    Ok(log_likelihood(data.len(), expectation.log_sum, D, map.len(), sigma))
}

/// Adds the terms that do not depend on the component means: −ln K − D/2·ln(2πσ²) per point.
pub(crate) fn log_likelihood(
    points: usize,
    log_sum: f64,
    dimensions: usize,
    components: usize,
    sigma: f64,
) -> LogLikelihood {
    let normalizer =
        math::ln(components as f64) + 0.5 * dimensions as f64 * math::ln(TAU * sigma * sigma);
    let total = log_sum - points as f64 * normalizer;
    LogLikelihood { total, per_point: total / points as f64 }
}

/// Checks that σ² and the exponents of points kilometres away are within the range of a float.
pub(crate) fn check_sigma(sigma: f64) -> Result<(), MapError> {
    if (1e-9..=1e9).contains(&sigma) {
        return Ok(());
    }
    Err(MapError::Setting {
        setting: "sigma (m)",
        value: sigma,
        expected: "a number from 1e-9 to 1e9",
    })
}
