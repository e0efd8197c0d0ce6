//! People around a robot, modelled as readings that end at them.

use std::f64::consts::TAU;

use anyhow::{Result, bail};
use mcl_core::{LaserScan, Pose2, Rng, Seed, is_usable_range, math, wrap_angle};
use rand::RngExt;

use crate::recipe::disturbance::People;

/// Radius of a person (m): a trunk of 0.5 m across, or two legs in a skirt or a coat.
const RADIUS: f64 = 0.25;
/// Range of a person's distance from the laser, to the centre (m).
const NEAREST: f64 = 0.6;
const FARTHEST: f64 = 2.5;
/// Largest change from one localized scan to the next of a person's direction from the robot (rad) and
/// distance (m).
const DRIFT: f64 = 0.35;
/// Limit on the number of people.
const MOST: u64 = 100;

/// People who accompany the robot, like the visitors around a guide in a museum: each has a position near it,
/// by direction in the map and distance, that drifts from scan to scan. Where a wall is nearer, a person
/// walks in front of it, and falls back where there is no room. People are added one after another until the
/// share is met; the last one is with the robot for a part of the run.
///
/// `used` are the run's scans among `scans`, `reference` the poses at these.
///
/// # Errors
/// When this share of the readings cannot end at people.
pub fn surround(
    scans: &mut [LaserScan],
    used: &[usize],
    reference: &[Pose2],
    people: &People,
    max_range: f64,
    seed: Seed,
) -> Result<()> {
    let walls: Vec<Vec<f64>> = used.iter().map(|&scan| scans[scan].ranges.clone()).collect();
    let mut usable: usize = used.iter().map(|&scan| scans[scan].usable_beams(max_range)).sum();
    let mut ended: Vec<Vec<bool>> = walls.iter().map(|walls| vec![false; walls.len()]).collect();
    let mut hits = 0;
    for person in 0..MOST {
        let mut rng = seed.derive_index(person).rng();
        let way = way(used.len(), &mut rng);
        let from = rng.random_range(0..used.len());
        for step in (from..used.len()).chain((0..from).rev()) {
            if hits as f64 >= people.share * usable as f64 {
                return Ok(());
            }
            let scan = &mut scans[used[step]];
            let [direction, distance] = way[step];
            let bearing = direction - reference[step].theta;
            for (beam, range) in ends(scan, &walls[step], [bearing, distance], max_range) {
                let is_usable = is_usable_range(scan.ranges[beam], max_range);
                if is_usable && scan.ranges[beam] <= range {
                    continue;
                }
                scan.ranges[beam] = range;
                usable += usize::from(!is_usable);
                hits += usize::from(!ended[step][beam]);
                ended[step][beam] = true;
            }
        }
    }
    bail!(
        "people.share is {}, but {MOST} people block only {:.2} of the readings; expected a smaller share",
        people.share,
        hits as f64 / usable as f64
    )
}

/// Direction in the map (rad) and distance (m) of a person from the laser, at every scan.
fn way(scans: usize, rng: &mut Rng) -> Vec<[f64; 2]> {
    let mut place = [rng.random_range(0.0..TAU), rng.random_range(NEAREST..FARTHEST)];
    let step = |_| {
        let here = place;
        place[0] += rng.random_range(-DRIFT..DRIFT);
        place[1] = (place[1] + rng.random_range(-DRIFT..DRIFT)).clamp(NEAREST, FARTHEST);
        here
    };
    (0..scans).map(step).collect()
}

/// The beams that meet a person, with the distance (m) to the person. `walls` are the readings without
/// people.
fn ends(
    scan: &LaserScan,
    walls: &[f64],
    [bearing, distance]: [f64; 2],
    max_range: f64,
) -> Vec<(usize, f64)> {
    let off: Vec<f64> =
        (0..walls.len()).map(|beam| wrap_angle(scan.direction(beam) - bearing)).collect();
    let Some(middle) = (0..off.len()).min_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs())) else {
        return Vec::new();
    };
    let wall = walls[middle];
    let distance = match is_usable_range(wall, max_range) {
        true => distance.min(wall - RADIUS),
        false => distance,
    };
    if distance < NEAREST {
        return Vec::new();
    }
    let half_width = math::asin(RADIUS / distance);
    let seen = off.iter().enumerate().filter(|(_, off)| off.abs() < half_width);
    let range = |off: f64| {
        let (sin, cos) = math::sin_cos(off);
        distance * cos - (math::square(RADIUS) - math::square(distance * sin)).max(0.0).sqrt()
    };
    seen.map(|(beam, &off)| (beam, range(off))).collect()
}
