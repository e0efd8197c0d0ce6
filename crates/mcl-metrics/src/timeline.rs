use mcl_core::{Pose2, Stamp, Trajectory};

use crate::error::MetricsError;

/// Default for the longest gap for interpolation, in usual intervals, and its minimum (ns).
const USUAL_INTERVALS: u64 = 5;
const SHORT: u64 = 200_000_000;

/// A trajectory with at least one pose, sorted by time; poses with equal stamps keep the order of the trajectory.
pub(crate) struct Timeline<'a> {
    trajectory: &'a Trajectory,
    /// Indices into the trajectory.
    order: Vec<usize>,
}

/// The pose at a time on a [`Timeline`], and the poses it was interpolated from.
pub(crate) struct TimedPose {
    /// Index in the trajectory of the pose with this stamp, or of the last one before.
    pub before: usize,
    /// Index in the trajectory of the same pose, or of the first one after.
    pub after: usize,
    pub pose: Pose2,
}

impl<'a> Timeline<'a> {
    pub fn new(trajectory: &'a Trajectory) -> Self {
        let mut order: Vec<usize> = (0..trajectory.len()).collect();
        order.sort_by_key(|&index| trajectory.stamps()[index]);
        Timeline { trajectory, order }
    }

    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Index in the trajectory of the pose at a position in the sorted order.
    pub fn index(&self, position: usize) -> usize {
        self.order[position]
    }

    pub fn stamp(&self, position: usize) -> Stamp {
        self.trajectory.stamps()[self.order[position]]
    }

    pub fn pose(&self, position: usize) -> Pose2 {
        self.trajectory.poses()[self.order[position]]
    }

    /// Earliest and latest stamp.
    pub fn span(&self) -> [Stamp; 2] {
        [self.stamp(0), self.stamp(self.len() - 1)]
    }

    /// Position of the first pose that is not before `stamp`.
    pub fn first_from(&self, stamp: Stamp) -> usize {
        self.order.partition_point(|&index| self.trajectory.stamps()[index] < stamp)
    }

    /// Position of the first pose after `stamp`.
    pub fn first_after(&self, stamp: Stamp) -> usize {
        self.order.partition_point(|&index| self.trajectory.stamps()[index] <= stamp)
    }

    /// The median interval between successive different stamps, in nanoseconds.
    pub fn usual_interval(&self) -> Option<u64> {
        let interval = |position| gap(self.stamp(position - 1), self.stamp(position));
        let mut intervals: Vec<u64> =
            (1..self.len()).map(interval).filter(|&interval| interval > 0).collect();
        let middle = intervals.len() / 2;
        (!intervals.is_empty()).then(|| *intervals.select_nth_unstable(middle).1)
    }

    /// The longest gap between two poses for interpolation, in nanoseconds: as given
    /// (seconds), or five usual intervals, at least 0.2 s.
    pub fn longest_gap(&self, asked_s: Option<f64>) -> Result<u64, MetricsError> {
        let Some(found) = asked_s else {
            let usual = self.usual_interval().unwrap_or(0);
            return Ok(usual.saturating_mul(USUAL_INTERVALS).max(SHORT));
        };
        if !(found.is_finite() && found >= 0.0) {
            let expected = "a finite number of seconds, not negative";
            return Err(MetricsError::Setting { name: "longest gap", found, expected });
        }
        Ok((found * 1e9).round() as u64)
    }

    /// The pose at a stamp: the pose with this stamp (the `occurrence`-th of several, from 0, at
    /// most the last), otherwise interpolated between its neighbours, but not beyond the ends or over more than
    /// `longest` nanoseconds.
    pub fn at(&self, stamp: Stamp, occurrence: usize, longest: u64) -> Option<TimedPose> {
        let (start, end) = (self.first_from(stamp), self.first_after(stamp));
        if start < end {
            let position = start.saturating_add(occurrence).min(end - 1);
            let index = self.index(position);
            return Some(TimedPose { before: index, after: index, pose: self.pose(position) });
        }
        let before = start.checked_sub(1).filter(|_| start < self.len())?;
        let whole = gap(self.stamp(before), self.stamp(start));
        if whole > longest {
            return None;
        }
        let part = gap(self.stamp(before), stamp) as f64 / whole as f64;
        let pose = self.pose(before).interpolate(&self.pose(start), part);
        Some(TimedPose { before: self.index(before), after: self.index(start), pose })
    }
}

/// Nanoseconds between two stamps.
pub(crate) fn gap(a: Stamp, b: Stamp) -> u64 {
    a.nanoseconds().abs_diff(b.nanoseconds())
}
