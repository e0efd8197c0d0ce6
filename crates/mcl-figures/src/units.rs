//! Lengths on the page: SVG units, plotters' whole numbers, and pixels.

/// Width of a figure (SVG user units): at a text width of 160 mm, letters of 12 units are 2.5 mm.
pub(crate) const WIDTH: f64 = 760.0;
/// Width of a figure in a column of a paper of 3.5 inches: letters of 12 units are 8 points.
pub(crate) const COLUMN: f64 = 380.0;
/// SVG units of an inch in a paper.
pub(crate) const UNITS_PER_INCH: f32 = 380.0 / 3.5;
/// Pixels of the PNG, and of embedded pictures, per SVG unit: about 360 dpi at 160 mm.
pub(crate) const PIXELS_PER_UNIT: f32 = 3.0;
/// plotters' whole numbers per SVG unit.
const SCALE: f64 = 100.0;

/// A length or place in SVG units as plotters counts it.
pub(crate) fn units(length: f64) -> i32 {
    (length * SCALE).round() as i32
}

/// A length or place counted by plotters in SVG units.
pub(crate) fn svg_units(length: impl Into<f64>) -> f64 {
    length.into() / SCALE
}
