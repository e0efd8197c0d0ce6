//! People who walk through the office.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, SQRT_2};

use mcl_core::{Bounds, Point, Rng, Seed, math};
use rand::RngExt;

use super::obstacles::Obstacles;
use super::path::Path;

/// A person is a pair of legs at the height of the scanner (0.3 to 0.5 m on most robots), not a disc: beams pass
/// between them. A calf has a circumference of 0.37 m; trousers add a centimetre.
const LEG_RADIUS: f64 = 0.07;
/// Half of the distance between the legs across the direction of walking (m).
const HALF_STANCE: f64 = 0.1;
/// A leg is at most this far ahead of or behind the body (m) …
const SWING: f64 = 0.15;
/// … and comes to the front once in two steps of this length (m).
const STEP: f64 = 0.7;

/// Range of walking speeds (m/s); one is drawn for each way.
const SPEEDS: [f64; 2] = [0.5, 1.5];

/// People walk from cell to cell of a grid with this edge (m), along, across or diagonally …
const CELL: f64 = 0.2;
/// … whose middle is this far from all surfaces (m): no leg touches one on the way between two cells.
const CLEARANCE: f64 = 0.4;
/// People keep this far from the middle of the robot (m) as long as they have somewhere to go.
const DISTANCE: f64 = 0.8;

/// Costs of steps between cells in the search for the shortest way, in fifths of a cell: √2 is about 7/5.
const STRAIGHT: u32 = 5;
const DIAGONAL: u32 = 7;

/// Cells of the floor on which people can walk.
struct Floor {
    min: Point<2>,
    columns: usize,
    /// Per cell, row by row, whether there is room for a person.
    is_free: Vec<bool>,
}

/// A time and position on a person's way.
#[derive(Debug, Clone, Copy)]
struct Knot {
    /// From the start of the drive (s).
    time: f64,
    at: Point<2>,
    /// Distance walked so far (m).
    walked: f64,
}

/// People on their ways, for as long as the robot drives.
pub(super) struct People {
    ways: Vec<Vec<Knot>>,
}

impl People {
    /// This number of people, each with a random stream of their own, between surfaces and around a robot on
    /// its path. They walk from one place to another, each drawn from all that can be reached from the
    /// robot's start, and ignore each other.
    pub fn new(number: usize, obstacles: &Obstacles, path: &Path, seed: Seed) -> Self {
        if number == 0 {
            return People { ways: Vec::new() };
        }
        let floor = Floor::of(obstacles);
        let start = path.pose(0.0).map_or([0.0; 2], |pose| [pose.x, pose.y]);
        let reach = floor.distances(floor.nearest_free(start));
        let places: Vec<usize> = (0..reach.len()).filter(|&cell| reach[cell] < u32::MAX).collect();
        let way = |person: usize| {
            let mut rng = seed.derive_index(person as u64).rng();
            floor.way(&places, path, &mut rng)
        };
        People { ways: (0..number).map(way).collect() }
    }

    /// All legs at a time (s from the start of the drive).
    pub fn legs(&self, time: f64) -> Obstacles {
        let mut legs = Obstacles::default();
        for way in self.ways.iter().filter(|way| way.len() > 1) {
            let next = way.partition_point(|knot| knot.time <= time).clamp(1, way.len() - 1);
            let [from, to] = [way[next - 1], way[next]];
            let part = ((time - from.time) / (to.time - from.time)).clamp(0.0, 1.0);
            let body = [0, 1].map(|axis| from.at[axis] + part * (to.at[axis] - from.at[axis]));
            let walked = from.walked + part * (to.walked - from.walked);
            let [along, across] = facing(&way[..=next]);
            let swing = SWING * math::sin(PI * walked / STEP);
            for side in [-1.0, 1.0] {
                let leg = [0, 1].map(|axis| {
                    body[axis] + side * (swing * along[axis] + HALF_STANCE * across[axis])
                });
                legs.add_circle(leg, LEG_RADIUS);
            }
        }
        legs
    }
}

/// Unit vectors along and across the last step of this way that moved: people who stand still keep facing in
/// their last direction of walking.
fn facing(way: &[Knot]) -> [Point<2>; 2] {
    let moved = way.windows(2).rev().find(|pair| pair[1].walked > pair[0].walked);
    let [x, y] = moved.map_or([1.0, 0.0], |pair| {
        let [from, to] = [pair[0].at, pair[1].at];
        let length = math::hypot(to[0] - from[0], to[1] - from[1]);
        [(to[0] - from[0]) / length, (to[1] - from[1]) / length]
    });
    [[x, y], [-y, x]]
}

impl Floor {
    fn of(obstacles: &Obstacles) -> Self {
        let bounds = obstacles.bounds().unwrap_or(Bounds { min: [0.0; 2], max: [0.0; 2] });
        let [columns, rows] = [0, 1].map(|axis| (bounds.extent(axis) / CELL) as usize + 1);
        let mut floor = Floor { min: bounds.min, columns, is_free: Vec::new() };
        let is_free = |cell| obstacles.clearance(floor.middle(cell)) >= CLEARANCE;
        floor.is_free = (0..columns * rows).map(is_free).collect();
        floor
    }

    fn middle(&self, cell: usize) -> Point<2> {
        let place = [cell % self.columns, cell / self.columns];
        [0, 1].map(|axis| self.min[axis] + CELL * (place[axis] as f64 + 0.5))
    }

    fn nearest_free(&self, place: Point<2>) -> Option<usize> {
        let distance = |&cell: &usize| {
            let [x, y] = self.middle(cell);
            math::hypot(x - place[0], y - place[1])
        };
        let free = (0..self.is_free.len()).filter(|&cell| self.is_free[cell]);
        free.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// The free cells around one, and the cost of the step to each.
    fn neighbors(&self, cell: usize) -> impl Iterator<Item = (usize, u32)> + '_ {
        let [column, row] = [cell % self.columns, cell / self.columns].map(|place| place as isize);
        let around = (-1..=1).flat_map(|down| (-1..=1).map(move |right| [right, down]));
        around.filter_map(move |[right, down]: [isize; 2]| {
            let length = match right.abs() + down.abs() {
                0 => return None,
                1 => STRAIGHT,
                _ => DIAGONAL,
            };
            let is_inside = (0..self.columns as isize).contains(&(column + right));
            let neighbor = (row + down) * self.columns as isize + column + right;
            let neighbor = usize::try_from(neighbor).ok().filter(|_| is_inside)?;
            self.is_free.get(neighbor)?.then_some((neighbor, length))
        })
    }

    /// The distance of each cell from one of them; `u32::MAX` for unreachable cells.
    fn distances(&self, from: Option<usize>) -> Vec<u32> {
        let mut distances = vec![u32::MAX; self.is_free.len()];
        let mut open = BinaryHeap::new();
        if let Some(cell) = from {
            distances[cell] = 0;
            open.push(Reverse((0, cell)));
        }
        while let Some(Reverse((distance, cell))) = open.pop() {
            if distance > distances[cell] {
                continue;
            }
            for (neighbor, length) in self.neighbors(cell) {
                if distance + length < distances[neighbor] {
                    distances[neighbor] = distance + length;
                    open.push(Reverse((distance + length, neighbor)));
                }
            }
        }
        distances
    }

    /// A way from one of these places to others, until the robot has arrived.
    fn way(&self, places: &[usize], path: &Path, rng: &mut Rng) -> Vec<Knot> {
        let from_robot = |cell: usize, time: f64| {
            let [x, y] = self.middle(cell);
            path.pose(time).map_or(f64::INFINITY, |robot| math::hypot(robot.x - x, robot.y - y))
        };
        let starts = places.iter().filter(|&&cell| from_robot(cell, 0.0) >= DISTANCE);
        let starts: Vec<usize> = starts.copied().collect();
        if starts.is_empty() || places.len() < 2 {
            // Nowhere to stand, or to go.
            return Vec::new();
        }
        let mut cell = starts[rng.random_range(0..starts.len())];
        let mut way = vec![Knot { time: 0.0, at: self.middle(cell), walked: 0.0 }];
        loop {
            let distances = self.distances(Some(places[rng.random_range(0..places.len())]));
            let speed = rng.random_range(SPEEDS[0]..=SPEEDS[1]);
            while distances[cell] > 0 {
                let last = way[way.len() - 1];
                if last.time > path.duration() {
                    return way;
                }
                let time = |length: u32| {
                    let cells = if length == DIAGONAL { SQRT_2 } else { 1.0 };
                    last.time + cells * CELL / speed
                };
                let room = |&(cell, length): &(usize, u32)| from_robot(cell, time(length));
                // Waiting is a step, too.
                let steps = || self.neighbors(cell).chain([(cell, STRAIGHT)]);
                let clear = steps().filter(|step| room(step) >= DISTANCE);
                let (next, length) = clear
                    .min_by_key(|&(cell, length)| (distances[cell].saturating_add(length), cell))
                    .or_else(|| steps().max_by(|a, b| room(a).total_cmp(&room(b))))
                    .unwrap_or((cell, STRAIGHT));
                let at = self.middle(next);
                let walked = last.walked + math::hypot(at[0] - last.at[0], at[1] - last.at[1]);
                way.push(Knot { time: time(length), at, walked });
                cell = next;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::{Office, OfficeSettings, simulate};
    use mcl_core::Recording;

    fn recording(people: usize, seed: u64) -> Recording {
        let settings = OfficeSettings { people, ..OfficeSettings::default() };
        simulate(&settings, Seed::new(seed)).unwrap()
    }

    #[test]
    fn people_change_the_readings_of_the_beams_that_meet_them_and_nothing_else() {
        let [without, with] = [0, 8].map(|people| recording(people, 1));
        let (mut nearer, mut lost) = (0, 0);
        for (a, b) in without.scans.iter().zip(&with.scans) {
            assert_eq!(
                (a.map_from_laser, a.odometry, a.stamp),
                (b.map_from_laser, b.odometry, b.stamp)
            );
            for (&a, &b) in a.ranges.iter().zip(&b.ranges) {
                lost += usize::from(b > 80.0 && a < b);
                nearer += usize::from(b < a);
                // A person right in front of a wall reads as the wall, up to noise.
                assert!(b < a + 0.1 || b > 80.0, "{a} m behind {b} m");
            }
        }
        let share = nearer as f64 / with.readings() as f64;
        assert!((0.005..0.05).contains(&share), "{share}");
        assert!(lost < nearer / 10, "{lost} of {nearer}");
        assert_eq!(with, recording(8, 1));
    }

    /// Legs stand free of walls and furniture, nobody runs, and the robot runs into nobody.
    #[test]
    fn people_walk_where_there_is_room() {
        for seed in [1, 5] {
            let office = Office::new(&OfficeSettings::default(), Seed::new(seed)).unwrap();
            let (obstacles, path) = (office.obstacles(), office.drive());
            let people = People::new(4, obstacles, path, Seed::new(seed));
            let legs = |time: f64| people.legs(time).circles().to_vec();
            let bodies = |time: f64| -> Vec<Point<2>> {
                let middle = |pair: &[crate::simulator::Circle]| {
                    [0, 1].map(|axis| 0.5 * (pair[0].center[axis] + pair[1].center[axis]))
                };
                legs(time).chunks(2).map(middle).collect()
            };
            let mut walked = 0.0;
            for second in 0..path.duration() as usize {
                let time = second as f64;
                for leg in legs(time) {
                    let room = obstacles.clearance(leg.center) - leg.radius;
                    assert!(room > 0.0, "seed {seed}, {time} s: {leg:?} has {room} m");
                }
                let robot = path.pose(time).unwrap();
                for (from, to) in bodies(time).into_iter().zip(bodies(time + 1.0)) {
                    let speed = (to[0] - from[0]).hypot(to[1] - from[1]);
                    assert!(speed <= SPEEDS[1] + 1e-9, "{speed} m/s");
                    walked += speed;
                    let apart = (from[0] - robot.x).hypot(from[1] - robot.y);
                    assert!(apart > 0.5, "seed {seed}, {time} s: {apart} m from the robot");
                }
            }
            let mean = walked / (4.0 * path.duration());
            assert!((SPEEDS[0]..SPEEDS[1]).contains(&mean), "{mean} m/s");
        }
    }
}
