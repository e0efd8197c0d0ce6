use mcl_core::{Point, PointMap};

use crate::fkm::Model;
use crate::{FkmReport, FkmSettings, MapError, PointSet};

/// Factor by which the largest step length grows after a success and shrinks after a failure.
const STEP_FACTOR: f64 = 4.0;

/// Runs fuzzy k-means with fewer updates: SQUAREM (Varadhan & Roland, *Simple and Globally Convergent Methods
/// for Accelerating the Convergence of Any EM Algorithm*, Scandinavian Journal of Statistics 35, 2008;
/// step length S3), with the same arguments and result as [`fuzzy_k_means`](crate::fuzzy_k_means). It
/// starts from the same means but takes longer steps, so it may converge to another local maximum.
///
/// From means μ, two updates move them by r and then by r + v. Further updates would continue roughly
/// geometrically, so the means jump to μ + 2αr + α²v, with α = ‖r‖/‖v‖; α = 1 gives the two updates
/// themselves. A jump that lowers the likelihood is undone, so the trace never falls. α is limited; the
/// limit starts at 1 and grows when a jump of that length succeeds.
///
/// Every evaluation of all points, including those of jumps, counts as an update and has an entry in the
/// trace; the entry of an undone jump repeats the previous one. Stops after a plain update that gains less
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

/// Moves a model to a local maximum by SQUAREM as above. `go_on` is called with the log-likelihood per point of the
/// model at the start and after every evaluation, and returns whether to continue. Returns whether the last plain
/// update gained less than the tolerance.
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
        // A jump of length 1 is the same as the next update.
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
    // If nothing moves, 0/0 becomes 1.
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
