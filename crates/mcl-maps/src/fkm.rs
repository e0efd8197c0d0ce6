use mcl_core::{Point, PointMap};
use serde::{Deserialize, Serialize};

use crate::mixture::{Expectation, Pull, check_sigma, expectation, log_likelihood};
use crate::{MapError, PointSet};

/// A component with a total responsibility below this (the bound on what sums omit) is not responsible for any point,
/// and keeps its mean.
const NO_RESPONSIBILITY: f64 = 1e-12;

/// Settings of fuzzy k-means.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FkmSettings {
    /// σ: standard deviation of every component in metres, equal along all axes.
    pub sigma: f64,
    /// Stop when an update gains less than this log-likelihood per point (nats).
    pub tolerance: f64,
    /// Stop after this many updates.
    pub max_iterations: usize,
}

impl Default for FkmSettings {
    fn default() -> Self {
        FkmSettings { sigma: 0.05, tolerance: 1e-4, max_iterations: 1000 }
    }
}

impl FkmSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`MapError::Setting`] names the first setting out of range.
    pub fn check(&self) -> Result<(), MapError> {
        check_sigma(self.sigma)?;
        if self.tolerance.is_finite() && self.tolerance >= 0.0 {
            return Ok(());
        }
        Err(MapError::Setting {
            setting: "tolerance (nats per point)",
            value: self.tolerance,
            expected: "a finite number of at least 0",
        })
    }
}

/// Report of a run of fuzzy k-means.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FkmReport {
    /// Number of updates of the means.
    pub iterations: usize,
    /// Whether the last update gained less than the tolerance.
    pub converged: bool,
    /// Log-likelihood per point in nats: entry *t* is that of the model after *t* updates.
    pub log_likelihood_trace: Vec<f64>,
}

/// Runs fuzzy k-means: EM for the means of a mixture of equal, equally weighted isotropic Gaussians (paper,
/// equations 4 and 5), from the points of `initial` to a local maximum of the likelihood of the data.
///
/// Stops after update *t* when `trace[t] − trace[t−1] < tolerance`. A component that is not responsible for any
/// point keeps its mean. `observe` is called after each evaluation with the number of updates and the log-likelihood
/// per point.
///
/// Returns the means, in the order of `initial`, and a report; [`snap_to_data`] turns the means into a
/// subset of the data. The result is the same bit for bit for any number of threads.
///
/// # Errors
/// [`MapError::Setting`] for settings out of range; [`MapError::Memory`].
pub fn fuzzy_k_means<const D: usize>(
    data: &PointSet<D>,
    initial: &PointMap<D>,
    settings: &FkmSettings,
    mut observe: impl FnMut(usize, f64),
) -> Result<(Vec<Point<D>>, FkmReport), MapError> {
    settings.check()?;
    data.check_tree_fits()?;
    let mut model = Model::new(data, data.centred(initial.points()), settings.sigma);
    let mut trace = vec![model.per_point];
    observe(0, model.per_point);
    let mut converged = false;
    while !converged && trace.len() <= settings.max_iterations {
        let updated = model.update(data, settings.sigma);
        converged = updated.per_point - model.per_point < settings.tolerance;
        observe(trace.len(), updated.per_point);
        trace.push(updated.per_point);
        model = updated;
    }
    let report = FkmReport { iterations: trace.len() - 1, converged, log_likelihood_trace: trace };
    Ok((data.absolute(&model.means), report))
}

/// The means with the result of the E step and the displacements of the M step.
pub(crate) struct Model<const D: usize> {
    /// Relative to the centre of the data, because sums of UTM coordinates would lose digits.
    pub means: Vec<Point<D>>,
    /// Log-likelihood per point in nats.
    pub per_point: f64,
    /// The displacement of each mean in an update (m).
    pub steps: Vec<Point<D>>,
}

impl<const D: usize> Model<D> {
    pub fn new(data: &PointSet<D>, means: Vec<Point<D>>, sigma: f64) -> Self {
        let Expectation { log_sum, pulls } = expectation(data, &means, sigma, true);
        let per_point = log_likelihood(data.len(), log_sum, D, means.len(), sigma).per_point;
        let step = |pull: &Pull<D>| match pull.weight >= NO_RESPONSIBILITY {
            true => pull.displacement.map(|sum| sum / pull.weight),
            false => [0.0; D],
        };
        Model { means, per_point, steps: pulls.iter().map(step).collect() }
    }

    /// The model after one update of EM.
    pub fn update(&self, data: &PointSet<D>, sigma: f64) -> Self {
        let mut means = self.means.clone();
        for (mean, step) in means.iter_mut().zip(&self.steps) {
            for axis in 0..D {
                mean[axis] += step[axis];
            }
        }
        Model::new(data, means, sigma)
    }
}

/// Replaces each mean by its nearest data point (of those within 10⁻⁹ m of the smallest distance, the one with the
/// lowest index) and drops duplicates. Returns indices into the data, in the order of the means.
pub fn snap_to_data<const D: usize>(data: &PointSet<D>, means: &[Point<D>]) -> Vec<usize> {
    let neighbors = data.neighbors();
    let mut taken = vec![false; data.len()];
    means
        .iter()
        .map(|mean| neighbors.nearest_earliest(mean).index)
        .filter(|&index| !std::mem::replace(&mut taken[index], true))
        .collect()
}
