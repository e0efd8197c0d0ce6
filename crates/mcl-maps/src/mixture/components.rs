//! Which components a box of points may need.

use mcl_core::Bounds;
use pulp::NullaryFnOnce;

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
}

/// Working memory of [`Filter`].
#[derive(Default)]
pub(super) struct FilterScratch {
    distances: Vec<f64>,
    chosen: Vec<u32>,
}

/// Keeps the components that a point in the box may need: those whose squared distance to the box is
/// at most `reach` more than the smallest squared distance within which every place in the box has a
/// component. Returns that smallest squared distance.
pub(super) struct Filter<'a, const D: usize> {
    pub components: &'a Components<D>,
    pub bounds: &'a Bounds<D>,
    pub reach: f64,
    pub scratch: &'a mut FilterScratch,
    pub kept: &'a mut Components<D>,
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
impl<const D: usize> NullaryFnOnce for Filter<'_, D> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let Filter { components, bounds, reach, scratch, kept } = self;
        let FilterScratch { distances, chosen } = scratch;
        let len = components.len();
        if distances.len() < 2 * len {
            distances.resize(2 * len, 0.0);
        }
        let (near, far) = distances.split_at_mut(len);
        let far = &mut far[..len];
        box_distances(components, bounds, near, far);
        let covered = smallest(far);
        // A hair of slack for the rounding of the distances themselves.
        let limit = (covered + reach) * (1.0 + 1e-12);
        // Without branches, which would be hard to predict.
        chosen.resize(len.max(chosen.len()), 0);
        let mut count = 0;
        for (j, near) in near.iter().enumerate() {
            chosen[count] = j as u32;
            count += usize::from(*near <= limit);
        }
        let chosen = &chosen[..count];
        for axis in 0..D {
            let coordinates = &components.coordinates[axis][..len];
            kept.coordinates[axis].clear();
            kept.coordinates[axis].extend(chosen.iter().map(|&j| coordinates[j as usize]));
        }
        let places = &components.places[..len];
        kept.places.clear();
        kept.places.extend(chosen.iter().map(|&j| places[j as usize]));
        covered
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
    let len = near.len();
    let far = &mut far[..len];
    let coordinates: [&[f64]; D] = std::array::from_fn(|axis| &components.coordinates[axis][..len]);
    let center = bounds.center();
    let half: [f64; D] = std::array::from_fn(|axis| 0.5 * bounds.extent(axis));
    for j in 0..len {
        let (mut to_near, mut to_far) = (0.0, 0.0);
        for axis in 0..D {
            let from_center = (coordinates[axis][j] - center[axis]).abs();
            let outside = from_center - half[axis];
            let outside = if outside > 0.0 { outside } else { 0.0 };
            let across = from_center + half[axis];
            to_near += outside * outside;
            to_far += across * across;
        }
        near[j] = to_near;
        far[j] = to_far;
    }
}

/// The smallest number, infinity for none.
#[inline(always)]
fn smallest(numbers: &[f64]) -> f64 {
    let min = |a: f64, b: f64| if b < a { b } else { a };
    let mut lanes = [f64::INFINITY; 8];
    let (chunks, rest) = numbers.as_chunks::<8>();
    for chunk in chunks {
        for lane in 0..8 {
            lanes[lane] = min(lanes[lane], chunk[lane]);
        }
    }
    lanes.iter().chain(rest).copied().fold(f64::INFINITY, min)
}
