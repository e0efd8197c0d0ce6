//! Colours, dashes and markers that stay apart for colour-blind readers and in greyscale.

use plotters::style::{BLACK, Color, RGBColor, ShapeStyle, WHITE};

use crate::units::units;

/// The palette of Okabe and Ito, *Color Universal Design* (2008), without yellow, which is too
/// light for lines on white; black first.
pub(crate) const PALETTE: [RGBColor; 7] = [
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0xE6, 0x9F, 0x00),
    RGBColor(0x56, 0xB4, 0xE9),
];

pub(crate) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub(crate) const CAPTION: RGBColor = RGBColor(0x44, 0x44, 0x44);
pub(crate) const FRAME: RGBColor = RGBColor(0x55, 0x55, 0x55);
pub(crate) const GRID: RGBColor = RGBColor(0xE4, 0xE4, 0xE4);
pub(crate) const HATCH: RGBColor = RGBColor(0xB8, 0xB8, 0xB8);
pub(crate) const FAINT_GRID: RGBColor = RGBColor(0xF3, 0xF3, 0xF3);

/// Colours from low to high: a few of *viridis* (van der Walt and Smith, 2015), which lightens evenly
/// and which colour-blind readers can tell apart. Its brightest yellow is left out: it would vanish on white.
const SHADES: [[f64; 3]; 5] = [
    [68.0, 1.0, 84.0],
    [59.0, 82.0, 139.0],
    [33.0, 145.0, 140.0],
    [94.0, 201.0, 98.0],
    [223.0, 200.0, 30.0],
];

/// The colour of a shade from 0 to 1.
pub(crate) fn shade_color(shade: f64) -> RGBColor {
    let place = shade.clamp(0.0, 1.0) * (SHADES.len() - 1) as f64;
    let index = (place as usize).min(SHADES.len() - 2);
    let part = place - index as f64;
    let [red, green, blue] = std::array::from_fn(|channel| {
        let [from, to] = [SHADES[index][channel], SHADES[index + 1][channel]];
        (from + part * (to - from)).round() as u8
    });
    RGBColor(red, green, blue)
}

/// What can be read on a colour: white or black, at a contrast of at least 4.5 (WCAG 2).
pub(crate) fn readable_on(color: RGBColor) -> RGBColor {
    let linear = |channel: u8| (f64::from(channel) / 255.0).powf(2.2);
    let luminance = 0.2126 * linear(color.0) + 0.7152 * linear(color.1) + 0.0722 * linear(color.2);
    if luminance < 0.18 { WHITE } else { BLACK }
}

/// Width of curves and paths (SVG units).
pub(crate) const LINE: f64 = 1.7;

/// A line of this colour and width (SVG units).
pub(crate) fn stroke(color: impl Color, width: f64) -> ShapeStyle {
    ShapeStyle::from(color).stroke_width(units(width).unsigned_abs())
}

/// The dash pattern of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Dash {
    /// ─────
    Solid,
    /// ─ ─ ─
    Dashed,
    /// · · · ·
    Dotted,
    /// ─ · ─ ·
    DashDot,
}

impl Dash {
    /// Lengths of dashes and gaps (SVG units).
    pub(crate) fn lengths(self) -> &'static [f32] {
        match self {
            Dash::Solid => &[],
            Dash::Dashed => &[7.0, 3.5],
            Dash::Dotted => &[1.8, 2.6],
            Dash::DashDot => &[8.0, 3.0, 1.8, 3.0],
        }
    }
}

/// The symbol at each point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Marker {
    /// ●
    Circle,
    /// ■
    Square,
    /// ▲
    TriangleUp,
    /// ◆
    Diamond,
    /// ▼
    TriangleDown,
    /// ⬟
    Pentagon,
}

impl Marker {
    /// The corners around the origin (SVG units, y downwards), none of a circle; the shapes cover
    /// about the same area.
    pub(crate) fn corners(self) -> &'static [[f64; 2]] {
        match self {
            Marker::Circle => &[],
            Marker::Square => &[[-3.2, -3.2], [3.2, -3.2], [3.2, 3.2], [-3.2, 3.2]],
            Marker::TriangleUp => &[[0.0, -4.6], [4.3, 3.2], [-4.3, 3.2]],
            Marker::Diamond => &[[0.0, -4.7], [4.7, 0.0], [0.0, 4.7], [-4.7, 0.0]],
            Marker::TriangleDown => &[[0.0, 4.6], [4.3, -3.2], [-4.3, -3.2]],
            Marker::Pentagon => &[[0.0, -4.2], [4.0, -1.3], [2.5, 3.4], [-2.5, 3.4], [-4.0, -1.3]],
        }
    }
}

/// How a curve or path is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CurveStyle {
    /// Index into the palette: black, vermilion, blue, green, purple, orange, sky blue; beyond, it
    /// starts over.
    pub color: usize,
    /// The dash pattern.
    pub dash: Dash,
    /// The symbol at each point; curves of many points, and paths, have none.
    pub marker: Option<Marker>,
}

impl CurveStyle {
    /// A solid line without symbols, for a curve of many points.
    pub fn line(color: usize) -> Self {
        CurveStyle { color, dash: Dash::Solid, marker: None }
    }

    /// The colour's components.
    pub(crate) fn rgb(self) -> RGBColor {
        PALETTE[self.color % PALETTE.len()]
    }
}
