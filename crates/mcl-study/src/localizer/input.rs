//! The input of an external program for a run.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_core::files::{write_atomically, write_with};
use mcl_core::{Pose2, Recording, ScanGeometry, Seed, Stamp, Trajectory};
use mcl_datasets::bag::{self, BASE_FRAME, LASER_FRAME, MAP_FRAME};
use mcl_datasets::carmen;
use mcl_filter::InitialPose;
use mcl_maps::files::{Encoding, write_grid, write_map};
use mcl_maps::occupancy::{FreeSpace, rasterize};
use mcl_metrics::tum;
use serde::Serialize;

use crate::data::source::LogSource;
use crate::localizer::stamps::Stamps;
use crate::recipe::localizer::{Formats, MapFormat, Whose};
use crate::recipe::run::RunRecipe;
use crate::trial::course::Course;
use crate::trial::division::Division;
use crate::trial::map::{Shape, StudyMap};

/// Name of the file, or folder, that a program writes.
pub const OUTPUT: &str = "estimate";
/// Name of the description of a run.
pub const RUN: &str = "run.json";
const START: &str = "start.json";

/// The input of a program for a run, apart from the map. It does not contain the robot's true pose after the
/// start.
pub struct Input {
    /// The scans of the run, with odometry and without reference poses. Stamps increase strictly.
    pub recording: Recording,
    /// Reference poses of the laser at these scans, which are not given to programs.
    pub reference: Vec<Pose2>,
    /// Stamps of the scans.
    pub stamps: Stamps,
    /// Scans before which part of the odometry is not known; it is written as standing still there.
    bridged: Vec<usize>,
    start: Start,
    dataset: String,
    run: u32,
    seed: u32,
    max_range: f64,
}

/// What is known about the robot's start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Start {
    /// A pose in the map's frame, of the robot and of its laser, and standard deviations (m, rad).
    Known { robot: Pose2, laser: Pose2, std: Pose2 },
    /// Nothing is known.
    Unknown,
}

/// Paths of the files of an [`Input`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Files {
    /// The log.
    pub log: PathBuf,
    /// The map.
    pub map: PathBuf,
    /// The start.
    pub start: PathBuf,
    /// The description of the run.
    pub run: PathBuf,
    /// The output of the program.
    pub output: PathBuf,
}

/// The content of `run.json`.
#[derive(Serialize)]
struct RunDescription<'a> {
    dataset: &'a str,
    run: u32,
    seed: u32,
    log: &'a Path,
    log_format: crate::recipe::localizer::LogFormat,
    map: &'a Path,
    map_format: MapFormat,
    output: &'a Path,
    /// Whose poses the program has to write, in the frame of the map.
    poses: Whose,
    topics: Option<Topics>,
    frames: Frames,
    start: Start,
    robot_from_laser: Pose2,
    max_range_m: f64,
    beams: ScanGeometry,
    scans: usize,
    /// Seconds as a decimal: a float would lose digits.
    first_stamp: String,
    last_stamp: String,
    made_stamps: usize,
    steps_without_odometry: &'a [usize],
    time_limit_s: Option<f64>,
}

#[derive(Serialize)]
struct Topics {
    scan: &'static str,
    odometry: &'static str,
    tf: &'static str,
    tf_static: &'static str,
}

#[derive(Serialize)]
struct Frames {
    map: &'static str,
    odometry: &'static str,
    robot: &'static str,
    laser: &'static str,
}

impl Input {
    /// The input for a course. `seed` is that of the program's random numbers.
    ///
    /// # Errors
    /// When the course has no scan, or odometry that is not finite.
    pub fn of(
        course: &Course<'_>,
        recipe: &RunRecipe,
        log: &LogSource,
        seed: Seed,
    ) -> Result<Self> {
        let replay = course.replay();
        let motions = replay.motions()?;
        let mut recording = Recording {
            scans: replay.scans.iter().map(|&scan| replay.recording.scans[scan].clone()).collect(),
            robot_from_laser: replay.recording.robot_from_laser,
        };
        let of_log: Vec<Option<Stamp>> = recording.scans.iter().map(|scan| scan.stamp).collect();
        let stamps = Stamps::of(&of_log, course.carried_off);
        let steps = [None].into_iter().chain(motions.iter().map(|&(motion, _)| Some(motion)));
        for ((scan, odometry), stamp) in recording.scans.iter_mut().zip(steps).zip(&stamps.all) {
            (scan.map_from_laser, scan.odometry, scan.stamp) = (None, odometry, Some(*stamp));
        }
        let unknown = motions.iter().enumerate().filter(|(_, (_, unknown))| *unknown > 0);
        let first = course.reference.first().context("the run has no scan")?;
        let start = match recipe.filter.initial_pose {
            InitialPose::Known { std_x, std_y, std_theta } => Start::Known {
                robot: first.compose(&recording.robot_from_laser.inverse()),
                laser: *first,
                std: Pose2::new(std_x, std_y, std_theta),
            },
            InitialPose::Uniform {} | InitialPose::Scan { .. } => Start::Unknown,
        };
        Ok(Input {
            bridged: unknown.map(|(step, _)| step + 1).collect(),
            reference: course.reference.clone(),
            dataset: log.name.clone(),
            run: recipe.run,
            // Programs read it as a 32-bit int.
            seed: (seed.number() >> 33) as u32,
            max_range: log.max_range,
            recording,
            stamps,
            start,
        })
    }

    /// The seed of a program's random numbers.
    pub fn seed(&self) -> u32 {
        self.seed
    }

    /// Writes log, map, start and description into a folder.
    ///
    /// # Errors
    /// When programs cannot read a map of this kind, the format cannot hold the log, or a file cannot be
    /// written.
    pub fn write(
        &self,
        folder: &Path,
        formats: &Formats,
        poses: Whose,
        map: &StudyMap<2>,
        (division, log): (&Division<2>, &LogSource),
        time_limit_s: Option<f64>,
    ) -> Result<Files> {
        let files = Files {
            log: folder.join(format!("run.{}", formats.log.ending())),
            map: folder.join(format!("map.{}", formats.map.ending())),
            start: folder.join(START),
            run: folder.join(RUN),
            output: folder.join(OUTPUT),
        };
        let recording = &self.recording;
        let written: Result<()> = write_with(&files.log, |file| {
            match formats.log.of_bag() {
                Some(format) => drop(bag::write_as(recording, format, file)?),
                None => carmen::write(recording, &[], file)?,
            }
            Ok(())
        });
        written.with_context(|| format!("cannot write {}", files.log.display()))?;
        write_shape(&files.map, formats, map, (division, log))?;
        let (Some(first), Some(last), Some(scan)) =
            (self.stamps.all.first(), self.stamps.all.last(), recording.scans.first())
        else {
            bail!("the run has no scan");
        };
        let name = |path: &'_ PathBuf| PathBuf::from(path.file_name().unwrap_or_default());
        let [log_name, map_name, output] = [&files.log, &files.map, &files.output].map(name);
        let described = RunDescription {
            dataset: &self.dataset,
            run: self.run,
            seed: self.seed,
            log: &log_name,
            log_format: formats.log,
            map: &map_name,
            map_format: formats.map,
            output: &output,
            poses,
            topics: formats.log.of_bag().map(|_| Topics {
                scan: "/scan",
                odometry: "/odom",
                tf: "/tf",
                tf_static: "/tf_static",
            }),
            frames: Frames {
                map: MAP_FRAME,
                odometry: "odom",
                robot: BASE_FRAME,
                laser: LASER_FRAME,
            },
            start: self.start,
            robot_from_laser: recording.robot_from_laser,
            max_range_m: self.max_range,
            beams: scan.geometry,
            scans: recording.scans.len(),
            first_stamp: first.to_string(),
            last_stamp: last.to_string(),
            made_stamps: self.stamps.made,
            steps_without_odometry: &self.bridged,
            time_limit_s,
        };
        save_json(&files.start, &self.start)?;
        save_json(&files.run, &described)?;
        Ok(files)
    }

    /// Writes the reference poses of the robot or its laser, at the stamps written to the input.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_reference(&self, path: &Path, poses: Whose) -> Result<()> {
        let carry = match poses {
            Whose::Robot => self.recording.robot_from_laser.inverse(),
            Whose::Laser => Pose2::IDENTITY,
        };
        let reference = self.reference.iter().map(|pose| pose.compose(&carry));
        let trajectory: Trajectory = self.stamps.all.iter().copied().zip(reference).collect();
        Ok(tum::write_file(path, &trajectory)?)
    }
}

fn save_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value)? + "\n";
    write_atomically(path, text.as_bytes())
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a map as points or cells. Cells made from points include the free space crossed by the beams that
/// built the map.
fn write_shape(
    path: &Path,
    formats: &Formats,
    map: &StudyMap<2>,
    (division, log): (&Division<2>, &LogSource),
) -> Result<()> {
    let is_grid = formats.map == MapFormat::Grid;
    match (&map.shape, is_grid) {
        (Shape::Grid(grid), true) => write_grid(path, grid)?,
        (Shape::Points(built), true) => {
            let resolution =
                formats.resolution.context("a grid of a map of points needs resolution")?;
            let recording = division.building_scans(log);
            let free_space = FreeSpace { recording: &recording, max_range: log.max_range };
            write_grid(path, &rasterize(&built.map, resolution, Some(free_space))?)?;
        }
        (Shape::Points(built), false) => write_map(path, &built.map, Encoding::Binary)?,
        (Shape::Grid(grid), false) => {
            let points = mcl_core::PointMap::new(grid.occupied_points())?;
            write_map(path, &points, Encoding::Binary)?;
        }
        (Shape::Ndt { .. } | Shape::Segments(_), _) => {
            bail!("programs are given maps of points or cells only")
        }
    }
    Ok(())
}
