use std::collections::HashMap;

use mcl_core::memory::{check_room, with_room};
use mcl_core::{Bounds, OutOfMemory, Point, TIE_DISTANCE, math};

use crate::MapError;

/// Relative width of the bracket at which bisection on the cell size stops.
const BISECTION_WIDTH: f64 = 1e-12;
/// Limit of cell indices, below which every integer is representable as a float.
const MAX_CELL_INDEX: f64 = (1u64 << 52) as f64;

/// What out-of-memory errors call this memory.
const CELLS: &str = "cells of a grid";

/// Position of the grid lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GridOffset<const D: usize> {
    /// A corner of a cell, in metres.
    Metres(Point<D>),
    /// A corner of a cell as a fraction of the cell size; random offsets are uniform in [0, 1) per axis.
    Cells(Point<D>),
}

impl<const D: usize> GridOffset<D> {
    /// Grid lines through the origin.
    pub const ORIGIN: Self = GridOffset::Metres([0.0; D]);

    fn metres(&self, cell: f64) -> Point<D> {
        match *self {
            GridOffset::Metres(offset) => offset,
            GridOffset::Cells(fraction) => fraction.map(|u| u * cell),
        }
    }

    fn check(&self) -> Result<(), MapError> {
        let (GridOffset::Metres(offset) | GridOffset::Cells(offset)) = self;
        match offset.iter().find(|value| !value.is_finite()) {
            Some(&value) => Err(MapError::Setting {
                setting: "grid offset",
                value,
                expected: "a finite number",
            }),
            None => Ok(()),
        }
    }
}

/// Result of grid-based sampling.
#[derive(Debug, Clone, PartialEq)]
pub struct GridSample<const D: usize> {
    /// Indices of the kept points, ascending.
    pub indices: Vec<usize>,
    /// Edge length of a cell in metres.
    pub cell: f64,
    /// A corner of a cell in metres.
    pub offset: Point<D>,
}

/// Samples points on a grid of a given cell size (paper, section IV-A): each non-empty cell keeps the point
/// nearest to the mean of its points, which minimizes equation 6. The cell of a point is
/// `floor((p − offset)/cell)` per axis. Distances within 10⁻⁹ m of the smallest are ties, and the point with the
/// lowest index wins.
///
/// The points must be finite. O(N).
///
/// # Errors
/// [`MapError::Setting`] unless `cell` is positive and the offset finite; [`MapError::CellIndex`] for
/// cells too small for the coordinates; [`MapError::Memory`].
pub fn sample_grid<const D: usize>(
    points: &[Point<D>],
    cell: f64,
    offset: GridOffset<D>,
) -> Result<GridSample<D>, MapError> {
    if !(cell.is_finite() && cell > 0.0) {
        return Err(MapError::Setting {
            setting: "cell (m)",
            value: cell,
            expected: "a positive number",
        });
    }
    offset.check()?;
    let offset = offset.metres(cell);
    let grid = Grid::over(points, cell, offset)?;
    let (cells, count) = grid.number_cells(points)?;
    Ok(GridSample { indices: keep_nearest_to_mean(points, &cells, count)?, cell, offset })
}

/// Samples points on a grid, with the cell size chosen by bisection for the largest result of at most `size` points.
/// The number of non-empty cells is not monotonic in the cell size, so the result may be a few points short; the
/// sample contains the cell size used.
///
/// Grid lines through one fixed point can separate the points however large the cells are (points on
/// both sides of the origin fall in different cells at any size). If that makes `size` impossible,
/// the grid is shifted by half a cell; see the `offset` of the sample.
///
/// Requires one or more finite points and `1 ≤ size`. O(N) per bisection step.
///
/// # Errors
/// As [`sample_grid`].
pub fn sample_grid_of_size<const D: usize>(
    points: &[Point<D>],
    size: usize,
    offset: GridOffset<D>,
) -> Result<GridSample<D>, MapError> {
    debug_assert!(size >= 1);
    offset.check()?;
    let Some(bounds) = Bounds::of(points) else {
        return Ok(GridSample { indices: Vec::new(), cell: f64::INFINITY, offset: [0.0; D] });
    };
    let count = |cell: f64, offset: &GridOffset<D>| -> Result<usize, MapError> {
        Ok(Grid::over(points, cell, offset.metres(cell))?.count_cells(points)?)
    };
    // Larger than any distance from the grid corner to a point, so every axis has at most two cells.
    let reach =
        bounds.min.iter().chain(&bounds.max).map(|coordinate| coordinate.abs()).fold(1.0, f64::max);
    let largest_offset = offset.metres(0.0).iter().map(|o| o.abs()).fold(0.0, f64::max);
    let mut large = 4.0 * (reach + largest_offset);
    let mut offset = offset;
    if count(large, &offset)? > size {
        offset = GridOffset::Cells([0.5; D]);
        debug_assert_eq!(count(large, &offset)?, 1);
    }
    // The bracket: `large` gives at most `size` cells; `small`, once found, gives more.
    let mut best = (count(large, &offset)?, large);
    let smallest = reach.max(largest_offset) * 4.0 / MAX_CELL_INDEX;
    let mut small = 0.0;
    while best.0 < size && large - small > BISECTION_WIDTH * large && large > smallest {
        // Geometric steps until the bracket has a lower end, because cell sizes span orders of magnitude.
        let middle =
            if small == 0.0 { (0.25 * large).max(smallest) } else { 0.5 * (small + large) };
        let found = count(middle, &offset)?;
        if found > size {
            small = middle;
        } else {
            large = middle;
            if found > best.0 {
                best = (found, middle);
            }
        }
    }
    sample_grid(points, best.1, offset)
}

/// A grid of cells over the bounding box of the points.
struct Grid<const D: usize> {
    cell: f64,
    offset: Point<D>,
    /// Cell index of the box's lower corner.
    first: [i64; D],
    /// Number of cells per axis.
    shape: [u64; D],
    /// Number of cells in the box; `None` on overflow.
    cells: Option<u64>,
}

impl<const D: usize> Grid<D> {
    fn over(points: &[Point<D>], cell: f64, offset: Point<D>) -> Result<Self, MapError> {
        let mut grid = Grid { cell, offset, first: [0; D], shape: [0; D], cells: Some(0) };
        let Some(bounds) = Bounds::of(points) else { return Ok(grid) };
        for corner in [bounds.min, bounds.max] {
            for (coordinate, offset) in corner.iter().zip(offset) {
                if ((coordinate - offset) / cell).abs() >= MAX_CELL_INDEX {
                    return Err(MapError::CellIndex { cell, coordinate: coordinate - offset });
                }
            }
        }
        grid.first = grid.cell_of(&bounds.min);
        let last = grid.cell_of(&bounds.max);
        grid.shape = std::array::from_fn(|axis| (last[axis] - grid.first[axis] + 1) as u64);
        grid.cells = grid.shape.iter().try_fold(1u64, |product, &n| product.checked_mul(n));
        Ok(grid)
    }

    #[inline]
    fn cell_of(&self, point: &Point<D>) -> [i64; D] {
        std::array::from_fn(|axis| ((point[axis] - self.offset[axis]) / self.cell).floor() as i64)
    }

    /// Index of the cell of a point in the box, first axis fastest. Requires `cells`.
    #[inline]
    fn position(&self, point: &Point<D>) -> u64 {
        let cell = self.cell_of(point);
        (0..D).rev().fold(0, |position, axis| {
            position * self.shape[axis] + (cell[axis] - self.first[axis]) as u64
        })
    }

    /// The number of cells in the box if a table of them, with `bits` per cell, takes at most a small multiple of the
    /// memory of the points.
    fn table_len(&self, points: usize, bits: u64) -> Option<usize> {
        const SMALL: u64 = 1 << 25;
        let affordable = SMALL.max(8 * 64 * points as u64) / bits;
        self.cells.filter(|&cells| cells <= affordable).map(|cells| cells as usize)
    }

    fn count_cells(&self, points: &[Point<D>]) -> Result<usize, OutOfMemory> {
        let Some(cells) = self.table_len(points.len(), 1) else {
            return Ok(self.number_cells(points)?.1);
        };
        check_room(cells.div_ceil(64), size_of::<u64>(), CELLS)?;
        let mut seen = vec![0u64; cells.div_ceil(64)];
        let mut count = 0;
        for point in points {
            let position = self.position(point);
            let (word, bit) = ((position / 64) as usize, 1u64 << (position % 64));
            count += usize::from(seen[word] & bit == 0);
            seen[word] |= bit;
        }
        Ok(count)
    }

    /// Numbers the non-empty cells from 0 in order of first appearance; returns the number of each point's cell, and
    /// the number of cells.
    fn number_cells(&self, points: &[Point<D>]) -> Result<(Vec<u32>, usize), OutOfMemory> {
        const EMPTY: u32 = u32::MAX;
        let mut next = 0u32;
        let mut number = |slot: &mut u32| {
            if *slot == EMPTY {
                *slot = next;
                next += 1;
            }
            *slot
        };
        let mut numbers = with_room(points.len(), CELLS)?;
        if let Some(cells) = self.table_len(points.len(), 32) {
            let mut table = with_room(cells, CELLS)?;
            table.resize(cells, EMPTY);
            let slots = points.iter().map(|point| self.position(point) as usize);
            numbers.extend(slots.map(|slot| number(&mut table[slot])));
        } else {
            let mut table = HashMap::new();
            for point in points {
                table.try_reserve(1).map_err(|_| OutOfMemory {
                    what: CELLS,
                    bytes: size_of::<([i64; D], u32)>() * 2 * table.len(),
                })?;
                numbers.push(number(table.entry(self.cell_of(point)).or_insert(EMPTY)));
            }
        }
        Ok((numbers, next as usize))
    }
}

/// For each of `count` cells, finds the point nearest to the mean of its points; returns ascending indices.
fn keep_nearest_to_mean<const D: usize>(
    points: &[Point<D>],
    cells: &[u32],
    count: usize,
) -> Result<Vec<usize>, OutOfMemory> {
    #[derive(Clone, Copy)]
    struct Cell<const D: usize> {
        first: Point<D>,
        /// Sum of the displacements of the points from `first`, so that points far from the origin lose
        /// no digits; later the mean.
        mean: Point<D>,
        points: f64,
        /// Smallest distance of a point from the mean, first squared.
        nearest: f64,
        kept: usize,
    }
    let mut table = with_room(count, CELLS)?;
    table.resize(
        count,
        Cell { first: [0.0; D], mean: [0.0; D], points: 0.0, nearest: f64::INFINITY, kept: 0 },
    );
    for (point, &cell) in points.iter().zip(cells) {
        let cell = &mut table[cell as usize];
        if cell.points == 0.0 {
            cell.first = *point;
        }
        cell.points += 1.0;
        for axis in 0..D {
            cell.mean[axis] += point[axis] - cell.first[axis];
        }
    }
    for cell in &mut table {
        for axis in 0..D {
            cell.mean[axis] /= cell.points;
        }
    }
    let distance_squared = |cell: &Cell<D>, point: &Point<D>| {
        (0..D)
            .map(|axis| math::square(point[axis] - cell.first[axis] - cell.mean[axis]))
            .sum::<f64>()
    };
    for (point, &cell) in points.iter().zip(cells) {
        let cell = &mut table[cell as usize];
        cell.nearest = cell.nearest.min(distance_squared(cell, point));
    }
    for cell in &mut table {
        cell.nearest = cell.nearest.sqrt();
    }
    // Backwards, so that the tied point with the lowest index is written last.
    for (index, (point, &cell)) in points.iter().zip(cells).enumerate().rev() {
        let cell = &mut table[cell as usize];
        let limit = cell.nearest + TIE_DISTANCE;
        if distance_squared(cell, point) <= limit * limit {
            cell.kept = index;
        }
    }
    let mut kept = with_room(count, CELLS)?;
    kept.extend(table.iter().map(|cell| cell.kept));
    kept.sort_unstable();
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Direct implementation of the definition.
    fn brute_force(points: &[Point<2>], cell: f64, offset: Point<2>) -> Vec<usize> {
        let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
        for (index, p) in points.iter().enumerate() {
            let key = [0, 1].map(|axis| ((p[axis] - offset[axis]) / cell).floor() as i64);
            cells.entry(key).or_default().push(index);
        }
        let mut kept: Vec<usize> = cells
            .values()
            .map(|members| {
                let mean = [0, 1].map(|axis| {
                    members.iter().map(|&i| points[i][axis]).sum::<f64>() / members.len() as f64
                });
                let distance = |i: usize| (points[i][0] - mean[0]).hypot(points[i][1] - mean[1]);
                let smallest = members.iter().map(|&i| distance(i)).fold(f64::INFINITY, f64::min);
                *members.iter().find(|&&i| distance(i) <= smallest + TIE_DISTANCE).unwrap()
            })
            .collect();
        kept.sort_unstable();
        kept
    }

    /// Coordinates on a lattice, so that ties and duplicates are common.
    fn points() -> impl Strategy<Value = Vec<Point<2>>> {
        prop::collection::vec((-40..40i32, -40..40i32), 1..200).prop_map(|lattice| {
            lattice.iter().map(|&(x, y)| [f64::from(x) * 0.25, f64::from(y) * 0.25]).collect()
        })
    }

    proptest! {
        #[test]
        fn keeps_what_the_definition_says(
            points in points(),
            cell in prop::sample::select(vec![0.1, 0.5, 0.7, 1.0, 3.0, 50.0]),
            offset in prop::sample::select(vec![0.0, 0.25, -0.3, 100.0]),
        ) {
            let sample = sample_grid(&points, cell, GridOffset::Metres([offset, -offset])).unwrap();
            prop_assert_eq!(sample.indices, brute_force(&points, cell, [offset, -offset]));
        }

        #[test]
        fn the_table_and_the_hash_map_agree(points in points(), cell in 0.1..5.0f64) {
            // A point 10,000 km away makes the table too large.
            let mut far = points.clone();
            far.push([1e7, 1e7]);
            let near = sample_grid(&points, cell, GridOffset::ORIGIN).unwrap();
            let mut far = sample_grid(&far, cell, GridOffset::ORIGIN).unwrap();
            prop_assert_eq!(far.indices.pop(), Some(points.len()));
            prop_assert_eq!(near.indices, far.indices);
        }

        #[test]
        fn a_requested_size_is_never_exceeded(points in points(), size in 1..250usize, u in 0.0..1.0f64) {
            let sample = sample_grid_of_size(&points, size, GridOffset::Cells([u, 1.0 - u])).unwrap();
            prop_assert!((1..=size).contains(&sample.indices.len()));
            prop_assert_eq!(
                &sample.indices,
                &sample_grid(&points, sample.cell, GridOffset::Metres(sample.offset)).unwrap().indices
            );
        }
    }

    #[test]
    fn every_size_from_one_to_all_distinct_points() {
        let points: Vec<Point<2>> =
            (0..64).map(|i| [f64::from(i % 8) - 3.7, f64::from(i / 8) * 1.3 - 4.1]).collect();
        let lens: Vec<usize> = [1, 2, 64, 1000]
            .iter()
            .map(|&k| sample_grid_of_size(&points, k, GridOffset::ORIGIN).unwrap().indices.len())
            .collect();
        assert_eq!(lens[0], 1);
        assert!(lens[1] <= 2);
        assert_eq!(lens[2..], [64, 64]);
    }

    /// Points on both sides of the origin never share a cell of a grid through the origin.
    #[test]
    fn a_grid_that_separates_the_points_at_any_size_is_shifted_and_says_so() {
        let points = [[-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [1.1, -1.0]];
        let four = sample_grid_of_size(&points, 4, GridOffset::ORIGIN).unwrap();
        assert_eq!((four.indices.len(), four.offset), (4, [0.0, 0.0]));
        let one = sample_grid_of_size(&points, 1, GridOffset::ORIGIN).unwrap();
        assert_eq!(one.indices.len(), 1);
        assert_eq!(one.offset, [0.5 * one.cell; 2]);
    }

    #[test]
    fn duplicates_count_once() {
        let points = [[2.0, 3.0]; 100];
        let sample = sample_grid_of_size(&points, 50, GridOffset::ORIGIN).unwrap();
        assert_eq!(sample.indices, [0]);
    }

    /// The same points are kept near the origin and at UTM coordinates.
    #[test]
    fn far_from_the_origin_no_digit_is_lost() {
        // Multiples of 2⁻¹⁰ m: exact in both frames.
        let near: Vec<Point<2>> = (0..5000u64)
            .map(|i| {
                let noise = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                [(noise >> 50) as f64 / 1024.0, (noise >> 20 & 0x3fff) as f64 / 1024.0]
            })
            .collect();
        let (east, north) = (524_288.0, 4_194_304.0);
        let far: Vec<Point<2>> = near.iter().map(|p| [p[0] + east, p[1] + north]).collect();
        let near = sample_grid(&near, 0.5, GridOffset::ORIGIN).unwrap();
        let far = sample_grid(&far, 0.5, GridOffset::ORIGIN).unwrap();
        assert!(near.indices.len() > 900);
        assert_eq!(near.indices, far.indices);
    }

    #[test]
    fn three_dimensions() {
        let points = [[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.1, 0.1, 1.1], [0.3, 0.1, 0.1]];
        let sample = sample_grid(&points, 1.0, GridOffset::ORIGIN).unwrap();
        assert_eq!(sample.indices, [1, 2]);
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let points = [[1.0, 1.0]];
        for cell in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(sample_grid(&points, cell, GridOffset::ORIGIN).is_err(), "{cell}");
        }
        assert!(sample_grid(&points, 1.0, GridOffset::Metres([f64::NAN, 0.0])).is_err());
        assert!(matches!(
            sample_grid(&[[1e6, 0.0]], 1e-12, GridOffset::ORIGIN),
            Err(MapError::CellIndex { .. })
        ));
    }
}
