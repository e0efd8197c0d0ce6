mod folder;
mod replay;
mod text;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use mcl_core::memory::check_room;
use mcl_core::{PointMap, Pose2, Seed};
use mcl_filter::sensor::FreeSpace;
use mcl_filter::{
    CheckedSettings, FilterSettings, InitialPose, MapDistances, MotionKind, OdometryNoise,
    ParticleNumber, Recovery, Replay, Run, localize_with, noisy_increments,
};
use mcl_maps::files::{is_grid, read_grid};
use mcl_metrics::WeightedPoseError;
use rayon::prelude::*;

use super::Outcome;
use super::args::{Global, Initial, LocalizeArgs};
use super::output::{
    input_files, open_map, prepare, print, refuse, report_bridged, report_image_in_place,
    report_losses,
};
use crate::localization::{FinishedRun, Localization, run_seed};
use crate::progress;
use crate::report::record::{MapLooks, Recorder as PageRecorder};
use folder::{Folder, Setup};
use mcl_study::data::source::{DEFAULT_MAX_RANGE, LogSource};
use mcl_study::trial::map::obstacle_grid;
use mcl_study::trial::stopwatch;
use mcl_study::trial::tracking::bridge;
use replay::{ReplayFile, Scene};

/// Particles for an unknown start: few thousands find the robot often, not always (docs/filter.md), and KLD sampling
/// soon needs few of them.
const UNKNOWN_START: ParticleNumber = ParticleNumber { least: 250, most: 10_000 };

pub fn run(args: &LocalizeArgs, global: &Global) -> Result<Outcome> {
    // Invalid settings are reported before anything is read.
    let max_range = args.log.max_range.unwrap_or(DEFAULT_MAX_RANGE);
    checked_settings(args, max_range)?;
    check_replay_name(args)?;
    let mut inputs = input_files(args.log.named());
    inputs.push(args.map.clone());
    check_replaced(args, &inputs)?;
    let (map, free) = filter_map(&args.map)?;
    let source = LogSource::open(&args.log.log, &args.log.options())?;
    let settings = checked_settings(args, source.max_range)?;
    let errors = size_of::<[f64; 3]>() * source.recording.scans.len();
    check_room(args.runs as usize, size_of::<FinishedRun>() + errors, "errors of runs")?;
    let start = first_pose(args, &source)?;
    // The filter would refuse too many unknown steps as well, but only after part of the work.
    let bridged = bridge(&source)?;
    let distances = MapDistances::grid(&map, settings.values().max_distance)?.with_free_space(free);
    let sigma_hit = settings.values().sigma_hit.metres(distances.spacing());
    let setup = Setup::new(args, &source, map.len(), (settings.values(), sigma_hit), start);
    let folder = args.output.as_deref().map(Folder::open).transpose()?;
    let mut first_recorder = None;
    if let Some(path) = &args.replay {
        let scene = Scene { recording: &source.recording, map: &map, max_range: source.max_range };
        let setup = serde_json::to_string(&setup)?;
        first_recorder = Some(ReplayFile::open(path, &inputs, &scene, setup)?);
    }
    let first_recorder = Mutex::new(first_recorder);
    let looks = MapLooks::of_points(map.points());

    let metric = WeightedPoseError::default();
    let bar = progress::bar(u64::from(args.runs), "localize", global.quiet);
    let runs = (0..args.runs)
        .into_par_iter()
        .map(|number| {
            let mut recorder = match number {
                0 => first_recorder.lock().unwrap_or_else(PoisonError::into_inner).take(),
                _ => None,
            };
            let seed = run_seed(args.seed, &source.name, number);
            let filter = (&distances, &settings, start);
            let watchers = Watchers {
                replay: recorder.as_mut(),
                page: folder
                    .as_ref()
                    .map(|_| PageRecorder::of(&source.recording, source.max_range)),
                end: &|| Ok(()),
            };
            let (run, elapsed, page) =
                one_run(&source, filter, args.odometry_noise, seed, watchers)
                    .with_context(|| format!("run {number}"))?;
            if let Some(recorder) = recorder {
                recorder.finish()?;
            }
            let finished = FinishedRun::of(&run, &source, elapsed)?;
            if let Some(folder) = &folder {
                folder.write_run(number, &source.recording, &run, &metric, &finished.nees)?;
                if let Some(page) = page {
                    let label = format!("{}, seed {}, run {number}", source.name, args.seed);
                    folder.write_recorded(number, &page.finish(label, &looks)?)?;
                }
            }
            bar.inc(1);
            Ok(finished)
        })
        .collect::<Result<Vec<_>>>();
    bar.finish_and_clear();
    let runs = runs?;

    let found = Localization::of(&runs, &source, bridged.scans.len(), args.seed)?;
    let mut complete = report_losses(&args.log.log, &source) == Outcome::Done;
    complete &= report_bridged(&args.log.log, &bridged) == Outcome::Done;
    if let Some(folder) = &folder {
        complete &=
            folder.finish(&source.recording, (&setup, &args.given), &found)? == Outcome::Done;
    }
    print(args.json, &found, |found| {
        text::text(found, args, (settings.values(), sigma_hit), &source, map.len())
    })?;
    Ok(Outcome::of(complete))
}

/// The points of a map, and its free space if known.
fn filter_map(path: &Path) -> Result<(PointMap<2>, Option<FreeSpace>)> {
    if !is_grid(path) {
        return Ok((open_map(path)?, None));
    }
    let map = grid_map(path)?;
    report_image_in_place(path);
    Ok(map)
}

/// Reads a grid map as the filter uses it: the cells that beams end on, as points, and the free space.
///
/// # Errors
/// When it cannot be read, or has no such cell.
pub fn grid_map(path: &Path) -> Result<(PointMap<2>, Option<FreeSpace>)> {
    let grid = obstacle_grid(&read_grid(path)?);
    Ok((grid.surface_points()?, FreeSpace::of(&grid)?))
}

/// Checks that no file to be replaced is an input.
fn check_replaced(args: &LocalizeArgs, inputs: &[PathBuf]) -> Result<()> {
    let mut outputs = Vec::new();
    if let Some(folder) = &args.output {
        let earlier = folder::earlier_files(folder)
            .with_context(|| format!("cannot read the folder {}", folder.display()))?;
        outputs.extend(earlier);
    }
    // Its folder may be that of the results, which does not exist yet.
    outputs.extend(args.replay.clone().filter(|path| path.exists()));
    Ok(prepare(outputs, inputs)?)
}

/// Readers recognize a bag by the ending of its name.
fn check_replay_name(args: &LocalizeArgs) -> Result<()> {
    let Some(path) = &args.replay else { return Ok(()) };
    if path.extension().is_none_or(|ending| ending != "mcap") {
        return refuse(&format!(
            "--replay {}: expected a name that ends with .mcap",
            path.display()
        ));
    }
    Ok(())
}

/// The settings for the arguments, with `max_range` in metres.
///
/// # Errors
/// Usage errors: values out of range, and invalid combinations.
pub fn checked_settings(args: &LocalizeArgs, max_range: f64) -> Result<CheckedSettings> {
    filter_settings(args, max_range)?.check().or_else(|error| refuse(&error.to_string()))
}

fn filter_settings(args: &LocalizeArgs, max_range: f64) -> Result<FilterSettings> {
    let preset = args.preset.settings();
    let initial_pose = match args.initial {
        Initial::Known => match args.initial_std {
            Some([std_x, std_y, std_theta]) => InitialPose::Known { std_x, std_y, std_theta },
            None => preset.initial_pose,
        },
        Initial::Uniform | Initial::Scan
            if args.initial_pose.is_some() || args.initial_std.is_some() =>
        {
            return refuse(
                "--initial-pose and --initial-std give a known start, and --initial uniform and scan mean \
                 an unknown one; expected one or the other",
            );
        }
        Initial::Uniform => InitialPose::Uniform {},
        Initial::Scan => InitialPose::scan(),
    };
    let [update_distance, update_angle] =
        args.update_min.unwrap_or([preset.update_distance, preset.update_angle]);
    let [resample_distance, resample_angle] =
        args.resample_after.unwrap_or([preset.resample_distance, preset.resample_angle]);
    Ok(FilterSettings {
        particles: args.particles.unwrap_or(match initial_pose {
            InitialPose::Known { .. } => preset.particles,
            InitialPose::Uniform {} | InitialPose::Scan { .. } => UNKNOWN_START,
        }),
        kld: preset.kld,
        initial_pose,
        motion: motion_model(args)?.unwrap_or(preset.motion),
        position_noise: args.position_noise.unwrap_or(preset.position_noise),
        heading_noise: args.heading_noise.unwrap_or(preset.heading_noise),
        alpha: args.alpha.unwrap_or(preset.alpha),
        turning_in_place: preset.turning_in_place,
        sigma_hit: args.sigma_hit.unwrap_or(preset.sigma_hit),
        z_rand: args.z_rand.unwrap_or(preset.z_rand),
        // Of the two ways to set this, the one given by the user counts.
        beam_floor: args.beam_floor.or(preset.beam_floor.filter(|_| args.z_rand.is_none())),
        outlier_fraction: args.outlier_fraction.unwrap_or(preset.outlier_fraction),
        max_distance: args.max_distance.unwrap_or(preset.max_distance),
        max_range,
        beams: args.beams.unwrap_or(preset.beams),
        likelihood_exponent: args.likelihood_exponent.unwrap_or(preset.likelihood_exponent),
        proposal: args.proposal.unwrap_or(preset.proposal),
        resampling: args.resampling.unwrap_or(preset.resampling),
        ess_fraction: args.ess_fraction.unwrap_or(preset.ess_fraction),
        resample_distance,
        resample_angle,
        update_distance,
        update_angle,
        recover: args.recover.then(Recovery::default).or(preset.recover),
    })
}

/// The requested motion model: by its name, or by the parameters of one.
fn motion_model(args: &LocalizeArgs) -> Result<Option<MotionKind>> {
    let is_gaussian = args.position_noise.is_some() || args.heading_noise.is_some();
    match (args.motion, args.alpha) {
        (Some(MotionKind::Gaussian), Some(_)) => refuse("--alpha belongs to --motion book"),
        (Some(MotionKind::Book), _) if is_gaussian => {
            refuse("--position-noise and --heading-noise belong to --motion gaussian")
        }
        (None, Some(_)) => Ok(Some(MotionKind::Book)),
        (None, None) if is_gaussian => Ok(Some(MotionKind::Gaussian)),
        (motion, _) => Ok(motion),
    }
}

/// The laser's pose at the first scan; `None` for global localization.
///
/// # Errors
/// When neither the arguments nor the log have the robot's initial pose.
pub fn first_pose(args: &LocalizeArgs, source: &LogSource) -> Result<Option<Pose2>> {
    if args.initial != Initial::Known {
        return Ok(None);
    }
    if let Some([x, y, theta]) = args.initial_pose {
        return Ok(Some(Pose2::new(x, y, theta)));
    }
    match source.recording.scans.first().and_then(|scan| scan.map_from_laser) {
        Some(pose) => Ok(Some(pose)),
        None => bail!(
            "{}: no reference pose says where the robot starts{}: give the laser's first pose in the \
             map with --initial-pose X,Y,THETA, or search for it with --initial scan{}",
            source.name,
            source.reasons("reference"),
            match source.survey {
                Some(_) => " (mcl-eval inspect lists what else could be the reference)",
                None =>
                    " (if the log's laser poses are ground truth nevertheless: --reference recorded)",
            }
        ),
    }
}

/// Observers of each step of a run.
pub struct Watchers<'a, 'b> {
    /// Writes a bag.
    replay: Option<&'a mut ReplayFile<'b>>,
    /// Records the run for a page.
    page: Option<PageRecorder>,
    /// Ends the run by returning an error.
    end: &'a dyn Fn() -> Result<()>,
}

impl<'a> Watchers<'a, '_> {
    /// Only the observer that can end the run.
    pub fn only(end: &'a dyn Fn() -> Result<()>) -> Self {
        Watchers { replay: None, page: None, end }
    }
}

/// A run, the time of its thread in the filter, and its recording for a page; the observers' time does not
/// count.
///
/// # Errors
/// Those of the filter and of the observers.
pub fn one_run(
    source: &LogSource,
    (distances, settings, start): (&MapDistances, &CheckedSettings, Option<Pose2>),
    noise: Option<[f64; 2]>,
    seed: Seed,
    mut watchers: Watchers<'_, '_>,
) -> Result<(Run, Duration, Option<PageRecorder>)> {
    let recording = &source.recording;
    let raw: Vec<Option<Pose2>> = recording.scans.iter().map(|scan| scan.odometry).collect();
    let [xy, theta] = noise.unwrap_or_default();
    let increments = noisy_increments(&raw, OdometryNoise { xy, theta }, seed)?;
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording, increments: &increments, scans: &scans };
    let mut recorded = Duration::ZERO;
    let started = stopwatch::now();
    let run = localize_with(&replay, distances, settings, start, seed, |step| {
        (watchers.end)()?;
        let started = stopwatch::now();
        if let Some(replay) = &mut watchers.replay {
            replay.step(&step)?;
        }
        if let Some(page) = &mut watchers.page {
            page.step(recording, &step);
        }
        recorded += stopwatch::now() - started;
        anyhow::Ok(())
    })?;
    Ok((run, stopwatch::now() - started - recorded, watchers.page))
}
