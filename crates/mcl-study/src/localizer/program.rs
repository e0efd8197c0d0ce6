//! A run of a program: its folder, its result, and what is kept of a failed run.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use mcl_core::Pose2;
use mcl_core::files::{create_folder, remove_folder, write_atomically};
use tempfile::TempDir;

use crate::data::source::LogSource;
use crate::localizer::input::{Files, Input};
use crate::localizer::output::{Missing, read};
use crate::localizer::process::{self, Ended, Finished};
use crate::recipe::localizer::{Program, filled};
use crate::trial::division::Division;
use crate::trial::map::StudyMap;

/// Folder for the stderr of failed runs of programs, below a result folder.
pub const FAILED_RUNS: &str = "localizer-failures";
/// Folder of the folders in which programs run, below a result folder.
const RUNNING: &str = "running";
/// File in such a folder that is locked by the process that created it.
const OWNER: &str = "owner";
/// A folder without such a file is abandoned after this time.
const ABANDONED_AFTER: Duration = Duration::from_secs(6 * 3600);

/// The folders in which programs of a study run.
pub struct Programs {
    /// The result folder.
    results: PathBuf,
    /// Folder of the study, which a program may read its files from.
    study: Option<PathBuf>,
}

/// The result of a run of a program.
pub struct ProgramRun {
    /// How the program ended.
    pub ended: Ended,
    /// Estimated pose of the laser per scan, where there is one.
    pub map_from_laser: Vec<Option<Pose2>>,
    /// Processor time (s).
    pub processor_s: f64,
    /// Peak memory (MB).
    pub peak_memory_mb: Option<f64>,
}

impl Programs {
    /// For a result folder and the folder of the study, where that is known. Removes folders of programs that
    /// killed processes left behind.
    pub fn new(results: &Path, study: Option<&Path>) -> Self {
        let running = results.join(RUNNING);
        for entry in fs::read_dir(&running).into_iter().flatten().flatten() {
            if is_abandoned(&entry.path()) {
                // A failure is ignored: the folder does no harm.
                drop(remove_folder(&entry.path()));
            }
        }
        Programs { results: results.to_owned(), study: study.map(Path::to_owned) }
    }

    /// Removes the folder when no program runs any more.
    pub fn end(self) {
        // It may hold folders of other processes, or not exist.
        let _ = fs::remove_dir(self.results.join(RUNNING));
    }

    /// Runs a program on an input and a map. `identity` is that of the row.
    ///
    /// # Errors
    /// When the input cannot be written or the program not started. No way of ending is an error.
    pub fn run(
        &self,
        program: &Program,
        input: &Input,
        map: &StudyMap<2>,
        (division, log): (&Division<2>, &LogSource),
        identity: &str,
    ) -> Result<ProgramRun> {
        let Program { name, formats, poses, limits, .. } = program;
        let study = self.study.as_deref().with_context(|| {
            format!(
                "localizer {name}: programs are run for studies that were read from a file only"
            )
        })?;
        if let Some(unknown) = program.files.iter().find(|(_, digest)| digest.is_empty()) {
            return Err(anyhow!("localizer {name}: nobody has looked at {}", unknown.0));
        }
        let place = self.results.join(RUNNING);
        let cannot = || format!("cannot make a folder in {}", place.display());
        create_folder(&place).with_context(cannot)?;
        let place = std::path::absolute(&place).with_context(cannot)?;
        let own = TempDir::new_in(&place).with_context(cannot)?;
        let owner = File::create(own.path().join(OWNER)).with_context(cannot)?;
        // Where locks are not supported, its age decides whether it is abandoned.
        let _ = owner.try_lock();
        let folder = own.path().join("run");
        create_folder(&folder).with_context(cannot)?;
        let files =
            input.write(&folder, formats, *poses, map, (division, log), Some(limits.time_limit))?;
        let fill = |text: &String| {
            filled(text, |name| placeholder(name, &files, input.seed(), study))
                .map_err(|m| anyhow!(m))
        };
        let command = program.command.iter().map(fill).collect::<Result<Vec<_>>>()?;
        let environment = program.environment.iter();
        let environment = environment.map(|(key, value)| Ok((key.clone(), fill(value)?)));
        let environment = environment.collect::<Result<Vec<_>>>()?;
        let finished = process::run(&command, &environment, &folder, limits)
            .with_context(|| format!("localizer {name}"))?;
        let read = read(&folder, *poses, finished.ended == Ended::Ok);
        let (scans, mount) = (&input.stamps.all, input.recording.robot_from_laser);
        let (ended, map_from_laser) = match (read, &finished.ended) {
            (Ok(found), ended) => (ended.clone(), found.lasers_at(scans, mount)),
            (Err(Missing::Nothing), Ended::Ok) => (Ended::NoOutput, vec![None; scans.len()]),
            (Err(Missing::Malformed(why)), Ended::Ok) => {
                (Ended::Malformed(why), vec![None; scans.len()])
            }
            (Err(_), ended) => (ended.clone(), vec![None; scans.len()]),
        };
        if ended != Ended::Ok {
            self.keep(identity, program, &ended, &finished)?;
        }
        let Finished { processor_s, peak_memory_mb, .. } = finished;
        Ok(ProgramRun { ended, map_from_laser, processor_s, peak_memory_mb })
    }

    /// Keeps the last part of a failed program's stdout and stderr.
    fn keep(
        &self,
        identity: &str,
        program: &Program,
        ended: &Ended,
        finished: &Finished,
    ) -> Result<()> {
        let folder = self.results.join(FAILED_RUNS);
        let path = folder.join(failed_run(identity));
        let mut text = format!("command: {}\nended: {ended}\n", program.command.join(" "));
        for (name, bytes) in [("stderr", &finished.stderr), ("stdout", &finished.stdout)] {
            let said = String::from_utf8_lossy(bytes);
            // Writing to a string cannot fail.
            let _ = write!(text, "\n--- end of {name}, {} bytes\n{said}", bytes.len());
        }
        let cannot = || format!("cannot write {}", path.display());
        create_folder(&folder).with_context(cannot)?;
        write_atomically(&path, text.as_bytes()).with_context(cannot)
    }
}

/// Name of a row's file in [`FAILED_RUNS`].
pub fn failed_run(identity: &str) -> String {
    format!("{identity}.txt")
}

fn placeholder(name: &str, files: &Files, seed: u32, study: &Path) -> Option<String> {
    let path = match name {
        "bag" | "log" => &files.log,
        "map" => &files.map,
        "start" => &files.start,
        "run" => &files.run,
        "output" => &files.output,
        "study" => study,
        "seed" => return Some(seed.to_string()),
        _ => return None,
    };
    Some(path.display().to_string())
}

/// Whether the process that created a folder is gone.
fn is_abandoned(folder: &Path) -> bool {
    match File::open(folder.join(OWNER)).map(|owner| owner.try_lock()) {
        Ok(Ok(())) => true,
        Ok(Err(TryLockError::WouldBlock)) => false,
        _ => {
            let changed = fs::symlink_metadata(folder).and_then(|found| found.modified()).ok();
            changed.and_then(|at| at.elapsed().ok()).is_some_and(|age| age > ABANDONED_AFTER)
        }
    }
}

/// The commands that a study would run, by program.
pub fn commands(programs: &[std::sync::Arc<Program>]) -> BTreeMap<&str, String> {
    programs.iter().map(|program| (program.name.as_str(), program.command.join(" "))).collect()
}
