//! Whole steps of the particle filter (propagate, weigh, normalize, estimate, resample).

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use mcl_core::{LaserScan, PointMap, Pose2, Seed};
use mcl_filter::{FilterSettings, MapDistances, ParticleFilter};

use crate::office::Office;
use crate::table::{Cell, Report, Scale, Title};

/// 30 m × 30 m, with as many points as the Intel log has.
const OFFICE: Office = Office { rooms: 6 };
const OFFICE_POINTS: usize = 155_648;

/// A robot that goes back and forth in the middle of a room.
struct Walk {
    poses: [Pose2; 2],
    scans: [LaserScan; 2],
}

impl Walk {
    fn new() -> Self {
        let poses = [0.0, 0.1].map(|x| Pose2::new(12.0 + x, 13.0, 0.6));
        Walk { poses, scans: poses.map(|pose| OFFICE.scan(&pose)) }
    }

    /// Number of beams that the filter uses.
    fn beams(&self, distances: &MapDistances) -> Result<usize> {
        Ok(self.start(distances, 1, 0)?.update(&self.scans[0])?.used_beams)
    }

    fn start<'a>(
        &self,
        distances: &'a MapDistances,
        particles: usize,
        seed: u64,
    ) -> Result<ParticleFilter<'a>> {
        let settings =
            FilterSettings { particles: particles.into(), ..FilterSettings::default() }.check()?;
        let start = Some(self.poses[0]);
        Ok(ParticleFilter::new(&settings, distances, Pose2::IDENTITY, start, Seed::new(seed))?)
    }

    /// There and back as often as it takes for that many steps.
    fn steps(&self, filter: &mut ParticleFilter, number: usize) {
        for step in 0..number {
            let (from, to) = (step % 2, 1 - step % 2);
            let increment = self.poses[from].between(&self.poses[to]);
            filter.step(&increment, &self.scans[to]).expect("the office is a good place");
        }
    }

    /// One filter, and two side by side: for these the time is that of a step of both, halved.
    fn cells<'a>(
        &'a self,
        size: usize,
        distances: &'a MapDistances,
        particles: usize,
    ) -> Result<[Cell<'a>; 2]> {
        let items = particles * self.beams(distances)?;
        let mut alone = self.start(distances, particles, 3)?;
        let mut pair = [self.start(distances, particles, 3)?, self.start(distances, particles, 4)?];
        let one = move |repeats: usize| {
            // An even number, so that the robot is where it was.
            let number = repeats.next_multiple_of(2);
            let start = Instant::now();
            self.steps(&mut alone, number);
            (number, start.elapsed())
        };
        let two = move |repeats: usize| {
            let number = repeats.next_multiple_of(2);
            let start = Instant::now();
            std::thread::scope(|scope| {
                for filter in &mut pair {
                    scope.spawn(|| self.steps(filter, number));
                }
            });
            (2 * number, start.elapsed())
        };
        let cell = |threads, work: Box<dyn FnMut(usize) -> (usize, Duration) + 'a>| Cell {
            size,
            threads,
            items,
            work,
        };
        Ok([cell(1, Box::new(one)), cell(2, Box::new(two))])
    }
}

fn distances(map_points: usize) -> Result<MapDistances> {
    let mut rng = Seed::new(1).rng();
    let map = PointMap::new((0..map_points).map(|_| OFFICE.wall_point(&mut rng)).collect())?;
    MapDistances::grid(&map, FilterSettings::default().max_distance).context("distance field")
}

/// Steps with 10² … 10⁵ particles on a map of 1 %.
pub fn particles(report: &mut Report, scale: Scale) -> Result<()> {
    let walk = Walk::new();
    let distances = distances(OFFICE_POINTS / 100)?;
    let mut cells = Vec::new();
    for size in scale.sizes(100, 100_000) {
        cells.extend(walk.cells(size, &distances, size)?);
    }
    let title = Title {
        id: "filter_particles",
        text: "Filter step: particles, on a map of 1,556 points (2 threads: two runs at once)",
        size: "particles",
        item: "beam",
    };
    report.measure(&title, cells, scale)
}

/// Steps of 500 particles on maps of 10² … 10⁵ points of the same office.
pub fn map_points(report: &mut Report, scale: Scale) -> Result<()> {
    let walk = Walk::new();
    let mut maps = Vec::new();
    for size in scale.sizes(100, 100_000) {
        maps.push((size, distances(size)?));
    }
    let mut cells = Vec::new();
    for (size, distances) in &maps {
        cells.extend(walk.cells(*size, distances, 500)?);
    }
    let title = Title {
        id: "filter_map",
        text: "Filter step: points of the map, 500 particles (2 threads: two runs at once)",
        size: "map points",
        item: "beam",
    };
    report.measure(&title, cells, scale)
}
