//! `--size auto` and `--sigma auto`: numbers that the data decides.

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use mcl_core::PointMap;
use mcl_filter::FilterSettings;
use mcl_maps::choice::{Search, best, minimize};
use mcl_maps::size_criteria::{bic, description_length};
use mcl_maps::{MapError, MapSize, PointSet, mixture_log_likelihood};
use serde::Serialize;

use super::args::AutoBy;
use crate::experiment::{FOLDS, hold_out};
use crate::progress;
use crate::racing::{Lane, Race, RaceSettings, Verdict, race};
use crate::source::LogSource;

/// Sizes are tried from this many points up.
const SMALLEST_SIZE: f64 = 2.0;
/// σ is looked for between these (m).
const SIGMA_RANGE: [f64; 2] = [0.005, 0.5];

/// A number that was chosen, and what it was chosen from.
#[derive(Serialize)]
pub struct Chosen {
    /// What decided.
    pub by: AutoBy,
    /// The chosen number of points, or σ in metres.
    pub value: f64,
    /// What was tried, with the score that decided (smaller is better).
    pub tried: Vec<Try>,
    /// The races of a choice by localization.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub races: Vec<Race>,
}

#[derive(Serialize)]
pub struct Try {
    pub value: f64,
    pub score: f64,
}

/// What maps are rated by.
enum Rated<const D: usize> {
    /// The points that they are built from.
    Same,
    /// Other points: those that build the map, and those that rate it.
    Others(Vec<[PointSet<D>; 2]>),
}

/// Builds a map of some points at a size and σ.
pub type Build<'a, const D: usize> =
    &'a dyn Fn(&PointSet<D>, Option<MapSize>, f64) -> Result<PointMap<D>, MapError>;

/// The number of points by `by`.
pub fn size<const D: usize>(
    by: AutoBy,
    data: &PointSet<D>,
    folds: impl Fn() -> Result<Vec<[PointSet<D>; 2]>>,
    sigma: f64,
    build: Build<D>,
    quiet: bool,
) -> Result<Chosen> {
    let rated = match by {
        AutoBy::HeldOut => Rated::Others(folds()?),
        _ => Rated::Same,
    };
    let largest = match &rated {
        Rated::Same => data.len(),
        Rated::Others(folds) => folds.iter().map(|[building, _]| building.len()).min().unwrap_or(1),
    };
    let bar = progress::spinner("size", quiet);
    // Sizes that round to the same are built once.
    let mut known: BTreeMap<usize, f64> = BTreeMap::new();
    let score = |value: f64| -> Result<f64> {
        let points = (value.round() as usize).clamp(1, largest);
        if let Some(&score) = known.get(&points) {
            return Ok(score);
        }
        let size = Some(MapSize::Points(points));
        let score = match &rated {
            Rated::Others(folds) => -held_out(folds, size, sigma, build)?,
            Rated::Same => {
                let map = build(data, size, sigma)?;
                let per_point = mixture_log_likelihood(data, &map, sigma)?.per_point;
                match by {
                    AutoBy::Bic => bic::<D>(per_point, data.len(), map.len()),
                    _ => description_length(per_point, data.len(), map.len()),
                }
            }
        };
        bar.set_message(format!("{points} points: {score:.4}"));
        known.insert(points, score);
        Ok(score)
    };
    let range = [SMALLEST_SIZE.min(largest as f64), largest as f64];
    let search = Search { range, factor: 1.4, patience: 4, precision: 1.03 };
    let tried = minimize(&search, score)?;
    bar.finish_and_clear();
    Ok(chosen(by, &tried, f64::round))
}

/// σ by `by`.
pub fn sigma<const D: usize>(
    by: AutoBy,
    data: &PointSet<D>,
    folds: impl Fn() -> Result<Vec<[PointSet<D>; 2]>>,
    size: Option<MapSize>,
    build: Build<D>,
    quiet: bool,
) -> Result<Chosen> {
    let folds = match by {
        AutoBy::HeldOut => folds()?,
        _ => Vec::new(),
    };
    let bar = progress::spinner("sigma", quiet);
    let score = |sigma: f64| -> Result<f64> {
        let likelihood = match by {
            AutoBy::HeldOut => held_out(&folds, size, sigma, build)?,
            _ => {
                let map = build(data, size, sigma)?;
                mixture_log_likelihood(data, &map, sigma)?.per_point
            }
        };
        bar.set_message(format!("{sigma:.4} m: {likelihood:.4} nats/point"));
        Ok(-likelihood)
    };
    let search = Search { range: SIGMA_RANGE, factor: 1.6, patience: 2, precision: 1.03 };
    let tried = minimize(&search, score)?;
    bar.finish_and_clear();
    Ok(chosen(by, &tried, |sigma| sigma))
}

fn chosen(by: AutoBy, tried: &[mcl_maps::choice::Tried], value: impl Fn(f64) -> f64) -> Chosen {
    let choice = best(tried).map_or(f64::NAN, |tried| tried.value);
    let tried = tried.iter().map(|t| Try { value: value(t.value), score: t.score }).collect();
    Chosen { by, value: value(choice), tried, races: Vec::new() }
}

/// Mean log-likelihood per held-out point (nats).
fn held_out<const D: usize>(
    folds: &[[PointSet<D>; 2]],
    size: Option<MapSize>,
    sigma: f64,
    build: Build<D>,
) -> Result<f64> {
    let (mut total, mut points) = (0.0, 0);
    for [building, others] in folds {
        let map = build(building, size, sigma)?;
        total += mixture_log_likelihood(others, &map, sigma)?.total;
        points += others.len();
    }
    Ok(total / points as f64)
}

/// The divisions of a log by time.
pub fn folds_of(log: &LogSource) -> Result<Vec<[PointSet<2>; 2]>> {
    (0..FOLDS)
        .map(|fold| {
            let divided = hold_out(&log.recording, log.max_range, fold)?;
            Ok([PointSet::new(divided.building)?, PointSet::new(divided.held_out)?])
        })
        .collect()
}

/// Sizes of the race: each is so many times the one before.
const RACE_FACTOR: f64 = 1.25;
/// The smallest size of the race.
const SMALLEST_RACED: f64 = 50.0;

/// The smallest size on which the weighted error is within 5 % of that on all points, with 95 %
/// confidence: bisection over sizes that grow by a quarter, each decided by a race.
pub fn size_by_localization(
    log: &LogSource,
    data: &PointSet<2>,
    sigma: f64,
    build: Build<2>,
    quiet: bool,
) -> Result<Chosen> {
    let filter =
        FilterSettings { max_range: log.max_range, ..FilterSettings::default() }.check()?;
    let all = PointMap::new(data.points().to_vec())?;
    let mut reference = Lane::new(&log.recording, &all, &filter)?;
    let mut sizes = vec![SMALLEST_RACED.min(data.len() as f64)];
    while sizes[sizes.len() - 1] * RACE_FACTOR < data.len() as f64 {
        sizes.push((sizes[sizes.len() - 1] * RACE_FACTOR).round());
    }
    // Each size that is decided has its share of the risk.
    let decisions = (sizes.len() as f64).log2().ceil().max(1.0);
    let settings = RaceSettings::default();
    let settings = RaceSettings { risk: settings.risk / decisions, ..settings };
    let bar = progress::spinner("size", quiet);
    let mut races = Vec::new();
    let (mut below, mut within) = (0, sizes.len());
    while below < within {
        let middle = (below + within) / 2;
        let size = Some(MapSize::Points(sizes[middle] as usize));
        let map = build(data, size, sigma)?;
        let race = race(&mut Lane::new(&log.recording, &map, &filter)?, &mut reference, &settings)?;
        bar.set_message(format!("{} points: {:?}", race.map_points, race.verdict));
        match race.verdict {
            Verdict::Within => within = middle,
            Verdict::Beyond | Verdict::Open => below = middle + 1,
        }
        races.push(race);
    }
    bar.finish_and_clear();
    let Some(&value) = sizes.get(within) else {
        bail!(
            "no map smaller than all points was shown to localize within 5 % of them; the largest tried has {} points",
            races.iter().map(|race| race.map_points).max().unwrap_or(0)
        );
    };
    let mut tried: Vec<Try> = races
        .iter()
        .map(|race| Try { value: race.map_points as f64, score: race.weighted / race.reference })
        .collect();
    tried.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(Chosen { by: AutoBy::Localization, value, tried, races })
}
