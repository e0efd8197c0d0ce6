//! Reference poses from a file of their own.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::{Pose2, Trajectory};
use mcl_datasets::bag::{PoseRequest, PoseRole};
use mcl_datasets::log::{ReferenceTrack, is_bag, read_log, read_poses};
use mcl_metrics::tum::{self, NonPlanar, TumError};
use serde::Deserialize;

/// Bytes in which the first line that is no comment is looked for.
const SNIFFED_BYTES: u64 = 1 << 16;
/// A row per run, some hundred bytes each.
const MAX_SUMMARY_BYTES: u64 = 1 << 28;
const LASER: &str = "laser";

/// Whether a file is a trajectory in the TUM format, whose lines begin with a number; those of CARMEN logs begin
/// with the name of their kind.
///
/// # Errors
/// When it cannot be read.
pub fn is_tum(path: &Path) -> Result<bool> {
    let first = first_line(path).with_context(|| format!("cannot read {}", path.display()))?;
    let is_number = |byte: &u8| byte.is_ascii_digit() || b"+-.".contains(byte);
    Ok(first.first().is_none_or(is_number))
}

/// Where the laser is on the robot, of a trajectory that `localize` wrote: its folder's `summary.json` says so, and the
/// poses are those of the laser.
pub fn mount_of_run(path: &Path) -> Option<Pose2> {
    #[derive(Deserialize)]
    struct Summary {
        setup: Setup,
    }
    #[derive(Deserialize)]
    struct Setup {
        robot_from_laser: Pose2,
    }
    let name = path.file_name()?.to_str()?;
    let is_run = name.starts_with("run-") || name == "reference.tum";
    let summary = is_run.then(|| path.with_file_name("summary.json"))?;
    let bytes = File::open(summary).ok()?.take(MAX_SUMMARY_BYTES);
    let Summary { setup } = serde_json::from_reader(BufReader::new(bytes)).ok()?;
    Some(setup.robot_from_laser)
}

/// The first line that is neither empty nor a comment; empty without any.
fn first_line(path: &Path) -> io::Result<Vec<u8>> {
    let mut reader = BufReader::new(File::open(path)?.take(SNIFFED_BYTES));
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line)? > 0 {
        let text = line.trim_ascii();
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        if !text.is_empty() && !text.starts_with(b"#") {
            return Ok(text.to_vec());
        }
        line.clear();
    }
    Ok(Vec::new())
}

/// Reads the reference from a TUM file, a topic of a bag, or the corrected poses of a CARMEN log.
///
/// # Errors
/// When it cannot be read, has no poses, or a topic is asked for of what is no bag.
pub(crate) fn read(path: &Path, topic: Option<&str>) -> Result<ReferenceTrack> {
    let told = path.display();
    if is_bag(path)? {
        let found =
            read_poses(path, &PoseRequest { topic, ..PoseRequest::of(PoseRole::Reference) })?;
        if found.trajectory.is_empty() {
            bail!("{told}: {} has no message that could be read", found.name);
        }
        let name = format!("{told} {}", found.name);
        return Ok(ReferenceTrack { name, trajectory: found.trajectory, frame: found.frame });
    }
    if topic.is_some() {
        bail!("--reference-topic goes with a bag, and {told} is none");
    }
    if is_tum(path)? {
        let (found, note) = match tum::read_file(path, NonPlanar::Refuse) {
            Err(TumError::Field { field: "z" | "qx qy qz qw", .. }) => {
                (tum::read_file(path, NonPlanar::Project)?, ", seen from above")
            }
            found => (found?, ""),
        };
        let frame = mount_of_run(path).map(|_| LASER.to_owned());
        return Ok(ReferenceTrack {
            name: format!("{told}{note}"),
            trajectory: found.trajectory,
            frame,
        });
    }
    let trajectory: Trajectory = read_log(path)?.recording.reference();
    if trajectory.is_empty() {
        bail!("{told}: no reference poses with a stamp in it");
    }
    Ok(ReferenceTrack { name: told.to_string(), trajectory, frame: Some(LASER.to_owned()) })
}
