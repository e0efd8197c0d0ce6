//! How long this thread has worked.

use std::time::Duration;

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
