use mcl_core::Point;
use rayon::prelude::*;

use crate::PointSet;

/// Number of 2-means iterations.
const HALVING_ROUNDS: usize = 3;
/// Number of power iterations for the longest axis of a cluster.
const AXIS_STEPS: usize = 8;

/// A component replaced by two.
pub(super) struct Split<const D: usize> {
    /// Index of the component.
    pub component: usize,
    /// The means of the two halves of its points.
    pub halves: [Point<D>; 2],
}

/// Computes a split of each component that is nearest to at least two different points, with its gain: the decrease
/// (m²) of the sum of squared distances of its points. `nearest` is the component nearest to each point, in the order
/// of the tree.
pub(super) fn splits<const D: usize>(
    data: &PointSet<D>,
    components: usize,
    nearest: impl Iterator<Item = u32> + Clone,
) -> Vec<(f64, Split<D>)> {
    // Groups the points by component with a counting sort.
    let mut ends = vec![0; components];
    for component in nearest.clone() {
        ends[component as usize] += 1;
    }
    let mut starts = Vec::with_capacity(components + 1);
    let mut total = 0;
    for end in &mut ends {
        starts.push(total);
        total += *end;
        *end = *starts.last().expect("just pushed");
    }
    starts.push(total);
    let mut points = vec![[0.0; D]; total];
    for (component, point) in nearest.zip(data.tree().leaf_points()) {
        let end = &mut ends[component as usize];
        points[*end] = point;
        *end += 1;
    }
    (0..components)
        .into_par_iter()
        .filter_map(|component| {
            let (halves, gain) = halve(&points[starts[component]..starts[component + 1]])?;
            Some((gain, Split { component, halves }))
        })
        .collect()
}

/// Two means of a cluster (2-means, started on both sides of the mean along its longest axis), and the decrease of the
/// sum of squared distances from that with one mean.
fn halve<const D: usize>(cluster: &[Point<D>]) -> Option<([Point<D>; 2], f64)> {
    let count = cluster.len() as f64;
    let mean = mean(cluster.iter(), count)?;
    let axis = longest_axis(cluster, &mean)?;
    let mut sides: [Point<D>; 2] = [-1.0, 1.0].map(|sign| along(&mean, &axis, sign));
    let mut counts = [0.0; 2];
    for _ in 0..HALVING_ROUNDS {
        let mut sums = [[0.0; D]; 2];
        counts = [0.0; 2];
        for point in cluster {
            let [a, b] = sides.map(|side| squared_distance(point, &side));
            let side = usize::from(b < a);
            counts[side] += 1.0;
            for axis in 0..D {
                // Relative to the mean, so that no digits are lost.
                sums[side][axis] += point[axis] - mean[axis];
            }
        }
        if counts.contains(&0.0) {
            return None;
        }
        for side in 0..2 {
            sides[side] = std::array::from_fn(|axis| mean[axis] + sums[side][axis] / counts[side]);
        }
    }
    let gain = counts[0] * counts[1] / count * squared_distance(&sides[0], &sides[1]);
    (gain > 0.0).then_some((sides, gain))
}

/// The direction of the largest spread, with the spread (one standard deviation or less) as its length; `None`
/// if all points are equal.
fn longest_axis<const D: usize>(cluster: &[Point<D>], mean: &Point<D>) -> Option<Point<D>> {
    let mut scatter = [[0.0; D]; D];
    for point in cluster {
        for row in 0..D {
            for column in 0..D {
                scatter[row][column] += (point[row] - mean[row]) * (point[column] - mean[column]);
            }
        }
    }
    // Power iteration from the coordinate axis with the largest spread, which is never orthogonal to the wanted
    // eigenvector.
    let widest = (0..D).max_by(|&a, &b| scatter[a][a].total_cmp(&scatter[b][b]))?;
    let mut direction: Point<D> = std::array::from_fn(|axis| scatter[axis][widest]);
    let mut spread = 0.0;
    for _ in 0..AXIS_STEPS {
        let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        direction = direction.map(|d| d / length);
        let image: Point<D> = std::array::from_fn(|row| {
            (0..D).map(|column| scatter[row][column] * direction[column]).sum()
        });
        spread = (0..D).map(|axis| image[axis] * direction[axis]).sum();
        direction = image;
    }
    let deviation = (spread / cluster.len() as f64).sqrt();
    Some(direction.map(|d| d / spread * deviation))
}

fn mean<'a, const D: usize>(
    points: impl Iterator<Item = &'a Point<D>>,
    count: f64,
) -> Option<Point<D>> {
    let mut sum = [0.0; D];
    for point in points {
        for axis in 0..D {
            sum[axis] += point[axis];
        }
    }
    (count > 1.0).then(|| sum.map(|sum| sum / count))
}

fn along<const D: usize>(from: &Point<D>, direction: &Point<D>, times: f64) -> Point<D> {
    std::array::from_fn(|axis| from[axis] + times * direction[axis])
}

fn squared_distance<const D: usize>(a: &Point<D>, b: &Point<D>) -> f64 {
    (0..D).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_clusters_are_separated() {
        let cluster = [[0.0, 0.0], [0.2, 0.0], [9.0, 3.0], [9.2, 3.0], [9.1, 3.3]];
        let (mut halves, gain) = halve(&cluster).unwrap();
        halves.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let expected = [[0.1, 0.0], [9.1, 3.1]];
        for (half, expected) in halves.iter().flatten().zip(expected.iter().flatten()) {
            assert!((half - expected).abs() < 1e-12, "{halves:?}");
        }
        // 2·3/5 · (9² + 3.1²)
        assert!((gain - 1.2 * (81.0 + 3.1 * 3.1)).abs() < 1e-9, "{gain}");
    }

    #[test]
    fn equal_points_and_single_points_are_not_split() {
        assert!(halve(&[[1.0, 2.0]]).is_none());
        assert!(halve(&[[1.0, 2.0]; 7]).is_none());
        assert!(halve::<2>(&[]).is_none());
    }

    #[test]
    fn the_axis_of_a_diagonal_is_found() {
        let cluster: Vec<[f64; 2]> = (0..11).map(|i| [f64::from(i), -2.0 * f64::from(i)]).collect();
        let axis = longest_axis(&cluster, &[5.0, -10.0]).unwrap();
        assert!((axis[1] / axis[0] + 2.0).abs() < 1e-9);
        // The variance of 0..10 is 10, and 5 times that along the diagonal.
        assert!((axis[0].hypot(axis[1]) - 50_f64.sqrt()).abs() < 1e-9);
    }
}
