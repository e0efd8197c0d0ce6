//! Runs a trial: the map, its measures, and the runs on it.

use anyhow::{Context, Result};
use serde_json::value::RawValue;

use crate::localizer::program::Programs;
use crate::measure::{MapContext, MapMeasure, Measures, OfDimension, RunContext};
use crate::recipe::map::MapRecipe;
use crate::recipe::run::{RunRecipe, WrittenRun};
use crate::table::Cells;
use crate::trial::division::{Division, StudyData};
use crate::trial::map::Dimension;
use crate::trial::maps::Maps;
use crate::trial::stopwatch::Stopwatch;
use crate::trial::tracking::{TrackedRun, Tracker, track};

/// The parts of a trial's time spent in runs; all others are spent on the map.
pub const OF_RUNS: [&str; 4] = [FIELDS, PROGRAMS, FILTER, ERRORS];
const FIELDS: &str = "distance fields";
const PROGRAMS: &str = "programs";
const FILTER: &str = "filter";
const ERRORS: &str = "errors";

/// A map and the runs on it; without runs the map alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// How the map is built.
    pub map: MapRecipe,
    /// How robots are localized on it.
    pub runs: Vec<RunRecipe>,
}

impl Trial {
    /// The identities of the rows of this trial: that of the map's row where there is no run, else one per
    /// run. They depend on everything that a row depends on, apart from the content of the data and the
    /// build.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn identities(&self, measures: &Measures) -> Result<Vec<String>> {
        let runs = self.runs.iter().map(WrittenRun::of).collect::<Result<Vec<_>>>()?;
        self.identities_of(&self.map.identity()?, runs.iter(), measures)
    }

    /// As [`Trial::identities`], from the identity of the map and the runs as JSON.
    pub(crate) fn identities_of<'a>(
        &self,
        map: &str,
        runs: impl ExactSizeIterator<Item = &'a WrittenRun>,
        measures: &Measures,
    ) -> Result<Vec<String>> {
        // A study may give one refinement several names, and rows contain the name.
        let name = &self.map.kind.name;
        let MapRecipe { draw, seed, .. } = self.map;
        let measures = measures.names();
        let of = |run: Option<&RawValue>| {
            crate::recipe::identity(&(map, name, draw, seed, &measures, run))
        };
        if runs.len() == 0 {
            return Ok(vec![of(None)?]);
        }
        runs.map(|run| of(Some(&run.json))).collect()
    }
}

/// "alternate gbs+f-km 0.25 % #3".
impl std::fmt::Display for Trial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.map.fmt(f)
    }
}

/// Runs a trial: a row per run, or one for the map without runs. `see_run` is called with each run.
///
/// # Errors
/// When the map cannot be built, a measure cannot be computed, or the filter cannot run.
pub fn run_trial<const D: usize>(
    trial: &Trial,
    maps: &Maps<'_, D>,
    data: &StudyData,
    measures: &Measures,
    programs: &Programs,
    watch: &mut Stopwatch,
    mut see_run: impl FnMut(&RunRecipe, &TrackedRun) -> Result<()>,
) -> Result<Vec<Cells>>
where
    Division<D>: Dimension<D>,
    MapMeasure: OfDimension<D>,
{
    let map = maps.get(&trial.map)?;
    let division = maps.division(&trial.map)?;
    watch.lap("map");
    let context = MapContext { recipe: &trial.map, division: &division, map: &map, data };
    let mut of_map = trial.map.cells();
    for measure in &measures.of_maps {
        of_map.extend(measure.take(&context).with_context(|| measure.name.to_owned())?);
        watch.lap(measure.name);
    }
    if trial.runs.is_empty() {
        return Ok(vec![of_map]);
    }
    let mut rows = Vec::new();
    let log = data.log()?;
    let (division, map) = Division::plane(&division, &map)
        .with_context(|| format!("{}: robots are localized in the plane only", log.name))?;
    let MapRecipe { seed, split, .. } = trial.map;
    for (run, identity) in trial.runs.iter().zip(trial.identities(measures)?) {
        let tracked = if let Some(program) = run.program() {
            let tracker = Tracker::Program(program, map, programs, &identity);
            track(run, seed, split, log, division, &tracker)?
        } else {
            let distances = map.distances(&run.filter.with_max_range(log.max_range)?)?;
            watch.lap(FIELDS);
            track(run, seed, split, log, division, &Tracker::Own(&distances))?
        };
        watch.lap(if run.program().is_some() { PROGRAMS } else { FILTER });
        let mut cells = of_map.clone();
        cells.extend(run.cells()?);
        let context = RunContext {
            recipe: run,
            tracked: &tracked,
            laser_from_robot: log.recording.robot_from_laser.inverse(),
        };
        for measure in &measures.of_runs {
            cells.extend(measure.take(&context).with_context(|| measure.name.to_owned())?);
        }
        see_run(run, &tracked)?;
        watch.lap(ERRORS);
        rows.push(cells);
    }
    Ok(rows)
}
