//! The legend: one entry per curve or path, in rows above the panels.

use super::WIDTH;
use super::canvas::{Canvas, Stroke, Text};
use super::frame::{MARGIN, TEXT};
use super::style::CurveStyle;
use super::text::text_width;

const SAMPLE: f64 = 38.0;
const GAP: f64 = 22.0;
const ROW: f64 = 19.0;
pub(super) const LINE: f64 = 1.7;

/// Draws each different entry once, in order of appearance; returns where the legend ends.
pub(super) fn draw_legend<'a>(
    canvas: &mut Canvas,
    entries: impl Iterator<Item = (&'a str, CurveStyle)>,
    with_markers: bool,
    mut top: f64,
) -> f64 {
    let mut seen: Vec<(&str, CurveStyle)> = Vec::new();
    let mut left = MARGIN;
    for entry in entries {
        if seen.contains(&entry) {
            continue;
        }
        let (label, style) = entry;
        let width = SAMPLE + 6.0 + text_width(label, TEXT, false);
        if !seen.is_empty() && left + width > WIDTH - MARGIN {
            left = MARGIN;
            top += ROW;
        }
        seen.push(entry);
        let y = top + 0.5 * ROW;
        let stroke = Stroke { color: style.hex(), width: LINE, dashes: style.dash.lengths() };
        canvas.line([left, y], [left + SAMPLE, y], stroke);
        if with_markers {
            let outline = Stroke { color: "white", width: 0.8, dashes: &[] };
            canvas.symbol(style.marker.path(), [left + 0.5 * SAMPLE, y], style.hex(), outline);
        }
        canvas.text(label, [left + SAMPLE + 6.0, y + 0.36 * TEXT], Text::default());
        left += width + GAP;
    }
    if seen.is_empty() { top } else { top + ROW + 2.0 }
}
