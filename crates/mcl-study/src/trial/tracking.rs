//! A robot localized on a map.

use anyhow::{Context, Result};
use mcl_core::{Pose2, Seed};
use mcl_filter::{Bridge, MapDistances, Replay, Run, localize};
use mcl_metrics::{PoseError, pose_errors};

use crate::data::source::LogSource;
use crate::recipe::run::RunRecipe;
use crate::recipe::split::Split;
use crate::trial::course::Course;
use crate::trial::division::Division;

/// A run with its errors.
pub struct TrackedRun {
    /// What the filter estimated and reported.
    pub run: Run,
    /// Errors of the estimates, per scan.
    pub errors: Vec<PoseError>,
    /// The localized scans in the order in which the robot saw them, as places in the log.
    pub scans: Vec<usize>,
    /// Reference poses of the laser in the map's frame, per scan.
    pub reference: Vec<Pose2>,
    /// Place of the first scan after the robot was carried off.
    pub carried_off: Option<usize>,
}

/// The steps of a log that its odometry says nothing of, which the filter bridges.
///
/// # Errors
/// When there are too many of them.
pub fn bridge(log: &LogSource) -> Result<Bridge> {
    let increments: Vec<Option<Pose2>> =
        log.recording.scans.iter().map(|scan| scan.odometry).collect();
    let scans: Vec<usize> = (0..increments.len()).collect();
    let replay = Replay { recording: &log.recording, increments: &increments, scans: &scans };
    Bridge::over(&replay).with_context(|| {
        let advice = match log.survey {
            Some(_) => "what could be the odometry, inspect says",
            None => {
                "if the log's laser poses are odometry, take them so with --reference none --initial-pose X,Y,THETA"
            }
        };
        format!("{}: localization needs odometry{}; {advice}", log.name, log.reasons("odometry"))
    })
}

/// Localizes the robot on a map. Noise, disturbances and filter are seeded by the study's seed, the data set, the
/// split and the run's number, never by the map.
///
/// # Errors
/// When the filter cannot run on this log, or the recipe asks for more than the log has.
pub fn track(
    recipe: &RunRecipe,
    seed: u64,
    split: Option<Split>,
    log: &LogSource,
    division: &Division<2>,
    distances: &MapDistances,
) -> Result<TrackedRun> {
    let seed = |purpose: &str| {
        Seed::new(seed)
            .derive(purpose)
            .derive(&log.name)
            .derive(split.unwrap_or(Split::Same).seed_name())
            .derive_index(u64::from(recipe.run))
    };
    let settings = recipe.filter.with_max_range(log.max_range)?;
    let course = Course::of(recipe, log, division, seed)?;
    let start = course.reference.first().copied();
    let run = localize(&course.replay(), distances, &settings, start, seed("filter"))?;
    let Course { scans, reference, carried_off, .. } = course;
    let errors = pose_errors(&reference, &run.map_from_laser)?;
    Ok(TrackedRun { run, errors, scans, reference, carried_off })
}
