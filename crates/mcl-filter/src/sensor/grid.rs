//! The grid behind [`DistanceField`](super::DistanceField): which map points can be nearest to some
//! place in a cell.

use mcl_core::{Bounds, Point, PointMap};

/// Cells per map point, and limits of the number of cells: more cells take more memory and time to
/// build and have shorter lists. Results do not depend on them.
const CELLS_PER_POINT: usize = 64;
const MIN_CELLS: usize = 1 << 14;
const MAX_CELLS: usize = 1 << 20;
/// A cell with more points than this is left to the tree, so that no query takes long.
const MAX_LIST: usize = 64;
/// Lists stop growing at this many entries in all (256 MiB); further cells are left to the tree.
const MAX_ENTRIES: usize = 1 << 24;
/// In place of a list's length: left to the tree.
const CROWDED: u32 = u32::MAX;

/// What a cell knows.
pub(super) enum Cell<'a> {
    /// Every point that is nearest, and nearer than the cut, to some place in the cell.
    Listed(&'a [Point<2>]),
    /// Too many such points to list.
    Crowded,
}

/// Where a cell's list starts among the entries, and its length or [`CROWDED`].
#[derive(Clone, Copy)]
struct List {
    start: u32,
    length: u32,
}

/// A uniform grid over a map and everything within the cut of it.
pub(super) struct Grid {
    /// Lower left corner; nothing outside the grid is nearer to a point than the cut.
    origin: Point<2>,
    cell: f64,
    inverse_cell: f64,
    columns: usize,
    rows: usize,
    /// One list per cell, row by row. Neighbouring cells' lists lie near each other.
    lists: Vec<List>,
    entries: Vec<Point<2>>,
}

impl Grid {
    /// `max_distance` (m): a checked length.
    pub(super) fn build(map: &PointMap<2>, max_distance: f64) -> Self {
        let mut points = map.points().to_vec();
        // Equal points would be listed as often as they occur.
        points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        points.dedup();
        let mut grid = Grid::empty(map.bounds(), points.len(), max_distance);
        let largest = largest_coordinate(&map.bounds());
        let builder = Builder {
            points: &points,
            max_distance_squared: max_distance * max_distance,
            margin: 1e-9 * grid.cell + rounding_margin(largest, max_distance),
        };
        // Candidates of the block of cells at hand, on top of those of the blocks it is a part of.
        let mut stack: Vec<u32> = (0..points.len() as u32).collect();
        let whole = Block { column: 0, row: 0, columns: grid.columns, rows: grid.rows };
        builder.fill(&mut grid, whole, &mut stack, 0);
        grid
    }

    /// A grid over everything within `max_distance` of the points' box, without lists.
    fn empty(bounds: Bounds<2>, points: usize, max_distance: f64) -> Self {
        let largest = largest_coordinate(&bounds);
        let reach = max_distance + rounding_margin(largest, max_distance);
        let origin = bounds.min.map(|coordinate| coordinate - reach);
        let [width, height] = [0, 1].map(|axis| bounds.extent(axis) + 2.0 * reach);
        let wanted = points.saturating_mul(CELLS_PER_POINT).clamp(MIN_CELLS, MAX_CELLS) as f64;
        // No side is cut into more than `wanted` parts, so that a long and narrow map does not get
        // many more cells than that: with c columns and r rows at this cell size,
        // (c + 1)(r + 1) ≤ wanted + c + r + 1 ≤ 3·wanted + 1.
        let cell = (width * height / wanted).sqrt().max(width.max(height) / wanted);
        let parts = |length: f64| (length / cell).ceil().max(1.0) as usize;
        let (columns, rows) = (parts(width), parts(height));
        Grid {
            origin,
            cell,
            inverse_cell: cell.recip(),
            columns,
            rows,
            lists: vec![List { start: 0, length: 0 }; columns * rows],
            entries: Vec::new(),
        }
    }

    /// The cell of a place. Outside the grid no point is near, and the list is empty.
    #[inline]
    pub(super) fn cell_at(&self, [x, y]: Point<2>) -> Cell<'_> {
        let column = (x - self.origin[0]) * self.inverse_cell;
        let row = (y - self.origin[1]) * self.inverse_cell;
        // The casts below saturate: too large stays too large, but below 0 would become 0.
        if !(column >= 0.0 && row >= 0.0) {
            return Cell::Listed(&[]);
        }
        let (column, row) = (column as usize, row as usize);
        if column >= self.columns || row >= self.rows {
            return Cell::Listed(&[]);
        }
        let List { start, length } = self.lists[row * self.columns + column];
        if length == CROWDED {
            return Cell::Crowded;
        }
        Cell::Listed(&self.entries[start as usize..][..length as usize])
    }
}

fn largest_coordinate(bounds: &Bounds<2>) -> f64 {
    bounds.min.iter().chain(&bounds.max).fold(0.0, |largest, c| c.abs().max(largest))
}

/// More than the rounding of a sum or difference of coordinates of this size and the cut.
fn rounding_margin(largest_coordinate: f64, max_distance: f64) -> f64 {
    16.0 * f64::EPSILON * (largest_coordinate + max_distance)
}

/// A rectangle of cells.
#[derive(Clone, Copy)]
struct Block {
    column: usize,
    row: usize,
    columns: usize,
    rows: usize,
}

impl Block {
    /// The two halves across the longer side; `None` for a single cell.
    fn halves(self) -> Option<[Block; 2]> {
        if self.columns >= self.rows && self.columns > 1 {
            let left = self.columns / 2;
            let right = self.columns - left;
            Some([
                Block { columns: left, ..self },
                Block { column: self.column + left, columns: right, ..self },
            ])
        } else if self.rows > 1 {
            let lower = self.rows / 2;
            let upper = self.rows - lower;
            Some([
                Block { rows: lower, ..self },
                Block { row: self.row + lower, rows: upper, ..self },
            ])
        } else {
            None
        }
    }
}

/// Fills a grid from coarse to fine: a point that is never nearest within a block of cells need not
/// be looked at again within it.
struct Builder<'a> {
    points: &'a [Point<2>],
    max_distance_squared: f64,
    /// By how much (m) cells are taken larger than they are, so that a place which rounding assigns
    /// to the cell beside its own still finds its nearest point there.
    margin: f64,
}

impl Builder<'_> {
    /// Lists the points for each cell of the block; its candidates are `stack[from..]`.
    fn fill(&self, grid: &mut Grid, block: Block, stack: &mut Vec<u32>, from: usize) {
        let kept_from = stack.len();
        self.keep_nearest(grid, block, stack, from);
        if stack.len() > kept_from {
            match block.halves() {
                Some(halves) => {
                    for half in halves {
                        self.fill(grid, half, stack, kept_from);
                    }
                }
                None => self.list(grid, block, &stack[kept_from..]),
            }
        }
        stack.truncate(kept_from);
    }

    /// Pushes those of the candidates `stack[from..]` that can be nearest somewhere in the block.
    ///
    /// The places nearer to a point q than to a point p are a half-plane. When all four corners of a
    /// block are in it then so is the block, and p is nearest nowhere in it. Rivals q are only the
    /// points nearest to the corners, so a few points more than necessary are kept. Squared
    /// distances have a relative rounding error of less than 4ε; a point is dropped only when it
    /// loses by more, so the minimum over the kept points is the minimum over all, to the last bit.
    fn keep_nearest(&self, grid: &Grid, block: Block, stack: &mut Vec<u32>, from: usize) {
        let low = |origin: f64, first: usize| origin + first as f64 * grid.cell - self.margin;
        let high = |origin: f64, end: usize| origin + end as f64 * grid.cell + self.margin;
        let min = [low(grid.origin[0], block.column), low(grid.origin[1], block.row)];
        let max = [
            high(grid.origin[0], block.column + block.columns),
            high(grid.origin[1], block.row + block.rows),
        ];
        let candidates = from..stack.len();
        let mut rivals = [(f64::INFINITY, [0.0; 4]); 4];
        let mut reach = self.max_distance_squared;
        for i in candidates.clone() {
            let corners = corner_distances(self.points[stack[i] as usize], min, max);
            for (rival, distance) in rivals.iter_mut().zip(corners) {
                if distance < rival.0 {
                    *rival = (distance, corners);
                }
            }
            // Every place in the block is at least this near to this point.
            reach = reach.min(corners.iter().copied().fold(0.0, f64::max));
        }
        reach *= 1.0 + 16.0 * f64::EPSILON;
        for i in candidates {
            let point = self.points[stack[i] as usize];
            if box_distance(point, min, max) > reach {
                continue;
            }
            let corners = corner_distances(point, min, max);
            let slack = 16.0 * f64::EPSILON * corners.iter().copied().fold(0.0, f64::max);
            let beaten = rivals
                .iter()
                .any(|(_, rival)| rival.iter().zip(&corners).all(|(q, p)| q + slack < *p));
            if !beaten {
                stack.push(stack[i]);
            }
        }
    }

    /// Writes the list of a single cell.
    fn list(&self, grid: &mut Grid, cell: Block, candidates: &[u32]) {
        let list = &mut grid.lists[cell.row * grid.columns + cell.column];
        let start = grid.entries.len();
        if candidates.len() > MAX_LIST || start + candidates.len() > MAX_ENTRIES {
            list.length = CROWDED;
        } else {
            *list = List { start: start as u32, length: candidates.len() as u32 };
            grid.entries.extend(candidates.iter().map(|&i| self.points[i as usize]));
        }
    }
}

/// Squared distances of a point to the corners of a box.
#[inline]
fn corner_distances(p: Point<2>, min: Point<2>, max: Point<2>) -> [f64; 4] {
    let squares = |axis: usize| {
        let (low, high) = (p[axis] - min[axis], p[axis] - max[axis]);
        (low * low, high * high)
    };
    let ((left, right), (lower, upper)) = (squares(0), squares(1));
    [left + lower, right + lower, left + upper, right + upper]
}

/// Squared distance of a point to a box, 0 inside.
#[inline]
fn box_distance(p: Point<2>, min: Point<2>, max: Point<2>) -> f64 {
    let outside = |axis: usize| (min[axis] - p[axis]).max(p[axis] - max[axis]).max(0.0);
    let (dx, dy) = (outside(0), outside(1));
    dx * dx + dy * dy
}
