use mcl_core::memory::{check_room, with_room};
use mcl_core::{Point, PointMap, Seed};

use crate::refine::{RefineReport, RefineSettings, RefineStep, Refined, refine};
use crate::sampling::{sample_grid, sample_grid_of_size, sample_random};
use crate::{GridOffset, MapError, MapSize, PointSet, snap_to_data};

/// The method that chooses the initial map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialMap<const D: usize> {
    /// All points.
    All,
    /// Distinct points drawn at random without replacement (*rnd* in the paper).
    Random {
        /// Number of points.
        size: MapSize,
        /// Random seed.
        seed: Seed,
    },
    /// Grid-based sampling by cell size (*gbs* in the paper).
    GridCell {
        /// Edge length of a grid cell in metres.
        cell: f64,
        /// Position of the grid lines.
        offset: GridOffset<D>,
    },
    /// Grid-based sampling by number of points.
    GridSize {
        /// Largest number of points.
        size: MapSize,
        /// Position of the grid lines.
        offset: GridOffset<D>,
    },
}

/// Settings of [`build_map`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSettings<const D: usize> {
    /// How to choose the initial map.
    pub initial: InitialMap<D>,
    /// How to refine it, if at all ([`Refinement::Fkm`](crate::Refinement::Fkm): *+f-km* in the paper).
    pub refinement: Option<RefineSettings>,
}

/// A map with a record of how it was built.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct BuiltMap<const D: usize> {
    /// The map: a subset of the data.
    pub map: PointMap<D>,
    /// Indices of the map's points in the data.
    pub indices: Vec<usize>,
    /// Edge length of a grid cell (m), if a grid was used.
    pub cell: Option<f64>,
    /// A corner of a grid cell (m), if a grid was used.
    pub offset: Option<Point<D>>,
    /// Report of the refinement, if one was requested.
    pub refinement: Option<RefineReport>,
}

/// Builds a map: chooses the initial map and refines it if requested.
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

/// What out-of-memory errors call this memory.
const POINTS: &str = "points of a map";

/// Builds the initial map only.
///
/// # Errors
/// [`MapError`] for sizes or cells out of range, and if there is not enough memory.
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
            // In the worst case the library allocates a list of all points to draw from.
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
    /// Refines this map. `observe` is called with every accepted step.
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

    /// Snaps means fitted from this map to the data ([`snap_to_data`]); the result is a subset of the data.
    ///
    /// # Errors
    /// [`MapError::Points`] without means; [`MapError::Memory`].
    pub fn snapped(&self, data: &PointSet<D>, means: &[Point<D>]) -> Result<Self, MapError> {
        data.check_neighbors_fit()?;
        self.with(data, snap_to_data(data, means))
    }

    /// This record with other points of the data.
    fn with(&self, data: &PointSet<D>, indices: Vec<usize>) -> Result<Self, MapError> {
        let map = PointMap::new(indices.iter().map(|&index| data.points()[index]).collect())?;
        Ok(BuiltMap { map, indices, ..self.clone() })
    }
}
