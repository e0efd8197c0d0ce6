//! Trajectories from whatever file they are in: TUM, CARMEN, bag.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mcl_core::{Pose2, Trajectory};
use mcl_datasets::bag::{PoseRequest, PoseRole};
use mcl_datasets::log::{LogKind, ReferencePoses, is_bag, read_poses};
use mcl_datasets::registry::Registry;
use mcl_metrics::tum::{self, NonPlanar};
use serde::Serialize;

use crate::cli::Outcome;
use crate::cli::args::{EvaluateArgs, Frame, Global};
use crate::cli::output::{refuse, tell_losses};
use crate::progress::tell;
use mcl_study::data::options::{ReferenceSource, SourceOptions};
use mcl_study::data::reference::{is_tum, mount_of_run};
use mcl_study::data::source::LogSource;

/// What compressed files begin with: gzip, bzip2, xz, zstd. Trajectories in the TUM format are plain.
const PACKED: [&[u8]; 4] = [b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd"];

/// A trajectory and where it is from.
pub struct Source {
    pub of: Named,
    pub trajectory: Trajectory,
    /// Whose poses they are, where that is known.
    pub whose: Option<Frame>,
    /// Where the laser is on the robot, where that is known.
    pub robot_from_laser: Option<Pose2>,
    /// Whether all that the file says was read, and is in the trajectory.
    pub is_complete: bool,
}

/// Where a trajectory is from.
#[derive(Clone, Serialize)]
pub struct Named {
    /// The file, as the user named it.
    file: String,
    /// Topic of a bag; null for other files.
    topic: Option<String>,
}

impl Named {
    /// The file, and the topic of a bag.
    pub fn label(&self) -> String {
        match &self.topic {
            Some(topic) => format!("{} {topic}", self.file),
            None => self.file.clone(),
        }
    }
}

/// The first bytes of a file.
fn read_head(path: &Path) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    File::open(path)?.take(8).read_to_end(&mut head)?;
    Ok(head)
}

impl Source {
    fn new(file: &str, topic: Option<String>, trajectory: Trajectory, is_complete: bool) -> Self {
        Source {
            of: Named { file: file.to_owned(), topic },
            trajectory,
            whose: None,
            robot_from_laser: None,
            is_complete,
        }
    }

    /// What the trajectory is, and whose poses it has.
    pub fn describe(&self) -> String {
        let whose = match self.whose {
            Some(Frame::Laser) => "of the laser",
            Some(Frame::Robot) => "of the robot",
            None => "nothing says whose",
        };
        format!("{}, {} poses, {whose}", self.of.label(), self.trajectory.len())
    }

    /// The trajectory as poses of the laser or of the robot; as it stands, where nothing says whose poses they
    /// are. `mount` is where the laser is on the robot.
    pub fn poses_of(&self, wanted: Frame, mount: Option<Pose2>) -> Result<Cow<'_, Trajectory>> {
        let Some(whose) = self.whose.filter(|whose| *whose != wanted) else {
            return Ok(Cow::Borrowed(&self.trajectory));
        };
        let Some(mount) = mount else {
            bail!(
                "{}: its poses are those of the {}, and nothing says where the laser is on the robot; compare them with a trajectory that says so (of `localize`, a log or a bag), or with --frame {}",
                self.of.label(),
                whose.name(),
                whose.name()
            );
        };
        let carry = match wanted {
            Frame::Laser => mount,
            Frame::Robot => mount.inverse(),
        };
        let poses = self.trajectory.iter();
        Ok(Cow::Owned(poses.map(|(stamp, pose)| (stamp, pose.compose(&carry))).collect()))
    }
}

enum Format {
    Tum,
    Log,
    /// With its path, which may be that of a data set.
    Bag(PathBuf),
}

/// The trajectory of `--reference`.
pub fn reference(args: &EvaluateArgs, global: &Global) -> Result<Source> {
    let file = &args.reference;
    let format = format_of(file)?;
    if !matches!(format, Format::Bag(_)) && args.reference_topic.is_some() {
        refuse(&format!("--reference-topic goes with a bag, and {file} is none"));
    }
    let source = match format {
        Format::Tum => {
            let source = tum_file(file, args)?;
            Source { whose: args.reference_frame.or(source.whose), ..source }
        }
        Format::Bag(path) => {
            let topic = args.reference_topic.as_deref();
            bag(file, &path, topic, PoseRole::Reference, args, global)?
        }
        Format::Log => log(file, PoseRole::Reference, global)?,
    };
    let stamps = source.trajectory.stamps();
    let backward = stamps.windows(2).filter(|pair| pair[1] < pair[0]).count();
    if backward > 0 && !global.quiet {
        tell!(
            "note: {file}: {backward} stamps step back in time; poses are taken in the order of the file"
        );
    }
    Ok(source)
}

/// The trajectories to be held against it: one of each file, and of a bag one of each `--topic`.
pub fn estimates(args: &EvaluateArgs, global: &Global) -> Result<Vec<Source>> {
    let formats: Vec<Format> =
        args.estimates.iter().map(|file| format_of(file)).collect::<Result<_>>()?;
    let any_bag = formats.iter().any(|format| matches!(format, Format::Bag(_)));
    if !args.topics.is_empty() && !any_bag {
        refuse("--topic goes with bags, and none of the estimates is one");
    }
    let mut sources = Vec::new();
    for (file, format) in args.estimates.iter().zip(formats) {
        match format {
            Format::Tum => sources.push(tum_file(file, args)?),
            Format::Log => sources.push(log(file, PoseRole::Estimate, global)?),
            Format::Bag(path) if args.topics.is_empty() => {
                sources.push(bag(file, &path, None, PoseRole::Estimate, args, global)?);
            }
            Format::Bag(path) => {
                for topic in &args.topics {
                    sources.push(bag(file, &path, Some(topic), PoseRole::Estimate, args, global)?);
                }
            }
        }
    }
    Ok(sources)
}

/// By the content: a line of a log begins with the name of its kind, one of a TUM file with a number.
fn format_of(file: &str) -> Result<Format> {
    let path = Path::new(file);
    if path.is_dir() || (path.is_file() && is_bag(path)?) {
        return Ok(Format::Bag(path.to_owned()));
    }
    if !path.is_file() {
        // The name of a data set, or a file that is not there.
        let is_name = path.components().count() == 1 && path.extension().is_none();
        return Ok(match is_name.then(|| bag_of_dataset(file)).transpose()? {
            Some(Some(bag)) => Format::Bag(bag),
            Some(None) => Format::Log,
            None => Format::Tum,
        });
    }
    let head = read_head(path).with_context(|| format!("cannot read {file}"))?;
    let is_packed = PACKED.iter().any(|magic| head.starts_with(magic));
    Ok(if is_packed || !is_tum(path)? { Format::Log } else { Format::Tum })
}

/// The bag of a data set; `None` if its file is none or not at hand, or there is no such data set.
fn bag_of_dataset(name: &str) -> Result<Option<PathBuf>> {
    let registry = Registry::from_environment()?;
    let located = registry.get(name).ok().and_then(|dataset| registry.locate(dataset).ok());
    Ok(match located {
        Some(path) if is_bag(&path)? => Some(path),
        _ => None,
    })
}

fn tum_file(file: &str, args: &EvaluateArgs) -> Result<Source> {
    let non_planar = if args.project { NonPlanar::Project } else { NonPlanar::Refuse };
    let trajectory = tum::read_file(file, non_planar)?.trajectory;
    let robot_from_laser = mount_of_run(Path::new(file));
    let whose = robot_from_laser.map(|_| Frame::Laser);
    Ok(Source { whose, robot_from_laser, ..Source::new(file, None, trajectory, true) })
}

/// The laser poses written in a CARMEN log: as a reference only where they are corrected; as an
/// estimate also raw odometry.
fn log(file: &str, role: PoseRole, global: &Global) -> Result<Source> {
    let reference = match role {
        PoseRole::Reference => None,
        PoseRole::Estimate => Some(ReferenceSource::Log(ReferencePoses::Recorded)),
    };
    let source = LogSource::open(file, &SourceOptions { reference, ..SourceOptions::default() })?;
    if role == PoseRole::Estimate && source.kind == Some(LogKind::Raw) && !global.quiet {
        tell!("note: {file}: its laser poses are raw odometry");
    }
    let scans = source.recording.scans.len();
    let without =
        source.recording.scans.iter().filter(|scan| scan.map_from_laser.is_none()).count();
    if without == scans {
        bail!(
            "{file}: no reference poses: the log is raw, its laser poses are odometry (as an estimate \
             they can be evaluated)"
        );
    }
    let trajectory = source.recording.reference();
    let unstamped = scans - without - trajectory.len();
    if unstamped > 0 {
        tell!(
            "warning: {file}: {unstamped} of {scans} scans have no usable stamp: they match nothing"
        );
    }
    let is_complete = tell_losses(file, &source) == Outcome::Done && unstamped == 0;
    let robot_from_laser = Some(source.recording.robot_from_laser);
    let source = Source::new(file, None, trajectory, is_complete);
    Ok(Source { whose: Some(Frame::Laser), robot_from_laser, ..source })
}

/// The poses of a bag's topic; of its laser, unless asked otherwise.
fn bag(
    file: &str,
    path: &Path,
    topic: Option<&str>,
    role: PoseRole,
    args: &EvaluateArgs,
    global: &Global,
) -> Result<Source> {
    let found = read_poses(path, &PoseRequest { topic, ..PoseRequest::of(role) })?;
    let name = found.name;
    if !found.report.is_complete() {
        tell!("warning: {file}: {}", found.report);
    }
    if found.trajectory.is_empty() {
        bail!("{file}: {name} has no message that could be read");
    }
    let is_complete = found.report.is_complete();
    let frame = found.frame.as_deref().unwrap_or("the robot");
    let mut note = format!("{file}: {name}: {} poses of {frame:?}", found.trajectory.len());
    let whose = match (args.frame, found.frame_from_laser) {
        (Frame::Laser, None) => None,
        (frame, _) => Some(frame),
    };
    let trajectory = match (args.frame, found.frame_from_laser) {
        (Frame::Robot, _) => found.trajectory,
        (Frame::Laser, None) => {
            note += ", as they stand: nothing in the bag says where its laser is";
            found.trajectory
        }
        (Frame::Laser, Some(mount)) if mount == Pose2::IDENTITY => found.trajectory,
        (Frame::Laser, Some(mount)) => {
            note += &format!(
                ", made poses of the laser by its mount (x {:.3} m, y {:.3} m, turned by {:.1}°); \
                 --frame robot takes them as they stand",
                mount.x,
                mount.y,
                mount.theta.to_degrees()
            );
            found.trajectory.iter().map(|(stamp, pose)| (stamp, pose.compose(&mount))).collect()
        }
    };
    if !global.quiet {
        tell!("note: {note}");
    }
    let source = Source::new(file, Some(name), trajectory, is_complete);
    Ok(Source { whose, robot_from_laser: found.frame_from_laser, ..source })
}
