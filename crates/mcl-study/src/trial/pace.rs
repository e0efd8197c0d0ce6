//! Estimates the time left from the times of completed trials.

use std::time::Duration;

/// Weight of the prior estimate, as a share of the estimated work: the first trials that end say little about
/// the others.
const PRIOR: f64 = 0.02;

/// The parts of trials by cost: maps with their measures, and runs.
const PARTS: usize = 2;

/// Completed and remaining work of a number of trials, in seconds.
#[derive(Debug, Clone)]
pub struct Pace {
    threads: f64,
    /// Estimated seconds of all trials, and of those that ended.
    all: [f64; PARTS],
    ended: [f64; PARTS],
    /// Measured processor seconds of the trials that ended.
    measured: [f64; PARTS],
    /// Wall-clock time of these trials: longer where other programs use the cores, too.
    elapsed: f64,
    /// Estimated seconds of the trial that ended last, which is similar to those in progress.
    last: f64,
}

impl Pace {
    /// For trials with these estimated seconds each, on this number of threads.
    pub fn new(trials: impl Iterator<Item = [f64; PARTS]>, threads: usize) -> Self {
        let (mut all, mut number) = ([0.0; PARTS], 0);
        for trial in trials {
            number += 1;
            all.iter_mut().zip(trial).for_each(|(sum, seconds)| *sum += seconds);
        }
        Pace {
            threads: threads.clamp(1, number.max(1)) as f64,
            all,
            ended: [0.0; PARTS],
            measured: [0.0; PARTS],
            elapsed: 0.0,
            last: 0.0,
        }
    }

    /// A trial ended: the estimate, the measured times of its parts (none for a failed one), and the
    /// wall-clock time.
    pub fn end(&mut self, estimated: [f64; PARTS], measured: Option<[f64; PARTS]>, took: Duration) {
        self.last = estimated.iter().sum();
        match measured {
            Some(measured) => {
                for part in 0..PARTS {
                    self.ended[part] += estimated[part];
                    self.measured[part] += measured[part];
                }
                self.elapsed += took.as_secs_f64();
            }
            // A failed trial says nothing about the others.
            None => self.all.iter_mut().zip(estimated).for_each(|(all, one)| *all -= one),
        }
    }

    /// Share of the estimated work that is done, from 0 to 1.
    pub fn share(&self) -> f64 {
        let [ended, all] = [self.ended, self.all].map(|parts| parts.iter().sum::<f64>());
        if all > 0.0 { (ended / all).clamp(0.0, 1.0) } else { 1.0 }
    }

    /// Estimated wall-clock time until all trials have ended.
    pub fn left(&self) -> Duration {
        let work: f64 = (0..PARTS)
            .map(|part| {
                let prior = PRIOR * self.all[part];
                let slower = (self.measured[part] + prior) / (self.ended[part] + prior);
                let left = (self.all[part] - self.ended[part]).max(0.0);
                if prior > 0.0 { slower * left } else { 0.0 }
            })
            .sum();
        // The other threads are halfway through their trials.
        let under_way = 0.5 * (self.threads - 1.0) * self.last;
        let measured: f64 = self.measured.iter().sum();
        let waiting = if measured > 0.0 { (self.elapsed / measured).max(1.0) } else { 1.0 };
        let seconds = waiting * (work - under_way).max(0.0) / self.threads;
        Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends a tenth of the trials, the longest first, on a machine that takes `of_map` and `of_runs` times as
    /// long as estimated and gives this program every `cores`-th part of its time; returns the ratio of the
    /// reported time left to the true one.
    fn reported_over_true(of_map: f64, of_runs: f64, cores: f64) -> f64 {
        let mut trials: Vec<[f64; 2]> =
            (0..100).flat_map(|n| [[f64::from(n % 10), 0.5], [0.0, 0.5]]).collect();
        trials.sort_by(|a, b| (b[0] + b[1]).total_cmp(&(a[0] + a[1])));
        let threads = 2;
        let mut pace = Pace::new(trials.iter().copied(), threads);
        let truth = |[map, runs]: [f64; 2]| [of_map * map, of_runs * runs];
        let seconds = |trial: &[f64; 2]| cores * truth(*trial).iter().sum::<f64>();
        let total: f64 = trials.iter().map(seconds).sum();
        let mut done = 0.0;
        for trial in &trials {
            let took = seconds(trial);
            pace.end(*trial, Some(truth(*trial)), Duration::from_secs_f64(took));
            done += took;
            if done >= 0.1 * total {
                break;
            }
        }
        pace.left().as_secs_f64() / ((total - done) / threads as f64)
    }

    /// Fault: the reported time left assumed the rate of the first trials for all work, whatever it consists
    /// of, and was four times the true time.
    #[test]
    fn the_time_left_is_right_within_a_third_from_a_tenth_of_the_way_on() {
        for (of_map, of_runs, cores) in
            [(1.0, 1.0, 1.0), (0.3, 1.0, 1.0), (3.0, 1.0, 1.0), (1.0, 0.4, 1.0), (2.0, 2.0, 3.0)]
        {
            let ratio = reported_over_true(of_map, of_runs, cores);
            assert!((0.75..1.33).contains(&ratio), "{of_map} {of_runs} {cores}: {ratio}");
        }
    }

    #[test]
    fn failed_and_free_trials_leave_no_time() {
        let mut pace = Pace::new([[1.0, 2.0], [1.0, 2.0]].into_iter(), 1);
        assert_eq!(pace.left(), Duration::from_secs(6));
        assert_eq!(pace.share(), 0.0);
        pace.end([1.0, 2.0], None, Duration::from_millis(1));
        assert_eq!(pace.left(), Duration::from_secs(3));
        pace.end([1.0, 2.0], Some([1.0, 2.0]), Duration::from_secs(3));
        assert_eq!((pace.left(), pace.share()), (Duration::ZERO, 1.0));
        let nothing = Pace::new(std::iter::empty(), 2);
        assert_eq!((nothing.left(), nothing.share()), (Duration::ZERO, 1.0));
    }
}
