//! Runs an external program within limits, and leaves no process behind.
//!
//! A program is the leader of its own process group. It is asked to end at its time limit and killed a few
//! seconds later, with its whole group; one that uses too much memory or disk is killed at once. Its stdout
//! and stderr are read, and the last part of each is kept. A process that left the group is recognized by a
//! variable of its environment where the system provides that (Linux).

use std::fmt;
use std::time::Duration;

/// How a program ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// With exit code 0.
    Ok,
    /// It was stopped at its time limit.
    TimeLimit,
    /// It was killed for exceeding its memory limit.
    MemoryLimit,
    /// It was killed for exceeding its output limit.
    OutputLimit,
    /// With another exit code.
    ExitCode(i32),
    /// By a signal.
    Signal(i32),
    /// With exit code 0 and nothing written.
    NoOutput,
    /// With exit code 0 and output that cannot be used, for this reason.
    Malformed(String),
}

/// As written in the column `ended`.
impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Ended::Ok => f.write_str("ok"),
            Ended::TimeLimit => f.write_str("time limit"),
            Ended::MemoryLimit => f.write_str("memory limit"),
            Ended::OutputLimit => f.write_str("output limit"),
            Ended::ExitCode(code) => write!(f, "exit code {code}"),
            Ended::Signal(signal) => write!(f, "signal {signal}"),
            Ended::NoOutput => f.write_str("no output"),
            Ended::Malformed(why) => write!(f, "malformed output: {why}"),
        }
    }
}

/// The result of a program that ended.
#[derive(Debug, Clone, PartialEq)]
pub struct FinishedProgram {
    /// How it ended; [`Ended::Ok`] whatever its output.
    pub ended: Ended,
    /// Processor time of it and of the processes that it waited for (s).
    pub processor_s: f64,
    /// Peak memory of its processes together, sampled, and at least the peak of any single one (MB); `None`
    /// where the system does not report it.
    pub peak_memory_mb: Option<f64>,
    /// The end of its stdout.
    pub stdout: Vec<u8>,
    /// The end of its stderr.
    pub stderr: Vec<u8>,
}

/// Time that a program has to end after it was asked to.
pub const GRACE: Duration = Duration::from_secs(3);
#[cfg(unix)]
pub use on_unix::{end_all, run};

#[cfg(unix)]
mod on_unix {
    use std::collections::BTreeMap;
    use std::fs;
    use std::os::unix::process::CommandExt;
    use std::path::Path;
    use std::process::{Child, Command, Stdio};
    use std::sync::{Mutex, PoisonError};
    use std::time::{Duration, Instant};

    use anyhow::{Context, Result, bail};
    use rustix::process::{
        Pid, Signal, WaitId, WaitIdOptions, kill_process, kill_process_group, waitid,
    };
    use wait4::Wait4;

    use super::{Ended, FinishedProgram, GRACE};
    use crate::localizer::tail::OutputTail;
    use crate::recipe::localizer::Limits;

    /// Environment variables that are passed on to programs.
    const PASSED_ON: [&str; 3] = ["PATH", "HOME", "LANG"];
    /// The environment variable that marks a program's processes.
    const MARK: &str = "MCL_EVAL_PROGRAM";
    /// Intervals between two checks of a program: short after its start, longer later.
    const SHORTEST: Duration = Duration::from_millis(2);
    const LONGEST: Duration = Duration::from_millis(200);
    /// A folder with more files exceeds any limit.
    const MOST_FILES: usize = 100_000;
    const MEGABYTE: f64 = 1e6;

    /// The running programs, by process group, each with its mark; `None` when no further one may start.
    static RUNNING: Mutex<Option<BTreeMap<i32, String>>> = Mutex::new(Some(BTreeMap::new()));

    /// Ends all programs and lets no other start: for a process that is about to exit.
    pub fn end_all() {
        let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
        let groups = running.take().unwrap_or_default();
        for &group in groups.keys() {
            signal_group(group, Signal::TERM);
        }
        let since = Instant::now();
        let is_alive = || groups.iter().any(|(&group, mark)| !alive(group, mark).is_empty());
        while since.elapsed() < Duration::from_millis(500) && is_alive() {
            std::thread::sleep(Duration::from_millis(5));
        }
        for (group, mark) in &groups {
            kill_all(*group, mark);
        }
    }

    /// Runs a program in a folder, which is its working directory and may grow up to its output limit.
    ///
    /// # Errors
    /// When it cannot be started. No way of ending is an error.
    pub fn run(
        command: &[String],
        environment: &[(String, String)],
        folder: &Path,
        limits: &Limits,
    ) -> Result<FinishedProgram> {
        let Some((program, arguments)) = command.split_first() else {
            bail!("there is no command")
        };
        if limits.memory_limit.is_some() && cfg!(not(target_os = "linux")) {
            bail!("memory_limit is supported on Linux only");
        }
        let mark = format!("{MARK}={}", folder.display());
        let before = size_of(folder);
        let mut child = Command::new(program);
        child.args(arguments).current_dir(folder).env_clear();
        for name in PASSED_ON {
            child.envs(std::env::var_os(name).map(|value| (name, value)));
        }
        child.envs(environment.iter().map(|(name, value)| (name, value)));
        child.env(MARK, folder);
        child.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        let mut child = {
            let mut running = RUNNING.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(running) = running.as_mut() else { bail!("interrupted") };
            let child = child.spawn().with_context(|| format!("cannot start {program}"))?;
            running.insert(child.id() as i32, mark.clone());
            child
        };
        let group = child.id() as i32;
        limit_files(group, limits);
        let watched = watch(&mut child, (folder, before), limits, &mark);
        // The leader has not been waited for yet, so that the group id is still its own.
        kill_all(group, &mark);
        if let Some(running) = RUNNING.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            running.remove(&group);
        }
        let used = child.wait4().context("cannot wait for a program")?;
        let (stopped, peak_kb, [stdout, stderr]) = watched?;
        let is_over = size_of(folder).saturating_sub(before) > bytes(limits.output_limit);
        let ended = match (stopped, used.status.code(), signal_of(&used.status)) {
            (Some(ended), ..) => ended,
            _ if is_over => Ended::OutputLimit,
            (None, Some(0), _) => Ended::Ok,
            (None, Some(code), _) => Ended::ExitCode(code),
            (None, None, signal) => Ended::Signal(signal),
        };
        let time = used.rusage.utime + used.rusage.stime;
        // The system includes the memory of the process before it became the program: that of this process.
        let by_system = used.rusage.maxrss / 1024;
        let peak_kb = if by_system > own_peak_kb() { peak_kb.max(by_system) } else { peak_kb };
        Ok(FinishedProgram {
            ended,
            processor_s: time.as_secs_f64(),
            peak_memory_mb: (peak_kb > 0).then(|| peak_kb as f64 * 1024.0 / MEGABYTE),
            stdout: stdout.end(),
            stderr: stderr.end(),
        })
    }

    /// Waits until the leader has ended or was stopped; returns why, and the peak memory of its processes
    /// (kB).
    fn watch(
        child: &mut Child,
        (folder, before): (&Path, u64),
        limits: &Limits,
        mark: &str,
    ) -> Result<(Option<Ended>, u64, [OutputTail; 2])> {
        let group = child.id() as i32;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let tails = [
            OutputTail::of(stdout.context("a program without stdout")?)?,
            OutputTail::of(stderr.context("a program without stderr")?)?,
        ];
        let pid = Pid::from_child(child);
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
        let since = Instant::now();
        let limit = Duration::try_from_secs_f64(limits.time_limit).unwrap_or(Duration::MAX);
        let (mut stopped, mut peak_kb, mut is_killed) = (None, 0, false);
        loop {
            let elapsed = since.elapsed();
            if waitid(WaitId::Pid(pid), options).context("cannot wait for a program")?.is_some() {
                return Ok((stopped, peak_kb, tails));
            }
            if !is_killed {
                let (together, each) = memory(group);
                peak_kb = peak_kb.max(together).max(each);
                let memory_mb = together as f64 * 1024.0 / MEGABYTE;
                if limits.memory_limit.is_some_and(|limit| memory_mb > limit) {
                    stopped = stopped.or(Some(Ended::MemoryLimit));
                    is_killed = true;
                } else if size_of(folder).saturating_sub(before) > bytes(limits.output_limit) {
                    stopped = stopped.or(Some(Ended::OutputLimit));
                    is_killed = true;
                } else if elapsed >= limit.saturating_add(GRACE) {
                    is_killed = true;
                } else if elapsed >= limit && stopped.is_none() {
                    stopped = Some(Ended::TimeLimit);
                    signal_group(group, Signal::TERM);
                }
                if is_killed {
                    kill_all(group, mark);
                }
            }
            let pause = (elapsed / 20).clamp(SHORTEST, LONGEST);
            let left = [limit, limit.saturating_add(GRACE)].map(|at| at.saturating_sub(elapsed));
            let next = left.into_iter().filter(|left| !left.is_zero()).min();
            std::thread::sleep(next.map_or(pause, |next| pause.min(next)));
        }
    }

    fn bytes(megabytes: f64) -> u64 {
        (megabytes * MEGABYTE) as u64
    }

    fn signal_of(status: &std::process::ExitStatus) -> i32 {
        use std::os::unix::process::ExitStatusExt;
        status.signal().unwrap_or_default()
    }

    /// Bytes of the files below a folder; links are not followed.
    fn size_of(folder: &Path) -> u64 {
        let (mut sum, mut files, mut folders) = (0_u64, 0, vec![folder.to_owned()]);
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                files += 1;
                if files > MOST_FILES {
                    return u64::MAX;
                }
                match entry.metadata() {
                    Ok(found) if found.is_dir() => folders.push(entry.path()),
                    Ok(found) => sum = sum.saturating_add(found.len()),
                    Err(_) => {}
                }
            }
        }
        sum
    }

    fn signal_group(group: i32, signal: Signal) {
        // There may be no process left.
        let _ = Pid::from_raw(group).map(|group| kill_process_group(group, signal));
    }

    /// Kills all processes of a program, and waits until they are gone.
    fn kill_all(group: i32, mark: &str) {
        const LONGEST: Duration = Duration::from_secs(5);
        let since = Instant::now();
        signal_group(group, Signal::KILL);
        while since.elapsed() < LONGEST {
            let alive = alive(group, mark);
            if alive.is_empty() {
                return;
            }
            signal_group(group, Signal::KILL);
            for pid in alive.into_iter().filter_map(Pid::from_raw) {
                let _ = kill_process(pid, Signal::KILL);
            }
            std::thread::sleep(SHORTEST);
        }
    }

    /// The processes of a program that are alive, as far as the system reports them.
    #[cfg(target_os = "linux")]
    fn alive(group: i32, mark: &str) -> Vec<i32> {
        crate::localizer::members::of_group_or_mark(group, mark)
    }

    #[cfg(not(target_os = "linux"))]
    fn alive(_: i32, _: &str) -> Vec<i32> {
        Vec::new()
    }

    /// Memory of a group together, and the peak of any of its processes (kB); 0 where the system does not
    /// report it.
    #[cfg(target_os = "linux")]
    fn memory(group: i32) -> (u64, u64) {
        let members = crate::localizer::members::of_group(group);
        let together = members.iter().map(|member| member.resident_kb).sum();
        (together, members.iter().map(|member| member.peak_kb).max().unwrap_or(0))
    }

    #[cfg(not(target_os = "linux"))]
    fn memory(_: i32) -> (u64, u64) {
        (0, 0)
    }

    #[cfg(target_os = "linux")]
    fn own_peak_kb() -> u64 {
        crate::localizer::members::own_peak_kb()
    }

    #[cfg(not(target_os = "linux"))]
    fn own_peak_kb() -> u64 {
        u64::MAX
    }

    /// Limits the size of any single file to about the limit of all together: a program that writes fast
    /// would exceed it by far before the next check.
    #[cfg(target_os = "linux")]
    fn limit_files(pid: i32, limits: &Limits) {
        use rustix::process::{Resource, Rlimit, prlimit};
        let most = Some(bytes(limits.output_limit) + (1 << 20));
        // The folder is watched in any case.
        let _ =
            prlimit(Pid::from_raw(pid), Resource::Fsize, Rlimit { current: most, maximum: most });
    }

    #[cfg(not(target_os = "linux"))]
    fn limit_files(_: i32, _: &Limits) {}
}

/// Does nothing where programs cannot be run.
#[cfg(not(unix))]
pub fn end_all() {}

/// External programs are run on Unix only.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub fn run(
    _: &[String],
    _: &[(String, String)],
    _: &std::path::Path,
    _: &crate::recipe::localizer::Limits,
) -> anyhow::Result<FinishedProgram> {
    anyhow::bail!("external programs are run on Unix only")
}
