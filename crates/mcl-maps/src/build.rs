use mcl_core::memory::{check_room, with_room};
use mcl_core::{Point, PointMap, Seed};

use crate::refine::{RefineReport, RefineSettings, RefineStep, Refined, refine};
use crate::sampling::{sample_grid, sample_grid_of_size, sample_random};
use crate::{GridOffset, MapError, MapSize, PointSet, snap_to_data};

/// How to choose the initial map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialMap<const D: usize> {
    /// Every point.
    All,
    /// Distinct points at random, without replacement (*rnd* in the paper).
    Random {
        /// Number of points.
        size: MapSize,
        /// Seed of the draw.
        seed: Seed,
    },
    /// Grid-based sampling by cell size (*gbs* in the paper).
    GridCell {
        /// Edge length of a cell in metres.
        cell: f64,
        /// Where the grid's lines lie.
        offset: GridOffset<D>,
    },
    /// Grid-based sampling by number of points.
    GridSize {
        /// Number of points, an upper bound.
        size: MapSize,
        /// Where the grid's lines lie.
        offset: GridOffset<D>,
    },
}

/// How to build a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSettings<const D: usize> {
    /// The initial map.
    pub initial: InitialMap<D>,
    /// Improve it ([`Refinement::Fkm`](crate::Refinement::Fkm): *+f-km* in the paper).
    pub refinement: Option<RefineSettings>,
}

/// A map with how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct BuiltMap<const D: usize> {
    /// The map: a subset of the data.
    pub map: PointMap<D>,
    /// Indices of the map's points in the data.
    pub indices: Vec<usize>,
    /// Edge length of a grid cell (m), where a grid was used.
    pub cell: Option<f64>,
    /// A corner of a grid cell (m), where a grid was used.
    pub offset: Option<Point<D>>,
    /// Report of the refinement, where one was asked for.
    pub refinement: Option<RefineReport>,
}

/// Builds a map: the initial one, refined when asked.
///
/// # Errors
/// [`MapError`] for sizes, cells or settings out of range.
pub fn build_map<const D: usize>(
    data: &PointSet<D>,
    settings: &MapSettings<D>,
) -> Result<BuiltMap<D>, MapError> {
    let initial = initial_map(data, &settings.initial)?;
    let Some(refinement) = &settings.refinement else { return Ok(initial) };
    initial.refined(data, refinement, |_| {})
}

/// What memory is asked for as.
const POINTS: &str = "points of a map";

/// The initial map alone.
///
/// # Errors
/// [`MapError`] for sizes or cells out of range, and when there is not enough memory.
pub fn initial_map<const D: usize>(
    data: &PointSet<D>,
    initial: &InitialMap<D>,
) -> Result<BuiltMap<D>, MapError> {
    let points = data.points();
    let (indices, grid) = match *initial {
        InitialMap::All => {
            let mut indices = with_room(points.len(), POINTS)?;
            indices.extend(0..points.len());
            (indices, None)
        }
        InitialMap::Random { size, seed } => {
            // The library keeps a list of all points to draw from, at worst.
            check_room(points.len(), 2 * size_of::<usize>(), POINTS)?;
            (sample_random(points.len(), size.resolve(points.len())?, seed), None)
        }
        InitialMap::GridCell { cell, offset } => {
            let sample = sample_grid(points, cell, offset)?;
            (sample.indices, Some((sample.cell, sample.offset)))
        }
        InitialMap::GridSize { size, offset } => {
            let sample = sample_grid_of_size(points, size.resolve(points.len())?, offset)?;
            (sample.indices, Some((sample.cell, sample.offset)))
        }
    };
    let mut chosen = with_room(indices.len(), POINTS)?;
    chosen.extend(indices.iter().map(|&index| points[index]));
    let map = PointMap::new(chosen)?;
    let (cell, offset) = grid.unzip();
    Ok(BuiltMap { map, indices, cell, offset, refinement: None })
}

impl<const D: usize> BuiltMap<D> {
    /// The map that a refinement makes of this one. `observe` is called with every accepted step.
    ///
    /// # Errors
    /// [`MapError::Setting`] for settings out of range.
    pub fn refined(
        &self,
        data: &PointSet<D>,
        settings: &RefineSettings,
        observe: impl FnMut(&RefineStep),
    ) -> Result<Self, MapError> {
        let Refined { indices, report, .. } = refine(data, &self.map, settings, observe)?;
        Ok(BuiltMap { refinement: Some(report), ..self.with(data, indices)? })
    }

    /// The map that means fitted from this one become as a subset of the data ([`snap_to_data`]).
    ///
    /// # Errors
    /// [`MapError::Points`] when there is no mean; [`MapError::Memory`].
    pub fn snapped(&self, data: &PointSet<D>, means: &[Point<D>]) -> Result<Self, MapError> {
        data.check_neighbors_fit()?;
        self.with(data, snap_to_data(data, means))
    }

    /// The same with other points of the data.
    fn with(&self, data: &PointSet<D>, indices: Vec<usize>) -> Result<Self, MapError> {
        let map = PointMap::new(indices.iter().map(|&index| data.points()[index]).collect())?;
        Ok(BuiltMap { map, indices, ..self.clone() })
    }
}
