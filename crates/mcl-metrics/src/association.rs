use std::cmp::Reverse;
use std::collections::BinaryHeap;

use mcl_core::{Stamp, Trajectory};

use crate::error::MetricsError;

/// Largest difference of two matching stamps unless another is given, in seconds (evo's default).
pub const DEFAULT_TOLERANCE_S: f64 = 0.01;

/// Poses of a reference and an estimate that belong to the same moments.
#[derive(Debug, Clone, PartialEq)]
pub struct Matched {
    /// Matched part of the reference; entry *k* belongs to entry *k* of `estimate`.
    pub reference: Trajectory,
    /// Matched part of the estimate, in the estimate's own order.
    pub estimate: Trajectory,
    /// Index of each entry in the whole reference.
    pub reference_indices: Vec<usize>,
    /// Index of each entry in the whole estimate, ascending.
    pub estimate_indices: Vec<usize>,
    /// Number of poses of the reference left without a partner.
    pub unmatched_reference: usize,
    /// Number of poses of the estimate left without a partner.
    pub unmatched_estimate: usize,
}

/// Matches poses by stamp, one to one: of all pairs not further apart than `tolerance_s` the nearest
/// in time is taken, then the nearest of what is left, and so on. Equally near pairs are taken in
/// order of time; equal stamps are used up in recorded order. Neither trajectory needs to be sorted,
/// and pairs come in the order of the estimate.
///
/// Greedy means nearest first, not as many as possible: a pose whose only neighbour has a nearer
/// partner stays unmatched.
///
/// # Errors
/// When the tolerance is negative or not finite, a trajectory is empty, or nothing matches.
pub fn associate(
    reference: &Trajectory,
    estimate: &Trajectory,
    tolerance_s: f64,
) -> Result<Matched, MetricsError> {
    if !(tolerance_s.is_finite() && tolerance_s >= 0.0) {
        let expected = "a finite number of seconds, not negative";
        return Err(MetricsError::Setting { name: "tolerance", found: tolerance_s, expected });
    }
    for (what, trajectory) in [("reference poses", reference), ("estimated poses", estimate)] {
        if trajectory.is_empty() {
            return Err(MetricsError::TooFew { what, found: 0, needed: 1 });
        }
    }
    let timeline = merge(reference.stamps(), estimate.stamps());
    let tolerance = (tolerance_s * 1e9).round() as u64;
    let mut pairs = nearest_pairs(&timeline, tolerance);
    if pairs.is_empty() {
        let nearest = timeline.windows(2).filter_map(|pair| gap(&pair[0], &pair[1])).min();
        return Err(MetricsError::NothingMatches {
            tolerance_s,
            reference: time_range(reference.stamps()),
            estimate: time_range(estimate.stamps()),
            nearest_s: nearest.unwrap_or(u64::MAX) as f64 / 1e9,
        });
    }
    pairs.sort_unstable_by_key(|&(_, estimate)| estimate);
    let (reference_indices, estimate_indices): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    let select = |trajectory: &Trajectory, indices: &[usize]| -> Trajectory {
        indices.iter().map(|&i| (trajectory.stamps()[i], trajectory.poses()[i])).collect()
    };
    Ok(Matched {
        unmatched_reference: reference.len() - reference_indices.len(),
        unmatched_estimate: estimate.len() - estimate_indices.len(),
        reference: select(reference, &reference_indices),
        estimate: select(estimate, &estimate_indices),
        reference_indices,
        estimate_indices,
    })
}

/// A stamp on the common time line. Field order is sorting order: by time, and equal stamps of both
/// sides take turns, so that the k-th of the one stands beside the k-th of the other.
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

/// Nanoseconds between a stamp of the one side and a later one of the other.
fn gap(earlier: &Entry, later: &Entry) -> Option<u64> {
    let differ = earlier.is_estimate != later.is_estimate;
    differ.then(|| later.stamp.nanoseconds().abs_diff(earlier.stamp.nanoseconds()))
}

/// (reference index, estimate index) of the greedy matching. The nearest two unmatched entries of
/// different sides are always neighbours on what is left of the time line, so a heap of neighbours
/// and a linked list do: O(n log n) for any tolerance.
fn nearest_pairs(timeline: &[Entry], tolerance: u64) -> Vec<(usize, usize)> {
    let count = timeline.len();
    let mut next: Vec<Option<usize>> =
        (0..count).map(|i| (i + 1 < count).then_some(i + 1)).collect();
    let mut previous: Vec<Option<usize>> = (0..count).map(|i| i.checked_sub(1)).collect();
    let mut is_matched = vec![false; count];
    let mut heap = BinaryHeap::new();
    let candidate = |left: usize, right: usize| {
        gap(&timeline[left], &timeline[right])
            .filter(|&nanoseconds| nanoseconds <= tolerance)
            .map(|nanoseconds| Reverse((nanoseconds, left, right)))
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

fn time_range(stamps: &[Stamp]) -> [Stamp; 2] {
    stamps.iter().fold([stamps[0]; 2], |[first, last], &s| [first.min(s), last.max(s)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Pose2;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// Milliseconds to a trajectory whose x tells the index.
    fn track(milliseconds: &[i64]) -> Trajectory {
        let stamp = |ms: i64| Stamp::from_nanoseconds(ms * 1_000_000);
        let poses = (0..milliseconds.len()).map(|i| Pose2::new(i as f64, 0.0, 0.0));
        milliseconds.iter().map(|&ms| stamp(ms)).zip(poses).collect()
    }

    fn indices(reference: &[i64], estimate: &[i64]) -> Vec<(usize, usize)> {
        let m = associate(&track(reference), &track(estimate), DEFAULT_TOLERANCE_S).unwrap();
        let xs = |t: &Trajectory| t.poses().iter().map(|p| p.x as usize).collect::<Vec<_>>();
        assert_eq!(xs(&m.reference), m.reference_indices);
        assert_eq!(xs(&m.estimate), m.estimate_indices);
        m.reference_indices.into_iter().zip(m.estimate_indices).collect()
    }

    #[test]
    fn nearest_first_and_each_pose_once() {
        // 104 is nearer to 105 than 100 is; 100 then takes the 95 (5 ms), not the used 104.
        assert_eq!(indices(&[95, 105], &[100, 104]), [(0, 0), (1, 1)]);
        // Both want 105; the nearer one gets it, and nothing else is within 10 ms.
        assert_eq!(indices(&[105], &[100, 104]), [(0, 1)]);
        // The tolerance is inclusive; of equally near pairs the earlier is taken.
        assert_eq!(indices(&[110, 130], &[120]), [(0, 0)]);
        assert_eq!(indices(&[109, 131], &[100, 120]), [(0, 0)]);
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
             apart. Check that both are of the same recording and on the same clock; if only their \
             rates differ, raise the tolerance"
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

    /// The definition, in cubic time: (reference, estimate) of all pairs, nearest first.
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
        /// Few different stamps, so that repeats and ties abound.
        #[test]
        fn each_pose_once_within_the_tolerance(
            reference in prop::collection::vec(0..60i64, 1..25),
            estimate in prop::collection::vec(0..60i64, 1..25),
        ) {
            let Ok(m) = associate(&track(&reference), &track(&estimate), 0.01) else {
                prop_assert!(greedy(&reference, &estimate, 10).is_empty());
                return Ok(());
            };
            let distinct: BTreeSet<usize> = m.reference_indices.iter().copied().collect();
            prop_assert_eq!(distinct.len() + m.unmatched_reference, reference.len());
            prop_assert_eq!(m.estimate_indices.len() + m.unmatched_estimate, estimate.len());
            prop_assert!(m.estimate_indices.is_sorted_by(|a, b| a < b));
            let same = associate(&track(&reference), &track(&reference), 0.01).unwrap();
            prop_assert_eq!(same.reference_indices, same.estimate_indices);
            for (&r, &e) in m.reference_indices.iter().zip(&m.estimate_indices) {
                prop_assert!(reference[r].abs_diff(estimate[e]) <= 10);
            }
        }

        /// Where no two gaps are equal, the greedy matching is unique.
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
                    let found = m.reference_indices.into_iter().zip(m.estimate_indices);
                    prop_assert_eq!(found.collect::<Vec<_>>(), expected);
                }
                Err(_) => prop_assert!(expected.is_empty()),
            }
        }
    }
}
