use std::sync::OnceLock;

use anyhow::{Context, Result};
use mcl_core::{PointMap, Seed};
use mcl_filter::{CheckedSettings, MapDistances};
use mcl_maps::{
    FkmSettings, GridOffset, InitialMap, MapError, MapSettings, MapSize, PointSet, RefineSettings,
    build_map, mixture_log_likelihood,
};
use serde::{Deserialize, Serialize};

use super::choices::{ChoiceTask, ChoiceTrial, ChoicesExperiment};
use super::localization::{RunErrors, track};
use super::scheduler::Stopwatch;
use super::{HeldOut, LocalizationData, Split};
use crate::auto::{
    Build, Chosen, Criterion, RaceSettings, Rating, Verdict, folds_of, judge, size_by_localization,
};
use mcl_study::data::source::LogSource;

/// How sure the sweep by localization is of each size by itself.
const RISK: f64 = 0.05;

/// What is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// The number of points of a map.
    Size,
    /// σ of the mixture, at a given size.
    Sigma,
}

/// Where a value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// The criterion chose it.
    Chosen,
    /// It is the experiment's.
    Given,
    /// It is of the exhaustive sweep.
    Swept,
}

/// A number of points or σ, and what the map is worth. Scores are such that smaller ones are better: nats per
/// point, or by localization the weighted error over that on all points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/results.md.
pub struct ChoiceRow {
    pub dataset: String,
    pub quantity: Quantity,
    /// Size at which σ is looked for.
    pub size_percent: Option<f64>,
    pub by: Criterion,
    pub origin: Origin,
    /// What the sweep was asked for: percent, points or metres.
    pub swept: Option<f64>,
    /// Points or metres.
    pub value: f64,
    pub score: Option<f64>,
    pub verdict: Option<Verdict>,
    /// Values that were tried for the choice.
    pub tried: Option<usize>,
    pub map_points: Option<usize>,
    pub log_likelihood: Option<f64>,
    pub held_out_log_likelihood: Option<f64>,
    pub runs: Option<usize>,
    pub diverged: Option<usize>,
    pub weighted: Option<f64>,
    pub weighted_all: Option<f64>,
}

/// What tells a row from the others on its data set; floats by their bits.
pub type ChoiceKey = (Quantity, Option<u64>, Criterion, Origin, Option<u64>);

impl ChoiceRow {
    /// What tells this row from the others on its data set.
    pub fn key(&self) -> ChoiceKey {
        let size = self.size_percent.map(f64::to_bits);
        (self.quantity, size, self.by, self.origin, self.swept.map(f64::to_bits))
    }

    fn new(dataset: &str, task: ChoiceTask, by: Criterion, value: f64) -> Self {
        let (quantity, size_percent, origin, swept) = identity(task);
        ChoiceRow {
            dataset: dataset.to_owned(),
            quantity,
            size_percent,
            by,
            origin,
            swept,
            value,
            score: None,
            verdict: None,
            tried: None,
            map_points: None,
            log_likelihood: None,
            held_out_log_likelihood: None,
            runs: None,
            diverged: None,
            weighted: None,
            weighted_all: None,
        }
    }
}

fn identity(task: ChoiceTask) -> (Quantity, Option<f64>, Origin, Option<f64>) {
    match task {
        ChoiceTask::Size => (Quantity::Size, None, Origin::Chosen, None),
        ChoiceTask::SweepSize { percent } => (Quantity::Size, None, Origin::Swept, Some(percent)),
        ChoiceTask::SweepRaced { points } => {
            (Quantity::Size, None, Origin::Swept, Some(points as f64))
        }
        ChoiceTask::Sigma { percent } => (Quantity::Sigma, Some(percent), Origin::Chosen, None),
        ChoiceTask::GivenSigma { percent } => (Quantity::Sigma, Some(percent), Origin::Given, None),
        ChoiceTask::SweepSigma { percent, sigma } => {
            (Quantity::Sigma, Some(percent), Origin::Swept, Some(sigma))
        }
    }
}

impl ChoiceTrial {
    /// Keys of the rows of this trial.
    pub fn keys(&self) -> Vec<ChoiceKey> {
        let (quantity, size, origin, swept) = identity(self.task);
        let of = |&by| (quantity, size.map(f64::to_bits), by, origin, swept.map(f64::to_bits));
        self.by.iter().map(of).collect()
    }
}

/// What the trials on a log have in common.
pub struct ChoiceData<'a> {
    localization: LocalizationData<'a>,
    folds: Vec<HeldOut<2>>,
    filter: CheckedSettings,
    /// Mean weighted errors of the runs on all points, once they are needed.
    on_all: OnceLock<Vec<f64>>,
}

impl<'a> ChoiceData<'a> {
    /// Divides a log.
    ///
    /// # Errors
    /// When it cannot be divided, or no robot be localized on it.
    pub fn new(experiment: &ChoicesExperiment, source: &'a LogSource) -> Result<Self> {
        let LogSource { name, recording, max_range, .. } = source;
        Ok(ChoiceData {
            localization: LocalizationData::new(Split::Same, name, recording, *max_range)?,
            folds: folds_of(source)?,
            filter: experiment.filter.with_max_range(*max_range)?,
            on_all: OnceLock::new(),
        })
    }

    /// All points.
    pub fn points(&self) -> &PointSet<2> {
        &self.localization.points
    }
}

impl ChoicesExperiment {
    /// Runs one trial: a row per criterion.
    ///
    /// # Errors
    /// When a map cannot be built, no value can be chosen or the filter cannot run.
    pub fn run_trial(
        &self,
        data: &ChoiceData<'_>,
        trial: &ChoiceTrial,
        watch: &mut Stopwatch,
    ) -> Result<Vec<ChoiceRow>> {
        let build =
            |data: &PointSet<2>, size: Option<MapSize>, sigma| self.build(data, size, sigma);
        let rating = Rating { data: data.points(), folds: &data.folds, build: &build };
        let dataset = data.localization.dataset;
        let points = |percent: f64| MapSize::Percent(percent).resolve(data.points().len());
        let row = |by, value| ChoiceRow::new(dataset, trial.task, by, value);
        // Trials with one answer.
        let by = *trial.by.first().context("a trial has a criterion")?;
        let rows = match trial.task {
            ChoiceTask::Size => {
                let chosen = match by {
                    Criterion::Localization => self.race(data, &build)?,
                    _ => rating.choose_size(by, self.sigma, |_| {})?,
                };
                watch.lap("search");
                let mut row = row(by, chosen.value);
                row.score = chosen.score();
                row.tried = Some(chosen.tried.len());
                self.rate(data, &rating, chosen.value as usize, self.sigma, &mut row)?;
                vec![row]
            }
            ChoiceTask::Sigma { percent } => {
                let size = points(percent)?;
                let chosen = rating.choose_sigma(by, Some(MapSize::Points(size)), |_| {})?;
                watch.lap("search");
                let mut row = row(by, chosen.value);
                row.score = chosen.score();
                row.tried = Some(chosen.tried.len());
                self.rate(data, &rating, size, chosen.value, &mut row)?;
                vec![row]
            }
            ChoiceTask::GivenSigma { percent } => {
                let mut row = row(by, self.sigma);
                self.rate(data, &rating, points(percent)?, self.sigma, &mut row)?;
                vec![row]
            }
            ChoiceTask::SweepSize { percent } => {
                let size = points(percent)?;
                let scores = rating.scores(&trial.by, Some(MapSize::Points(size)), self.sigma)?;
                let row = |(&by, score)| ChoiceRow { score: Some(score), ..row(by, size as f64) };
                trial.by.iter().zip(scores).map(row).collect()
            }
            ChoiceTask::SweepSigma { percent, sigma } => {
                let size = Some(MapSize::Points(points(percent)?));
                let scores = rating.scores(&trial.by, size, sigma)?;
                let row = |(&by, score)| ChoiceRow { score: Some(score), ..row(by, sigma) };
                trial.by.iter().zip(scores).map(row).collect()
            }
            ChoiceTask::SweepRaced { points } => {
                let mut row = row(by, points as f64);
                let map = build(data.points(), Some(MapSize::Points(points)), self.sigma)?;
                self.localize(data, &map, &mut row)?;
                row.score = row.weighted.zip(row.weighted_all).map(|(on_map, all)| on_map / all);
                vec![row]
            }
        };
        watch.lap("rating");
        Ok(rows)
    }

    /// A grid-based map, as `mcl-eval map --init grid` builds it; without a size all points.
    fn build(
        &self,
        data: &PointSet<2>,
        size: Option<MapSize>,
        sigma: f64,
    ) -> Result<PointMap<2>, MapError> {
        let fkm = FkmSettings { sigma, ..self.fkm() };
        let refinement = self.refine.map(|method| RefineSettings {
            method,
            seed: Seed::new(self.seed),
            ..RefineSettings::fkm(fkm)
        });
        let initial = match size {
            Some(size) => InitialMap::GridSize { size, offset: GridOffset::ORIGIN },
            None => InitialMap::All,
        };
        Ok(build_map(data, &MapSettings { initial, refinement })?.map)
    }

    fn race(&self, data: &ChoiceData<'_>, build: Build<2>) -> Result<Chosen> {
        let settings =
            RaceSettings { noise: self.odometry_noise, seed: self.seed, ..RaceSettings::default() };
        let ChoiceData { localization, filter, .. } = data;
        size_by_localization(localization, filter, &settings, self.sigma, build, |_| {})
    }

    /// What the map of a size and σ is worth by likelihood and by localization.
    fn rate(
        &self,
        data: &ChoiceData<'_>,
        rating: &Rating<2>,
        points: usize,
        sigma: f64,
        row: &mut ChoiceRow,
    ) -> Result<()> {
        let size = Some(MapSize::Points(points));
        let map = (rating.build)(data.points(), size, sigma)?;
        row.map_points = Some(map.len());
        row.log_likelihood = Some(mixture_log_likelihood(data.points(), &map, sigma)?.per_point);
        row.held_out_log_likelihood = Some(match (row.by, row.score) {
            (Criterion::HeldOut, Some(score)) => -score,
            _ => rating.held_out(size, sigma)?,
        });
        self.localize(data, &map, row)
    }

    /// Localizes the robot on a map, and compares with all points.
    fn localize(
        &self,
        data: &ChoiceData<'_>,
        map: &PointMap<2>,
        row: &mut ChoiceRow,
    ) -> Result<()> {
        let errors = |map: &PointMap<2>| -> Result<Vec<RunErrors>> {
            let max_distance = data.filter.values().max_distance;
            let distances = MapDistances::grid(map, max_distance)?;
            let of_run = |run| {
                let ChoiceData { localization, filter, .. } = data;
                let noise = self.odometry_noise;
                RunErrors::of(&track(self.seed, noise, localization, &distances, filter, run)?)
            };
            (0..self.runs).map(of_run).collect()
        };
        let weighted = |runs: &[RunErrors]| runs.iter().map(|run| run.weighted).collect();
        let on_all = match data.on_all.get() {
            Some(known) => known,
            None => {
                let found = weighted(&errors(&data.localization.all_points()?)?);
                // Another thread may have been faster; its errors are the same.
                data.on_all.get_or_init(|| found)
            }
        };
        let runs = errors(map)?;
        let on_map: Vec<f64> = weighted(&runs);
        let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
        row.map_points = Some(map.len());
        row.runs = Some(runs.len());
        row.diverged = Some(runs.iter().filter(|run| run.diverged).count());
        row.weighted = Some(mean(&on_map));
        row.weighted_all = Some(mean(on_all));
        row.verdict = Some(judge(&on_map, on_all, RaceSettings::default().ratio, RISK)?);
        Ok(())
    }
}
