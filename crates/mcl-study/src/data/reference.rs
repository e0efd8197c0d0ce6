//! Reference poses from a separate file.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::{Pose2, Trajectory, math};
use mcl_datasets::bag::{PoseRequest, PoseRole};
use mcl_datasets::log::{PoseInSpace, ReferenceTrack, is_bag, out_of_plane, read_log, read_poses};
use mcl_metrics::trajectory_file::{
    self, NonPlanar, ReadSettings, TrajectoryFileError, is_trajectory_file,
};
use mcl_metrics::tum::TumError;
use serde::Deserialize;

/// The summary in a folder that `localize` writes.
pub const RUN_SUMMARY: &str = "summary.json";
/// Size limit of `summary.json` (bytes): it has a row per run of some hundred bytes.
const MAX_SUMMARY_BYTES: u64 = 1 << 28;
const LASER: &str = "laser";

/// Mount of the laser for a trajectory written by `localize`: it is stated in the folder's `summary.json`,
/// and the poses are those of the laser.
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
    let summary = is_run.then(|| path.with_file_name(RUN_SUMMARY))?;
    let bytes = File::open(summary).ok()?.take(MAX_SUMMARY_BYTES);
    let Summary { setup } = serde_json::from_reader(BufReader::new(bytes)).ok()?;
    Some(setup.robot_from_laser)
}

/// The poses of a TUM file in space; malformed rows are skipped here, as the reader of the file refuses them.
fn in_space(path: &Path) -> Result<impl Iterator<Item = PoseInSpace>> {
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let lines = BufReader::new(file).lines().map_while(|line| line.ok());
    Ok(lines.filter_map(|line| {
        let is_between = |c: char| c.is_whitespace() || c == ',';
        let fields = line.split(is_between).filter(|field| !field.is_empty());
        let values: Vec<f64> = fields.map_while(|field| field.parse().ok()).collect();
        let &[_, x, y, z, i, j, k, w] = values.as_slice() else { return None };
        let up = 1.0 - 2.0 * (i * i + j * j) / (i * i + j * j + k * k + w * w);
        let tilt_degrees = math::acos(up.clamp(-1.0, 1.0)).to_degrees();
        Some(PoseInSpace { position: [x, y, z], tilt_degrees })
    }))
}

/// Reads the reference from a file of a trajectory, a topic of a bag, or the corrected poses of a CARMEN log.
///
/// # Errors
/// When it cannot be read, has no poses, or a topic is requested of a file that is not a bag.
pub(crate) fn read(path: &Path, topic: Option<&str>) -> Result<ReferenceTrack> {
    let file = path.display();
    if is_bag(path)? {
        let found =
            read_poses(path, &PoseRequest { topic, ..PoseRequest::of(PoseRole::Reference) })?;
        if found.trajectory.is_empty() {
            bail!("{file}: {} has no message that could be read", found.name);
        }
        let name = format!("{file} {}", found.name);
        let doubt = found.out_of_plane;
        return Ok(ReferenceTrack {
            name,
            trajectory: found.trajectory,
            doubt,
            frame: found.frame,
        });
    }
    if topic.is_some() {
        bail!("--reference-topic applies to bags only, and {file} is not a bag");
    }
    let is_ours = is_trajectory_file(path).with_context(|| format!("cannot read {file}"))?;
    if is_ours {
        let read = |non_planar| {
            trajectory_file::read_file(
                path,
                &ReadSettings { non_planar, ..ReadSettings::default() },
            )
        };
        let (found, note, doubt) = match read(NonPlanar::Refuse) {
            Err(TrajectoryFileError::Tum(TumError::Field {
                field: "z" | "qx qy qz qw", ..
            })) => (read(NonPlanar::Project)?, ", seen from above", out_of_plane(in_space(path)?)),
            found => (found?, "", None),
        };
        if !found.has_headings {
            bail!("{file}: it holds positions only, and a reference needs headings");
        }
        let frame = mount_of_run(path).map(|_| LASER.to_owned());
        return Ok(ReferenceTrack {
            name: format!("{file}{note}"),
            trajectory: found.trajectory,
            doubt,
            frame,
        });
    }
    let trajectory: Trajectory = read_log(path)?.recording.stamped_reference();
    if trajectory.is_empty() {
        bail!("{file}: no reference poses with a stamp in it");
    }
    Ok(ReferenceTrack {
        name: file.to_string(),
        trajectory,
        doubt: None,
        frame: Some(LASER.to_owned()),
    })
}
