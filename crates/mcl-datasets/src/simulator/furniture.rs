//! Furniture: randomly drawn pieces, kept where they block neither the robot's path nor another piece.

use std::f64::consts::{FRAC_PI_2, TAU};

use mcl_core::{Bounds, Point, Pose2, Rng, math};
use rand::RngExt;

use super::obstacles::Obstacles;

/// Furniture keeps this distance from the centre of the robot's path, in m.
const PATH_CLEARANCE: f64 = 0.4;

/// Pieces stand this far apart, in m.
const GAP: f64 = 0.05;

/// A piece of furniture in its own frame, facing +x.
struct Piece {
    shape: Vec<Part>,
    /// Whether it stands with its back, which is then at the origin, to a wall.
    against_wall: bool,
}

enum Part {
    /// A box between two corners, in the piece's frame.
    Box(Point<2>, Point<2>),
    /// A round part: centre and radius.
    Round(Point<2>, f64),
}

/// Furnishes a floor: tries `density` pieces per m² and keeps those that fit. `path` holds positions
/// along the robot's path at most 0.1 m apart; `structure` is the building without furniture.
pub(super) fn furnish(
    floor: &Bounds<2>,
    density: f64,
    path: &[Point<2>],
    structure: &Obstacles,
    rng: &mut Rng,
) -> Obstacles {
    let surroundings = grown(floor, 2.0 * PATH_CLEARANCE);
    let point = |p: &Point<2>| Bounds { min: *p, max: *p };
    let path: Vec<Point<2>> =
        path.iter().copied().filter(|p| overlap(&surroundings, &point(p))).collect();
    let mut taken: Vec<Bounds<2>> =
        boxes(structure).filter(|taken| overlap(floor, taken)).collect();
    let tries = (density * floor.extent(0) * floor.extent(1)).round() as usize;
    let mut furniture = Obstacles::default();
    for _ in 0..tries {
        let piece = draw_piece(rng);
        let map_from_piece =
            if piece.against_wall { at_wall(floor, rng) } else { anywhere(floor, rng) };
        let placed = place(&piece, &map_from_piece);
        let Some(bounds) = placed.bounds() else { continue };
        if contains(floor, &bounds)
            && !taken.iter().any(|taken| overlap(taken, &bounds))
            && path.iter().all(|&position| placed.clearance(position) >= PATH_CLEARANCE)
        {
            taken.push(grown(&bounds, GAP));
            furniture.add(placed);
        }
    }
    furniture
}

/// A random kind of office furniture, with random sizes.
fn draw_piece(rng: &mut Rng) -> Piece {
    match rng.random_range(0..9) {
        0 | 1 => desk(rng),
        2 | 3 => {
            // A cabinet or a shelf.
            let (half, depth) = (rng.random_range(0.3..0.7), rng.random_range(0.3..0.45));
            Piece { shape: vec![Part::Box([0.0, -half], [depth, half])], against_wall: true }
        }
        4 => {
            // A carton or a computer on the floor.
            let (half, depth) = (rng.random_range(0.1..0.3), rng.random_range(0.2..0.5));
            Piece { shape: vec![Part::Box([0.0, -half], [depth, half])], against_wall: false }
        }
        5 => Piece {
            // A waste bin or a plant pot.
            shape: vec![Part::Round([0.0, 0.0], rng.random_range(0.12..0.22))],
            against_wall: false,
        },
        6 => {
            // A table on four legs.
            let (x, y) = (rng.random_range(0.35..0.45), rng.random_range(0.5..0.8));
            legs(x, y, rng.random_range(0.02..0.035))
        }
        7 => legs(0.2, 0.2, rng.random_range(0.01..0.02)), // A chair.
        _ => swivel_chair(),
    }
}

/// A desk with its back to the wall: a drawer unit at one end, a panel at the other.
fn desk(rng: &mut Rng) -> Piece {
    let (half, depth) = (rng.random_range(0.6..0.8), rng.random_range(0.6..0.75));
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let drawers = Part::Box([0.0, side * half], [depth, side * (half - 0.42)]);
    let panel = Part::Box([0.0, -side * half], [depth, -side * (half - 0.03)]);
    Piece { shape: vec![drawers, panel], against_wall: true }
}

fn legs(x: f64, y: f64, radius: f64) -> Piece {
    let corners = [[x, y], [-x, y], [-x, -y], [x, -y]];
    let shape = corners.map(|corner| Part::Round(corner, radius)).into();
    Piece { shape, against_wall: false }
}

/// A column over five castors.
fn swivel_chair() -> Piece {
    let castor = |i: i32| {
        let (sin, cos) = math::sin_cos(f64::from(i) * TAU / 5.0);
        Part::Round([0.28 * cos, 0.28 * sin], 0.03)
    };
    let mut shape: Vec<Part> = (0..5).map(castor).collect();
    shape.push(Part::Round([0.0, 0.0], 0.04));
    Piece { shape, against_wall: false }
}

/// A place with the back to one of the four walls.
fn at_wall(floor: &Bounds<2>, rng: &mut Rng) -> Pose2 {
    let x = rng.random_range(floor.min[0]..floor.max[0]);
    let y = rng.random_range(floor.min[1]..floor.max[1]);
    // Not quite touching: furniture is never flush.
    let gap = rng.random_range(0.01..0.06);
    let turn = rng.random_range(-0.03..0.03);
    match rng.random_range(0..4) {
        0 => Pose2::new(floor.min[0] + gap, y, turn),
        1 => Pose2::new(x, floor.min[1] + gap, FRAC_PI_2 + turn),
        2 => Pose2::new(floor.max[0] - gap, y, 2.0 * FRAC_PI_2 + turn),
        _ => Pose2::new(x, floor.max[1] - gap, 3.0 * FRAC_PI_2 + turn),
    }
}

fn anywhere(floor: &Bounds<2>, rng: &mut Rng) -> Pose2 {
    Pose2::new(
        rng.random_range(floor.min[0]..floor.max[0]),
        rng.random_range(floor.min[1]..floor.max[1]),
        rng.random_range(0.0..TAU),
    )
}

fn place(piece: &Piece, map_from_piece: &Pose2) -> Obstacles {
    let mut placed = Obstacles::default();
    for part in &piece.shape {
        match *part {
            Part::Box([x0, y0], [x1, y1]) => {
                let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
                placed.add_box(corners.map(|corner| map_from_piece.transform_point(corner)));
            }
            Part::Round(center, radius) => {
                placed.add_circle(map_from_piece.transform_point(center), radius);
            }
        }
    }
    placed
}

/// The box around each surface.
fn boxes(obstacles: &Obstacles) -> impl Iterator<Item = Bounds<2>> + '_ {
    let segments = obstacles.segments().iter().map(|segment| Bounds {
        min: [segment.from[0].min(segment.to[0]), segment.from[1].min(segment.to[1])],
        max: [segment.from[0].max(segment.to[0]), segment.from[1].max(segment.to[1])],
    });
    let circles = obstacles.circles().iter().map(|circle| Bounds {
        min: circle.center.map(|value| value - circle.radius),
        max: circle.center.map(|value| value + circle.radius),
    });
    segments.chain(circles)
}

fn grown(bounds: &Bounds<2>, margin: f64) -> Bounds<2> {
    Bounds { min: bounds.min.map(|v| v - margin), max: bounds.max.map(|v| v + margin) }
}

fn overlap(a: &Bounds<2>, b: &Bounds<2>) -> bool {
    (0..2).all(|axis| a.min[axis] < b.max[axis] && a.max[axis] > b.min[axis])
}

fn contains(outer: &Bounds<2>, inner: &Bounds<2>) -> bool {
    (0..2).all(|axis| inner.min[axis] >= outer.min[axis] && inner.max[axis] <= outer.max[axis])
}
