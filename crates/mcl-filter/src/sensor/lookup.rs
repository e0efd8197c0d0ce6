//! Distances for many positions at a time: the inner loop of the filter.
//!
//! Positions within a cell are `f32`. Positions on the map are `f64`, or `f32` relative to the centre of a nearby
//! cell, so that the accuracy does not depend on the size of the map. Arithmetic and table lookups
//! alternate in separate loops. The arithmetic loops have no branches or fused operations; inlined into a dispatched
//! function, they vectorize and give the same bits for every instruction set.

use super::DistanceField;
use super::fetch::{Fetch, LANES};
use super::grid::{BLOCK, CellOffset, PointBlock, RECORD_BITS, RECORD_MASK, SHRINK};

/// Number of positions processed at a time: few enough that their data stays in the first-level cache.
pub(super) const CHUNK: usize = 256;
/// 1.5·2⁵²: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// 1.5·2²³: the same for `f32`, below 2²².
const ROUND_F32: f32 = 12_582_912.0;
/// The low bits in which [`ROUND_F32`] leaves a number.
const ROUND_MASK: u32 = (1 << 22) - 1;

/// Intermediate results of a chunk.
pub(super) struct Workspace {
    /// Positions relative to the centre of the cell.
    dx: [f32; CHUNK],
    dy: [f32; CHUNK],
    cell: [u32; CHUNK],
    /// First the entry of the cell, then the number of the record.
    record: [u32; CHUNK],
    /// Candidates of the records, coordinate by coordinate.
    x: [[f32; CHUNK]; 2],
    y: [[f32; CHUNK]; 2],
    squared: [f32; CHUNK],
}

/// A position, located in its cell.
#[derive(Clone, Copy)]
pub(super) struct Located {
    /// Relative to the centre of the cell.
    dx: f32,
    dy: f32,
    cell: u32,
}

impl Default for Workspace {
    fn default() -> Self {
        Workspace {
            dx: [0.0; CHUNK],
            dy: [0.0; CHUNK],
            cell: [0; CHUNK],
            record: [0; CHUNK],
            x: [[0.0; CHUNK]; 2],
            y: [[0.0; CHUNK]; 2],
            squared: [0.0; CHUNK],
        }
    }
}

impl Workspace {
    /// Sets the first `number` positions.
    #[inline(always)]
    pub fn place(&mut self, number: usize, located: impl Fn(usize) -> Located) {
        let (dx, dy) = (&mut self.dx[..number], &mut self.dy[..number]);
        let cell = &mut self.cell[..number];
        for i in 0..number {
            Located { dx: dx[i], dy: dy[i], cell: cell[i] } = located(i);
        }
    }
}

/// The constants of a lookup, and the tables of the grid.
#[derive(Clone, Copy)]
pub(super) struct Lookup<'a> {
    field: &'a DistanceField,
    last_column: f64,
    last_row: f64,
    columns: f64,
    /// The previous three in `f32`.
    limits: [f32; 3],
    /// The squared maximum distance in cells.
    cut: f32,
}

impl<'a> Lookup<'a> {
    pub fn new(field: &'a DistanceField) -> Self {
        let grid = &field.grid;
        let cut = field.exact.max_distance() / grid.cell;
        Lookup {
            field,
            last_column: (grid.columns - 1) as f64,
            last_row: (grid.rows - 1) as f64,
            columns: grid.columns as f64,
            limits: [(grid.columns - 1) as f32, (grid.rows - 1) as f32, grid.columns as f32],
            cut: (cut * cut) as f32,
        }
    }

    /// The cell of a position (in cells), and the position relative to its centre.
    #[inline(always)]
    pub fn locate(&self, x: f64, y: f64) -> Located {
        let (column, dx) = round(x, self.last_column);
        let (row, dy) = round(y, self.last_row);
        let cell = (row * self.columns + column + ROUND).to_bits() as u32;
        Located { dx: dx as f32, dy: dy as f32, cell }
    }

    /// The same for a position relative to the centre of the cell in `column` and `row`; all four arguments are below
    /// 2²².
    #[inline(always)]
    pub fn locate_from(&self, column: f32, row: f32, x: f32, y: f32) -> Located {
        let (columns, rows) = ((x + ROUND_F32) - ROUND_F32, (y + ROUND_F32) - ROUND_F32);
        let [last_column, last_row, width] = self.limits;
        let (column, row) = (clamp(column + columns, last_column), clamp(row + rows, last_row));
        let cell = (row * width + column + ROUND_F32).to_bits() & ROUND_MASK;
        Located { dx: x - columns, dy: y - rows, cell }
    }

    /// Truncated squared distances of the first `number` positions of the workspace, in cells. `number` is a
    /// multiple of [`LANES`] and at most [`CHUNK`].
    #[inline(always)]
    pub fn squared_distances<'w, F: Fetch>(
        &self,
        fetch: F,
        number: usize,
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        let grid = &self.field.grid;
        let (cells, table) = (grid.cells.as_slice(), grid.records.as_slice());
        let (dx, dy) = (&workspace.dx[..number], &workspace.dy[..number]);
        let cell = &workspace.cell[..number];
        let record = &mut workspace.record[..number];
        for (records, numbers) in
            record.as_chunks_mut::<LANES>().0.iter_mut().zip(cell.as_chunks::<LANES>().0)
        {
            for lane in 0..LANES {
                records[lane] = cells[numbers[lane] as usize];
            }
        }
        for i in 0..number {
            let entry = record[i];
            let parts = f32::from_bits(((entry >> RECORD_BITS) + 127) << 23);
            let (scale, middle) = (parts * SHRINK as f32, 0.5 * parts - 0.5);
            let column = (dx[i] * scale + middle + ROUND_F32) - ROUND_F32;
            let row = (dy[i] * scale + middle + ROUND_F32) - ROUND_F32;
            let part = (row * parts + column + ROUND_F32).to_bits() & ROUND_MASK;
            record[i] = (entry & RECORD_MASK) + part;
        }
        let ([x1, x2], [y1, y2]) = (&mut workspace.x, &mut workspace.y);
        let (x1, x2) = (&mut x1[..number], &mut x2[..number]);
        let (y1, y2) = (&mut y1[..number], &mut y2[..number]);
        // Which positions need a list is hard to predict, so there are few branches on it.
        let mut overfull = [0u64; CHUNK / 64];
        let outputs = x1
            .as_chunks_mut::<LANES>()
            .0
            .iter_mut()
            .zip(x2.as_chunks_mut::<LANES>().0)
            .zip(y1.as_chunks_mut::<LANES>().0)
            .zip(y2.as_chunks_mut::<LANES>().0);
        let groups = record.as_chunks::<LANES>().0.iter().zip(outputs);
        for (group, (numbers, (((x1, x2), y1), y2))) in groups.enumerate() {
            let candidates = fetch.fetch(table, numbers);
            *x1 = candidates.x[0];
            *x2 = candidates.x[1];
            *y1 = candidates.y[0];
            *y2 = candidates.y[1];
            overfull[group / 8 % 4] |= u64::from(candidates.overfull) << (group % 8 * LANES);
        }
        let squared = &mut workspace.squared[..number];
        for i in 0..number {
            let one = squared_distance([x1[i], y1[i]], dx[i], dy[i]);
            let other = squared_distance([x2[i], y2[i]], dx[i], dy[i]);
            let nearest = if one < other { one } else { other };
            squared[i] = if nearest < self.cut { nearest } else { self.cut };
        }
        for (word, &bits) in overfull.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let i = 64 * word + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let blocks = grid.blocks(y1[i], x2[i]);
                squared[i] = self.nearest_listed(blocks, cell[i], dx[i], dy[i]);
            }
        }
        squared
    }

    /// The truncated squared distance to the nearest point of a list.
    #[inline(always)]
    fn nearest_listed(&self, blocks: Option<&[PointBlock]>, cell: u32, dx: f32, dy: f32) -> f32 {
        let Some(blocks) = blocks else { return self.crowded(cell, dx, dy) };
        let mut nearest = [self.cut; BLOCK];
        for block in blocks {
            for i in 0..BLOCK {
                let squared = squared_distance([block.x[i], block.y[i]], dx, dy);
                nearest[i] = if squared < nearest[i] { squared } else { nearest[i] };
            }
        }
        let [a, b, c, d] = nearest;
        let (a, b) = (if a < b { a } else { b }, if c < d { c } else { d });
        if a < b { a } else { b }
    }

    /// The squared distance from the tree.
    #[cold]
    #[inline(never)]
    fn crowded(&self, cell: u32, dx: f32, dy: f32) -> f32 {
        let grid = &self.field.grid;
        let cell = cell as usize;
        let place = [
            (cell % grid.columns) as f64 + f64::from(dx),
            (cell / grid.columns) as f64 + f64::from(dy),
        ];
        let point = std::array::from_fn(|axis| grid.origin[axis] + place[axis] * grid.cell);
        (self.field.exact.distance_squared(point) / (grid.cell * grid.cell)) as f32
    }
}

#[inline(always)]
fn squared_distance([x, y]: CellOffset, dx: f32, dy: f32) -> f32 {
    let (x, y) = (x - dx, y - dy);
    x * x + y * y
}

/// The integer in 0..=`last` nearest to a position, and the position relative to it. 0 for NaN.
#[inline(always)]
fn round(place: f64, last: f64) -> (f64, f64) {
    let place = if place > 0.0 { place } else { 0.0 };
    let place = if place < last { place } else { last };
    let nearest = (place + ROUND) - ROUND;
    (nearest, place - nearest)
}

#[inline(always)]
fn clamp(place: f32, last: f32) -> f32 {
    let place = if place > 0.0 { place } else { 0.0 };
    if place < last { place } else { last }
}
