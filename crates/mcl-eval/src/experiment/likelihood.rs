use anyhow::Result;
use mcl_core::{Point, Seed};
use mcl_maps::{
    GridOffset, InitialMap, MapSize, PointSet, fuzzy_k_means, initial_map, mixture_log_likelihood,
};
use mcl_metrics::{Summary, mean_interval, paired_t_test, standard_deviation, welch_t_test};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::scheduler::{Stopwatch, Trial};
use super::{LikelihoodExperiment, SizeGroup};

/// How an initial map is chosen, by the paper's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Builder {
    /// Grid-based sampling with a random offset of the grid.
    #[serde(rename = "gbs")]
    Grid,
    /// Random sampling.
    #[serde(rename = "rnd")]
    Random,
}

impl Builder {
    /// Both builders.
    pub const ALL: [Builder; 2] = [Builder::Grid, Builder::Random];

    /// The paper's name of the maps, before or after fuzzy k-means.
    pub fn label(self, improved: bool) -> &'static str {
        match (self, improved) {
            (Builder::Grid, false) => "gbs",
            (Builder::Grid, true) => "gbs+f-km",
            (Builder::Random, false) => "rnd",
            (Builder::Random, true) => "rnd+f-km",
        }
    }

    /// The initial map of `size` that belongs to a seed.
    pub fn initial<const D: usize>(self, size: MapSize, seed: u64) -> InitialMap<D> {
        let seed = Seed::new(seed);
        match self {
            Builder::Random => InitialMap::Random { size, seed },
            Builder::Grid => {
                let mut rng = seed.derive("grid-offset").rng();
                let offset = std::array::from_fn(|_| rng.random::<f64>());
                InitialMap::GridSize { size, offset: GridOffset::Cells(offset) }
            }
        }
    }
}

/// A trial of the likelihood experiment: one initial map, and what fuzzy k-means makes of it.
#[derive(Debug, Clone, PartialEq)]
pub struct LikelihoodTrial {
    /// How the initial map is chosen.
    pub builder: Builder,
    /// Requested size in percent.
    pub size_percent: f64,
    /// Number of the repeat, from 0.
    pub repeat: u32,
    /// Seed of the initial map.
    pub seed: u64,
    cost: f64,
}

impl Trial for LikelihoodTrial {
    fn cost(&self) -> f64 {
        self.cost
    }
}

/// "gbs 0.25 % #3".
impl std::fmt::Display for LikelihoodTrial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {} % #{}", self.builder.label(false), self.size_percent, self.repeat)
    }
}

/// All trials of the experiment on a data set of `points` points.
pub fn trials(
    experiment: &LikelihoodExperiment,
    dataset: &str,
    sizes: &[SizeGroup],
    points: usize,
) -> Vec<LikelihoodTrial> {
    let root = Seed::new(experiment.seed).derive("map").derive(dataset);
    let mut trials = Vec::new();
    for group in sizes {
        for &size_percent in &group.percent {
            for builder in Builder::ALL {
                for repeat in 0..group.repeats {
                    let seed = root
                        .derive(builder.label(false))
                        .derive(&size_percent.to_string())
                        .derive_index(u64::from(repeat))
                        .number();
                    // Pairs of points and components grow with the density of the map.
                    let cost = points as f64 * (4.0 + size_percent);
                    trials.push(LikelihoodTrial { builder, size_percent, repeat, seed, cost });
                }
            }
        }
    }
    trials
}

/// What a trial of the likelihood experiment measured. Sizes in points; likelihoods in nats per point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/results.md.
pub struct LikelihoodRow {
    pub dataset: String,
    pub builder: Builder,
    pub size_percent: f64,
    pub repeat: u32,
    pub seed: u64,
    pub data_points: usize,
    pub requested_points: usize,
    pub cell_m: Option<f64>,
    pub offset_x_m: Option<f64>,
    pub offset_y_m: Option<f64>,
    pub initial_points: usize,
    pub initial_log_likelihood: f64,
    pub iterations: usize,
    pub converged: bool,
    pub fitted_log_likelihood: f64,
    pub improved_points: usize,
    pub improved_log_likelihood: f64,
}

impl LikelihoodRow {
    /// What tells the trial of this row from the others on its data set.
    pub fn key(&self) -> (u64, Builder, u32) {
        (self.size_percent.to_bits(), self.builder, self.repeat)
    }
}

impl LikelihoodTrial {
    /// What tells this trial from the others on its data set.
    pub fn key(&self) -> (u64, Builder, u32) {
        (self.size_percent.to_bits(), self.builder, self.repeat)
    }
}

/// Runs one trial.
///
/// # Errors
/// When the map cannot be built.
pub fn run_likelihood_trial<const D: usize>(
    experiment: &LikelihoodExperiment,
    dataset: &str,
    data: &PointSet<D>,
    trial: &LikelihoodTrial,
    watch: &mut Stopwatch,
) -> Result<LikelihoodRow> {
    let size = MapSize::Percent(trial.size_percent);
    let initial = initial_map(data, &trial.builder.initial(size, trial.seed))?;
    watch.lap("initial map");
    let (means, report) = fuzzy_k_means(data, &initial.map, &experiment.fkm(), |_, _| {})?;
    let improved = initial.snapped(data, &means)?;
    watch.lap("fuzzy k-means");
    let improved_log_likelihood =
        mixture_log_likelihood(data, &improved.map, experiment.sigma)?.per_point;
    watch.lap("likelihood");

    let trace = &report.log_likelihood_trace;
    // A third one follows from the seed, as these do.
    let axis = |axis: usize| initial.offset.map(|offset: Point<D>| offset[axis]);
    Ok(LikelihoodRow {
        dataset: dataset.to_owned(),
        builder: trial.builder,
        size_percent: trial.size_percent,
        repeat: trial.repeat,
        seed: trial.seed,
        data_points: data.len(),
        requested_points: size.resolve(data.len())?,
        cell_m: initial.cell,
        offset_x_m: axis(0),
        offset_y_m: axis(1),
        initial_points: initial.map.len(),
        initial_log_likelihood: trace[0],
        iterations: report.iterations,
        converged: report.converged,
        fitted_log_likelihood: trace[trace.len() - 1],
        improved_points: improved.map.len(),
        improved_log_likelihood,
    })
}

/// Summary of the maps of one strategy and size. Likelihoods in nats per point; the interval is
/// Student's 95 % interval of the mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/results.md.
pub struct SummaryRow {
    pub dataset: String,
    pub strategy: String,
    pub builder: Builder,
    pub improved: bool,
    pub size_percent: f64,
    pub maps: usize,
    pub mean_map_points: f64,
    pub mean_real_percent: f64,
    pub mean_log_likelihood: f64,
    pub sd_log_likelihood: Option<f64>,
    pub ci95_low: Option<f64>,
    pub ci95_high: Option<f64>,
    pub mean_iterations: Option<f64>,
}

/// A test of improved against initial maps of one initialization and size. Differences are improved
/// minus initial, in nats per point; p is two-sided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of tests.csv, described in docs/results.md.
pub struct TestRow {
    pub dataset: String,
    pub builder: Builder,
    pub size_percent: f64,
    pub maps: usize,
    pub mean_difference: f64,
    pub welch_t: f64,
    pub welch_df: f64,
    pub welch_p: f64,
    pub paired_t: f64,
    pub paired_df: f64,
    pub paired_p: f64,
    pub ci95_low: f64,
    pub ci95_high: f64,
}

/// Summaries per strategy and size, in that order.
///
/// # Errors
/// When a row holds a number that is none.
pub fn summarize(rows: &[LikelihoodRow]) -> Result<Vec<SummaryRow>> {
    let mut summary = Vec::new();
    for builder in Builder::ALL {
        for improved in [false, true] {
            for (size_percent, cell) in cells(rows, builder) {
                let of = |value: fn(&LikelihoodRow, bool) -> f64| -> Vec<f64> {
                    cell.iter().map(|row| value(row, improved)).collect()
                };
                let mean = |value| Summary::of(&of(value)).map(|summary| summary.mean);
                let likelihoods = of(LikelihoodRow::log_likelihood);
                // One map has no spread to estimate an interval from.
                let (sd, interval) = match likelihoods.len() {
                    1 => (None, None),
                    _ => (
                        Some(standard_deviation(&likelihoods)?),
                        Some(mean_interval(&likelihoods)?.interval),
                    ),
                };
                let iterations = mean(|row, _| row.iterations as f64)?;
                summary.push(SummaryRow {
                    dataset: cell[0].dataset.clone(),
                    strategy: builder.label(improved).to_owned(),
                    builder,
                    improved,
                    size_percent,
                    maps: cell.len(),
                    mean_map_points: mean(|row, improved| row.map_points(improved) as f64)?,
                    mean_real_percent: mean(|row, improved| {
                        100.0 * row.map_points(improved) as f64 / row.data_points as f64
                    })?,
                    mean_log_likelihood: Summary::of(&likelihoods)?.mean,
                    sd_log_likelihood: sd,
                    ci95_low: interval.map(|interval| interval.low),
                    ci95_high: interval.map(|interval| interval.high),
                    mean_iterations: improved.then_some(iterations),
                });
            }
        }
    }
    Ok(summary)
}

/// Tests of improved against initial maps per initialization and size: Welch's two-sample t test, as
/// in the paper, and the paired differences. Sizes with fewer than two maps have no test.
///
/// # Errors
/// When a row holds a number that is none.
pub fn test_improvement(rows: &[LikelihoodRow]) -> Result<Vec<TestRow>> {
    let mut tests = Vec::new();
    for builder in Builder::ALL {
        for (size_percent, cell) in cells(rows, builder) {
            if cell.len() < 2 {
                continue;
            }
            let of = |improved| -> Vec<f64> {
                cell.iter().map(|row| row.log_likelihood(improved)).collect()
            };
            let (initial, improved) = (of(false), of(true));
            let welch = welch_t_test(&improved, &initial)?;
            let paired = paired_t_test(&improved, &initial)?;
            tests.push(TestRow {
                dataset: cell[0].dataset.clone(),
                builder,
                size_percent,
                maps: cell.len(),
                mean_difference: paired.mean_difference,
                welch_t: welch.t,
                welch_df: welch.degrees_of_freedom,
                welch_p: welch.p_two_sided,
                paired_t: paired.t,
                paired_df: paired.degrees_of_freedom,
                paired_p: paired.p_two_sided,
                ci95_low: paired.interval.low,
                ci95_high: paired.interval.high,
            });
        }
    }
    Ok(tests)
}

impl LikelihoodRow {
    /// Log-likelihood per point (nats) of the initial or the improved map.
    pub fn log_likelihood(&self, improved: bool) -> f64 {
        if improved { self.improved_log_likelihood } else { self.initial_log_likelihood }
    }

    /// Number of points of the initial or the improved map.
    pub fn map_points(&self, improved: bool) -> usize {
        if improved { self.improved_points } else { self.initial_points }
    }
}

/// The rows of one builder, size by size, sizes ascending.
fn cells(rows: &[LikelihoodRow], builder: Builder) -> Vec<(f64, Vec<&LikelihoodRow>)> {
    let mut of_builder: Vec<_> = rows.iter().filter(|row| row.builder == builder).collect();
    of_builder.sort_by(|a, b| a.size_percent.total_cmp(&b.size_percent));
    of_builder
        .chunk_by(|a, b| a.size_percent == b.size_percent)
        .map(|cell| (cell[0].size_percent, cell.to_vec()))
        .collect()
}
