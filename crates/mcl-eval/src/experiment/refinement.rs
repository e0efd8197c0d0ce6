use std::fmt;

use anyhow::{Result, bail};
use mcl_core::Seed;
use mcl_maps::refine::RefineSettings;
use mcl_maps::size_criteria::bic;
use mcl_maps::{FkmSettings, MapSize, PointSet, Refinement, initial_map, mixture_log_likelihood};
use mcl_metrics::mean_interval;
use serde::{Deserialize, Serialize};

use super::definition::{Definition, check_name, check_percent, check_rows};
use super::scheduler::{Stopwatch, Trial};
use super::{Builder, Kind, Split};

/// Settings of a comparison of refinements: how likely the data is under maps of the same size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefinementExperiment {
    /// [`Kind::Refinement`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// Initial maps (offsets of the grid) per size; with [`Split::HeldOut`] each holds out other scans.
    pub repeats: u32,
    /// Which scans build maps, and which they are rated by: all, or blocks of time held out.
    pub splits: Vec<Split>,
    /// Map sizes in percent of the points that build the map.
    pub sizes: Vec<f64>,
    /// Further sizes, of plain fuzzy k-means only: those that others are measured by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plain_sizes: Vec<f64>,
    /// What is made of each initial map.
    pub methods: Vec<Refinement>,
    /// σ of the mixture in metres.
    pub sigma: f64,
    /// EM stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// EM stops after this many updates.
    pub max_iterations: usize,
    /// The data sets to run on, as far as they are at hand.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<RefinementDataset>,
}

/// A data set of a comparison of refinements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefinementDataset {
    /// Name in the registry.
    pub name: String,
    /// Sizes for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sizes: Vec<f64>,
    /// Initial maps for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats: Option<u32>,
    /// Further sizes of plain fuzzy k-means for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plain_sizes: Option<Vec<f64>>,
    /// Names of those of the experiment's methods that are run on this data set; none: all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub methods: Vec<String>,
}

impl RefinementExperiment {
    /// σ, and when EM stops.
    pub fn fkm(&self) -> FkmSettings {
        FkmSettings {
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
        }
    }

    fn of_dataset(&self, name: &str) -> Option<&RefinementDataset> {
        self.datasets.iter().find(|dataset| dataset.name == name)
    }

    fn sizes_for(&self, name: &str) -> &[f64] {
        self.of_dataset(name)
            .map(|dataset| &dataset.sizes)
            .filter(|sizes| !sizes.is_empty())
            .unwrap_or(&self.sizes)
    }

    /// Methods for a data set: those that it names, or all of the experiment's.
    pub fn methods_for(&self, name: &str) -> Vec<Refinement> {
        let named = self.of_dataset(name).map_or(&[][..], |dataset| &dataset.methods);
        let is_run = |method: &&Refinement| {
            named.is_empty() || named.iter().any(|named| named == method.name())
        };
        self.methods.iter().filter(is_run).copied().collect()
    }

    fn plain_sizes_for(&self, name: &str) -> &[f64] {
        let own = self.of_dataset(name).and_then(|dataset| dataset.plain_sizes.as_ref());
        own.unwrap_or(&self.plain_sizes)
    }

    fn repeats_for(&self, name: &str) -> u32 {
        self.of_dataset(name).and_then(|dataset| dataset.repeats).unwrap_or(self.repeats)
    }
}

impl Definition for RefinementExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        if self.splits.is_empty() {
            bail!("splits is empty, expected \"same\", \"held-out\" or both");
        }
        if self.sizes.is_empty() {
            bail!("sizes is empty, expected at least one");
        }
        let own = self.datasets.iter();
        for &size in own.clone().flat_map(|dataset| &dataset.sizes).chain(&self.sizes) {
            check_percent(size, "sizes")?;
        }
        let plain = own.clone().filter_map(|dataset| dataset.plain_sizes.as_ref());
        for &size in plain.flatten().chain(&self.plain_sizes) {
            check_percent(size, "plain_sizes")?;
        }
        let most = own
            .clone()
            .map(|d| d.sizes.len() + d.plain_sizes.as_ref().map_or(0, Vec::len))
            .chain([self.sizes.len() + self.plain_sizes.len()])
            .max();
        for repeats in own.filter_map(|dataset| dataset.repeats).chain([self.repeats]) {
            if repeats == 0 {
                bail!("repeats is 0, expected at least 1");
            }
            let rows =
                [repeats as usize, self.splits.len(), most.unwrap_or(0), 1 + self.methods.len()];
            check_rows(&rows, &format!("repeats = {repeats}"))?;
        }
        let mut names: Vec<&str> = self.methods.iter().map(Refinement::name).collect();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            bail!("methods lists {} twice", pair[0]);
        }
        for dataset in &self.datasets {
            if let Some(other) = dataset.methods.iter().find(|name| !names.contains(&name.as_str()))
            {
                bail!(
                    "data set {}: methods names {other}, expected one of the experiment's: {}",
                    dataset.name,
                    names.join(", ")
                );
            }
        }
        Ok(())
    }
}

/// A trial: a grid-based map, and what each method makes of it.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinementTrial {
    /// How scans are divided.
    pub split: Split,
    /// Requested size in percent.
    pub size_percent: f64,
    /// Number of the repeat, from 0.
    pub repeat: u32,
    /// What is made of the initial map.
    pub methods: Vec<Refinement>,
    seed: u64,
}

/// What tells a row from the others on its data set: split, size by its bits, repeat, method.
pub type RefinementKey = (Split, u64, u32, String);

impl Trial for RefinementTrial {
    fn cost(&self) -> f64 {
        // Pairs of points and components grow with the density of the map.
        1.0 + self.size_percent
    }
}

/// "held-out 0.25 % #3".
impl fmt::Display for RefinementTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} % #{}", self.split.name(), self.size_percent, self.repeat)
    }
}

impl RefinementTrial {
    /// Keys of the rows of this trial.
    pub fn keys(&self) -> Vec<RefinementKey> {
        let names = [INITIAL].into_iter().chain(self.methods.iter().map(Refinement::name));
        let size = self.size_percent.to_bits();
        names.map(|name| (self.split, size, self.repeat, name.to_owned())).collect()
    }
}

/// All trials of the experiment on a data set.
pub fn refinement_trials(experiment: &RefinementExperiment, dataset: &str) -> Vec<RefinementTrial> {
    let root = Seed::new(experiment.seed).derive("map").derive(dataset);
    let methods = experiment.methods_for(dataset);
    let is_plain = |method: &&Refinement| method.name() == PLAIN;
    let plain: Vec<Refinement> = methods.iter().filter(is_plain).copied().collect();
    let mut trials = Vec::new();
    for &split in &experiment.splits {
        let sizes = experiment.sizes_for(dataset);
        let plain_sizes = experiment.plain_sizes_for(dataset);
        let further = plain_sizes.iter().filter(|size| !sizes.contains(size));
        for (&size_percent, methods) in
            sizes.iter().map(|size| (size, &methods)).chain(further.map(|size| (size, &plain)))
        {
            for repeat in 0..experiment.repeats_for(dataset) {
                let seed = root
                    .derive(split.name())
                    .derive(&size_percent.to_string())
                    .derive_index(u64::from(repeat))
                    .number();
                let methods = methods.clone();
                trials.push(RefinementTrial { split, size_percent, repeat, methods, seed });
            }
        }
    }
    trials
}

/// A map, and how likely the points are that built it, and others. Likelihoods in nats per point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/results.md.
pub struct RefinementRow {
    pub dataset: String,
    pub split: Split,
    /// `gbs` for the initial map.
    pub method: String,
    pub size_percent: f64,
    pub repeat: u32,
    pub seed: u64,
    pub data_points: usize,
    pub map_points: usize,
    pub evaluations: usize,
    pub converged: Option<bool>,
    pub log_likelihood: f64,
    pub held_out_log_likelihood: Option<f64>,
}

impl RefinementRow {
    /// What tells this row from the others on its data set.
    pub fn key(&self) -> RefinementKey {
        (self.split, self.size_percent.to_bits(), self.repeat, self.method.clone())
    }
}

impl RefinementExperiment {
    /// Runs one trial: a row for the initial map and one per method. `held_out` are other points that
    /// maps are rated by.
    ///
    /// # Errors
    /// When a map cannot be built.
    pub fn run_trial<const D: usize>(
        &self,
        dataset: &str,
        building: &PointSet<D>,
        held_out: Option<&PointSet<D>>,
        trial: &RefinementTrial,
        watch: &mut Stopwatch,
    ) -> Result<Vec<RefinementRow>> {
        let size = MapSize::Percent(trial.size_percent);
        let initial = initial_map(building, &Builder::Grid.initial(size, trial.seed))?;
        watch.lap(INITIAL);
        let mut maps = vec![(INITIAL, initial.clone())];
        for &method in &trial.methods {
            let seed = Seed::new(trial.seed);
            let settings = RefineSettings { method, seed, ..RefineSettings::fkm(self.fkm()) };
            maps.push((method.name(), initial.refined(building, &settings, |_| {})?));
            watch.lap(method.name());
        }
        let mut rows = Vec::new();
        for (method, built) in maps {
            let per_point = |data: &PointSet<D>| {
                mixture_log_likelihood(data, &built.map, self.sigma).map(|found| found.per_point)
            };
            rows.push(RefinementRow {
                dataset: dataset.to_owned(),
                split: trial.split,
                method: method.to_owned(),
                size_percent: trial.size_percent,
                repeat: trial.repeat,
                seed: trial.seed,
                data_points: building.len(),
                map_points: built.map.len(),
                evaluations: built.refinement.as_ref().map_or(0, |report| report.evaluations),
                converged: built.refinement.as_ref().map(|report| report.converged),
                log_likelihood: per_point(building)?,
                held_out_log_likelihood: held_out.map(per_point).transpose()?,
            });
        }
        watch.lap("likelihood");
        Ok(rows)
    }
}

/// The method of the initial maps' rows.
pub const INITIAL: &str = "gbs";

/// The method whose maps others are measured by.
const PLAIN: &str = "fkm";

/// Summary of the maps of one split, method and size. Likelihoods in nats per point, with Student's 95 %
/// interval of the mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/results.md.
pub struct RefinementSummaryRow {
    pub dataset: String,
    pub split: Split,
    pub method: String,
    pub size_percent: f64,
    pub maps: usize,
    pub mean_map_points: f64,
    pub mean_real_percent: f64,
    pub log_likelihood: f64,
    pub ci95_low: Option<f64>,
    pub ci95_high: Option<f64>,
    pub held_out_log_likelihood: Option<f64>,
    /// How many times as many points a map of plain fuzzy k-means needs for the same likelihood (of held-out
    /// points where there are some): between its measured sizes, interpolated in the logarithm.
    pub plain_size_factor: Option<f64>,
    /// The Bayesian information criterion in nats per point; smaller is better (docs/refinement.md).
    pub bic: f64,
}

/// Summaries per split, method and size, in that order, of maps in so many dimensions.
///
/// # Errors
/// When a row holds a number that is none.
pub fn summarize_refinement(
    rows: &[RefinementRow],
    dimensions: usize,
) -> Result<Vec<RefinementSummaryRow>> {
    let mut sorted: Vec<&RefinementRow> = rows.iter().collect();
    sorted.sort_by(|a, b| {
        (a.split, &a.method)
            .cmp(&(b.split, &b.method))
            .then(a.size_percent.total_cmp(&b.size_percent))
    });
    let same = |a: &&RefinementRow, b: &&RefinementRow| {
        (a.split, &a.method, a.size_percent) == (b.split, &b.method, b.size_percent)
    };
    let cells = sorted.chunk_by(same);
    let mut summary =
        cells.map(|cell| summarize_cell(cell, dimensions)).collect::<Result<Vec<_>>>()?;
    let factors: Vec<_> = summary.iter().map(|row| plain_size_factor(row, &summary)).collect();
    for (row, factor) in summary.iter_mut().zip(factors) {
        row.plain_size_factor = factor;
    }
    Ok(summary)
}

fn summarize_cell(cell: &[&RefinementRow], dimensions: usize) -> Result<RefinementSummaryRow> {
    let first = cell[0];
    let mean = |value: &dyn Fn(&RefinementRow) -> f64| {
        cell.iter().map(|row| value(row)).sum::<f64>() / cell.len() as f64
    };
    let likelihoods: Vec<f64> = cell.iter().map(|row| row.log_likelihood).collect();
    let interval = match cell.len() {
        1 => None,
        _ => Some(mean_interval(&likelihoods)?.interval),
    };
    let held_out: Option<Vec<f64>> = cell.iter().map(|row| row.held_out_log_likelihood).collect();
    let mean_map_points = mean(&|row| row.map_points as f64);
    Ok(RefinementSummaryRow {
        dataset: first.dataset.clone(),
        split: first.split,
        method: first.method.clone(),
        size_percent: first.size_percent,
        maps: cell.len(),
        mean_map_points,
        mean_real_percent: mean(&|row| 100.0 * row.map_points as f64 / row.data_points as f64),
        log_likelihood: mean(&|row| row.log_likelihood),
        ci95_low: interval.map(|interval| interval.low),
        ci95_high: interval.map(|interval| interval.high),
        held_out_log_likelihood: held_out.map(|all| all.iter().sum::<f64>() / all.len() as f64),
        plain_size_factor: None,
        bic: mean(&|row| bic(row.log_likelihood, row.data_points, row.map_points, dimensions)),
    })
}

/// At which size the curve of plain fuzzy k-means reaches the likelihood of a row, over the row's size.
fn plain_size_factor(row: &RefinementSummaryRow, all: &[RefinementSummaryRow]) -> Option<f64> {
    let rated =
        |row: &RefinementSummaryRow| row.held_out_log_likelihood.unwrap_or(row.log_likelihood);
    let plain: Vec<_> =
        all.iter().filter(|other| other.method == PLAIN && other.split == row.split).collect();
    let pair =
        plain.windows(2).find(|pair| (rated(pair[0])..=rated(pair[1])).contains(&rated(row)))?;
    let (below, above) = (rated(pair[0]), rated(pair[1]));
    let part = if above > below { (rated(row) - below) / (above - below) } else { 0.0 };
    let sizes = [pair[0], pair[1]].map(|row| row.mean_map_points.ln());
    Some((sizes[0] + part * (sizes[1] - sizes[0])).exp() / row.mean_map_points)
}
