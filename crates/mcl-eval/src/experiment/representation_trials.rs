use anyhow::Result;
use mcl_core::{PointMap, Seed};
use mcl_filter::sensor::{NdtReading, ObstacleGrid};
use mcl_filter::{CheckedSettings, MapDistances};
use mcl_maps::bytes::{grid_bytes, grid_run_lengths, ndt_bytes, point_bytes, segment_bytes};
use mcl_maps::ndt::{NdtSettings, normal_distributions};
use mcl_maps::occupancy::{Cell, FreeSpace, rasterize};
use mcl_maps::segments::{SegmentSettings, line_segments};
use mcl_maps::{MapSettings, MapSize, RefineSettings, Refinement, build_map};
use serde::{Deserialize, Serialize};

use super::localization::{RunErrors, track};
use super::scheduler::Stopwatch;
use super::{
    Builder, LocalizationData, Representation, RepresentationKey, RepresentationTrial,
    RepresentationsExperiment, Split,
};

/// A run of the filter on a map. Errors are means over the run's scans: `weighted` by equation 7,
/// translation in metres, heading in radians. `elements` are points, cells of a grid,
/// Gaussians, or segments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of trials.csv, described in docs/representations.md.
pub struct RepresentationRow {
    pub dataset: String,
    pub split: Split,
    pub representation: Representation,
    pub parameter: f64,
    pub map: u32,
    pub map_seed: Option<u64>,
    pub run: u32,
    pub elements: usize,
    pub bytes_raw: usize,
    pub bytes_run_length: Option<usize>,
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

impl RepresentationRow {
    /// What tells this row from the others on its data set.
    pub fn key(&self) -> RepresentationKey {
        (self.split, self.representation, self.parameter.to_bits(), self.run)
    }
}

/// A map as the filter sees it, and what it takes.
struct BuiltRepresentation {
    distances: MapDistances,
    elements: usize,
    bytes_raw: usize,
    bytes_run_length: Option<usize>,
}

impl BuiltRepresentation {
    fn of_points(map: &PointMap<2>, max_distance: f64) -> Result<Self> {
        Ok(BuiltRepresentation {
            distances: MapDistances::grid(map, max_distance)?,
            elements: map.len(),
            bytes_raw: point_bytes(map),
            bytes_run_length: None,
        })
    }

    /// The cells that hold a point are occupied; those crossed by beams and holding none are free.
    fn of_grid(
        data: &LocalizationData<'_>,
        resolution: f64,
        settings: &CheckedSettings,
    ) -> Result<Self> {
        let recording = data.map_recording();
        let max_range = settings.values().max_range;
        let points = data.all_points()?;
        let free_space = FreeSpace { recording: &recording, max_range };
        let grid = rasterize(&points, resolution, Some(free_space))?;
        let occupied: Vec<bool> = grid.cells().iter().map(|&cell| cell == Cell::Occupied).collect();
        let obstacles = ObstacleGrid {
            width: grid.width(),
            resolution,
            map_from_grid: grid.map_from_grid(),
            occupied: &occupied,
        };
        Ok(BuiltRepresentation {
            distances: MapDistances::cells(&obstacles, settings.values().max_distance)?,
            elements: grid.cells().len(),
            bytes_raw: grid_bytes(&grid),
            bytes_run_length: Some(grid_run_lengths(&grid).len()),
        })
    }

    fn of_ndt(
        data: &LocalizationData<'_>,
        cell: f64,
        wide: bool,
        settings: &CheckedSettings,
    ) -> Result<Self> {
        let map = normal_distributions(data.points.points(), &NdtSettings::of_cell(cell))?;
        let sigma_hit = settings.values().sigma_hit;
        let reading = NdtReading { sigma_hit, endpoint_std: if wide { sigma_hit } else { 0.0 } };
        Ok(BuiltRepresentation {
            distances: MapDistances::ndt(&map, reading, settings.values().max_distance)?,
            elements: map.cells().len(),
            bytes_raw: ndt_bytes(&map),
            bytes_run_length: None,
        })
    }

    fn of_segments(
        data: &LocalizationData<'_>,
        tolerance: f64,
        settings: &CheckedSettings,
    ) -> Result<Self> {
        let (recording, settings) = (data.map_recording(), settings.values());
        let of_tolerance = SegmentSettings::of_tolerance(tolerance);
        let map = line_segments(&recording, settings.max_range, &of_tolerance)?;
        Ok(BuiltRepresentation {
            distances: MapDistances::segments(&map, settings.max_distance)?,
            elements: map.segments().len(),
            bytes_raw: segment_bytes(&map),
            bytes_run_length: None,
        })
    }
}

impl RepresentationsExperiment {
    /// Runs one trial: a row per run.
    ///
    /// # Errors
    /// When the map cannot be built or the filter cannot run.
    pub fn run_trial(
        &self,
        data: &LocalizationData<'_>,
        settings: &CheckedSettings,
        trial: &RepresentationTrial,
        watch: &mut Stopwatch,
    ) -> Result<Vec<RepresentationRow>> {
        let built = self.build(data, settings, trial)?;
        watch.lap("maps");
        let mut rows = Vec::new();
        for &run in &trial.runs {
            let tracked =
                track(self.seed, self.odometry_noise, data, &built.distances, settings, run)?;
            let errors = RunErrors::of(&tracked)?;
            rows.push(RepresentationRow {
                dataset: data.dataset.to_owned(),
                split: data.split,
                representation: trial.representation,
                parameter: trial.parameter,
                map: trial.map,
                map_seed: trial.map_seed,
                run,
                elements: built.elements,
                bytes_raw: built.bytes_raw,
                bytes_run_length: built.bytes_run_length,
                scans: errors.scans,
                weighted: errors.weighted,
                translation: errors.translation,
                heading: errors.heading,
                translation_max: errors.translation_max,
                diverged: errors.diverged,
                lost_episodes: errors.lost_episodes,
                recovered_episodes: errors.recovered_episodes,
                mean_effective_sample_size: errors.mean_effective_sample_size,
            });
        }
        watch.lap("filter");
        Ok(rows)
    }

    fn build(
        &self,
        data: &LocalizationData<'_>,
        settings: &CheckedSettings,
        trial: &RepresentationTrial,
    ) -> Result<BuiltRepresentation> {
        let max_distance = settings.values().max_distance;
        let sampled = |builder: Builder, method: Option<Refinement>| {
            let seed = trial.map_seed.unwrap_or_default();
            let size = MapSize::Percent(trial.parameter);
            let refinement = method.map(|method| RefineSettings {
                method,
                seed: Seed::new(seed).derive("refine"),
                ..RefineSettings::fkm(self.fkm())
            });
            let settings = MapSettings { initial: builder.initial(size, seed), refinement };
            BuiltRepresentation::of_points(&build_map(&data.points, &settings)?.map, max_distance)
        };
        let fkm = Some(Refinement::Fkm {});
        match trial.representation {
            Representation::Random => sampled(Builder::Random, None),
            Representation::RandomImproved => sampled(Builder::Random, fkm),
            Representation::Grid => sampled(Builder::Grid, None),
            Representation::GridImproved => sampled(Builder::Grid, fkm),
            Representation::GridBest => sampled(Builder::Grid, Some(Refinement::BEST)),
            Representation::All => {
                BuiltRepresentation::of_points(&data.all_points()?, max_distance)
            }
            Representation::Occupancy => {
                BuiltRepresentation::of_grid(data, trial.parameter, settings)
            }
            Representation::Ndt => {
                BuiltRepresentation::of_ndt(data, trial.parameter, false, settings)
            }
            Representation::NdtWide => {
                BuiltRepresentation::of_ndt(data, trial.parameter, true, settings)
            }
            Representation::Segments => {
                BuiltRepresentation::of_segments(data, trial.parameter, settings)
            }
        }
    }
}
