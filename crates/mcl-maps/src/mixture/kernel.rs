use mcl_core::Bounds;

use super::exp::exp_nonpositive;
use crate::point_set::LANES;

type Lanes = [f64; LANES];

/// Components by coordinate: `coordinates[axis][j]`, and the place of each in the caller's list.
#[derive(Clone)]
pub(super) struct Components<const D: usize> {
    pub coordinates: [Vec<f64>; D],
    pub places: Vec<u32>,
}

impl<const D: usize> Default for Components<D> {
    fn default() -> Self {
        Components { coordinates: std::array::from_fn(|_| Vec::new()), places: Vec::new() }
    }
}

impl<const D: usize> Components<D> {
    pub fn len(&self) -> usize {
        self.places.len()
    }

    fn resize(&mut self, len: usize) {
        self.coordinates.iter_mut().for_each(|axis| axis.resize(len, 0.0));
        self.places.resize(len, 0);
    }
}

/// Squared distances from each component to the nearest and to the furthest place in a box.
#[inline(always)]
fn box_distances<const D: usize>(
    components: &Components<D>,
    bounds: &Bounds<D>,
    near: &mut [f64],
    far: &mut [f64],
) {
    near.fill(0.0);
    far.fill(0.0);
    for axis in 0..D {
        let (min, max) = (bounds.min[axis], bounds.max[axis]);
        let coordinates = &components.coordinates[axis];
        for ((&c, near), far) in coordinates.iter().zip(near.iter_mut()).zip(far.iter_mut()) {
            let (below, above) = (min - c, c - max);
            let outside = if below > above { below } else { above };
            let outside = if outside > 0.0 { outside } else { 0.0 };
            let (to_max, to_min) = (max - c, c - min);
            let across = if to_max > to_min { to_max } else { to_min };
            *near += outside * outside;
            *far += across * across;
        }
    }
}

/// Keeps the components that a point in the box may need: those whose squared distance to the box is
/// at most `reach` more than the smallest squared distance within which every place in the box has a
/// component.
#[inline(always)]
pub(super) fn filter<const D: usize>(
    components: &Components<D>,
    bounds: &Bounds<D>,
    reach: f64,
    scratch: &mut Vec<f64>,
    kept: &mut Components<D>,
) {
    let len = components.len();
    scratch.resize(2 * len, 0.0);
    let (near, far) = scratch.split_at_mut(len);
    box_distances(components, bounds, near, far);
    let covered = far.iter().copied().fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    // A hair of slack for the rounding of the distances themselves.
    let limit = (covered + reach) * (1.0 + 1e-12);
    kept.resize(len);
    let mut count = 0;
    for (j, &near) in near.iter().enumerate() {
        for axis in 0..D {
            kept.coordinates[axis][count] = components.coordinates[axis][j];
        }
        kept.places[count] = components.places[j];
        count += usize::from(near <= limit);
    }
    kept.resize(count);
}

/// Working memory of [`leaf`]: per pair of component and point first the squared distance, then the
/// exponential.
#[derive(Default)]
pub(super) struct LeafScratch {
    pairs: Vec<Lanes>,
    nearest: Vec<Lanes>,
    sums: Vec<Lanes>,
}

/// Weight and weighted displacement that the points of a leaf give to a component: Σᵢ pᵢⱼ and
/// Σᵢ pᵢⱼ·(xᵢ − μⱼ), with pᵢⱼ of equation 4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pull<const D: usize> {
    pub weight: f64,
    pub displacement: [f64; D],
}

impl<const D: usize> Pull<D> {
    pub const NONE: Self = Pull { weight: 0.0, displacement: [0.0; D] };

    pub fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        for axis in 0..D {
            self.displacement[axis] += other.displacement[axis];
        }
    }
}

/// Evaluates one leaf: returns Σᵢ ln Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²) over its `count` points, and, where
/// `pulls` is given, adds what the points pull at the components to `pulls[components.places[j]]`.
///
/// `coordinates` holds `padded(count)` numbers per axis.
#[inline(always)]
pub(super) fn leaf<const D: usize>(
    coordinates: &[f64],
    count: usize,
    components: &Components<D>,
    inverse_two_variance: f64,
    scratch: &mut LeafScratch,
    pulls: Option<&mut [Pull<D>]>,
) -> f64 {
    let width = coordinates.len() / D / LANES;
    let (chunks, _) = coordinates.as_chunks::<LANES>();
    let axes: [&[Lanes]; D] = std::array::from_fn(|axis| &chunks[axis * width..(axis + 1) * width]);
    let len = components.len();
    // Every element is written before it is read; only growth has to be initialised.
    if scratch.pairs.len() < len * width {
        scratch.pairs.resize(len * width, [0.0; LANES]);
    }
    let pairs = &mut scratch.pairs[..len * width];
    scratch.nearest.clear();
    scratch.nearest.resize(width, [f64::INFINITY; LANES]);
    scratch.sums.clear();
    scratch.sums.resize(width, [0.0; LANES]);

    for (j, row) in pairs.chunks_exact_mut(width).enumerate() {
        let mean: [f64; D] = std::array::from_fn(|axis| components.coordinates[axis][j]);
        for (chunk, (pair, nearest)) in row.iter_mut().zip(&mut scratch.nearest).enumerate() {
            for lane in 0..LANES {
                let mut distance = 0.0;
                for axis in 0..D {
                    let difference = axes[axis][chunk][lane] - mean[axis];
                    distance += difference * difference;
                }
                pair[lane] = distance;
                nearest[lane] = if distance < nearest[lane] { distance } else { nearest[lane] };
            }
        }
    }
    for row in pairs.chunks_exact_mut(width) {
        for ((pair, nearest), sum) in row.iter_mut().zip(&scratch.nearest).zip(&mut scratch.sums) {
            for lane in 0..LANES {
                let e = exp_nonpositive((nearest[lane] - pair[lane]) * inverse_two_variance);
                pair[lane] = e;
                sum[lane] += e;
            }
        }
    }
    // Padding repeats the last point: it counts nowhere.
    let is_point = |chunk: usize, lane: usize| chunk * LANES + lane < count;
    let mut log_sum = 0.0;
    let mut product = [1.0; LANES];
    let mut nearest_sum = [0.0; LANES];
    for (chunk, (sum, nearest)) in scratch.sums.iter_mut().zip(&scratch.nearest).enumerate() {
        for lane in 0..LANES {
            let real = is_point(chunk, lane);
            // Each sum lies in [1, K] and K in [1, 2³²]: a product of the 6 chunks of a leaf lies
            // below 2¹⁹², and that of four lanes below 2⁷⁶⁸.
            product[lane] *= if real { sum[lane] } else { 1.0 };
            nearest_sum[lane] += if real { nearest[lane] } else { 0.0 };
            sum[lane] = if real { 1.0 / sum[lane] } else { 0.0 };
        }
    }
    for half in product.chunks_exact(4) {
        log_sum += ((half[0] * half[1]) * (half[2] * half[3])).ln();
    }
    log_sum -= fold(&nearest_sum) * inverse_two_variance;

    let Some(pulls) = pulls else { return log_sum };
    for (j, row) in pairs.chunks_exact(width).enumerate() {
        let mean: [f64; D] = std::array::from_fn(|axis| components.coordinates[axis][j]);
        let mut weight = [0.0; LANES];
        let mut displacement = [[0.0; LANES]; D];
        for (chunk, (pair, inverse)) in row.iter().zip(&scratch.sums).enumerate() {
            for lane in 0..LANES {
                let responsibility = pair[lane] * inverse[lane];
                weight[lane] += responsibility;
                for axis in 0..D {
                    displacement[axis][lane] +=
                        responsibility * (axes[axis][chunk][lane] - mean[axis]);
                }
            }
        }
        let pull = Pull {
            weight: fold(&weight),
            displacement: std::array::from_fn(|axis| fold(&displacement[axis])),
        };
        pulls[components.places[j] as usize].add(&pull);
    }
    log_sum
}

/// The sum over the lanes, always in the same order.
#[inline(always)]
fn fold(lanes: &Lanes) -> f64 {
    let [a, b, c, d, e, f, g, h] = *lanes;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}
