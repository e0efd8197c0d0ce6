use mcl_core::{Bounds, Point, math};

use super::obstacles::{Circle, Material, Obstacles, Segment};

/// Edge of a grid cell in m: about the size of a piece of furniture.
const CELL: f64 = 0.5;

/// Surfaces are enlarged by this (m) when they are sorted into cells, so that rounding at a grid line loses
/// none.
const MARGIN: f64 = 1e-6;

/// A ray that meets the end of a segment this close (in lengths of the segment) still hits it, so
/// that rounding opens no slit between two walls that share a corner.
const END_TOLERANCE: f64 = 1e-9;

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// Distance along the ray, in m.
    pub distance: f64,
    /// |cos i| of the angle of incidence *i*, measured from the surface's normal.
    pub incidence_cos: f64,
    /// What was hit.
    pub material: Material,
    /// Which surface it was: segments count from 0, circles on from there.
    pub surface: usize,
}

/// Exact ray casting against segments and circles, accelerated by a uniform grid.
pub(super) struct RayCaster<'a> {
    obstacles: &'a Obstacles,
    bounds: Bounds<2>,
    columns: usize,
    rows: usize,
    /// Surfaces whose bounding box touches a cell, row by row: segments count from 0, circles on
    /// from there.
    cells: Vec<Vec<usize>>,
}

impl<'a> RayCaster<'a> {
    /// Indexes the surfaces.
    pub fn new(obstacles: &'a Obstacles) -> Self {
        let bounds = obstacles.bounds().unwrap_or(Bounds { min: [0.0; 2], max: [0.0; 2] });
        let count = |axis| (bounds.extent(axis) / CELL) as usize + 1;
        let (columns, rows) = (count(0), count(1));
        let mut caster =
            RayCaster { obstacles, bounds, columns, rows, cells: vec![vec![]; columns * rows] };
        let segments = obstacles.segments();
        for (index, Segment { from, to, .. }) in segments.iter().enumerate() {
            caster.insert(index, [*from, *to]);
        }
        for (index, Circle { center: [x, y], radius }) in obstacles.circles().iter().enumerate() {
            let corners = [[x - radius, y - radius], [x + radius, y + radius]];
            caster.insert(segments.len() + index, corners);
        }
        caster
    }

    /// The nearest surface from `origin` in the direction `angle` (rad), at a distance greater than
    /// `beyond` (m).
    pub fn first_hit(&self, origin: Point<2>, angle: f64, beyond: f64) -> Option<Hit> {
        let (sin, cos) = math::sin_cos(angle);
        let direction = [cos, sin];
        let enter = self.enter(origin, direction, beyond)?;
        let start = std::array::from_fn(|axis| origin[axis] + enter * direction[axis]);
        let mut cell = self.cell(start).map(|c| c as isize);
        // Distance to the next grid line per axis, and from one line to the next.
        let step = direction.map(|d| if d < 0.0 { -1isize } else { 1 });
        let spacing = direction.map(|d| CELL / d.abs());
        let mut next: [f64; 2] = std::array::from_fn(|axis| {
            let line = (cell[axis] + isize::from(step[axis] > 0)) as f64 * CELL;
            let distance = (self.bounds.min[axis] + line - origin[axis]) / direction[axis];
            if distance.is_finite() { distance } else { f64::INFINITY }
        });
        let mut nearest: Option<Hit> = None;
        loop {
            let index = cell[1] as usize * self.columns + cell[0] as usize;
            for &surface in &self.cells[index] {
                let hit = self.hit(surface, origin, direction, beyond);
                if let Some(hit) = hit
                    && nearest.is_none_or(|nearest| hit.distance < nearest.distance)
                {
                    nearest = Some(hit);
                }
            }
            let axis = usize::from(next[1] < next[0]);
            // A surface may reach into this cell and be hit in a later one: only a hit before the ray leaves
            // the cell is known to be the nearest.
            if nearest.is_some_and(|nearest| nearest.distance <= next[axis]) {
                return nearest;
            }
            cell[axis] += step[axis];
            next[axis] += spacing[axis];
            let size = if axis == 0 { self.columns } else { self.rows };
            if cell[axis] < 0 || cell[axis] >= size as isize {
                return nearest;
            }
        }
    }

    /// Column and row of a point, clamped to the grid.
    fn cell(&self, point: Point<2>) -> [usize; 2] {
        // A float cast saturates, so that points below the grid are put into cell 0.
        let index = |axis: usize| ((point[axis] - self.bounds.min[axis]) / CELL) as usize;
        [index(0).min(self.columns - 1), index(1).min(self.rows - 1)]
    }

    fn insert(&mut self, surface: usize, [a, b]: [Point<2>; 2]) {
        let low = self.cell([a[0].min(b[0]) - MARGIN, a[1].min(b[1]) - MARGIN]);
        let high = self.cell([a[0].max(b[0]) + MARGIN, a[1].max(b[1]) + MARGIN]);
        for row in low[1]..=high[1] {
            for column in low[0]..=high[0] {
                self.cells[row * self.columns + column].push(surface);
            }
        }
    }

    /// Distance at which the ray enters the bounding box, or `beyond` when it is inside there; `None`
    /// when it misses the box.
    fn enter(&self, origin: Point<2>, direction: [f64; 2], beyond: f64) -> Option<f64> {
        let (mut enter, mut leave) = (beyond.max(0.0), f64::INFINITY);
        for axis in 0..2 {
            let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
            if direction[axis] == 0.0 {
                if origin[axis] < min - MARGIN || origin[axis] > max + MARGIN {
                    return None;
                }
                continue;
            }
            let to_min = (min - origin[axis]) / direction[axis];
            let to_max = (max - origin[axis]) / direction[axis];
            enter = enter.max(to_min.min(to_max));
            leave = leave.min(to_min.max(to_max));
        }
        // Rounding must not lose a ray along the edge of the box.
        (enter <= leave + MARGIN).then_some(enter)
    }

    fn hit(
        &self,
        surface: usize,
        origin: Point<2>,
        direction: [f64; 2],
        beyond: f64,
    ) -> Option<Hit> {
        let segments = self.obstacles.segments();
        let hit = match segments.get(surface) {
            Some(segment) => hit_segment(segment, origin, direction),
            None => hit_circle(
                &self.obstacles.circles()[surface - segments.len()],
                origin,
                direction,
                beyond,
            ),
        };
        hit.filter(|hit| hit.distance > beyond).map(|hit| Hit { surface, ..hit })
    }
}

/// Solves `origin + t·direction = from + u·(to − from)`.
fn hit_segment(segment: &Segment, origin: Point<2>, direction: [f64; 2]) -> Option<Hit> {
    let along = [segment.to[0] - segment.from[0], segment.to[1] - segment.from[1]];
    let offset = [segment.from[0] - origin[0], segment.from[1] - origin[1]];
    let denominator = cross(direction, along);
    if denominator == 0.0 {
        return None;
    }
    let u = cross(offset, direction) / denominator;
    (-END_TOLERANCE..=1.0 + END_TOLERANCE).contains(&u).then(|| Hit {
        distance: cross(offset, along) / denominator,
        incidence_cos: denominator.abs() / math::hypot(along[0], along[1]),
        material: segment.material,
        surface: 0,
    })
}

/// The near side of the circle, or the far side when the near one is not beyond `beyond`.
fn hit_circle(circle: &Circle, origin: Point<2>, direction: [f64; 2], beyond: f64) -> Option<Hit> {
    let offset = [circle.center[0] - origin[0], circle.center[1] - origin[1]];
    let along = offset[0] * direction[0] + offset[1] * direction[1];
    let across = cross(direction, offset);
    let half_chord_squared = circle.radius * circle.radius - across * across;
    if half_chord_squared < 0.0 {
        return None;
    }
    let half_chord = half_chord_squared.sqrt();
    let near = along - half_chord;
    Some(Hit {
        distance: if near > beyond { near } else { along + half_chord },
        incidence_cos: half_chord / circle.radius,
        material: Material::Opaque,
        surface: 0,
    })
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;
    use rand::RngExt;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

    /// A room of 4 m × 3 m with a pillar of radius 0.5 m at (3, 1) and a pane of glass at x = 1.
    fn room() -> Obstacles {
        let mut room = Obstacles::default();
        room.add_box([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]);
        room.add_circle([3.0, 1.0], 0.5);
        room.add_glass([1.0, 0.0], [1.0, 3.0]);
        room
    }

    fn distance(caster: &RayCaster, origin: Point<2>, angle: f64) -> f64 {
        caster.first_hit(origin, angle, 0.0).unwrap().distance
    }

    #[test]
    fn walls_and_pillars_lie_where_geometry_says() {
        let room = room();
        let caster = RayCaster::new(&room);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} is not {b}");
        close(distance(&caster, [2.0, 2.0], FRAC_PI_2), 1.0);
        close(distance(&caster, [2.0, 2.0], 0.0), 2.0);
        // The corner region: 1 m up the diagonal is √2.
        close(distance(&caster, [2.0, 2.0], FRAC_PI_4), 2f64.sqrt());
        // Head on, the pillar begins 0.5 m before its centre.
        close(distance(&caster, [2.0, 1.0], 0.0), 0.5);
        // At 0.3 m beside the axis, the half chord is 0.4 m (3-4-5).
        close(distance(&caster, [2.0, 1.3], 0.0), 0.6);
        // 0.6 m beside the axis the ray passes the pillar and meets the wall.
        close(distance(&caster, [2.0, 1.6], 0.0), 2.0);
        // From outside the box.
        close(distance(&caster, [-3.0, 1.5], 0.0), 3.0);
        assert_eq!(caster.first_hit([-3.0, 1.5], PI, 0.0), None);
        assert_eq!(caster.first_hit([-3.0, 5.0], 0.0, 0.0), None);
        assert_eq!(caster.first_hit([1.0, 1.0], f64::NAN, 0.0), None);
    }

    #[test]
    fn incidence_and_what_lies_behind_are_known() {
        let room = room();
        let caster = RayCaster::new(&room);
        let pane = caster.first_hit([2.0, 1.5], PI, 0.0).unwrap();
        assert_eq!(pane.material, Material::Glass);
        assert!((pane.distance - 1.0).abs() < 1e-12 && (pane.incidence_cos - 1.0).abs() < 1e-12);
        let behind = caster.first_hit([2.0, 1.5], PI, pane.distance).unwrap();
        assert_eq!(behind.material, Material::Opaque);
        assert!((behind.distance - 2.0).abs() < 1e-12);
        let oblique = caster.first_hit([2.0, 1.5], PI - FRAC_PI_4, 0.0).unwrap();
        assert!((oblique.incidence_cos - FRAC_PI_4.cos()).abs() < 1e-12);
    }

    #[test]
    fn the_grid_changes_nothing() {
        let mut rng = Seed::new(3).derive("ray test").rng();
        let mut obstacles = Obstacles::default();
        for _ in 0..200 {
            let from: [f64; 2] = std::array::from_fn(|_| rng.random_range(0.0..20.0));
            let to = from.map(|value| value + rng.random_range(-3.0..3.0));
            obstacles.add_segment(from, to);
            let center = std::array::from_fn(|_| rng.random_range(0.0..20.0));
            obstacles.add_circle(center, rng.random_range(0.01..0.5));
        }
        let caster = RayCaster::new(&obstacles);
        let surfaces = obstacles.segments().len() + obstacles.circles().len();
        let mut hits = 0;
        for _ in 0..5000 {
            let origin = std::array::from_fn(|_| rng.random_range(-2.0..22.0));
            let angle: f64 = rng.random_range(0.0..TAU);
            let beyond = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..10.0) };
            let direction = [math::cos(angle), math::sin(angle)];
            let expected = (0..surfaces)
                .filter_map(|surface| caster.hit(surface, origin, direction, beyond))
                .map(|hit| hit.distance)
                .fold(f64::INFINITY, f64::min);
            let found =
                caster.first_hit(origin, angle, beyond).map_or(f64::INFINITY, |hit| hit.distance);
            assert_eq!(found, expected, "{origin:?} {angle} {beyond}");
            hits += usize::from(found.is_finite());
        }
        assert!(hits > 3000, "only {hits} of 5000 rays hit anything");
    }
}
