use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::{PointMap, Seed};
use mcl_maps::files::{Encoding, read_map, write_map};
use mcl_maps::{
    BuiltMap, GridOffset, InitialMap, MapSize, PointSet, fuzzy_k_means, initial_map,
    mixture_log_likelihood,
};
use serde::{Deserialize, Serialize};

use super::MAPS;
use crate::experiment::{LikelihoodExperiment, write_rows};

/// About the maps beside it.
pub(super) const INDEX: &str = "maps.csv";
/// The whole data set, figures 1 and 3.
pub(super) const ALL: &str = "all";
/// Grid-based map of figure 1, and what fuzzy k-means makes of it.
pub(super) const OVERVIEW: &str = "overview-gbs";
pub(super) const OVERVIEW_IMPROVED: &str = "overview-gbs-fkm";
/// Maps of figure 2.
pub(super) const COMPARISON_RANDOM: &str = "comparison-rnd";
pub(super) const COMPARISON_GRID: &str = "comparison-gbs";

const NAMES: [&str; 5] = [ALL, OVERVIEW, OVERVIEW_IMPROVED, COMPARISON_RANDOM, COMPARISON_GRID];

/// A map that a figure shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct MapRow {
    /// Its file is `<name>.ply`.
    pub name: String,
    pub points: usize,
    /// Edge length of a grid cell in metres.
    pub cell_m: Option<f64>,
    /// Seed of a random map.
    pub seed: Option<u64>,
    /// Nats per point.
    pub log_likelihood: Option<f64>,
}

/// The maps of figure 2: random and grid-based, of the same requested size.
pub(crate) struct ComparisonMaps {
    pub random: PointMap<2>,
    pub grid: PointMap<2>,
}

impl ComparisonMaps {
    /// Of a result folder; `None` when not both maps are there.
    pub(crate) fn read(folder: &Path) -> Result<Option<Self>> {
        let [random, grid] = [COMPARISON_RANDOM, COMPARISON_GRID]
            .map(|name| folder.join(MAPS).join(file_name(name)));
        if !(random.exists() && grid.exists()) {
            return Ok(None);
        }
        Ok(Some(ComparisonMaps { random: read_map(random)?, grid: read_map(grid)? }))
    }
}

/// The file of a map of this name.
pub(super) fn file_name(name: &str) -> String {
    format!("{name}.ply")
}

/// Whether all maps are there. The index is written last.
pub(super) fn complete(folder: &Path) -> bool {
    folder.join(INDEX).exists() && NAMES.iter().all(|name| folder.join(file_name(name)).exists())
}

/// Builds and saves the maps that figures show. Grids lie at the origin, as in the paper.
pub(super) fn build<const D: usize>(
    experiment: &LikelihoodExperiment,
    dataset: &str,
    data: &PointSet<D>,
    folder: &Path,
) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut rows = Vec::new();
    let mut save = |name: &str, map: &PointMap<D>, cell_m, seed, scored: bool| -> Result<()> {
        write_map(folder.join(file_name(name)), map, Encoding::Binary)?;
        let log_likelihood = match scored {
            true => Some(mixture_log_likelihood(data, map, experiment.sigma)?.per_point),
            false => None,
        };
        let name = name.to_owned();
        rows.push(MapRow { name, points: map.len(), cell_m, seed, log_likelihood });
        Ok(())
    };
    let grid = |percent| InitialMap::GridSize {
        size: MapSize::Percent(percent),
        offset: GridOffset::ORIGIN,
    };
    save(ALL, &PointMap::new(data.points().to_vec())?, None, None, false)?;

    let overview: BuiltMap<D> = initial_map(data, &grid(experiment.figures.overview))?;
    save(OVERVIEW, &overview.map, overview.cell, None, true)?;
    let (means, _) = fuzzy_k_means(data, &overview.map, &experiment.fkm(), |_, _| {})?;
    save(OVERVIEW_IMPROVED, &overview.snapped(data, &means)?.map, overview.cell, None, true)?;

    let size = MapSize::Percent(experiment.figures.comparison);
    let seed = Seed::new(experiment.seed).derive("figure").derive(dataset).number();
    let random = initial_map(data, &InitialMap::Random { size, seed: Seed::new(seed) })?;
    save(COMPARISON_RANDOM, &random.map, None, Some(seed), true)?;
    let grid = initial_map(data, &grid(experiment.figures.comparison))?;
    save(COMPARISON_GRID, &grid.map, grid.cell, None, true)?;
    write_rows(&folder.join(INDEX), &rows)
}
