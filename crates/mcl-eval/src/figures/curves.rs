//! Curves with intervals: likelihood or error over the map size.

use std::path::{Path, PathBuf};

use super::axis::{Axis, Scale};
use super::canvas::{Anchor, Canvas, Position, Rect, Stroke, Text};
use super::frame::{Frame, MARGIN, TEXT, bottom_margin, draw_caption, draw_title, left_margin};
use super::legend::{LINE, draw_legend};
use super::style::CurveStyle;
use super::{FigureError, WIDTH, save};

const PANEL_HEIGHT: f64 = 235.0;

/// Curves in one or more panels above each other.
#[derive(Debug, Clone)]
pub struct CurveFigure {
    /// The panels, from the top.
    pub panels: Vec<CurvePanel>,
    /// How the interval of each point is drawn.
    pub interval: Interval,
    /// Paragraphs beneath: the data set, the settings, what the marks mean.
    pub caption: Vec<String>,
}

/// One panel of a [`CurveFigure`]. Curves of the same label and style share one legend entry.
#[derive(Debug, Clone)]
pub struct CurvePanel {
    /// Stands above the panel; may be empty.
    pub title: String,
    /// The horizontal axis.
    pub x: AxisSpec,
    /// The vertical axis.
    pub y: AxisSpec,
    /// The curves, drawn in this order.
    pub curves: Vec<Curve>,
}

/// An axis of a panel.
#[derive(Debug, Clone)]
pub struct AxisSpec {
    /// What the axis shows, with its unit: "map size [% of the points]".
    pub label: String,
    /// How values are laid out.
    pub scale: Scale,
    /// The ends; without them, those of the data with some room. What lies outside is cut off.
    pub range: Option<[f64; 2]>,
}

/// How a point's interval is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interval {
    /// As error bars.
    Bars,
    /// As a shaded band along the curve.
    Band,
}

/// One curve.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name in the legend.
    pub label: String,
    /// How it is drawn.
    pub style: CurveStyle,
    /// Its points, joined in this order.
    pub points: Vec<CurvePoint>,
}

/// One point of a curve. Without finite position it is left out, and the caption says so.
#[derive(Debug, Clone)]
pub struct CurvePoint {
    /// Horizontal position.
    pub x: f64,
    /// Vertical position.
    pub mean: f64,
    /// Lower end of the interval; NaN for none.
    pub low: f64,
    /// Upper end of the interval; NaN for none.
    pub high: f64,
    /// Draws the point as an open symbol with this text beside it ("3/20").
    pub mark: Option<String>,
}

impl CurvePanel {
    fn holds(&self, point: &CurvePoint) -> bool {
        self.x.scale.holds(point.x) && self.y.scale.holds(point.mean)
    }

    /// The points that the scales can show.
    fn drawable<'a>(&'a self, curve: &'a Curve) -> impl Iterator<Item = &'a CurvePoint> {
        curve.points.iter().filter(|point| self.holds(point))
    }

    fn interval(&self, point: &CurvePoint) -> Option<[f64; 2]> {
        let ends = [point.low, point.high];
        ends.iter().all(|&end| self.y.scale.holds(end)).then_some(ends)
    }

    /// The axes; `None` when no point can be seen.
    fn axes(&self) -> Option<(Axis, Axis)> {
        let points = || self.curves.iter().flat_map(|curve| self.drawable(curve));
        let x = match self.x.range {
            Some(range) => Axis::over(range, self.x.scale, 8),
            None => Axis::around(points().map(|point| point.x), self.x.scale, 8)?,
        };
        let seen = || points().filter(|point| x.contains(point.x));
        seen().next()?;
        let y = match self.y.range {
            Some(range) => Axis::over(range, self.y.scale, 7),
            None => {
                let ends = seen().flat_map(|point| {
                    let [low, high] = self.interval(point).unwrap_or([point.mean; 2]);
                    [low, point.mean, high]
                });
                Axis::around(ends, self.y.scale, 7)?
            }
        };
        Some((x, y))
    }
}

/// Draws curves and writes `<stem>.svg` and `<stem>.png`.
///
/// # Errors
/// [`FigureError::Range`] for an axis with impossible ends; [`FigureError::NothingToDraw`] when no panel has a point that its axes can show; a single empty
/// panel says so in the figure. [`FigureError::Write`] when a file cannot be written.
pub fn draw_curves(stem: &Path, figure: &CurveFigure) -> Result<[PathBuf; 2], FigureError> {
    for axis in figure.panels.iter().flat_map(|panel| [&panel.x, &panel.y]) {
        if let Some(range) = axis.range
            && !(range[0] < range[1] && range.iter().all(|&end| axis.scale.holds(end)))
        {
            let label = axis.label.clone();
            return Err(FigureError::Range { stem: stem.into(), label, range });
        }
    }
    let points = || figure.panels.iter().flat_map(|panel| &panel.curves).flat_map(|c| &c.points);
    if figure.panels.iter().all(|panel| panel.axes().is_none()) {
        return Err(FigureError::NothingToDraw {
            stem: stem.into(),
            found: format!("{} panels with {} points", figure.panels.len(), points().count()),
            expected: "point within the axes",
        });
    }
    let mut canvas = Canvas::new();
    let entries = figure
        .panels
        .iter()
        .flat_map(|panel| &panel.curves)
        .map(|curve| (curve.label.as_str(), curve.style));
    let mut top = draw_legend(&mut canvas, entries, true, MARGIN);
    // Windows of all panels begin at the same place, so that x axes can be compared.
    let axes: Vec<_> = figure.panels.iter().map(CurvePanel::axes).collect();
    let left = figure
        .panels
        .iter()
        .zip(&axes)
        .filter_map(|(panel, axes)| Some(left_margin(&axes.as_ref()?.1, &panel.y.label)))
        .fold(0.0, f64::max)
        + MARGIN;
    for (panel, axes) in figure.panels.iter().zip(axes) {
        let width = WIDTH - left - MARGIN - 8.0;
        top = draw_title(&mut canvas, &panel.title, left, top, width);
        let window = Rect { left, top: top + 3.0, width, height: PANEL_HEIGHT };
        draw_panel(&mut canvas, panel, axes, window, figure.interval);
        top = window.bottom() + bottom_margin(&panel.x.label) + 10.0;
    }
    let mut caption = figure.caption.clone();
    caption.extend(left_out(figure));
    let bottom = draw_caption(&mut canvas, &caption, top);
    save(stem, &canvas.into_page(WIDTH, bottom + MARGIN))
}

/// Says how many points no panel can show.
fn left_out(figure: &CurveFigure) -> Option<String> {
    let count: usize = figure
        .panels
        .iter()
        .flat_map(|panel| panel.curves.iter().map(move |curve| (panel, curve)))
        .map(|(panel, curve)| curve.points.len() - panel.drawable(curve).count())
        .sum();
    let s = if count == 1 { "" } else { "s" };
    (count > 0).then(|| {
        format!("Left out: {count} point{s} without a finite value that the axes can show.")
    })
}

fn draw_panel(
    canvas: &mut Canvas,
    panel: &CurvePanel,
    axes: Option<(Axis, Axis)>,
    window: Rect,
    interval: Interval,
) {
    let Some((x, y)) = axes else {
        let [x, y] = [&panel.x, &panel.y]
            .map(|axis| Axis::over(axis.range.unwrap_or([1.0, 10.0]), axis.scale, 7));
        let frame = Frame { window, x, y };
        frame.draw_axes(canvas, &panel.x.label, Some(&panel.y.label));
        frame.draw_remark(canvas, "no data here");
        return;
    };
    let frame = Frame { window, x, y };
    frame.draw_grid(canvas);
    canvas.clipped(window, |canvas| {
        for curve in &panel.curves {
            match interval {
                Interval::Bars => draw_bars(canvas, panel, &frame, curve),
                Interval::Band => draw_band(canvas, panel, &frame, curve),
            }
        }
        for curve in &panel.curves {
            let line: Vec<_> =
                panel.drawable(curve).map(|point| frame.place(point.x, point.mean)).collect();
            let dashes = curve.style.dash.lengths();
            canvas.polyline(&line, Stroke { color: curve.style.hex(), width: LINE, dashes });
        }
    });
    frame.draw_axes(canvas, &panel.x.label, Some(&panel.y.label));
    // Markers last, and not clipped: a symbol on the frame stays whole.
    let seen = |point: &CurvePoint| frame.x.contains(point.x) && frame.y.contains(point.mean);
    for curve in &panel.curves {
        let color = curve.style.hex();
        for point in panel.drawable(curve).filter(|point| seen(point)) {
            let at = frame.place(point.x, point.mean);
            let (fill, outline) = match point.mark {
                None => (color, Stroke { color: "white", width: 0.8, dashes: &[] }),
                Some(_) => ("white", Stroke { color, width: 1.5, dashes: &[] }),
            };
            canvas.symbol(curve.style.marker.path(), at, fill, outline);
        }
    }
    for curve in &panel.curves {
        for point in panel.drawable(curve).filter(|point| seen(point)) {
            if let Some(mark) = &point.mark {
                draw_mark(canvas, mark, frame.place(point.x, point.mean), window, curve.style);
            }
        }
    }
}

fn draw_mark(canvas: &mut Canvas, mark: &str, at: Position, window: Rect, style: CurveStyle) {
    // Above to the right, but inside the window.
    let at_right_end = at[0] > window.right() - 40.0;
    let (dx, anchor) = if at_right_end { (-6.0, Anchor::End) } else { (6.0, Anchor::Start) };
    let dy = if at[1] < window.top + 16.0 { 13.0 } else { -6.0 };
    let text = Text { size: TEXT - 2.0, anchor, color: style.hex(), rim: true, ..Text::default() };
    canvas.text(mark, [at[0] + dx, at[1] + dy], text);
}

fn draw_bars(canvas: &mut Canvas, panel: &CurvePanel, frame: &Frame, curve: &Curve) {
    let stroke = Stroke { color: curve.style.hex(), width: 1.0, dashes: &[] };
    for point in panel.drawable(curve) {
        if let Some(ends) = panel.interval(point) {
            let [low, high] = ends.map(|end| frame.place(point.x, end));
            canvas.line(low, high, stroke);
            for [x, y] in [low, high] {
                canvas.line([x - 3.0, y], [x + 3.0, y], stroke);
            }
        }
    }
}

fn draw_band(canvas: &mut Canvas, panel: &CurvePanel, frame: &Frame, curve: &Curve) {
    let (mut lows, mut highs) = (Vec::new(), Vec::new());
    for point in panel.drawable(curve) {
        if let Some([low, high]) = panel.interval(point) {
            lows.push(frame.place(point.x, low));
            highs.push(frame.place(point.x, high));
        }
    }
    lows.extend(highs.into_iter().rev());
    canvas.area(&lows, curve.style.hex(), 0.16);
}
