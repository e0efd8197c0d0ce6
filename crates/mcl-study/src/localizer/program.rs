//! A run of a program: its folder, its result, and what is kept of a failed run.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use mcl_core::Pose2;
use mcl_core::files::{create_folder, remove_folder, write_atomically};
use tempfile::{Builder, NamedTempFile};

use crate::data::source::LogSource;
use crate::localizer::input::{Files, Input};
use crate::localizer::output::{Missing, read};
use crate::localizer::process::{self, Ended, FinishedProgram};
use crate::recipe::localizer::{Program, filled};
use crate::trial::division::Division;
use crate::trial::map::StudyMap;

/// Folder for the stderr of failed runs of programs, below a result folder.
pub const FAILED_RUNS: &str = "localizer-failures";
/// Folder of the folders in which programs run, below a result folder.
const RUNNING: &str = "running";
/// Ends the name of the file beside such a folder that its process keeps locked. It is created before the folder and removed
/// after it, so that a process that ends at any moment leaves no folder without it.
const OWNER: &str = ".owner";
/// Where locks are not supported, what was not changed for this long is abandoned.
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
            let owner = entry.path();
            let Some(folder) = folder_of(&owner) else { continue };
            if is_abandoned(&owner) {
                // A failure is ignored: the folder does no harm.
                drop(remove_folder(&folder).and_then(|()| fs::remove_file(&owner)));
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
                "localizer {name}: external programs are run only for studies that were read from a file"
            )
        })?;
        if let Some(unknown) = program.files.iter().find(|(_, digest)| digest.is_empty()) {
            return Err(anyhow!("localizer {name}: the digest of {} is unknown", unknown.0));
        }
        let place = self.results.join(RUNNING);
        let cannot = || format!("cannot make a folder in {}", place.display());
        create_folder(&place).with_context(cannot)?;
        let place = std::path::absolute(&place).with_context(cannot)?;
        // Dropped in the reverse order: the folder before the file that says whose it is.
        let owner = owner_in(&place).with_context(cannot)?;
        let own = folder_of(owner.path()).context("a folder of its own")?;
        let own_name = own.file_name().unwrap_or_default();
        let own = Builder::new().rand_bytes(0).prefix(own_name).tempdir_in(&place);
        let own = own.with_context(cannot)?;
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
        let FinishedProgram { processor_s, peak_memory_mb, .. } = finished;
        Ok(ProgramRun { ended, map_from_laser, processor_s, peak_memory_mb })
    }

    /// Keeps the last part of a failed program's stdout and stderr.
    fn keep(
        &self,
        identity: &str,
        program: &Program,
        ended: &Ended,
        finished: &FinishedProgram,
    ) -> Result<()> {
        let folder = self.results.join(FAILED_RUNS);
        let path = folder.join(failed_run(identity));
        let mut text = format!("command: {}\nended: {ended}\n", program.command.join(" "));
        for (name, bytes) in [("stderr", &finished.stderr), ("stdout", &finished.stdout)] {
            let printed = String::from_utf8_lossy(bytes);
            // Writing to a string cannot fail.
            let _ = write!(text, "\n--- end of {name}, {} bytes\n{printed}", bytes.len());
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

/// A new locked file for a folder in which a program will run.
fn owner_in(place: &Path) -> std::io::Result<NamedTempFile> {
    loop {
        let owner = Builder::new().suffix(OWNER).tempfile_in(place)?;
        // Where locks are not supported, its age decides whether the folder is abandoned.
        let _ = owner.as_file().try_lock();
        // A process that starts may have taken it for abandoned before it was locked.
        if owner.path().exists() {
            return Ok(owner);
        }
    }
}

/// The folder to which a file beside it belongs; `None` for any other file.
fn folder_of(owner: &Path) -> Option<PathBuf> {
    let name = owner.file_name()?.to_str()?.strip_suffix(OWNER)?;
    Some(owner.with_file_name(name))
}

/// Whether the process that created a file beside a folder is gone.
fn is_abandoned(owner: &Path) -> bool {
    let Ok(file) = File::open(owner) else { return false };
    match file.try_lock() {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => false,
        Err(TryLockError::Error(_)) => {
            let changed = file.metadata().and_then(|found| found.modified()).ok();
            changed.and_then(|at| at.elapsed().ok()).is_some_and(|age| age > ABANDONED_AFTER)
        }
    }
}

/// The commands that a study would run, by program.
pub fn commands(programs: &[std::sync::Arc<Program>]) -> BTreeMap<&str, String> {
    programs.iter().map(|program| (program.name.as_str(), program.command.join(" "))).collect()
}
