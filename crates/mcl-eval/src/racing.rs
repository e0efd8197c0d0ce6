//! The smallest map that localizes about as well as all points: a race that spends runs where the
//! decision is open.

use anyhow::{Context, Result};
use mcl_core::{PointMap, Pose2, Recording, Seed};
use mcl_filter::{
    CheckedSettings, MapDistances, OdometryNoise, Replay, localize, noisy_increments,
};
use mcl_metrics::{WeightedPoseError, paired_t_test};
use rayon::prelude::*;
use serde::Serialize;

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
    pub seed: Seed,
}

/// Within 5 %, 95 % sure, 40 runs at most, the noise of the localization experiment.
impl Default for RaceSettings {
    fn default() -> Self {
        RaceSettings {
            ratio: 1.05,
            risk: 0.05,
            max_runs: 40,
            noise: OdometryNoise { xy: 0.01, theta: 0.01 },
            seed: Seed::new(1),
        }
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

/// Runs of the filter on one map, made as they are needed.
pub struct Lane<'a> {
    recording: &'a Recording,
    reference: Vec<Pose2>,
    scans: Vec<usize>,
    filter: &'a CheckedSettings,
    distances: MapDistances,
    map_points: usize,
    /// Mean weighted error of each run.
    errors: Vec<f64>,
}

impl<'a> Lane<'a> {
    /// A lane on a map. All scans need a reference pose.
    ///
    /// # Errors
    /// When a scan has no reference pose, or the map cannot be indexed.
    pub fn new(
        recording: &'a Recording,
        map: &PointMap<2>,
        filter: &'a CheckedSettings,
    ) -> Result<Self> {
        let reference = recording.scans.iter().enumerate().map(|(index, scan)| {
            scan.map_from_laser.with_context(|| format!("scan {index} has no reference pose"))
        });
        Ok(Lane {
            recording,
            reference: reference.collect::<Result<_>>()?,
            scans: (0..recording.scans.len()).collect(),
            filter,
            distances: MapDistances::grid(map, filter.values().max_distance)?,
            map_points: map.len(),
            errors: Vec::new(),
        })
    }

    /// Sees that there are so many runs.
    fn run_to(&mut self, runs: usize, settings: &RaceSettings) -> Result<()> {
        let made = self.errors.len();
        let more: Vec<f64> = (made..runs)
            .into_par_iter()
            .map(|run| self.run(run, settings))
            .collect::<Result<_>>()?;
        self.errors.extend(more);
        Ok(())
    }

    fn run(&self, run: usize, settings: &RaceSettings) -> Result<f64> {
        let seed = |purpose: &str| settings.seed.derive(purpose).derive_index(run as u64);
        let odometry: Vec<Option<Pose2>> =
            self.recording.scans.iter().map(|scan| scan.odometry).collect();
        let increments = noisy_increments(&odometry, settings.noise, seed("race noise"))?;
        let replay =
            Replay { recording: self.recording, increments: &increments, scans: &self.scans };
        let start = self.reference.first().copied();
        let run = localize(&replay, &self.distances, self.filter, start, seed("race filter"))?;
        let weighted = WeightedPoseError::default();
        let errors = self.reference.iter().zip(&run.map_from_laser);
        Ok(errors.map(|(truth, found)| weighted.distance(truth, found)).sum::<f64>()
            / self.reference.len() as f64)
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
    let mut verdict = Verdict::Open;
    while verdict == Verdict::Open && runs < settings.max_runs {
        runs = (runs + BATCH).min(settings.max_runs);
        lane.run_to(runs, settings)?;
        other.run_to(runs, settings)?;
        let allowed: Vec<f64> =
            other.errors[..runs].iter().map(|error| settings.ratio * error).collect();
        if runs < 2 {
            continue;
        }
        let test = paired_t_test(&lane.errors[..runs], &allowed)?;
        if test.p_less < limit {
            verdict = Verdict::Within;
        } else if test.p_greater < limit {
            verdict = Verdict::Beyond;
        }
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    Ok(Race {
        map_points: lane.map_points,
        runs,
        weighted: mean(&lane.errors[..runs]),
        reference: mean(&other.errors[..runs]),
        verdict,
    })
}
