//! Distances for eight places at a time: the inner loop of the filter.
//!
//! Places are found in `f64`, so that the size of a map costs no accuracy; only positions within a
//! cell are `f32`. Everything but the loads is a plain loop over lanes without branches and fused
//! operations, which becomes vector instructions where it is inlined into a dispatched closure, with
//! the same bits for every instruction set.

use super::DistanceField;
use super::grid::{Grid, RECORD_BITS, RECORD_MASK, Record, SHRINK};

pub(super) const LANES: usize = 8;
pub(super) type Lanes = [f64; LANES];
/// 1.5·2⁵²: adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// 1.5·2²³: the same in `f32`.
const ROUND_F32: f32 = 12_582_912.0;

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

    /// Squared distances, cut, from places in cells, all in units of cells.
    #[inline(always)]
    pub fn distances_squared(&self, x: &Lanes, y: &Lanes) -> [f32; LANES] {
        let grid = &self.field.grid;
        let mut dx = [0.0f32; LANES];
        let mut dy = [0.0f32; LANES];
        let mut cell = [0u32; LANES];
        for lane in 0..LANES {
            let (column, from_x) = round(x[lane], self.last_column);
            let (row, from_y) = round(y[lane], self.last_row);
            dx[lane] = from_x as f32;
            dy[lane] = from_y as f32;
            cell[lane] = (row * self.columns + column + ROUND).to_bits() as u32;
        }
        let entry: [u32; LANES] = std::array::from_fn(|lane| grid.cells[cell[lane] as usize]);
        let mut index = [0u32; LANES];
        for lane in 0..LANES {
            let parts = f32::from_bits(((entry[lane] >> RECORD_BITS) + 127) << 23);
            let (scale, middle) = (parts * SHRINK as f32, 0.5 * parts - 0.5);
            let column = (dx[lane] * scale + middle + ROUND_F32) - ROUND_F32;
            let row = (dy[lane] * scale + middle + ROUND_F32) - ROUND_F32;
            let part = (row * parts + column + ROUND_F32).to_bits() - ROUND_F32.to_bits();
            index[lane] = (entry[lane] & RECORD_MASK) + part;
        }
        let records: [Record; LANES] = std::array::from_fn(|lane| {
            let record = grid.records[index[lane] as usize];
            if record[0].is_nan() {
                self.nearest_listed(index[lane], dx[lane], dy[lane], x[lane], y[lane])
            } else {
                record
            }
        });
        let mut squared = [0.0f32; LANES];
        for lane in 0..LANES {
            let [x0, y0, x1, y1] = records[lane];
            let (x0, y0, x1, y1) = (x0 - dx[lane], y0 - dy[lane], x1 - dx[lane], y1 - dy[lane]);
            let (one, other) = (x0 * x0 + y0 * y0, x1 * x1 + y1 * y1);
            let nearest = if one < other { one } else { other };
            squared[lane] = if nearest < self.cut { nearest } else { self.cut };
        }
        squared
    }

    #[inline(never)]
    fn nearest_listed(&self, record: u32, dx: f32, dy: f32, x: f64, y: f64) -> Record {
        let grid = &self.field.grid;
        let [_, list] = grid.numbers[record as usize];
        let Some(range) = grid.list(list) else { return self.crowded(dx, dy, x, y) };
        let mut nearest = ([0.0; 2], f32::INFINITY);
        for place in &grid.listed_places[range] {
            let (x, y) = (place[0] - dx, place[1] - dy);
            let squared = x * x + y * y;
            if squared < nearest.1 {
                nearest = (*place, squared);
            }
        }
        let [x, y] = nearest.0;
        [x, y, x, y]
    }

    #[cold]
    #[inline(never)]
    fn crowded(&self, dx: f32, dy: f32, x: f64, y: f64) -> Record {
        let grid = &self.field.grid;
        let point = [grid.origin[0] + x * grid.cell, grid.origin[1] + y * grid.cell];
        let x = dx + (self.field.exact.distance_squared(point).sqrt() / grid.cell) as f32;
        [x, dy, x, dy]
    }
}

/// The integer in 0..=`last` nearest to a place, and the place relative to it. 0 for NaN.
#[inline(always)]
fn round(place: f64, last: f64) -> (f64, f64) {
    let place = if place > 0.0 { place } else { 0.0 };
    let place = if place < last { place } else { last };
    let nearest = (place + ROUND) - ROUND;
    (nearest, place - nearest)
}

impl Grid {
    /// A coordinate (m) in cells.
    #[inline(always)]
    pub fn in_cells(&self, axis: usize, coordinate: f64) -> f64 {
        (coordinate - self.origin[axis]) / self.cell
    }
}
