//! Time of an event: the time stretch that it belongs to, and the time within it.
//!
//! A bag recorded while another is played in a loop, or while a simulator is reset, covers the same time more
//! than once. What lies before such a jump and what lies after it are kept apart.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use mcl_core::Stamp;
use mcl_core::text::counted;

/// A jump back by more than this (ns) begins a new stretch. A shorter one does so where the messages of one
/// sender follow each other evenly, if the jump is longer than their usual interval and leads to a time at
/// which there were messages before: messages that are merely out of order fill a hole, or stand alone.
const RESET: i64 = 1_000_000_000;

/// A time within a stretch; ordered by stretch, then by time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Moment {
    pub stretch: usize,
    /// Nanoseconds.
    pub at: i64,
}

impl Moment {
    /// A time in a log with a single stretch.
    pub const fn only(stamp: Stamp) -> Self {
        Moment { stretch: 0, at: stamp.nanoseconds() }
    }
}

/// The time of a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimedMessage<'a> {
    /// Its index in the bag.
    pub place: usize,
    /// What it is about (a topic or a frame): only stamps of the same one are compared.
    pub of: &'a str,
    pub at: i64,
    /// Whether such messages follow each other evenly, as from a single sender.
    pub is_even: bool,
}

/// The times at which a message counts as being near `at`: one that fills a hole is an interval away from all
/// others.
pub(super) fn near(at: i64, usual: i64) -> RangeInclusive<i64> {
    let reach = usual / 4 * 3;
    at.saturating_sub(reach)..=at.saturating_add(reach)
}

/// The median of the steps forward; the largest integer without any.
pub(super) fn usual_interval(times: &[i64]) -> i64 {
    let steps = times.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    let mut steps: Vec<i64> = steps.filter(|&step| step > 0).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return i64::MAX;
    }
    *steps.select_nth_unstable(middle).1
}

/// Where in the bag's order its stretches begin.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Stretches {
    /// Indices of the first messages of all but the first stretch.
    starts: Vec<usize>,
    /// The largest jump: from time, to time, and what jumped.
    largest: Option<(i64, i64, String)>,
}

impl Stretches {
    /// Finds the jumps in a sequence of messages.
    pub fn of<'a>(messages: impl Iterator<Item = TimedMessage<'a>>) -> Self {
        let mut messages: Vec<TimedMessage<'a>> = messages.collect();
        messages.sort_by_key(|message| message.place);
        let mut in_order: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
        for message in messages.iter().filter(|message| message.is_even) {
            in_order.entry(message.of).or_default().push(message.at);
        }
        let usual: BTreeMap<&str, i64> =
            in_order.iter().map(|(of, times)| (*of, usual_interval(times))).collect();
        let mut found = Stretches::default();
        let mut next: BTreeMap<&str, usize> = BTreeMap::new();
        let mut earlier: BTreeMap<&str, BTreeSet<i64>> = BTreeMap::new();
        for TimedMessage { place, of, at, is_even } in messages {
            let last = earlier.get(of).and_then(|times| times.last()).copied().unwrap_or(at);
            let back = last.saturating_sub(at);
            let follows = is_even.then(|| {
                let next = next.entry(of).or_default();
                *next += 1;
                in_order[of].get(*next).copied()
            });
            let goes_over_again = || {
                let usual = usual.get(of).copied().unwrap_or(i64::MAX);
                let was_there = earlier
                    .get(of)
                    .is_some_and(|times| times.range(near(at, usual)).next().is_some());
                let goes_on = follows.flatten().is_some_and(|next| at < next && next <= last);
                back > usual && was_there && goes_on
            };
            if back > RESET || goes_over_again() {
                found.starts.push(place);
                let is_larger = |(from, to, _): &(i64, i64, String)| back > from - to;
                if found.largest.as_ref().is_none_or(is_larger) {
                    found.largest = Some((last, at, of.to_owned()));
                }
                earlier.clear();
            }
            earlier.entry(of).or_default().insert(at);
        }
        found
    }

    pub fn moment(&self, place: usize, at: i64) -> Moment {
        Moment { stretch: self.starts.partition_point(|&start| start <= place), at }
    }

    /// The doubt to report about the jumps.
    pub fn doubt(&self) -> Option<String> {
        let (from, to, of) = self.largest.as_ref()?;
        let (from, to) = (Stamp::from_nanoseconds(*from), Stamp::from_nanoseconds(*to));
        let times = counted(self.starts.len(), "time");
        Some(format!(
            "time jumps back {times}, {of} by {:.3} s from {from} s to {to} s: what comes before and after is kept apart; was a bag played in a loop, or a simulator reset?",
            from.seconds_since(to)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn stretches_of(messages: &[(&str, f64)], is_even: bool) -> Stretches {
        Stretches::of(messages.iter().enumerate().map(|(place, &(of, seconds))| TimedMessage {
            place,
            of,
            at: (seconds * S as f64).round() as i64,
            is_even,
        }))
    }

    #[test]
    fn only_large_jumps_begin_a_new_stretch() {
        // Two topics with clocks of their own, one with a small step back.
        let steady = [("a", 5.0), ("b", 900.0), ("a", 4.0), ("a", 6.0), ("b", 901.0)];
        for is_even in [false, true] {
            let found = stretches_of(&steady, is_even);
            assert_eq!((found.doubt(), found.moment(4, 7)), (None, Moment { stretch: 0, at: 7 }));
        }
        let reset = [("a", 5.0), ("b", 6.0), ("a", 2.0), ("b", 3.0)];
        let found = stretches_of(&reset, false);
        assert_eq!(found.starts, [2], "one jump, however many topics make it");
        assert_eq!((found.moment(1, 9).stretch, found.moment(2, 0).stretch), (0, 1));
        let doubt = found.doubt().unwrap();
        assert!(
            doubt.contains("1 time, a by 3.000 s from 5.000000000 s to 2.000000000 s"),
            "{doubt}"
        );
    }

    #[test]
    fn a_short_jump_is_distinguished_from_messages_out_of_order() {
        let even = |times: &[f64]| {
            let messages: Vec<_> = times.iter().map(|&at| ("a", at)).collect();
            stretches_of(&messages, true).starts
        };
        let (before, after) = ([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], [0.35, 0.45, 0.55, 0.65]);
        assert_eq!(even(&[before.as_slice(), &after].concat()), [6], "by 1.5 intervals");
        assert_eq!(even(&[0.0, 0.1, 0.2, 0.3, 0.1, 0.2, 0.3]), [4], "over the same times");
        assert_eq!(even(&[0.0, 0.1, 0.3, 0.2, 0.4, 0.5]), [0; 0], "two changed places");
        assert_eq!(even(&[0.0, 0.1, 0.4, 0.5, 0.2, 0.3, 0.6]), [0; 0], "a packet that was late");
        assert_eq!(even(&[0.0, 0.1, 0.2, 0.3, 0.1, 0.4, 0.5]), [0; 0], "one that comes twice");
        assert_eq!(even(&[0.5, 0.4, 0.3, 0.2, 0.1]), [0; 0], "written from the end");
        let twice: Vec<f64> =
            (0..20).flat_map(|k| [0.1 * f64::from(k), 0.1 * f64::from(k) - 0.3]).collect();
        assert_eq!(even(&twice), [0; 0], "two senders, the one late");
    }
}
