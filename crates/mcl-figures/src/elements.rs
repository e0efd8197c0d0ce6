//! Elements that plotters lacks: lines beyond the chart's edges, dashes, symbols.

use plotters::coord::CoordTranslate;
use plotters::drawing::Rect;
use plotters::element::{
    Circle, CoordMapper, Drawable, DynElement, EmptyElement, IntoDynElement, PathElement,
    PointCollection, Polygon,
};
use plotters::style::{Color, WHITE};
use plotters_backend::{BackendCoord, DrawingBackend, DrawingErrorKind};

use crate::canvas::Canvas;
use crate::style::{CurveStyle, Dash, stroke};
use crate::units::units;

const CIRCLE_RADIUS: f64 = 3.6;

/// Leaves places outside of a chart where they are. plotters moves them to its edge, which bends
/// every line that leaves the chart.
pub(crate) struct Unclipped;

impl CoordMapper for Unclipped {
    type Output = BackendCoord;

    fn map<CT: CoordTranslate>(coordinates: &CT, from: &CT::From, _: &Rect) -> BackendCoord {
        coordinates.translate(from)
    }
}

/// An element that may leave its chart; the canvas clips it.
pub(crate) struct Clipped<E>(pub(crate) E, pub(crate) Dash);

impl<'a, C, E> PointCollection<'a, C, Unclipped> for &'a Clipped<E>
where
    &'a E: PointCollection<'a, C>,
{
    type Point = <&'a E as PointCollection<'a, C>>::Point;
    type IntoIter = <&'a E as PointCollection<'a, C>>::IntoIter;

    fn point_iter(self) -> Self::IntoIter {
        self.0.point_iter()
    }
}

impl<E: Drawable<Canvas>> Drawable<Canvas, Unclipped> for Clipped<E> {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        places: I,
        canvas: &mut Canvas,
        size: (u32, u32),
    ) -> Result<(), DrawingErrorKind<<Canvas as DrawingBackend>::ErrorType>> {
        canvas.dashes = self.1.lengths();
        let drawn = self.0.draw(places, canvas, size);
        canvas.dashes = Dash::Solid.lengths();
        drawn
    }
}

/// The symbol of a curve at one of its points, if it has one; an open one is white inside.
pub(crate) fn symbol<C: Clone + 'static>(
    at: C,
    style: CurveStyle,
    open: bool,
) -> Option<DynElement<'static, Canvas, C>> {
    let marker = style.marker?;
    let color = style.rgb();
    let (fill, outline) =
        if open { (WHITE, stroke(color, 1.5)) } else { (color, stroke(WHITE, 0.8)) };
    let at = EmptyElement::at(at);
    let corner = |[x, y]: &[f64; 2]| (units(*x), units(*y));
    let mut corners: Vec<_> = marker.corners().iter().map(corner).collect();
    if corners.is_empty() {
        let radius = units(CIRCLE_RADIUS);
        let circle = |style| Circle::new((0, 0), radius, style);
        return Some((at + circle(fill.filled()) + circle(outline)).into_dyn());
    }
    let area = Polygon::new(corners.clone(), fill);
    // Past the first corner, so that it is joined like the others.
    corners.extend_from_within(..2);
    Some((at + area + PathElement::new(corners, outline)).into_dyn())
}
