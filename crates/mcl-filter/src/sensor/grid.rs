//! The grid behind [`DistanceField`](super::DistanceField): the map points that can be nearest to some
//! point in a cell.

use mcl_core::Point;

/// Entries of [`Grid::cells`]: the low bits are the first record of the cell, the high bits log₂ of the
/// number of parts per side.
pub(super) const RECORD_BITS: u32 = 28;
pub(super) const RECORD_MASK: u32 = (1 << RECORD_BITS) - 1;
/// In place of the number of a point: no point.
pub(super) const NO_POINT: u32 = u32::MAX;
/// In place of the number of the first point: the second number is that of a list.
pub(super) const LISTED: u32 = u32::MAX - 1;
/// In place of the length of a list: the tree is used.
pub(super) const CROWDED: u32 = 1 << 30;
/// Candidates of a part of a cell without points: farther away than any maximum distance, but near
/// enough that their squares are finite.
pub(super) const FAR: f32 = 1e18;
/// Added to a number stored in place of a coordinate, so that its bits are those of a normal float.
const NUMBER_BASE: u32 = 1 << 23;
/// Positions at the end of a cell belong to its last part: they are scaled by slightly less
/// than the number of parts, so that rounding cannot lead beyond it.
pub(super) const SHRINK: f64 = 1.0 - 1.0 / 262_144.0;

/// A position relative to the centre of its cell, in cells.
pub(super) type CellOffset = [f32; 2];

/// The two candidates of a part of a cell; twice the same if there is only one. If there are more, the
/// first coordinate is NaN and the second a number that [`blocks`](Grid::blocks) interprets.
pub(super) type Record = [CellOffset; 2];

/// The record of a part with a list, from its first block and their number, or [`CROWDED`].
pub(super) fn overfull(first_block: u32, blocks: u32) -> Record {
    [[f32::NAN, as_coordinate(first_block)], [as_coordinate(blocks), 0.0]]
}

fn as_coordinate(number: u32) -> f32 {
    f32::from_bits(NUMBER_BASE + number)
}

fn from_coordinate(coordinate: f32) -> u32 {
    coordinate.to_bits() - NUMBER_BASE
}

/// The candidates of a part of a cell.
pub(super) enum Candidates<'a> {
    /// Numbers of all points that are nearest to some point in it, and nearer than the maximum distance.
    Few(&'a [u32]),
    /// Too many such points to list.
    Crowded,
}

/// Start of a list, and its length or [`CROWDED`].
#[derive(Clone, Copy)]
pub(super) struct List {
    pub start: u32,
    pub length: u32,
}

/// Number of listed points per block, whose squared distances are computed together.
pub(super) const BLOCK: usize = 4;

/// Positions of some listed points, coordinate by coordinate.
#[derive(Clone, Copy)]
pub(super) struct PointBlock {
    pub x: [f32; BLOCK],
    pub y: [f32; BLOCK],
}

/// A grid over a map and everything within the maximum distance of it. Cells with many candidates are divided into
/// 2ⁿ × 2ⁿ parts; each part has a record.
///
/// Coordinates *in cells* are relative to the centre of the first cell, so that a position belongs to the
/// cell whose number it rounds to.
pub(super) struct Grid {
    /// Centre of the first cell (m).
    pub origin: Point<2>,
    /// Side of a cell (m).
    pub cell: f64,
    pub columns: usize,
    pub rows: usize,
    /// Row by row. Cells at the border are empty, so that positions outside can be clamped to them.
    pub cells: Vec<u32>,
    /// The parts of a cell row by row. The first record belongs to all cells without points.
    pub records: Vec<Record>,
    /// For exact distances: per record the numbers of points, [`NO_POINT`] or [`LISTED`].
    pub numbers: Vec<[u32; 2]>,
    pub lists: Vec<List>,
    pub listed: Vec<u32>,
    /// Positions of the listed points, list by list, each padded with [`FAR`] to whole blocks.
    pub blocks: Vec<PointBlock>,
    /// All distinct points of the map.
    pub points: Vec<Point<2>>,
}

impl Grid {
    /// Converts a coordinate (m) to cells.
    #[inline(always)]
    pub fn in_cells(&self, axis: usize, coordinate: f64) -> f64 {
        (coordinate - self.origin[axis]) / self.cell
    }

    /// The lower left corner (m) of the cell centred at a position in cells.
    pub fn corner(&self, centre: Point<2>) -> Point<2> {
        std::array::from_fn(|axis| self.origin[axis] + (centre[axis] - 0.5) * self.cell)
    }

    /// Position of a point relative to the centre of a cell, given in cells. Not computed in metres, which are
    /// coarse far from the origin.
    pub fn place(&self, number: u32, centre: Point<2>) -> CellOffset {
        let point = self.points[number as usize];
        [0, 1].map(|axis| (self.in_cells(axis, point[axis]) - centre[axis]) as f32)
    }

    /// The candidates for a point.
    pub fn candidates_at(&self, point: Point<2>) -> Candidates<'_> {
        let ends = [(self.columns - 1) as f64, (self.rows - 1) as f64];
        let place: Point<2> = std::array::from_fn(|axis| {
            // Not `clamp`, because NaN must map to some cell too.
            self.in_cells(axis, point[axis]).max(0.0).min(ends[axis])
        });
        let cell = place.map(f64::round);
        let entry = self.cells[cell[1] as usize * self.columns + cell[0] as usize];
        let parts = f64::from(1 << (entry >> RECORD_BITS));
        let part = |axis: usize| {
            ((place[axis] - cell[axis]) * parts * SHRINK + 0.5 * (parts - 1.0)).round()
        };
        let record = (entry & RECORD_MASK) as usize + (part(1) * parts + part(0)) as usize;
        let numbers = &self.numbers[record];
        match *numbers {
            [NO_POINT, _] => Candidates::Few(&[]),
            [LISTED, list] => match self.list(list) {
                Some(range) => Candidates::Few(&self.listed[range]),
                None => Candidates::Crowded,
            },
            [_, NO_POINT] => Candidates::Few(&numbers[..1]),
            _ => Candidates::Few(numbers),
        }
    }

    /// The range of a list in `listed`; `None` if the tree is used.
    #[inline(always)]
    pub fn list(&self, list: u32) -> Option<std::ops::Range<usize>> {
        let List { start, length } = self.lists[list as usize];
        (length != CROWDED).then(|| start as usize..start as usize + length as usize)
    }

    /// The blocks of an overfull record, from its second and third coordinate; `None` if the tree is used.
    #[inline(always)]
    pub fn blocks(&self, first: f32, number: f32) -> Option<&[PointBlock]> {
        let (first, number) = (from_coordinate(first) as usize, from_coordinate(number));
        (number != CROWDED).then(|| &self.blocks[first..first + number as usize])
    }
}
