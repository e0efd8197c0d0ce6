use std::fmt;

use anyhow::{Context, Result, bail};
use mcl_filter::{FilterSettings, OdometryNoise};
use mcl_maps::{FkmSettings, Refinement};
use serde::{Deserialize, Serialize};

use super::definition::{Definition, check_distinct, check_name, check_percent, check_rows};
use super::scheduler::Trial;
use super::{ExperimentDataset, Kind};
use crate::auto::{Criterion, race_sizes};

/// Settings of an experiment on automatic sizes and σ: what each criterion chooses, and what an exhaustive
/// sweep finds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChoicesExperiment {
    /// [`Kind::Choices`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// What decides the size.
    pub size_by: Vec<Criterion>,
    /// The sizes of the sweep, in percent of the data set's points. By localization the sweep takes those that
    /// the race chooses from.
    pub sizes: Steps,
    /// What decides σ.
    #[serde(default)]
    pub sigma_by: Vec<Criterion>,
    /// The sizes at which σ is chosen, in percent of the data set's points.
    #[serde(default)]
    pub sigma_sizes: Vec<f64>,
    /// The σ of the sweep in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigmas: Option<Steps>,
    /// What is made of the grid-based maps; nothing if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refine: Option<Refinement>,
    /// σ of the mixture in metres where it is not chosen.
    pub sigma: f64,
    /// EM stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// EM stops after this many updates.
    pub max_iterations: usize,
    /// Runs of the filter on each map that is chosen, and on each of the sweep by localization.
    pub runs: u32,
    /// Gaussian noise added to the odometry of each run, the same for every map.
    pub odometry_noise: OdometryNoise,
    /// The particle filter; what is not given is the default of `mcl-eval localize`. Its `max_range` is
    /// the data set's.
    #[serde(default)]
    pub filter: FilterSettings,
    /// The data sets to run on, as far as they are at hand.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<ExperimentDataset>,
}

/// Values in equal ratios.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Steps {
    /// The smallest.
    pub from: f64,
    /// None is larger.
    pub to: f64,
    /// Each is so many times the one before.
    pub factor: f64,
}

/// Values of a sweep at most.
const MAX_STEPS: f64 = 1000.0;

impl Steps {
    /// The values, from the smallest.
    pub fn values(self) -> Vec<f64> {
        // A last one that rounding lifts above the end counts.
        let end = self.to * (1.0 + 1e-9);
        let values = (0..).map(|step| self.from * self.factor.powi(step));
        values.take_while(|&value| value <= end).collect()
    }

    fn check(self, place: &str) -> Result<()> {
        let Steps { from, to, factor } = self;
        if !(from > 0.0 && from.is_finite() && to >= from && to.is_finite()) {
            bail!("{place}: from {from} to {to}, expected positive numbers, the smaller first");
        }
        let count = (to / from).ln() / factor.ln();
        if !(factor > 1.0 && factor.is_finite() && count < MAX_STEPS) {
            bail!(
                "{place}: factor is {factor}, expected one above 1 that makes at most {MAX_STEPS} steps"
            );
        }
        Ok(())
    }
}

impl ChoicesExperiment {
    /// σ, and when EM stops.
    pub fn fkm(&self) -> FkmSettings {
        FkmSettings {
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
        }
    }

    /// What decides the size of those that are likelihoods.
    pub fn size_likelihoods(&self) -> Vec<Criterion> {
        let is_likelihood = |by: &&Criterion| **by != Criterion::Localization;
        self.size_by.iter().filter(is_likelihood).copied().collect()
    }

    /// All trials of the experiment on a data set of so many points.
    pub fn trials(&self, points: usize) -> Vec<ChoiceTrial> {
        let mut trials = Vec::new();
        let mut push = |task: ChoiceTask, by: &[Criterion]| {
            if !by.is_empty() {
                trials.push(ChoiceTrial { task, by: by.to_vec() });
            }
        };
        for &by in &self.size_by {
            push(ChoiceTask::Size, &[by]);
        }
        for percent in self.sizes.values() {
            push(ChoiceTask::SweepSize { percent }, &self.size_likelihoods());
        }
        if self.size_by.contains(&Criterion::Localization) {
            for points in race_sizes(points) {
                push(ChoiceTask::SweepRaced { points }, &[Criterion::Localization]);
            }
        }
        for &percent in &self.sigma_sizes {
            for &by in &self.sigma_by {
                push(ChoiceTask::Sigma { percent }, &[by]);
            }
            push(ChoiceTask::GivenSigma { percent }, &[Criterion::Likelihood]);
            for sigma in self.sigmas.into_iter().flat_map(Steps::values) {
                push(ChoiceTask::SweepSigma { percent, sigma }, &self.sigma_by);
            }
        }
        trials
    }
}

impl Definition for ChoicesExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        self.filter.clone().check().context("filter")?;
        check_distinct(&self.size_by, "size_by")?;
        check_distinct(&self.sigma_by, "sigma_by")?;
        check_distinct(&self.sigma_sizes, "sigma_sizes")?;
        if let Some(other) = self.size_by.iter().find(|by| !by.decides_size()) {
            bail!(
                "size_by: {} decides no size, expected held-out, bic, mdl or localization",
                other.name()
            );
        }
        if let Some(other) = self.sigma_by.iter().find(|by| !by.decides_sigma()) {
            bail!("sigma_by: {} decides no σ, expected likelihood or held-out", other.name());
        }
        if self.size_by.is_empty() && self.sigma_by.is_empty() {
            bail!("size_by and sigma_by are empty, expected a criterion");
        }
        if self.runs < 2 {
            bail!("runs is {}, expected at least 2", self.runs);
        }
        self.sizes.check("sizes")?;
        check_percent(self.sizes.to, "sizes.to")?;
        self.sigmas.map_or(Ok(()), |sigmas| sigmas.check("sigmas"))?;
        self.sigma_sizes.iter().try_for_each(|&size| check_percent(size, "sigma_sizes"))?;
        let sigmas = self.sigmas.map_or(1, |sigmas| sigmas.values().len());
        check_rows(&[self.sigma_sizes.len(), sigmas, self.sigma_by.len()], "sigma_sizes")
    }
}

/// What a trial finds out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ChoiceTask {
    /// The size that a criterion chooses.
    Size,
    /// How it rates a size.
    SweepSize {
        /// Percent of the points.
        percent: f64,
    },
    /// How well a robot is localized on a map of a size that the race chooses from.
    SweepRaced {
        /// Number of points.
        points: usize,
    },
    /// The σ that a criterion chooses at a size.
    Sigma {
        /// Percent of the points.
        percent: f64,
    },
    /// What the given σ is worth at that size.
    GivenSigma {
        /// Percent of the points.
        percent: f64,
    },
    /// How a criterion rates a σ at a size.
    SweepSigma {
        /// Percent of the points.
        percent: f64,
        /// In metres.
        sigma: f64,
    },
}

/// A trial: maps of one size and σ, or a search over many.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceTrial {
    /// What is asked.
    pub task: ChoiceTask,
    /// What answers: a row each.
    pub by: Vec<Criterion>,
}

impl Trial for ChoiceTrial {
    /// In maps of the whole data. Searches build dozens of them, held-out ones for each fold.
    fn cost(&self) -> f64 {
        let folds = |by: &Criterion| if *by == Criterion::HeldOut { 5.0 } else { 1.0 };
        let maps: f64 = self.by.iter().map(folds).sum();
        let size = |percent: f64| 1.0 + percent;
        match self.task {
            ChoiceTask::Size if self.by.contains(&Criterion::Localization) => 500.0,
            ChoiceTask::Size => 100.0 * maps,
            ChoiceTask::SweepSize { percent } => maps * size(percent),
            ChoiceTask::SweepRaced { .. } => 20.0,
            ChoiceTask::Sigma { percent } => 15.0 * maps * size(percent) + 20.0,
            ChoiceTask::GivenSigma { percent } => 6.0 * size(percent) + 20.0,
            ChoiceTask::SweepSigma { percent, .. } => maps * size(percent),
        }
    }
}

/// "size by bic", "sigma at 1 % by held-out", "sweep of size 0.25 %".
impl fmt::Display for ChoiceTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = self.by.iter().map(|by| by.name()).collect::<Vec<_>>().join(", ");
        match self.task {
            ChoiceTask::Size => write!(f, "size by {by}"),
            ChoiceTask::SweepSize { percent } => write!(f, "sweep of size {percent:.4} % by {by}"),
            ChoiceTask::SweepRaced { points } => write!(f, "sweep of size {points} by {by}"),
            ChoiceTask::Sigma { percent } => write!(f, "sigma at {percent} % by {by}"),
            ChoiceTask::GivenSigma { percent } => write!(f, "given sigma at {percent} %"),
            ChoiceTask::SweepSigma { percent, sigma } => {
                write!(f, "sweep of sigma {sigma:.4} m at {percent} % by {by}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::Experiment;
    use std::collections::HashSet;

    const SMALL: &str = r#"
        kind = "choices"
        seed = 1
        size_by = ["held-out", "bic", "localization"]
        sizes = { from = 1, to = 4, factor = 2 }
        sigma_by = ["likelihood", "held-out"]
        sigma_sizes = [1, 5]
        sigmas = { from = 0.01, to = 0.1, factor = 10 }
        refine = { method = "fkm" }
        sigma = 0.05
        tolerance = 1e-4
        max_iterations = 100
        runs = 4
        odometry_noise = { xy = 0.01, theta = 0.01 }
    "#;

    fn parse(text: &str) -> Result<ChoicesExperiment> {
        match Experiment::parse(text)? {
            Experiment::Choices(experiment) => Ok(experiment),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn trials_are_of_all_criteria_and_values_once() {
        let experiment = parse(SMALL).unwrap();
        assert_eq!(experiment.sizes.values(), [1.0, 2.0, 4.0]);
        let trials = experiment.trials(70);
        // Three searches, three sizes; of 50 and 63 of 70 points; per size two σ searched, one given, two
        // swept.
        assert_eq!(trials.len(), 3 + 3 + 2 + 2 * (2 + 1 + 2));
        let names: HashSet<_> = trials.iter().map(ToString::to_string).collect();
        assert_eq!(names.len(), trials.len(), "{names:?}");
        assert!(names.contains("sweep of size 63 by localization"), "{names:?}");
    }

    #[test]
    fn mistakes_are_named() {
        for (right, wrong, named) in [
            ("[\"held-out\", \"bic\"", "[\"likelihood\", \"bic\"", "likelihood decides no size"),
            ("[\"held-out\", \"bic\"", "[\"bic\", \"bic\"", "Bic is listed twice"),
            ("[\"likelihood\", \"held-out\"]", "[\"bic\"]", "bic decides no σ"),
            ("to = 4", "to = 400", "sizes.to"),
            ("to = 4", "to = 0.5", "from 1 to 0.5"),
            ("factor = 2", "factor = 1", "factor is 1"),
            ("factor = 10", "factor = 1.0001", "at most 1000 steps"),
            ("[1, 5]", "[0]", "sigma_sizes"),
            ("runs = 4", "runs = 1", "runs is 1"),
        ] {
            let error = parse(&SMALL.replace(right, wrong)).unwrap_err();
            assert!(format!("{error:#}").contains(named), "{error:#}");
        }
    }
}
