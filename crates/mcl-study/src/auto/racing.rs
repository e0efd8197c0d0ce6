//! Two maps raced against one another: runs are spent where the decision is open.

use anyhow::{Result, bail};
use mcl_core::PointMap;
use mcl_filter::MapDistances;
use mcl_maps::MapSize;
use mcl_metrics::{WeightedPoseError, paired_t_test};
use rayon::prelude::*;
use serde::Serialize;

use super::{Build, Chosen, Try};
use crate::data::source::LogSource;
use crate::recipe::criterion::Criterion;
use crate::recipe::run::RunRecipe;
use crate::recipe::split::Split;
use crate::trial::division::Division;
use crate::trial::tracking::track;

/// Runs that are added to both sides when the decision is open.
const BATCH: usize = 4;
/// Sizes of the race: each is so many times the one before.
const RACE_FACTOR: f64 = 1.25;
/// The smallest size of the race.
const SMALLEST_RACED: f64 = 50.0;

/// What is asked of the smaller map, and for how long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RaceSettings {
    /// Largest ratio of its mean weighted error to that on the other map.
    pub ratio: f64,
    /// How sure the decision has to be: the share of races that may end wrong.
    pub risk: f64,
    /// Runs on each map at most.
    pub max_runs: usize,
}

/// Within 5 %, 95 % sure, 40 runs at most.
impl Default for RaceSettings {
    fn default() -> Self {
        RaceSettings { ratio: 1.05, risk: 0.05, max_runs: 40 }
    }
}

/// How a race ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The map is good enough.
    Within,
    /// It is not.
    Beyond,
    /// Not decided within the largest number of runs.
    Open,
}

/// A race of one map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Race {
    /// Points of the map.
    pub map_points: usize,
    /// Runs on each map.
    pub runs: usize,
    /// Mean weighted error (equation 7) on the map.
    pub weighted: f64,
    /// The same on the other one.
    pub reference: f64,
    /// How it ended.
    pub verdict: Verdict,
}

/// Where races are held: the scans to localize on, and how.
pub struct Arena<'a> {
    /// The log.
    pub log: &'a LogSource,
    /// Its scans, and the points of maps.
    pub division: &'a Division<2>,
    /// Filter and noise; each run of a race is this one under another number.
    pub recipe: &'a RunRecipe,
    /// Root of the seeds of noise and filter.
    pub seed: u64,
}

/// Runs of the filter on one map, made as they are needed.
pub struct Lane<'a> {
    arena: &'a Arena<'a>,
    distances: MapDistances,
    map_points: usize,
    /// Mean weighted error of each run.
    errors: Vec<f64>,
}

impl<'a> Lane<'a> {
    /// A lane on a map.
    ///
    /// # Errors
    /// When the map cannot be indexed.
    pub fn new(arena: &'a Arena<'a>, map: &PointMap<2>) -> Result<Self> {
        let distances = MapDistances::grid(map, arena.recipe.filter.max_distance)?;
        Ok(Lane { arena, distances, map_points: map.len(), errors: Vec::new() })
    }

    /// Sees that there are so many runs, and returns the mean weighted error (equation 7) of each.
    ///
    /// # Errors
    /// When the filter cannot run.
    pub fn run_to(&mut self, runs: usize) -> Result<&[f64]> {
        let made = self.errors.len() as u32;
        let weighted = WeightedPoseError::default();
        let Arena { log, division, recipe, seed } = *self.arena;
        let error = |run: u32| -> Result<f64> {
            let recipe = RunRecipe { run, ..recipe.clone() };
            let tracked = track(&recipe, seed, Some(Split::Same), log, division, &self.distances)?;
            let errors = tracked.errors.iter().map(|error| weighted.of(error));
            Ok(errors.sum::<f64>() / tracked.errors.len() as f64)
        };
        let more: Vec<f64> =
            (made..runs as u32).into_par_iter().map(error).collect::<Result<_>>()?;
        self.errors.extend(more);
        Ok(&self.errors[..runs])
    }
}

/// Races a map against another one: paired runs in batches, until a t test of d − ratio·d′ says within or
/// beyond. It is asked after every batch, so each time with its share of the risk (Bonferroni), half to
/// either side. The question is about these two maps, so that their runs are the independent units.
///
/// # Errors
/// When the filter cannot run.
pub fn race(lane: &mut Lane, other: &mut Lane, settings: &RaceSettings) -> Result<Race> {
    let looks = settings.max_runs.div_ceil(BATCH).max(1);
    let limit = settings.risk / (2 * looks) as f64;
    let mut runs = 0;
    let (mut weighted, mut reference) = (0.0, 0.0);
    let mut verdict = Verdict::Open;
    while verdict == Verdict::Open && runs < settings.max_runs {
        runs = (runs + BATCH).min(settings.max_runs);
        let (errors, others) = (lane.run_to(runs)?, other.run_to(runs)?);
        (weighted, reference) = (mean(errors), mean(others));
        if runs > 1 {
            verdict = judge(errors, others, settings.ratio, limit)?;
        }
    }
    Ok(Race { map_points: lane.map_points, runs, weighted, reference, verdict })
}

/// Whether the errors of runs on a map are within `ratio` times those of the same runs on another one,
/// where a t test may be wrong with probability `risk` to either side.
fn judge(errors: &[f64], others: &[f64], ratio: f64, risk: f64) -> Result<Verdict> {
    let allowed: Vec<f64> = others.iter().map(|error| ratio * error).collect();
    let test = paired_t_test(errors, &allowed)?;
    Ok(match (test.p_less < risk, test.p_greater < risk) {
        (true, _) => Verdict::Within,
        (_, true) => Verdict::Beyond,
        _ => Verdict::Open,
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The sizes that a choice by localization is made from: numbers of points, each a quarter more than the one
/// before, fewer than all.
pub fn race_sizes(points: usize) -> Vec<usize> {
    let mut sizes = vec![SMALLEST_RACED.min(points as f64)];
    while sizes[sizes.len() - 1] * RACE_FACTOR < points as f64 {
        sizes.push((sizes[sizes.len() - 1] * RACE_FACTOR).round());
    }
    sizes.into_iter().map(|size| size as usize).collect()
}

/// The smallest size on which the weighted error is within 5 % of that on all points, with 95 %
/// confidence: bisection over [`race_sizes`], each decided by a race. `observe` is shown every race.
///
/// # Errors
/// When no size was shown to do, a map cannot be built or the filter cannot run.
pub fn size_by_localization(
    arena: &Arena<'_>,
    settings: &RaceSettings,
    sigma: f64,
    build: Build<2>,
    observe: impl Fn(&Race),
) -> Result<Chosen> {
    let data = &arena.division.building;
    let mut reference = Lane::new(arena, &PointMap::new(data.points().to_vec())?)?;
    let sizes = race_sizes(data.len());
    // Each size that is decided has its share of the risk.
    let decisions = (sizes.len() as f64).log2().ceil().max(1.0);
    let settings = RaceSettings { risk: settings.risk / decisions, ..*settings };
    let mut races: Vec<Race> = Vec::new();
    let mut tried = Vec::new();
    let (mut below, mut within) = (0, sizes.len());
    let mut value = None;
    while below < within {
        let middle = (below + within) / 2;
        let map = build(data, Some(MapSize::Points(sizes[middle])), sigma)?;
        let race = race(&mut Lane::new(arena, &map)?, &mut reference, &settings)?;
        observe(&race);
        match race.verdict {
            Verdict::Within => (within, value) = (middle, Some(sizes[middle] as f64)),
            Verdict::Beyond | Verdict::Open => below = middle + 1,
        }
        tried.push(Try { value: sizes[middle] as f64, score: race.weighted / race.reference });
        races.push(race);
    }
    let Some(value) = value else {
        bail!(
            "no map smaller than all points was shown to localize within 5 % of them; the largest tried has {} points",
            races.iter().map(|race| race.map_points).max().unwrap_or(0)
        );
    };
    tried.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(Chosen { by: Criterion::Localization, value, tried, races })
}
