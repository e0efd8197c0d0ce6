//! Fuzzy k-means and grid-based sampling.

use std::hint::black_box;
use std::time::Instant;

use anyhow::{Result, anyhow};
use mcl_core::{Point, PointMap, Seed};
use mcl_maps::sampling::{GridOffset, sample_grid};
use mcl_maps::{FkmSettings, InitialMap, MapSize, PointSet, fuzzy_k_means, initial_map};
use rayon::ThreadPool;

use crate::office::Office;
use crate::table::{Cell, Report, Scale, Title};

/// An office of 10 m × 10 m; the data are as many of them as it takes, side by side.
const BUILDING: Office = Office { rooms: 2 };
const BUILDING_POINTS: usize = 10_000;
/// From corner to corner (m).
const BUILDING_DISTANCE: f64 = 15.0;
/// The office of the filter's benches, 30 m × 30 m, with as many points as the Intel log has.
const OFFICE: Office = Office { rooms: 6 };
const OFFICE_POINTS: usize = 155_648;

/// Walls of equal buildings in a square: density and shape are the same however many they are.
fn buildings(points: usize) -> Vec<Point<2>> {
    let number = points.div_ceil(BUILDING_POINTS);
    let columns = (number as f64).sqrt().ceil() as usize;
    let mut rng = Seed::new(1).rng();
    (0..points)
        .map(|index| {
            let building = index / BUILDING_POINTS;
            let [x, y] = BUILDING.wall_point(&mut rng);
            let (column, row) = ((building % columns) as f64, (building / columns) as f64);
            [x + BUILDING_DISTANCE * column, y + BUILDING_DISTANCE * row]
        })
        .collect()
}

fn random_map(data: &PointSet<2>, size: MapSize) -> Result<PointMap<2>> {
    Ok(initial_map(data, &InitialMap::Random { size, seed: Seed::new(2) })?.map)
}

fn pools() -> Result<[ThreadPool; 2]> {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok([pool(1)?, pool(2)?])
}

/// A cell whose unit of work is one update of the means: an M step and an E step. The E step before
/// the first update is not timed.
fn updates<'a>(
    size: usize,
    data: &'a PointSet<2>,
    map: &'a PointMap<2>,
    pool: &'a ThreadPool,
) -> Cell<'a> {
    let work = move |updates: usize| {
        let settings =
            FkmSettings { tolerance: 0.0, max_iterations: updates, ..FkmSettings::default() };
        let mut span = (Instant::now(), Instant::now(), 0);
        let observe = |done: usize, _| match done {
            0 => span.0 = Instant::now(),
            _ => (span.1, span.2) = (Instant::now(), done),
        };
        let fitted = pool.install(|| {
            // The callback stays on the thread that runs the updates.
            fuzzy_k_means(data, map, &settings, observe)
        });
        black_box(fitted.expect("the settings are good"));
        (span.2, span.1 - span.0)
    };
    let threads = pool.current_num_threads();
    Cell { size, threads, items: data.len(), work: Box::new(work) }
}

/// EM when the data covers more and more area: N = 10⁴ … 10⁷ points, K = 1 % of them.
pub fn area_grows_with_the_data(report: &mut Report, scale: Scale) -> Result<()> {
    let pools = pools()?;
    let mut data = Vec::new();
    for size in scale.sizes(BUILDING_POINTS, 10_000_000) {
        let points = PointSet::new(buildings(size))?;
        let map = random_map(&points, MapSize::Percent(1.0))?;
        data.push((size, points, map));
    }
    let mut cells = Vec::new();
    for (size, points, map) in &data {
        cells.extend(pools.iter().map(|pool| updates(*size, points, map, pool)));
    }
    let title = Title {
        id: "em_area",
        text: "EM update (E and M step): area grows with the data, K = 1 % of the points",
        size: "points",
        item: "point",
    };
    report.measure(&title, cells, scale)
}

/// EM with K = 10² … 10⁵ components on the same points.
pub fn components(report: &mut Report, scale: Scale) -> Result<()> {
    let pools = pools()?;
    let mut rng = Seed::new(1).rng();
    let points = (0..OFFICE_POINTS).map(|_| OFFICE.wall_point(&mut rng)).collect();
    let data = PointSet::new(points)?;
    let mut maps = Vec::new();
    for size in scale.sizes(100, 100_000) {
        maps.push((size, random_map(&data, MapSize::Points(size))?));
    }
    let mut cells = Vec::new();
    for (size, map) in &maps {
        cells.extend(pools.iter().map(|pool| updates(*size, &data, map, pool)));
    }
    let title = Title {
        id: "em_components",
        text: "EM update (E and M step): K components, 155,648 points on 30 m x 30 m",
        size: "components",
        item: "point",
    };
    report.measure(&title, cells, scale)
}

/// Grid-based sampling with cells of half a metre; it knows no threads.
pub fn grid_sampling(report: &mut Report, scale: Scale) -> Result<()> {
    let data: Vec<_> = scale
        .sizes(BUILDING_POINTS, 10_000_000)
        .into_iter()
        .map(|size| (size, buildings(size)))
        .collect();
    for (size, points) in &data {
        sample_grid(points, 0.5, GridOffset::ORIGIN)
            .map_err(|error| anyhow!("{size} points: {error}"))?;
    }
    let cells = data.iter().map(|(size, points)| Cell {
        size: *size,
        threads: 1,
        items: points.len(),
        work: Box::new(|repeats| {
            let start = Instant::now();
            for _ in 0..repeats {
                black_box(sample_grid(black_box(points), 0.5, GridOffset::ORIGIN)).ok();
            }
            (repeats, start.elapsed())
        }),
    });
    let title = Title {
        id: "grid_sampling",
        text: "Grid-based sampling, cells of 0.5 m: area grows with the data",
        size: "points",
        item: "point",
    };
    report.measure(&title, cells.collect(), scale)
}
