//! The hand-drawn floor plan: a ring of corridors around an inner block that a middle and a cross
//! corridor divide, offices on both sides, a lobby with a glass front, an open lab with pillars.
//!
//! All coordinates are metres in the map's frame, whose origin is the building's south-west corner;
//! *x* points east, *y* north. Walls are given by their centre lines.

use mcl_core::{Bounds, Point, math};

use super::obstacles::Obstacles;

/// Thickness of walls in m.
const WALL: f64 = 0.15;

/// Edge of the square building in m, along the centre lines of the outer walls.
const SIZE: f64 = 30.0;

/// Width of doorways in m.
const DOORWAY: f64 = 1.2;

/// The direction of a wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Run {
    /// West to east, at a given y.
    East,
    /// South to north, at a given x.
    North,
}

/// A stretch of a line along an axis: `at` is its y (running east) or its x (running north).
#[derive(Debug, Clone, Copy)]
struct Stretch {
    run: Run,
    at: f64,
    from: f64,
    to: f64,
}

const fn east(y: f64, from: f64, to: f64) -> Stretch {
    Stretch { run: Run::East, at: y, from, to }
}

const fn north(x: f64, from: f64, to: f64) -> Stretch {
    Stretch { run: Run::North, at: x, from, to }
}

impl Stretch {
    /// The point at a coordinate along the stretch and a distance across it (north or east).
    fn point(&self, along: f64, across: f64) -> Point<2> {
        match self.run {
            Run::East => [along, self.at + across],
            Run::North => [self.at + across, along],
        }
    }
}

const WALLS: &[Stretch] = &[
    // Outer walls.
    east(0.0, 0.0, SIZE),
    east(SIZE, 0.0, SIZE),
    north(0.0, 0.0, SIZE),
    north(SIZE, 0.0, SIZE),
    // The outer side of the ring of corridors, and between the rooms in its corners.
    east(6.0, 0.0, 24.0),
    east(24.0, 0.0, SIZE),
    north(6.0, 6.0, 24.0),
    north(24.0, 0.0, 24.0),
    // The inner side.
    east(8.0, 8.0, 22.0),
    east(22.0, 8.0, 14.0),
    east(22.0, 16.0, 22.0),
    north(8.0, 8.0, 14.5),
    north(8.0, 16.5, 22.0),
    north(22.0, 8.0, 14.5),
    north(22.0, 16.5, 22.0),
    // The middle and the cross corridor.
    east(14.5, 8.0, 22.0),
    east(16.5, 8.0, 14.0),
    east(16.5, 16.0, 22.0),
    north(14.0, 16.5, 22.0),
    north(16.0, 16.5, 22.0),
    // Between the rooms: south, north, west, east, inner block.
    north(9.0, 0.0, 6.0),
    north(12.5, 0.0, 6.0),
    north(16.0, 0.0, 6.0),
    north(19.5, 0.0, 6.0),
    north(8.0, 24.0, SIZE),
    north(11.5, 24.0, SIZE),
    north(15.0, 24.0, SIZE),
    north(18.5, 24.0, SIZE),
    north(22.0, 24.0, SIZE),
    east(9.5, 0.0, 6.0),
    east(13.0, 0.0, 6.0),
    east(16.5, 0.0, 6.0),
    east(20.0, 0.0, 6.0),
    east(10.0, 24.0, SIZE),
    east(13.5, 24.0, SIZE),
    east(17.0, 24.0, SIZE),
    east(20.5, 24.0, SIZE),
    north(16.0, 8.0, 14.5),
    north(11.0, 16.5, 22.0),
    north(19.0, 16.5, 22.0),
];

/// Open passages: the lobby to the corridors, the lab to the corridors north and south of it.
const GAPS: &[Stretch] = &[north(24.0, 6.15, 9.2), east(14.5, 10.3, 12.7), east(8.0, 12.0, 14.0)];

/// Panes of glass in place of the wall: the lobby's front, the conference room, the break room, an
/// office.
const GLASS: &[Stretch] = &[
    north(SIZE, 1.0, 4.5),
    north(SIZE, 4.8, 9.0),
    east(0.0, 25.0, 29.0),
    east(8.0, 16.8, 18.8),
    east(8.0, 19.0, 21.2),
    east(14.5, 16.6, 19.2),
    north(22.0, 18.2, 20.6),
    east(6.0, 12.9, 14.2),
];

/// Walls along neither axis: a chamfered corner, partitions in the large rooms, the reception.
const SLANTED_WALLS: &[[Point<2>; 2]] = &[
    [[0.0, 2.2], [2.2, 0.0]],
    [[26.6, 26.5], [28.2, 28.0]],
    [[26.2, 4.2], [26.9, 5.0]],
    [[26.9, 5.0], [27.9, 5.0]],
    [[13.0, 10.4], [14.0, 10.9]],
    [[3.2, 3.4], [4.8, 2.6]],
];

/// Round pillars: centre and radius.
const PILLARS: &[(Point<2>, f64)] = &[
    ([27.0, 2.6], 0.28),
    ([27.0, 7.2], 0.28),
    ([10.2, 11.2], 0.3),
    ([13.8, 11.8], 0.3),
    ([25.6, 27.0], 0.25),
    ([4.6, 1.9], 0.2),
];

/// The side of a room that its door is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    North,
    East,
    South,
    West,
}

/// Which end of the doorway carries the hinges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hinge {
    /// The west or south end.
    Low,
    /// The east or north end.
    High,
}

/// A door that opens into its room.
#[derive(Debug, Clone, Copy)]
pub(super) struct Door {
    side: Side,
    /// Centre of the doorway along the wall.
    at: f64,
    hinge: Hinge,
    /// How far the leaf stands open, in degrees.
    open: f64,
}

/// How the robot drives through a room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tour {
    /// Around the room, anticlockwise seen from above.
    Left,
    /// Around the room, clockwise.
    Right,
    /// To the far end, turning there.
    TurnAround,
    /// A look inside, and out backward.
    BackOut,
}

/// A room with a door.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    pub name: &'static str,
    /// South-west corner, on the centre lines of the walls.
    pub min: Point<2>,
    /// North-east corner.
    pub max: Point<2>,
    pub door: Door,
    pub tour: Tour,
}

const fn room(
    name: &'static str,
    x: [f64; 2],
    y: [f64; 2],
    (side, at, hinge, open): (Side, f64, Hinge, f64),
    tour: Tour,
) -> Room {
    let door = Door { side, at, hinge, open };
    Room { name, min: [x[0], y[0]], max: [x[1], y[1]], door, tour }
}

use Hinge::{High, Low};
use Side::{East, North, South, West};
use Tour::{BackOut, Left, Right, TurnAround};

/// Every room that a door leads to.
pub(super) const ROOMS: &[Room] = &[
    room("south 1", [0.0, 9.0], [0.0, 6.0], (North, 7.7, High, 92.0), Left),
    room("south 2", [9.0, 12.5], [0.0, 6.0], (North, 10.0, Low, 84.0), Right),
    room("south 3", [12.5, 16.0], [0.0, 6.0], (North, 15.1, High, 65.0), TurnAround),
    room("south 4", [16.0, 19.5], [0.0, 6.0], (North, 17.0, Low, 95.0), Left),
    room("south 5", [19.5, 24.0], [0.0, 6.0], (North, 22.6, High, 88.0), Right),
    room("east 1", [24.0, SIZE], [10.0, 13.5], (West, 11.0, Low, 90.0), Left),
    room("east 2", [24.0, SIZE], [13.5, 17.0], (West, 15.9, High, 62.0), TurnAround),
    room("east 3", [24.0, SIZE], [17.0, 20.5], (West, 18.0, Low, 97.0), Right),
    room("east 4", [24.0, SIZE], [20.5, 24.0], (West, 21.5, Low, 86.0), Left),
    room("north-east", [22.0, SIZE], [24.0, SIZE], (South, 23.2, Low, 90.0), Left),
    room("north 5", [18.5, 22.0], [24.0, SIZE], (South, 19.5, Low, 60.0), TurnAround),
    room("north 4", [15.0, 18.5], [24.0, SIZE], (South, 17.5, High, 90.0), Right),
    room("north 3", [11.5, 15.0], [24.0, SIZE], (South, 12.5, Low, 93.0), Left),
    room("north 2", [8.0, 11.5], [24.0, SIZE], (South, 10.5, High, 82.0), TurnAround),
    room("north 1", [0.0, 8.0], [24.0, SIZE], (South, 7.0, High, 90.0), Right),
    room("west 5", [0.0, 6.0], [20.0, 24.0], (East, 22.6, High, 88.0), Left),
    room("west 4", [0.0, 6.0], [16.5, 20.0], (East, 19.0, High, 66.0), TurnAround),
    room("west 3", [0.0, 6.0], [13.0, 16.5], (East, 14.2, Low, 90.0), Right),
    room("west 2", [0.0, 6.0], [9.5, 13.0], (East, 10.5, Low, 85.0), Left),
    room("west 1", [0.0, 6.0], [6.0, 9.5], (East, 8.4, High, 72.0), TurnAround),
    room("conference", [16.0, 22.0], [8.0, 14.5], (North, 20.6, High, 90.0), Left),
    room("copy room", [8.0, 11.0], [16.5, 22.0], (South, 9.8, High, 85.0), BackOut),
    room("kitchen", [11.0, 14.0], [16.5, 22.0], (East, 19.0, High, 90.0), TurnAround),
    room("server room", [16.0, 19.0], [16.5, 22.0], (South, 17.4, Low, 80.0), BackOut),
    room("break room", [19.0, 22.0], [16.5, 22.0], (North, 20.6, High, 90.0), TurnAround),
];

/// Floor areas without a door: lobby, lab, and the corridors.
pub(super) const OPEN_AREAS: &[[Point<2>; 2]] = &[
    [[24.0, 0.0], [SIZE, 10.0]],
    [[8.0, 8.0], [16.0, 14.5]],
    [[6.0, 6.0], [24.0, 8.0]],
    [[6.0, 22.0], [24.0, 24.0]],
    [[6.0, 8.0], [8.0, 22.0]],
    [[22.0, 8.0], [24.0, 22.0]],
    [[8.0, 14.5], [22.0, 16.5]],
];

impl Room {
    /// The area between the walls' faces.
    pub fn floor(&self) -> Bounds<2> {
        inside_walls(self.min, self.max)
    }

    /// The middle of the opening that the door's leaf leaves, `depth` metres behind the wall's centre line;
    /// negative depths lie in front of the door.
    pub fn doorway(&self, depth: f64) -> Point<2> {
        // The leaf's tip is DOORWAY·cos(open) from its hinge.
        let leaf = DOORWAY * math::cos(self.door.open.to_radians()).max(0.0);
        let shift = match self.door.hinge {
            Low => 0.5 * leaf,
            High => -0.5 * leaf,
        };
        self.door_point(self.door.at + shift, depth)
    }

    /// The point at a coordinate along the door's wall, `depth` metres into the room.
    pub fn door_point(&self, along: f64, depth: f64) -> Point<2> {
        match self.door.side {
            North => [along, self.max[1] - depth],
            South => [along, self.min[1] + depth],
            East => [self.max[0] - depth, along],
            West => [self.min[0] + depth, along],
        }
    }

    /// Extent of the room along the door's wall, and its depth seen from the door, in m.
    pub fn along_and_depth(&self) -> ([f64; 2], f64) {
        match self.door.side {
            North | South => ([self.min[0], self.max[0]], self.max[1] - self.min[1]),
            East | West => ([self.min[1], self.max[1]], self.max[0] - self.min[0]),
        }
    }

    /// Whether growing coordinates along the door's wall are to the right of somebody who enters.
    pub fn along_is_right(&self) -> bool {
        matches!(self.door.side, South | East)
    }

    fn doorway_stretch(&self) -> Stretch {
        let (from, to) = (self.door.at - 0.5 * DOORWAY, self.door.at + 0.5 * DOORWAY);
        match self.door.side {
            North => east(self.max[1], from, to),
            South => east(self.min[1], from, to),
            East => north(self.max[0], from, to),
            West => north(self.min[0], from, to),
        }
    }

    /// The open leaf, from its hinge at the wall's inner face.
    fn leaf(&self) -> [Point<2>; 2] {
        let (sin, cos) = math::sin_cos(self.door.open.to_radians());
        let (hinge, towards) = match self.door.hinge {
            Low => (self.door.at - 0.5 * DOORWAY, 1.0),
            High => (self.door.at + 0.5 * DOORWAY, -1.0),
        };
        let depth = 0.5 * WALL;
        [
            self.door_point(hinge, depth),
            self.door_point(hinge + towards * DOORWAY * cos, depth + DOORWAY * sin),
        ]
    }
}

/// Between the faces of the walls on the given centre lines.
pub(super) fn inside_walls(min: Point<2>, max: Point<2>) -> Bounds<2> {
    let half = 0.5 * WALL;
    Bounds { min: min.map(|value| value + half), max: max.map(|value| value - half) }
}

/// Walls with their openings, panes, doors and pillars: everything except the furniture.
pub(super) fn structure() -> Obstacles {
    let doorways: Vec<Stretch> = ROOMS.iter().map(Room::doorway_stretch).collect();
    let openings: Vec<&Stretch> = doorways.iter().chain(GAPS).chain(GLASS).collect();
    let mut obstacles = Obstacles::default();
    for wall in WALLS {
        add_wall(&mut obstacles, wall, &openings);
    }
    for pane in GLASS {
        obstacles.add_glass(pane.point(pane.from, 0.0), pane.point(pane.to, 0.0));
    }
    for room in ROOMS {
        let [hinge, tip] = room.leaf();
        obstacles.add_segment(hinge, tip);
    }
    for &[from, to] in SLANTED_WALLS {
        obstacles.add_segment(from, to);
    }
    for &(center, radius) in PILLARS {
        obstacles.add_circle(center, radius);
    }
    obstacles
}

/// Adds the boxes that remain of a wall between its openings. Walls end half a thickness beyond
/// their centre lines' ends, so that corners are closed.
fn add_wall(obstacles: &mut Obstacles, wall: &Stretch, openings: &[&Stretch]) {
    let mut cuts: Vec<&Stretch> = openings
        .iter()
        .copied()
        .filter(|opening| {
            // Lines of the plan are written as equal decimals, so that comparison is exact.
            opening.run == wall.run
                && opening.at == wall.at
                && opening.from > wall.from
                && opening.to < wall.to
        })
        .collect();
    cuts.sort_by(|a, b| a.from.total_cmp(&b.from));
    let half = 0.5 * WALL;
    let mut begin = wall.from - half;
    let ends = cuts.iter().map(|cut| (cut.from, cut.to)).chain([(wall.to + half, f64::NAN)]);
    for (end, next) in ends {
        obstacles.add_box([
            wall.point(begin, -half),
            wall.point(end, -half),
            wall.point(end, half),
            wall.point(begin, half),
        ]);
        begin = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_opening_lies_in_exactly_one_wall_and_none_overlap() {
        let doorways: Vec<Stretch> = ROOMS.iter().map(Room::doorway_stretch).collect();
        let openings: Vec<&Stretch> = doorways.iter().chain(GAPS).chain(GLASS).collect();
        for (i, a) in openings.iter().enumerate() {
            let walls = WALLS
                .iter()
                .filter(|w| w.run == a.run && w.at == a.at && w.from < a.from && w.to > a.to);
            assert_eq!(walls.count(), 1, "{a:?}");
            for b in &openings[..i] {
                let apart = a.to < b.from || b.to < a.from;
                assert!(a.run != b.run || a.at != b.at || apart, "{a:?} overlaps {b:?}");
            }
        }
    }

    #[test]
    fn the_building_measures_30_by_30_metres() {
        let bounds = structure().bounds().unwrap();
        for axis in 0..2 {
            assert!((bounds.extent(axis) - (SIZE + WALL)).abs() < 1e-9);
        }
    }

    #[test]
    fn a_half_open_door_leaves_its_middle_free() {
        // 60° open: the tip of the 1.2 m leaf stands 0.6 m from the hinge, 0.6 m remain.
        let room = room("test", [0.0, 4.0], [0.0, 4.0], (Side::South, 2.0, Hinge::Low, 60.0), Left);
        let [hinge, tip] = room.leaf();
        assert!((hinge[0] - 1.4).abs() < 1e-12 && (hinge[1] - 0.075).abs() < 1e-12);
        assert!((tip[0] - 2.0).abs() < 1e-12);
        let middle = room.doorway(1.0);
        assert!((middle[0] - 2.3).abs() < 1e-12 && (middle[1] - 1.0).abs() < 1e-12);
    }
}
