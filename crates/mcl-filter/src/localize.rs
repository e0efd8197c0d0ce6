use mcl_core::memory::with_room;
use mcl_core::{Pose2, Recording, Seed};

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
/// [`InitialPose::Known`](crate::InitialPose::Known): its reference pose, or what a user gives.
///
/// # Errors
/// [`FilterError::IncrementCount`] and [`FilterError::ScanList`] for a replay that does not fit
/// together, [`FilterError::MissingOdometry`] or [`FilterError::NonFiniteOdometry`] with the scan
/// concerned, and those of [`ParticleFilter`].
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
    check_replay(replay)?;
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
            let motion = composed(replay.increments, previous + 1, scan)?;
            // The increment of the laser, seen by the robot it is mounted on.
            filter.predict(&robot_from_laser.compose(&motion).compose(&laser_from_robot))?;
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

/// The increments of scans `first..=last`, one after the other.
fn composed(increments: &[Option<Pose2>], first: usize, last: usize) -> Result<Pose2, FilterError> {
    let mut motion = Pose2::IDENTITY;
    for (scan, increment) in increments.iter().enumerate().take(last + 1).skip(first) {
        let increment = increment.ok_or(FilterError::MissingOdometry { scan })?;
        if !increment.is_finite() {
            return Err(FilterError::NonFiniteOdometry { scan, increment });
        }
        motion = motion.compose(&increment);
    }
    Ok(motion)
}
