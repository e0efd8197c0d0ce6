//! When something was: the stretch of time that it belongs to, and its time in it.
//!
//! A bag that is recorded while another is played in a loop, or while a simulator is reset, goes over the
//! same time again. What lies before such a jump and what lies after it are taken apart.

use std::collections::BTreeMap;

use mcl_core::Stamp;

/// A jump back by more (ns) begins a new stretch; stamps of one topic step back by less, when its messages
/// are out of order.
const RESET: i64 = 1_000_000_000;

/// A time in a stretch; in the order of stretches, then of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Moment {
    pub stretch: usize,
    /// Nanoseconds.
    pub at: i64,
}

/// Where in the bag's order its stretches begin.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Stretches {
    /// Places of the first messages of all but the first stretch.
    starts: Vec<usize>,
    /// The largest jump: from which time to which, and what jumped.
    largest: Option<(i64, i64, String)>,
}

impl Stretches {
    /// Finds the jumps among messages: the place of each in the bag, what it tells of (its stamps alone
    /// follow each other), and its time.
    pub fn of<'a>(messages: impl Iterator<Item = (usize, &'a str, i64)>) -> Self {
        let mut messages: Vec<_> = messages.collect();
        messages.sort_by_key(|&(place, ..)| place);
        let mut found = Stretches::default();
        let mut latest: BTreeMap<&str, i64> = BTreeMap::new();
        for (place, of, at) in messages {
            let last = *latest.entry(of).or_insert(at);
            if last.saturating_sub(at) > RESET {
                found.starts.push(place);
                let is_larger = |(from, to, _): &(i64, i64, String)| last - at > from - to;
                if found.largest.as_ref().is_none_or(is_larger) {
                    found.largest = Some((last, at, of.to_owned()));
                }
                latest.clear();
            }
            let last = latest.entry(of).or_insert(at);
            *last = at.max(*last);
        }
        found
    }

    pub fn moment(&self, place: usize, at: i64) -> Moment {
        Moment { stretch: self.starts.partition_point(|&start| start <= place), at }
    }

    /// What is to be said of the jumps.
    pub fn doubt(&self) -> Option<String> {
        let (from, to, of) = self.largest.as_ref()?;
        let (from, to) = (Stamp::from_nanoseconds(*from), Stamp::from_nanoseconds(*to));
        let count = self.starts.len();
        let s = if count == 1 { "" } else { "s" };
        Some(format!(
            "time jumps back {count} time{s}, {of} by {:.3} s from {from} s to {to} s: what comes before and after is taken apart; was a bag played in a loop, or a simulator reset?",
            from.seconds_since(to)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn only_what_jumps_far_begins_anew() {
        // Two topics with clocks of their own, one with a small step back.
        let steady = [
            (0, "a", 5 * S),
            (1, "b", 900 * S),
            (2, "a", 4 * S),
            (3, "a", 6 * S),
            (4, "b", 901 * S),
        ];
        let found = Stretches::of(steady.into_iter());
        assert_eq!((found.doubt(), found.moment(4, 7)), (None, Moment { stretch: 0, at: 7 }));
        let reset = [(0, "a", 5 * S), (1, "b", 6 * S), (2, "a", 2 * S), (3, "b", 3 * S)];
        let found = Stretches::of(reset.into_iter());
        assert_eq!(found.starts, [2], "one jump, however many topics make it");
        assert_eq!((found.moment(1, 9).stretch, found.moment(2, 0).stretch), (0, 1));
        let told = found.doubt().unwrap();
        assert!(
            told.contains("1 time, a by 3.000 s from 5.000000000 s to 2.000000000 s"),
            "{told}"
        );
    }
}
