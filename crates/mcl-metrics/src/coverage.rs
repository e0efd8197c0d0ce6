use mcl_core::{Pose2, Stamp, Trajectory};

use crate::association::check_not_empty;
use crate::error::MetricsError;
use crate::timeline::{Timeline, gap};

/// A robot that moves less than this in metres and turns less than this in radians stands still.
const STANDSTILL_M: f64 = 0.05;
const STANDSTILL_RAD: f64 = 0.05;

/// Fraction of a reference that an estimate covers, independent of the rates of both.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// Covered fraction of the duration of the reference, within [0, 1].
    pub time: f64,
    /// Covered fraction of the path length of the reference, within [0, 1]; for a reference that does not move, that
    /// of its duration.
    pub path: f64,
    /// First and last covered time of the reference; `None` if nothing is covered.
    pub covered: Option<(Stamp, Stamp)>,
    /// The intervals that are not covered, sorted by time.
    pub gaps: Vec<(Stamp, Stamp)>,
}

/// Computes how much of the duration and path of the reference the estimate covers. Covered are times between two
/// successive estimated poses at most `longest_gap_s` apart (by default five times the usual (median) interval of the
/// estimate, at least 0.2 s), and up to one usual interval before its first pose and after its last, so that an
/// estimate with a lower rate still covers the reference.
///
/// A gap in which the reference stands still (within 0.05 m and 0.05 rad) counts as covered, because some localizers
/// publish only when the robot moves. Neither trajectory needs to be sorted.
///
/// # Errors
/// If the longest gap is negative or not finite, or a trajectory is empty.
pub fn coverage(
    reference: &Trajectory,
    estimate: &Trajectory,
    longest_gap_s: Option<f64>,
) -> Result<Coverage, MetricsError> {
    check_not_empty(reference, estimate)?;
    let (path, estimate) = (ReferencePath::new(reference), Timeline::new(estimate));
    let longest = estimate.longest_gap(longest_gap_s)?;
    let [first, last] = path.timeline.span();
    let uncovered = gaps(&estimate, longest, [first, last]);
    let is_apart = uncovered == [(first, last)];
    let gaps: Vec<(Stamp, Stamp)> = uncovered
        .into_iter()
        .filter(|&(from, to)| is_apart || !path.stands_still(from, to))
        .collect();
    let uncovered_ns: f64 = gaps.iter().map(|&(from, to)| gap(from, to) as f64).sum();
    let duration = gap(first, last) as f64;
    let time = match duration > 0.0 {
        true => (1.0 - uncovered_ns / duration).clamp(0.0, 1.0),
        // A single time, with one or more poses.
        false => f64::from(gaps.is_empty()),
    };
    let length = path.length_until(last);
    let uncovered_m: f64 =
        gaps.iter().map(|&(from, to)| path.length_until(to) - path.length_until(from)).sum();
    let path = if length > 0.0 { (1.0 - uncovered_m / length).clamp(0.0, 1.0) } else { time };
    Ok(Coverage { time, path, covered: covered(&gaps, [first, last]), gaps })
}

/// The parts of a time span that are in no interval of the estimate, sorted by time.
fn gaps(estimate: &Timeline<'_>, longest: u64, [first, last]: [Stamp; 2]) -> Vec<(Stamp, Stamp)> {
    let usual = i64::try_from(estimate.usual_interval().unwrap_or(0)).unwrap_or(i64::MAX);
    let [begins, ends] = estimate.span().map(Stamp::nanoseconds);
    let begins = Stamp::from_nanoseconds(begins.saturating_sub(usual));
    let ends = Stamp::from_nanoseconds(ends.saturating_add(usual));
    if begins > last || ends < first {
        return vec![(first, last)];
    }
    let between = (1..estimate.len())
        .map(|position| (estimate.stamp(position - 1), estimate.stamp(position)))
        .filter(|&(from, to)| gap(from, to) > longest);
    [(first, begins)]
        .into_iter()
        .chain(between)
        .chain([(ends, last)])
        .filter(|&(from, to)| from < last && to > first)
        .map(|(from, to)| (from.max(first), to.min(last)))
        .collect()
}

/// First and last time of a span outside its gaps.
fn covered(gaps: &[(Stamp, Stamp)], [first, last]: [Stamp; 2]) -> Option<(Stamp, Stamp)> {
    if gaps == [(first, last)] {
        return None;
    }
    let from = gaps.first().filter(|gap| gap.0 == first).map_or(first, |gap| gap.1);
    let to = gaps.last().filter(|gap| gap.1 == last).map_or(last, |gap| gap.0);
    Some((from, to))
}

/// A reference with the path length up to each pose.
struct ReferencePath<'a> {
    timeline: Timeline<'a>,
    /// Length of the path up to each pose, sorted by time, in metres.
    lengths: Vec<f64>,
}

impl<'a> ReferencePath<'a> {
    fn new(trajectory: &'a Trajectory) -> Self {
        let timeline = Timeline::new(trajectory);
        let mut lengths = vec![0.0];
        for position in 1..timeline.len() {
            let step = timeline.pose(position - 1).distance(&timeline.pose(position));
            lengths.push(lengths[position - 1] + step);
        }
        ReferencePath { timeline, lengths }
    }

    /// Length of the path up to a stamp.
    fn length_until(&self, stamp: Stamp) -> f64 {
        let after = self.timeline.first_after(stamp);
        let Some(before) = after.checked_sub(1) else { return 0.0 };
        if after == self.timeline.len() {
            return self.lengths[before];
        }
        let whole = gap(self.timeline.stamp(before), self.timeline.stamp(after)) as f64;
        let part = gap(self.timeline.stamp(before), stamp) as f64 / whole;
        self.lengths[before] + part * (self.lengths[after] - self.lengths[before])
    }

    /// Whether the robot stands still from `from` to `to`; both are within the trajectory.
    fn stands_still(&self, from: Stamp, to: Stamp) -> bool {
        let at = |stamp| self.timeline.at(stamp, 0, u64::MAX).map(|place| place.pose);
        let Some(start) = at(from) else { return false };
        let stays = |pose: Pose2| {
            let moved = start.between(&pose);
            start.distance(&pose) < STANDSTILL_M && moved.theta.abs() < STANDSTILL_RAD
        };
        let within = self.timeline.first_from(from)..self.timeline.first_after(to);
        within.map(|position| self.timeline.pose(position)).chain(at(to)).all(stays)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stamp(milliseconds: i64) -> Stamp {
        Stamp::from_nanoseconds(milliseconds * 1_000_000)
    }

    /// At 0.5 m/s along x from `from` to `to` (ms), a pose every `step`.
    fn drive(from: i64, to: i64, step: i64) -> Trajectory {
        let pose = |ms: i64| (stamp(ms), Pose2::new(ms as f64 * 5e-4, 0.0, 0.0));
        (0..=(to - from) / step).map(|k| pose(from + k * step)).collect()
    }

    fn of(reference: &Trajectory, estimate: &Trajectory) -> Coverage {
        coverage(reference, estimate, None).unwrap()
    }

    /// Once, unmatched poses were counted instead, of which every estimate with a lower rate has many.
    #[test]
    fn an_estimate_that_stops_after_a_third_of_the_time_covers_a_third() {
        let reference = drive(0, 60_000, 10);
        let found = of(&reference, &drive(0, 20_000, 100));
        // Plus one interval of the estimate.
        assert!((found.time - 20.1 / 60.0).abs() < 1e-12, "{found:?}");
        assert!((found.path - 20.1 / 60.0).abs() < 1e-12, "{found:?}");
        assert_eq!(found.covered, Some((stamp(0), stamp(20_100))));
        assert_eq!(found.gaps, [(stamp(20_100), stamp(60_000))]);
    }

    #[test]
    fn other_rates_and_phases_cover_all() {
        for (reference, estimate) in [(10, 100), (100, 20), (33, 1000), (100, 100)] {
            for phase in [0, estimate / 2, estimate - 1] {
                let reference = drive(0, 60_000, reference);
                let found = of(&reference, &drive(phase, 60_000 - phase, estimate));
                assert_eq!((found.time, found.path), (1.0, 1.0), "{estimate} {phase}");
                assert_eq!(found.covered, Some((stamp(0), *reference.stamps().last().unwrap())));
                assert!(found.gaps.is_empty());
            }
        }
    }

    #[test]
    fn gaps_are_longer_than_usual_or_than_requested() {
        let reference = drive(0, 10_000, 10);
        let estimate: Trajectory =
            drive(0, 4000, 100).iter().chain(drive(6000, 10_000, 100).iter()).collect();
        let found = of(&reference, &estimate);
        assert_eq!(found.gaps, [(stamp(4000), stamp(6000))]);
        assert!((found.time - 0.8).abs() < 1e-12 && (found.path - 0.8).abs() < 1e-12, "{found:?}");
        assert_eq!(found.covered, Some((stamp(0), stamp(10_000))));
        let found = coverage(&reference, &estimate, Some(2.0)).unwrap();
        assert_eq!((found.time, found.path, found.gaps), (1.0, 1.0, vec![]));
        let found = coverage(&reference, &drive(0, 10_000, 400), Some(0.1)).unwrap();
        assert_eq!((found.time, found.path, found.gaps.len()), (0.0, 0.0, 25));
        for gap in [-1.0, f64::NAN] {
            assert!(coverage(&reference, &estimate, Some(gap)).is_err());
        }
    }

    #[test]
    fn a_localizer_that_publishes_only_when_the_robot_moves_covers_all() {
        // Drives 5 s, stands 10 s (with 1 mm of noise), drives 5 s, stands 5 s.
        let pose = |ms: i64| {
            let driven = ms.min(5000) + (ms - 15_000).clamp(0, 5000);
            Pose2::new(driven as f64 * 5e-4, 1e-3 * (ms % 3) as f64, 0.0)
        };
        let reference: Trajectory = (0..2500).map(|k| (stamp(k * 10), pose(k * 10))).collect();
        let moving = (0..=50).chain(150..=200).map(|k| (stamp(k * 100), pose(k * 100)));
        let found = of(&reference, &moving.collect());
        assert_eq!((found.time, found.path, found.gaps), (1.0, 1.0, vec![]));
        // A robot that turns on the spot does not stand still.
        let turning = |ms: i64| {
            let pose = pose(ms);
            Pose2::new(pose.x, pose.y, if ms > 7000 && ms < 9000 { 0.3 } else { 0.0 })
        };
        let reference: Trajectory = (0..2500).map(|k| (stamp(k * 10), turning(k * 10))).collect();
        let moving = (0..=50).chain(150..=200).map(|k| (stamp(k * 100), turning(k * 100)));
        assert_eq!(of(&reference, &moving.collect()).gaps, [(stamp(5000), stamp(15_000))]);
    }

    #[test]
    fn nothing_in_common_is_zero_coverage_even_of_a_robot_at_rest() {
        let still: Trajectory = (0..10).map(|k| (stamp(k * 100), Pose2::IDENTITY)).collect();
        let found = of(&still, &drive(100_000, 110_000, 100));
        assert_eq!((found.time, found.path, found.covered), (0.0, 0.0, None));
        assert_eq!(found.gaps, [(stamp(0), stamp(900))]);
        // All of it, if a pose lies within.
        let found = of(&still, &drive(500, 500, 100));
        assert_eq!((found.time, found.path), (1.0, 1.0));
    }

    #[test]
    fn a_reference_of_a_single_moment_is_covered_or_not() {
        let one = drive(1000, 1000, 1);
        let found = of(&one, &drive(0, 2000, 100));
        assert_eq!(
            (found.time, found.path, found.covered),
            (1.0, 1.0, Some((stamp(1000), stamp(1000))))
        );
        let found = of(&one, &drive(2000, 3000, 100));
        assert_eq!((found.time, found.path, found.covered), (0.0, 0.0, None));
        let found = of(&one, &one);
        assert_eq!((found.time, found.path), (1.0, 1.0));
        // In a gap of the estimate.
        let around: Trajectory =
            drive(0, 500, 100).iter().chain(drive(9000, 9500, 100).iter()).collect();
        assert_eq!(of(&one, &around).time, 0.0);
        assert!(coverage(&one, &Trajectory::default(), None).is_err());
    }

    proptest! {
        #[test]
        fn shares_and_gaps_agree(
            reference in prop::collection::vec((0..500i64, -3..3i8), 1..40),
            estimate in prop::collection::vec(-50..600i64, 1..40),
            longest in 0.0..0.2f64,
        ) {
            let reference: Trajectory = reference
                .iter()
                .map(|&(ms, x)| (stamp(ms), Pose2::new(f64::from(x), 0.0, 0.0)))
                .collect();
            let estimate: Trajectory =
                estimate.iter().map(|&ms| (stamp(ms), Pose2::IDENTITY)).collect();
            let found = coverage(&reference, &estimate, Some(longest)).unwrap();
            prop_assert!((0.0..=1.0).contains(&found.time) && (0.0..=1.0).contains(&found.path));
            prop_assert!(found.gaps.windows(2).all(|pair| pair[0].1 <= pair[1].0));
            prop_assert_eq!(found.gaps.is_empty(), found.time == 1.0);
            prop_assert_eq!(found.covered.is_none(), found.time == 0.0 && found.gaps.len() == 1);
        }
    }
}
