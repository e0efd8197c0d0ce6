//! Reads trajectories from any supported file, with their frames.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_core::text::counted;
use mcl_core::{Pose2, Trajectory};
use mcl_datasets::bag::{PoseRequest, PoseRole};
use mcl_datasets::log::{LogError, LogKind, ReferencePoses, is_bag, read_poses};
use mcl_datasets::registry::Registry;
use mcl_metrics::trajectory_file::{
    self, NonPlanar, QuaternionOrder, ReadSettings, is_trajectory_file,
};
use serde::Serialize;

use super::mounts::{Mounts, SideFrames, name_of};
use crate::cli::Outcome;
use crate::cli::args::{AlignTo, EvaluateArgs, Global, Whose};
use crate::cli::output::{refuse, report_losses};
use crate::progress::tell;
use mcl_study::data::options::{ReferenceSource, SourceOptions};
use mcl_study::data::reference::mount_of_run;
use mcl_study::data::source::LogSource;

/// Magic bytes of compressed files: gzip, bzip2, xz, zstd. Files of trajectories are uncompressed.
const PACKED: [&[u8]; 4] = [b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd"];
/// The usual names of the robot's frame (REP 105), and of the map's.
const BASE: [&str; 2] = ["base_link", "base_footprint"];
const MAP: &str = "map";

/// A trajectory, its source, and what is known of its frames.
pub struct TrajectoryInput {
    pub of: TrajectorySource,
    pub trajectory: Trajectory,
    /// Covariance of each pose, where the file has any: x, y (m) and heading (rad) along the axes of the
    /// frame of the poses.
    pub covariances: Vec<Option<[[f64; 3]; 3]>>,
    pub has_headings: bool,
    /// Whose poses they are, where known.
    pub whose: Option<Whose>,
    /// The frame that they are in, where known.
    pub within: Option<String>,
    pub carried_from: Option<String>,
    /// What is known of the robot's frames.
    pub mounts: Mounts,
    /// Whether everything in the file was read, and is in the trajectory.
    pub is_complete: bool,
}

/// The source of a trajectory.
#[derive(Debug, Clone, Serialize)]
pub struct TrajectorySource {
    /// The file, as named by the user.
    pub file: String,
    /// Topic of a bag; null for other files.
    pub topic: Option<String>,
}

impl TrajectorySource {
    /// The file, and the topic of a bag.
    pub fn label(&self) -> String {
        match &self.topic {
            Some(topic) => format!("{} {topic}", self.file),
            None => self.file.clone(),
        }
    }
}

impl TrajectoryInput {
    fn new(file: &str, topic: Option<String>, trajectory: Trajectory) -> Self {
        TrajectoryInput {
            of: TrajectorySource { file: file.to_owned(), topic },
            trajectory,
            covariances: Vec::new(),
            has_headings: true,
            whose: None,
            within: None,
            carried_from: None,
            mounts: Mounts::default(),
            is_complete: true,
        }
    }

    /// A description of the trajectory, and whose poses it has.
    pub fn describe(&self) -> String {
        let whose = match &self.whose {
            Some(whose) => format!("of {whose}"),
            None => format!("of {} (assumed)", Whose::Robot),
        };
        let within = self.within.iter().map(|frame| format!(" in {frame:?}"));
        let from = self.carried_from.iter().map(|frame| format!(", carried there from {frame:?}"));
        let kind = if self.has_headings { "pose" } else { "position" };
        let poses = counted(self.trajectory.len(), kind);
        let parts: String = within.chain(from).collect();
        format!("{}, {poses}, {whose}{parts}", self.of.label())
    }

    /// Its frames, for the report.
    pub fn frames(&self) -> SideFrames {
        SideFrames {
            of: self.whose.as_ref().map(name_of),
            within: self.within.clone(),
            carried_from: self.carried_from.clone(),
        }
    }
}

enum Format {
    Poses,
    Log,
    /// With its path, which may be that of a data set.
    Bag(PathBuf),
}

/// The trajectory of a file given as the reference.
pub fn reference(file: &str, args: &EvaluateArgs, global: &Global) -> Result<TrajectoryInput> {
    let format = format_of(file)?;
    if !matches!(format, Format::Bag(_)) && args.reference_topic.is_some() {
        return refuse(&format!("--reference-topic applies to bags only, and {file} is not a bag"));
    }
    let request = PoseRequest {
        topic: args.reference_topic.as_deref(),
        ..PoseRequest::of(PoseRole::Reference)
    };
    let mut source = read(file, &format, &request, args, global)?;
    if let Some(whose) = &args.reference_frame {
        source.whose = Some(whose.clone());
    }
    Ok(source)
}

/// An estimated trajectory: from a file, or from one topic of a bag. The poses of a bag are converted to the
/// frame of the reference, if transforms lead there, unless it is aligned anyway.
pub fn estimate(
    file: &str,
    topic: Option<&str>,
    reference: &TrajectoryInput,
    args: &EvaluateArgs,
    global: &Global,
) -> Result<TrajectoryInput> {
    let into = reference.within.as_deref().unwrap_or(MAP);
    let into = (args.align == AlignTo::None).then_some(into);
    let request = PoseRequest { topic, role: PoseRole::Estimate, into };
    let mut source = read(file, &format_of(file)?, &request, args, global)?;
    if let Some(whose) = &args.estimate_frame {
        source.whose = Some(whose.clone());
    }
    Ok(source)
}

/// Whether a file is a bag, with topics to select.
pub fn has_topics(file: &str) -> bool {
    matches!(format_of(file), Ok(Format::Bag(_)))
}

fn read(
    file: &str,
    format: &Format,
    request: &PoseRequest<'_>,
    args: &EvaluateArgs,
    global: &Global,
) -> Result<TrajectoryInput> {
    let mut source = match format {
        Format::Poses => poses(file, args, global)?,
        Format::Log => log(file, request.role, global)?,
        Format::Bag(path) => bag(file, path, request, global)?,
    };
    source.has_headings &= !args.positions;
    Ok(source)
}

/// Decided by the content: a line of a log begins with the name of its kind.
fn format_of(file: &str) -> Result<Format> {
    let path = Path::new(file);
    // A file that was opened for writing and got no pose.
    if path.metadata().is_ok_and(|file| file.is_file() && file.len() == 0) {
        return Ok(Format::Poses);
    }
    if path.is_dir() || (path.is_file() && is_bag(path)?) {
        return Ok(Format::Bag(path.to_owned()));
    }
    if !path.is_file() {
        // The name of a data set, a pipe, or a file that does not exist.
        let is_name = path.components().count() == 1 && path.extension().is_none();
        return Ok(match is_name.then(|| bag_of_dataset(file)).transpose()? {
            Some(Some(bag)) => Format::Bag(bag),
            Some(None) => Format::Log,
            None if matches!(path.try_exists(), Ok(false)) => {
                bail!(LogError::NotFound { path: path.to_owned() })
            }
            None => Format::Poses,
        });
    }
    let head = read_head(path).with_context(|| format!("cannot read {file}"))?;
    let is_packed = PACKED.iter().any(|magic| head.starts_with(magic));
    let is_poses = is_trajectory_file(path).with_context(|| format!("cannot read {file}"))?;
    Ok(if is_packed || !is_poses { Format::Log } else { Format::Poses })
}

/// The first bytes of a file.
fn read_head(path: &Path) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    File::open(path)?.take(8).read_to_end(&mut head)?;
    Ok(head)
}

/// The bag of a data set; `None` if its file is not a bag or not available, or there is no such data set.
fn bag_of_dataset(name: &str) -> Result<Option<PathBuf>> {
    let registry = Registry::from_environment()?;
    let located = registry.get(name).ok().and_then(|dataset| registry.locate(dataset).ok());
    Ok(match located {
        Some(path) if is_bag(&path)? => Some(path),
        _ => None,
    })
}

/// A file with poses only.
fn poses(file: &str, args: &EvaluateArgs, global: &Global) -> Result<TrajectoryInput> {
    let read = |order| {
        let non_planar = if args.project { NonPlanar::Project } else { NonPlanar::Refuse };
        trajectory_file::read_file(file, &ReadSettings { non_planar, order })
    };
    let found = match read(QuaternionOrder::Xyzw) {
        // Applies only to files whose quaternions are invalid otherwise: the other side may be in the usual
        // order.
        Err(_) if args.wxyz => read(QuaternionOrder::Wxyz),
        found => found,
    }?;
    if !global.quiet {
        found.notes.iter().for_each(|note| tell!("note: {file}: {note}"));
    }
    let mut source = TrajectoryInput::new(file, None, found.trajectory);
    if !args.positions {
        found.doubts.iter().for_each(|doubt| tell!("warning: {file}: {doubt}"));
        source.is_complete = found.doubts.is_empty();
    }
    source.has_headings = found.has_headings;
    if let Some(robot_from_laser) = mount_of_run(Path::new(file)) {
        source.whose = Some(Whose::Laser);
        source.mounts = Mounts::of_laser(robot_from_laser);
    }
    Ok(source)
}

/// The laser poses written in a CARMEN log: as a reference only where they are corrected; as an
/// estimate also raw odometry.
fn log(file: &str, role: PoseRole, global: &Global) -> Result<TrajectoryInput> {
    let reference = match role {
        PoseRole::Reference => None,
        PoseRole::Estimate => Some(ReferenceSource::Log(ReferencePoses::Recorded)),
    };
    let log = LogSource::open(file, &SourceOptions { reference, ..SourceOptions::default() })?;
    if role == PoseRole::Estimate && log.kind == Some(LogKind::Raw) && !global.quiet {
        tell!("note: {file}: its laser poses are raw odometry");
    }
    let scans = log.recording.scans.len();
    let without = log.recording.scans.iter().filter(|scan| scan.map_from_laser.is_none()).count();
    if without == scans {
        bail!(
            "{file}: no reference poses: the log is raw, its laser poses are odometry (as an estimate \
             they can be evaluated)"
        );
    }
    let trajectory = log.recording.stamped_reference();
    let unstamped = scans - without - trajectory.len();
    if unstamped > 0 {
        tell!(
            "warning: {file}: {unstamped} of {scans} scans have no usable stamp: they match nothing"
        );
    }
    let is_complete = report_losses(file, &log) == Outcome::Done && unstamped == 0;
    Ok(TrajectoryInput {
        whose: Some(Whose::Laser),
        mounts: Mounts::of_laser(log.recording.robot_from_laser),
        is_complete,
        ..TrajectoryInput::new(file, None, trajectory)
    })
}

/// The poses of a bag's topic. Where the bag does not state whose they are, they are taken as the robot's
/// (REP 105).
fn bag(
    file: &str,
    path: &Path,
    request: &PoseRequest<'_>,
    global: &Global,
) -> Result<TrajectoryInput> {
    let found = read_poses(path, request)?;
    if !found.report.is_complete() {
        tell!("warning: {file}: {}", found.report);
    }
    if found.trajectory.is_empty() {
        bail!("{file}: {} has no message that could be read", found.name);
    }
    let mut mounts = Mounts::default();
    for (name, pose) in &found.mounts {
        mounts.insert(Whose::Frame(name.clone()), *pose);
    }
    if let Some(frame) = &found.frame {
        mounts.insert(Whose::Frame(frame.clone()), Pose2::IDENTITY);
    }
    let base = BASE.iter().find_map(|base| found.mounts.get(*base).copied());
    mounts.insert(Whose::Robot, base.unwrap_or(Pose2::IDENTITY));
    if let Some(laser) = found.frame_from_laser {
        mounts.insert(Whose::Laser, laser);
    }
    let whose = found.frame.map_or(Whose::Robot, Whose::Frame);
    let source = TrajectoryInput {
        covariances: found.covariances,
        whose: Some(whose),
        within: found.parent,
        carried_from: found.carried_from,
        mounts,
        is_complete: found.report.is_complete(),
        ..TrajectoryInput::new(file, Some(found.name), found.trajectory)
    };
    if !global.quiet {
        tell!("note: {}", source.describe());
    }
    Ok(source)
}
