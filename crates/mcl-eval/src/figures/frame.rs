//! What surrounds the data: axes with ticks and labels, titles, captions.

use super::WIDTH;
use super::axis::Axis;
use super::canvas::{Anchor, Canvas, Position, Rect, Stroke, Text};
use super::text::{text_width, wrap};

pub(super) const TEXT: f64 = 12.0;
pub(super) const MARGIN: f64 = 12.0;
const TITLE: f64 = 13.0;
const LINE_HEIGHT: f64 = 1.35;

const FRAME: Stroke = Stroke { color: "#555555", width: 1.0, dashes: &[] };
const GRID: Stroke = Stroke { color: "#E4E4E4", width: 1.0, dashes: &[] };

/// The window of a panel and what its axes mean there.
pub(super) struct Frame {
    pub(super) window: Rect,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

/// Room left of a window for the tick labels and the label of the y axis.
pub(super) fn left_margin(axis: &Axis, label: &str) -> f64 {
    let widths = axis.ticks.iter().map(|tick| text_width(&tick.label, TEXT, false));
    let title = if label.is_empty() { 0.0 } else { 1.5 * TEXT };
    widths.fold(0.0, f64::max) + title + 8.0
}

/// Room below a window for the tick labels and the label of the x axis.
pub(super) fn bottom_margin(label: &str) -> f64 {
    if label.is_empty() { 1.7 * TEXT } else { 3.1 * TEXT }
}

impl Frame {
    /// Where a point of the data stands.
    pub(super) fn place(&self, x: f64, y: f64) -> Position {
        [
            self.window.left + self.window.width * self.x.fraction(x),
            self.window.bottom() - self.window.height * self.y.fraction(y),
        ]
    }

    /// Grid lines; drawn before the data.
    pub(super) fn draw_grid(&self, canvas: &mut Canvas) {
        let Rect { left, top, .. } = self.window;
        for tick in &self.x.ticks {
            let x = left + self.window.width * self.x.fraction(tick.value);
            canvas.line([x, top], [x, self.window.bottom()], GRID);
        }
        for tick in &self.y.ticks {
            let y = self.window.bottom() - self.window.height * self.y.fraction(tick.value);
            canvas.line([left, y], [self.window.right(), y], GRID);
        }
    }

    /// Frame, ticks and labels; an empty label stands for none, `y_label: None` for no tick labels
    /// either.
    pub(super) fn draw_axes(&self, canvas: &mut Canvas, x_label: &str, y_label: Option<&str>) {
        let Rect { left, top, .. } = self.window;
        let (right, bottom) = (self.window.right(), self.window.bottom());
        let corners = [[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
        canvas.polyline(&corners, FRAME);
        let small = Text { size: TEXT, ..Text::default() };
        for &value in &self.x.minor {
            let x = left + self.window.width * self.x.fraction(value);
            canvas.line([x, bottom], [x, bottom + 2.5], FRAME);
        }
        let mut free_from = f64::NEG_INFINITY;
        for tick in &self.x.ticks {
            let x = left + self.window.width * self.x.fraction(tick.value);
            canvas.line([x, bottom], [x, bottom + 4.5], FRAME);
            let half = 0.5 * text_width(&tick.label, TEXT, false);
            // A label that would touch its neighbour is left out; its tick stays.
            if x - half >= free_from {
                let at = [x, bottom + 5.0 + TEXT];
                canvas.text(&tick.label, at, Text { anchor: Anchor::Middle, ..small });
                free_from = x + half + 5.0;
            }
        }
        let middle = Text { anchor: Anchor::Middle, ..small };
        canvas.text(x_label, [left + 0.5 * self.window.width, bottom + 2.75 * TEXT], middle);
        for &value in &self.y.minor {
            let y = bottom - self.window.height * self.y.fraction(value);
            canvas.line([left, y], [left - 2.5, y], FRAME);
        }
        for tick in &self.y.ticks {
            let y = bottom - self.window.height * self.y.fraction(tick.value);
            canvas.line([left, y], [left - 4.5, y], FRAME);
            if y_label.is_some() {
                let at = [left - 8.0, y + 0.36 * TEXT];
                canvas.text(&tick.label, at, Text { anchor: Anchor::End, ..small });
            }
        }
        if let Some(label) = y_label {
            let at = [left - left_margin(&self.y, label) + TEXT, top + 0.5 * self.window.height];
            canvas.text(label, at, Text { upwards: true, ..middle });
        }
    }

    /// A remark in place of data.
    pub(super) fn draw_remark(&self, canvas: &mut Canvas, remark: &str) {
        let at = [
            self.window.left + 0.5 * self.window.width,
            self.window.top + 0.5 * self.window.height,
        ];
        canvas.text(
            remark,
            at,
            Text { anchor: Anchor::Middle, color: "#777777", ..Text::default() },
        );
    }
}

/// Draws a title, bold and wrapped; returns where it ends.
pub(super) fn draw_title(
    canvas: &mut Canvas,
    title: &str,
    left: f64,
    mut top: f64,
    width: f64,
) -> f64 {
    for line in wrap(title, TITLE, true, width) {
        top += LINE_HEIGHT * TITLE;
        let style = Text { size: TITLE, bold: true, ..Text::default() };
        canvas.text(&line, [left, top - 0.3 * TITLE], style);
    }
    top + 3.0
}

/// Draws the caption, each of its paragraphs wrapped, and returns where it ends.
pub(super) fn draw_caption(canvas: &mut Canvas, paragraphs: &[String], mut top: f64) -> f64 {
    for line in paragraphs.iter().flat_map(|text| wrap(text, TEXT, false, WIDTH - 2.0 * MARGIN)) {
        top += LINE_HEIGHT * TEXT;
        let style = Text { size: TEXT, color: "#444444", ..Text::default() };
        canvas.text(&line, [MARGIN, top - 0.3 * TEXT], style);
    }
    top
}
