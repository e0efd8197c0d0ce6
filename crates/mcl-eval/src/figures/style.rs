//! Colours, dashes and markers that stay apart for colour-blind readers and in greyscale.

/// The palette of Okabe and Ito, *Color Universal Design* (2008), without yellow, which is too
/// light for lines on white; black first.
const PALETTE: [&str; 7] =
    ["#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];

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
    pub(super) fn lengths(self) -> &'static [f32] {
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
    /// SVG path data around the origin; the shapes cover about the same area.
    pub(super) fn path(self) -> &'static str {
        match self {
            Marker::Circle => "M-3.6 0a3.6 3.6 0 1 0 7.2 0a3.6 3.6 0 1 0 -7.2 0z",
            Marker::Square => "M-3.2 -3.2h6.4v6.4h-6.4z",
            Marker::TriangleUp => "M0 -4.6L4.3 3.2H-4.3z",
            Marker::Diamond => "M0 -4.7L4.7 0L0 4.7L-4.7 0z",
            Marker::TriangleDown => "M0 4.6L4.3 -3.2H-4.3z",
            Marker::Pentagon => "M0 -4.2L4 -1.3L2.5 3.4H-2.5L-4 -1.3z",
        }
    }
}

/// How a curve or path is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CurveStyle {
    /// Index into the palette: black, vermilion, blue, green, purple, orange, sky blue; beyond, it
    /// starts anew.
    pub color: usize,
    /// The dash pattern.
    pub dash: Dash,
    /// The symbol at each point; paths have none.
    pub marker: Marker,
}

impl CurveStyle {
    /// The style of the `index`-th curve, from 0: the first six differ in colour, marker and dash.
    pub fn nth(index: usize) -> Self {
        let (marker, dash) = [
            (Marker::Circle, Dash::Solid),
            (Marker::Square, Dash::Dashed),
            (Marker::TriangleUp, Dash::Solid),
            (Marker::Diamond, Dash::DashDot),
            (Marker::TriangleDown, Dash::Dotted),
            (Marker::Pentagon, Dash::Dashed),
        ][index % 6];
        CurveStyle { color: index, dash, marker }
    }

    /// The colour as `#RRGGBB`.
    pub(super) fn hex(self) -> &'static str {
        PALETTE[self.color % PALETTE.len()]
    }
}
