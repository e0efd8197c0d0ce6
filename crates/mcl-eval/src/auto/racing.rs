//! Two maps raced against one another: runs are spent where the decision is open.

use anyhow::Result;
use mcl_core::PointMap;
use mcl_filter::{CheckedSettings, MapDistances, OdometryNoise};
use mcl_metrics::{WeightedPoseError, paired_t_test};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::experiment::{LocalizationData, track};

/// Runs that are added to both sides when the decision is open.
const BATCH: usize = 4;

/// What is asked of the smaller map, and for how long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RaceSettings {
    /// Largest ratio of its mean weighted error to that on the other map.
    pub ratio: f64,
    /// How sure the decision has to be: the share of races that may end wrong.
    pub risk: f64,
    /// Runs on each map at most.
    pub max_runs: usize,
    /// Noise added to the odometry, the same for both maps.
    pub noise: OdometryNoise,
    /// Seed of noise and filter.
    pub seed: u64,
}

/// Within 5 %, 95 % sure, 40 runs at most, the noise of the localization experiment.
impl Default for RaceSettings {
    fn default() -> Self {
        RaceSettings {
            ratio: 1.05,
            risk: 0.05,
            max_runs: 40,
            noise: OdometryNoise { xy: 0.01, theta: 0.01 },
            seed: 1,
        }
    }
}

/// How a race ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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

/// Runs of the filter on one map, made as they are needed.
pub struct Lane<'a> {
    data: &'a LocalizationData<'a>,
    filter: &'a CheckedSettings,
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
    pub fn new(
        data: &'a LocalizationData<'a>,
        map: &PointMap<2>,
        filter: &'a CheckedSettings,
    ) -> Result<Self> {
        let distances = MapDistances::grid(map, filter.values().max_distance)?;
        Ok(Lane { data, filter, distances, map_points: map.len(), errors: Vec::new() })
    }

    /// Sees that there are so many runs, and returns the mean weighted error (equation 7) of each.
    ///
    /// # Errors
    /// When the filter cannot run.
    pub fn run_to(&mut self, runs: usize, settings: &RaceSettings) -> Result<&[f64]> {
        let made = self.errors.len() as u32;
        let weighted = WeightedPoseError::default();
        let error = |run: u32| -> Result<f64> {
            let RaceSettings { seed, noise, .. } = *settings;
            let tracked = track(seed, noise, self.data, &self.distances, self.filter, run)?;
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
/// either side.
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
        let (errors, others) = (lane.run_to(runs, settings)?, other.run_to(runs, settings)?);
        (weighted, reference) = (mean(errors), mean(others));
        if runs > 1 {
            verdict = judge(errors, others, settings.ratio, limit)?;
        }
    }
    Ok(Race { map_points: lane.map_points, runs, weighted, reference, verdict })
}

/// Whether the errors of runs on a map are within `ratio` times those of the same runs on another one,
/// where a t test may be wrong with probability `risk` to either side.
///
/// # Errors
/// When there are fewer than two runs.
pub fn judge(errors: &[f64], others: &[f64], ratio: f64, risk: f64) -> Result<Verdict> {
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
