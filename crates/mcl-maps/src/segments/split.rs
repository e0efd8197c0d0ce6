use mcl_core::{LineSegment, Point, math};

use super::SegmentSettings;
use super::piece::Piece;

/// A piece of two points needs no split, as they are always on a line.
const MIN_POINTS: usize = 3;

/// Splits a scan, whose points are in beam order, into pieces: runs without gaps, split at the point
/// farthest from the line between their ends as long as that exceeds the tolerance.
///
/// Distances are to the segment between the ends, not to the line through them, because a run may return to where
/// it started.
pub(super) fn split<'a>(
    points: &'a [Point<2>],
    settings: &SegmentSettings,
) -> impl Iterator<Item = Piece> + use<'a> {
    let SegmentSettings { tolerance, max_gap, .. } = *settings;
    let squared =
        |a: &Point<2>, b: &Point<2>| math::square(b[0] - a[0]) + math::square(b[1] - a[1]);
    let mut runs: Vec<&[Point<2>]> =
        points.chunk_by(|a, b| squared(a, b) <= max_gap * max_gap).collect();
    std::iter::from_fn(move || {
        while let Some(run) = runs.pop() {
            let [first, .., last] = run else { continue };
            if run.len() < MIN_POINTS {
                continue;
            }
            let chord = LineSegment { start: *first, end: *last };
            let inner = run.iter().enumerate().take(run.len() - 1).skip(1);
            let (farthest, distance_squared) = inner
                .map(|(index, point)| (index, chord.distance_squared(point)))
                .max_by(|(_, a), (_, b)| a.total_cmp(b))
                .expect("there are three points");
            if distance_squared <= tolerance * tolerance {
                return Some(Piece::of(run));
            }
            let (before, after) = run.split_at(farthest);
            runs.extend([before, after]);
        }
        None
    })
}
