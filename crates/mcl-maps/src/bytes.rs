//! Size of a map in bytes: its content, packed as is usual for its kind of map. Headers (resolution, origin,
//! counts: some tens of bytes) are not counted.

use mcl_core::{NdtMap, PointMap, SegmentMap};

use crate::occupancy::{Cell, OccupancyGrid};

/// Bytes of a point map: one `f32` per coordinate. Coordinates that need `f64` take twice as much.
pub fn point_bytes<const D: usize>(map: &PointMap<D>) -> usize {
    map.len() * D * size_of::<f32>()
}

/// Bytes of an occupancy grid in memory: one per cell, as in the images and messages of ROS.
pub fn grid_bytes(grid: &OccupancyGrid) -> usize {
    grid.cells().len()
}

/// Encodes the cells of an occupancy grid as run lengths.
///
/// Cells are read row by row, and runs continue across rows. A run of n equal cells is encoded as the number
/// 3·(n − 1) + k, with k = 0 for unknown, 1 for free and 2 for occupied cells, as a LEB128 varint: seven bits
/// per byte, lowest first, the eighth set if more bytes follow. Runs of up to 42 cells take one byte.
pub fn grid_run_lengths(grid: &OccupancyGrid) -> Vec<u8> {
    let mut bytes = Vec::new();
    for run in grid.cells().chunk_by(|a, b| a == b) {
        let kind = match run[0] {
            Cell::Unknown => 0,
            Cell::Free => 1,
            Cell::Occupied => 2,
        };
        let mut left = 3 * (run.len() as u64 - 1) + kind;
        while left >= 0x80 {
            bytes.push(left as u8 | 0x80);
            left >>= 7;
        }
        bytes.push(left as u8);
    }
    bytes
}

/// Bytes of an NDT map: 24 per Gaussian, for the cell index (4 bytes), the mean (two `f32`) and the covariance
/// (three `f32`).
pub fn ndt_bytes(map: &NdtMap) -> usize {
    map.cells().len() * (size_of::<u32>() + 5 * size_of::<f32>())
}

/// Bytes of a map of line segments: 16 per segment, one `f32` per coordinate of both ends.
pub fn segment_bytes(map: &SegmentMap) -> usize {
    map.segments().len() * 4 * size_of::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{LineSegment, NdtCell, Pose2};
    use proptest::prelude::*;

    fn grid(width: usize, cells: Vec<Cell>) -> OccupancyGrid {
        OccupancyGrid::new(width, 0.05, Pose2::IDENTITY, cells).unwrap()
    }

    #[test]
    fn bytes_by_hand() {
        let points = PointMap::new(vec![[0.0, 0.0]; 7]).unwrap();
        assert_eq!(point_bytes(&points), 56);
        let covariance = [1.0, 0.0, 1.0];
        let cell = NdtCell { column: 0, row: 0, mean: [0.5, 0.5], covariance };
        assert_eq!(ndt_bytes(&NdtMap::new(1.0, vec![cell; 3]).unwrap()), 72);
        let wall = LineSegment { start: [0.0, 0.0], end: [1.0, 0.0] };
        assert_eq!(segment_bytes(&SegmentMap::new(vec![wall; 3]).unwrap()), 48);
        let (o, f, u) = (Cell::Occupied, Cell::Free, Cell::Unknown);
        let small = grid(4, vec![u, f, f, f, f, f, o, o]);
        assert_eq!(grid_bytes(&small), 8);
        // One unknown: 0; five free, across the end of a row: 3·4 + 1; two occupied: 3·1 + 2.
        assert_eq!(grid_run_lengths(&small), [0, 13, 5]);
        // 3·299 + 1 = 898 = 7·128 + 2.
        assert_eq!(grid_run_lengths(&grid(30, vec![f; 300])), [0x82, 7]);
    }

    fn decoded(bytes: &[u8]) -> Vec<Cell> {
        let mut cells = Vec::new();
        let (mut number, mut shift) = (0u64, 0);
        for byte in bytes {
            number |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                let kind = [Cell::Unknown, Cell::Free, Cell::Occupied][(number % 3) as usize];
                cells.extend(std::iter::repeat_n(kind, (number / 3) as usize + 1));
                (number, shift) = (0, 0);
            }
        }
        cells
    }

    proptest! {
        #[test]
        fn run_lengths_hold_every_cell(
            runs in prop::collection::vec((0..3usize, 1..400usize), 1..40),
        ) {
            let kinds = [Cell::Unknown, Cell::Free, Cell::Occupied];
            let cells: Vec<Cell> = runs
                .iter()
                .flat_map(|&(kind, length)| std::iter::repeat_n(kinds[kind], length))
                .collect();
            prop_assert_eq!(decoded(&grid_run_lengths(&grid(1, cells.clone()))), cells);
        }
    }
}
