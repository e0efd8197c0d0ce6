//! Poses over time, and where between them a scan was taken.

use mcl_core::Pose2;

use super::moment::Moment;

/// Interpolated over at most so many usual intervals, and any this short (ns).
const USUAL_INTERVALS: i64 = 5;
const SHORT: i64 = 200_000_000;

/// Stamped poses in order of time; those of one time in the order of the log.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseTrack {
    samples: Vec<(Moment, Pose2)>,
    /// The longest time between two samples that is interpolated over, in nanoseconds.
    longest: i64,
}

/// What a track says of a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Placed {
    /// The pose there.
    At(Pose2),
    /// Before the first or after the last sample of its stretch.
    Outside,
    /// Between two samples too far apart, in nanoseconds.
    InGap(i64),
}

/// The longest time interpolated over: that which is asked for (ns), or a few times the usual interval.
pub(super) fn longest_interval(times: impl Iterator<Item = Moment>, asked: Option<i64>) -> i64 {
    if let Some(asked) = asked {
        return asked;
    }
    let mut intervals = Vec::new();
    let mut last: Option<Moment> = None;
    for moment in times {
        if let Some(last) =
            last.filter(|last| last.stretch == moment.stretch && last.at < moment.at)
        {
            intervals.push(moment.at.saturating_sub(last.at));
        }
        last = Some(moment);
    }
    if intervals.is_empty() {
        return i64::MAX;
    }
    let middle = intervals.len() / 2;
    let usual = *intervals.select_nth_unstable(middle).1;
    usual.saturating_mul(USUAL_INTERVALS).max(SHORT)
}

impl PoseTrack {
    /// A track of samples in the order of the log; `None` without any. `longest` is the longest time to
    /// be interpolated over (ns), where it is asked for.
    pub fn new(mut samples: Vec<(Moment, Pose2)>, longest: Option<i64>) -> Option<Self> {
        samples.sort_by_key(|&(moment, _)| moment);
        let longest = longest_interval(samples.iter().map(|&(moment, _)| moment), longest);
        (!samples.is_empty()).then_some(PoseTrack { samples, longest })
    }

    /// Earliest and latest time.
    pub fn span(&self) -> (i64, i64) {
        let times = || self.samples.iter().map(|&(moment, _)| moment.at);
        (times().min().unwrap_or_default(), times().max().unwrap_or_default())
    }

    /// Adds those samples of another track that lie before or after this one in each stretch.
    pub fn extended_by(self, other: &[(Moment, Pose2)]) -> Self {
        let is_inside = |moment: &Moment| {
            let after = self.samples.partition_point(|&(sample, _)| sample < *moment);
            let is_of = |sample: Option<&(Moment, Pose2)>| {
                sample.is_some_and(|(sample, _)| sample.stretch == moment.stretch)
            };
            let is_there = self.samples.get(after).is_some_and(|(sample, _)| sample == moment);
            is_there
                || is_of(self.samples.get(after))
                    && is_of(after.checked_sub(1).and_then(|before| self.samples.get(before)))
        };
        let beyond = other.iter().filter(|(moment, _)| !is_inside(moment));
        let mut samples: Vec<_> = beyond.copied().collect();
        samples.extend(self.samples.iter().copied());
        samples.sort_by_key(|&(moment, _)| moment);
        PoseTrack { samples, longest: self.longest }
    }

    /// The pose at a time: that of the sample with this very stamp, else between the two neighbours
    /// (on the line between the positions, on the shorter arc between the headings). Of several samples
    /// of one stamp, the `occurrence`-th (from 0, at most the last).
    pub fn at(&self, moment: Moment, occurrence: usize) -> Placed {
        let start = self.samples.partition_point(|&(other, _)| other < moment);
        let end = self.samples.partition_point(|&(other, _)| other <= moment);
        if start < end {
            return Placed::At(self.samples[(start + occurrence).min(end - 1)].1);
        }
        let of_stretch = |sample: &&(Moment, Pose2)| sample.0.stretch == moment.stretch;
        let before = start.checked_sub(1).and_then(|index| self.samples.get(index));
        let after = self.samples.get(start);
        let (Some((before, from)), Some((after, to))) =
            (before.filter(of_stretch), after.filter(of_stretch))
        else {
            return Placed::Outside;
        };
        let gap = i128::from(after.at) - i128::from(before.at);
        if gap > i128::from(self.longest) {
            return Placed::InGap(i64::try_from(gap).unwrap_or(i64::MAX));
        }
        let part = (i128::from(moment.at) - i128::from(before.at)) as f64 / gap as f64;
        Placed::At(from.interpolate(to, part))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const fn at(at: i64) -> Moment {
        Moment { stretch: 0, at }
    }

    fn pose(track: &PoseTrack, moment: Moment) -> Pose2 {
        match track.at(moment, 0) {
            Placed::At(pose) => pose,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn between_neighbours_but_never_beyond() {
        let samples = vec![
            (at(0), Pose2::new(0.0, 0.0, PI - 0.1)),
            (at(100), Pose2::new(1.0, 2.0, -PI + 0.3)),
        ];
        let track = PoseTrack::new(samples, None).unwrap();
        let found = pose(&track, at(25));
        assert_eq!((found.x, found.y), (0.25, 0.5));
        assert!(found.theta.abs() - PI < 1e-15 && (found.theta - PI).abs() < 1e-12, "{found:?}");
        assert_eq!(pose(&track, at(100)).x, 1.0);
        assert_eq!((track.at(at(-1), 0), track.at(at(101), 0)), (Placed::Outside, Placed::Outside));
        let other = [(at(50), Pose2::IDENTITY), (at(200), Pose2::new(3.0, 2.0, 0.0))];
        let longer = track.extended_by(&other);
        assert_eq!(longer.span(), (0, 200));
        assert_eq!((pose(&longer, at(150)).x, pose(&longer, at(50)).x), (2.0, 0.5));
    }

    #[test]
    fn poses_of_one_stamp_stay_in_order() {
        let x = |x| Pose2::new(x, 0.0, 0.0);
        let track =
            PoseTrack::new(vec![(at(5), x(1.0)), (at(9), x(2.0)), (at(5), x(3.0))], None).unwrap();
        let found: Vec<Placed> = (0..3).map(|k| track.at(at(5), k)).collect();
        assert_eq!(found, [1.0, 3.0, 3.0].map(|value| Placed::At(x(value))));
    }

    #[test]
    fn neither_over_long_gaps_nor_from_one_stretch_into_another() {
        const S: i64 = 1_000_000_000;
        let mut samples: Vec<_> = (0..10).map(|k| (at(k * S / 2), Pose2::IDENTITY)).collect();
        samples.push((at(14 * S), Pose2::IDENTITY));
        samples.push((Moment { stretch: 1, at: 2 * S }, Pose2::IDENTITY));
        samples.push((Moment { stretch: 1, at: 3 * S }, Pose2::IDENTITY));
        let track = PoseTrack::new(samples.clone(), None).unwrap();
        assert_eq!(track.at(at(7 * S), 0), Placed::InGap(9_500_000_000));
        assert!(matches!(track.at(at(S / 4), 0), Placed::At(_)));
        assert_eq!(track.at(Moment { stretch: 1, at: S }, 0), Placed::Outside);
        assert_eq!(track.at(at(15 * S), 0), Placed::Outside);
        let track = PoseTrack::new(samples, Some(10 * S)).unwrap();
        assert!(matches!(track.at(at(7 * S), 0), Placed::At(_)), "as asked for");
    }
}
