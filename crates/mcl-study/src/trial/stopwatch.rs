//! How long the parts of a trial take.

use std::time::Duration;

/// Takes the times of a trial's parts: processor time of the trial's thread, which other load on the
/// machine does not stretch.
#[derive(Debug)]
pub struct Stopwatch {
    since: Duration,
    laps: Vec<(String, f64)>,
}

impl Stopwatch {
    /// Starts on the calling thread, where it has to stay.
    pub fn start() -> Self {
        Stopwatch { since: now(), laps: Vec::new() }
    }

    /// Adds the time since the start or the lap before to a part.
    pub fn lap(&mut self, part: &str) {
        let now = now();
        let seconds = now.saturating_sub(self.since).as_secs_f64();
        self.since = now;
        match self.laps.iter_mut().find(|(name, _)| name == part) {
            Some((_, sum)) => *sum += seconds,
            None => self.laps.push((part.to_owned(), seconds)),
        }
    }

    /// The parts in the order of their first laps, with their seconds.
    pub fn into_laps(self) -> Vec<(String, f64)> {
        self.laps
    }
}

/// The processor's time of the calling thread, from some moment on: time in which other threads or
/// programs had the core does not count.
#[cfg(unix)]
pub fn now() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    // The clock starts at 0 with the thread.
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Where there is no such clock to be had: ordinary time from some moment on.
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
    fn only_work_counts() {
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
