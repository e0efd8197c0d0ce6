//! Measures of a map, or of a run on it.
//!
//! A measure is a file here and a line in [`OF_MAPS`] or [`OF_RUNS`]. It has a value per column; a study
//! lists measures by name. A value that is not known is empty, never zero.

pub mod bytes;
pub mod consistency;
pub mod criteria;
pub mod finding;
pub mod likelihood;
pub mod particles;
pub mod program;
pub mod size;
pub mod tracking;

use anyhow::Result;
use mcl_core::Pose2;

use crate::recipe::map::MapRecipe;
use crate::recipe::run::RunRecipe;
use crate::table::{Cells, Value};
use crate::trial::division::{Division, StudyData};
use crate::trial::map::StudyMap;
use crate::trial::tracking::TrackedRun;

/// The measures of maps. The first is always taken.
pub const OF_MAPS: [&MapMeasure; 4] =
    [&size::SIZE, &likelihood::LIKELIHOOD, &criteria::CRITERIA, &bytes::BYTES];

/// The measures of runs. The first is always taken.
pub const OF_RUNS: [&RunMeasure; 4] =
    [&tracking::TRACKING, &consistency::CONSISTENCY, &finding::FINDING, &particles::PARTICLES];

/// The input of a measure of a map.
pub struct MapContext<'a, const D: usize> {
    /// How the map was built.
    pub recipe: &'a MapRecipe,
    /// The points that built it, and those held out.
    pub division: &'a Division<D>,
    /// The map.
    pub map: &'a StudyMap<D>,
    /// All of the data.
    pub data: &'a StudyData,
}

/// The input of a measure of a run.
pub struct RunContext<'a> {
    /// How the robot was localized.
    pub recipe: &'a RunRecipe,
    /// Estimates, reports of the filter, and errors, per scan.
    pub tracked: &'a TrackedRun,
    /// Pose of the robot in the laser's frame.
    pub laser_from_robot: Pose2,
}

/// Values of a measure of a map in `D` dimensions.
type OfMap<const D: usize> = fn(&MapContext<'_, D>) -> Result<Vec<Value>>;

/// A measure of maps.
pub struct MapMeasure {
    /// Its name in a study.
    pub name: &'static str,
    /// The names of its values.
    pub columns: &'static [&'static str],
    /// Computes it in the plane.
    pub planar: OfMap<2>,
    /// Computes it in space.
    pub spatial: OfMap<3>,
}

/// A measure of runs.
pub struct RunMeasure {
    /// Its name in a study.
    pub name: &'static str,
    /// The names of its values.
    pub columns: &'static [&'static str],
    /// Computes it.
    pub measure: fn(&RunContext<'_>) -> Result<Vec<Value>>,
}

/// A measure in `D` dimensions.
pub trait OfDimension<const D: usize> {
    /// Computes the measure of a map.
    ///
    /// # Errors
    /// When it cannot be computed.
    fn take(&self, context: &MapContext<'_, D>) -> Result<Cells>;
}

impl OfDimension<2> for MapMeasure {
    fn take(&self, context: &MapContext<'_, 2>) -> Result<Cells> {
        Ok(named(self.columns, (self.planar)(context)?))
    }
}

impl OfDimension<3> for MapMeasure {
    fn take(&self, context: &MapContext<'_, 3>) -> Result<Cells> {
        Ok(named(self.columns, (self.spatial)(context)?))
    }
}

impl RunMeasure {
    /// Computes the measure of a run.
    ///
    /// # Errors
    /// When it cannot be computed.
    pub fn take(&self, context: &RunContext<'_>) -> Result<Cells> {
        Ok(named(self.columns, (self.measure)(context)?))
    }
}

fn named(columns: &[&str], values: Vec<Value>) -> Cells {
    debug_assert_eq!(columns.len(), values.len());
    columns.iter().map(|&column| column.to_owned()).zip(values).collect()
}

/// The measures of a study.
#[derive(Clone, Default)]
pub struct Measures {
    /// Of maps.
    pub of_maps: Vec<&'static MapMeasure>,
    /// Of runs.
    pub of_runs: Vec<&'static RunMeasure>,
}

impl Measures {
    /// The measures with these names, and those that are always computed.
    ///
    /// # Errors
    /// The name that is not a measure, and the names of all measures.
    pub fn of(names: &[String]) -> Result<Self, String> {
        let of_maps = OF_MAPS[1..].iter().map(|measure| measure.name);
        let known: Vec<&str> = of_maps.chain(OF_RUNS[1..].iter().map(|m| m.name)).collect();
        if let Some(unknown) = names.iter().find(|name| !known.contains(&name.as_str())) {
            return Err(format!("{unknown:?} is unknown, expected {}", known.join(", ")));
        }
        let is_asked = |name: &str| names.iter().any(|asked| asked == name);
        let of_maps = OF_MAPS.into_iter().enumerate();
        let of_runs = OF_RUNS.into_iter().enumerate();
        Ok(Measures {
            of_maps: of_maps.filter(|(i, m)| *i == 0 || is_asked(m.name)).map(|(_, m)| m).collect(),
            of_runs: of_runs.filter(|(i, m)| *i == 0 || is_asked(m.name)).map(|(_, m)| m).collect(),
        })
    }

    /// Names of the measures.
    pub fn names(&self) -> Vec<&'static str> {
        let of_maps = self.of_maps.iter().map(|measure| measure.name);
        of_maps.chain(self.of_runs.iter().map(|measure| measure.name)).collect()
    }

    /// Columns of the measures.
    pub fn columns(&self) -> Vec<&'static str> {
        let of_maps = self.of_maps.iter().flat_map(|measure| measure.columns);
        of_maps.chain(self.of_runs.iter().flat_map(|measure| measure.columns)).copied().collect()
    }
}
