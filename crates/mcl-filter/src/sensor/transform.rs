//! Distance transform of a grid.

use mcl_core::math;

/// Squared distances, in cells, from the centre of each cell to that of the nearest occupied cell; infinite
/// if there is none. They are computed along columns first, then as the lower envelope of one parabola per column
/// along each row: P. Felzenszwalb and D. Huttenlocher, *Distance Transforms of Sampled Functions*, Theory of
/// Computing 8 (2012). Exact, because all compared numbers are integers or quotients of integers.
pub(super) fn squared_distances(width: usize, occupied: &[bool]) -> Vec<f64> {
    let height = occupied.len() / width;
    let mut squared = vec![f64::INFINITY; occupied.len()];
    for column in 0..width {
        // Upwards, then downwards: the number of cells since the last occupied one.
        let mut since = f64::INFINITY;
        for row in (0..height).chain((0..height).rev()) {
            let cell = row * width + column;
            since = if occupied[cell] { 0.0 } else { since + 1.0 };
            squared[cell] = squared[cell].min(since * since);
        }
    }
    let mut envelope: Vec<Parabola> = Vec::with_capacity(width);
    for row in squared.chunks_mut(width) {
        envelope.clear();
        for (column, &height) in row.iter().enumerate().filter(|(_, height)| height.is_finite()) {
            let mut parabola = Parabola { vertex: column as f64, height, from: f64::NEG_INFINITY };
            while let Some(last) = envelope.last() {
                parabola.from = last.meets(&parabola);
                if parabola.from > last.from {
                    break;
                }
                envelope.pop();
                parabola.from = f64::NEG_INFINITY;
            }
            envelope.push(parabola);
        }
        let mut lowest = 0;
        for (column, value) in row.iter_mut().enumerate() {
            let x = column as f64;
            while envelope.get(lowest + 1).is_some_and(|next| next.from <= x) {
                lowest += 1;
            }
            if let Some(parabola) = envelope.get(lowest) {
                *value = math::square(x - parabola.vertex) + parabola.height;
            }
        }
    }
    squared
}

/// The parabola (x − vertex)² + height, which is the lowest one from `from` on.
struct Parabola {
    vertex: f64,
    height: f64,
    from: f64,
}

impl Parabola {
    /// The x from which a parabola with a vertex farther right is lower.
    fn meets(&self, right: &Parabola) -> f64 {
        let sum = |parabola: &Parabola| parabola.height + parabola.vertex * parabola.vertex;
        (sum(right) - sum(self)) / (2.0 * (right.vertex - self.vertex))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_transform_is_that_of_brute_force(
            width in 1..12usize,
            height in 1..12usize,
            dense in any::<bool>(),
            seed in prop::collection::vec(0..10u8, 144),
        ) {
            let limit = if dense { 4 } else { 1 };
            let occupied: Vec<bool> = seed[..width * height].iter().map(|&n| n < limit).collect();
            let place = |cell: usize| ((cell % width) as f64, (cell / width) as f64);
            for (cell, &found) in squared_distances(width, &occupied).iter().enumerate() {
                let (x, y) = place(cell);
                let distances = (0..occupied.len()).filter(|&other| occupied[other]).map(|other| {
                    (place(other).0 - x).powi(2) + (place(other).1 - y).powi(2)
                });
                prop_assert_eq!(found, distances.fold(f64::INFINITY, f64::min));
            }
        }
    }
}
