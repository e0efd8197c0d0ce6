//! Means of groups of rows, with their uncertainty.

use anyhow::{Context, Result};
use mcl_core::math;
use mcl_metrics::{Blocked, BlockedRate, Interval, IntervalBasis, standard_deviation};

use crate::store::results::Results;
use crate::study::settings::SIZE;
use crate::study::views::{Factor, LOST, made_of};
use crate::view::groups::{Group, Groups};
use crate::view::lost;

/// A mean over blocks. Every block has the same weight, as in tests.
///
/// One rule serves all measured numbers: Student's interval over the means of blocks, which is also the basis
/// of the tests. Its coverage is correct with few blocks (a bootstrap over ten is too narrow by a fifth, over
/// five by a third) and it depends on no seed. Where a few lost runs dominate the mean it may extend below
/// zero, and does so visibly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The mean; for a column of yes or no the share of yes among rows.
    pub mean: f64,
    /// 95 % interval; `None` where there are too few blocks, or for a [`Factor`].
    pub interval: Option<Interval>,
    /// The unit that the interval of a share treats as a trial; `None` for Student's interval.
    pub basis: Option<IntervalBasis>,
    /// Standard deviation of the means of blocks, where there are two.
    pub spread: Option<f64>,
    /// Independent units.
    pub blocks: usize,
    /// Rows.
    pub rows: usize,
}

impl Estimate {
    /// From values by block.
    pub fn of(values: &Blocked) -> Self {
        let means: Vec<f64> = values.block_means().iter().map(|&(_, mean)| mean).collect();
        Estimate {
            mean: values.mean_of_blocks(),
            interval: values.mean_interval().ok().map(|found| found.interval),
            basis: None,
            spread: standard_deviation(&means).ok(),
            blocks: values.blocks(),
            rows: values.count(),
        }
    }

    /// From a share of yes.
    ///
    /// # Errors
    /// When there is no interval.
    pub fn of_rate(rate: &BlockedRate) -> Result<Self> {
        let units = rate.of_units();
        Ok(Estimate {
            mean: units.hits() as f64 / units.trials() as f64,
            interval: Some(rate.interval(0.95)?),
            basis: Some(rate.basis()),
            spread: None,
            blocks: rate.of_blocks().trials() as usize,
            rows: units.trials() as usize,
        })
    }
}

/// Groups of rows with the columns derived from several groups.
pub struct Estimates<'r> {
    /// The groups.
    pub groups: Groups<'r>,
    /// Names of the factors, and the value of each by group.
    factors: Vec<(String, Vec<Option<f64>>)>,
}

impl<'r> Estimates<'r> {
    /// From the rows of a study on a data set.
    ///
    /// # Errors
    /// When a value cannot be computed with.
    pub fn of(results: &'r Results) -> Result<Self> {
        let groups = Groups::of(results)?;
        let factors = results.study.views.factors.iter();
        let factors =
            factors.map(|factor| Ok((factor.name.clone(), size_factors(&groups, factor)?)));
        let factors = factors.collect::<Result<_>>()?;
        Ok(Estimates { groups, factors })
    }

    /// Names of the factors.
    pub fn factors(&self) -> impl Iterator<Item = &str> {
        self.factors.iter().map(|(name, _)| name.as_str())
    }

    /// The mean of a measured column or factor of a group, or the share of yes; `None` where it is not
    /// known.
    ///
    /// # Errors
    /// When a value cannot be computed with.
    pub fn mean(&self, group: &Group<'_>, column: &str) -> Result<Option<Estimate>> {
        if let Some((_, values)) = self.factors.iter().find(|(name, _)| name == column) {
            return Ok(values[group.place].map(|mean| Estimate {
                mean,
                interval: None,
                basis: None,
                spread: None,
                blocks: group.blocks(),
                rows: group.rows.len(),
            }));
        }
        if column == LOST {
            return lost::rate(group)?.map(|rate| Estimate::of_rate(&rate)).transpose();
        }
        let values = match made_of(column) {
            Some(_) => lost::tracked(group, column)?,
            None => group.blocked(column)?,
        };
        let Some(values) = values else { return Ok(None) };
        let mut found = Estimate::of(&values);
        if let Some(rate) = group.rate(column)? {
            found = Estimate { spread: found.spread, ..Estimate::of_rate(&rate)? };
        }
        Ok(Some(found))
    }
}

/// The factor of every group.
fn size_factors(groups: &Groups<'_>, factor: &Factor) -> Result<Vec<Option<f64>>> {
    let map = groups.place("map").context("rows have no column map")?;
    let at = |group: &Group<'_>| -> Result<Option<[f64; 2]>> {
        let [x, y] = [&factor.x, &factor.y].map(|column| group.blocked(column));
        Ok(x?.zip(y?).map(|(x, y)| [x.mean_of_blocks(), y.mean_of_blocks()]))
    };
    let points = groups.all.iter().map(at).collect::<Result<Vec<_>>>()?;
    let sizes = SIZE.iter().filter_map(|size| groups.place(size));
    let free: Vec<usize> = sizes.chain([map]).collect();
    let value = |(group, point): (&Group<'_>, &Option<[f64; 2]>)| {
        let [x, y] = (*point)?;
        let yardstick = groups.all.iter().zip(&points).filter(|(other, _)| {
            other.text(map) == factor.than && groups.differ_only_in(group, other, &free)
        });
        let mut curve: Vec<[f64; 2]> = yardstick.filter_map(|(_, point)| *point).collect();
        curve.sort_by(|a, b| a[0].total_cmp(&b[0]));
        reached(&curve, y).map(|reached| reached / x)
    };
    Ok(groups.all.iter().zip(&points).map(value).collect())
}

/// The x at which a curve first reaches a height, interpolated in the logarithm of x.
fn reached(curve: &[[f64; 2]], height: f64) -> Option<f64> {
    let pair = curve.windows(2).find(|pair| (pair[0][1]..=pair[1][1]).contains(&height))?;
    let ([x0, below], [x1, above]) = (pair[0], pair[1]);
    let part = if above > below { (height - below) / (above - below) } else { 0.0 };
    let x = math::exp(math::ln(x0) + part * (math::ln(x1) - math::ln(x0)));
    x.is_finite().then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_interpolated_in_the_logarithm() {
        let curve = [[10.0, -3.0], [1000.0, -1.0], [2000.0, -1.0]];
        assert!((reached(&curve, -2.0).unwrap() - 100.0).abs() < 1e-9);
        assert_eq!(reached(&curve, -3.0).map(f64::round), Some(10.0));
        assert_eq!(reached(&curve, -0.5), None);
        assert_eq!(reached(&curve, -3.1), None);
    }
}
