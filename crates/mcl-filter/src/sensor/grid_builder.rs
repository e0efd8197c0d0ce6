//! Building a [`Grid`].

use mcl_core::memory::{reserve, with_room};
use mcl_core::{Bounds, OutOfMemory, Point, PointMap};

use super::grid::{
    BLOCK, CROWDED, FAR, Grid, LISTED, List, NO_POINT, PointBlock, RECORD_BITS, overfull,
};

/// Cells per map point, and limits of the number of cells. Results do not depend on them or on the
/// limits below.
const CELLS_PER_POINT: usize = 16;
const MIN_CELLS: usize = 1 << 12;
const MAX_CELLS: usize = 1 << 17;
/// A cell is divided into smaller parts as long as more than one part in this many is overfull ...
const OVERFULL_SHARE: usize = 8;
/// ... it has no more than this many parts per candidate (fewer if the map has so many points that
/// records would run out before all cells are divided) ...
const PARTS_PER_CANDIDATE: f64 = 8.0;
/// ... and four parts together have less than this times the candidates of the part they were divided
/// from: four times as many mean that division does not help, as at the centre of a circle.
const MAX_GROWTH: usize = 3;
/// At most 2ⁿ × 2ⁿ parts.
const MAX_DEPTH: u32 = 8;
/// Largest number of records (128 MiB, and half as much for the numbers of their points).
const MAX_RECORDS: usize = 1 << 23;
/// Parts with more points than this use the tree, so that no query takes long.
const MAX_LIST: usize = 64;
/// Largest total number of list entries, absolute or per point, whichever is larger; further parts use the tree.
const MAX_LISTED: usize = 1 << 24;
const LISTED_PER_POINT: usize = 4;
/// Examining a candidate once for a block or part is a unit of work. After more than this per point
/// and per cell (thousands of nearly equal points are candidates all over the map), blocks with
/// more than [`MAX_LIST`] candidates use the tree.
const WORK_PER_POINT: usize = 4096;
const WORK_PER_CELL: usize = 128;
/// Largest number of candidates collected before records are written, absolute or per point, whichever is larger. Few
/// maps have more.
const MAX_NOTED: usize = 1 << 24;
const NOTED_PER_POINT: usize = 16;
/// Fraction of its side by which a cell is enlarged: positions are rounded to `f32` and scaled
/// by [`SHRINK`](super::grid::SHRINK), which together moves them by less than a quarter of this.
const MARGIN: f64 = 1e-5;

/// What out-of-memory errors call this memory.
const DISTANCES: &str = "a map's distances";

/// Builds the grid of a map; `max_distance` (m) has been checked.
pub(super) fn build(map: &PointMap<2>, max_distance: f64) -> Result<Grid, OutOfMemory> {
    build_within(map, max_distance, MAX_RECORDS, MAX_NOTED.max(NOTED_PER_POINT * map.len()))
}

fn build_within(
    map: &PointMap<2>,
    max_distance: f64,
    max_records: usize,
    max_noted: usize,
) -> Result<Grid, OutOfMemory> {
    let mut points = with_room(map.len(), DISTANCES)?;
    points.extend_from_slice(map.points());
    // Duplicates would be listed repeatedly.
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let bounds = map.bounds();
    let largest = bounds.min.iter().chain(&bounds.max).fold(0.0f64, |l, c| c.abs().max(l));
    // More than the rounding of a sum or difference of coordinates of this size and the maximum distance.
    let rounding = 16.0 * f64::EPSILON * (largest + max_distance);
    let mut grid = empty(&bounds, points.len(), max_distance + rounding);
    let margin = MARGIN * grid.cell + rounding;
    let mut stack: Vec<u32> = with_room(points.len(), DISTANCES)?;
    stack.extend(0..points.len() as u32);
    grid.points = points;
    let whole = CellBlock { column: 0, row: 0, columns: grid.columns, rows: grid.rows };
    let max_distance_squared = max_distance * max_distance;
    let work = WORK_PER_POINT * grid.points.len() + WORK_PER_CELL * grid.cells.len();
    let max_listed = MAX_LISTED.max(LISTED_PER_POINT * grid.points.len());
    let mut builder = Builder {
        grid,
        max_distance_squared,
        margin,
        work,
        max_listed,
        max_noted,
        max_records,
        cells: CellCandidates::default(),
    };
    builder.fill(whole, &mut stack, 0)?;
    drop(stack);
    builder.write_records(1)?;
    Ok(builder.grid)
}

/// Creates a grid without candidates over everything within `reach` (m) of the bounding box of the points, plus one
/// cell.
fn empty(bounds: &Bounds<2>, points: usize, reach: f64) -> Grid {
    let [width, height] = [0, 1].map(|axis| bounds.extent(axis) + 2.0 * reach);
    let wanted = points.saturating_mul(CELLS_PER_POINT).clamp(MIN_CELLS, MAX_CELLS) as f64;
    // No side is divided into more than `wanted` cells, so that a long and narrow map does not get many
    // more cells than that.
    let cell = (width * height / wanted).sqrt().max(width.max(height) / wanted);
    let cells = |length: f64| (length / cell).ceil().max(1.0) as usize + 2;
    let (columns, rows) = (cells(width), cells(height));
    Grid {
        // The first cell ends where `reach` begins.
        origin: bounds.min.map(|coordinate| coordinate - reach - 0.5 * cell),
        cell,
        columns,
        rows,
        cells: vec![0; columns * rows],
        records: vec![[[FAR; 2]; 2]],
        numbers: vec![[NO_POINT; 2]],
        lists: Vec::new(),
        listed: Vec::new(),
        blocks: Vec::new(),
        points: Vec::new(),
    }
}

/// A rectangle of cells.
#[derive(Clone, Copy)]
pub(super) struct CellBlock {
    pub column: usize,
    pub row: usize,
    pub columns: usize,
    pub rows: usize,
}

impl CellBlock {
    /// The two halves across the longer side; `None` for a single cell.
    pub fn halves(self) -> Option<[CellBlock; 2]> {
        if self.columns >= self.rows && self.columns > 1 {
            let left = self.columns / 2;
            let right = self.columns - left;
            Some([
                CellBlock { columns: left, ..self },
                CellBlock { column: self.column + left, columns: right, ..self },
            ])
        } else if self.rows > 1 {
            let lower = self.rows / 2;
            let upper = self.rows - lower;
            Some([
                CellBlock { rows: lower, ..self },
                CellBlock { row: self.row + lower, rows: upper, ..self },
            ])
        } else {
            None
        }
    }
}

/// Candidates of the parts of one cell, row by row.
#[derive(Default)]
struct PartCandidates {
    /// log₂ of the number of parts per side.
    depth: u32,
    candidates: Vec<u32>,
    /// End of the candidates of each part.
    ends: Vec<usize>,
}

impl PartCandidates {
    fn of(&self, part: usize) -> std::ops::Range<usize> {
        let start = if part == 0 { 0 } else { self.ends[part - 1] };
        start..self.ends[part]
    }

    fn overfull(&self) -> usize {
        (0..self.ends.len()).filter(|&part| self.of(part).len() > 2).count()
    }
}

/// Candidates of all cells, cell by cell.
#[derive(Default)]
struct CellCandidates {
    /// Column and row of a cell, and the end of its candidates.
    cells: Vec<([u32; 2], usize)>,
    candidates: Vec<u32>,
}

/// Finds the candidates of all cells from coarse to fine, because a point that is never nearest within a
/// block of cells need not be examined again within it. Then divides the cells into parts and writes the
/// records of the grid. How finely they can be divided is known only after all candidates have been found.
struct Builder {
    grid: Grid,
    max_distance_squared: f64,
    /// Length (m) by which cells are enlarged, so that a position which rounding assigns
    /// to a neighbouring cell still finds its nearest point there.
    margin: f64,
    /// Remaining work.
    work: usize,
    max_listed: usize,
    max_noted: usize,
    max_records: usize,
    cells: CellCandidates,
}

impl Builder {
    /// Collects the candidates of each cell of the block, all of which are in `stack[from..]`.
    fn fill(
        &mut self,
        block: CellBlock,
        stack: &mut Vec<u32>,
        from: usize,
    ) -> Result<(), OutOfMemory> {
        let kept_from = stack.len();
        let corner = |first: [usize; 2]| self.grid.corner(first.map(|number| number as f64));
        let min = corner([block.column, block.row]);
        let max = corner([block.column + block.columns, block.row + block.rows]);
        reserve(stack, kept_from - from, DISTANCES)?;
        stack.extend_from_within(from..kept_from);
        self.work = self.work.saturating_sub(kept_from - from);
        self.keep_nearest(min, max, stack, kept_from);
        let kept = stack.len() - kept_from;
        if self.work == 0 && kept > MAX_LIST {
            self.leave_to_tree(block)?;
        } else if kept > 0 {
            match block.halves() {
                Some(halves) => {
                    for half in halves {
                        self.fill(half, stack, kept_from)?;
                    }
                }
                None => self.note(block, &stack[kept_from..])?,
            }
        }
        stack.truncate(kept_from);
        Ok(())
    }

    /// Gives all cells of the block one shared crowded record.
    fn leave_to_tree(&mut self, block: CellBlock) -> Result<(), OutOfMemory> {
        self.make_room()?;
        let grid = &mut self.grid;
        let record = grid.records.len() as u32;
        grid.records.push(overfull(0, CROWDED));
        grid.numbers.push([LISTED, grid.lists.len() as u32]);
        grid.lists.push(List { start: 0, length: CROWDED });
        for row in block.row..block.row + block.rows {
            grid.cells[row * grid.columns + block.column..][..block.columns].fill(record);
        }
        Ok(())
    }

    /// Reserves room for one more record of any kind.
    fn make_room(&mut self) -> Result<(), OutOfMemory> {
        let Grid { records, numbers, lists, listed, blocks, .. } = &mut self.grid;
        reserve(records, 1, DISTANCES)?;
        reserve(numbers, 1, DISTANCES)?;
        reserve(lists, 1, DISTANCES)?;
        reserve(listed, MAX_LIST, DISTANCES)?;
        reserve(blocks, MAX_LIST.div_ceil(BLOCK), DISTANCES)
    }

    /// Keeps of the candidates `stack[from..]` those that can be nearest somewhere in the box.
    ///
    /// The positions nearer to a point q than to a point p form a half-plane. If all four corners of a
    /// box are in it, so is the box, and p is nearest nowhere in it. Only the
    /// points nearest to the corners are used as q, so a few points more than necessary are kept. Squared
    /// distances have a relative rounding error of less than 4ε; a point is dropped only if it
    /// loses by more, so the minimum over the kept points is the minimum over all points, bit for bit.
    fn keep_nearest(&self, min: Point<2>, max: Point<2>, stack: &mut Vec<u32>, from: usize) {
        let min = min.map(|coordinate| coordinate - self.margin);
        let max = max.map(|coordinate| coordinate + self.margin);
        let points = &self.grid.points;
        let mut rivals = [(f64::INFINITY, [0.0; 4]); 4];
        let mut reach = self.max_distance_squared;
        for &i in &stack[from..] {
            let corners = corner_distances(points[i as usize], min, max);
            for (rival, distance) in rivals.iter_mut().zip(corners) {
                if distance < rival.0 {
                    *rival = (distance, corners);
                }
            }
            // Every position in the box is at least this near to this point.
            reach = reach.min(corners.iter().copied().fold(0.0, f64::max));
        }
        reach *= 1.0 + 16.0 * f64::EPSILON;
        let mut kept = from;
        for i in from..stack.len() {
            let point = points[stack[i] as usize];
            if box_distance(point, min, max) > reach {
                continue;
            }
            let corners = corner_distances(point, min, max);
            let slack = 16.0 * f64::EPSILON * corners.iter().copied().fold(0.0, f64::max);
            let beaten = rivals
                .iter()
                .any(|(_, rival)| rival.iter().zip(&corners).all(|(q, p)| q + slack < *p));
            if !beaten {
                stack[kept] = stack[i];
                kept += 1;
            }
        }
        stack.truncate(kept);
    }

    fn note(&mut self, cell: CellBlock, candidates: &[u32]) -> Result<(), OutOfMemory> {
        let noted = &mut self.cells;
        reserve(&mut noted.candidates, candidates.len(), DISTANCES)?;
        noted.candidates.extend(candidates);
        reserve(&mut noted.cells, 1, DISTANCES)?;
        noted.cells.push(([cell.column as u32, cell.row as u32], noted.candidates.len()));
        if noted.candidates.len() > self.max_noted {
            self.write_records(2)?;
        }
        Ok(())
    }

    /// Divides all collected cells into parts and writes their records, using at most one `share`-th of
    /// the remaining records in total.
    fn write_records(&mut self, share: usize) -> Result<(), OutOfMemory> {
        let CellCandidates { cells, candidates } = std::mem::take(&mut self.cells);
        let left = self.max_records.saturating_sub(self.grid.records.len());
        let parts = (left / share).saturating_sub(cells.len()) as f64;
        let parts_per_candidate = (parts / candidates.len() as f64).min(PARTS_PER_CANDIDATE);
        let mut buffers = Default::default();
        let mut start = 0;
        for (place, end) in cells {
            let candidates = &candidates[start..end];
            let most = (parts_per_candidate * candidates.len() as f64) as usize;
            self.record(place, candidates, most, &mut buffers)?;
            start = end;
        }
        Ok(())
    }

    /// Divides a cell with these candidates into at most `most` parts and writes their records.
    fn record(
        &mut self,
        [column, row]: [u32; 2],
        candidates: &[u32],
        most: usize,
        [parts, finer]: &mut [PartCandidates; 2],
    ) -> Result<(), OutOfMemory> {
        parts.depth = 0;
        parts.candidates.clear();
        reserve(&mut parts.candidates, candidates.len(), DISTANCES)?;
        parts.candidates.extend(candidates);
        parts.ends.clear();
        parts.ends.push(candidates.len());
        let centre = [column, row].map(f64::from);
        let min = self.grid.corner(centre);
        while self.work > 0
            && parts.depth < MAX_DEPTH
            && 4 * parts.ends.len() <= most
            && OVERFULL_SHARE * parts.overfull() > parts.ends.len()
        {
            self.work = self.work.saturating_sub(4 * parts.candidates.len());
            self.cut(parts, min, finer)?;
            if finer.candidates.len() > MAX_GROWTH * parts.candidates.len() {
                break;
            }
            std::mem::swap(parts, finer);
        }
        let first = self.grid.records.len();
        let number = row as usize * self.grid.columns + column as usize;
        self.grid.cells[number] = first as u32 | parts.depth << RECORD_BITS;
        for part in 0..parts.ends.len() {
            self.push(centre, &parts.candidates[parts.of(part)])?;
        }
        Ok(())
    }

    /// Divides every part into four; `min` is the lower left corner of the cell.
    fn cut(
        &self,
        parts: &PartCandidates,
        min: Point<2>,
        finer: &mut PartCandidates,
    ) -> Result<(), OutOfMemory> {
        let side = 2usize << parts.depth;
        let size = self.grid.cell / side as f64;
        finer.depth = parts.depth + 1;
        finer.candidates.clear();
        finer.ends.clear();
        for row in 0..side {
            for column in 0..side {
                let parent = (row / 2) * (side / 2) + column / 2;
                let from = finer.candidates.len();
                let candidates = &parts.candidates[parts.of(parent)];
                reserve(&mut finer.candidates, candidates.len(), DISTANCES)?;
                finer.candidates.extend(candidates);
                let low = [min[0] + column as f64 * size, min[1] + row as f64 * size];
                let high = low.map(|coordinate| coordinate + size);
                self.keep_nearest(low, high, &mut finer.candidates, from);
                finer.ends.push(finer.candidates.len());
            }
        }
        Ok(())
    }

    /// Writes the record of one part of the cell centred at `centre` (in cells).
    fn push(&mut self, centre: Point<2>, candidates: &[u32]) -> Result<(), OutOfMemory> {
        self.make_room()?;
        let grid = &mut self.grid;
        let (record, numbers) = match *candidates {
            [] => ([[FAR; 2]; 2], [NO_POINT; 2]),
            [one] => ([grid.place(one, centre); 2], [one, NO_POINT]),
            [one, other] => ([grid.place(one, centre), grid.place(other, centre)], [one, other]),
            _ => {
                let start = grid.listed.len();
                let fits =
                    candidates.len() <= MAX_LIST && start + candidates.len() <= self.max_listed;
                let length = if fits { candidates.len() as u32 } else { CROWDED };
                let first_block = grid.blocks.len() as u32;
                let blocks = if fits { length.div_ceil(BLOCK as u32) } else { CROWDED };
                grid.lists.push(List { start: start as u32, length });
                if fits {
                    for numbers in candidates.chunks(BLOCK) {
                        let mut block = PointBlock { x: [FAR; BLOCK], y: [FAR; BLOCK] };
                        for (i, &number) in numbers.iter().enumerate() {
                            [block.x[i], block.y[i]] = grid.place(number, centre);
                        }
                        grid.blocks.push(block);
                    }
                    grid.listed.extend(candidates);
                }
                (overfull(first_block, blocks), [LISTED, grid.lists.len() as u32 - 1])
            }
        };
        grid.records.push(record);
        grid.numbers.push(numbers);
        Ok(())
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

#[cfg(test)]
mod tests {
    use super::super::grid::Candidates;
    use super::*;
    use mcl_core::Seed;
    use rand::RngExt;

    /// A wall of 20 m, 3 cm thick, with a hundred points in each nonempty cell.
    fn dense_map() -> PointMap<2> {
        let mut rng = Seed::new(1).rng();
        let wall = |along: f64, across: f64| [20.0 * along, 10.0 + 0.03 * across];
        let points = (0..200_000).map(|_| wall(rng.random(), rng.random())).collect();
        PointMap::new(points).unwrap()
    }

    /// Records are spread over the whole map, and no part of it uses the tree.
    #[test]
    fn records_suffice_for_all_of_a_dense_map() {
        for max_records in [1 << 18, 1 << 20] {
            let grid = build_within(&dense_map(), 1.0, max_records, usize::MAX).unwrap();
            assert!(grid.records.len() <= max_records + 1);
            assert!(grid.lists.iter().all(|list| list.length != CROWDED));
        }
    }

    #[test]
    fn records_written_in_several_turns_find_the_same_points() {
        let map = dense_map();
        let [once, often] = [usize::MAX, 50_000]
            .map(|max_noted| build_within(&map, 1.0, 1 << 20, max_noted).unwrap());
        let nearest = |grid: &Grid, place: Point<2>| match grid.candidates_at(place) {
            Candidates::Few(numbers) => Some(
                numbers
                    .iter()
                    .map(|&number| grid.points[number as usize])
                    .map(|point| (point[0] - place[0]).powi(2) + (point[1] - place[1]).powi(2))
                    .fold(1.0, f64::min),
            ),
            Candidates::Crowded => None,
        };
        let mut rng = Seed::new(2).rng();
        let (mut found, number) = (0, 20_000);
        for _ in 0..number {
            let place = [22.0 * rng.random::<f64>() - 1.0, 9.0 + 2.0 * rng.random::<f64>()];
            if let (Some(once), Some(often)) = (nearest(&once, place), nearest(&often, place)) {
                assert_eq!(once, often, "{place:?}");
                found += 1;
            }
        }
        assert!(10 * found > 9 * number, "{found}");
    }
}
