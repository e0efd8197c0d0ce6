use mcl_core::Seed;

/// Draws the indices of `count` distinct points of `available` without replacement, in ascending order.
///
/// `count` is at most `available`.
pub fn sample_random(available: usize, count: usize, seed: Seed) -> Vec<usize> {
    debug_assert!(count <= available);
    let mut indices = rand::seq::index::sample(&mut seed.rng(), available, count).into_vec();
    indices.sort_unstable();
    indices
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pinned values, so that no dependency can silently change results; one draw per algorithm that the
    /// library may choose.
    #[test]
    fn draws_are_stable() {
        assert_eq!(sample_random(1000, 4, Seed::new(1)), [124, 291, 379, 996]);
        let sums = [100, 500, 4000]
            .map(|count| sample_random(155_648, count, Seed::new(1)).iter().sum::<usize>());
        assert_eq!(sums, [7_902_227, 39_020_774, 307_467_880]);
    }

    #[test]
    fn every_point_is_equally_likely() {
        let mut counts = [0u32; 20];
        for run in 0..4000 {
            for index in sample_random(20, 5, Seed::new(7).derive_index(run)) {
                counts[index] += 1;
            }
        }
        // Binomial(4000, 1/4): standard deviation 27.4; 5 of them.
        assert!(counts.iter().all(|&count| count.abs_diff(1000) < 137), "{counts:?}");
    }

    #[test]
    fn a_sample_of_all_points_has_every_point() {
        assert_eq!(sample_random(5, 5, Seed::new(1)), [0, 1, 2, 3, 4]);
    }
}
