//! Refinements: maps of the same size with a larger likelihood than plain fuzzy k-means gives.
//!
//! EM converges to the nearest local maximum, and the paper's snapping to data points then lowers the likelihood.
//! The methods here search for a higher maximum, or continue after snapping. Each results in a subset of the
//! data with no more points than the initial map. docs/refinement.md compares them.

mod annealed;
mod exchange;
mod restarts;
mod split;
mod split_merge;

use std::time::{Duration, Instant};

use mcl_core::{Point, PointMap, Seed};
use serde::{Deserialize, Serialize};

use crate::fkm::Model;
use crate::fkm_accelerated::climb;
use crate::{
    FkmSettings, MapError, PointSet, accelerated_fuzzy_k_means, fuzzy_k_means, snap_to_data,
};

/// A method that improves an initial map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Refinement {
    /// [`fuzzy_k_means`], as in the paper.
    Fkm {},
    /// [`accelerated_fuzzy_k_means`]: fewer updates, to an equally good but not the same maximum.
    FkmAccelerated {},
    /// Fuzzy k-means from the initial map and from random ones of its size; the map with the largest likelihood is
    /// kept.
    Restarts {
        /// Number of random maps.
        restarts: usize,
    },
    /// Fuzzy k-means with a σ that decreases to the requested one, so that components are first attracted by distant
    /// points (deterministic annealing: Ueda & Nakano, Neural Networks 11, 1998).
    Annealed {
        /// The largest σ, in multiples of the requested one.
        start: u32,
        /// Number of σ values before the requested one, in equal ratios.
        steps: usize,
    },
    /// Split and merge: splits the components whose points gain most, runs EM, removes as many components with the
    /// smallest removal cost, and keeps the result if the likelihood rises (split and merge EM: Ueda et al., Neural
    /// Computation 12, 2000; many components at a time as in breathing k-means: Fritzke, arXiv:2006.15666).
    SplitMerge {
        /// Number of rounds.
        rounds: usize,
    },
    /// Fuzzy k-means, snapping, and exchange of kept points for others nearby as long as the likelihood of the data
    /// under the subset rises.
    Exchange {
        /// Largest number of sweeps over all kept points.
        sweeps: usize,
    },
    /// [`SplitMerge`](Self::SplitMerge), then [`Exchange`](Self::Exchange).
    Best {
        /// Number of rounds.
        rounds: usize,
        /// Largest number of sweeps over all kept points.
        sweeps: usize,
    },
}

/// Each method with its default settings.
impl Refinement {
    /// Five random maps.
    pub const RESTARTS: Self = Refinement::Restarts { restarts: 5 };
    /// From 8 σ in twelve steps.
    pub const ANNEALED: Self = Refinement::Annealed { start: 8, steps: 12 };
    /// Twelve rounds.
    pub const SPLIT_MERGE: Self = Refinement::SplitMerge { rounds: 12 };
    /// At most ten sweeps.
    pub const EXCHANGE: Self = Refinement::Exchange { sweeps: 10 };
    /// Twelve rounds and at most ten sweeps.
    pub const BEST: Self = Refinement::Best { rounds: 12, sweeps: 10 };
    /// Every method, with its default settings.
    pub const ALL: [Self; 7] = [
        Refinement::Fkm {},
        Refinement::FkmAccelerated {},
        Self::RESTARTS,
        Self::ANNEALED,
        Self::SPLIT_MERGE,
        Self::EXCHANGE,
        Self::BEST,
    ];

    /// The name of the method, as in `--refine`.
    pub fn name(&self) -> &'static str {
        match self {
            Refinement::Fkm {} => "fkm",
            Refinement::FkmAccelerated {} => "fkm-accelerated",
            Refinement::Restarts { .. } => "restarts",
            Refinement::Annealed { .. } => "annealed",
            Refinement::SplitMerge { .. } => "split-merge",
            Refinement::Exchange { .. } => "exchange",
            Refinement::Best { .. } => "best",
        }
    }
}

/// Settings of [`refine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineSettings {
    /// The method.
    pub method: Refinement,
    /// σ and the stopping criteria of EM.
    pub fkm: FkmSettings,
    /// Random seed (for restarts, and for split and merge once it is stuck).
    pub seed: Seed,
    /// Time limit in seconds, after which the best result so far is returned; the result then depends on the speed of
    /// the machine.
    pub budget_s: Option<f64>,
}

impl RefineSettings {
    /// Plain fuzzy k-means.
    pub fn fkm(fkm: FkmSettings) -> Self {
        RefineSettings { method: Refinement::Fkm {}, fkm, seed: Seed::new(0), budget_s: None }
    }

    fn check(&self) -> Result<(), MapError> {
        self.fkm.check()?;
        let setting =
            |setting, value, expected| Err(MapError::Setting { setting, value, expected });
        match (self.method, self.budget_s) {
            (Refinement::Annealed { start, .. }, _) if !(1..=1_000_000).contains(&start) => {
                setting("annealing start (multiples of sigma)", start.into(), "from 1 to 1,000,000")
            }
            (_, Some(budget)) if !(budget.is_finite() && budget >= 0.0) => {
                setting("time budget (s)", budget, "a finite number of at least 0")
            }
            _ => Ok(()),
        }
    }
}

/// The operation behind an entry of a [`RefineReport`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// The model of the initial map.
    Initial,
    /// An evaluation of EM.
    Em,
    /// A higher maximum, from another start or at the end of annealing.
    Restart,
    /// Components split and merged.
    SplitMerge,
    /// Means replaced by data points.
    Snap,
    /// Kept points exchanged for others.
    Exchange,
}

/// An accepted step of a refinement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RefineStep {
    /// The operation.
    pub stage: Stage,
    /// Log-likelihood of the data per point after the step, in nats.
    pub log_likelihood: f64,
    /// Evaluations of all points so far.
    pub evaluations: usize,
    /// Seconds since the start.
    pub seconds: f64,
}

/// Report of a refinement. The log-likelihood never falls from one step to the next, except at
/// [`Stage::Snap`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RefineReport {
    /// The accepted steps.
    pub steps: Vec<RefineStep>,
    /// Whether EM, and the exchanges if any, stopped because the gain was at most the tolerance, and not because of
    /// the maximum number of iterations or sweeps or the time limit.
    pub converged: bool,
    /// Evaluations of all points.
    pub evaluations: usize,
}

/// A refined map.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined<const D: usize> {
    /// Indices of the kept points in the data: at most as many as the initial map has.
    pub indices: Vec<usize>,
    /// The final means of EM, before any was replaced by a data point.
    pub means: Vec<Point<D>>,
    /// Report of the refinement.
    pub report: RefineReport,
}

/// Refines the map `initial` of `data`. `observe` is called with every accepted step.
///
/// The result is the same bit for bit for any number of threads, unless the time limit ends it.
///
/// # Errors
/// [`MapError::Setting`] for settings out of range; [`MapError::Memory`].
pub fn refine<const D: usize>(
    data: &PointSet<D>,
    initial: &PointMap<D>,
    settings: &RefineSettings,
    mut observe: impl FnMut(&RefineStep),
) -> Result<Refined<D>, MapError> {
    settings.check()?;
    data.check_tree_fits()?;
    data.check_neighbors_fit()?;
    let FkmSettings { sigma, tolerance, max_iterations } = settings.fkm;
    let mut progress = Progress::new(settings.budget_s, &mut observe);
    if let Refinement::Fkm {} | Refinement::FkmAccelerated {} = settings.method {
        let evaluated = |_: usize, per_point: f64| {
            progress.evaluations += 1;
            progress.step(
                if progress.steps.is_empty() { Stage::Initial } else { Stage::Em },
                per_point,
            );
        };
        let (means, report) = match settings.method {
            Refinement::Fkm {} => fuzzy_k_means(data, initial, &settings.fkm, evaluated)?,
            _ => accelerated_fuzzy_k_means(data, initial, &settings.fkm, evaluated)?,
        };
        let indices = snap_to_data(data, &means);
        return Ok(progress.finish(indices, means, report.converged));
    }

    let mut model = Model::new(data, data.centred(initial.points()), sigma);
    progress.evaluations += 1;
    progress.step(Stage::Initial, model.per_point);
    match settings.method {
        Refinement::Restarts { restarts } => {
            restarts::search(data, &mut model, settings, restarts, &mut progress)?;
        }
        Refinement::Annealed { start, steps } => {
            annealed::search(data, &mut model, sigma, start.into(), steps, &mut progress);
        }
        Refinement::SplitMerge { rounds } | Refinement::Best { rounds, .. } => {
            split_merge::search(data, &mut model, settings, rounds, &mut progress);
        }
        Refinement::Exchange { .. } | Refinement::Fkm {} | Refinement::FkmAccelerated {} => {}
    }
    let last = progress.evaluations + max_iterations;
    // The step of the initial model has already been reported.
    let mut is_known = true;
    let mut converged = climb(data, &mut model, sigma, tolerance, |per_point| {
        if !std::mem::take(&mut is_known) {
            progress.evaluations += 1;
            progress.step(Stage::Em, per_point);
        }
        progress.evaluations < last && !progress.is_over()
    });
    let indices = match settings.method {
        Refinement::Exchange { sweeps } | Refinement::Best { sweeps, .. } => {
            let (indices, settled) =
                exchange::search(data, &model.means, &settings.fkm, sweeps, &mut progress);
            converged &= settled;
            indices
        }
        _ => snap_to_data(data, &data.absolute(&model.means)),
    };
    Ok(progress.finish(indices, data.absolute(&model.means), converged))
}

/// The report in progress.
struct Progress<'a> {
    start: Instant,
    end: Option<Instant>,
    evaluations: usize,
    steps: Vec<RefineStep>,
    observe: &'a mut dyn FnMut(&RefineStep),
}

impl<'a> Progress<'a> {
    fn new(budget_s: Option<f64>, observe: &'a mut dyn FnMut(&RefineStep)) -> Self {
        let start = Instant::now();
        // A limit beyond the range of the clock never ends.
        let end = budget_s
            .and_then(|budget| Duration::try_from_secs_f64(budget).ok())
            .and_then(|budget| start.checked_add(budget));
        Progress { start, end, evaluations: 0, steps: Vec::new(), observe }
    }

    /// Whether the time limit has been reached.
    fn is_over(&self) -> bool {
        self.end.is_some_and(|end| Instant::now() >= end)
    }

    fn step(&mut self, stage: Stage, log_likelihood: f64) {
        let seconds = self.start.elapsed().as_secs_f64();
        let step = RefineStep { stage, log_likelihood, evaluations: self.evaluations, seconds };
        (self.observe)(&step);
        self.steps.push(step);
    }

    fn finish<const D: usize>(
        self,
        indices: Vec<usize>,
        means: Vec<Point<D>>,
        converged: bool,
    ) -> Refined<D> {
        let report = RefineReport { steps: self.steps, converged, evaluations: self.evaluations };
        Refined { indices, means, report }
    }
}

/// Runs EM for a limited number of evaluations, which are counted but not reported.
fn relax<const D: usize>(
    data: &PointSet<D>,
    means: Vec<Point<D>>,
    sigma: f64,
    evaluations: usize,
    progress: &mut Progress,
) -> Model<D> {
    let mut model = Model::new(data, means, sigma);
    let mut used = 0;
    climb(data, &mut model, sigma, 0.0, |_| {
        used += 1;
        used < evaluations
    });
    progress.evaluations += used;
    model
}
