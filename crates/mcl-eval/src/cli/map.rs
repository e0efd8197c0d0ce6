use anyhow::Result;
use mcl_core::{PointMap, Seed};
use mcl_maps::files::{Encoding, is_grid, write_grid, write_map};
use mcl_maps::{
    FkmReport, FkmSettings, GridOffset, InitialMap, PointSet, accelerated_fuzzy_k_means,
    fuzzy_k_means, initial_map, mixture_log_likelihood,
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
    log_likelihood_per_point: Option<f64>,
    /// Of a grid map; null for a point map.
    grid: Option<GridFigures>,
}

pub fn run(args: &MapArgs, global: &Global) -> Result<Outcome> {
    let initial = initial_settings(args);
    check_options(&args.output, args.resolution, None);
    mcl_maps::files::check_writable(&args.output)?;
    let source = LogSource::open(&args.log.log, &args.log.options())?;
    let data = PointSet::new(source.points()?)?;

    let initial = initial_map(&data, &initial)?;
    let (map, report) = match args.refine {
        None => (initial.map.clone(), None),
        Some(method) => {
            let (means, report) = refine(method, &data, &initial.map, args, global)?;
            let map = match args.no_snap {
                true => PointMap::new(means)?,
                false => initial.snapped(&data, &means)?.map,
            };
            (map, Some(report))
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
        iterations: report.as_ref().map_or(0, |report| report.iterations),
        converged: report.as_ref().map(|report| report.converged),
        log_likelihood_trace: match report {
            Some(report) => report.log_likelihood_trace,
            // Without a refinement a point map written is the initial one.
            None if grid.is_none() => log_likelihood_per_point.into_iter().collect(),
            None => likelihood(&initial.map)?.into_iter().collect(),
        },
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

/// Fuzzy k-means with a progress bar. Gains shrink about geometrically, so the bar shows how far the
/// last gain is, on a logarithmic scale, from the first to the tolerance.
fn refine(
    method: Refine,
    data: &PointSet<2>,
    initial: &PointMap<2>,
    args: &MapArgs,
    global: &Global,
) -> Result<(Vec<mcl_core::Point<2>>, FkmReport)> {
    let settings = FkmSettings {
        sigma: args.sigma,
        tolerance: args.tolerance,
        max_iterations: args.max_iterations,
    };
    let bar = progress::bar(1000, "fuzzy k-means", global.quiet);
    let mut before: Option<f64> = None;
    let mut first_gain: Option<f64> = None;
    let observe = |updates: usize, per_point: f64| {
        bar.set_message(format!("update {updates}, {per_point:.4} nats/point"));
        if let Some(before) = before {
            let gain = per_point - before;
            let first = *first_gain.get_or_insert(gain);
            let by_gain = (first / gain).ln() / (first / args.tolerance).ln();
            let by_count = updates as f64 / args.max_iterations as f64;
            let fraction = if by_gain.is_finite() { by_gain.max(by_count) } else { by_count };
            bar.set_position((1000.0 * fraction.clamp(0.0, 1.0)) as u64);
        }
        before = Some(per_point);
    };
    let result = match method {
        Refine::Fkm => fuzzy_k_means(data, initial, &settings, observe),
        Refine::FkmAccelerated => accelerated_fuzzy_k_means(data, initial, &settings, observe),
    };
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
        let updates = built.iterations;
        text += &format!(
            "\nfuzzy k-means: {how} after {updates} updates, {first:.4} → {last:.4} nats per point"
        );
    }
    if let Some(per_point) = built.log_likelihood_per_point {
        text += &format!("\nlog-likelihood of the map: {per_point:.4} nats per point");
    }
    text
}
