use std::f64::consts::FRAC_PI_3;

use mcl_core::memory::with_room;
use mcl_core::{Pose2, Recording, Seed, math};

use crate::{CheckedSettings, FilterError, MapDistances, ParticleFilter, Particles, StepReport};

/// What is replayed to the filter: a recording, the odometry to believe, and which scans to use.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    /// Scans and the mount of the laser. Its own odometry is not looked at.
    pub recording: &'a Recording,
    /// Per scan of the recording the increment since the scan before (pose of the laser in the frame
    /// of the laser before), with or without [noise](crate::noisy_increments). The one of the first
    /// used scan, and those before it, are not looked at.
    pub increments: &'a [Option<Pose2>],
    /// Indices of the scans to use, increasing. The increments of scans left out are composed into
    /// the next one that is used.
    pub scans: &'a [usize],
}

impl Replay<'_> {
    /// Per used scan after the first the motion of the laser since the used scan before it, and of how many steps in
    /// between nobody knows any, as if there had been none.
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
    /// Estimated poses of the laser in the map's frame, to be compared with the recording's
    /// reference.
    pub map_from_laser: Vec<Pose2>,
    /// What the filter reported, about the robot.
    pub reports: Vec<StepReport>,
}

/// A step of a run, as [`localize_with`] shows it.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// Index of the scan in the recording.
    pub scan: usize,
    /// What the filter reported, about the robot.
    pub report: &'a StepReport,
    /// The particles after the scan; where [`StepReport::resampled`] says so, resampled.
    pub particles: &'a Particles,
}

/// Localizes the robot of a recording on a map: one run of the particle filter over the used scans.
///
/// `initial_map_from_laser` is the pose of the laser at the first used scan, needed for
/// [`InitialPose::Known`](crate::InitialPose::Known): its reference pose, or what a user gives. A few steps
/// without odometry are bridged ([`Bridge`]).
///
/// # Errors
/// Those of [`Bridge::over`], [`FilterError::NonFiniteOdometry`] with the scan concerned, and those of
/// [`ParticleFilter`].
pub fn localize(
    replay: &Replay<'_>,
    distances: &MapDistances,
    settings: &CheckedSettings,
    initial_map_from_laser: Option<Pose2>,
    seed: Seed,
) -> Result<Run, FilterError> {
    localize_with(replay, distances, settings, initial_map_from_laser, seed, |_| Ok(()))
}

/// [`localize`], showing each step to `observe`, which changes nothing of the run but ends it by an
/// error.
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
            // The increment of the laser, seen by the robot it is mounted on.
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

/// The largest share of steps without odometry that is bridged.
const MOST_UNKNOWN: f64 = 0.25;
/// The least that a robot may have moved on such a step (m).
const LEAST_REACH: f64 = 0.25;
/// Standard deviation of the heading after such a step (rad): half a turn is three of them.
const TURN: f64 = FRAC_PI_3;

/// Steps whose motion nobody knows, and how the filter bridges them.
#[derive(Debug, Clone, PartialEq)]
pub struct Bridge {
    /// The scans that these steps lead to.
    pub scans: Vec<usize>,
    /// Number of all steps.
    pub steps: usize,
    /// Standard deviation of the position along each axis after such a step (m): the longest step that is
    /// known, at least 0.25 m. The heading has one of 60°.
    pub reach: f64,
}

impl Bridge {
    /// Finds the steps of a replay without odometry. Unknown motion is never taken as none: on a few steps the
    /// robot is looked for about where it was ([`ParticleFilter::bridge`]).
    ///
    /// # Errors
    /// [`FilterError::IncrementCount`] and [`FilterError::ScanList`]; [`FilterError::MissingOdometry`] where more
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

/// The increments of scans `first..=last` that are known, one after the other, and the number of others.
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
