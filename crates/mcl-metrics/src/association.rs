use std::cmp::Reverse;
use std::collections::BinaryHeap;

use mcl_core::{Stamp, Trajectory};
use serde::Serialize;

use crate::error::MetricsError;
use crate::timeline::{Timeline, gap};

/// Default for the largest difference of two matching stamps, in seconds (as in evo).
pub const DEFAULT_TOLERANCE_S: f64 = 0.01;

/// Differences are compared in this unit (nanoseconds): stamps that were seconds since 1970 in 64-bit numbers are off by
/// up to 0.12 µs, which must not choose between two poses that are equally near.
const NOISE: u64 = 1000;

/// One of the two compared trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The reference.
    Reference,
    /// The estimate.
    Estimate,
}

/// Matched poses of a reference and an estimate, at the same times.
///
/// Pairs are in the order of the estimate if that is also the order of the reference (logs that step
/// back in time do so in both). Otherwise at least one of the two is unsorted by itself, and pairs are sorted by time.
#[derive(Debug, Clone, PartialEq)]
pub struct Matched {
    /// Matched part of the reference; entry *k* belongs to entry *k* of `estimate`.
    pub reference: Trajectory,
    /// Matched part of the estimate.
    pub estimate: Trajectory,
    /// Index of each entry in the whole reference; `None` if the reference was interpolated.
    pub reference_indices: Option<Vec<usize>>,
    /// Index of each entry in the whole estimate; `None` if the estimate was interpolated.
    pub estimate_indices: Option<Vec<usize>>,
    /// The sparser trajectory: the one with fewer poses in the common time span, or the estimate if both have
    /// equally many. With interpolation, its poses are the compared ones.
    pub sampled: Side,
    /// Time differences within the pairs; `None` with interpolation, where there are none.
    pub time_difference: Option<TimeDifference>,
    /// Number of poses of the reference that are in no pair.
    pub unmatched_reference: usize,
    /// Number of poses of the estimate that are in no pair.
    pub unmatched_estimate: usize,
    /// Whether the pairs are sorted by time instead of being in the order of the estimate.
    pub sorted_by_time: bool,
}

/// Differences between the stamps of pairs, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimeDifference {
    /// Mean of the magnitudes.
    pub mean_s: f64,
    /// Largest magnitude.
    pub max_s: f64,
}

/// Matches poses by stamp, one to one and greedily: of all pairs at most `tolerance_s` apart, the pair nearest
/// in time is matched first, then the nearest of the remaining ones, and so on. Equally near pairs (to the microsecond) are
/// matched in order of time, equal stamps in recorded order. Neither trajectory needs to be sorted.
///
/// The number of pairs is not maximized: a pose whose only neighbour has a nearer partner stays unmatched.
///
/// # Errors
/// If the tolerance is negative or not finite, a trajectory is empty, or nothing matches.
pub fn associate(
    reference: &Trajectory,
    estimate: &Trajectory,
    tolerance_s: f64,
) -> Result<Matched, MetricsError> {
    if !(tolerance_s.is_finite() && tolerance_s >= 0.0) {
        let expected = "a finite number of seconds, not negative";
        return Err(MetricsError::Setting { name: "tolerance", found: tolerance_s, expected });
    }
    let sides = Sides::new(reference, estimate)?;
    let timeline = merge(reference.stamps(), estimate.stamps());
    let tolerance = (tolerance_s * 1e9).round() as u64;
    let pairs = nearest_pairs(&timeline, tolerance);
    if pairs.is_empty() {
        let nearest = timeline.windows(2).filter_map(|pair| distance(&pair[0], &pair[1])).min();
        return Err(MetricsError::NothingMatches {
            tolerance_s,
            reference: sides.reference.span(),
            estimate: sides.estimate.span(),
            nearest_s: nearest.unwrap_or(u64::MAX) as f64 / 1e9,
        });
    }
    let stamp = |&(_, e): &(usize, usize)| estimate.stamps()[e];
    let (pairs, sorted_by_time) = in_order(pairs, |&pair| pair, stamp);
    let apart = |&(r, e): &(usize, usize)| gap(reference.stamps()[r], estimate.stamps()[e]);
    let sum: f64 = pairs.iter().map(|pair| apart(pair) as f64).sum();
    let largest = pairs.iter().map(apart).max().unwrap_or(0);
    let time_difference =
        TimeDifference { mean_s: sum / pairs.len() as f64 / 1e9, max_s: largest as f64 / 1e9 };
    let (reference_indices, estimate_indices): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    Ok(Matched {
        unmatched_reference: reference.len() - reference_indices.len(),
        unmatched_estimate: estimate.len() - estimate_indices.len(),
        reference: select(reference, &reference_indices),
        estimate: select(estimate, &estimate_indices),
        reference_indices: Some(reference_indices),
        estimate_indices: Some(estimate_indices),
        sampled: sides.sparser(),
        time_difference: Some(time_difference),
        sorted_by_time,
    })
}

/// Matches the poses of the sparser trajectory with the other one, interpolated to their stamps: linearly
/// between the positions before and after, and along the shorter arc between the headings. There is no
/// extrapolation, and no interpolation over gaps longer than `longest_gap_s`; the default is five times
/// the usual (median) interval of the interpolated trajectory, at least 0.2 s. Stamps that occur in both
/// trajectories are not interpolated: equal stamps are matched in recorded order, and those in excess with the last
/// of them.
///
/// A pose of the interpolated trajectory is in a pair if a sample lies at it, or between it and the
/// next one.
///
/// # Errors
/// If the longest gap is negative or not finite, a trajectory is empty, or no pose of the sparser one
/// lies within the other one.
pub fn interpolate(
    reference: &Trajectory,
    estimate: &Trajectory,
    longest_gap_s: Option<f64>,
) -> Result<Matched, MetricsError> {
    let sides = Sides::new(reference, estimate)?;
    let sampled = sides.sparser();
    let (samples, other) = match sampled {
        Side::Reference => (&sides.reference, &sides.estimate),
        Side::Estimate => (&sides.estimate, &sides.reference),
    };
    let longest = other.longest_gap(longest_gap_s)?;
    let mut takes_part = vec![false; other.len()];
    let mut found = Vec::new();
    let mut occurrence = 0;
    for position in 0..samples.len() {
        let stamp = samples.stamp(position);
        let repeats = position > 0 && samples.stamp(position - 1) == stamp;
        occurrence = if repeats { occurrence + 1 } else { 0 };
        let Some(place) = other.at(stamp, occurrence, longest) else { continue };
        takes_part[place.before] = true;
        takes_part[place.after] = true;
        found.push((samples.index(position), place.before, stamp, place.pose));
    }
    if found.is_empty() {
        return Err(MetricsError::NothingInterpolated {
            longest_gap_s: longest as f64 / 1e9,
            reference: sides.reference.span(),
            estimate: sides.estimate.span(),
        });
    }
    let positions = |&(sample, before, ..): &(usize, usize, _, _)| match sampled {
        Side::Reference => (sample, before),
        Side::Estimate => (before, sample),
    };
    let (found, sorted_by_time) = in_order(found, positions, |&(_, _, stamp, _)| stamp);
    let indices: Vec<usize> = found.iter().map(|&(sample, ..)| sample).collect();
    let interpolated: Trajectory = found.iter().map(|&(_, _, stamp, pose)| (stamp, pose)).collect();
    let unmatched_samples = samples.len() - indices.len();
    let unmatched_others = takes_part.iter().filter(|&&takes_part| !takes_part).count();
    let matched = Matched {
        reference: Trajectory::default(),
        estimate: Trajectory::default(),
        reference_indices: None,
        estimate_indices: None,
        sampled,
        time_difference: None,
        unmatched_reference: unmatched_others,
        unmatched_estimate: unmatched_others,
        sorted_by_time,
    };
    Ok(match sampled {
        Side::Reference => Matched {
            reference: select(reference, &indices),
            estimate: interpolated,
            reference_indices: Some(indices),
            unmatched_reference: unmatched_samples,
            ..matched
        },
        Side::Estimate => Matched {
            reference: interpolated,
            estimate: select(estimate, &indices),
            estimate_indices: Some(indices),
            unmatched_estimate: unmatched_samples,
            ..matched
        },
    })
}

/// Two trajectories, sorted by time.
struct Sides<'a> {
    reference: Timeline<'a>,
    estimate: Timeline<'a>,
}

impl<'a> Sides<'a> {
    fn new(reference: &'a Trajectory, estimate: &'a Trajectory) -> Result<Self, MetricsError> {
        check_not_empty(reference, estimate)?;
        Ok(Sides { reference: Timeline::new(reference), estimate: Timeline::new(estimate) })
    }

    /// The result of [`sparser`].
    fn sparser(&self) -> Side {
        sparser(&self.reference, &self.estimate)
    }
}

/// The trajectory of the lower rate, by the usual intervals of both: the reference only if its rate is clearly lower, so
/// that the result does not depend on jitter or the end of a trajectory. A trajectory of a single pose is the sparser.
pub(crate) fn sparser(reference: &Timeline<'_>, estimate: &Timeline<'_>) -> Side {
    const CLEARLY: f64 = 1.5;
    let usual = |timeline: &Timeline<'_>| timeline.usual_interval().unwrap_or(u64::MAX) as f64;
    match usual(reference) > CLEARLY * usual(estimate) {
        true => Side::Reference,
        false => Side::Estimate,
    }
}

/// Checks that both trajectories have poses.
pub(crate) fn check_not_empty(
    reference: &Trajectory,
    estimate: &Trajectory,
) -> Result<(), MetricsError> {
    for (what, trajectory) in [("reference poses", reference), ("estimated poses", estimate)] {
        if trajectory.is_empty() {
            return Err(MetricsError::TooFew { what, found: 0, needed: 1 });
        }
    }
    Ok(())
}

fn select(trajectory: &Trajectory, indices: &[usize]) -> Trajectory {
    indices.iter().map(|&i| (trajectory.stamps()[i], trajectory.poses()[i])).collect()
}

/// Returns the pairs in the order of the estimate if the reference is then also in order, otherwise sorted by time; and
/// whether that is a different order. `positions` are those in reference and estimate.
fn in_order<T>(
    mut pairs: Vec<T>,
    positions: impl Fn(&T) -> (usize, usize),
    stamp: impl Fn(&T) -> Stamp,
) -> (Vec<T>, bool) {
    // Several poses may be interpolated from one position; these are in order of time.
    pairs.sort_by_key(|pair| {
        let (reference, estimate) = positions(pair);
        (estimate, stamp(pair), reference)
    });
    let is_in_order = pairs.is_sorted_by_key(|pair| positions(pair).0);
    let is_to_be_sorted = !is_in_order && !pairs.is_sorted_by_key(&stamp);
    if is_to_be_sorted {
        pairs.sort_by_key(&stamp);
    }
    (pairs, is_to_be_sorted)
}

/// A stamp on the common time line. The order of the fields is the sort order: by time, with equal stamps of both
/// sides alternating, so that the k-th of one is next to the k-th of the other.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    stamp: Stamp,
    repeat: usize,
    is_estimate: bool,
    index: usize,
}

fn merge(reference: &[Stamp], estimate: &[Stamp]) -> Vec<Entry> {
    let mut timeline = Vec::with_capacity(reference.len() + estimate.len());
    for (stamps, is_estimate) in [(reference, false), (estimate, true)] {
        let mut order: Vec<usize> = (0..stamps.len()).collect();
        order.sort_by_key(|&index| stamps[index]);
        let mut repeat = 0;
        for (position, &index) in order.iter().enumerate() {
            let repeats = position > 0 && stamps[order[position - 1]] == stamps[index];
            repeat = if repeats { repeat + 1 } else { 0 };
            timeline.push(Entry { stamp: stamps[index], repeat, is_estimate, index });
        }
    }
    timeline.sort_unstable();
    timeline
}

/// Nanoseconds between a stamp of one side and a later one of the other.
fn distance(earlier: &Entry, later: &Entry) -> Option<u64> {
    (earlier.is_estimate != later.is_estimate).then(|| gap(earlier.stamp, later.stamp))
}

/// Computes the pairs (reference index, estimate index) of the greedy matching. The nearest two unmatched entries of
/// different sides are always neighbours on the remaining time line, so a heap of neighbours
/// and a linked list suffice: O(n log n) for any tolerance.
fn nearest_pairs(timeline: &[Entry], tolerance: u64) -> Vec<(usize, usize)> {
    let count = timeline.len();
    let mut next: Vec<Option<usize>> =
        (0..count).map(|i| (i + 1 < count).then_some(i + 1)).collect();
    let mut previous: Vec<Option<usize>> = (0..count).map(|i| i.checked_sub(1)).collect();
    let mut is_matched = vec![false; count];
    let mut heap = BinaryHeap::new();
    let candidate = |left: usize, right: usize| {
        distance(&timeline[left], &timeline[right])
            .filter(|&nanoseconds| nanoseconds <= tolerance)
            .map(|nanoseconds| {
                Reverse((nanoseconds.saturating_add(NOISE / 2) / NOISE, left, right))
            })
    };
    heap.extend((1..count).filter_map(|right| candidate(right - 1, right)));
    let mut pairs = Vec::new();
    while let Some(Reverse((_, left, right))) = heap.pop() {
        if is_matched[left] || is_matched[right] {
            continue;
        }
        is_matched[left] = true;
        is_matched[right] = true;
        let (l, r) = (timeline[left].index, timeline[right].index);
        pairs.push(if timeline[left].is_estimate { (r, l) } else { (l, r) });
        let (before, after) = (previous[left], next[right]);
        if let Some(before) = before {
            next[before] = after;
        }
        if let Some(after) = after {
            previous[after] = before;
        }
        if let (Some(before), Some(after)) = (before, after) {
            heap.extend(candidate(before, after));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Pose2;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// Converts milliseconds to a trajectory whose x is the index.
    fn track(milliseconds: &[i64]) -> Trajectory {
        let stamp = |ms: i64| Stamp::from_nanoseconds(ms * 1_000_000);
        let poses = (0..milliseconds.len()).map(|i| Pose2::new(i as f64, 0.0, 0.0));
        milliseconds.iter().map(|&ms| stamp(ms)).zip(poses).collect()
    }

    /// Indices of nearest poses.
    fn both(matched: &Matched) -> (Vec<usize>, Vec<usize>) {
        (matched.reference_indices.clone().unwrap(), matched.estimate_indices.clone().unwrap())
    }

    fn indices(reference: &[i64], estimate: &[i64]) -> Vec<(usize, usize)> {
        let m = associate(&track(reference), &track(estimate), DEFAULT_TOLERANCE_S).unwrap();
        let xs = |t: &Trajectory| t.poses().iter().map(|p| p.x as usize).collect::<Vec<_>>();
        let (of_reference, of_estimate) = both(&m);
        assert_eq!(xs(&m.reference), of_reference);
        assert_eq!(xs(&m.estimate), of_estimate);
        of_reference.into_iter().zip(of_estimate).collect()
    }

    #[test]
    fn nearest_first_and_each_pose_once() {
        // 104 is nearer to 105 than 100 is; 100 is then matched with 95 (5 ms), not with the used 104.
        assert_eq!(indices(&[95, 105], &[100, 104]), [(0, 0), (1, 1)]);
        // Both are near 105; the nearer one is matched, and nothing else is within 10 ms.
        assert_eq!(indices(&[105], &[100, 104]), [(0, 1)]);
        // The tolerance is inclusive; of equally near pairs the earlier one is matched.
        assert_eq!(indices(&[110, 130], &[120]), [(0, 0)]);
        assert_eq!(indices(&[109, 131], &[100, 120]), [(0, 0)]);
    }

    /// Half a period apart, poses were left alone wherever noise far below a microsecond changed its sign.
    #[test]
    fn noise_of_stamps_does_not_decide() {
        let track = |shift: fn(i64) -> i64| -> Trajectory {
            let stamp = |k: i64| Stamp::from_nanoseconds(100_000_000 * k + shift(k));
            (0..100).map(|k| (stamp(k), Pose2::new(k as f64, 0.0, 0.0))).collect()
        };
        let reference = track(|_| 0);
        let estimate = track(|k| -50_000_000 + if k < 50 { -95 } else { 95 });
        let matched = associate(&reference, &estimate, 0.06).unwrap();
        assert_eq!(both(&matched).0, (0..100).collect::<Vec<usize>>());
    }

    #[test]
    fn steps_back_and_repeated_stamps_keep_their_order() {
        assert_eq!(
            indices(&[0, 100, 200, 150, 250], &[0, 100, 200, 150, 250]),
            [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)]
        );
        assert_eq!(indices(&[250, 0, 150], &[1, 251]), [(1, 0), (0, 1)]);
        assert_eq!(indices(&[50, 50, 50], &[50, 50]), [(0, 0), (1, 1)]);
    }

    #[test]
    fn unmatched_poses_are_counted_on_both_sides() {
        let matched = associate(&track(&[0, 100, 200]), &track(&[101, 500]), 0.01).unwrap();
        assert_eq!((matched.unmatched_reference, matched.unmatched_estimate), (2, 1));
    }

    #[test]
    fn no_match_says_where_both_lie() {
        let error = associate(&track(&[2000, 1000]), &track(&[2500, 9000]), 0.01).unwrap_err();
        assert_eq!(
            error.to_string(),
            "no stamps match within 0.01 s: the reference lasts from 1.000000000 to 2.000000000 s, \
             the estimate from 2.500000000 to 9.000000000 s, and the nearest two stamps are 0.5 s \
             apart. Check that both are of the same recording; if their rates or phases differ, \
             interpolate between poses (`--match interpolate`), and if their clocks differ, shift the \
             estimate's stamps (`--offset`)"
        );
        for tolerance in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                associate(&track(&[0]), &track(&[0]), tolerance),
                Err(MetricsError::Setting { name: "tolerance", .. })
            ));
        }
        let empty = associate(&track(&[]), &track(&[0]), 0.01).unwrap_err();
        assert_eq!(empty.to_string(), "reference poses: found 0, expected at least 1");
    }

    /// Pairs were once in the order of a shuffled file, which gave relative errors between poses that are not
    /// successive.
    #[test]
    fn an_unsorted_estimate_of_a_sorted_reference_is_taken_in_order_of_time() {
        let (reference, estimate) = (track(&[0, 100, 200, 300]), track(&[200, 0, 300, 100]));
        let nearest = associate(&reference, &estimate, 0.01).unwrap();
        assert!(nearest.sorted_by_time);
        assert_eq!(both(&nearest), (vec![0, 1, 2, 3], vec![1, 3, 0, 2]));
        let between = interpolate(&reference, &estimate, None).unwrap();
        assert!(between.sorted_by_time);
        assert_eq!(between.estimate_indices, Some(vec![1, 3, 0, 2]));
        assert_eq!(between.reference, reference);
        // An unsorted reference does not affect the order.
        let (nearest, between) = (
            associate(&estimate, &reference, 0.01).unwrap(),
            interpolate(&estimate, &reference, None).unwrap(),
        );
        assert!(!nearest.sorted_by_time && !between.sorted_by_time);
        assert_eq!(between.estimate, reference);
    }

    #[test]
    fn a_log_that_steps_back_in_time_keeps_its_order_with_interpolation() {
        let log = track(&[0, 100, 200, 150, 250, 250]);
        let matched = interpolate(&log, &log, None).unwrap();
        assert!(!matched.sorted_by_time);
        assert_eq!((&matched.reference, &matched.estimate), (&log, &log));
        assert_eq!((matched.unmatched_reference, matched.unmatched_estimate), (0, 0));
    }

    #[test]
    fn the_denser_trajectory_is_interpolated_to_the_stamps_of_the_sparser() {
        // Both run along x at 1 m per pose; the reference at 10 Hz, the estimate slower, half a period off.
        let reference = track(&[0, 100, 200, 300, 400]);
        let estimate = track(&[50, 275, 450]);
        let matched = interpolate(&reference, &estimate, None).unwrap();
        assert_eq!(matched.sampled, Side::Estimate);
        let xs: Vec<f64> = matched.reference.poses().iter().map(|pose| pose.x).collect();
        assert_eq!(xs, [0.5, 2.75], "450 ms lie beyond the reference");
        assert_eq!(matched.reference.stamps(), matched.estimate.stamps());
        assert_eq!(matched.estimate_indices, Some(vec![0, 1]));
        assert_eq!((matched.reference_indices, matched.time_difference), (None, None));
        // The last pose of the reference lies beyond the last sample within it.
        assert_eq!((matched.unmatched_reference, matched.unmatched_estimate), (1, 1));
        let swapped = interpolate(&estimate, &reference, None).unwrap();
        assert_eq!(
            (swapped.sampled, swapped.reference_indices),
            (Side::Reference, Some(vec![0, 1]))
        );
        assert_eq!(swapped.estimate, matched.reference);
        assert_eq!((swapped.unmatched_reference, swapped.unmatched_estimate), (1, 1));
        // With equally many poses in the common time span, those of the estimate are the samples.
        let ties = interpolate(&track(&[0, 100, 200]), &track(&[50, 150, 250]), None).unwrap();
        assert_eq!((ties.sampled, ties.estimate_indices), (Side::Estimate, Some(vec![0, 1])));
    }

    #[test]
    fn nothing_is_interpolated_over_a_long_gap() {
        let reference = track(&[0, 100, 200, 300, 900, 1000, 1100]);
        let estimate = track(&[50, 600, 950]);
        let found =
            |gap| interpolate(&reference, &estimate, gap).unwrap().estimate_indices.unwrap();
        assert_eq!(found(None), [0, 2], "600 ms are more than five usual intervals");
        assert_eq!(found(Some(0.6)), [0, 1, 2]);
        assert_eq!(found(Some(0.1)), [0, 2]);
        // Gaps of 0.2 s are always interpolated.
        let fast = track(&[0, 1, 2, 3, 203]);
        let found = interpolate(&fast, &track(&[100]), None).unwrap();
        assert_eq!(found.reference.poses()[0].x, 3.485);
        for error in [
            interpolate(&reference, &track(&[600]), None).unwrap_err(),
            interpolate(&reference, &track(&[1101]), None).unwrap_err(),
        ] {
            assert!(error.to_string().contains("over more than 0.5 s"), "{error}");
            assert!(error.to_string().contains("`--offset`"), "{error}");
        }
        for gap in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                interpolate(&reference, &estimate, Some(gap)),
                Err(MetricsError::Setting { name: "longest gap", .. })
            ));
        }
    }

    #[test]
    fn repeated_stamps_are_interpolated_between_their_neighbours() {
        // Three poses at 100 ms: x 1, 2, 3.
        let reference = track(&[0, 100, 100, 100, 200]);
        for (estimate, expected) in
            [([50, 150, 150], [0.5, 3.5, 3.5]), ([100, 100, 200], [1.0, 2.0, 4.0])]
        {
            let matched = interpolate(&reference, &track(&estimate), None).unwrap();
            let xs: Vec<f64> = matched.reference.poses().iter().map(|pose| pose.x).collect();
            assert_eq!(xs, expected);
        }
    }

    /// Direct implementation of the definition, in cubic time: (reference, estimate) of all pairs, nearest first.
    fn greedy(reference: &[i64], estimate: &[i64], tolerance: u64) -> Vec<(usize, usize)> {
        let mut all: Vec<(u64, usize, usize)> = Vec::new();
        for (r, a) in reference.iter().enumerate() {
            all.extend(estimate.iter().enumerate().map(|(e, b)| (a.abs_diff(*b), r, e)));
        }
        all.sort_unstable();
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        for (gap, r, e) in all {
            if gap <= tolerance && pairs.iter().all(|&(r2, e2)| r != r2 && e != e2) {
                pairs.push((r, e));
            }
        }
        pairs.sort_unstable_by_key(|&(_, e)| e);
        pairs
    }

    proptest! {
        /// Few different stamps, so that repeats and ties are common.
        #[test]
        fn each_pose_once_within_the_tolerance(
            reference in prop::collection::vec(0..60i64, 1..25),
            estimate in prop::collection::vec(0..60i64, 1..25),
        ) {
            let Ok(m) = associate(&track(&reference), &track(&estimate), 0.01) else {
                prop_assert!(greedy(&reference, &estimate, 10).is_empty());
                return Ok(());
            };
            let (of_reference, of_estimate) = both(&m);
            let distinct: BTreeSet<usize> = of_reference.iter().copied().collect();
            prop_assert_eq!(distinct.len() + m.unmatched_reference, reference.len());
            prop_assert_eq!(of_estimate.len() + m.unmatched_estimate, estimate.len());
            if m.sorted_by_time {
                prop_assert!(m.estimate.stamps().is_sorted());
            } else {
                prop_assert!(of_estimate.is_sorted_by(|a, b| a < b));
                prop_assert!(of_reference.is_sorted() || m.estimate.stamps().is_sorted());
            }
            let same = associate(&track(&reference), &track(&reference), 0.01).unwrap();
            prop_assert_eq!(&same.reference_indices, &same.estimate_indices);
            prop_assert!(!same.sorted_by_time);
            let mut largest = 0;
            for (&r, &e) in of_reference.iter().zip(&of_estimate) {
                prop_assert!(reference[r].abs_diff(estimate[e]) <= 10);
                largest = largest.max(reference[r].abs_diff(estimate[e]));
            }
            let apart = m.time_difference.unwrap();
            prop_assert_eq!(apart.max_s, largest as f64 / 1e3);
            prop_assert!(apart.mean_s <= apart.max_s * (1.0 + 1e-12));
        }

        /// If no two gaps are equal, the greedy matching is unique.
        #[test]
        fn agrees_with_the_definition(
            reference in prop::collection::vec(0..1_000_000i64, 1..15),
            estimate in prop::collection::vec(0..1_000_000i64, 1..15),
            tolerance in 1_000..100_000u64,
        ) {
            let gaps: BTreeSet<u64> = reference
                .iter()
                .flat_map(|r| estimate.iter().map(|e| r.abs_diff(*e)))
                .collect();
            prop_assume!(gaps.len() == reference.len() * estimate.len());
            let expected = greedy(&reference, &estimate, tolerance);
            match associate(&track(&reference), &track(&estimate), tolerance as f64 / 1e3) {
                Ok(m) => {
                    let (of_reference, of_estimate) = both(&m);
                    let mut found: Vec<_> = of_reference.into_iter().zip(of_estimate).collect();
                    found.sort_unstable_by_key(|&(_, e)| e);
                    prop_assert_eq!(found, expected);
                }
                Err(_) => prop_assert!(expected.is_empty()),
            }
        }
    }
}
