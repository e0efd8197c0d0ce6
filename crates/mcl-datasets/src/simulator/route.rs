//! The robot's route through the floor plan: along the corridors, through every room, and around the
//! loops again.

use mcl_core::{Point, Rng, math};
use rand::RngExt;

use super::floor_plan::{ROOMS, Room, Tour};
use super::path::Leg;

/// One stop of the route.
#[derive(Debug, Clone, Copy)]
enum Stop {
    /// A point in a corridor, straight ahead of the last stop.
    Corridor(f64, f64),
    /// A point in the open: lobby or lab.
    Open(f64, f64),
    /// A visit to the named room, whose door opens to the corridor the robot is in.
    Visit(&'static str),
}

use Stop::{Corridor, Open, Visit};

/// Where the drive begins: the south-west corner of the ring.
const START: Point<2> = [7.0, 7.0];

const STOPS: &[Stop] = &[
    // Around the ring and through the outer rooms.
    Visit("south 2"),
    Visit("south 3"),
    Visit("south 4"),
    Visit("south 5"),
    Corridor(23.0, 7.0),
    Open(25.3, 6.4),
    Open(25.3, 1.4),
    Open(28.7, 1.5),
    Open(28.8, 5.2),
    Open(28.5, 8.7),
    Open(25.2, 8.6),
    Open(23.0, 8.6),
    Visit("east 1"),
    Visit("east 2"),
    Visit("east 3"),
    Visit("east 4"),
    Corridor(23.0, 23.0),
    Visit("north-east"),
    Visit("north 5"),
    Visit("north 4"),
    Visit("north 3"),
    Visit("north 2"),
    Corridor(7.0, 23.0),
    Visit("north 1"),
    Visit("west 5"),
    Visit("west 4"),
    Visit("west 3"),
    Visit("west 2"),
    Visit("west 1"),
    Corridor(7.0, 7.0),
    Visit("south 1"),
    // Through the lab and the inner block.
    Corridor(13.0, 7.0),
    Open(13.0, 9.4),
    Open(14.8, 9.4),
    Open(15.0, 13.0),
    Open(12.0, 12.8),
    Open(12.0, 9.6),
    Open(9.3, 9.4),
    Open(9.2, 13.1),
    Open(11.5, 13.0),
    Corridor(11.5, 15.5),
    Visit("server room"),
    Visit("conference"),
    Corridor(23.0, 15.5),
    Corridor(23.0, 23.0),
    Visit("break room"),
    Corridor(15.0, 23.0),
    Visit("kitchen"),
    Corridor(15.0, 15.5),
    Visit("copy room"),
    Corridor(7.0, 15.5),
    // The north-west loop again, and half of the ring.
    Corridor(7.0, 23.0),
    Corridor(15.0, 23.0),
    Corridor(15.0, 15.5),
    Corridor(7.0, 15.5),
    Corridor(7.0, 7.0),
    Corridor(22.0, 7.0),
];

/// A robot in a corridor keeps to a straight line for at most this long, in m.
const STRAIGHT: f64 = 2.6;

/// Deviation of the robot from its planned points, in m: in corridors, across them; in rooms.
const CORRIDOR_JITTER: f64 = 0.22;
const ROOM_JITTER: f64 = 0.12;

/// Depth in m, behind the centre line of the door's wall, at which the robot is past an open door leaf.
const INSIDE: f64 = 1.5;

/// Distance in m that a tour keeps from the walls of a room: a desk and some air.
const TOUR_MARGIN: f64 = 1.3;

/// How far into a room the robot looks before it backs out, in m.
const LOOK_DEPTH: f64 = 2.6;

/// Distance in m from the centre line of a corridor's wall to the middle of the corridor.
const HALF_CORRIDOR: f64 = 1.0;

/// Where the drive starts, and its legs. The deviations from the route are random.
pub(super) fn route(rng: &mut Rng) -> (Point<2>, Vec<Leg>) {
    let mut route = Route { at: START, legs: Vec::new(), rng };
    for stop in STOPS {
        match *stop {
            Corridor(x, y) => route.along_corridor([x, y]),
            Open(x, y) => {
                let to = route.stray([x, y], ROOM_JITTER);
                route.forward(to);
            }
            Visit(name) => {
                let room = ROOMS.iter().find(|room| room.name == name);
                route.visit(room.expect("every visit names a room of the floor plan"));
            }
        }
    }
    (START, route.legs)
}

struct Route<'a> {
    at: Point<2>,
    legs: Vec<Leg>,
    rng: &'a mut Rng,
}

impl Route<'_> {
    fn forward(&mut self, to: Point<2>) {
        self.legs.push(Leg { to, backward: false });
        self.at = to;
    }

    fn jitter(&mut self, limit: f64) -> f64 {
        self.rng.random_range(-limit..=limit)
    }

    fn stray(&mut self, point: Point<2>, limit: f64) -> Point<2> {
        point.map(|value| value + self.jitter(limit))
    }

    /// Weaves along a corridor to a point near `to`.
    fn along_corridor(&mut self, to: Point<2>) {
        let to = self.stray(to, CORRIDOR_JITTER);
        self.weave(to);
    }

    /// Straight pieces to exactly `to`, deviating sideways in between.
    fn weave(&mut self, to: Point<2>) {
        let from = self.at;
        let offset = [to[0] - from[0], to[1] - from[1]];
        let length = math::hypot(offset[0], offset[1]);
        let pieces = (length / STRAIGHT).ceil().max(1.0) as usize;
        for piece in 1..pieces {
            let fraction = piece as f64 / pieces as f64;
            let across = self.jitter(CORRIDOR_JITTER) / length;
            self.forward([
                from[0] + fraction * offset[0] - across * offset[1],
                from[1] + fraction * offset[1] + across * offset[0],
            ]);
        }
        self.forward(to);
    }

    /// Along the corridor to the room's door, in, around, and out again.
    fn visit(&mut self, room: &Room) {
        let front = room.doorway(-HALF_CORRIDOR + self.jitter(CORRIDOR_JITTER));
        self.weave(front);
        let ([low, high], depth) = room.along_and_depth();
        let inside = room.doorway(INSIDE);
        let middle = 0.5 * (low + high);
        if room.tour == Tour::BackOut {
            let look = room.doorway(LOOK_DEPTH);
            self.forward(look);
            self.legs.push(Leg { to: front, backward: true });
            self.at = front;
            return;
        }
        self.forward(inside);
        if room.tour == Tour::TurnAround {
            let far = self.stray(room.door_point(middle, depth - TOUR_MARGIN), ROOM_JITTER);
            self.forward(far);
        } else {
            // Anticlockwise begins on the right-hand side.
            let (low, high) = (low + TOUR_MARGIN, high - TOUR_MARGIN);
            let right_first = room.tour == Tour::Left;
            let (first, second) =
                if right_first == room.along_is_right() { (high, low) } else { (low, high) };
            let far = depth - TOUR_MARGIN;
            for (along, depth) in [(first, INSIDE), (first, far), (second, far), (second, INSIDE)] {
                let corner = self.stray(room.door_point(along, depth), ROOM_JITTER);
                self.forward(corner);
            }
        }
        self.forward(inside);
        let out = room.doorway(-HALF_CORRIDOR + self.jitter(CORRIDOR_JITTER));
        self.forward(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_room_is_visited_once() {
        let mut visits: Vec<&str> = STOPS
            .iter()
            .filter_map(|s| if let Visit(name) = s { Some(*name) } else { None })
            .collect();
        let mut rooms: Vec<&str> = ROOMS.iter().map(|room| room.name).collect();
        visits.sort_unstable();
        rooms.sort_unstable();
        assert_eq!(visits, rooms);
    }
}
