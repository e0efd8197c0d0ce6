//! Runs trials on threads.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

use anyhow::{Context, Result, anyhow};

/// Runs trials on `threads` threads, each trial sequentially, those of the highest cost (in any unit) first,
/// so that no core is idle at the end, and passes every result to `receive` on the calling thread, in the
/// order in which they end. Results must not depend on that order: seeds are derived from identities. A trial
/// that panics counts as failed, like one that returns an error.
///
/// # Errors
/// The first error of `receive` (no further trial is started), or of creating threads. A trial's own error is
/// passed to `receive` like a result.
pub fn run_trials<T: Sync, R: Send>(
    trials: &[T],
    cost: impl Fn(&T) -> f64,
    threads: usize,
    run: impl Fn(&T) -> Result<R> + Sync,
    mut receive: impl FnMut(&T, Result<R>) -> Result<()>,
) -> Result<()> {
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| cost(&trials[b]).total_cmp(&cost(&trials[a])));
    // A pool of one thread per worker keeps the parallel loops inside a trial on that worker: with a
    // shared pool a worker that waits would start another long trial inside the first.
    let pools = (0..threads.clamp(1, trials.len().max(1)))
        .map(|_| rayon::ThreadPoolBuilder::new().num_threads(1).build())
        .collect::<Result<Vec<_>, _>>()
        .context("cannot start worker threads")?;
    let next = AtomicUsize::new(0);
    let stop = AtomicBool::new(false);
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for pool in &pools {
            let (sender, order, next, run, stop) = (sender.clone(), &order, &next, &run, &stop);
            let work = move || {
                while let Some(&index) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if stop.load(Ordering::Relaxed) {
                        break;
                    }
                    // State shared between trials is read-only.
                    let unwinding = || pool.install(|| run(&trials[index]));
                    let result =
                        catch_unwind(AssertUnwindSafe(unwinding)).unwrap_or_else(|panic| {
                            Err(anyhow!("internal error: {}", message(panic.as_ref())))
                        });
                    if sender.send((index, result)).is_err() {
                        break;
                    }
                }
            };
            // `scope.spawn` panics when no thread can be created.
            if let Err(error) = std::thread::Builder::new().spawn_scoped(scope, work) {
                stop.store(true, Ordering::Relaxed);
                return Err(error).context("cannot start worker threads");
            }
        }
        drop(sender);
        for (index, result) in receiver {
            if let Err(error) = receive(&trials[index], result) {
                stop.store(true, Ordering::Relaxed);
                return Err(error);
            }
        }
        Ok(())
    })
}

/// The message of a panic.
fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message")
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::bail;

    struct Square(u32);

    fn cost(trial: &Square) -> f64 {
        f64::from(trial.0)
    }

    fn trials() -> Vec<Square> {
        (0..50).map(Square).collect()
    }

    #[test]
    fn every_trial_runs_once_and_failures_are_received() {
        for threads in [1, 2, 7] {
            let mut seen = Vec::new();
            let run = |trial: &Square| {
                if trial.0 == 13 {
                    bail!("unlucky")
                }
                assert!(trial.0 != 17, "a panic in {}", trial.0);
                Ok(trial.0 * trial.0)
            };
            run_trials(&trials(), cost, threads, run, |trial, result| {
                if trial.0 == 17 {
                    assert!(result.as_ref().unwrap_err().to_string().ends_with("a panic in 17"));
                }
                seen.push((trial.0, result.ok()));
                Ok(())
            })
            .unwrap();
            seen.sort_unstable();
            let expected: Vec<_> =
                (0..50).map(|n| (n, (n != 13 && n != 17).then_some(n * n))).collect();
            assert_eq!(seen, expected);
        }
    }

    #[test]
    fn long_trials_start_first() {
        let mut seen = Vec::new();
        run_trials(
            &trials(),
            cost,
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
            cost,
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
