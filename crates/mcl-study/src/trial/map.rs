//! Builds the map of a recipe.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use mcl_core::{NdtMap, PointMap, SegmentMap};
use mcl_filter::sensor::{NdtReading, ObstacleGrid};
use mcl_filter::{CheckedSettings, MapDistances};
use mcl_maps::ndt::{NdtSettings, normal_distributions};
use mcl_maps::occupancy::{Cell, FreeSpace, OccupancyGrid, rasterize};
use mcl_maps::segments::{SegmentSettings, line_segments};
use mcl_maps::{BuiltMap, InitialMap, MapSettings, MapSize, PointSet, build_map, initial_map};

use crate::auto::Rating;
use crate::data::source::LogSource;
use crate::recipe::criterion::Criterion;
use crate::recipe::kind::MapKind;
use crate::recipe::map::{MapRecipe, Sigma, Size};
use crate::trial::division::{AnyDivision, Division, StudyData};

/// What a map consists of.
pub enum Shape<const D: usize> {
    /// Points of the data.
    Points(BuiltMap<D>),
    /// Cells.
    Grid(OccupancyGrid),
    /// Gaussians.
    Ndt {
        /// The Gaussians.
        map: NdtMap,
        /// Whether σ_hit² is added to each variance.
        wide: bool,
    },
    /// Line segments.
    Segments(SegmentMap),
}

/// A map with its size and σ, given or chosen.
pub struct StudyMap<const D: usize> {
    /// What it consists of.
    pub shape: Shape<D>,
    /// σ of the mixture (m): given, or chosen by the data.
    pub sigma: f64,
    /// The requested number of points, where the map has one.
    pub requested_points: Option<usize>,
    /// Number of values tried for a size or σ chosen by the data.
    pub tried: Option<usize>,
    /// Distances from the map by the settings that they depend on, computed on demand and cached.
    distances: Mutex<Vec<(DistanceKey, Arc<MapDistances>)>>,
}

/// The settings that distances depend on: where they are truncated, and for NDT maps σ_hit.
type DistanceKey = [u64; 2];

impl<const D: usize> StudyMap<D> {
    /// The map's points, where it consists of points.
    pub fn points(&self) -> Option<&PointMap<D>> {
        match &self.shape {
            Shape::Points(built) => Some(&built.map),
            _ => None,
        }
    }
}

impl StudyMap<2> {
    /// Distances from the map for the filter's settings.
    ///
    /// # Errors
    /// When the map cannot be indexed.
    pub fn distances(&self, settings: &CheckedSettings) -> Result<Arc<MapDistances>> {
        let settings = settings.values();
        // Gaussians have no spacing.
        let sigma_hit = settings.sigma_hit.metres(0.0);
        let sigma_hit = if let Shape::Ndt { .. } = self.shape { sigma_hit } else { 0.0 };
        let key = [settings.max_distance, sigma_hit].map(f64::to_bits);
        // While one thread builds a field, others wait for it: they would do the same work.
        let mut kept = self.distances.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, distances)) = kept.iter().find(|(other, _)| *other == key) {
            return Ok(distances.clone());
        }
        let max_distance = settings.max_distance;
        let built = Arc::new(match &self.shape {
            Shape::Points(built) => MapDistances::grid(&built.map, max_distance)?,
            Shape::Grid(grid) => MapDistances::cells(&obstacle_grid(grid), max_distance)?,
            Shape::Ndt { map, wide } => {
                let endpoint_std = if *wide { sigma_hit } else { 0.0 };
                MapDistances::ndt(map, NdtReading { sigma_hit, endpoint_std }, max_distance)?
            }
            Shape::Segments(map) => MapDistances::segments(map, max_distance)?,
        });
        kept.push((key, built.clone()));
        Ok(built)
    }
}

/// The part of a grid that the filter uses.
pub fn obstacle_grid(grid: &OccupancyGrid) -> ObstacleGrid {
    let are = |kind: Cell| grid.cells().iter().map(|&cell| cell == kind).collect();
    ObstacleGrid {
        width: grid.width(),
        resolution: grid.resolution(),
        map_from_grid: grid.map_from_grid(),
        occupied: are(Cell::Occupied),
        free: are(Cell::Free),
    }
}

/// Code that depends on the dimension of the data: all kinds of maps in the plane, where robots are
/// localized; maps with a given number of points in space.
pub trait Dimension<const D: usize>: Sized {
    /// The division in this dimension.
    ///
    /// # Errors
    /// When the data has another dimension.
    fn of(divided: &AnyDivision) -> Result<&Arc<Self>>;

    /// The map of a recipe that does not consist of points.
    ///
    /// # Errors
    /// When it cannot be built of this data.
    fn surfaces(recipe: &MapRecipe, division: &Self, data: &StudyData) -> Result<Shape<D>>;

    /// The size and σ of a recipe, as given or chosen by the data.
    ///
    /// # Errors
    /// When no value can be chosen.
    fn choose(recipe: &MapRecipe, division: &Self, data: &StudyData) -> Result<Choice>;

    /// Division and map, if they are in the plane.
    fn plane<'a>(
        division: &'a Self,
        map: &'a StudyMap<D>,
    ) -> Option<(&'a Division<2>, &'a StudyMap<2>)>;
}

/// A size and σ, as given or chosen by the data.
pub struct Choice {
    size: Option<Size>,
    /// In metres.
    sigma: f64,
    tried: Option<usize>,
}

impl Dimension<2> for Division<2> {
    fn of(divided: &AnyDivision) -> Result<&Arc<Self>> {
        divided.planar()
    }

    fn surfaces(recipe: &MapRecipe, division: &Self, data: &StudyData) -> Result<Shape<2>> {
        let Some(Size::Resolution(resolution)) = recipe.size else {
            bail!("{recipe}: expected a resolution in metres");
        };
        Ok(match recipe.kind.kind {
            MapKind::Occupancy => Shape::Grid(occupancy(division, data.log()?, resolution)?),
            MapKind::Ndt { wide } => {
                let points = division.building.points();
                let map = normal_distributions(points, &NdtSettings::of_cell(resolution))?;
                Shape::Ndt { map, wide }
            }
            MapKind::Segments => {
                let log = data.log()?;
                let settings = SegmentSettings::of_tolerance(resolution);
                let scans = division.building_scans(log);
                Shape::Segments(line_segments(&scans, log.max_range, &settings)?)
            }
            MapKind::All | MapKind::Sampled { .. } => {
                bail!("{recipe}: a map of points has no resolution")
            }
        })
    }

    fn choose(recipe: &MapRecipe, division: &Self, data: &StudyData) -> Result<Choice> {
        if let Some(given) = given(recipe) {
            return Ok(given);
        }
        let by = match (recipe.size, recipe.sigma) {
            (Some(Size::Chosen(by)), Sigma::Metres(_)) => by,
            (Some(Size::Percent(_) | Size::Points(_)), Sigma::Chosen(by)) => by,
            _ => bail!(
                "{recipe}: the data chooses the size or σ of a map of points, not both at once"
            ),
        };
        let folds = match by {
            Criterion::HeldOut => data.folds()?,
            _ => Vec::new(),
        };
        let build = |data: &PointSet<2>, size, sigma| sample(recipe, data, size, sigma);
        let rating = Rating { data: &division.building, folds: &folds, build: &build };
        let (chosen, size, sigma) = match recipe.sigma {
            Sigma::Chosen(_) => {
                let chosen = rating.choose_sigma(by, map_size(recipe.size), |_| {})?;
                let sigma = chosen.value;
                (chosen, recipe.size, sigma)
            }
            Sigma::Metres(sigma) => {
                let chosen = rating.choose_size(by, sigma, |_| {})?;
                let size = Some(Size::Points(chosen.value as usize));
                (chosen, size, sigma)
            }
        };
        Ok(Choice { size, sigma, tried: Some(chosen.tried.len()) })
    }

    fn plane<'a>(
        division: &'a Self,
        map: &'a StudyMap<2>,
    ) -> Option<(&'a Division<2>, &'a StudyMap<2>)> {
        Some((division, map))
    }
}

impl Dimension<3> for Division<3> {
    fn of(divided: &AnyDivision) -> Result<&Arc<Self>> {
        match divided {
            AnyDivision::Spatial(division) => Ok(division),
            AnyDivision::Planar(_) => bail!("the points lie in the plane, not in space"),
        }
    }

    fn surfaces(recipe: &MapRecipe, _: &Self, _: &StudyData) -> Result<Shape<3>> {
        bail!("{recipe}: maps in space consist of points")
    }

    fn choose(recipe: &MapRecipe, _: &Self, _: &StudyData) -> Result<Choice> {
        given(recipe).with_context(|| format!("{recipe}: in space, size and σ are given"))
    }

    fn plane<'a>(_: &'a Self, _: &'a StudyMap<3>) -> Option<(&'a Division<2>, &'a StudyMap<2>)> {
        None
    }
}

/// Size and σ, where neither is chosen by the data.
fn given(recipe: &MapRecipe) -> Option<Choice> {
    match (recipe.size, recipe.sigma) {
        (Some(Size::Chosen(_)), _) | (_, Sigma::Chosen(_)) => None,
        (size, Sigma::Metres(sigma)) => Some(Choice { size, sigma, tried: None }),
    }
}

/// The size in the terms of map building; `None` where it is not a number of points.
fn map_size(size: Option<Size>) -> Option<MapSize> {
    match size {
        Some(Size::Percent(percent)) => Some(MapSize::Percent(percent)),
        Some(Size::Points(points)) => Some(MapSize::Points(points)),
        _ => None,
    }
}

/// The map that the recipe of a sampled one gives for other points, or for another size or σ (m). Without a
/// size it has all points.
///
/// # Errors
/// When it cannot be built.
pub fn sample<const D: usize>(
    recipe: &MapRecipe,
    data: &PointSet<D>,
    size: Option<MapSize>,
    sigma: f64,
) -> Result<PointMap<D>> {
    let initial = size.map_or(InitialMap::All, |size| recipe.initial_map(size));
    let settings = MapSettings { initial, refinement: recipe.refinement(sigma) };
    Ok(build_map(data, &settings)?.map)
}

/// The cells that hold a point are occupied; those crossed by beams and holding none are free.
fn occupancy(division: &Division<2>, log: &LogSource, resolution: f64) -> Result<OccupancyGrid> {
    let recording = division.building_scans(log);
    let points = initial_map(&division.building, &InitialMap::All)?.map;
    let free_space = FreeSpace { recording: &recording, max_range: log.max_range };
    Ok(rasterize(&points, resolution, Some(free_space))?)
}

/// Builds the map of a recipe. `initial` returns the map that a refinement starts from, which may be shared.
/// What is chosen by the data is built as if it had been given.
///
/// # Errors
/// When it cannot be built of this data.
pub fn build<const D: usize>(
    recipe: &MapRecipe,
    division: &Division<D>,
    data: &StudyData,
    initial: impl FnOnce(&MapRecipe) -> Result<Arc<StudyMap<D>>>,
) -> Result<StudyMap<D>>
where
    Division<D>: Dimension<D>,
{
    let Choice { size, sigma, tried } = Division::choose(recipe, division, data)?;
    let recipe = MapRecipe { size, sigma: Sigma::Metres(sigma), ..recipe.clone() };
    let points = &division.building;
    let size = map_size(size);
    let requested_points = match recipe.kind.kind {
        MapKind::All => Some(points.len()),
        _ => size.map(|size| size.resolve(points.len())).transpose()?,
    };
    let shape = match &recipe.kind.kind {
        MapKind::All => Shape::Points(initial_map(points, &InitialMap::All)?),
        MapKind::Sampled { .. } => Shape::Points(match recipe.refinement(sigma) {
            None => {
                let size = size.with_context(|| format!("{recipe}: expected a size"))?;
                initial_map(points, &recipe.initial_map(size))?
            }
            Some(settings) => match &initial(&recipe.initial())?.shape {
                Shape::Points(before) => before.refined(points, &settings, |_| {})?,
                _ => bail!("{recipe}: a refinement starts from points"),
            },
        }),
        _ => Division::surfaces(&recipe, division, data)?,
    };
    let distances = Mutex::default();
    Ok(StudyMap { shape, sigma, requested_points, tried, distances })
}
