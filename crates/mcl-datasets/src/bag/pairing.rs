//! Which pose of a track belongs to which scan, and the remarks on scans that have none.

use std::collections::{BTreeMap, BTreeSet};

use mcl_core::text::counted;
use mcl_core::{Pose2, Stamp};

use super::moment::{Moment, near, usual_interval};
use super::track::{Occurrence, Placed, PoseTrack};

/// Stamps are not used for any scan when they are ambiguous for more than this part of the scans.
const MANY: f64 = 0.1;
/// Scans at the ends of a log that lie outside of its poses, as a part of all, that need no remark: recorders
/// do not start all topics at once.
const ENDS: f64 = 0.05;
/// The same as a number of scans.
const FEW: f64 = 2.0;

/// Which of the scans with the same time each one is.
pub(crate) fn occurrences(times: &[Moment]) -> Vec<Occurrence> {
    let mut seen: BTreeMap<Moment, usize> = BTreeMap::new();
    let index = |time: &Moment| {
        let count = seen.entry(*time).or_default();
        *count += 1;
        *count - 1
    };
    let indices: Vec<usize> = times.iter().map(index).collect();
    indices
        .into_iter()
        .zip(times)
        .map(|(index, time)| Occurrence { index, of: seen[time] })
        .collect()
}

/// The remark on scans that share their stamps, and whether these are many.
pub(crate) fn shared_stamps(moments: impl Iterator<Item = Moment>) -> Option<(String, bool)> {
    let mut counts: BTreeMap<Moment, usize> = BTreeMap::new();
    moments.for_each(|moment| *counts.entry(moment).or_default() += 1);
    let all: usize = counts.values().sum();
    let sharing: usize = counts.values().filter(|&&count| count > 1).sum();
    let (most, count) = counts.iter().max_by_key(|(_, count)| **count)?;
    (sharing > 0).then(|| {
        let message = format!(
            "{sharing} of {all} scans share their stamp with another scan, so stamps cannot tell them apart: there {} {}, and {} s occurs {} times",
            if counts.len() == 1 { "is" } else { "are" },
            counted(counts.len(), "different stamp"),
            Stamp::from_nanoseconds(most.at),
            count
        );
        (message, sharing as f64 > MANY * all as f64)
    })
}

/// Poses over time, with a name for remarks.
pub(crate) struct Track {
    poses: PoseTrack,
    pub what: &'static str,
    scans: usize,
    /// Whether stamps are too ambiguous to take any pose by them.
    is_void: bool,
    /// Scans whose stamps leave open which pose is theirs, scans outside of the track and in its gaps, and
    /// the samples around these gaps.
    unclear: usize,
    outside: usize,
    in_gaps: usize,
    gaps: BTreeSet<[Moment; 2]>,
}

impl Track {
    /// A track for the poses of scans at these times.
    pub fn new(
        poses: PoseTrack,
        what: &'static str,
        moments: &[Moment],
        occurrences: &[Occurrence],
    ) -> Self {
        // Where as many poses as scans share a stamp, they are paired in order; where that never happens, the
        // stamps were truncated, and those of scans that stand alone are ambiguous as well.
        let is_shared = |(moment, occurrence): (&Moment, &Occurrence)| {
            occurrence.of > 1 && poses.count(*moment) == occurrence.of
        };
        let are_cut = poses.shared() as f64 > MANY * poses.len() as f64
            && !moments.iter().zip(occurrences).any(is_shared);
        let is_unclear = |(moment, occurrence): (&Moment, &Occurrence)| {
            are_cut || matches!(poses.at(*moment, *occurrence), Placed::Unclear)
        };
        let unclear = moments.iter().zip(occurrences).filter(|&pair| is_unclear(pair)).count();
        let is_void = unclear as f64 > MANY * moments.len() as f64;
        let scans = moments.len();
        let gaps = BTreeSet::new();
        Track { poses, what, scans, is_void, unclear: 0, outside: 0, in_gaps: 0, gaps }
    }

    /// The pose of a scan.
    pub fn at(&mut self, moment: Moment, occurrence: Occurrence) -> Option<Pose2> {
        match self.poses.at(moment, occurrence) {
            _ if self.is_void => self.unclear += 1,
            Placed::At(pose) => return Some(pose),
            Placed::Unclear => self.unclear += 1,
            Placed::Outside => self.outside += 1,
            Placed::InGap(gap) => {
                self.in_gaps += 1;
                self.gaps.insert(gap);
            }
        }
        None
    }

    /// Its poses, unless the stamps are too ambiguous.
    pub fn poses(&self) -> Option<&PoseTrack> {
        Some(&self.poses).filter(|_| !self.is_void)
    }

    /// Earliest and latest time.
    pub fn span(&self) -> (i64, i64) {
        self.poses.span()
    }

    /// Doubts, losses and notes for scans at these times.
    pub fn remarks(&self, moments: &[Moment]) -> TrackRemarks {
        let Track { what, scans, unclear, outside, in_gaps, .. } = *self;
        let mut remarks = TrackRemarks::default();
        let lie = |count: usize| match count {
            1 => "1 scan lies".to_owned(),
            _ => format!("{count} scans lie"),
        };
        if unclear > 0 {
            let shared = match self.poses.shared() {
                0 => String::new(),
                shared => {
                    let (metres, degrees) = self.poses.apart();
                    format!(
                        "; {shared} of its {} poses share their stamp with another that is up to {metres:.3} m and {degrees:.1}° away",
                        self.poses.len()
                    )
                }
            };
            remarks.doubts.push(format!(
                "{what}: stamps do not say which of its poses belongs to {unclear} of {scans} scans{shared}; no {what} there"
            ));
        }
        if outside == scans {
            let (start, end) = self.span();
            let times = || moments.iter().map(|moment| moment.at);
            let shown = |at: Option<i64>| Stamp::from_nanoseconds(at.unwrap_or_default());
            remarks.doubts.push(format!(
                "{what}: it lasts from {} s to {} s, the scans from {} s to {} s, so no scan has any; were they stamped by different clocks?",
                shown(Some(start)),
                shown(Some(end)),
                shown(times().min()),
                shown(times().max()),
            ));
        } else if outside > 0 {
            let is_loss = outside as f64 > (ENDS * scans as f64).max(FEW);
            let list = if is_loss { &mut remarks.doubts } else { &mut remarks.assumptions };
            list.push(format!(
                "{} before the first or after the last {what} message: nothing is extrapolated, so no {what} there",
                lie(outside)
            ));
        }
        let ends = |gap: &[Moment; 2]| gap.map(|moment| Stamp::from_nanoseconds(moment.at));
        let longest = self
            .gaps
            .iter()
            .map(ends)
            .max_by_key(|[from, to]| to.nanoseconds().saturating_sub(from.nanoseconds()));
        if let Some([from, to]) = longest {
            remarks.doubts.push(format!(
                "{} in {} of the {what}, up to {:.3} s long (from {from} s to {to} s): nothing is interpolated over that time, so no {what} there ({} of {} have it; --longest-gap S interpolates over more)",
                lie(in_gaps),
                counted(self.gaps.len(), "gap"),
                to.seconds_since(from),
                scans - unclear - outside - in_gaps,
                counted(scans, "scan")
            ));
        }
        remarks
    }
}

/// Remarks on a track.
#[derive(Default)]
pub(crate) struct TrackRemarks {
    pub doubts: Vec<String>,
    pub assumptions: Vec<String>,
}

/// The time stretch of each pose in a file that covers the same time more than once.
pub(crate) fn stretches_of_file(times: &[i64]) -> Vec<usize> {
    let forward = times.windows(2).filter(|pair| pair[0] <= pair[1]).count();
    let usual = match forward as f64 >= (1.0 - MANY) * times.len().saturating_sub(1) as f64 {
        true => usual_interval(times),
        // Not ordered at all.
        false => {
            let mut sorted = times.to_vec();
            sorted.sort_unstable();
            usual_interval(&sorted)
        }
    };
    let mut earlier = BTreeSet::new();
    let mut stretch = 0;
    let mut of = Vec::with_capacity(times.len());
    for (index, &at) in times.iter().enumerate() {
        let latest = earlier.last().copied().unwrap_or(at);
        let was_there = earlier.range(near(at, usual)).next().is_some();
        let goes_on = times.get(index + 1).is_some_and(|&next| at < next && next <= latest);
        if latest.saturating_sub(at) > usual && goes_on && was_there {
            stretch += 1;
            earlier.clear();
        }
        earlier.insert(at);
        of.push(stretch);
    }
    of
}

/// The error that a file of poses covers more time stretches than the log and cannot be used.
pub(crate) fn goes_over_again(name: &str, in_file: usize, in_log: usize) -> String {
    format!(
        "reference: time jumps back {} in {name}, which then covers the same time again, and {} in the scans, so poses cannot be matched with scans and the reference is not used: cut it where its time jumps",
        counted(in_file.saturating_sub(1), "time"),
        counted(in_log.saturating_sub(1), "time"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_goes_over_the_same_time_again() {
        let stretches = |times: &[i64]| stretches_of_file(times).pop();
        let twice: Vec<i64> = (0..20).map(|k| 10 * (k % 10)).collect();
        assert_eq!(stretches_of_file(&twice), [[0; 10], [1; 10]].concat());
        // Shifted by half an interval.
        let off: Vec<i64> =
            twice.iter().enumerate().map(|(k, at)| at + if k < 10 { 5 } else { 0 }).collect();
        assert_eq!(stretches_of_file(&off), [[0; 10], [1; 10]].concat());
        assert_eq!(stretches(&[30, 10, 0, 20, 50, 40]), Some(0), "in any order");
        assert_eq!(stretches(&[0, 0, 10, 10, 20, 20]), Some(0), "each row twice");
        assert_eq!((stretches(&[5]), stretches(&[])), (Some(0), None));
    }

    #[test]
    fn scans_of_one_stamp_are_counted() {
        let shared =
            |times: &[i64]| shared_stamps(times.iter().map(|&at| Moment { stretch: 0, at }));
        assert_eq!(shared(&[1, 2, 3]), None);
        let (message, are_many) = shared(&[1, 1, 3]).unwrap();
        assert!(
            message.contains("2 of 3 scans") && message.contains("2 different stamps"),
            "{message}"
        );
        assert!(are_many);
        let few: Vec<i64> = (0..40).map(|k| if k == 7 { 8 } else { k }).collect();
        assert!(!shared(&few).unwrap().1);
    }
}
