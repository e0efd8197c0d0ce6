use mcl_core::{Bounds, LineSegment, Point, SegmentMap, math};

use super::grid_builder::CellBlock;
use crate::FilterError;
use crate::check::check_length;

/// Approximate number of cells, and the limit per side. Results do not depend on it.
const CELLS: f64 = (1u64 << 17) as f64;
/// Largest number of candidates examined while building, per segment and cell. Once it is reached (thousands of
/// nearly equal segments are candidates everywhere), the remaining cells share the lists of larger blocks.
const WORK: usize = 128;

/// Exact distances to the nearest segment of a map, from a grid in which each cell lists the segments that
/// can be the nearest to some point in it. Distances are not rounded to cells: each is the minimum of
/// [`LineSegment::distance_squared`] over all segments.
pub struct SegmentDistances {
    segments: Vec<LineSegment>,
    /// Lower left corner of the first cell.
    origin: Point<2>,
    /// Edge length of a cell (m).
    cell: f64,
    columns: usize,
    rows: usize,
    /// Start and end of the list of each cell, row by row.
    cells: Vec<[u32; 2]>,
    /// Indices of segments.
    listed: Vec<u32>,
    bounds: Bounds<2>,
    max_distance: f64,
}

impl SegmentDistances {
    /// Indexes a map, with distances truncated at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance` out of range.
    pub fn build(map: &SegmentMap, max_distance: f64) -> Result<Self, FilterError> {
        check_length("max_distance", max_distance)?;
        let mut segments = map.segments().to_vec();
        // Duplicates would be listed repeatedly.
        let ends = |segment: &LineSegment| [segment.start, segment.end];
        segments.sort_by(|a, b| ends(a).partial_cmp(&ends(b)).expect("ends are finite"));
        segments.dedup();
        let bounds = Bounds::around(segments.iter().flat_map(|s| [s.start, s.end]))
            .expect("a map has at least one segment");
        let largest = bounds.min.iter().chain(&bounds.max).fold(0.0f64, |l, c| c.abs().max(l));
        // More than the rounding of distances between coordinates of this size and the maximum distance.
        let rounding = 16.0 * f64::EPSILON * (largest + max_distance);
        let reach = max_distance + rounding;
        let [width, height] = [0, 1].map(|axis| bounds.extent(axis) + 2.0 * reach);
        let cell = (width * height / CELLS).sqrt().max(width.max(height) / CELLS);
        let [columns, rows] = [width, height].map(|length| (length / cell) as usize + 1);
        let all: Vec<u32> = (0..segments.len() as u32).collect();
        let mut distances = SegmentDistances {
            origin: bounds.min.map(|coordinate| coordinate - reach),
            cell,
            columns,
            rows,
            cells: vec![[0; 2]; columns * rows],
            listed: Vec::new(),
            bounds,
            max_distance,
            segments,
        };
        // The lists have at most as many entries as candidates were examined, and indices are `u32`.
        let work = WORK * (distances.segments.len() + distances.cells.len());
        let mut work = work.min(1 << 31);
        let whole = CellBlock { column: 0, row: 0, columns, rows };
        distances.fill(whole, &all, rounding, &mut work);
        Ok(distances)
    }

    /// Lists the segments that can be nearest to points in a block, given those of a larger block.
    fn fill(&mut self, block: CellBlock, candidates: &[u32], rounding: f64, work: &mut usize) {
        let near = self.near(block, candidates, rounding);
        *work = work.saturating_sub(candidates.len());
        // A list of at most one candidate is the same for every part.
        if let Some(halves) = block.halves()
            && near.len() > 1
            && *work > 0
        {
            for half in halves {
                self.fill(half, &near, rounding, work);
            }
            return;
        }
        let first = self.listed.len() as u32;
        self.listed.extend(near);
        let list = [first, self.listed.len() as u32];
        for row in block.row..block.row + block.rows {
            let start = row * self.columns + block.column;
            self.cells[start..start + block.columns].fill(list);
        }
    }

    /// The candidates that can be nearest to some point in a block and within the maximum distance. Distances differ
    /// from that at its centre by at most half the diagonal.
    fn near(&self, block: CellBlock, candidates: &[u32], rounding: f64) -> Vec<u32> {
        let [columns, rows] = [block.columns, block.rows].map(|number| 0.5 * number as f64);
        let radius = self.cell * math::hypot(columns, rows) + rounding;
        let middle = [
            self.origin[0] + (block.column as f64 + columns) * self.cell,
            self.origin[1] + (block.row as f64 + rows) * self.cell,
        ];
        let distances: Vec<f64> = candidates
            .iter()
            .map(|&index| self.segments[index as usize].distance_squared(&middle).sqrt())
            .collect();
        let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
        let limit = (nearest + radius).min(self.max_distance) + radius;
        let pairs = candidates.iter().zip(&distances);
        pairs.filter(|(_, distance)| **distance <= limit).map(|(index, _)| *index).collect()
    }

    /// Distance at which distances are truncated (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// Bounding box of the segments.
    pub fn bounds(&self) -> Bounds<2> {
        self.bounds
    }

    /// min(d², max_distance²) in m², with d the distance from a finite point to the nearest segment.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        let [x, y] = [0, 1].map(|axis| (point[axis] - self.origin[axis]) / self.cell);
        let cut = self.max_distance * self.max_distance;
        if !(x >= 0.0 && y >= 0.0 && x < self.columns as f64 && y < self.rows as f64) {
            return cut;
        }
        let [start, end] = self.cells[y as usize * self.columns + x as usize];
        let near = &self.listed[start as usize..end as usize];
        near.iter().fold(cut, |least, &index| {
            least.min(self.segments[index as usize].distance_squared(&point))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;
    use proptest::prelude::*;
    use rand::RngExt;

    /// An independent implementation of [`LineSegment::distance_squared`]: the perpendicular beside the segment, the
    /// nearer end beyond its ends.
    fn distance(segment: &LineSegment, place: Point<2>) -> f64 {
        let to = |end: Point<2>| (place[0] - end[0]).hypot(place[1] - end[1]);
        let ends = to(segment.start).min(to(segment.end));
        let along = [0, 1].map(|axis| segment.end[axis] - segment.start[axis]);
        let dot =
            |from: Point<2>| along[0] * (place[0] - from[0]) + along[1] * (place[1] - from[1]);
        if segment.length() == 0.0 || dot(segment.start) <= 0.0 || dot(segment.end) >= 0.0 {
            return ends;
        }
        let [x, y] = [0, 1].map(|axis| place[axis] - segment.start[axis]);
        ((along[0] * y - along[1] * x) / segment.length()).abs()
    }

    /// Panics unless the distances equal those of a search through all segments.
    fn compare(segments: &[LineSegment], max_distance: f64, seed: u64) {
        let map = SegmentMap::new(segments.to_vec()).unwrap();
        let distances = SegmentDistances::build(&map, max_distance).unwrap();
        let bounds = distances.bounds();
        let mut rng = Seed::new(seed).rng();
        let margin = 1.5 * max_distance;
        for i in 0..2_000 {
            let segment = segments[rng.random_range(0..segments.len())];
            let (along, u): (f64, [f64; 2]) = (rng.random(), [rng.random(), rng.random()]);
            let place = [0, 1].map(|axis| match i % 3 {
                0 => bounds.min[axis] - margin + u[axis] * (bounds.extent(axis) + 2.0 * margin),
                1 => segment.start[axis] + along * (segment.end[axis] - segment.start[axis]),
                _ => segment.end[axis] + 2.0 * (u[axis] - 0.5) * max_distance,
            });
            let least =
                |distances: &mut dyn Iterator<Item = f64>| distances.fold(f64::MAX, f64::min);
            let cut = max_distance * max_distance;
            let squared = least(&mut segments.iter().map(|s| s.distance_squared(&place))).min(cut);
            assert_eq!(distances.distance_squared(place), squared, "{place:?}");
            let by_hand = least(&mut segments.iter().map(|s| distance(s, place))).min(max_distance);
            assert!((squared.sqrt() - by_hand).abs() < 1e-9, "{place:?}: {squared} for {by_hand}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        /// Coarse coordinates, so that segments meet, overlap, lie on one line or are points.
        #[test]
        fn distances_are_those_of_brute_force(
            ends in prop::collection::vec([-40..40i32, -40..40i32, -40..40i32, -40..40i32], 1..60),
            scale in prop::sample::select(vec![0.25, 0.01, 3.7]),
            shift in prop::sample::select(vec![0.0, 1e4]),
            max_distance in prop::sample::select(vec![0.3, 2.0, 50.0]),
            seed in any::<u64>(),
        ) {
            let place = |x: i32, y: i32| [shift + scale * f64::from(x), scale * f64::from(y)];
            let segments: Vec<LineSegment> = ends
                .iter()
                .map(|&[a, b, c, d]| LineSegment { start: place(a, b), end: place(c, d) })
                .collect();
            compare(&segments, max_distance, seed);
        }
    }

    /// Maps without cells of few candidates, or with almost no width.
    #[test]
    fn hard_maps_are_exact_too() {
        let star = (0..300).map(|i| {
            let (sin, cos) = (f64::from(i) * 0.021).sin_cos();
            LineSegment { start: [0.01 * cos, 0.01 * sin], end: [10.0 * cos, 10.0 * sin] }
        });
        compare(&star.collect::<Vec<_>>(), 2.0, 1);
        let nearly_equal = (0..300).map(|i| {
            let y = 1e-5 * f64::from(i);
            LineSegment { start: [y, y], end: [10.0 - y, 2.0 * y] }
        });
        compare(&nearly_equal.collect::<Vec<_>>(), 2.0, 2);
        compare(&[LineSegment { start: [0.0, 0.0], end: [1e5, 0.0] }; 20], 0.01, 3);
        compare(&[LineSegment { start: [7.0, 7.0], end: [7.0, 7.0] }], 1.0, 4);
    }

    /// When the work limit is reached, cells share lists, and distances stay exact.
    #[test]
    fn without_work_left_lists_are_longer() {
        let mut rng = Seed::new(5).rng();
        let mut place = || [20.0 * rng.random::<f64>(), 20.0 * rng.random::<f64>()];
        let segments: Vec<LineSegment> =
            (0..50).map(|_| LineSegment { start: place(), end: place() }).collect();
        let map = SegmentMap::new(segments.clone()).unwrap();
        let rich = SegmentDistances::build(&map, 2.0).unwrap();
        let mut poor = SegmentDistances::build(&map, 2.0).unwrap();
        let whole = CellBlock { column: 0, row: 0, columns: poor.columns, rows: poor.rows };
        let all: Vec<u32> = (0..50).collect();
        poor.listed.clear();
        poor.fill(whole, &all, 1e-12, &mut 1_000);
        assert!(poor.listed.len() < 2_000 && rich.listed.len() > 50_000, "{}", rich.listed.len());
        for _ in 0..2_000 {
            let place = place();
            assert_eq!(poor.distance_squared(place), rich.distance_squared(place));
        }
    }

    #[test]
    fn a_truncation_that_is_not_a_length_is_refused() {
        let wall = LineSegment { start: [0.0, 0.0], end: [1.0, 0.0] };
        let map = SegmentMap::new(vec![wall]).unwrap();
        assert!(matches!(SegmentDistances::build(&map, 0.0), Err(FilterError::Setting { .. })));
        let far = SegmentDistances::build(&map, 2.0).unwrap();
        assert_eq!(far.distance_squared([-1e300, 1e300]), 4.0);
        assert_eq!(far.bounds(), Bounds { min: [0.0, 0.0], max: [1.0, 0.0] });
    }
}
