use std::collections::BTreeMap;

use mcl_core::{Seed, math};

use crate::error::{MetricsError, TooFew, is_usable};
use crate::interval::{self, Interval, MeanInterval, resample_groups};

/// Values grouped by block: the maps of one draw number with all runs on them, or the runs from one start.
///
/// Blocks are independent of each other, but values in the same block are not: twice as many runs on the same
/// ten maps give little more information about other maps. Every test and interval therefore uses one
/// number per block as its sample, and no value can be tested without its block.
///
/// Values may have a *unit*, such as the number of the run, by which the values of two `Blocked` are paired:
/// run 3 has the same odometry noise on the maps of both builders. See [`Blocked::minus`].
///
/// No result depends on the order in which values are given.
///
/// # Example
/// ```
/// use mcl_metrics::Blocked;
///
/// // Errors of two runs on the map of draw 0, and of three on that of draw 1.
/// let errors = Blocked::new([(0, 0.02), (0, 0.04), (1, 0.05), (1, 0.06), (1, 0.07)])?;
/// assert_eq!((errors.blocks(), errors.count()), (2, 5));
/// assert!((errors.mean() - 0.048).abs() < 1e-15);
/// assert!((errors.mean_of_blocks() - 0.045).abs() < 1e-15);
/// // One degree of freedom, whatever the number of runs.
/// assert!(errors.mean_interval()?.interval.high > 0.2);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Blocked {
    /// At least one; by block, unit, value.
    items: Vec<Item>,
    means: Vec<(u64, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Item {
    block: u64,
    unit: Option<u64>,
    value: f64,
}

impl Item {
    fn place(&self) -> String {
        match self.unit {
            Some(unit) => format!("block {}, unit {unit}", self.block),
            None => format!("block {}", self.block),
        }
    }
}

impl Blocked {
    /// Groups values given as `(block, value)`, in any order.
    ///
    /// # Errors
    /// If there is no value, or one is not finite (or not below 10¹⁴⁰ in magnitude); the error has its block
    /// and its index among the values of that block.
    pub fn new(values: impl IntoIterator<Item = (u64, f64)>) -> Result<Self, MetricsError> {
        let item = |(block, value)| Item { block, unit: None, value };
        Self::checked(values.into_iter().map(item).collect())
    }

    /// Groups values given as `(block, unit, value)`, in any order. Units are identified within their block: the same
    /// number in another block is a different unit.
    ///
    /// # Errors
    /// As [`Blocked::new`], and if a unit occurs more than once in its block.
    pub fn with_units(
        values: impl IntoIterator<Item = (u64, u64, f64)>,
    ) -> Result<Self, MetricsError> {
        let item = |(block, unit, value)| Item { block, unit: Some(unit), value };
        Self::checked(values.into_iter().map(item).collect())
    }

    fn checked(items: Vec<Item>) -> Result<Self, MetricsError> {
        if let Some(position) = items.iter().position(|item| !is_usable(item.value)) {
            let bad = items[position];
            let index = items[..position].iter().filter(|item| item.block == bad.block).count();
            return Err(MetricsError::Sample { index, value: bad.value }.within(bad.place()));
        }
        let blocked = Self::of(items)?;
        let repeated = |pair: &&[Item]| {
            pair[0].unit.is_some() && (pair[0].block, pair[0].unit) == (pair[1].block, pair[1].unit)
        };
        match blocked.items.windows(2).find(repeated) {
            Some(&[Item { block, unit: Some(unit), .. }, ..]) => {
                Err(MetricsError::RepeatedUnit { block, unit })
            }
            _ => Ok(blocked),
        }
    }

    fn of(mut items: Vec<Item>) -> Result<Self, TooFew> {
        if items.is_empty() {
            return Err(TooFew { blocks: 0, needed: 1 });
        }
        items.sort_unstable_by(|a, b| {
            (a.block, a.unit).cmp(&(b.block, b.unit)).then(a.value.total_cmp(&b.value))
        });
        let mean = |(block, values): (u64, Vec<f64>)| (block, interval::mean(&values));
        let means = groups(&items).map(mean).collect();
        Ok(Blocked { items, means })
    }

    /// Number of blocks, at least 1.
    pub fn blocks(&self) -> usize {
        self.means.len()
    }

    /// Number of values in all blocks together.
    pub fn count(&self) -> usize {
        self.items.len()
    }

    /// Every value with its block, blocks ascending.
    pub fn values(&self) -> impl Iterator<Item = (u64, f64)> + '_ {
        self.items.iter().map(|item| (item.block, item.value))
    }

    /// Mean of the values of each block, blocks ascending.
    pub fn block_means(&self) -> &[(u64, f64)] {
        &self.means
    }

    /// Mean of all values with equal weights, so that the weight of a block is its number of values.
    /// Figures and tests use [`mean_of_blocks`](Self::mean_of_blocks).
    pub fn mean(&self) -> f64 {
        interval::mean(&self.items.iter().map(|item| item.value).collect::<Vec<f64>>())
    }

    /// Mean of the block means, with equal weights of all blocks. This is what tests compare.
    pub fn mean_of_blocks(&self) -> f64 {
        interval::mean(&self.sample())
    }

    /// Transforms every value, for example to its logarithm.
    ///
    /// # Errors
    /// If the result for a value is not finite (ln of 0 or of a negative number); the error has its block and unit.
    ///
    /// # Example
    /// ```
    /// use mcl_metrics::Blocked;
    ///
    /// let errors = Blocked::with_units([(0, 3, 1.0), (1, 4, 0.0)])?;
    /// assert_eq!(
    ///     errors.map(f64::ln).unwrap_err().to_string(),
    ///     "block 1, unit 4: the value 0 is transformed to -inf, expected a finite number"
    /// );
    /// # Ok::<(), mcl_metrics::MetricsError>(())
    /// ```
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Result<Blocked, MetricsError> {
        let transform = |item: &Item| {
            let (value, result) = (item.value, f(item.value));
            match is_usable(result) {
                true => Ok(Item { value: result, ..*item }),
                false => Err(MetricsError::Transformed { value, result }.within(item.place())),
            }
        };
        let items: Vec<Item> = self.items.iter().map(transform).collect::<Result<_, _>>()?;
        Ok(Self::of(items)?)
    }

    /// The differences a − b in the blocks that both have. If both have units, each value of `self`
    /// is paired with that of `other` with the same block and unit, and values without a partner are left
    /// out; the differences keep these units. Otherwise the block means are subtracted.
    ///
    /// # Errors
    /// If there is no pair.
    pub fn minus(&self, other: &Blocked) -> Result<Blocked, TooFew> {
        let have_units = [self, other].iter().all(|side| side.items[0].unit.is_some());
        let [a, b] = [self, other].map(|side| match have_units {
            true => side.items.clone(),
            false => {
                let item = |&(block, value)| Item { block, unit: None, value };
                side.means.iter().map(item).collect()
            }
        });
        let key = |item: &Item| (item.block, item.unit);
        let b: BTreeMap<_, f64> = b.iter().map(|item| (key(item), item.value)).collect();
        let difference =
            |item: Item| Some(Item { value: item.value - b.get(&key(&item))?, ..item });
        Self::of(a.into_iter().filter_map(difference).collect())
    }

    /// Intraclass correlation ICC(1) of the one-way analysis of variance (Donner 1986), for blocks of any size: the
    /// similarity of the values in a block, from 0 (no more similar than those of different blocks) to 1 (all
    /// equal). The estimate is negative if values differ more within blocks than
    /// between them. `None` if there are fewer than two blocks, no block has two values, or all values
    /// are equal.
    pub fn intraclass_correlation(&self) -> Option<f64> {
        let (count, blocks) = (self.count() as f64, self.blocks() as f64);
        if self.blocks() < 2 || self.count() == self.blocks() {
            return None;
        }
        let grand_mean = self.mean();
        let (mut between, mut within, mut squared_sizes) = (0.0, 0.0, 0.0);
        for ((_, values), (_, mean)) in groups(&self.items).zip(&self.means) {
            let size = values.len() as f64;
            between += size * math::square(mean - grand_mean);
            within += values.iter().map(|value| math::square(value - mean)).sum::<f64>();
            squared_sizes += size * size;
        }
        let (between, within) = (between / (blocks - 1.0), within / (count - blocks));
        let size = (count - squared_sizes / count) / (blocks - 1.0);
        let total = between + (size - 1.0) * within;
        (total > 0.0).then(|| (between - within) / total)
    }

    /// [`Blocked::mean_of_blocks`] with Student's 95 % interval over the blocks.
    ///
    /// # Errors
    /// If there are fewer than two blocks.
    pub fn mean_interval(&self) -> Result<MeanInterval, TooFew> {
        Ok(interval::student_mean(&self.at_least_two()?))
    }

    /// [`Blocked::mean`] with the 95 % percentile interval of a bootstrap over blocks (Efron & Tibshirani
    /// 1993, ch. 13): `resamples` times, whole blocks are drawn with replacement, as many as there are, and their
    /// values pooled. The result depends on `seed` but not on how blocks are numbered. Unlike
    /// Student's interval it need not be symmetric, but with few blocks it is too narrow: for normally
    /// distributed means by a fifth with ten blocks, by a third with five.
    ///
    /// # Errors
    /// If there are fewer than two blocks, or `resamples` is 0.
    pub fn bootstrap_interval(
        &self,
        resamples: usize,
        seed: Seed,
    ) -> Result<MeanInterval, MetricsError> {
        self.at_least_two()?;
        // Relative to the mean, so that the mean of equal values is exact.
        let mean = self.mean();
        let total = |(_, values): (u64, Vec<f64>)| {
            (values.iter().map(|value| value - mean).sum(), values.len() as f64)
        };
        let mut totals: Vec<(f64, f64)> = groups(&self.items).map(total).collect();
        totals.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
        let Interval { low, high } = resample_groups(&totals, resamples, seed)?.interval;
        Ok(MeanInterval { mean, interval: Interval { low: mean + low, high: mean + high } })
    }

    /// The sample of every test and interval: one number per block.
    pub(crate) fn sample(&self) -> Vec<f64> {
        self.means.iter().map(|&(_, mean)| mean).collect()
    }

    /// The sample of block means, if its spread can be estimated.
    pub(crate) fn at_least_two(&self) -> Result<Vec<f64>, TooFew> {
        match self.blocks() {
            blocks @ ..2 => Err(TooFew { blocks, needed: 2 }),
            _ => Ok(self.sample()),
        }
    }
}

/// The values of each block.
fn groups(items: &[Item]) -> impl Iterator<Item = (u64, Vec<f64>)> + '_ {
    items
        .chunk_by(|a, b| a.block == b.block)
        .map(|block| (block[0].block, block.iter().map(|item| item.value).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uneven() -> Blocked {
        Blocked::new([(7, 8.0), (2, 1.0), (5, 5.0), (2, 3.0), (7, 12.0), (7, 10.0)]).unwrap()
    }

    #[test]
    fn values_are_grouped_by_block() {
        let blocked = uneven();
        assert_eq!((blocked.blocks(), blocked.count()), (3, 6));
        assert_eq!(blocked.block_means(), [(2, 2.0), (5, 5.0), (7, 10.0)]);
        assert_eq!(blocked.mean(), 6.5);
        assert!((blocked.mean_of_blocks() - 17.0 / 3.0).abs() < 1e-14);
        let values: Vec<(u64, f64)> = blocked.values().collect();
        assert_eq!(values, [(2, 1.0), (2, 3.0), (5, 5.0), (7, 8.0), (7, 10.0), (7, 12.0)]);
        assert_eq!(blocked.map(|x| 2.0 * x).unwrap().mean(), 13.0);
    }

    #[test]
    fn invalid_values_are_named() {
        let message = |result: Result<Blocked, MetricsError>| result.unwrap_err().to_string();
        assert_eq!(
            message(Blocked::new([(4, 1.0), (9, 1.0), (4, f64::NAN)])),
            "block 4: sample 1 is NaN, expected a finite number of magnitude below 1e140"
        );
        assert!(
            message(Blocked::with_units([(4, 7, 1e200)]))
                .starts_with("block 4, unit 7: sample 0 is")
        );
        assert_eq!(
            message(Blocked::new([])),
            "too few to tell: 0 independent blocks, at least 1 needed"
        );
        let negative = Blocked::new([(3, -2.0)]).unwrap().map(f64::ln);
        assert!(message(negative).starts_with("block 3: the value -2 is transformed to NaN"));
    }

    /// A size that was listed twice was once counted twice, with p = 0.0007 instead of 0.034.
    #[test]
    fn a_unit_counts_once() {
        let twice = Blocked::with_units([(1, 5, 0.1), (2, 5, 0.2), (1, 6, 0.3), (1, 5, 0.1)]);
        assert_eq!(twice.unwrap_err(), MetricsError::RepeatedUnit { block: 1, unit: 5 });
        assert!(Blocked::with_units([(1, 5, 0.1), (2, 5, 0.2), (1, 6, 0.3)]).is_ok());
    }

    #[test]
    fn units_of_both_sides_are_paired() {
        let a = Blocked::with_units([(0, 0, 5.0), (0, 1, 9.0), (1, 2, 4.0), (3, 3, 1.0)]).unwrap();
        let b = Blocked::with_units([(0, 1, 2.0), (1, 2, 3.0), (1, 7, 8.0), (4, 3, 1.0)]).unwrap();
        let difference = a.minus(&b).unwrap();
        assert_eq!(difference.block_means(), [(0, 7.0), (1, 1.0)]);
        assert_eq!(difference, Blocked::with_units([(0, 1, 7.0), (1, 2, 1.0)]).unwrap());
        // If a side has no units, block means are subtracted.
        let means = Blocked::new(b.values()).unwrap();
        assert_eq!(a.minus(&means).unwrap().block_means(), [(0, 5.0), (1, -1.5)]);
        let elsewhere = Blocked::with_units([(0, 8, 2.0), (9, 1, 2.0)]).unwrap();
        assert_eq!(a.minus(&elsewhere), Err(TooFew { blocks: 0, needed: 1 }));
    }

    /// By hand: 79.5 between blocks with 2 degrees of freedom, 10 within with 3, 11/6 values per block.
    #[test]
    fn intraclass_correlation_of_uneven_blocks() {
        let found = uneven().intraclass_correlation().unwrap();
        assert!((found - 1311.0 / 1531.0).abs() < 1e-14, "{found}");
        let of = |values: [f64; 4]| {
            Blocked::new([0, 0, 1, 1].into_iter().zip(values)).unwrap().intraclass_correlation()
        };
        assert_eq!(of([1.0, 1.0, 2.0, 2.0]), Some(1.0));
        assert_eq!(of([0.0, 2.0, 2.0, 0.0]), Some(-1.0));
        assert_eq!(of([0.1; 4]), None);
        assert_eq!(Blocked::new([(0, 1.0), (0, 2.0)]).unwrap().intraclass_correlation(), None);
        assert_eq!(Blocked::new([(0, 1.0), (1, 2.0)]).unwrap().intraclass_correlation(), None);
    }

    /// Block means 2, 5, 10: Student's interval with two degrees of freedom.
    #[test]
    fn intervals_are_over_blocks() {
        let found = uneven().mean_interval().unwrap();
        assert_eq!(found, interval::mean_interval(&[2.0, 5.0, 10.0]).unwrap());
        let few = Blocked::new([(3, 1.0), (3, 2.0), (3, 3.0)]).unwrap();
        assert_eq!(few.mean_interval(), Err(TooFew { blocks: 1, needed: 2 }));
        let error = few.bootstrap_interval(100, Seed::new(1)).unwrap_err();
        assert_eq!(error, TooFew { blocks: 1, needed: 2 }.into());
        let error = uneven().bootstrap_interval(0, Seed::new(1)).unwrap_err().to_string();
        assert!(error.starts_with("resamples is 0, expected at least 1"), "{error}");
    }

    /// With two blocks a resample is (a, a), (a, b) twice, or (b, b): the bounds are the blocks' means.
    #[test]
    fn whole_blocks_are_resampled() {
        let values = [(0, 0.0), (0, 0.2), (1, 0.9), (1, 1.0), (1, 1.1)];
        let blocked = Blocked::new(values).unwrap();
        let found = blocked.bootstrap_interval(2000, Seed::new(3)).unwrap();
        assert!((found.mean - 0.64).abs() < 1e-15, "{found:?}");
        let Interval { low, high } = found.interval;
        assert!((low - 0.1).abs() < 1e-15 && (high - 1.0).abs() < 1e-15, "{found:?}");
        let equal = Blocked::new((0..21).map(|i| (i / 3, 0.1))).unwrap();
        let found = equal.bootstrap_interval(50, Seed::new(3)).unwrap();
        assert_eq!((found.mean, found.interval), (0.1, Interval { low: 0.1, high: 0.1 }));
    }

    /// Pinned values, so that no dependency can silently change results.
    #[test]
    fn draws_are_stable() {
        let blocked = Blocked::new((0..9).map(|i| (i, (i * i) as f64))).unwrap();
        let seed = Seed::new(3).derive("bootstrap");
        let found = blocked.bootstrap_interval(101, seed).unwrap().interval;
        assert_ne!(found, blocked.bootstrap_interval(101, Seed::new(4)).unwrap().interval);
        // Equals the result for single runs in the same order.
        assert!((found.low - 14.277777777777779).abs() < 1e-13, "{found:?}");
        assert!((found.high - 35.0).abs() < 1e-13, "{found:?}");
    }
}
