//! `--size auto` and `--sigma auto`: numbers that the data decides (docs/refinement.md).

mod by_localization;
mod racing;

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use clap::ValueEnum;
use mcl_core::PointMap;
use mcl_maps::choice::{Search, Tried, best, minimize};
use mcl_maps::size_criteria::{bic, description_length};
use mcl_maps::{LogLikelihood, MapError, MapSize, PointSet, mixture_log_likelihood};
use serde::{Deserialize, Serialize};

pub use by_localization::{race_sizes, size_by_localization};
pub use racing::{Lane, Race, RaceSettings, Verdict, judge, race};

use crate::experiment::{FOLDS, HeldOut, hold_out};
use mcl_study::data::source::LogSource;

/// Sizes are tried from this many points up.
const SMALLEST_SIZE: f64 = 2.0;
/// σ is looked for between these (m).
pub const SIGMA_RANGE: [f64; 2] = [0.005, 5.0];

/// What decides an automatic size or sigma (docs/refinement.md).
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ValueEnum, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// The likelihood of blocks of scans left out in turn.
    HeldOut,
    /// The Bayesian information criterion (size).
    Bic,
    /// The description length of data and map (size).
    Mdl,
    /// The smallest map that localizes within 5 % of all points (size; takes minutes).
    Localization,
    /// The likelihood of the very data, as EM would estimate it (sigma).
    Likelihood,
}

impl Criterion {
    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Criterion::HeldOut => "held-out",
            Criterion::Bic => "bic",
            Criterion::Mdl => "mdl",
            Criterion::Localization => "localization",
            Criterion::Likelihood => "likelihood",
        }
    }

    /// Whether it can decide a size.
    pub fn decides_size(self) -> bool {
        // More points are always likelier.
        self != Criterion::Likelihood
    }

    /// Whether it can decide a σ.
    pub fn decides_sigma(self) -> bool {
        matches!(self, Criterion::HeldOut | Criterion::Likelihood)
    }
}

/// A number that was chosen, and what it was chosen from.
#[derive(Debug, Clone, Serialize)]
pub struct Chosen {
    /// What decided.
    pub by: Criterion,
    /// The chosen number of points, or σ in metres.
    pub value: f64,
    /// What was tried, with the score that decided (smaller is better).
    pub tried: Vec<Try>,
    /// The races of a choice by localization.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub races: Vec<Race>,
}

impl Chosen {
    /// The score of the choice.
    pub fn score(&self) -> Option<f64> {
        self.tried.iter().find(|tried| tried.value == self.value).map(|tried| tried.score)
    }
}

/// A number of points or σ with its score.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Try {
    /// Number of points, or σ in metres.
    pub value: f64,
    /// Smaller is better.
    pub score: f64,
}

/// Builds a map of some points at a size and σ.
pub type Build<'a, const D: usize> =
    &'a (dyn Fn(&PointSet<D>, Option<MapSize>, f64) -> Result<PointMap<D>, MapError> + Sync);

/// What maps are built of and rated by.
pub struct Rating<'a, const D: usize> {
    /// All points.
    pub data: &'a PointSet<D>,
    /// Other points, for [`Criterion::HeldOut`]: what maps are built of, and what rates these.
    pub folds: &'a [HeldOut<D>],
    /// How maps are built.
    pub build: Build<'a, D>,
}

/// The divisions of a log by time.
///
/// # Errors
/// As [`hold_out`].
pub fn folds_of(log: &LogSource) -> Result<Vec<HeldOut<2>>> {
    (0..FOLDS).map(|fold| hold_out(&log.recording, log.max_range, fold)).collect()
}

impl<const D: usize> Rating<'_, D> {
    /// The scores of the maps of a size (`None`: one that the builder does not need to be told) and σ by several
    /// criteria, in nats per point; smaller is better.
    ///
    /// # Errors
    /// When a map cannot be built, or the criterion is no likelihood.
    pub fn scores(
        &self,
        criteria: &[Criterion],
        size: Option<MapSize>,
        sigma: f64,
    ) -> Result<Vec<f64>> {
        let mut own = None;
        let mut scores = Vec::with_capacity(criteria.len());
        for by in criteria {
            if *by == Criterion::HeldOut {
                scores.push(-self.held_out(size, sigma)?);
                continue;
            }
            let (map, found) = match &mut own {
                Some(known) => known,
                None => own.insert(self.own(size, sigma)?),
            };
            scores.push(match by {
                Criterion::Bic => bic(found.per_point, self.data.len(), map.len(), D),
                Criterion::Mdl => description_length(self.data, map, sigma, *found)?,
                Criterion::Likelihood => -found.per_point,
                Criterion::Localization | Criterion::HeldOut => {
                    bail!("{} is no likelihood", by.name())
                }
            });
        }
        Ok(scores)
    }

    /// The map of a size and σ, and how likely the points are that it is built of.
    ///
    /// # Errors
    /// When the map cannot be built.
    fn own(&self, size: Option<MapSize>, sigma: f64) -> Result<(PointMap<D>, LogLikelihood)> {
        let map = (self.build)(self.data, size, sigma)?;
        let log_likelihood = mixture_log_likelihood(self.data, &map, sigma)?;
        Ok((map, log_likelihood))
    }

    /// Mean log-likelihood per held-out point (nats).
    ///
    /// # Errors
    /// When a map cannot be built.
    pub fn held_out(&self, size: Option<MapSize>, sigma: f64) -> Result<f64> {
        let (mut total, mut points) = (0.0, 0);
        for HeldOut { building, held_out } in self.folds {
            let map = (self.build)(building, size, sigma)?;
            total += mixture_log_likelihood(held_out, &map, sigma)?.total;
            points += held_out.len();
        }
        Ok(total / points as f64)
    }

    /// The largest size that there can be, in points.
    fn largest(&self, by: Criterion) -> usize {
        let all = self.data.len();
        match by {
            Criterion::HeldOut => {
                self.folds.iter().map(|fold| fold.building.len()).min().unwrap_or(all)
            }
            _ => all,
        }
    }

    /// The number of points by a criterion that is a likelihood. `observe` is told what was tried.
    ///
    /// # Errors
    /// As [`Rating::scores`].
    pub fn choose_size(&self, by: Criterion, sigma: f64, observe: impl Fn(&Try)) -> Result<Chosen> {
        let largest = self.largest(by);
        // Sizes that round to the same are built once.
        let mut known: BTreeMap<usize, f64> = BTreeMap::new();
        let score = |value: f64| -> Result<f64> {
            let points = (value.round() as usize).clamp(1, largest);
            if let Some(&score) = known.get(&points) {
                return Ok(score);
            }
            let score = self.scores(&[by], Some(MapSize::Points(points)), sigma)?[0];
            observe(&Try { value: points as f64, score });
            known.insert(points, score);
            Ok(score)
        };
        let range = [SMALLEST_SIZE.min(largest as f64), largest as f64];
        let search = Search { range, factor: 1.4, patience: 4, precision: 1.03 };
        Ok(chosen(by, &minimize(&search, score)?, f64::round))
    }

    /// σ by a criterion. `observe` is told what was tried.
    ///
    /// # Errors
    /// As [`Rating::scores`].
    pub fn choose_sigma(
        &self,
        by: Criterion,
        size: Option<MapSize>,
        observe: impl Fn(&Try),
    ) -> Result<Chosen> {
        let score = |sigma: f64| -> Result<f64> {
            let score = self.scores(&[by], size, sigma)?[0];
            observe(&Try { value: sigma, score });
            Ok(score)
        };
        let search = Search { range: SIGMA_RANGE, factor: 1.6, patience: 2, precision: 1.03 };
        Ok(chosen(by, &minimize(&search, score)?, |sigma| sigma))
    }
}

fn chosen(by: Criterion, tried: &[Tried], value: impl Fn(f64) -> f64) -> Chosen {
    let choice = best(tried).map_or(f64::NAN, |tried| tried.value);
    let tried = tried.iter().map(|t| Try { value: value(t.value), score: t.score }).collect();
    Chosen { by, value: value(choice), tried, races: Vec::new() }
}
