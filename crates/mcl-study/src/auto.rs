//! Sizes and σ chosen by the data (docs/refinement.md).

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result};
use mcl_core::PointMap;
use mcl_maps::choice::{Search, Tried, best, minimize};
use mcl_maps::size_criteria::{bic, description_length};
use mcl_maps::{LogLikelihood, MapSize, PointSet, mixture_log_likelihood};
use serde::Serialize;

use crate::recipe::criterion::Criterion;
use crate::trial::division::Division;

/// The smallest size tried, in points.
const SMALLEST_SIZE: f64 = 2.0;
/// Range of the search for σ (m).
pub const SIGMA_RANGE: [f64; 2] = [0.005, 5.0];

/// A chosen number, and the values that were tried.
#[derive(Debug, Clone, Serialize)]
pub struct DataChoice {
    /// The criterion that decided.
    pub by: Criterion,
    /// The chosen number of points, or σ in metres.
    pub value: f64,
    /// The values tried (a number of points, or σ in metres), with their scores (smaller is better).
    pub tried: Vec<Tried>,
}

/// Builds a map of some points at a size (`None`: one that the builder does not need) and σ (m).
pub type Build<'a, const D: usize> =
    &'a (dyn Fn(&PointSet<D>, Option<MapSize>, f64) -> Result<PointMap<D>> + Sync);

/// The data that maps are built from and rated by.
pub struct Rating<'a, const D: usize> {
    /// All points.
    pub data: &'a PointSet<D>,
    /// Divisions of the points, for [`Criterion::HeldOut`]: points that maps are built from, and points that
    /// rate these.
    pub folds: &'a [Arc<Division<D>>],
    /// How maps are built.
    pub build: Build<'a, D>,
}

impl<const D: usize> Rating<'_, D> {
    /// The score of the map of a size and σ by a criterion, in nats per point; smaller is better.
    ///
    /// # Errors
    /// When a map cannot be built.
    pub fn score(&self, by: Criterion, size: Option<MapSize>, sigma: f64) -> Result<f64> {
        if by == Criterion::HeldOut {
            return Ok(-self.held_out(size, sigma)?);
        }
        let map = (self.build)(self.data, size, sigma)?;
        let found: LogLikelihood = mixture_log_likelihood(self.data, &map, sigma)?;
        Ok(match by {
            Criterion::Bic => bic(found.per_point, self.data.len(), map.len(), D),
            Criterion::Mdl => description_length(self.data, &map, sigma, found)?,
            Criterion::Likelihood | Criterion::HeldOut => -found.per_point,
        })
    }

    /// Mean log-likelihood per held-out point (nats).
    fn held_out(&self, size: Option<MapSize>, sigma: f64) -> Result<f64> {
        let (mut total, mut points) = (0.0, 0);
        for fold in self.folds {
            let held_out = fold.held_out.as_ref().context("a fold holds scans out")?;
            let map = (self.build)(&fold.building, size, sigma)?;
            total += mixture_log_likelihood(held_out, &map, sigma)?.total;
            points += held_out.len();
        }
        Ok(total / points as f64)
    }

    /// The largest size of a map that a criterion can rate, in points.
    pub fn largest(&self, by: Criterion) -> usize {
        let all = self.data.len();
        match by {
            Criterion::HeldOut => {
                self.folds.iter().map(|fold| fold.building.len()).min().unwrap_or(all)
            }
            _ => all,
        }
    }

    /// The number of points chosen by a criterion. `observe` is called with each value tried.
    ///
    /// # Errors
    /// As [`Rating::score`].
    pub fn choose_size(
        &self,
        by: Criterion,
        sigma: f64,
        observe: impl Fn(&Tried),
    ) -> Result<DataChoice> {
        let largest = self.largest(by);
        // Sizes that round to the same number are built once.
        let mut known: BTreeMap<usize, f64> = BTreeMap::new();
        let score = |value: f64| -> Result<f64> {
            let points = (value.round() as usize).clamp(1, largest);
            if let Some(&score) = known.get(&points) {
                return Ok(score);
            }
            let score = self.score(by, Some(MapSize::Points(points)), sigma)?;
            observe(&Tried { value: points as f64, score });
            known.insert(points, score);
            Ok(score)
        };
        let range = [SMALLEST_SIZE.min(largest as f64), largest as f64];
        let search = Search { range, factor: 1.4, patience: 4, precision: 1.03 };
        Ok(chosen(by, minimize(&search, score)?, f64::round))
    }

    /// σ (m) chosen by a criterion. `observe` is called with each value tried.
    ///
    /// # Errors
    /// As [`Rating::score`].
    pub fn choose_sigma(
        &self,
        by: Criterion,
        size: Option<MapSize>,
        observe: impl Fn(&Tried),
    ) -> Result<DataChoice> {
        let score = |sigma: f64| -> Result<f64> {
            let score = self.score(by, size, sigma)?;
            observe(&Tried { value: sigma, score });
            Ok(score)
        };
        let search = Search { range: SIGMA_RANGE, factor: 1.6, patience: 2, precision: 1.03 };
        Ok(chosen(by, minimize(&search, score)?, |sigma| sigma))
    }
}

fn chosen(by: Criterion, mut tried: Vec<Tried>, value: impl Fn(f64) -> f64) -> DataChoice {
    tried.iter_mut().for_each(|tried| tried.value = value(tried.value));
    DataChoice { by, value: best(&tried).map_or(f64::NAN, |tried| tried.value), tried }
}
