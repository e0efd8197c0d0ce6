//! A robot localized on a map.

use anyhow::{Context, Result};
use mcl_core::{Pose2, Seed};
use mcl_filter::{Bridge, FilterError, MapDistances, Replay, Step, StepReport, localize_with};
use mcl_metrics::{PoseError, pose_errors};

use crate::data::source::LogSource;
use crate::localizer::input::Input;
use crate::localizer::process::Ended;
use crate::localizer::program::{ProgramRun, Programs};
use crate::recipe::localizer::Program;
use crate::recipe::run::RunRecipe;
use crate::recipe::split::Split;
use crate::trial::course::Course;
use crate::trial::division::Division;
use crate::trial::map::StudyMap;
use crate::trial::stopwatch::now;

/// A run with its errors.
pub struct TrackedRun {
    /// Estimated pose of the laser in the map's frame, per scan, where there is one.
    pub map_from_laser: Vec<Option<Pose2>>,
    /// Reports of the built-in filter, per scan; empty for external programs.
    reports: Vec<StepReport>,
    /// Errors of the estimates, per scan.
    pub errors: Vec<Option<PoseError>>,
    /// How the localizer ended.
    pub ended: Ended,
    /// Processor time of the localizer (s).
    pub processor_s: f64,
    /// Peak memory of an external program (MB).
    pub peak_memory_mb: Option<f64>,
    /// Indices of the localized scans in the log, in the order of the run.
    pub scans: Vec<usize>,
    /// Reference poses of the laser in the map's frame, per scan.
    pub reference: Vec<Pose2>,
    /// Poses of the laser by odometry alone, per scan.
    pub odometry: Vec<Pose2>,
    /// Index of the first scan after the robot was kidnapped.
    pub carried_off: Option<usize>,
}

/// The translation error (m) assigned to a scan without estimate, where the robot counts as lost.
const LOST: f64 = 1e9;

impl TrackedRun {
    /// Reports of the built-in filter, per scan; empty for external programs.
    pub fn reports(&self) -> &[StepReport] {
        &self.reports
    }

    /// The translation error of each scan (m); without an estimate, far above the threshold for being lost.
    pub fn translations(&self) -> Vec<f64> {
        let translation =
            |error: &Option<PoseError>| error.map_or(LOST, |error| error.translation());
        self.errors.iter().map(translation).collect()
    }
}

/// The localizer of a robot.
pub enum Tracker<'a> {
    /// The built-in filter, with distances from the map.
    Own(&'a MapDistances),
    /// An external program on the map, for the row with an identity.
    Program(&'a Program, &'a StudyMap<2>, &'a Programs, &'a str),
}

/// The steps of a log with unknown odometry, which the filter bridges.
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
            Some(_) => "--odom-topic or --odom-frame chooses what mcl-eval inspect lists",
            None => {
                "if the log's laser poses are odometry, use them with --reference none --initial-pose X,Y,THETA"
            }
        };
        format!("{}: localization needs odometry{}; {advice}", log.name, log.reasons("odometry"))
    })
}

/// The seed of a run's random draws: it depends on the study's seed, the data set, the split and the run's
/// number.
pub fn seed_of(
    purpose: &str,
    seed: u64,
    split: Option<Split>,
    log: &LogSource,
    run: &RunRecipe,
) -> Seed {
    Seed::new(seed)
        .derive(purpose)
        .derive(&log.name)
        .derive(split.unwrap_or(Split::Same).seed_name())
        .derive_index(u64::from(run.run))
}

/// Localizes the robot on a map. Noise, disturbances and localizer are seeded by the study's seed, the data set, the
/// split and the run's number, never by the map.
///
/// # Errors
/// When the localizer cannot run on this log, or the recipe asks for more than the log has.
pub fn track(
    recipe: &RunRecipe,
    seed: u64,
    split: Option<Split>,
    log: &LogSource,
    division: &Division<2>,
    tracker: &Tracker<'_>,
) -> Result<TrackedRun> {
    track_with(recipe, seed, split, log, division, tracker, |_, _| {})
}

/// [`track`] with a callback: `see` is called with each step of the built-in filter, and cannot change the
/// run. The [scan](Step::scan) of a step is one of the course's own recording.
///
/// # Errors
/// Those of [`track`].
pub fn track_with(
    recipe: &RunRecipe,
    seed: u64,
    split: Option<Split>,
    log: &LogSource,
    division: &Division<2>,
    tracker: &Tracker<'_>,
    mut see: impl FnMut(&Course<'_>, &Step<'_>),
) -> Result<TrackedRun> {
    let seed = |purpose: &str| seed_of(purpose, seed, split, log, recipe);
    let course = Course::of(recipe, log, division, seed)?;
    let (ran, reports) = match tracker {
        Tracker::Own(distances) => {
            let settings = recipe.filter.with_max_range(log.max_range)?;
            let start = course.reference.first().copied();
            let since = now();
            let filter = seed("filter");
            let run =
                localize_with(&course.replay(), distances, &settings, start, filter, |step| {
                    see(&course, &step);
                    Ok::<(), FilterError>(())
                })?;
            let ran = ProgramRun {
                ended: Ended::Ok,
                map_from_laser: run.map_from_laser.into_iter().map(Some).collect(),
                processor_s: now().saturating_sub(since).as_secs_f64(),
                peak_memory_mb: None,
            };
            (ran, run.reports)
        }
        Tracker::Program(program, map, programs, identity) => {
            let input = Input::of(&course, recipe, log, seed("localizer"))?;
            (programs.run(program, &input, map, (division, log), identity)?, Vec::new())
        }
    };
    let ProgramRun { ended, map_from_laser, processor_s, peak_memory_mb } = ran;
    let odometry = course.odometry();
    let Course { scans, reference, carried_off, .. } = course;
    let covered = reference.iter().zip(&map_from_laser);
    let (of_covered, estimates): (Vec<Pose2>, Vec<Pose2>) =
        covered.filter_map(|(reference, pose)| Some((*reference, (*pose)?))).unzip();
    let known = match estimates.is_empty() {
        true => Vec::new(),
        false => pose_errors(&of_covered, &estimates)?,
    };
    let mut known = known.into_iter();
    let errors = map_from_laser.iter().map(|pose| pose.and_then(|_| known.next())).collect();
    Ok(TrackedRun {
        map_from_laser,
        reports,
        errors,
        ended,
        processor_s,
        peak_memory_mb,
        scans,
        reference,
        odometry,
        carried_off,
    })
}
