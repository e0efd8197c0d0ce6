//! Selection of the components that the points in a box may need.

use mcl_core::{Bounds, Point};
use pulp::NullaryFnOnce;

/// Number of components processed together: large enough that the compiler vectorizes the loop over them instead of
/// unrolling it.
const CHUNK: usize = 16;

/// Components by coordinate: `coordinates[axis]`, in chunks, and the index of each in the caller's list.
/// Padding after the last component has infinite coordinates.
#[derive(Clone)]
pub(super) struct Components<const D: usize> {
    coordinates: [Vec<[f64; CHUNK]>; D],
    pub places: Vec<u32>,
}

impl<const D: usize> Default for Components<D> {
    fn default() -> Self {
        Components { coordinates: std::array::from_fn(|_| Vec::new()), places: Vec::new() }
    }
}

impl<const D: usize> Components<D> {
    pub fn new(means: &[Point<D>]) -> Self {
        let mut components = Self::default();
        components.fill(means.len(), |j, axis| means[j][axis], |j| j as u32);
        components
    }

    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// One coordinate of all components.
    #[inline(always)]
    pub fn coordinates(&self, axis: usize) -> &[f64] {
        &self.coordinates[axis].as_flattened()[..self.len()]
    }

    /// Replaces the content by `len` components; `coordinate` gets the number of a component and an axis.
    #[inline(always)]
    fn fill(
        &mut self,
        len: usize,
        coordinate: impl Fn(usize, usize) -> f64,
        place: impl Fn(usize) -> u32,
    ) {
        let chunks = len.div_ceil(CHUNK);
        for axis in 0..D {
            let chunked = &mut self.coordinates[axis];
            chunked.resize(chunks, [f64::INFINITY; CHUNK]);
            if let Some(last) = chunked.last_mut() {
                *last = [f64::INFINITY; CHUNK];
            }
            for (j, to) in chunked.as_flattened_mut()[..len].iter_mut().enumerate() {
                *to = coordinate(j, axis);
            }
        }
        self.places.clear();
        self.places.extend((0..len).map(place));
    }
}

/// Keeps the components that a point in the box may need: those whose squared distance to the box is
/// at most `reach` more than the smallest squared distance within which every position in the box has
/// `NEAREST` components (one or two). Returns that smallest squared distance.
pub(super) struct Filter<'a, const D: usize, const NEAREST: usize> {
    pub components: &'a Components<D>,
    pub bounds: &'a Bounds<D>,
    pub reach: f64,
    pub scratch: &'a mut FilterScratch,
    pub kept: &'a mut Components<D>,
}

/// Working memory of [`Filter`].
#[derive(Default)]
pub(super) struct FilterScratch {
    /// Squared distances from each component to the nearest position in the box.
    near: Vec<[f64; CHUNK]>,
    chosen: Vec<u32>,
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
impl<const D: usize, const NEAREST: usize> NullaryFnOnce for Filter<'_, D, NEAREST> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let Filter { components, bounds, reach, scratch, kept } = self;
        let FilterScratch { near, chosen } = scratch;
        let len = components.len();
        let chunks = len.div_ceil(CHUNK);
        if near.len() < chunks {
            near.resize(chunks, [0.0; CHUNK]);
            chosen.resize(chunks * CHUNK, 0);
        }
        let near = &mut near[..chunks];
        let covered = box_distances::<D, NEAREST>(components, bounds, near);
        // A little slack for the rounding of the distances.
        let limit = (covered + reach) * (1.0 + 1e-12);
        // Branch-free, because branches would be hard to predict.
        let mut count = 0;
        for (j, &near) in near.as_flattened()[..len].iter().enumerate() {
            chosen[count] = j as u32;
            count += usize::from(near <= limit);
        }
        let chosen = &chosen[..count];
        let mut from: [&[f64]; D] = [&[]; D];
        for axis in 0..D {
            from[axis] = components.coordinates(axis);
        }
        kept.fill(
            count,
            |j, axis| from[axis][chosen[j] as usize],
            |j| components.places[chosen[j] as usize],
        );
        covered
    }
}

/// Computes squared distances from each component to the nearest position in a box; returns the smallest (`NEAREST`
/// 2: the second smallest) of the squared distances to the farthest position.
#[inline(always)]
fn box_distances<const D: usize, const NEAREST: usize>(
    components: &Components<D>,
    bounds: &Bounds<D>,
    near: &mut [[f64; CHUNK]],
) -> f64 {
    let center = bounds.center();
    let mut half = [0.0; D];
    for axis in 0..D {
        half[axis] = 0.5 * bounds.extent(axis);
    }
    let mut smallest = [[f64::INFINITY; CHUNK]; NEAREST];
    for (chunk, near) in near.iter_mut().enumerate() {
        let mut coordinates = [[0.0; CHUNK]; D];
        for axis in 0..D {
            coordinates[axis] = components.coordinates[axis][chunk];
        }
        for lane in 0..CHUNK {
            let (mut to_near, mut to_far) = (0.0, 0.0);
            for axis in 0..D {
                let from_center = (coordinates[axis][lane] - center[axis]).abs();
                let outside = from_center - half[axis];
                let outside = if outside > 0.0 { outside } else { 0.0 };
                let across = from_center + half[axis];
                to_near += outside * outside;
                to_far += across * across;
            }
            near[lane] = to_near;
            // The larger of the two moves on to the next rank.
            for of_rank in &mut smallest {
                let known = of_rank[lane];
                of_rank[lane] = if to_far < known { to_far } else { known };
                to_far = if to_far < known { known } else { to_far };
            }
        }
    }
    let mut ranked = [f64::INFINITY; NEAREST];
    for mut value in smallest.into_iter().flatten() {
        for of_rank in &mut ranked {
            let known = *of_rank;
            *of_rank = if value < known { value } else { known };
            value = if value < known { known } else { value };
        }
    }
    ranked[NEAREST - 1]
}
