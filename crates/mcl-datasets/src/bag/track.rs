//! Poses over time, interpolated at the times of scans.

use mcl_core::{Pose2, math};

use super::moment::Moment;

/// Gaps up to this many usual intervals are interpolated over, and any gap up to this length (ns).
const USUAL_INTERVALS: i64 = 5;
const SHORT: i64 = 200_000_000;

/// Poses of the same stamp closer than this (metres, radians) are the same but for noise.
const ALIKE: (f64, f64) = (0.01, 0.01);

/// Which of several with the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Occurrence {
    /// Index, from 0.
    pub index: usize,
    /// Their number.
    pub of: usize,
}

impl Occurrence {
    /// A single one.
    pub const ONLY: Occurrence = Occurrence { index: 0, of: 1 };
}

/// Stamped poses in order of time; those of the same time in the order of the log.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseTrack {
    samples: Vec<(Moment, Pose2)>,
    /// Number of samples whose time has several different poses, and how far these are apart: metres and
    /// radians.
    shared: usize,
    apart: (f64, f64),
    /// The longest time between two samples that is interpolated over, in nanoseconds.
    longest: i64,
}

/// The result of looking up a time in a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Placed {
    /// The pose at that time.
    At(Pose2),
    /// Several poses have this stamp or that of a neighbour, or several scans share one stamp.
    Unclear,
    /// Before the first or after the last sample of its stretch.
    Outside,
    /// Between these two samples, which are too far apart.
    InGap([Moment; 2]),
}

/// The longest time interpolated over (ns): the requested one, or a few times the usual interval.
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
    /// interpolate over (ns), where requested.
    pub fn new(mut samples: Vec<(Moment, Pose2)>, longest: Option<i64>) -> Option<Self> {
        samples.sort_by_key(|&(moment, _)| moment);
        let longest = longest_interval(samples.iter().map(|&(moment, _)| moment), longest);
        (!samples.is_empty()).then(|| PoseTrack::of(samples, longest))
    }

    fn of(samples: Vec<(Moment, Pose2)>, longest: i64) -> Self {
        let (mut shared, mut apart) = (0, (0.0_f64, 0.0_f64));
        for group in samples.chunk_by(|a, b| a.0 == b.0).filter(|group| !are_alike(group)) {
            shared += group.len();
            let [metres, radians] = spread(group);
            apart = (apart.0.max(metres), apart.1.max(radians));
        }
        PoseTrack { samples, shared, apart, longest }
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Number of poses whose stamp has several different poses.
    pub fn shared(&self) -> usize {
        self.shared
    }

    /// How far poses of the same stamp are apart, in metres and degrees.
    pub fn apart(&self) -> (f64, f64) {
        (self.apart.0, self.apart.1.to_degrees())
    }

    /// Number of poses with this time.
    pub fn count(&self, moment: Moment) -> usize {
        self.group(moment).len()
    }

    fn group(&self, moment: Moment) -> &[(Moment, Pose2)] {
        let start = self.samples.partition_point(|&(other, _)| other < moment);
        let end = self.samples.partition_point(|&(other, _)| other <= moment);
        &self.samples[start..end]
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
        PoseTrack::of(samples, self.longest)
    }

    /// The pose at a time: that of the sample with exactly this stamp, else interpolated between the two
    /// neighbours (positions linearly, headings along the shorter arc). Several queries with the same time
    /// get its samples one after the other, if there are as many.
    pub fn at(&self, moment: Moment, occurrence: Occurrence) -> Placed {
        let group = self.group(moment);
        match group.get(occurrence.index) {
            Some((_, pose)) if occurrence.of == group.len() => return Placed::At(*pose),
            _ if occurrence.of > 1 => return Placed::Unclear,
            Some((_, pose)) if are_alike(group) => return Placed::At(*pose),
            Some(_) => return Placed::Unclear,
            None => {}
        }
        let start = self.samples.partition_point(|&(other, _)| other < moment);
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
            return Placed::InGap([*before, *after]);
        }
        if !are_alike(self.group(*before)) || !are_alike(self.group(*after)) {
            return Placed::Unclear;
        }
        let part = (i128::from(moment.at) - i128::from(before.at)) as f64 / gap as f64;
        Placed::At(from.interpolate(to, part))
    }
}

/// Largest deviation from the first pose: metres and radians.
fn spread(samples: &[(Moment, Pose2)]) -> [f64; 2] {
    let mut spread = [0.0_f64; 2];
    for (_, pose) in samples {
        let apart = samples[0].1.between(pose);
        let metres = math::hypot(apart.x, apart.y);
        spread = [spread[0].max(metres), spread[1].max(apart.theta.abs())];
    }
    spread
}

fn are_alike(samples: &[(Moment, Pose2)]) -> bool {
    let [metres, radians] = if samples.len() > 1 { spread(samples) } else { [0.0; 2] };
    metres <= ALIKE.0 && radians <= ALIKE.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const fn at(at: i64) -> Moment {
        Moment { stretch: 0, at }
    }

    fn pose(track: &PoseTrack, moment: Moment) -> Pose2 {
        match track.at(moment, Occurrence::ONLY) {
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
        assert_eq!(
            (track.at(at(-1), Occurrence::ONLY), track.at(at(101), Occurrence::ONLY)),
            (Placed::Outside, Placed::Outside)
        );
        let other = [(at(50), Pose2::IDENTITY), (at(200), Pose2::new(3.0, 2.0, 0.0))];
        let longer = track.extended_by(&other);
        assert_eq!(longer.span(), (0, 200));
        assert_eq!((pose(&longer, at(150)).x, pose(&longer, at(50)).x), (2.0, 0.5));
    }

    #[test]
    fn poses_of_one_stamp_go_to_as_many_in_order_and_to_no_other_number() {
        let x = |x| Pose2::new(x, 0.0, 0.0);
        let samples = vec![(at(5), x(1.0)), (at(9), x(2.0)), (at(5), x(3.0)), (at(1), x(0.0))];
        let track = PoseTrack::new(samples, None).unwrap();
        assert_eq!((track.len(), track.shared(), track.apart().0), (4, 2, 2.0));
        let found: Vec<Placed> =
            (0..2).map(|index| track.at(at(5), Occurrence { index, of: 2 })).collect();
        assert_eq!(found, [1.0, 3.0].map(|value| Placed::At(x(value))));
        for of in [1, 3] {
            assert_eq!(track.at(at(5), Occurrence { index: 0, of }), Placed::Unclear);
        }
        assert_eq!(track.at(at(9), Occurrence { index: 1, of: 2 }), Placed::Unclear);
        // Nor between two of which one is ambiguous.
        assert_eq!(track.at(at(7), Occurrence::ONLY), Placed::Unclear);
        let noise = vec![(at(5), x(1.0)), (at(5), x(1.005)), (at(9), x(2.0))];
        let track = PoseTrack::new(noise, None).unwrap();
        assert_eq!(track.at(at(5), Occurrence::ONLY), Placed::At(x(1.0)));
    }

    #[test]
    fn neither_over_long_gaps_nor_from_one_stretch_into_another() {
        const S: i64 = 1_000_000_000;
        let mut samples: Vec<_> = (0..10).map(|k| (at(k * S / 2), Pose2::IDENTITY)).collect();
        samples.push((at(14 * S), Pose2::IDENTITY));
        samples.push((Moment { stretch: 1, at: 2 * S }, Pose2::IDENTITY));
        samples.push((Moment { stretch: 1, at: 3 * S }, Pose2::IDENTITY));
        let track = PoseTrack::new(samples.clone(), None).unwrap();
        assert_eq!(
            track.at(at(7 * S), Occurrence::ONLY),
            Placed::InGap([at(9 * S / 2), at(14 * S)])
        );
        assert!(matches!(track.at(at(S / 4), Occurrence::ONLY), Placed::At(_)));
        assert_eq!(track.at(Moment { stretch: 1, at: S }, Occurrence::ONLY), Placed::Outside);
        assert_eq!(track.at(at(15 * S), Occurrence::ONLY), Placed::Outside);
        let track = PoseTrack::new(samples, Some(10 * S)).unwrap();
        assert!(matches!(track.at(at(7 * S), Occurrence::ONLY), Placed::At(_)), "as asked for");
    }
}
