//! Point clouds and paths as pictures.

use mcl_core::memory::{OutOfMemory, check_room};
use plotters::style::{RGBColor, WHITE};
use resvg::tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, PremultipliedColorU8, Stroke,
    StrokeDash, Transform,
};

use crate::style::{CurveStyle, LINE, shade_color};
use crate::units::PIXELS_PER_UNIT;

/// A place in SVG units from the corner of a window, y downwards.
pub(crate) type Position = [f64; 2];

/// More points than this are drawn as a density, fewer as dots.
const MOST_DOTS: usize = 50_000;
/// At most so much memory is taken at once for a pixel: four bytes each while it is drawn, counted and
/// sorted; then three of a colour, and four each as it is embedded, copied and packed.
const BYTES_PER_PIXEL: usize = 16;
/// Colour of a point that has no shade.
const DOT: RGBColor = RGBColor(20, 20, 20);
/// Darkness of a pixel that holds a single point, so that it can be seen in print.
const FAINTEST: f32 = 0.38;
/// Share of the pixels with points that may be fully dark.
const DARKEST_SHARE: f64 = 0.02;

/// A transparent picture of a window.
pub(crate) struct Raster {
    pixels: Pixmap,
}

impl Raster {
    /// A picture of a window of this size (SVG units); `None` if there can be none.
    ///
    /// # Errors
    /// When there is no memory for it, or for drawing and embedding it.
    pub(crate) fn new(width: f64, height: f64) -> Result<Option<Self>, OutOfMemory> {
        let pixels = |length: f64| (length as f32 * PIXELS_PER_UNIT).round().max(1.0) as u32;
        let (width, height) = (pixels(width), pixels(height));
        let number = (width as usize).saturating_mul(height as usize);
        check_room(number, BYTES_PER_PIXEL, "pixels of a point cloud")?;
        Ok(Pixmap::new(width, height).map(|pixels| Raster { pixels }))
    }

    /// Draws points.
    pub(crate) fn draw_points(&mut self, points: &[Position]) {
        if points.len() <= MOST_DOTS {
            self.draw_dots(points);
        } else {
            self.draw_density(points);
        }
    }

    fn draw_dots(&mut self, points: &[Position]) {
        // Fewer points get larger dots (2 units at 300 points, 1.1 at 6,000); a picture of half the
        // width gets smaller ones.
        let size = (self.pixels.width() as f32 / 1800.0).sqrt().clamp(0.6, 1.0);
        let radius = 2.0 * (300.0 / points.len().max(300) as f32).powf(0.2) * size;
        points.iter().for_each(|&at| self.draw_dot(at, radius, DOT));
    }

    /// Draws points in their shades, from 0 to 1, later ones over earlier ones.
    pub(crate) fn draw_shaded(&mut self, points: &[Position], shades: &[f64]) {
        let radius = 1.9 * (300.0 / points.len().max(300) as f32).powf(0.2);
        for (&at, &shade) in points.iter().zip(shades) {
            self.draw_dot(at, radius, shade_color(shade));
        }
    }

    fn draw_dot(&mut self, at: Position, radius: f32, color: RGBColor) {
        let [x, y] = pixels(at);
        if let Some(dot) = PathBuilder::from_circle(x, y, radius * PIXELS_PER_UNIT) {
            let untouched = Transform::identity();
            self.pixels.fill_path(&dot, &paint(color), FillRule::Winding, untouched, None);
        }
    }

    /// Darkness by the number of points: logarithmic, because walls seen in thousands of scans hold
    /// a thousand times as many points as those seen once.
    fn draw_density(&mut self, points: &[Position]) {
        let (width, height) = (self.pixels.width() as usize, self.pixels.height() as usize);
        let mut counts = vec![0_u32; width * height];
        let scale = f64::from(PIXELS_PER_UNIT);
        // Each point covers a few pixels; one alone would vanish in print.
        let side = if points.len() <= 300_000 { 3 } else { 2 };
        for &[x, y] in points {
            let corner = |place: f64| (place * scale - 0.5 * (side as f64 - 1.0)).round() as isize;
            for (x, y) in (0..side * side).map(|i| (corner(x) + i % side, corner(y) + i / side)) {
                if (0..width as isize).contains(&x) && (0..height as isize).contains(&y) {
                    counts[y as usize * width + x as usize] += 1;
                }
            }
        }
        let mut held: Vec<u32> = counts.iter().copied().filter(|&count| count > 0).collect();
        held.sort_unstable();
        let darkest = ((1.0 - DARKEST_SHARE) * held.len() as f64) as usize;
        let full = held.get(darkest).copied().unwrap_or(1).max(2) as f32;
        for (pixel, &count) in self.pixels.pixels_mut().iter_mut().zip(&counts) {
            if count > 0 {
                let part = ((count as f32).ln() / full.ln()).min(1.0);
                let alpha = (255.0 * (FAINTEST + (1.0 - FAINTEST) * part)) as u8;
                if let Some(black) = PremultipliedColorU8::from_rgba(0, 0, 0, alpha) {
                    *pixel = black;
                }
            }
        }
    }

    /// Draws a line through places.
    pub(crate) fn draw_path(&mut self, places: &[Position], style: CurveStyle) {
        let mut path = PathBuilder::new();
        for (index, [x, y]) in places.iter().copied().map(pixels).enumerate() {
            match index {
                0 => path.move_to(x, y),
                _ => path.line_to(x, y),
            }
        }
        let Some(path) = path.finish() else { return };
        let dashes = style.dash.lengths().iter().map(|length| length * PIXELS_PER_UNIT).collect();
        let stroke = Stroke {
            width: LINE as f32 * PIXELS_PER_UNIT,
            line_cap: LineCap::Butt,
            line_join: LineJoin::Round,
            dash: StrokeDash::new(dashes, 0.0),
            ..Stroke::default()
        };
        self.pixels.stroke_path(&path, &paint(style.rgb()), &stroke, Transform::identity(), None);
    }

    /// Draws a ring around a place, on white, so that it is seen over points and paths.
    pub(crate) fn draw_ring(&mut self, at: Position) {
        const RADIUS: f32 = 5.0 * PIXELS_PER_UNIT;
        let [x, y] = pixels(at);
        let Some(ring) = PathBuilder::from_circle(x, y, RADIUS) else { return };
        let untouched = Transform::identity();
        for (color, width) in [(WHITE, 2.4), (DOT, 1.4)] {
            let stroke =
                Stroke { width: width * LINE as f32 * PIXELS_PER_UNIT, ..Stroke::default() };
            self.pixels.stroke_path(&ring, &paint(color), &stroke, untouched, None);
        }
    }

    /// The size in pixels, and red, green and blue of each, on white paper.
    pub(crate) fn into_rgb(self) -> ((u32, u32), Vec<u8>) {
        let on_paper = |pixel: &PremultipliedColorU8| {
            let paper = u8::MAX - pixel.alpha();
            [pixel.red(), pixel.green(), pixel.blue()].map(|part| part.saturating_add(paper))
        };
        let size = (self.pixels.width(), self.pixels.height());
        (size, self.pixels.pixels().iter().flat_map(on_paper).collect())
    }
}

fn pixels(place: Position) -> [f32; 2] {
    place.map(|length| length as f32 * PIXELS_PER_UNIT)
}

fn paint(color: RGBColor) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(color.0, color.1, color.2, u8::MAX);
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    /// It was asked for without a check, which ends the program where memory is short.
    #[test]
    fn a_picture_without_memory_is_refused() {
        let refused = Raster::new(1e7, 1e7).err().expect("no machine has so much");
        assert_eq!(refused.bytes, 30_000_000 * 30_000_000 * BYTES_PER_PIXEL);
        let (size, pixels) = Raster::new(10.0, 5.0).unwrap().unwrap().into_rgb();
        assert_eq!((size, pixels), ((30, 15), vec![u8::MAX; 30 * 15 * 3]));
    }
}
