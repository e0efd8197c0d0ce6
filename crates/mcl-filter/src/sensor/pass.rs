//! Beams passing over particles: the loop around [`Lookup`] that weighs them.

use std::ops::Range;

use pulp::NullaryFnOnce;

use super::Poses;
use super::exp::exp_nonpositive;
use super::grid::Grid;
use super::lookup::{Lookup, Workspace};

/// Some particles: positions in cells of the grid, sines and cosines of their headings, and the sum
/// or product over beams so far.
#[derive(Default)]
pub(super) struct Chunk {
    x: Vec<f64>,
    y: Vec<f64>,
    sin: Vec<f64>,
    cos: Vec<f64>,
    value: Vec<f64>,
    endpoint_x: Vec<f64>,
    endpoint_y: Vec<f64>,
    workspace: Box<Workspace>,
}

impl Chunk {
    /// Takes over those of the poses in `range`; there are at most [`CHUNK`](super::lookup::CHUNK).
    pub fn load(&mut self, grid: &Grid, poses: &Poses<'_>, range: Range<usize>, neutral: f64) {
        let fill = |to: &mut Vec<f64>, from: &[f64]| {
            to.clear();
            to.extend_from_slice(&from[range.clone()]);
        };
        fill(&mut self.x, poses.x);
        fill(&mut self.y, poses.y);
        fill(&mut self.sin, poses.sin);
        fill(&mut self.cos, poses.cos);
        self.x.iter_mut().for_each(|x| *x = grid.in_cells(0, *x));
        self.y.iter_mut().for_each(|y| *y = grid.in_cells(1, *y));
        for buffer in [&mut self.value, &mut self.endpoint_x, &mut self.endpoint_y] {
            buffer.clear();
            buffer.resize(range.len(), neutral);
        }
    }

    /// Adds what the values stand for to the particles' log-weights and makes the values neutral
    /// again.
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

/// What a beam does to the value of a particle.
pub(super) trait Update: Copy {
    /// What counts of a squared distance, in `f32`.
    fn term(self, squared: f32) -> f32;
    fn next(self, value: f64, term: f32) -> f64;
}

/// Without random measurements: the sum of squared distances.
#[derive(Clone, Copy)]
pub(super) struct Sum;

impl Update for Sum {
    #[inline(always)]
    fn term(self, squared: f32) -> f32 {
        squared
    }

    #[inline(always)]
    fn next(self, value: f64, term: f32) -> f64 {
        value + f64::from(term)
    }
}

/// The product of likelihoods.
#[derive(Clone, Copy)]
pub(super) struct Product {
    /// 1/(2σ_hit²) in cells.
    pub decay: f32,
    pub hit: f64,
    pub random: f64,
}

impl Update for Product {
    #[inline(always)]
    fn term(self, squared: f32) -> f32 {
        exp_nonpositive(-squared * self.decay)
    }

    #[inline(always)]
    fn next(self, value: f64, term: f32) -> f64 {
        value * (self.hit * f64::from(term) + self.random)
    }
}

/// Updates the value of every particle by the squared distances (in cells) of the beams' endpoints
/// (in cells, in the robot's frame) from the map.
pub(super) struct Pass<'a, I, U> {
    pub lookup: Lookup<'a>,
    pub particles: &'a mut Chunk,
    pub beams: I,
    pub update: U,
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
impl<I, U> NullaryFnOnce for Pass<'_, I, U>
where
    I: Iterator<Item = (f64, f64)>,
    U: Update,
{
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Chunk { x, y, sin, cos, value, endpoint_x, endpoint_y, workspace } = self.particles;
        let number = x.len();
        let (x, y) = (&x[..number], &y[..number]);
        let (sin, cos) = (&sin[..number], &cos[..number]);
        let (endpoint_x, endpoint_y) = (&mut endpoint_x[..number], &mut endpoint_y[..number]);
        for (ex, ey) in self.beams {
            for i in 0..number {
                endpoint_x[i] = x[i] + cos[i] * ex - sin[i] * ey;
                endpoint_y[i] = y[i] + sin[i] * ex + cos[i] * ey;
            }
            let squared = self.lookup.distances_squared(endpoint_x, endpoint_y, workspace);
            squared.iter_mut().for_each(|squared| *squared = self.update.term(*squared));
            for (value, &term) in value.iter_mut().zip(&*squared) {
                *value = self.update.next(*value, term);
            }
        }
    }
}
