use super::{Progress, Stage, relax};
use crate::PointSet;
use crate::fkm::Model;
use mcl_core::math;

/// Evaluations at each σ.
const EVALUATIONS: usize = 10;

/// Replaces the model by the result of annealing, if that has a larger likelihood.
pub(super) fn search<const D: usize>(
    data: &PointSet<D>,
    model: &mut Model<D>,
    sigma: f64,
    start: f64,
    steps: usize,
    progress: &mut Progress,
) {
    let mut means = model.means.clone();
    for step in 0..steps {
        if progress.is_over() {
            break;
        }
        let left = (steps - step) as f64 / steps as f64;
        means = relax(data, means, sigma * math::powf(start, left), EVALUATIONS, progress).means;
    }
    let annealed = relax(data, means, sigma, EVALUATIONS, progress);
    if annealed.per_point > model.per_point {
        *model = annealed;
        progress.step(Stage::Restart, model.per_point);
    }
}
