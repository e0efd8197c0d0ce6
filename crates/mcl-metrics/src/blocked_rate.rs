use std::collections::BTreeMap;
use std::fmt;

use mcl_core::math;
use serde::Serialize;

use crate::error::{MetricsError, TooFew};
use crate::interval::Interval;
use crate::rate::{Rate, clopper_pearson};

/// Rate of an event in units (runs) that are grouped in independent blocks (maps).
///
/// Runs on one map are not independent trials: a bad map may lose all of them. To compare two such
/// rates, test the block means of `Blocked` values of 0 and 1 by [`paired`](crate::paired) or
/// [`two_sample`](crate::two_sample). If both sides have different blocks with equally many
/// units, [`fisher_exact_greater`](crate::fisher_exact_greater) of [`BlockedRate::of_blocks`] is an alternative.
///
/// # Example
/// ```
/// use mcl_metrics::{BlockedRate, IntervalBasis};
///
/// // 20 runs on 10 maps, none of them diverged.
/// let none = BlockedRate::new((0..20).map(|run| (run % 10, false)))?;
/// assert_eq!((none.of_units().trials(), none.of_blocks().trials()), (20, 10));
/// assert_eq!(none.basis(), IntervalBasis::Conservative);
/// // The bound for ten trials, not for twenty (0.168).
/// assert!((none.interval(0.95)?.high - 0.308497).abs() < 1e-6);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockedRate {
    of_units: Rate,
    of_blocks: Rate,
    /// Sum over blocks of the squared number of units.
    squared_sizes: f64,
}

/// What [`BlockedRate::interval`] counts as a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum IntervalBasis {
    /// Every block has one unit. Blocks are the trials, and the interval is exact.
    Exact,
    /// Blocks have several units, counted as if all units of a block always shared one outcome.
    Conservative,
}

impl fmt::Display for IntervalBasis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            IntervalBasis::Exact => "exact: one trial per block",
            IntervalBasis::Conservative => {
                "conservative: as if all units of a block were one trial"
            }
        })
    }
}

impl BlockedRate {
    /// Counts events given as `(block, whether the event occurred)` for every unit, in any order.
    ///
    /// # Errors
    /// If there is no unit.
    pub fn new(units: impl IntoIterator<Item = (u64, bool)>) -> Result<Self, MetricsError> {
        let mut blocks: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
        for (block, happened) in units {
            let (hits, units) = blocks.entry(block).or_default();
            *hits += usize::from(happened);
            *units += 1;
        }
        if blocks.is_empty() {
            return Err(TooFew { blocks: 0, needed: 1 }.into());
        }
        let sum = |of: fn(&(usize, usize)) -> usize| blocks.values().map(of).sum();
        Ok(BlockedRate {
            of_units: Rate::new(sum(|block| block.0), sum(|block| block.1))?,
            of_blocks: Rate::new(sum(|block| usize::from(block.0 > 0)), blocks.len())?,
            squared_sizes: blocks.values().map(|block| math::square(block.1 as f64)).sum(),
        })
    }

    /// Number of units with the event, of all units.
    pub fn of_units(&self) -> Rate {
        self.of_units
    }

    /// Number of blocks with the event in at least one unit, of all blocks.
    pub fn of_blocks(&self) -> Rate {
        self.of_blocks
    }

    /// What the interval counts as a trial.
    pub fn basis(&self) -> IntervalBasis {
        match self.of_units.trials() == self.of_blocks.trials() {
            true => IntervalBasis::Exact,
            false => IntervalBasis::Conservative,
        }
    }

    /// Two-sided confidence interval of the true rate among units: that of Clopper &
    /// Pearson (1934) for the fraction of units, with the effective number of independent trials (Korn &
    /// Graubard 1998). This is the number in the worst case, in which all units of a block share one
    /// outcome: (Σn)²/Σn² for n units in a block (Kish 1965), which is the number of blocks if all have
    /// equally many units.
    ///
    /// A bootstrap over blocks is not suitable: if no event occurred, all resamples are equal and the
    /// interval has no width. The correlation within blocks cannot be estimated from a few rare events either.
    ///
    /// # Errors
    /// If the confidence is not between 0 and 1.
    pub fn interval(&self, confidence: f64) -> Result<Interval, MetricsError> {
        let (hits, units) = (self.of_units.hits() as f64, self.of_units.trials() as f64);
        let per_trial = self.squared_sizes / units;
        clopper_pearson(hits / per_trial, units / per_trial, confidence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_unit_per_block_is_exact() {
        let rate = BlockedRate::new((0..10).map(|block| (block, block < 3))).unwrap();
        assert_eq!(rate.basis(), IntervalBasis::Exact);
        assert_eq!(rate.of_units(), rate.of_blocks());
        assert_eq!(rate.interval(0.95), Rate::new(3, 10).unwrap().interval(0.95));
    }

    /// If all runs on a map have the same outcome, there are as many trials as maps.
    #[test]
    fn more_units_of_the_same_blocks_are_not_more_trials() {
        let of = |units: u64| {
            let happened = (0..10 * units).map(|i| (i % 10, i % 10 < 3));
            let rate = BlockedRate::new(happened).unwrap();
            assert_eq!(rate.of_units().hits(), 3 * units);
            rate.interval(0.95).unwrap()
        };
        let exact = of(1);
        for units in [2, 5, 100] {
            let found = of(units);
            assert!((found.low - exact.low).abs() < 1e-12, "{units}: {found:?}");
            assert!((found.high - exact.high).abs() < 1e-12, "{units}: {found:?}");
        }
    }

    /// Blocks of 3, 1 and 1 units: 25/11 trials, and 2 of 5 units hit are 10/11 of them.
    #[test]
    fn uneven_blocks_are_fewer_trials() {
        let units = [(0, true), (0, false), (0, true), (1, false), (2, false)];
        let rate = BlockedRate::new(units).unwrap();
        assert_eq!(
            (rate.of_units(), rate.of_blocks()),
            (Rate::new(2, 5).unwrap(), Rate::new(1, 3).unwrap())
        );
        assert_eq!(
            rate.basis().to_string(),
            "conservative: as if all units of a block were one trial"
        );
        let found = rate.interval(0.95).unwrap();
        let expected = clopper_pearson(10.0 / 11.0, 25.0 / 11.0, 0.95).unwrap();
        assert!((found.low - expected.low).abs() < 1e-12, "{found:?}");
        assert!((found.high - expected.high).abs() < 1e-12, "{found:?}");
        let all = BlockedRate::new([(0, true), (0, true), (1, true)]).unwrap();
        assert_eq!(all.interval(0.95).unwrap().high, 1.0);
    }

    #[test]
    fn a_rate_needs_trials() {
        let error = BlockedRate::new([]).unwrap_err();
        assert_eq!(error, TooFew { blocks: 0, needed: 1 }.into());
        let rate = BlockedRate::new([(0, true)]).unwrap();
        assert!(rate.interval(1.0).is_err() && rate.interval(f64::NAN).is_err());
    }
}
