use std::panic::resume_unwind;
use std::sync::Arc;

use anyhow::{Result, bail};
use mcl_core::{Point, PointMap, Seed};
use mcl_maps::choice::Tried;
use mcl_maps::files::{Encoding, is_grid, write_grid, write_map};
use mcl_maps::occupancy::OccupancyGrid;
use mcl_maps::refine::{RefineReport, RefineStep, Refined, refine};
use mcl_maps::{
    BuiltMap, FkmSettings, GridOffset, InitialMap, MapSettings, MapSize, PointSet, RefineSettings,
    Refinement, build_map, initial_map, mixture_log_likelihood,
};
use serde::Serialize;

use super::Outcome;
use super::args::{Auto, Global, Init, MapArgs, Offset, Refine};
use super::grid::{GridFigures, check_options, grid_of};
use super::output::{input_files, print, reference_of_data, refuse, report_data_losses};
use crate::progress::{self, tell};
use mcl_core::text::thousands;
use mcl_study::auto::{DataChoice, Rating, SIGMA_RANGE};
use mcl_study::data::cloud_source::Points;
use mcl_study::data::source::DataSource;
use mcl_study::recipe::criterion::Criterion;
use mcl_study::recipe::map::random_offset;
use mcl_study::trial::division::{Division, StudyData};

/// The report of a map.
#[derive(Serialize)]
pub struct MapReport {
    dimensions: usize,
    points: usize,
    map_points: usize,
    cell_m: Option<f64>,
    /// A corner of a grid cell; null unless the builder is grid.
    offset_m: Option<Vec<f64>>,
    iterations: usize,
    /// Null without a refinement.
    converged: Option<bool>,
    log_likelihood_trace: Vec<f64>,
    /// The same entries, with the preceding step and the time it took.
    steps: Vec<RefineStep>,
    log_likelihood_per_point: Option<f64>,
    /// Figures of a grid map; null for a point map.
    grid: Option<GridFigures>,
    sigma_m: f64,
    /// The reference that places the points of a log, and whose poses it has.
    reference: Option<String>,
    /// How an automatic size was chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    auto_size: Option<DataChoice>,
    /// How an automatic σ was chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    auto_sigma: Option<DataChoice>,
}

/// The size and σ of a map, given or chosen.
#[derive(Clone, Copy)]
struct SizeAndSigma {
    size: Option<MapSize>,
    sigma: f64,
}

pub fn run(args: &MapArgs, global: &Global) -> Result<Outcome> {
    check_arguments(args)?;
    check_options(&args.output, args.resolution, None)?;
    let name = &args.data.log.log;
    mcl_maps::files::check_writable(&args.output, &input_files(args.data.log.named()))?;
    let data = StudyData::new(DataSource::open(name, &args.data.options(), false)?);
    let source = &data.source;
    let watch = Watch { quiet: global.quiet, end: &|| Ok(()) };
    let mut built = match source.points()? {
        Points::Planar(points) => {
            let log = source.log().ok();
            let grid = |map: &PointMap<2>| {
                if !is_grid(&args.output) {
                    return Ok(None);
                }
                let grid = grid_of(map, args.resolution, log)?;
                let cells = PointMap::new(grid.occupied_points())?;
                Ok(Some((grid, cells)))
            };
            let folds = || data.folds();
            let folds = log.map(|_| &folds as Folds<'_, 2>);
            written(build(points, folds, grid, args, &watch)?, args)?
        }
        Points::Spatial(points) => {
            if is_grid(&args.output) {
                bail!(
                    "{}: a grid map is planar, and {name} has three dimensions; expected .ply, .pcd or \
                     .csv, or --dimensions 2 to drop the heights",
                    args.output.display()
                );
            }
            written(build(points, None, |_| Ok(None), args, &watch)?, args)?
        }
    };
    built.reference = reference_of_data(source);
    print(args.json, &built, |built| text(built, args))?;
    Ok(report_data_losses(name, source))
}

/// The position of the lines of a grid.
fn offset<const D: usize>(args: &MapArgs) -> Result<GridOffset<D>> {
    let given: &[f64] = match &args.offset {
        None => return Ok(GridOffset::ORIGIN),
        Some(Offset::Random) => return Ok(random_offset(args.seed)),
        Some(Offset::Planar(offset)) => offset,
        Some(Offset::Spatial(offset)) => offset,
    };
    match given.try_into() {
        Ok(offset) => Ok(GridOffset::Metres(offset)),
        Err(_) if D == 2 => refuse("--offset has three numbers, expected two (X,Y)"),
        Err(_) => refuse("--offset has two numbers, expected three (X,Y,Z) in three dimensions"),
    }
}

/// Writes a map that was built, and returns its report.
fn written<const D: usize>(
    (map, grid, built): (PointMap<D>, Option<OccupancyGrid>, MapReport),
    args: &MapArgs,
) -> Result<MapReport> {
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::Binary };
    match &grid {
        Some(grid) => write_grid(&args.output, grid)?,
        None => write_map(&args.output, &map, encoding)?,
    }
    Ok(built)
}

/// Divisions of the scans that the points are from, computed on demand.
pub type Folds<'a, const D: usize> = &'a dyn Fn() -> Result<Vec<Arc<Division<D>>>>;

/// How the building of a map is observed.
pub struct Watch<'a> {
    /// No progress bars.
    pub quiet: bool,
    /// Ends the work by returning an error, or inside a refinement by unwinding with it; called at every step
    /// of a refinement and for every map that is tried.
    pub end: &'a (dyn Fn() -> Result<()> + Sync),
}

/// Builds the map of points for the arguments; `grid` converts it to the grid that replaces its points, with
/// the points of that grid. The last value returned is the report.
///
/// # Errors
/// Usage errors, and points or settings from which no map can be built.
pub fn build<const D: usize>(
    points: Vec<Point<D>>,
    folds: Option<Folds<'_, D>>,
    grid: impl FnOnce(&PointMap<D>) -> Result<Option<(OccupancyGrid, PointMap<D>)>>,
    args: &MapArgs,
    watch: &Watch<'_>,
) -> Result<(PointMap<D>, Option<OccupancyGrid>, MapReport)> {
    let data = PointSet::new(points)?;
    let offset = offset(args)?;
    let (wanted, choices) = choose(&data, folds, offset, args, watch)?;
    let mut fitted = fit(&data, offset, wanted, args, watch)?;
    let grid = grid(&fitted.map)?.map(|(grid, cells)| {
        // The content of the file, and all that is reported of it: points that share a cell are one.
        fitted.map = cells;
        grid
    });
    let figures = grid.as_ref().map(GridFigures::of);
    let built = fitted.built(&data, figures, wanted, choices, args)?;
    Ok((fitted.map, grid, built))
}

/// A map with the one it came from.
struct Fitted<const D: usize> {
    initial: BuiltMap<D>,
    map: PointMap<D>,
    report: Option<RefineReport>,
}

/// The size and σ, chosen by the data where the arguments say so: points without scans have no folds.
fn choose<const D: usize>(
    data: &PointSet<D>,
    folds: Option<Folds<'_, D>>,
    offset: GridOffset<D>,
    args: &MapArgs,
    watch: &Watch<'_>,
) -> Result<(SizeAndSigma, [Option<DataChoice>; 2])> {
    let by = args.auto_by;
    let is_auto = matches!(args.size, Some(Auto::Auto)) || matches!(args.sigma, Auto::Auto);
    let folds = match (is_auto && by == Criterion::HeldOut, folds) {
        (false, _) => Vec::new(),
        (true, Some(folds)) => folds()?,
        (true, None) => bail!(
            "--auto-by held-out leaves out scans, and a point cloud has none; expected bic, mdl or likelihood"
        ),
    };
    let build = |data: &PointSet<D>, size, sigma| {
        (watch.end)()?;
        build_at(data, offset, size, sigma, args)
    };
    let rating = Rating { data, folds: &folds, build: &build };
    match (args.size, args.sigma) {
        (Some(Auto::Auto), _) => {
            let sigma = given_sigma(args)?;
            let bar = progress::spinner("size", watch.quiet);
            let chosen = rating.choose_size(by, sigma, |Tried { value, score }| {
                bar.set_message(format!("{value} points: {score:.4}"));
            });
            bar.finish_and_clear();
            let chosen = chosen?;
            let size = Some(MapSize::Points(chosen.value as usize));
            Ok((SizeAndSigma { size, sigma }, [Some(chosen), None]))
        }
        (size, Auto::Auto) => {
            let size = given_size(size);
            let bar = progress::spinner("sigma", watch.quiet);
            let chosen = rating.choose_sigma(by, size, |Tried { value, score }| {
                bar.set_message(format!("{value:.4} m: {:.4} nats/point", -score));
            });
            bar.finish_and_clear();
            let chosen = chosen?;
            if SIGMA_RANGE.contains(&chosen.value) {
                tell!(
                    "warning: sigma is at a limit of the values tried, {} to {} m",
                    SIGMA_RANGE[0],
                    SIGMA_RANGE[1]
                );
            }
            Ok((SizeAndSigma { size, sigma: chosen.value }, [None, Some(chosen)]))
        }
        (size, Auto::Given(sigma)) => {
            Ok((SizeAndSigma { size: given_size(size), sigma }, [None, None]))
        }
    }
}

fn given_size(size: Option<Auto<MapSize>>) -> Option<MapSize> {
    match size {
        Some(Auto::Given(size)) => Some(size),
        Some(Auto::Auto) | None => None,
    }
}

/// σ, where it is not chosen by the data.
fn given_sigma(args: &MapArgs) -> Result<f64> {
    match args.sigma {
        Auto::Given(sigma) => Ok(sigma),
        Auto::Auto => refuse("--size auto and --sigma auto do not go together: give one of them"),
    }
}

/// The map for the arguments, with another size and σ.
fn build_at<const D: usize>(
    data: &PointSet<D>,
    offset: GridOffset<D>,
    size: Option<MapSize>,
    sigma: f64,
    args: &MapArgs,
) -> Result<PointMap<D>> {
    let wanted = SizeAndSigma { size, sigma };
    let initial = initial_settings(args, offset, wanted)?;
    let refinement = refine_settings(args, wanted)?;
    Ok(build_map(data, &MapSettings { initial, refinement })?.map)
}

fn fit<const D: usize>(
    data: &PointSet<D>,
    offset: GridOffset<D>,
    wanted: SizeAndSigma,
    args: &MapArgs,
    watch: &Watch<'_>,
) -> Result<Fitted<D>> {
    let initial = initial_map(data, &initial_settings(args, offset, wanted)?)?;
    let (map, report) = match refine_settings(args, wanted)? {
        None => (initial.map.clone(), None),
        Some(settings) => {
            let found = refined(&settings, data, &initial.map, watch)?;
            let kept = || found.indices.iter().map(|&index| data.points()[index]).collect();
            let points = if args.no_snap { found.means } else { kept() };
            (PointMap::new(points)?, Some(found.report))
        }
    };
    Ok(Fitted { initial, map, report })
}

impl<const D: usize> Fitted<D> {
    /// The report of the map.
    fn built(
        &self,
        data: &PointSet<D>,
        grid: Option<GridFigures>,
        wanted: SizeAndSigma,
        [auto_size, auto_sigma]: [Option<DataChoice>; 2],
        args: &MapArgs,
    ) -> Result<MapReport> {
        let Fitted { initial, map, report } = self;
        // Likelihoods cost more than the sampling itself, and are computed only where they are shown.
        let is_looked_at = args.json || report.is_some();
        let likelihood = |map: &PointMap<D>| match is_looked_at {
            true => {
                mixture_log_likelihood(data, map, wanted.sigma).map(|found| Some(found.per_point))
            }
            false => Ok(None),
        };
        let log_likelihood_per_point = likelihood(map)?;
        Ok(MapReport {
            dimensions: D,
            points: data.len(),
            map_points: map.len(),
            cell_m: initial.cell,
            offset_m: initial.offset.map(|offset| offset.to_vec()),
            iterations: report.as_ref().map_or(0, |report| report.evaluations - 1),
            converged: report.as_ref().map(|report| report.converged),
            log_likelihood_trace: match report {
                Some(report) => report.steps.iter().map(|step| step.log_likelihood).collect(),
                // Without a refinement, the point map written is the initial one.
                None if grid.is_none() => log_likelihood_per_point.into_iter().collect(),
                None => likelihood(&initial.map)?.into_iter().collect(),
            },
            steps: report.as_ref().map_or(Vec::new(), |report| report.steps.clone()),
            log_likelihood_per_point,
            grid,
            sigma_m: wanted.sigma,
            reference: None,
            auto_size,
            auto_sigma,
        })
    }
}

/// Usage errors: invalid combinations of `--init` and its companions.
pub fn check_arguments(args: &MapArgs) -> Result<()> {
    // Checked before the log is read.
    let wanted = match (args.size, args.sigma) {
        (Some(Auto::Auto), _) => {
            if !args.auto_by.decides_size() {
                return refuse(
                    "--auto-by likelihood does not go with --size auto: more points are always likelier",
                );
            }
            SizeAndSigma { size: Some(MapSize::Points(1)), sigma: given_sigma(args)? }
        }
        (size, Auto::Auto) => {
            if !args.auto_by.decides_sigma() {
                return refuse("--sigma auto goes with --auto-by held-out or likelihood");
            }
            SizeAndSigma { size: given_size(size), sigma: 1.0 }
        }
        (size, Auto::Given(sigma)) => SizeAndSigma { size: given_size(size), sigma },
    };
    refine_settings(args, wanted)?;
    if args.init != Init::Grid && (args.cell.is_some() || args.offset.is_some()) {
        return refuse("--cell and --offset go with --init grid");
    }
    initial_settings::<2>(args, GridOffset::ORIGIN, wanted)?;
    Ok(())
}

/// The settings for `--init` and its companions.
fn initial_settings<const D: usize>(
    args: &MapArgs,
    offset: GridOffset<D>,
    wanted: SizeAndSigma,
) -> Result<InitialMap<D>> {
    Ok(match (args.init, wanted.size, args.cell) {
        (Init::All, Some(_), _) => {
            return refuse("--init all takes every point: --size does not go with it");
        }
        (Init::All, None, _) => InitialMap::All,
        (Init::Random, Some(size), _) => InitialMap::Random { size, seed: Seed::new(args.seed) },
        (Init::Random, None, _) => return refuse("--init random needs --size"),
        (Init::Grid, _, Some(cell)) => InitialMap::GridCell { cell, offset },
        (Init::Grid, Some(size), None) => InitialMap::GridSize { size, offset },
        (Init::Grid, None, None) => return refuse("--init grid needs --size or --cell"),
    })
}

/// The settings for `--refine` and its companions; invalid combinations are usage errors.
fn refine_settings(args: &MapArgs, wanted: SizeAndSigma) -> Result<Option<RefineSettings>> {
    let mut method = args.refine.map(refinement);
    match (&mut method, args.rounds, args.restarts) {
        (
            Some(Refinement::SplitMerge { rounds } | Refinement::Best { rounds, .. }),
            Some(wanted),
            None,
        ) => *rounds = wanted,
        (Some(Refinement::Restarts { restarts }), None, Some(wanted)) => *restarts = wanted,
        (_, Some(_), _) => return refuse("--rounds goes with --refine split-merge or best"),
        (_, _, Some(_)) => return refuse("--restarts goes with --refine restarts"),
        (_, None, None) => {}
    }
    if args.no_snap && matches!(args.refine, Some(Refine::Exchange | Refine::Best)) {
        return refuse(
            "--no-snap does not go with --refine exchange or best, which end with data points",
        );
    }
    Ok(method.map(|method| RefineSettings {
        method,
        fkm: FkmSettings {
            sigma: wanted.sigma,
            tolerance: args.tolerance,
            max_iterations: args.max_iterations,
        },
        seed: Seed::new(args.seed),
        budget_s: args.refine_seconds,
    }))
}

fn refinement(refine: Refine) -> Refinement {
    match refine {
        Refine::Fkm => Refinement::Fkm {},
        Refine::FkmAccelerated => Refinement::FkmAccelerated {},
        Refine::Restarts => Refinement::RESTARTS,
        Refine::Annealed => Refinement::ANNEALED,
        Refine::SplitMerge => Refinement::SPLIT_MERGE,
        Refine::Exchange => Refinement::EXCHANGE,
        Refine::Best => Refinement::BEST,
    }
}

/// A refinement with a progress line.
fn refined<const D: usize>(
    settings: &RefineSettings,
    data: &PointSet<D>,
    initial: &PointMap<D>,
    watch: &Watch<'_>,
) -> Result<Refined<D>> {
    let bar = progress::spinner(settings.method.name(), watch.quiet);
    let observe = |step: &RefineStep| {
        // A refinement has no other way out. The panic hook is not called, so nothing is reported as for a
        // panic.
        if let Err(ended) = (watch.end)() {
            resume_unwind(Box::new(ended));
        }
        let RefineStep { evaluations, log_likelihood, .. } = step;
        bar.set_message(format!("{evaluations} evaluations, {log_likelihood:.4} nats/point"));
    };
    let result = refine(data, initial, settings, observe);
    bar.finish_and_clear();
    Ok(result?)
}

fn text(built: &MapReport, args: &MapArgs) -> String {
    let mut text = format!(
        "{}: {} of {} points ({:.4} %)",
        args.output.display(),
        thousands(built.map_points),
        thousands(built.points),
        100.0 * built.map_points as f64 / built.points as f64
    );
    if let (Some(cell), Some(offset)) = (built.cell_m, &built.offset_m) {
        let corner: Vec<String> = offset.iter().map(|value| format!("{value:.3}")).collect();
        text += &format!("\ngrid: cells of {cell:.6} m, corner at ({}) m", corner.join(", "));
    }
    for (what, chosen, unit) in
        [("size", &built.auto_size, "points"), ("sigma", &built.auto_sigma, "m")]
    {
        if let Some(chosen) = chosen {
            let by = chosen.by.name();
            let value = (chosen.value * 1e4).round() / 1e4;
            text +=
                &format!("\n{what} by {by}: {value} {unit}, best of {} tried", chosen.tried.len());
        }
    }
    if let Some(grid) = &built.grid {
        text += &format!("\n{}", grid.text());
    }
    if let (Some(converged), [first, .., last]) = (built.converged, &built.log_likelihood_trace[..])
    {
        let how = if converged { "converged" } else { "stopped (not converged)" };
        let method = match args.refine {
            Some(Refine::Fkm) | None => "fuzzy k-means",
            Some(refine) => refinement(refine).name(),
        };
        let updates = built.iterations;
        text += &format!(
            "\n{method}: {how} after {updates} updates, {first:.4} → {last:.4} nats per point"
        );
    }
    if let Some(per_point) = built.log_likelihood_per_point {
        text += &format!("\nlog-likelihood of the map: {per_point:.4} nats per point");
    }
    if let Some(reference) = &built.reference {
        text += &format!("\nreference: {reference}");
    }
    text
}
