use std::fmt;
use std::sync::{Arc, OnceLock};

use anyhow::{Context, Result, bail};
use mcl_core::memory::with_room;
use mcl_core::{Point, PointMap, Pose2, Recording, Seed};
use mcl_filter::{
    CheckedSettings, MapDistances, OdometryNoise, Replay, Run, localize, noisy_increments,
};
use mcl_maps::{MapSize, PointSet, RefineSettings, Refinement, fuzzy_k_means, initial_map};
use mcl_metrics::{
    DivergenceSettings, LossSettings, PoseError, WeightedPoseError, diverged, lost_episodes,
    pose_errors,
};
use serde::{Deserialize, Serialize};

use super::scheduler::{Stopwatch, Trial};
use super::{Builder, LocalizationExperiment, Split};
use mcl_study::data::source::LogSource;

/// Which map a robot is localized on, by the paper's names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum MapStrategy {
    /// Grid-based sampling with a random offset of the grid.
    #[serde(rename = "gbs")]
    Grid,
    /// The same, improved by fuzzy k-means.
    #[serde(rename = "gbs+f-km")]
    GridImproved,
    /// The same, improved by [`Refinement::BEST`].
    #[serde(rename = "gbs+best")]
    GridBest,
    /// Random sampling.
    #[serde(rename = "rnd")]
    Random,
    /// The same, improved by fuzzy k-means.
    #[serde(rename = "rnd+f-km")]
    RandomImproved,
    /// Every point, for reference.
    #[serde(rename = "all")]
    All,
}

impl MapStrategy {
    /// The four strategies of the paper.
    pub const SAMPLED: [MapStrategy; 4] = [
        MapStrategy::Grid,
        MapStrategy::GridImproved,
        MapStrategy::Random,
        MapStrategy::RandomImproved,
    ];

    /// Those of the paper and beyond.
    pub const DRAWN: [MapStrategy; 5] = [
        MapStrategy::Grid,
        MapStrategy::GridImproved,
        MapStrategy::Random,
        MapStrategy::RandomImproved,
        MapStrategy::GridBest,
    ];

    /// The maps of a builder, before or after fuzzy k-means.
    pub fn of(builder: Builder, improved: bool) -> Self {
        match (builder, improved) {
            (Builder::Grid, false) => MapStrategy::Grid,
            (Builder::Grid, true) => MapStrategy::GridImproved,
            (Builder::Random, false) => MapStrategy::Random,
            (Builder::Random, true) => MapStrategy::RandomImproved,
        }
    }

    /// Who chose the points; `None` for all points.
    pub fn builder(self) -> Option<Builder> {
        match self {
            MapStrategy::Grid | MapStrategy::GridImproved | MapStrategy::GridBest => {
                Some(Builder::Grid)
            }
            MapStrategy::Random | MapStrategy::RandomImproved => Some(Builder::Random),
            MapStrategy::All => None,
        }
    }

    /// The paper's name.
    pub fn label(self) -> &'static str {
        match self {
            MapStrategy::Grid => "gbs",
            MapStrategy::GridImproved => "gbs+f-km",
            MapStrategy::GridBest => "gbs+best",
            MapStrategy::Random => "rnd",
            MapStrategy::RandomImproved => "rnd+f-km",
            MapStrategy::All => "all",
        }
    }
}

/// A recording divided into what builds the map and what is localized.
pub struct LocalizationData<'a> {
    /// The division.
    pub split: Split,
    /// Name of the data set.
    pub dataset: &'a str,
    /// All scans.
    pub recording: &'a Recording,
    /// Points of the scans that build the map.
    pub points: PointSet<2>,
    /// Indices of the scans that are localized.
    pub scans: Vec<usize>,
    /// Their reference poses.
    pub reference: Vec<Pose2>,
    /// Distances from all points, once they are needed.
    all_distances: OnceLock<Arc<MapDistances>>,
}

impl<'a> LocalizationData<'a> {
    /// Divides a recording; `max_range` in metres.
    ///
    /// # Errors
    /// When a scan has no reference pose or no odometry, or no scan builds the map.
    pub fn new(
        split: Split,
        dataset: &'a str,
        recording: &'a Recording,
        max_range: f64,
    ) -> Result<Self> {
        let is_localized = |index: usize| split == Split::Same || !index.is_multiple_of(2);
        let points: Vec<Point<2>> = map_scans(recording, split).points(max_range)?;
        let scans: Vec<usize> = (0..recording.scans.len()).filter(|&i| is_localized(i)).collect();
        let reference = scans
            .iter()
            .map(|&scan| {
                recording.scans[scan]
                    .map_from_laser
                    .with_context(|| format!("scan {scan} has no reference pose"))
            })
            .collect::<Result<Vec<_>>>()?;
        if reference.len() < 2 {
            bail!("{} scans to localize, expected at least 2", reference.len());
        }
        let points = PointSet::new(points)?;
        let all_distances = OnceLock::new();
        Ok(LocalizationData { split, dataset, recording, points, scans, reference, all_distances })
    }

    /// A log divided in several ways.
    ///
    /// # Errors
    /// As [`LocalizationData::new`].
    pub fn of_splits(splits: &[Split], source: &'a LogSource) -> Result<Vec<Self>> {
        let of = |&split: &Split| {
            LocalizationData::new(split, &source.name, &source.recording, source.max_range)
        };
        splits.iter().map(of).collect()
    }

    /// The map of all points.
    ///
    /// # Errors
    /// When there is no memory for it.
    pub fn all_points(&self) -> Result<PointMap<2>> {
        let mut points = with_room(self.points.len(), "points of a map")?;
        points.extend_from_slice(self.points.points());
        Ok(PointMap::new(points)?)
    }

    /// The scans that build the map.
    pub fn map_recording(&self) -> Recording {
        map_scans(self.recording, self.split)
    }

    /// The distances from a map. Those from all points, the slowest to index, are kept, for many
    /// trials ask for them.
    ///
    /// # Errors
    /// When the map cannot be indexed.
    pub fn distances(
        &self,
        strategy: MapStrategy,
        map: &PointMap<2>,
        max_distance: f64,
    ) -> Result<Arc<MapDistances>> {
        let kept = self
            .all_distances
            .get()
            .filter(|kept| strategy == MapStrategy::All && kept.max_distance() == max_distance);
        if let Some(kept) = kept {
            return Ok(kept.clone());
        }
        let built = Arc::new(MapDistances::grid(map, max_distance)?);
        if strategy == MapStrategy::All {
            // Another thread may have been faster; its distances are the same.
            self.all_distances.get_or_init(|| built.clone());
        }
        Ok(built)
    }
}

fn map_scans(recording: &Recording, split: Split) -> Recording {
    let builds_map = |index: usize| split == Split::Same || index.is_multiple_of(2);
    let scans = recording.scans.iter().enumerate();
    let scans = scans.filter(|&(index, _)| builds_map(index)).map(|(_, scan)| scan.clone());
    Recording { scans: scans.collect(), robot_from_laser: recording.robot_from_laser }
}

/// A trial of the localization experiment: an initial map and what fuzzy k-means makes of it (or all
/// points), and the runs of the filter on them.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalizationTrial {
    /// How scans are divided.
    pub split: Split,
    /// How the initial map is chosen; `None` for all points.
    pub builder: Option<Builder>,
    /// Requested size in percent.
    pub size_percent: f64,
    /// Number of the map, from 0.
    pub map: u32,
    /// Seed of the initial map.
    pub map_seed: u64,
    /// Numbers of the runs.
    pub runs: Vec<u32>,
    /// Whether the map that the best refinement makes of a grid-based one is localized on, too.
    pub best: bool,
    cost: f64,
}

impl Trial for LocalizationTrial {
    fn cost(&self) -> f64 {
        self.cost
    }
}

/// "held-out gbs 0.25 % #3".
impl fmt::Display for LocalizationTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let builder = self.builder.map_or("all", |builder| builder.label(false));
        write!(f, "{} {builder} {} % #{}", self.split.name(), self.size_percent, self.map)
    }
}

impl LocalizationTrial {
    /// Strategies of the rows of this trial.
    pub fn strategies(&self) -> Vec<MapStrategy> {
        match self.builder {
            Some(builder) => {
                let mut maps =
                    [false, true].map(|improved| MapStrategy::of(builder, improved)).to_vec();
                maps.extend(self.best.then_some(MapStrategy::GridBest));
                maps
            }
            None => vec![MapStrategy::All],
        }
    }

    /// Keys of the rows of this trial.
    pub fn keys(&self) -> Vec<(Split, MapStrategy, u64, u32)> {
        let strategies = self.strategies();
        let of_run = |&run: &u32| {
            strategies
                .iter()
                .map(move |&strategy| (self.split, strategy, self.size_percent.to_bits(), run))
        };
        self.runs.iter().flat_map(of_run).collect()
    }
}

/// Seed of the initial map number `map` of a builder and size; `None` for all points.
pub(super) fn map_seed(
    seed: u64,
    dataset: &str,
    split: Split,
    builder: Option<Builder>,
    size_percent: f64,
    map: u32,
) -> u64 {
    Seed::new(seed)
        .derive("map")
        .derive(dataset)
        .derive(split.name())
        .derive(builder.map_or("all", |builder| builder.label(false)))
        .derive(&size_percent.to_string())
        .derive_index(u64::from(map))
        .number()
}

/// All trials of the experiment on a data set.
pub fn localization_trials(
    experiment: &LocalizationExperiment,
    dataset: &str,
) -> Vec<LocalizationTrial> {
    let runs = experiment.runs_for(dataset);
    let mut trials = Vec::new();
    for &split in &experiment.splits {
        for map in 0..experiment.maps {
            let runs: Vec<u32> = (map..runs).step_by(experiment.maps as usize).collect();
            let mut push = |builder: Option<Builder>, size_percent: f64| {
                let map_seed =
                    map_seed(experiment.seed, dataset, split, builder, size_percent, map);
                let best = experiment.best && builder == Some(Builder::Grid);
                let maps = if builder.is_some() { 2.0 + f64::from(best) } else { 1.5 };
                let cost = runs.len() as f64 * maps;
                let runs = runs.clone();
                trials.push(LocalizationTrial {
                    split,
                    builder,
                    size_percent,
                    map,
                    map_seed,
                    runs,
                    best,
                    cost,
                });
            };
            push(None, 100.0);
            for &size_percent in experiment.sizes_for(dataset) {
                for builder in Builder::ALL {
                    push(Some(builder), size_percent);
                }
            }
        }
    }
    trials
}

/// A run of the filter on a map. Errors are means over the run's scans: `weighted` by equation 7,
/// translation in metres, heading in radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/results.md.
pub struct LocalizationRow {
    pub dataset: String,
    pub split: Split,
    pub strategy: MapStrategy,
    pub size_percent: f64,
    pub map: u32,
    pub map_seed: u64,
    pub run: u32,
    pub data_points: usize,
    pub map_points: usize,
    pub scans: usize,
    pub used_beams: usize,
    pub weighted: f64,
    pub translation: f64,
    pub heading: f64,
    pub translation_max: f64,
    pub diverged: bool,
    pub lost_episodes: usize,
    pub recovered_episodes: usize,
    pub mean_effective_sample_size: f64,
    pub resamplings: usize,
}

impl LocalizationRow {
    /// What tells this row from the others on its data set.
    pub fn key(&self) -> (Split, MapStrategy, u64, u32) {
        (self.split, self.strategy, self.size_percent.to_bits(), self.run)
    }
}

/// A run with its errors.
pub struct TrackedRun {
    /// What the filter estimated and reported.
    pub run: Run,
    /// Errors of the estimates, per scan.
    pub errors: Vec<PoseError>,
}

impl LocalizationExperiment {
    /// The maps of a trial, by strategy.
    ///
    /// # Errors
    /// When a map cannot be built.
    pub fn maps_of(
        &self,
        data: &LocalizationData<'_>,
        trial: &LocalizationTrial,
    ) -> Result<Vec<(MapStrategy, PointMap<2>)>> {
        let Some(builder) = trial.builder else {
            return Ok(vec![(MapStrategy::All, data.all_points()?)]);
        };
        let size = MapSize::Percent(trial.size_percent);
        let initial = initial_map(&data.points, &builder.initial(size, trial.map_seed))?;
        let (means, _) = fuzzy_k_means(&data.points, &initial.map, &self.fkm(), |_, _| {})?;
        let improved = initial.snapped(&data.points, &means)?;
        let mut maps = vec![(MapStrategy::of(builder, true), improved.map)];
        if trial.best {
            let best = RefineSettings {
                method: Refinement::BEST,
                seed: Seed::new(trial.map_seed),
                ..RefineSettings::fkm(self.fkm())
            };
            maps.push((MapStrategy::GridBest, initial.refined(&data.points, &best, |_| {})?.map));
        }
        maps.insert(0, (MapStrategy::of(builder, false), initial.map));
        Ok(maps)
    }

    /// Localizes the robot on a map. Noise and filter depend on the run's number, never on the map.
    ///
    /// # Errors
    /// When the filter cannot run on this recording.
    pub fn track(
        &self,
        data: &LocalizationData<'_>,
        distances: &MapDistances,
        settings: &CheckedSettings,
        run: u32,
    ) -> Result<TrackedRun> {
        track(self.seed, self.odometry_noise, data, distances, settings, run)
    }

    /// Runs one trial: a row per map and run.
    ///
    /// # Errors
    /// When a map cannot be built or the filter cannot run.
    pub fn run_trial(
        &self,
        data: &LocalizationData<'_>,
        settings: &CheckedSettings,
        trial: &LocalizationTrial,
        watch: &mut Stopwatch,
    ) -> Result<Vec<LocalizationRow>> {
        let mut rows = Vec::new();
        let maps = self.maps_of(data, trial)?;
        watch.lap("maps");
        for (strategy, map) in maps {
            let distances = data.distances(strategy, &map, settings.values().max_distance)?;
            watch.lap("distance fields");
            for &run in &trial.runs {
                let tracked = self.track(data, &distances, settings, run)?;
                rows.push(row(data, trial, strategy, map.len(), run, &tracked)?);
            }
            watch.lap("filter");
        }
        Ok(rows)
    }
}

/// Localizes the robot on a map. Noise and filter depend on the experiment's seed, the data and the run's
/// number, never on the map.
pub(crate) fn track(
    seed: u64,
    odometry_noise: OdometryNoise,
    data: &LocalizationData<'_>,
    distances: &MapDistances,
    settings: &CheckedSettings,
    run: u32,
) -> Result<TrackedRun> {
    let seed = |purpose: &str| {
        Seed::new(seed)
            .derive(purpose)
            .derive(data.dataset)
            .derive(data.split.name())
            .derive_index(u64::from(run))
    };
    let odometry: Vec<Option<Pose2>> =
        data.recording.scans.iter().map(|scan| scan.odometry).collect();
    let increments = noisy_increments(&odometry, odometry_noise, seed("experiment-noise"))?;
    let replay = Replay { recording: data.recording, increments: &increments, scans: &data.scans };
    let run = localize(&replay, distances, settings, Some(data.reference[0]), seed("filter"))?;
    let errors = pose_errors(&data.reference, &run.map_from_laser)?;
    Ok(TrackedRun { run, errors })
}

/// Figures of a run: means over its scans, as in [`LocalizationRow`].
pub(crate) struct RunErrors {
    pub scans: usize,
    pub weighted: f64,
    pub translation: f64,
    pub heading: f64,
    pub translation_max: f64,
    pub diverged: bool,
    pub lost_episodes: usize,
    pub recovered_episodes: usize,
    pub mean_effective_sample_size: f64,
}

impl RunErrors {
    pub fn of(tracked: &TrackedRun) -> Result<Self> {
        let weighted = WeightedPoseError::default();
        let translations: Vec<f64> = tracked.errors.iter().map(PoseError::translation).collect();
        let episodes = lost_episodes(&translations, &LossSettings::default())?;
        let scans = tracked.errors.len();
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / scans as f64;
        let mut sample_sizes = tracked.run.reports.iter().map(|r| r.effective_sample_size);
        Ok(RunErrors {
            scans,
            weighted: mean(&mut tracked.errors.iter().map(|error| weighted.of(error))),
            translation: mean(&mut translations.iter().copied()),
            heading: mean(&mut tracked.errors.iter().map(PoseError::heading)),
            translation_max: translations.iter().copied().fold(0.0, f64::max),
            diverged: diverged(&translations, &DivergenceSettings::default())?,
            lost_episodes: episodes.len(),
            recovered_episodes: episodes.iter().filter(|e| e.recovered.is_some()).count(),
            mean_effective_sample_size: mean(&mut sample_sizes),
        })
    }
}

/// The row of a run.
pub(super) fn row(
    data: &LocalizationData<'_>,
    trial: &LocalizationTrial,
    strategy: MapStrategy,
    map_points: usize,
    run: u32,
    tracked: &TrackedRun,
) -> Result<LocalizationRow> {
    let errors = RunErrors::of(tracked)?;
    let reports = &tracked.run.reports;
    Ok(LocalizationRow {
        dataset: data.dataset.to_owned(),
        split: data.split,
        strategy,
        size_percent: trial.size_percent,
        map: trial.map,
        map_seed: trial.map_seed,
        run,
        data_points: data.points.len(),
        map_points,
        scans: errors.scans,
        used_beams: reports.iter().map(|report| report.used_beams).sum(),
        weighted: errors.weighted,
        translation: errors.translation,
        heading: errors.heading,
        translation_max: errors.translation_max,
        diverged: errors.diverged,
        lost_episodes: errors.lost_episodes,
        recovered_episodes: errors.recovered_episodes,
        mean_effective_sample_size: errors.mean_effective_sample_size,
        resamplings: reports.iter().filter(|report| report.resampled).count(),
    })
}
