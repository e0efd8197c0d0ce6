//! Distances for many places at a time: the inner loop of the filter.
//!
//! Places are found in `f64`, so that the size of a map costs no accuracy; only positions within a
//! cell are `f32`. Arithmetic and table look-ups alternate in loops of their own: the former, without
//! branches and fused operations, become vector instructions where they are inlined into a dispatched
//! function, with the same bits for every instruction set.

use super::DistanceField;
use super::grid::{OVERFULL, Place, RECORD_BITS, RECORD_MASK, SHRINK, pack};

/// Places looked up at a time: few enough that all they need stays in the first-level cache.
pub(super) const CHUNK: usize = 256;
/// 1.5·2⁵²: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// 1.5·2²³: the same in `f32`.
const ROUND_F32: f32 = 12_582_912.0;
/// The low bits in which [`ROUND_F32`] leaves a number of at most 2¹⁶.
const PART_MASK: u32 = (1 << 20) - 1;

/// Intermediate results of a chunk.
pub(super) struct Workspace {
    /// Positions relative to the centre of the cell.
    dx: [f32; CHUNK],
    dy: [f32; CHUNK],
    cell: [u32; CHUNK],
    /// First the cell's entry, then the number of the record.
    record: [u32; CHUNK],
    /// Candidates of the records.
    first: [Place; CHUNK],
    second: [Place; CHUNK],
    /// Those of the chunk that need a list.
    overfull: [u32; CHUNK],
    squared: [f32; CHUNK],
}

impl Default for Workspace {
    fn default() -> Self {
        Workspace {
            dx: [0.0; CHUNK],
            dy: [0.0; CHUNK],
            cell: [0; CHUNK],
            record: [0; CHUNK],
            first: [0; CHUNK],
            second: [0; CHUNK],
            overfull: [0; CHUNK],
            squared: [0.0; CHUNK],
        }
    }
}

/// What a look-up needs beside the grid's tables.
#[derive(Clone, Copy)]
pub(super) struct Lookup<'a> {
    field: &'a DistanceField,
    last_column: f64,
    last_row: f64,
    columns: f64,
    /// The squared cut in cells.
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
            cut: (cut * cut) as f32,
        }
    }

    /// Squared distances, cut, from at most [`CHUNK`] places in cells, all in units of cells.
    #[inline(always)]
    pub fn distances_squared<'w>(
        &self,
        x: &[f64],
        y: &[f64],
        workspace: &'w mut Workspace,
    ) -> &'w mut [f32] {
        let grid = &self.field.grid;
        let (cells, table) = (grid.cells.as_slice(), grid.records.as_slice());
        let number = x.len();
        let y = &y[..number];
        let dx = &mut workspace.dx[..number];
        let dy = &mut workspace.dy[..number];
        let cell = &mut workspace.cell[..number];
        let record = &mut workspace.record[..number];
        let (first, second) = (&mut workspace.first[..number], &mut workspace.second[..number]);
        let overfull = &mut workspace.overfull;
        let squared = &mut workspace.squared[..number];

        for i in 0..number {
            let (column, from_x) = round(x[i], self.last_column);
            let (row, from_y) = round(y[i], self.last_row);
            dx[i] = from_x as f32;
            dy[i] = from_y as f32;
            cell[i] = (row * self.columns + column + ROUND).to_bits() as u32;
        }
        for i in 0..number {
            record[i] = cells[cell[i] as usize];
        }
        for i in 0..number {
            let entry = record[i];
            let parts = f32::from_bits(((entry >> RECORD_BITS) + 127) << 23);
            let (scale, middle) = (parts * SHRINK as f32, 0.5 * parts - 0.5);
            let column = (dx[i] * scale + middle + ROUND_F32) - ROUND_F32;
            let row = (dy[i] * scale + middle + ROUND_F32) - ROUND_F32;
            let part = (row * parts + column + ROUND_F32).to_bits() & PART_MASK;
            record[i] = (entry & RECORD_MASK) + part;
        }
        // Which places need a list is hard to predict: they are noted without a branch.
        let mut count = 0;
        for i in 0..number {
            let [one, other] = table[record[i] as usize];
            (first[i], second[i]) = (one, other);
            overfull[count % CHUNK] = i as u32;
            count += usize::from(one == OVERFULL);
        }
        for &i in &overfull[..count] {
            let i = i as usize;
            first[i] = self.nearest_listed(record[i], cell[i], dx[i], dy[i]);
            second[i] = first[i];
        }
        for i in 0..number {
            let one = squared_distance(first[i], dx[i], dy[i]);
            let other = squared_distance(second[i], dx[i], dy[i]);
            let nearest = if one < other { one } else { other };
            squared[i] = if nearest < self.cut { nearest } else { self.cut };
        }
        squared
    }

    /// The nearest of a list.
    #[inline(always)]
    fn nearest_listed(&self, record: u32, cell: u32, dx: f32, dy: f32) -> Place {
        let grid = &self.field.grid;
        let [_, list] = grid.numbers[record as usize];
        let Some(range) = grid.list(list) else { return self.crowded(cell, dx, dy) };
        let mut nearest = (0, f32::INFINITY);
        for &place in &grid.listed_places[range] {
            let squared = squared_distance(place, dx, dy);
            if squared < nearest.1 {
                nearest = (place, squared);
            }
        }
        nearest.0
    }

    /// A place as far away as the tree says.
    #[cold]
    #[inline(never)]
    fn crowded(&self, cell: u32, dx: f32, dy: f32) -> Place {
        let grid = &self.field.grid;
        let cell = cell as usize;
        let place = [
            (cell % grid.columns) as f64 + f64::from(dx),
            (cell / grid.columns) as f64 + f64::from(dy),
        ];
        let point = std::array::from_fn(|axis| grid.origin[axis] + place[axis] * grid.cell);
        let distance = self.field.exact.distance_squared(point).sqrt() / grid.cell;
        pack(dx + distance as f32, dy)
    }
}

#[inline(always)]
fn squared_distance(place: Place, dx: f32, dy: f32) -> f32 {
    let (x, y) = (f32::from_bits(place as u32) - dx, f32::from_bits((place >> 32) as u32) - dy);
    x * x + y * y
}

/// The integer in 0..=`last` nearest to a place, and the place relative to it. 0 for NaN.
#[inline(always)]
fn round(place: f64, last: f64) -> (f64, f64) {
    let place = if place > 0.0 { place } else { 0.0 };
    let place = if place < last { place } else { last };
    let nearest = (place + ROUND) - ROUND;
    (nearest, place - nearest)
}
