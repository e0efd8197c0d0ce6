use std::f64::consts::FRAC_PI_3;

use mcl_core::memory::with_room;
use mcl_core::{Pose2, Recording, Seed, math};

use crate::{CheckedSettings, FilterError, MapDistances, ParticleFilter, Particles, StepReport};

/// Input of a filter run: a recording, the odometry to use, and the scans to use.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    /// The scans and the pose of the laser on the robot. The odometry of the recording is not used.
    pub recording: &'a Recording,
    /// For each scan of the recording the odometry increment since the previous scan (pose of the laser in the
    /// previous frame of the laser), with or without [noise](crate::noisy_increments). The increments up to and
    /// including that of the first used scan are not used.
    pub increments: &'a [Option<Pose2>],
    /// Indices of the scans to use, increasing. The increments of skipped scans are composed with that of the next
    /// used scan.
    pub scans: &'a [usize],
}

impl Replay<'_> {
    /// For each used scan after the first, the motion of the laser since the previous used scan, and the number of
    /// steps in between with unknown motion, which the motion does not include.
    ///
    /// # Errors
    /// Those of [`Bridge::over`], and [`FilterError::NonFiniteOdometry`] with the scan concerned.
    pub fn motions(&self) -> Result<Vec<(Pose2, usize)>, FilterError> {
        Bridge::over(self)?;
        let pairs = self.scans.windows(2);
        pairs.map(|pair| composed(self.increments, pair[0] + 1, pair[1])).collect()
    }
}

/// An estimated trajectory, one entry per used scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Estimated poses of the laser in the map frame, for comparison with the reference of the recording.
    pub map_from_laser: Vec<Pose2>,
    /// The reports of the filter, for the robot.
    pub reports: Vec<StepReport>,
}

/// A step of a run, as passed to the observer of [`localize_with`].
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Index of the scan in the recording.
    pub scan: usize,
    /// What the filter reported, about the robot.
    pub report: &'a StepReport,
    /// The particles after the scan, resampled if [`StepReport::resampled`] is set.
    pub particles: &'a Particles,
}

/// Localizes the robot of a recording on a map: one run of the particle filter over the used scans.
///
/// `initial_map_from_laser` is the pose of the laser at the first used scan, required for
/// [`InitialPose::Known`](crate::InitialPose::Known): its reference pose, or one given by the user. A few steps
/// without odometry are bridged ([`Bridge`]).
///
/// # Errors
/// Those of [`Bridge::over`], [`FilterError::NonFiniteOdometry`] with the scan concerned, and those of
/// [`ParticleFilter`].
///
/// # Example
/// ```
/// use mcl_core::{PointMap, Pose2, Recording, Seed};
/// use mcl_filter::{FilterError, FilterSettings, MapDistances, Replay, Run, localize};
///
/// /// Localizes on every scan of a log, from the reference pose of the first.
/// fn on_all_scans(log: &Recording, map: &PointMap<2>) -> Result<Run, FilterError> {
///     let settings = FilterSettings::default().check()?;
///     let distances = MapDistances::grid(map, settings.values().max_distance)?;
///     let increments: Vec<Option<Pose2>> = log.scans.iter().map(|scan| scan.odometry).collect();
///     let scans: Vec<usize> = (0..log.scans.len()).collect();
///     let replay = Replay { recording: log, increments: &increments, scans: &scans };
///     let start = log.scans.first().and_then(|scan| scan.map_from_laser);
///     localize(&replay, &distances, &settings, start, Seed::new(1))
/// }
/// # let log = Recording { scans: Vec::new(), robot_from_laser: Pose2::IDENTITY };
/// # let map = PointMap::new(vec![[0.0, 0.0]]).unwrap();
/// # assert!(on_all_scans(&log, &map).is_err(), "a known start is asked for");
/// ```
pub fn localize(
    replay: &Replay<'_>,
    distances: &MapDistances,
    settings: &CheckedSettings,
    initial_map_from_laser: Option<Pose2>,
    seed: Seed,
) -> Result<Run, FilterError> {
    localize_with(replay, distances, settings, initial_map_from_laser, seed, |_| Ok(()))
}

/// [`localize`] with a call of `observe` after each step, which can end the run with an error but not change it.
///
/// # Errors
/// Those of [`localize`] and of `observe`.
pub fn localize_with<E: From<FilterError>>(
    replay: &Replay<'_>,
    distances: &MapDistances,
    settings: &CheckedSettings,
    initial_map_from_laser: Option<Pose2>,
    seed: Seed,
    mut observe: impl FnMut(Step<'_>) -> Result<(), E>,
) -> Result<Run, E> {
    let scans = &replay.recording.scans;
    let bridge = Bridge::over(replay)?;
    let robot_from_laser = replay.recording.robot_from_laser;
    let laser_from_robot = robot_from_laser.inverse();
    let map_from_robot = initial_map_from_laser.map(|pose| pose.compose(&laser_from_robot));
    let mut filter =
        ParticleFilter::new(settings, distances, robot_from_laser, map_from_robot, seed)?;
    let mut run = Run {
        map_from_laser: with_room(replay.scans.len(), "estimates").map_err(FilterError::from)?,
        reports: with_room(replay.scans.len(), "estimates").map_err(FilterError::from)?,
    };
    let mut previous = None;
    for &scan in replay.scans {
        if let Some(previous) = previous {
            let (motion, unknown) = composed(replay.increments, previous + 1, scan)?;
            // The increment of the laser, converted to the robot.
            filter.predict(&robot_from_laser.compose(&motion).compose(&laser_from_robot))?;
            if unknown > 0 {
                let times = (unknown as f64).sqrt();
                filter.bridge(&scans[scan], times * bridge.reach, times * TURN)?;
            }
        }
        let report = filter.update(&scans[scan])?;
        observe(Step { scan, report: &report, particles: filter.particles() })?;
        run.map_from_laser.push(report.estimate.map_from_robot.compose(&robot_from_laser));
        run.reports.push(report);
        previous = Some(scan);
    }
    Ok(run)
}

fn check_replay(replay: &Replay<'_>) -> Result<(), FilterError> {
    let scans = replay.recording.scans.len();
    if replay.increments.len() != scans {
        return Err(FilterError::IncrementCount { increments: replay.increments.len(), scans });
    }
    let mut least = 0;
    for (entry, &scan) in replay.scans.iter().enumerate() {
        if scan < least || scan >= scans {
            return Err(FilterError::ScanList { entry, scan, scans });
        }
        least = scan + 1;
    }
    Ok(())
}

/// Largest fraction of steps without odometry that is bridged.
const MOST_UNKNOWN: f64 = 0.25;
/// Smallest assumed standard deviation of the position on such a step (m).
const LEAST_REACH: f64 = 0.25;
/// Standard deviation of the heading after such a step (rad): half a turn is three of them.
const TURN: f64 = FRAC_PI_3;

/// Steps with unknown motion, and how the filter bridges them.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// The scans that these steps lead to.
    pub scans: Vec<usize>,
    /// Number of all steps.
    pub steps: usize,
    /// Standard deviation of the position along each axis after such a step (m): the length of the longest known
    /// step, at least 0.25 m. That of the heading is 60°.
    pub reach: f64,
}

impl Bridge {
    /// Finds the steps of a replay without odometry. Unknown motion is never treated as no motion: if there are few
    /// such steps, the robot is searched for around its previous pose ([`ParticleFilter::bridge`]).
    ///
    /// # Errors
    /// [`FilterError::IncrementCount`] and [`FilterError::ScanList`]; [`FilterError::MissingOdometry`] if more
    /// than a quarter of the steps are unknown.
    pub fn over(replay: &Replay<'_>) -> Result<Self, FilterError> {
        check_replay(replay)?;
        let ends = replay.scans.first().zip(replay.scans.last());
        let increments = match ends {
            Some((&first, &last)) => &replay.increments[first + 1..=last.max(first)],
            None => &[],
        };
        let first = ends.map_or(0, |(first, _)| first + 1);
        let missing = increments.iter().enumerate().filter(|(_, increment)| increment.is_none());
        let scans: Vec<usize> = missing.map(|(step, _)| first + step).collect();
        let (unknown, steps) = (scans.len(), increments.len());
        if unknown as f64 > MOST_UNKNOWN * steps as f64 {
            return Err(FilterError::MissingOdometry { scan: scans[0], unknown, steps });
        }
        let lengths = increments.iter().flatten().map(|step| math::hypot(step.x, step.y));
        Ok(Bridge { scans, steps, reach: lengths.fold(LEAST_REACH, f64::max) })
    }
}

/// The composition of the known increments of scans `first..=last`, and the number of unknown ones.
fn composed(
    increments: &[Option<Pose2>],
    first: usize,
    last: usize,
) -> Result<(Pose2, usize), FilterError> {
    let mut motion = Pose2::IDENTITY;
    let mut unknown = 0;
    for (scan, increment) in increments.iter().enumerate().take(last + 1).skip(first) {
        let Some(increment) = *increment else {
            unknown += 1;
            continue;
        };
        if !increment.is_finite() {
            return Err(FilterError::NonFiniteOdometry { scan, increment });
        }
        motion = motion.compose(&increment);
    }
    Ok((motion, unknown))
}
