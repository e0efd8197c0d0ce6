use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::{Pose2, Recording, Trajectory, files};
use mcl_filter::{FilterSettings, Preset, Run};
use mcl_metrics::{
    DEFAULT_XI, DivergenceSettings, LossSettings, PoseError, WeightedPoseError, tum,
};
use serde::Serialize;

use crate::cli::Outcome;
use crate::cli::args::LocalizeArgs;
use crate::cli::output::write_rows;
use crate::localization::Localization;
use crate::progress::tell;
use crate::report::record::{RECORDED_END, RecordedRun};
use mcl_study::data::reference::RUN_SUMMARY;
use mcl_study::data::source::{self, LogSource};
use mcl_study::store::results::save;

/// The output folder: `run-NNN.tum`, `run-NNN.csv` and `run-NNN.watch.json` (for the page) as each run ends,
/// then `reference.tum` and `summary.json`. Every file is written atomically.
pub struct Folder {
    path: PathBuf,
}

/// A scan of a run: the filter's report and the error. Metres and radians.
#[derive(Serialize)]
struct ErrorRow {
    scan: usize,
    /// Seconds, exact; empty without a usable stamp.
    stamp: Option<String>,
    /// Estimate minus reference; errors are empty where the scan has none.
    dx: Option<f64>,
    dy: Option<f64>,
    dtheta: Option<f64>,
    translation: Option<f64>,
    heading: Option<f64>,
    weighted: Option<f64>,
    effective_sample_size: f64,
    resampled: bool,
    used_beams: usize,
    /// Covariance of the laser's pose in the map's frame: m², rad², m·rad.
    var_x: f64,
    var_y: f64,
    var_theta: f64,
    cov_xy: f64,
    cov_xtheta: f64,
    cov_ytheta: f64,
    /// Empty without a reference, and where the covariance is singular.
    nees: Option<f64>,
    /// Empty where no beam was used, as is the share of beams that the map explains.
    log_evidence: Option<f64>,
    explained_beams: Option<f64>,
    particles: usize,
    likelihood_exponent: f64,
}

/// The settings of the call: enough to repeat it.
#[derive(Serialize)]
pub struct Setup<'a> {
    version: &'static str,
    log: &'a str,
    /// SHA-256 of the content of the log, independent of the file.
    recording_sha256: String,
    scans: usize,
    map: &'a Path,
    map_points: usize,
    seed: u64,
    /// The set of settings that options changed to `filter`.
    preset: Preset,
    filter: &'a FilterSettings,
    /// σ_hit on this map (m).
    sigma_hit: f64,
    /// Least likelihood of a beam as a fraction of the largest.
    relative_floor: f64,
    /// Standard deviations in metres and radians.
    odometry_noise: [f64; 2],
    /// Pose of the laser on the robot; the poses in the folder are the laser's.
    robot_from_laser: Pose2,
    /// The laser's pose at the first scan; null for global localization.
    first_pose: Option<Pose2>,
    xi: f64,
    divergence: DivergenceSettings,
    loss: LossSettings,
}

#[derive(Serialize)]
struct Summary<'a> {
    setup: &'a Setup<'a>,
    /// The options of the command, except those of the output.
    options: &'a [String],
    figures: &'a Localization,
}

impl<'a> Setup<'a> {
    /// From the arguments and the values resolved from them.
    pub fn new(
        args: &'a LocalizeArgs,
        source: &'a LogSource,
        map_points: usize,
        (filter, sigma_hit): (&'a FilterSettings, f64),
        first_pose: Option<Pose2>,
    ) -> Self {
        Setup {
            version: env!("CARGO_PKG_VERSION"),
            log: &args.log.log,
            recording_sha256: source::digest(&source.recording),
            scans: source.recording.scans.len(),
            map: &args.map,
            map_points,
            seed: args.seed,
            preset: args.preset,
            filter,
            sigma_hit,
            relative_floor: filter.relative_floor(sigma_hit),
            odometry_noise: args.odometry_noise.unwrap_or_default(),
            robot_from_laser: source.recording.robot_from_laser,
            first_pose,
            xi: DEFAULT_XI,
            divergence: DivergenceSettings::default(),
            loss: LossSettings::default(),
        }
    }
}

impl Folder {
    /// Creates the folder. Files of an earlier call are removed, so that runs of two calls are not mistaken
    /// for those of one; other files stay.
    pub fn open(path: &Path) -> Result<Self> {
        let prepared = || -> io::Result<()> {
            files::create_folder(path)?;
            files::remove_leftovers(path);
            earlier_files(path)?.iter().try_for_each(|path| files::remove(path))
        };
        prepared().with_context(|| format!("cannot prepare the folder {}", path.display()))?;
        Ok(Folder { path: path.to_owned() })
    }

    /// Writes the trajectory and the rows of a run; `nees` has an entry per scan.
    pub fn write_run(
        &self,
        number: u32,
        recording: &Recording,
        run: &Run,
        metric: &WeightedPoseError,
        nees: &[Option<f64>],
    ) -> Result<()> {
        let stamped = recording.scans.iter().zip(&run.map_from_laser);
        let trajectory = stamped.filter_map(|(scan, &pose)| Some((scan.stamp?, pose))).collect();
        self.write_trajectory(&format!("run-{number:03}.tum"), &trajectory)?;
        let rows: Vec<ErrorRow> = recording
            .scans
            .iter()
            .zip(&run.map_from_laser)
            .zip(&run.reports)
            .enumerate()
            .map(|(index, ((scan, estimate), report))| {
                let error = scan.map_from_laser.map(|truth| PoseError::between(&truth, estimate));
                let covariance = report.estimate.covariance_at(&recording.robot_from_laser);
                ErrorRow {
                    scan: index,
                    stamp: scan.stamp.map(|stamp| stamp.to_string()),
                    dx: error.map(|error| error.dx),
                    dy: error.map(|error| error.dy),
                    dtheta: error.map(|error| error.dtheta),
                    translation: error.map(|error| error.translation()),
                    heading: error.map(|error| error.heading()),
                    weighted: error.map(|error| metric.of(&error)),
                    effective_sample_size: report.effective_sample_size,
                    resampled: report.resampled,
                    used_beams: report.used_beams,
                    var_x: covariance[(0, 0)],
                    var_y: covariance[(1, 1)],
                    var_theta: covariance[(2, 2)],
                    cov_xy: covariance[(0, 1)],
                    cov_xtheta: covariance[(0, 2)],
                    cov_ytheta: covariance[(1, 2)],
                    nees: nees[index],
                    log_evidence: (report.used_beams > 0).then_some(report.log_evidence),
                    explained_beams: report.explained_beams,
                    particles: report.particles,
                    likelihood_exponent: report.likelihood_exponent,
                }
            })
            .collect();
        write_rows(&self.path.join(format!("run-{number:03}.csv")), &rows)
    }

    /// Writes a run for playback on a page.
    pub fn write_recorded(&self, number: u32, run: &RecordedRun) -> Result<()> {
        let path = self.path.join(format!("run-{number:03}{RECORDED_END}"));
        save(&path, run.to_json()?.as_bytes())
    }

    /// Writes the reference and the summary; reports which scans the trajectories lack.
    pub fn finish(
        &self,
        recording: &Recording,
        (setup, options): (&Setup<'_>, &[String]),
        figures: &Localization,
    ) -> Result<Outcome> {
        self.write_trajectory("reference.tum", &recording.stamped_reference())?;
        let text = serde_json::to_string_pretty(&Summary { setup, options, figures })? + "\n";
        save(&self.path.join(RUN_SUMMARY), text.as_bytes())?;
        let unstamped = recording.scans.iter().filter(|scan| scan.stamp.is_none()).count();
        if unstamped > 0 {
            tell!(
                "warning: {} of {} scans have no usable stamp: they are in the error rows, but not in \
                 the TUM files, which are matched by stamp",
                unstamped,
                recording.scans.len()
            );
        }
        Ok(Outcome::of(unstamped == 0))
    }

    /// A trajectory without poses is not written: no reader would accept it.
    fn write_trajectory(&self, name: &str, trajectory: &Trajectory) -> Result<()> {
        if trajectory.is_empty() {
            return Ok(());
        }
        let path = self.path.join(name);
        tum::write_file(&path, trajectory)
            .with_context(|| format!("cannot write {}", path.display()))
    }
}

/// Files of an earlier call in a folder, which need not exist.
pub fn earlier_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut paths = Vec::new();
    for entry in entries {
        let entry = entry?;
        if is_ours(&entry.file_name().to_string_lossy()) {
            paths.push(entry.path());
        }
    }
    Ok(paths)
}

/// Whether a file of this name was written by an earlier call.
fn is_ours(name: &str) -> bool {
    let number = name.strip_prefix("run-").and_then(|rest| {
        [".tum", ".csv", RECORDED_END].iter().find_map(|end| rest.strip_suffix(end))
    });
    matches!(name, "reference.tum" | RUN_SUMMARY)
        || number.is_some_and(|n| n.len() >= 3 && n.bytes().all(|byte| byte.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_own_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let own = [
            "run-000.tum",
            "run-017.csv",
            "run-1000.csv",
            "run-000.watch.json",
            "reference.tum",
            "summary.json",
        ];
        let others = ["run-1.tum", "run-abc.csv", "run-000.tum.bak", "m.csv", "summary.csv"];
        for name in own.iter().chain(&others) {
            fs::write(folder.path().join(name), name).unwrap();
        }
        Folder::open(folder.path()).unwrap();
        assert!(own.iter().all(|name| !folder.path().join(name).exists()));
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
    }
}
