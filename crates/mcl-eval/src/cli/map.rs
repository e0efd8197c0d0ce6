use anyhow::Result;
use mcl_core::{PointMap, Seed};
use mcl_maps::files::{Encoding, is_grid, write_grid, write_map};
use mcl_maps::refine::{RefineStep, Refined, refine};
use mcl_maps::{
    FkmSettings, GridOffset, InitialMap, PointSet, RefineSettings, Refinement, initial_map,
    mixture_log_likelihood,
};
use serde::Serialize;

use super::Outcome;
use super::args::{Global, Init, MapArgs, Refine};
use super::grid::{GridFigures, check_options, grid_of};
use super::output::{print, refuse, tell_losses, thousands};
use crate::progress;
use crate::source::LogSource;

#[derive(Serialize)]
struct Built {
    points: usize,
    map_points: usize,
    cell_m: Option<f64>,
    /// A corner of a grid cell; null unless grid.
    offset_m: Option<[f64; 2]>,
    iterations: usize,
    /// Null without a refinement.
    converged: Option<bool>,
    log_likelihood_trace: Vec<f64>,
    /// The same entries, with what led to them and how long it took.
    steps: Vec<RefineStep>,
    log_likelihood_per_point: Option<f64>,
    /// Of a grid map; null for a point map.
    grid: Option<GridFigures>,
}

pub fn run(args: &MapArgs, global: &Global) -> Result<Outcome> {
    let initial = initial_settings(args);
    let refinement = refine_settings(args);
    check_options(&args.output, args.resolution, None);
    mcl_maps::files::check_writable(&args.output)?;
    let source = LogSource::open(&args.log.log, &args.log.options())?;
    let data = PointSet::new(source.points()?)?;

    let initial = initial_map(&data, &initial)?;
    let (map, report) = match refinement {
        None => (initial.map.clone(), None),
        Some(settings) => {
            let found = refined(&settings, &data, &initial.map, global)?;
            let kept = || found.indices.iter().map(|&index| data.points()[index]).collect();
            let points = if args.no_snap { found.means } else { kept() };
            (PointMap::new(points)?, Some(found.report))
        }
    };
    let grid = match is_grid(&args.output) {
        true => Some(grid_of(&map, args.resolution, Some(&source))?),
        false => None,
    };
    // What the file holds, and all that is told of it: points that share a cell are one.
    let map = match &grid {
        Some(grid) => PointMap::new(grid.occupied_points())?,
        None => map,
    };
    // Likelihoods cost more than the sampling itself: only where somebody looks at them.
    let wanted = args.json || report.is_some();
    let likelihood = |map: &PointMap<2>| match wanted {
        true => mixture_log_likelihood(&data, map, args.sigma).map(|found| Some(found.per_point)),
        false => Ok(None),
    };
    let log_likelihood_per_point = likelihood(&map)?;
    let built = Built {
        points: data.len(),
        map_points: map.len(),
        cell_m: initial.cell,
        offset_m: initial.offset,
        iterations: report.as_ref().map_or(0, |report| report.evaluations - 1),
        converged: report.as_ref().map(|report| report.converged),
        log_likelihood_trace: match &report {
            Some(report) => report.steps.iter().map(|step| step.log_likelihood).collect(),
            // Without a refinement a point map written is the initial one.
            None if grid.is_none() => log_likelihood_per_point.into_iter().collect(),
            None => likelihood(&initial.map)?.into_iter().collect(),
        },
        steps: report.map_or(Vec::new(), |report| report.steps),
        log_likelihood_per_point,
        grid: grid.as_ref().map(GridFigures::of),
    };
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::Binary };
    match &grid {
        Some(grid) => write_grid(&args.output, grid)?,
        None => write_map(&args.output, &map, encoding)?,
    }
    print(args.json, &built, |built| text(built, args))?;
    Ok(tell_losses(&args.log.log, &source))
}

/// What `--init` and its companions mean; combinations that mean nothing are usage errors.
fn initial_settings(args: &MapArgs) -> InitialMap<2> {
    if args.init != Init::Grid && (args.cell.is_some() || args.offset.is_some()) {
        refuse("--cell and --offset go with --init grid");
    }
    let offset = args.offset.map_or(GridOffset::ORIGIN, GridOffset::Metres);
    match (args.init, args.size, args.cell) {
        (Init::All, Some(_), _) => {
            refuse("--init all takes every point: --size does not go with it")
        }
        (Init::All, None, _) => InitialMap::All,
        (Init::Random, Some(size), _) => InitialMap::Random { size, seed: Seed::new(args.seed) },
        (Init::Random, None, _) => refuse("--init random needs --size"),
        (Init::Grid, _, Some(cell)) => InitialMap::GridCell { cell, offset },
        (Init::Grid, Some(size), None) => InitialMap::GridSize { size, offset },
        (Init::Grid, None, None) => refuse("--init grid needs --size or --cell"),
    }
}

/// What `--refine` and its companions mean; combinations that mean nothing are usage errors.
fn refine_settings(args: &MapArgs) -> Option<RefineSettings> {
    let mut method = match args.refine {
        Some(Refine::Fkm) => Some(Refinement::Fkm {}),
        Some(Refine::FkmAccelerated) => Some(Refinement::FkmAccelerated {}),
        Some(Refine::Restarts) => Some(Refinement::RESTARTS),
        Some(Refine::Annealed) => Some(Refinement::ANNEALED),
        Some(Refine::SplitMerge) => Some(Refinement::SPLIT_MERGE),
        Some(Refine::Exchange) => Some(Refinement::EXCHANGE),
        Some(Refine::Best) => Some(Refinement::BEST),
        None => None,
    };
    match (&mut method, args.rounds, args.restarts) {
        (
            Some(Refinement::SplitMerge { rounds } | Refinement::Best { rounds, .. }),
            Some(wanted),
            None,
        ) => *rounds = wanted,
        (Some(Refinement::Restarts { restarts }), None, Some(wanted)) => *restarts = wanted,
        (_, Some(_), _) => refuse("--rounds goes with --refine split-merge or best"),
        (_, _, Some(_)) => refuse("--restarts goes with --refine restarts"),
        (_, None, None) => {}
    }
    if args.no_snap && matches!(args.refine, Some(Refine::Exchange | Refine::Best)) {
        refuse("--no-snap does not go with --refine exchange or best, which end with data points");
    }
    Some(RefineSettings {
        method: method?,
        fkm: FkmSettings {
            sigma: args.sigma,
            tolerance: args.tolerance,
            max_iterations: args.max_iterations,
        },
        seed: Seed::new(args.seed),
        budget_s: args.refine_seconds,
    })
}

/// A refinement with a line that tells how far it is.
fn refined(
    settings: &RefineSettings,
    data: &PointSet<2>,
    initial: &PointMap<2>,
    global: &Global,
) -> Result<Refined<2>> {
    let bar = progress::spinner(settings.method.name(), global.quiet);
    let observe = |step: &RefineStep| {
        let RefineStep { evaluations, log_likelihood, .. } = step;
        bar.set_message(format!("{evaluations} evaluations, {log_likelihood:.4} nats/point"));
    };
    let result = refine(data, initial, settings, observe);
    bar.finish_and_clear();
    Ok(result?)
}

fn text(built: &Built, args: &MapArgs) -> String {
    let mut text = format!(
        "{}: {} of {} points ({:.4} %)",
        args.output.display(),
        thousands(built.map_points),
        thousands(built.points),
        100.0 * built.map_points as f64 / built.points as f64
    );
    if let (Some(cell), Some([x, y])) = (built.cell_m, built.offset_m) {
        text += &format!("\ngrid: cells of {cell:.6} m, corner at ({x:.3}, {y:.3}) m");
    }
    if let Some(grid) = &built.grid {
        text += &format!("\n{}", grid.text());
    }
    if let (Some(converged), [first, .., last]) = (built.converged, &built.log_likelihood_trace[..])
    {
        let how = if converged { "converged" } else { "stopped (not converged)" };
        let method = match args.refine {
            Some(Refine::Fkm) | None => "fuzzy k-means",
            Some(_) => refine_settings(args).map_or("", |settings| settings.method.name()),
        };
        let updates = built.iterations;
        text += &format!(
            "\n{method}: {how} after {updates} updates, {first:.4} → {last:.4} nats per point"
        );
    }
    if let Some(per_point) = built.log_likelihood_per_point {
        text += &format!("\nlog-likelihood of the map: {per_point:.4} nats per point");
    }
    text
}
