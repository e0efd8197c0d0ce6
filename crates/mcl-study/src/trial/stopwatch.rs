//! Measures the time of the parts of a trial.

use std::time::Duration;

/// Measures the parts of a trial in processor time of the trial's thread, which does not depend on other load
/// on the machine.
#[derive(Debug)]
pub struct Stopwatch {
    since: Duration,
    laps: Vec<(String, f64)>,
}

impl Stopwatch {
    /// Starts on the calling thread, and must stay on it.
    pub fn start() -> Self {
        Stopwatch { since: now(), laps: Vec::new() }
    }

    /// Adds the time since the start or the previous lap to a part.
    pub fn lap(&mut self, part: &str) {
        let now = now();
        let seconds = now.saturating_sub(self.since).as_secs_f64();
        self.since = now;
        match self.laps.iter_mut().find(|(name, _)| name == part) {
            Some((_, sum)) => *sum += seconds,
            None => self.laps.push((part.to_owned(), seconds)),
        }
    }

    /// The parts in the order of their first laps, with their times in seconds.
    pub fn into_laps(self) -> Vec<(String, f64)> {
        self.laps
    }
}

/// Processor time of the calling thread since an arbitrary moment: time in which other threads or programs
/// had the core does not count.
#[cfg(unix)]
pub fn now() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    // The clock starts at 0 with the thread.
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Where there is no such clock: wall-clock time since an arbitrary moment.
#[cfg(not(unix))]
pub fn now() -> Duration {
    use std::sync::LazyLock;
    use std::time::Instant;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_processor_time_counts() {
        const SLEEP: Duration = Duration::from_millis(200);
        let start = now();
        std::thread::sleep(SLEEP);
        let slept = now() - start;
        let mut rounds = 0u64;
        while now() - start < slept + Duration::from_millis(1) {
            rounds += 1;
        }
        assert!(slept < SLEEP && rounds > 0, "{slept:?}, {rounds}");
    }
}
