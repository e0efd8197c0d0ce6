//! Poses over time, and where between them a scan was taken.

use mcl_core::{Pose2, wrap_angle};

/// Stamped poses in order of time; those of one time in the order of the log.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PoseTrack {
    samples: Vec<(i64, Pose2)>,
}

impl PoseTrack {
    /// A track of samples in the order of the log; `None` without any.
    pub fn new(mut samples: Vec<(i64, Pose2)>) -> Option<Self> {
        samples.sort_by_key(|&(stamp, _)| stamp);
        (!samples.is_empty()).then_some(PoseTrack { samples })
    }

    /// Earliest and latest stamp.
    pub fn span(&self) -> (i64, i64) {
        (self.samples[0].0, self.samples[self.samples.len() - 1].0)
    }

    /// Adds those samples of another track that lie before or after this one.
    pub fn extended_by(self, other: &[(i64, Pose2)]) -> Self {
        let (first, last) = self.span();
        let beyond = other.iter().filter(|(stamp, _)| *stamp < first || *stamp > last);
        let mut samples: Vec<_> = beyond.copied().collect();
        samples.extend(self.samples);
        samples.sort_by_key(|&(stamp, _)| stamp);
        PoseTrack { samples }
    }

    /// The pose at a time: that of the sample with this very stamp, else between the two neighbours
    /// (on the line between the positions, on the shorter arc between the headings); `None` outside
    /// of the track. Of several samples of one stamp, the `occurrence`-th (from 0, at most the last).
    pub fn at(&self, stamp: i64, occurrence: usize) -> Option<Pose2> {
        let start = self.samples.partition_point(|&(other, _)| other < stamp);
        let end = self.samples.partition_point(|&(other, _)| other <= stamp);
        if start < end {
            return Some(self.samples[(start + occurrence).min(end - 1)].1);
        }
        let (before, from) = self.samples[start.checked_sub(1)?];
        let &(after, to) = self.samples.get(start)?;
        let gap = i128::from(after) - i128::from(before);
        let part = (i128::from(stamp) - i128::from(before)) as f64 / gap as f64;
        Some(Pose2::new(
            from.x + part * (to.x - from.x),
            from.y + part * (to.y - from.y),
            wrap_angle(from.theta + part * wrap_angle(to.theta - from.theta)),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn between_neighbours_but_never_beyond() {
        let track = PoseTrack::new(vec![
            (0, Pose2::new(0.0, 0.0, PI - 0.1)),
            (100, Pose2::new(1.0, 2.0, -PI + 0.3)),
        ])
        .unwrap();
        let pose = track.at(25, 0).unwrap();
        assert_eq!((pose.x, pose.y), (0.25, 0.5));
        assert!(pose.theta.abs() - PI < 1e-15 && (pose.theta - PI).abs() < 1e-12, "{}", pose.theta);
        assert_eq!(track.at(100, 0).unwrap().x, 1.0);
        assert_eq!(track.at(-1, 0), None);
        assert_eq!(track.at(101, 0), None);
        let longer = track.extended_by(&[(50, Pose2::IDENTITY), (200, Pose2::new(3.0, 2.0, 0.0))]);
        assert_eq!(longer.span(), (0, 200));
        assert_eq!(longer.at(150, 0).unwrap().x, 2.0);
        assert_eq!(longer.at(50, 0).unwrap().x, 0.5);
    }

    #[test]
    fn poses_of_one_stamp_stay_in_order() {
        let at = |x| Pose2::new(x, 0.0, 0.0);
        let track = PoseTrack::new(vec![(5, at(1.0)), (9, at(2.0)), (5, at(3.0))]).unwrap();
        let found: Vec<f64> = (0..3).map(|k| track.at(5, k).unwrap().x).collect();
        assert_eq!(found, [1.0, 3.0, 3.0]);
    }
}
