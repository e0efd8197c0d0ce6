//! Ray casting: the cells that a beam crosses.

/// The cells (column, row) that the segment from `start` to `end` crosses, in order, without the one
/// it ends in. Positions are in cells: cell (i, j) is [i, i + 1) × [j, j + 1).
///
/// Source: J. Amanatides and A. Woo, *A Fast Voxel Traversal Algorithm for Ray Tracing* (1987).
pub(super) fn cells_before_end(start: [f64; 2], end: [f64; 2]) -> impl Iterator<Item = (i64, i64)> {
    let cell = |position: [f64; 2]| position.map(|value| value.floor() as i64);
    let (mut at, last) = (cell(start), cell(end));
    let direction = [0, 1].map(|axis| end[axis] - start[axis]);
    // Position on the segment, from 0 to 1, of its next cell border on each axis, and the distance to the one after.
    let per_cell = direction.map(|d| 1.0 / d.abs());
    let mut next = [0, 1].map(|axis| {
        let inside = start[axis] - at[axis] as f64;
        let distance = if direction[axis] > 0.0 { 1.0 - inside } else { inside };
        distance * per_cell[axis]
    });
    // The number of cells is computed first, so that rounding can neither miss the last cell nor run past it.
    let mut left = [0, 1].map(|axis| at[axis].abs_diff(last[axis]));
    std::iter::from_fn(move || {
        if left == [0, 0] {
            return None;
        }
        let crossed = (at[0], at[1]);
        let axis = usize::from(left[0] == 0 || (left[1] > 0 && next[1] < next[0]));
        at[axis] += if last[axis] > at[axis] { 1 } else { -1 };
        next[axis] += per_cell[axis];
        left[axis] -= 1;
        Some(crossed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cells(start: [f64; 2], end: [f64; 2]) -> Vec<(i64, i64)> {
        cells_before_end(start, end).collect()
    }

    #[test]
    fn beams_that_can_be_drawn() {
        assert_eq!(cells([0.5, 0.5], [3.5, 0.5]), [(0, 0), (1, 0), (2, 0)]);
        assert_eq!(cells([0.5, 2.5], [0.5, 0.2]), [(0, 2), (0, 1)]);
        assert_eq!(cells([0.2, 0.5], [2.4, 1.6]), [(0, 0), (1, 0), (1, 1)]);
        assert_eq!(cells([-0.5, -0.5], [-1.5, 0.2]), [(-1, -1), (-2, -1)]);
        assert_eq!(cells([0.1, 0.1], [0.9, 0.9]), []);
    }

    proptest! {
        #[test]
        fn neighbours_that_the_segment_touches(
            start in [-9.0..9.0f64, -9.0..9.0], end in [-9.0..9.0f64, -9.0..9.0],
        ) {
            let mut crossed = cells(start, end);
            crossed.push((end[0].floor() as i64, end[1].floor() as i64));
            prop_assert_eq!(crossed[0], (start[0].floor() as i64, start[1].floor() as i64));
            for pair in crossed.windows(2) {
                prop_assert_eq!(pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1), 1);
            }
            // The centre of every cell is nearer to the segment than half its diagonal.
            let d = [end[0] - start[0], end[1] - start[1]];
            for &(column, row) in &crossed {
                let from_start = [column as f64 + 0.5 - start[0], row as f64 + 0.5 - start[1]];
                let off = (d[0] * from_start[1] - d[1] * from_start[0]).abs();
                prop_assert!(off <= 0.5_f64.sqrt() * d[0].hypot(d[1]) + 1e-9);
            }
        }
    }
}
