//! The loop around [`Lookup`] that weights particles by the beams of a scan.

use std::ops::Range;

use super::Poses;
use super::exp::{LEAST, exp2_nonpositive};
use super::fetch::{Fetch, PADDING, Task};
use super::grid::Grid;
use super::lookup::{Lookup, Workspace};

/// A chunk of particles, in cells of the grid, and their sums or products over the beams so far.
#[derive(Default)]
pub(super) struct Chunk {
    poses: [Vec<f64>; 4],
    near: [Vec<f32>; 6],
    combined: Vec<f32>,
    value: Vec<f64>,
    workspace: Box<Workspace>,
}

/// Largest distance from the first cell of the grid, in cells, at which cells are distinguished.
const FARTHEST_CELL: f64 = 4_194_304.0;

impl Chunk {
    /// Loads the poses in `range`, at most [`CHUNK`](super::lookup::CHUNK).
    ///
    /// The list is padded to whole vectors with poses whose results are not used.
    pub fn load(&mut self, grid: &Grid, poses: &Poses<'_>, range: Range<usize>, neutral: f64) {
        let number = range.len().next_multiple_of(PADDING);
        let [x, y, sin, cos] = &mut self.poses;
        let [column, row, from_x, from_y, near_sin, near_cos] = &mut self.near;
        for (to, from) in [(&mut *sin, poses.sin), (&mut *cos, poses.cos)] {
            to.clear();
            to.extend_from_slice(&from[range.clone()]);
        }
        for (axis, to, from) in [(0, &mut *x, poses.x), (1, &mut *y, poses.y)] {
            to.clear();
            to.extend(from[range.clone()].iter().map(|&metres| grid.in_cells(axis, metres)));
        }
        for coordinates in [&mut *x, &mut *y, &mut *sin, &mut *cos] {
            coordinates.resize(number, 0.0);
        }
        for (places, cells, from) in [(&*x, column, from_x), (&*y, row, from_y)] {
            let cell = |place: f64| place.round().clamp(-FARTHEST_CELL, FARTHEST_CELL);
            cells.clear();
            cells.extend(places.iter().map(|&place| cell(place) as f32));
            from.clear();
            from.extend(places.iter().map(|&place| (place - cell(place)).clamp(-0.5, 0.5) as f32));
        }
        for (exact, near) in [(&*sin, near_sin), (&*cos, near_cos)] {
            near.clear();
            near.extend(exact.iter().map(|&value| value as f32));
        }
        self.combined.resize(number, 0.0);
        self.value.clear();
        self.value.resize(number, neutral);
    }

    /// Adds the values, as log-likelihoods, to the log-weights of the particles and resets the values to neutral.
    pub fn take_values(
        &mut self,
        log_weights: &mut [f64],
        neutral: f64,
        log_likelihood: impl Fn(f64) -> f64,
    ) {
        for (log_weight, value) in log_weights.iter_mut().zip(&mut self.value) {
            *log_weight += log_likelihood(*value);
            *value = neutral;
        }
    }
}

/// The update of the value of a particle by the squared distances of beams (in cells). Those of a few beams
/// are combined in `f32` first.
pub(super) trait Update: Copy {
    /// The neutral element: no beams combined.
    const NEUTRAL: f32;
    fn combine(self, combined: f32, squared: f32) -> f32;
    fn next(self, value: f64, combined: f32) -> f64;
}

/// The update without random measurements: the sum of squared distances.
#[derive(Clone, Copy)]
pub(super) struct Sum;

impl Update for Sum {
    const NEUTRAL: f32 = 0.0;

    #[inline(always)]
    fn combine(self, combined: f32, squared: f32) -> f32 {
        combined + squared
    }

    #[inline(always)]
    fn next(self, value: f64, combined: f32) -> f64 {
        value + f64::from(combined)
    }
}

/// The update with random measurements: the product of likelihoods, each divided by its maximum.
#[derive(Clone, Copy)]
pub(super) struct Product {
    /// −log₂(e)/(2σ_hit²), σ_hit in cells.
    pub decay: f32,
    /// The contributions of the two terms of the likelihood at distance 0; together 1.
    pub hit: f32,
    pub random: f32,
}

impl Update for Product {
    const NEUTRAL: f32 = 1.0;

    #[inline(always)]
    fn combine(self, combined: f32, squared: f32) -> f32 {
        let exponent = squared * self.decay;
        let exponent = if exponent > LEAST { exponent } else { LEAST };
        combined * (self.hit * exp2_nonpositive(exponent) + self.random)
    }

    #[inline(always)]
    fn next(self, value: f64, combined: f32) -> f64 {
        value * f64::from(combined)
    }
}

/// Updates the value of every particle by the distances of the beams' endpoints from the map.
pub(super) struct Pass<'a, I, U> {
    pub lookup: Lookup<'a>,
    pub particles: &'a mut Chunk,
    /// Endpoints in cells, in the robot frame.
    pub beams: I,
    /// Whether `f32` is accurate enough for the positions of the endpoints ([`Lookup::is_near`]).
    pub near: bool,
    /// Number of beams combined in `f32`.
    pub few: usize,
    pub update: U,
}

impl<I, U> Task for Pass<'_, I, U>
where
    I: Iterator<Item = [f64; 2]>,
    U: Update,
{
    #[inline(always)]
    fn run<F: Fetch>(self, fetch: F) {
        let Pass { lookup, particles, mut beams, near, few, update } = self;
        let Chunk { poses, near: near_poses, combined, value, workspace } = particles;
        let number = value.len();
        let [x, y, sin, cos] = poses.each_ref().map(|values| &values[..number]);
        let [column, row, from_x, from_y, near_sin, near_cos] =
            near_poses.each_ref().map(|values| &values[..number]);
        let combined = &mut combined[..number];
        let mut next = beams.next();
        while next.is_some() {
            combined.fill(U::NEUTRAL);
            for [ex, ey] in
                std::iter::from_fn(|| std::mem::replace(&mut next, beams.next())).take(few)
            {
                if near {
                    let (ex, ey) = (ex as f32, ey as f32);
                    workspace.place(number, |i| {
                        let (sin, cos) = (near_sin[i], near_cos[i]);
                        let x = from_x[i] + (cos * ex - sin * ey);
                        let y = from_y[i] + (sin * ex + cos * ey);
                        lookup.locate_from(column[i], row[i], x, y)
                    });
                } else {
                    workspace.place(number, |i| {
                        let x = x[i] + (cos[i] * ex - sin[i] * ey);
                        let y = y[i] + (sin[i] * ex + cos[i] * ey);
                        lookup.locate(x, y)
                    });
                }
                let squared = lookup.squared_distances(fetch, number, workspace);
                for (combined, &squared) in combined.iter_mut().zip(squared) {
                    *combined = update.combine(*combined, squared);
                }
            }
            for (value, &combined) in value.iter_mut().zip(&*combined) {
                *value = update.next(*value, combined);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::DistanceField;
    use crate::sensor::fetch::{dispatch_on, instruction_sets};
    use mcl_core::{PointMap, Seed};
    use rand::RngExt;

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let mut rng = Seed::new(3).rng();
        let mut uniform = |width: f64| width * (rng.random::<f64>() - 0.5);
        let map =
            PointMap::new((0..3_000).map(|_| [uniform(20.0), uniform(10.0)]).collect()).unwrap();
        let field = DistanceField::build(&map, 1.0).unwrap();
        let n = 243;
        let [x, y, theta] =
            [20.0, 10.0, 6.3].map(|width| -> Vec<f64> { (0..n).map(|_| uniform(width)).collect() });
        let (sin, cos): (Vec<f64>, Vec<f64>) = theta.iter().map(|theta| theta.sin_cos()).unzip();
        let poses = Poses { x: &x, y: &y, sin: &sin, cos: &cos };
        let beams: Vec<[f64; 2]> = (0..50)
            .map(|_| [uniform(10.0) / field.grid.cell, uniform(10.0) / field.grid.cell])
            .collect();
        let update = Product { decay: -0.1, hit: 0.9, random: 0.1 };
        for near in [true, false] {
            let of_each: Vec<Vec<f64>> = instruction_sets()
                .into_iter()
                .map(|set| {
                    let mut particles = Chunk::default();
                    particles.load(&field.grid, &poses, 0..n, 1.0);
                    let lookup = Lookup::new(&field);
                    let beams = beams.iter().copied();
                    let pass =
                        Pass { lookup, particles: &mut particles, beams, near, few: 7, update };
                    dispatch_on(set, pass);
                    particles.value
                })
                .collect();
            assert!(of_each[0].iter().any(|&value| value > 1e-20 && value < 1.0));
            assert!(of_each.iter().all(|values| *values == of_each[0]), "near: {near}");
        }
    }
}
