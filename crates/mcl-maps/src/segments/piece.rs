use std::cmp::Ordering;

use mcl_core::{LineSegment, Point, math};

/// Number, mean and scatter of points: sufficient for fitting a line, and computable for the union of two sets of
/// points from those of each.
#[derive(Debug, Clone, Copy)]
struct Moments {
    number: f64,
    mean: Point<2>,
    /// Σ (p − mean)(p − mean)ᵀ in m²: xx, xy and yy.
    scatter: [f64; 3],
}

impl Moments {
    fn of(point: Point<2>) -> Self {
        Moments { number: 1.0, mean: point, scatter: [0.0; 3] }
    }

    /// The moments of the union of both sets of points (T. Chan, G. Golub and R. LeVeque, *Updating Formulae and a
    /// Pairwise Algorithm for Computing Sample Variances*, COMPSTAT 1982).
    fn with(self, other: Moments) -> Self {
        let number = self.number + other.number;
        let [dx, dy] = [0, 1].map(|axis| other.mean[axis] - self.mean[axis]);
        let share = other.number / number;
        let between = self.number * share;
        let [xx, xy, yy] = [0, 1, 2].map(|i| self.scatter[i] + other.scatter[i]);
        Moments {
            number,
            mean: [self.mean[0] + share * dx, self.mean[1] + share * dy],
            scatter: [xx + between * dx * dx, xy + between * dx * dy, yy + between * dy * dy],
        }
    }

    /// Direction of the line with the smallest sum of squared distances: the eigenvector of the larger eigenvalue.
    fn direction(&self) -> Point<2> {
        let [xx, xy, yy] = self.scatter;
        let (sin, cos) = math::sin_cos(0.5 * math::atan2(2.0 * xy, xx - yy));
        [cos, sin]
    }
}

/// Points on a line: their total least squares line, and its extent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    moments: Moments,
    direction: Point<2>,
    /// Positions of the ends along the direction, relative to the mean (m).
    low: f64,
    high: f64,
}

impl Piece {
    /// Fits a piece to one or more points.
    pub fn of(points: &[Point<2>]) -> Self {
        let moments = points.iter().copied().map(Moments::of).reduce(Moments::with);
        Self::reaching(moments.expect("a piece has points"), points.iter().copied())
    }

    /// Fits a piece to all points of this one and of the others.
    pub fn with(&self, others: &[Piece]) -> Self {
        let moments = others.iter().fold(self.moments, |sum, piece| sum.with(piece.moments));
        let ends = others.iter().chain([self]).flat_map(|piece| [piece.start(), piece.end()]);
        Self::reaching(moments, ends)
    }

    /// The piece from the first to the last of these positions along the line.
    fn reaching(moments: Moments, places: impl Iterator<Item = Point<2>>) -> Self {
        let direction = moments.direction();
        let mut piece = Piece { moments, direction, low: 0.0, high: 0.0 };
        for place in places {
            let [along, _] = piece.seen(place);
            (piece.low, piece.high) = (piece.low.min(along), piece.high.max(along));
        }
        piece
    }

    /// A position in the frame of the line: along it and to its left, relative to the mean (m).
    fn seen(&self, place: Point<2>) -> Point<2> {
        let [x, y] = [0, 1].map(|axis| place[axis] - self.moments.mean[axis]);
        let [cos, sin] = self.direction;
        [cos * x + sin * y, cos * y - sin * x]
    }

    fn at(&self, along: f64) -> Point<2> {
        [0, 1].map(|axis| self.moments.mean[axis] + along * self.direction[axis])
    }

    fn start(&self) -> Point<2> {
        self.at(self.low)
    }

    fn end(&self) -> Point<2> {
        self.at(self.high)
    }

    /// Whether another piece lies on this line: within `tolerance` of it, and separated from this piece by at most
    /// `max_gap` along it (m).
    pub fn goes_on_in(&self, other: &Piece, tolerance: f64, max_gap: f64) -> bool {
        let [start, end] = [other.start(), other.end()].map(|place| self.seen(place));
        start[1].abs() <= tolerance
            && end[1].abs() <= tolerance
            && start[0].min(end[0]) <= self.high + max_gap
            && start[0].max(end[0]) >= self.low - max_gap
    }

    /// Number of points.
    pub fn points(&self) -> f64 {
        self.moments.number
    }

    pub fn segment(&self) -> LineSegment {
        LineSegment { start: self.start(), end: self.end() }
    }

    /// Orders by length, shortest first. Only pieces that are identical in all bits are equal, so that the order does
    /// not depend on that of the input.
    pub fn by_length(&self, other: &Piece) -> Ordering {
        let key = |piece: &Piece| {
            let Moments { number, mean: [x, y], scatter: [xx, xy, yy] } = piece.moments;
            [piece.high - piece.low, piece.low, number, x, y, xx, xy, yy]
        };
        let (key, other) = (key(self), key(other));
        let differ = key.iter().zip(&other).map(|(a, b)| a.total_cmp(b));
        differ.fold(Ordering::Equal, Ordering::then)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_line_by_hand() {
        // About (2, 1): (−2, −1), (0, 0.5), (0, −0.5), (2, 1). xx = 8, xy = 4, yy = 2.5, so that the direction
        // is atan2(8, 5.5)/2; the first and the last point are equally far from the mean along it.
        let piece = Piece::of(&[[0.0, 0.0], [2.0, 1.5], [2.0, 0.5], [4.0, 2.0]]);
        let angle = 0.5 * 8f64.atan2(5.5);
        let reach = 2.0 * angle.cos() + angle.sin();
        let LineSegment { start, end } = piece.segment();
        for (found, sign) in [(start, -1.0), (end, 1.0)] {
            let expected = [2.0 + sign * reach * angle.cos(), 1.0 + sign * reach * angle.sin()];
            assert!((found[0] - expected[0]).abs() < 1e-12, "{found:?} for {expected:?}");
            assert!((found[1] - expected[1]).abs() < 1e-12, "{found:?} for {expected:?}");
        }
    }

    #[test]
    fn a_piece_goes_on_beside_and_behind_itself() {
        let wall = |x: f64, y: f64, end: f64, to: f64| Piece::of(&[[x, y], [end, to]]);
        let long = wall(0.0, 0.0, 4.0, 0.0);
        for (other, expected) in [
            (wall(1.0, 0.05, 2.0, -0.05), true),
            (wall(4.4, 0.0, 6.0, 0.09), true),
            (wall(-3.0, 0.0, -0.4, 0.0), true),
            // Too far beside it at one end, beyond either end; across it.
            (wall(1.0, 0.0, 2.0, 0.11), false),
            (wall(4.6, 0.0, 6.0, 0.0), false),
            (wall(-3.0, 0.0, -0.6, 0.0), false),
            (wall(2.0, -1.0, 2.0, 1.0), false),
        ] {
            assert_eq!(long.goes_on_in(&other, 0.1, 0.5), expected, "{:?}", other.segment());
        }
    }

    proptest! {
        /// Merging the parts gives the fit to all points, in the order of the points or reversed.
        #[test]
        fn merging_is_fitting_all_points(
            points in prop::collection::vec([-5.0..5.0f64, -0.5..0.5f64], 3..60),
            cuts in prop::collection::vec(0.0..1.0f64, 0..5),
            far in prop::sample::select(vec![0.0, 1e6]),
        ) {
            let points: Vec<Point<2>> = points.iter().map(|[x, y]| [x + far, x + y - far]).collect();
            let mut cuts: Vec<usize> =
                cuts.iter().map(|cut| (cut * points.len() as f64) as usize).collect();
            cuts.extend([0, points.len()]);
            cuts.sort_unstable();
            cuts.dedup();
            let parts: Vec<Piece> =
                cuts.windows(2).map(|cut| Piece::of(&points[cut[0]..cut[1]])).collect();
            let whole = Piece::of(&points);
            let forwards = parts[0].with(&parts[1..]);
            let mut backwards = parts;
            backwards.reverse();
            let backwards = backwards[0].with(&backwards[1..]);
            for merged in [forwards, backwards] {
                let (found, expected) = (merged.moments, whole.moments);
                prop_assert_eq!(found.number, expected.number);
                let values = |moments: Moments| {
                    let ([x, y], [xx, xy, yy]) = (moments.mean, moments.scatter);
                    [x, y, xx, xy, yy]
                };
                for (found, expected) in values(found).iter().zip(values(expected)) {
                    prop_assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()));
                }
            }
        }
    }
}
