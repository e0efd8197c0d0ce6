//! Stamps of the scans in the input of a program.

use mcl_core::Stamp;

const SECOND: i64 = 1_000_000_000;
/// The interval used where too few scans have a stamp (ns).
const INTERVAL: i64 = SECOND / 10;
/// The latest time that ROS messages can hold.
const LAST: i64 = i32::MAX as i64 * SECOND;

/// Strictly increasing stamps of a run's scans, which identify each of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stamps {
    /// One per scan.
    pub all: Vec<Stamp>,
    /// Number of stamps that are not those of the log.
    pub made: usize,
}

impl Stamps {
    /// Keeps as many stamps of the log as are in order; those between are spread evenly. After `carried_off`,
    /// the first scan from another part of the log, time continues as if there had been no jump. Times before
    /// the epoch, or beyond what bags can hold, are shifted as a whole.
    pub fn of(log: &[Option<Stamp>], carried_off: Option<usize>) -> Self {
        let nanoseconds: Vec<Option<i64>> =
            log.iter().map(|stamp| stamp.map(Stamp::nanoseconds)).collect();
        let (before, after) = nanoseconds.split_at(carried_off.unwrap_or(nanoseconds.len()));
        let mut all = increasing(before);
        if let (Some(&last), false) = (all.last(), after.is_empty()) {
            let part = increasing(after);
            let shift = last + usual(&all) - part[0];
            all.extend(part.iter().map(|at| at + shift));
        }
        if let (Some(&first), Some(&last)) = (all.first(), all.last())
            && (first <= 0 || last > LAST)
        {
            let shift = SECOND - first;
            all.iter_mut().for_each(|at| *at += shift);
        }
        let made = all.iter().zip(&nanoseconds).filter(|(made, log)| Some(**made) != **log).count();
        Stamps { all: all.into_iter().map(Stamp::from_nanoseconds).collect(), made }
    }
}

/// Strictly increasing times, most of them unchanged.
fn increasing(times: &[Option<i64>]) -> Vec<i64> {
    let kept = most_in_order(times);
    let at = |place: usize| times[place].unwrap_or_default();
    let (Some(&first), Some(&last)) = (kept.first(), kept.last()) else {
        return (0..times.len() as i64).map(|scan| SECOND + scan * INTERVAL).collect();
    };
    let known: Vec<i64> = kept.iter().map(|&place| at(place)).collect();
    let step = usual(&known);
    let mut all = vec![0; times.len()];
    for (place, time) in all.iter_mut().enumerate() {
        *time = match kept.binary_search(&place) {
            Ok(_) => at(place),
            Err(0) => at(first) - (first - place) as i64 * step,
            Err(next) if next == kept.len() => at(last) + (place - last) as i64 * step,
            Err(next) => {
                let (from, to) = (kept[next - 1], kept[next]);
                let part = i128::from(at(to) - at(from)) * (place - from) as i128;
                at(from) + (part / (to - from) as i128) as i64
            }
        };
    }
    all
}

/// Indices of the largest set of times that increase by at least a nanosecond per index, so that there is
/// room between them.
fn most_in_order(times: &[Option<i64>]) -> Vec<usize> {
    // Patience sorting, from the last to the first: among chains of the same length, the one that begins with
    // the earlier scans. `ends` has the index at which the lowest chain of each length ends.
    let mut ends: Vec<usize> = Vec::new();
    let mut after: Vec<Option<usize>> = vec![None; times.len()];
    let depth = |place: usize| place as i64 - times[place].unwrap_or_default();
    let is_usable = |place: &usize| times[*place].is_some_and(|at| at.abs() <= LAST);
    for place in (0..times.len()).rev().filter(is_usable) {
        let length = ends.partition_point(|&end| depth(end) <= depth(place));
        after[place] = length.checked_sub(1).map(|last| ends[last]);
        match ends.get_mut(length) {
            Some(end) => *end = place,
            None => ends.push(place),
        }
    }
    std::iter::successors(ends.last().copied(), |&place| after[place]).collect()
}

/// The usual interval (ns).
fn usual(times: &[i64]) -> i64 {
    let mut intervals: Vec<i64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if intervals.is_empty() {
        return INTERVAL;
    }
    let middle = intervals.len() / 2;
    *intervals.select_nth_unstable(middle).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(times: &[i64], carried_off: Option<usize>) -> (Vec<i64>, usize) {
        let known = |&at: &i64| (at >= 0).then(|| Stamp::from_nanoseconds(at * SECOND));
        let log: Vec<Option<Stamp>> = times.iter().map(known).collect();
        let Stamps { all, made } = Stamps::of(&log, carried_off);
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
        (all.iter().map(|at| at.nanoseconds() / (SECOND / 2)).collect(), made)
    }

    /// In half seconds.
    #[test]
    fn stamps_of_the_log_are_kept_where_they_increase() {
        assert_eq!(of(&[5, 6, 9], None), (vec![10, 12, 18], 0));
        // A step back, a repetition, a missing stamp.
        assert_eq!(of(&[5, 3, 6, 7], None), (vec![10, 11, 12, 14], 1));
        assert_eq!(of(&[5, 5, 6, -1, 8], None), (vec![10, 11, 12, 14, 16], 2));
        // From there on the robot is at another place, earlier or later in the log.
        assert_eq!(of(&[50, 51, 10, 11], Some(2)), (vec![100, 102, 104, 106], 2));
        assert_eq!(of(&[50, 51, 900, 901], Some(2)), (vec![100, 102, 104, 106], 2));
        // None at all, and one beyond what a bag can hold.
        assert_eq!(of(&[-1, -1], None).1, 2);
        assert_eq!(of(&[0, 1], None), (vec![2, 4], 2));
        assert_eq!(of(&[i64::MAX / SECOND, 3, 4], None), (vec![4, 6, 8], 1));
    }
}
