use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use anyhow::{Context, Result};

/// A unit of work of an experiment.
pub trait Trial: Sync {
    /// A guess of how long the trial takes, in any unit: long trials start first, so that no core is
    /// idle at the end, and the time left is told from it.
    fn cost(&self) -> f64;
}

/// How a set of trials ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrialOutcome {
    /// Trials whose row was saved.
    pub done: usize,
    /// Trials that failed.
    pub failed: usize,
}

/// Runs trials on `threads` threads, each sequential inside, and hands every result to `receive` on
/// the calling thread, in the order they end. What a trial gives must not depend on that order: its
/// seeds come from its identity.
///
/// # Errors
/// The first error of `receive` (no further trial is started), or threads that cannot be had. A trial's
/// own error is handed to `receive` like a result.
pub fn run_trials<T: Trial, R: Send>(
    trials: &[T],
    threads: usize,
    run: impl Fn(&T) -> Result<R> + Sync,
    mut receive: impl FnMut(&T, Result<R>) -> Result<()>,
) -> Result<TrialOutcome> {
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| trials[b].cost().total_cmp(&trials[a].cost()));
    // A pool of one thread per worker keeps the parallel loops inside a trial on that worker: with a
    // shared pool a worker that waits would start another long trial inside the first.
    let pools = (0..threads.clamp(1, trials.len().max(1)))
        .map(|_| rayon::ThreadPoolBuilder::new().num_threads(1).build())
        .collect::<Result<Vec<_>, _>>()
        .context("cannot start worker threads")?;
    let next = AtomicUsize::new(0);
    let stop = Mutex::new(false);
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for pool in &pools {
            let (sender, order, next, run, stop) = (sender.clone(), &order, &next, &run, &stop);
            scope.spawn(move || {
                while let Some(&index) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if *stop.lock().expect("no thread panics with the lock") {
                        break;
                    }
                    let result = pool.install(|| run(&trials[index]));
                    if sender.send((index, result)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut outcome = TrialOutcome { done: 0, failed: 0 };
        for (index, result) in receiver {
            if result.is_ok() {
                outcome.done += 1;
            } else {
                outcome.failed += 1;
            }
            if let Err(error) = receive(&trials[index], result) {
                *stop.lock().expect("no thread panics with the lock") = true;
                return Err(error);
            }
        }
        Ok(outcome)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::bail;

    struct Square(u32);

    impl Trial for Square {
        fn cost(&self) -> f64 {
            f64::from(self.0)
        }
    }

    fn trials() -> Vec<Square> {
        (0..50).map(Square).collect()
    }

    #[test]
    fn every_trial_runs_once_and_failures_are_counted() {
        for threads in [1, 2, 7] {
            let mut seen = Vec::new();
            let run = |trial: &Square| {
                if trial.0 == 13 {
                    bail!("unlucky")
                }
                Ok(trial.0 * trial.0)
            };
            let outcome = run_trials(&trials(), threads, run, |trial, result| {
                seen.push((trial.0, result.ok()));
                Ok(())
            })
            .unwrap();
            assert_eq!(outcome, TrialOutcome { done: 49, failed: 1 });
            seen.sort_unstable();
            let expected: Vec<_> = (0..50).map(|n| (n, (n != 13).then_some(n * n))).collect();
            assert_eq!(seen, expected);
        }
    }

    #[test]
    fn long_trials_start_first() {
        let mut seen = Vec::new();
        run_trials(
            &trials(),
            1,
            |trial| Ok(trial.0),
            |_, n| {
                seen.push(n?);
                Ok(())
            },
        )
        .unwrap();
        assert!(seen.is_sorted_by(|a, b| a > b));
    }

    #[test]
    fn a_result_that_cannot_be_saved_stops_the_run() {
        let mut received = 0;
        let error = run_trials(
            &trials(),
            2,
            |trial| Ok(trial.0),
            |_, _| {
                received += 1;
                bail!("disk full")
            },
        );
        assert_eq!(error.unwrap_err().to_string(), "disk full");
        assert_eq!(received, 1);
    }
}
