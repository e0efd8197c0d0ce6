use mcl_core::{Bounds, Point, math};

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// Returns every beam.
    Opaque,
    /// Sometimes lets a beam through.
    Glass,
}

/// A straight surface, seen from both sides. Metres, in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// One end.
    pub from: Point<2>,
    /// The other end.
    pub to: Point<2>,
    /// What it is made of.
    pub material: Material,
}

/// An opaque round surface. Metres, in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre.
    pub center: Point<2>,
    /// Radius, positive.
    pub radius: f64,
}

/// Surfaces at the height of the laser: a whole building, or one piece of furniture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Obstacles {
    segments: Vec<Segment>,
    circles: Vec<Circle>,
}

impl Segment {
    /// Distance from a point to the nearest point of the segment, in m.
    pub fn distance(&self, point: Point<2>) -> f64 {
        let along = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let offset = [point[0] - self.from[0], point[1] - self.from[1]];
        let length_squared = along[0] * along[0] + along[1] * along[1];
        let fraction = if length_squared > 0.0 {
            ((offset[0] * along[0] + offset[1] * along[1]) / length_squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        math::hypot(offset[0] - fraction * along[0], offset[1] - fraction * along[1])
    }
}

impl Circle {
    /// Distance from a point to the circle's disc, in m; 0 inside.
    pub fn distance(&self, point: Point<2>) -> f64 {
        (math::hypot(point[0] - self.center[0], point[1] - self.center[1]) - self.radius).max(0.0)
    }
}

impl Obstacles {
    /// The straight surfaces.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// The round surfaces.
    pub fn circles(&self) -> &[Circle] {
        &self.circles
    }

    /// The smallest box around all surfaces; `None` when there are none.
    pub fn bounds(&self) -> Option<Bounds<2>> {
        let ends = self.segments.iter().flat_map(|segment| [segment.from, segment.to]);
        let corners = self.circles.iter().flat_map(|circle| {
            let ([x, y], r) = (circle.center, circle.radius);
            [[x - r, y - r], [x + r, y + r]]
        });
        Bounds::of(&ends.chain(corners).collect::<Vec<_>>())
    }

    /// Distance from a point to the nearest surface in m; infinite when there are none. The inside
    /// of a box of four segments counts as free.
    pub fn clearance(&self, point: Point<2>) -> f64 {
        let segments = self.segments.iter().map(|segment| segment.distance(point));
        let circles = self.circles.iter().map(|circle| circle.distance(point));
        segments.chain(circles).fold(f64::INFINITY, f64::min)
    }

    /// Adds an opaque segment.
    pub(super) fn add_segment(&mut self, from: Point<2>, to: Point<2>) {
        self.segments.push(Segment { from, to, material: Material::Opaque });
    }

    /// Adds a pane of glass.
    pub(super) fn add_glass(&mut self, from: Point<2>, to: Point<2>) {
        self.segments.push(Segment { from, to, material: Material::Glass });
    }

    /// Adds a circle of the given radius (m).
    pub(super) fn add_circle(&mut self, center: Point<2>, radius: f64) {
        self.circles.push(Circle { center, radius });
    }

    /// Adds the outline of a box through its corners, in order.
    pub(super) fn add_box(&mut self, corners: [Point<2>; 4]) {
        for i in 0..4 {
            self.add_segment(corners[i], corners[(i + 1) % 4]);
        }
    }

    /// Adds all surfaces of `other`.
    pub(super) fn add(&mut self, other: Obstacles) {
        self.segments.extend(other.segments);
        self.circles.extend(other.circles);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clearance_is_the_distance_to_the_nearest_surface() {
        let mut obstacles = Obstacles::default();
        assert_eq!(obstacles.clearance([0.0, 0.0]), f64::INFINITY);
        assert_eq!(obstacles.bounds(), None);
        obstacles.add_segment([2.0, -1.0], [2.0, 1.0]);
        obstacles.add_circle([0.0, 5.0], 1.0);
        assert_eq!(obstacles.clearance([0.0, 0.0]), 2.0);
        assert_eq!(obstacles.clearance([5.0, 5.0]), 4.0);
        assert_eq!(obstacles.clearance([0.0, 5.5]), 0.0);
        let bounds = obstacles.bounds().unwrap();
        assert_eq!((bounds.min, bounds.max), ([-1.0, -1.0], [2.0, 6.0]));
        // Beyond the end of a segment, the end is nearest: a 3-4-5 triangle.
        assert_eq!(obstacles.segments()[0].distance([5.0, -5.0]), 5.0);
    }
}
