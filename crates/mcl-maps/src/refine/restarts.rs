use mcl_core::Point;

use super::{Progress, RefineSettings, Stage};
use crate::fkm::Model;
use crate::fkm_accelerated::climb;
use crate::sampling::sample_random;
use crate::{MapError, PointSet};

/// Runs EM from the model and from random maps of its size, and keeps the maximum with the largest likelihood.
pub(super) fn search<const D: usize>(
    data: &PointSet<D>,
    model: &mut Model<D>,
    settings: &RefineSettings,
    restarts: usize,
    progress: &mut Progress,
) -> Result<(), MapError> {
    let sigma = settings.fkm.sigma;
    let to_the_top = |model: &mut Model<D>, progress: &mut Progress| {
        let last = progress.evaluations + settings.fkm.max_iterations;
        climb(data, model, sigma, settings.fkm.tolerance, |_| {
            progress.evaluations += 1;
            progress.evaluations < last && !progress.is_over()
        });
    };
    to_the_top(model, progress);
    progress.step(Stage::Restart, model.per_point);
    for restart in 0..restarts {
        if progress.is_over() {
            break;
        }
        let seed = settings.seed.derive("restart").derive(&restart.to_string());
        let drawn = sample_random(data.len(), model.means.len().min(data.len()), seed);
        let points: Vec<Point<D>> = drawn.iter().map(|&index| data.points()[index]).collect();
        let mut other = Model::new(data, data.centred(&points), sigma);
        to_the_top(&mut other, progress);
        if other.per_point > model.per_point {
            *model = other;
            progress.step(Stage::Restart, model.per_point);
        }
    }
    Ok(())
}
