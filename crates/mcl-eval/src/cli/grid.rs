//! Grid maps written by commands.

use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::PointMap;
use mcl_maps::files::is_grid;
use mcl_maps::occupancy::{Cell, DEFAULT_RESOLUTION, FreeSpace, OccupancyGrid, rasterize};
use serde::Serialize;

use super::output::refuse;
use mcl_core::text::thousands;
use mcl_study::data::source::LogSource;

/// The reported figures of a grid.
#[derive(Debug, Serialize)]
pub struct GridFigures {
    resolution_m: f64,
    width: usize,
    height: usize,
    occupied: usize,
    free: usize,
    unknown: usize,
}

impl GridFigures {
    pub fn of(grid: &OccupancyGrid) -> Self {
        GridFigures {
            resolution_m: grid.resolution(),
            width: grid.width(),
            height: grid.height(),
            occupied: grid.count(Cell::Occupied),
            free: grid.count(Cell::Free),
            unknown: grid.count(Cell::Unknown),
        }
    }

    pub fn text(&self) -> String {
        format!(
            "grid: {} × {} cells of {} m: {} occupied, {} free, {} unknown",
            self.width,
            self.height,
            self.resolution_m,
            thousands(self.occupied),
            thousands(self.free),
            thousands(self.unknown)
        )
    }
}

/// Usage errors: options of grid maps, when the output is not a grid.
pub fn check_options(output: &Path, resolution: Option<f64>, log: Option<&str>) -> Result<()> {
    if !is_grid(output) {
        for (option, is_given) in [("--resolution", resolution.is_some()), ("--log", log.is_some())]
        {
            if is_given {
                return refuse(&format!("{option} applies only to a grid map as output (.yaml)"));
            }
        }
    }
    Ok(())
}

/// The grid of a map, with the free space crossed by the beams of a log.
pub fn grid_of(
    map: &PointMap<2>,
    resolution: Option<f64>,
    source: Option<&LogSource>,
) -> Result<OccupancyGrid> {
    let resolution = resolution.unwrap_or(DEFAULT_RESOLUTION);
    let free_space = source
        .map(|source| FreeSpace { recording: &source.recording, max_range: source.max_range });
    rasterize(map, resolution, free_space)
        .with_context(|| source.map_or("the map".to_owned(), |source| source.name.clone()))
}
