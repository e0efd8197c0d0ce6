//! The inner loop of the E step: one leaf of points and the components that they need.

use std::f64::consts::LOG2_E;

use pulp::NullaryFnOnce;

use super::components::Components;
use super::exp::exp2_bounded;
use super::log_product::LogProduct;
use crate::point_set::{LEAF_POINTS, LeafPoints};

/// Sums of exponentials of at least this power of two are far enough above the smallest value of
/// [`exp2_bounded`] that the exponents need no shift.
const UNSHIFTED: f64 = 600.0;

pub(super) type Row = [f64; LEAF_POINTS];

/// A sum in parts, one per lane of a vector.
type Lanes = [f64; LANES];
const LANES: usize = 4;

/// The pull of points on a component: its total responsibility Σᵢ pᵢⱼ and the weighted displacement
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

/// The partial sums of a [`Pull`].
#[derive(Debug, Clone, Copy)]
pub(super) struct PullLanes<const D: usize> {
    weight: Lanes,
    displacement: [Lanes; D],
}

impl<const D: usize> PullLanes<D> {
    pub const NONE: Self = PullLanes { weight: [0.0; LANES], displacement: [[0.0; LANES]; D] };

    /// Adds `count` points at a mean `displacement` from the component, which alone is responsible for them.
    pub fn add(&mut self, count: f64, displacement: [f64; D]) {
        self.weight[0] += count;
        for axis in 0..D {
            self.displacement[axis][0] += count * displacement[axis];
        }
    }

    pub fn total(&self) -> Pull<D> {
        let total = |[a, b, c, d]: Lanes| (a + c) + (b + d);
        Pull { weight: total(self.weight), displacement: self.displacement.map(total) }
    }
}

/// √(log₂e/2σ²): with lengths multiplied by this, the density of a component falls as 2^−d².
pub(super) fn inverse_unit(sigma: f64) -> f64 {
    (0.5 * LOG2_E).sqrt() / sigma
}

/// Evaluates one leaf: multiplies `sums` by Πᵢ Σⱼ exp(−‖xᵢ−μⱼ‖²/2σ²) over its points and, if
/// `pulls` is given, adds the pull of the points on the components to `pulls[components.places[j]]`.
pub(super) struct Leaf<'a, const D: usize> {
    pub points: &'a LeafPoints<D>,
    /// Number of points; the rest is padding.
    pub count: usize,
    /// The centre of the bounding box of the points (m).
    pub center: [f64; D],
    pub components: &'a Components<D>,
    /// Squared distance (m²) within which every point has a component.
    pub covered: f64,
    pub inverse_unit: f64,
    /// Working memory.
    pub rows: &'a mut Vec<Row>,
    pub sums: &'a mut LogProduct,
    pub pulls: Option<&'a mut [PullLanes<D>]>,
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
impl<const D: usize> NullaryFnOnce for Leaf<'_, D> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Leaf { count, center, components, inverse_unit: scale, .. } = self;
        let mut points = centred_leaf(self.points, &center, scale);
        let mean = |j: usize| -> [f64; D] {
            std::array::from_fn(|axis| (components.coordinates(axis)[j] - center[axis]) * scale)
        };
        let len = components.len();

        // Far from all components, exponents are relative to that of the nearest.
        let mut shift = [0.0; LEAF_POINTS];
        if self.covered * scale * scale > UNSHIFTED {
            shift = [f64::INFINITY; LEAF_POINTS];
            for j in 0..len {
                let mean = mean(j);
                for i in 0..LEAF_POINTS {
                    let squared = squared_distance(&points, i, &mean);
                    shift[i] = if squared < shift[i] { squared } else { shift[i] };
                }
            }
        }

        if self.rows.len() < len {
            self.rows.resize(len, [0.0; LEAF_POINTS]);
        }
        let rows = &mut self.rows[..len];
        let mut sums = [0.0; LEAF_POINTS];
        for (j, row) in rows.iter_mut().enumerate() {
            let mean = mean(j);
            for i in 0..LEAF_POINTS {
                row[i] = exp2_bounded(shift[i] - squared_distance(&points, i, &mean));
                sums[i] += row[i];
            }
        }
        self.sums.multiply(&sums, &shift, count);

        let Some(pulls) = self.pulls else { return };
        // Σᵢ pᵢⱼ·(xᵢ − μⱼ) = Σᵢ eᵢⱼ·(xᵢ/sᵢ) − μⱼ·Σᵢ eᵢⱼ·(1/sᵢ)
        let mut inverse = [0.0; LEAF_POINTS];
        for i in 0..LEAF_POINTS {
            inverse[i] = if i < count { 1.0 / sums[i] } else { 0.0 };
            for axis in 0..D {
                points[axis][i] *= inverse[i];
            }
        }
        let unit = 1.0 / scale;
        for (j, row) in rows.iter().enumerate() {
            let mean = mean(j);
            let pull = &mut pulls[components.places[j] as usize];
            let weight = dot(row, &inverse);
            for lane in 0..LANES {
                pull.weight[lane] += weight[lane];
            }
            for axis in 0..D {
                let sum = dot(row, &points[axis]);
                for lane in 0..LANES {
                    pull.displacement[axis][lane] += (sum[lane] - mean[axis] * weight[lane]) * unit;
                }
            }
        }
    }
}

/// Scales lengths to the unit, relative to the centre of the box.
#[inline(always)]
pub(super) fn centred_leaf<const D: usize>(
    leaf: &LeafPoints<D>,
    center: &[f64; D],
    scale: f64,
) -> LeafPoints<D> {
    let mut points = [[0.0; LEAF_POINTS]; D];
    for axis in 0..D {
        for i in 0..LEAF_POINTS {
            points[axis][i] = (leaf[axis][i] - center[axis]) * scale;
        }
    }
    points
}

/// Squared distance from one of the points. The rounding is the same wherever it is used, so that the exponent of the
/// nearest component, relative to itself, is exactly 0.
#[inline(always)]
pub(super) fn squared_distance<const D: usize>(
    points: &LeafPoints<D>,
    i: usize,
    mean: &[f64; D],
) -> f64 {
    let first = points[0][i] - mean[0];
    let mut squared = first * first;
    for axis in 1..D {
        let difference = points[axis][i] - mean[axis];
        squared += difference * difference;
    }
    squared
}

/// Σ aᵢ·bᵢ in partial sums: lane l sums i = l, l + 4, l + 8, ...
#[inline(always)]
fn dot(a: &Row, b: &Row) -> Lanes {
    let mut sums = [0.0; LANES];
    for first in (0..LEAF_POINTS).step_by(LANES) {
        for lane in 0..LANES {
            sums[lane] += a[first + lane] * b[first + lane];
        }
    }
    sums
}
