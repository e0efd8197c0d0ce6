use mcl_core::{Point, PointMap};

use crate::fkm::Model;
use crate::{FkmReport, FkmSettings, MapError, PointSet};

/// By how much the longest step that is tried grows when it succeeds and shrinks when it fails.
const STEP_FACTOR: f64 = 4.0;

/// Fuzzy k-means in fewer updates: SQUAREM (Varadhan & Roland, *Simple and Globally Convergent Methods
/// for Accelerating the Convergence of Any EM Algorithm*, Scandinavian Journal of Statistics 35, 2008;
/// step length S3), with the same arguments and result as [`fuzzy_k_means`](crate::fuzzy_k_means). It
/// climbs from the same place by longer steps, so it may end on another local maximum.
///
/// From means μ, two updates move them by r and then by r + v. What follows would go on about
/// geometrically, so the means jump to μ + 2αr + α²v, with α = ‖r‖/‖v‖; α = 1 is the two updates
/// themselves. A jump that would lower the likelihood is undone: the trace never falls. α is at most a
/// limit that starts at 1 and grows when a jump of that length succeeds.
///
/// Every evaluation of all points counts as an update, those of jumps too, and has its entry in the
/// trace; that of an undone jump repeats the one before. Stops after a plain update that gains less
/// than the tolerance.
///
/// # Errors
/// [`MapError::Setting`] for settings out of range; [`MapError::Memory`].
pub fn accelerated_fuzzy_k_means<const D: usize>(
    data: &PointSet<D>,
    initial: &PointMap<D>,
    settings: &FkmSettings,
    mut observe: impl FnMut(usize, f64),
) -> Result<(Vec<Point<D>>, FkmReport), MapError> {
    settings.check()?;
    data.check_tree_fits()?;
    let mut trace = Vec::new();
    let mut model = Model::new(data, data.centred(initial.points()), settings.sigma);
    let converged = climb(data, &mut model, settings.sigma, settings.tolerance, |per_point| {
        observe(trace.len(), per_point);
        trace.push(per_point);
        trace.len() <= settings.max_iterations
    });
    let report = FkmReport { iterations: trace.len() - 1, converged, log_likelihood_trace: trace };
    Ok((data.absolute(&model.means), report))
}

/// Takes a model up to a local maximum: SQUAREM as above. `go_on` is told the log-likelihood per point
/// of the model at the start and after every evaluation, and says whether there may be another.
/// Returns whether the last plain update gained less than the tolerance.
pub(crate) fn climb<const D: usize>(
    data: &PointSet<D>,
    model: &mut Model<D>,
    sigma: f64,
    tolerance: f64,
    mut go_on: impl FnMut(f64) -> bool,
) -> bool {
    let mut longest = 1.0;
    let mut may = go_on(model.per_point);
    while may {
        let updated = model.update(data, sigma);
        let converged = updated.per_point - model.per_point < tolerance;
        let length = step_length(model, &updated).min(longest);
        may = go_on(updated.per_point);
        let plain = std::mem::replace(model, updated);
        if converged || !may {
            return converged;
        }
        // A jump of length 1 goes where the next update goes anyway.
        let mut succeeded = true;
        if length > 1.0 {
            let jumped = Model::new(data, jump(&plain, model, length), sigma);
            succeeded = jumped.per_point >= model.per_point;
            if succeeded {
                *model = jumped;
            }
            may = go_on(model.per_point);
        }
        if !succeeded {
            longest = f64::max(longest / STEP_FACTOR, 1.0);
        } else if length == longest {
            longest *= STEP_FACTOR;
        }
    }
    false
}

/// α = ‖r‖/‖v‖, at least 1.
fn step_length<const D: usize>(model: &Model<D>, updated: &Model<D>) -> f64 {
    let (mut r2, mut v2) = (0.0, 0.0);
    for (step, next) in model.steps.iter().zip(&updated.steps) {
        for axis in 0..D {
            r2 += step[axis] * step[axis];
            v2 += (next[axis] - step[axis]) * (next[axis] - step[axis]);
        }
    }
    // Where nothing moves, 0/0 becomes 1.
    f64::max((r2 / v2).sqrt(), 1.0)
}

/// μ + 2αr + α²v.
fn jump<const D: usize>(model: &Model<D>, updated: &Model<D>, length: f64) -> Vec<Point<D>> {
    let steps = model.steps.iter().zip(&updated.steps);
    let jumped = |(mean, (step, next)): (&Point<D>, (&Point<D>, &Point<D>))| {
        std::array::from_fn(|axis| {
            let change = next[axis] - step[axis];
            mean[axis] + length * (2.0 * step[axis] + length * change)
        })
    };
    model.means.iter().zip(steps).map(jumped).collect()
}
