//! Point maps, and the robot's paths on them.

use std::path::{Path, PathBuf};

use mcl_core::Point;

use super::axis::{Axis, Scale};
use super::canvas::{Canvas, Position, Rect};
use super::frame::{Frame, MARGIN, bottom_margin, draw_caption, draw_title, left_margin};
use super::legend::draw_legend;
use super::raster::Raster;
use super::style::CurveStyle;
use super::{FigureError, WIDTH, save};

/// Largest height of a panel on its own, and of one among several.
const TALLEST: [f64; 2] = [560.0, 420.0];
const GAP: f64 = 16.0;

/// Point clouds in panels of the same bounds and scale.
#[derive(Debug, Clone)]
pub struct CloudFigure<'a> {
    /// The panels.
    pub panels: Vec<CloudPanel<'a>>,
    /// How the panels stand.
    pub arrangement: Arrangement,
    /// Paragraphs beneath: the data set, the settings.
    pub caption: Vec<String>,
}

/// How panels stand to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// Above each other: best for clouds wider than tall.
    Stacked,
    /// Beside each other.
    SideBySide,
}

/// One panel of a [`CloudFigure`].
#[derive(Debug, Clone)]
pub struct CloudPanel<'a> {
    /// Stands above the panel: "grid-based map, 1,245 points (0.8 %)".
    pub title: String,
    /// The points (m); those that are not finite are left out, and the caption says so.
    pub points: &'a [Point<2>],
    /// Lines over the points, drawn in this order.
    pub paths: Vec<CloudPath<'a>>,
}

/// A line over a cloud, such as the path of the robot.
#[derive(Debug, Clone)]
pub struct CloudPath<'a> {
    /// Its name in the legend.
    pub label: String,
    /// Its colour and dashes; paths have no markers.
    pub style: CurveStyle,
    /// The corners (m).
    pub points: &'a [Point<2>],
}

/// The box shown by every panel (m).
#[derive(Debug, Clone, Copy)]
struct View {
    low: Point<2>,
    high: Point<2>,
}

impl View {
    /// The box around all finite points and paths, with some room.
    fn of(panels: &[CloudPanel]) -> Option<Self> {
        let mut view = View { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        for panel in panels {
            let paths = panel.paths.iter().flat_map(|path| path.points);
            for point in panel.points.iter().chain(paths).filter(|point| drawable(point)) {
                for (axis, &coordinate) in point.iter().enumerate() {
                    view.low[axis] = view.low[axis].min(coordinate);
                    view.high[axis] = view.high[axis].max(coordinate);
                }
            }
        }
        if view.low[0] > view.high[0] {
            return None;
        }
        let extent = [0, 1].map(|axis| view.high[axis] - view.low[axis]);
        let largest = extent[0].max(extent[1]);
        // Room around; at least 1 m (or what can still be told apart far from 0) of a single point,
        // and no sliver when all points are on a line.
        let magnitude = view.low.iter().chain(&view.high).fold(0.0, |m: f64, v| m.max(v.abs()));
        let least = (0.2 * largest).max(1.0).max(1e-6 * magnitude);
        for (axis, extent) in extent.into_iter().enumerate() {
            let room = (0.02 * largest).max(0.5 * (least - extent));
            view.low[axis] -= room;
            view.high[axis] += room;
        }
        Some(view)
    }

    /// Height over width.
    fn aspect(&self) -> f64 {
        (self.high[1] - self.low[1]) / (self.high[0] - self.low[0])
    }
}

/// Far beyond any place on Earth, extents lose all meaning.
fn drawable(point: &Point<2>) -> bool {
    point.iter().all(|coordinate| coordinate.abs() <= 1e12)
}

/// Draws point clouds and writes `<stem>.svg` and `<stem>.png`.
///
/// One metre is as long on both axes and in every panel. Up to 50,000 points are drawn as dots, more
/// as a density, darker where there are more.
///
/// # Errors
/// [`FigureError::NothingToDraw`] when no panel has a finite point; a single empty panel says so in
/// the figure. [`FigureError::Render`] and [`FigureError::Write`] when a file cannot be made.
pub fn draw_clouds(stem: &Path, figure: &CloudFigure) -> Result<[PathBuf; 2], FigureError> {
    let view = View::of(&figure.panels).ok_or_else(|| FigureError::NothingToDraw {
        stem: stem.into(),
        found: format!(
            "{} panels with {} points",
            figure.panels.len(),
            figure.panels.iter().map(|panel| panel.points.len()).sum::<usize>()
        ),
        expected: "point",
    })?;
    let mut canvas = Canvas::new();
    let paths = figure.panels.iter().flat_map(|panel| &panel.paths);
    let entries = paths.map(|path| (path.label.as_str(), path.style));
    let mut top = draw_legend(&mut canvas, entries, false, MARGIN);

    let columns = match figure.arrangement {
        Arrangement::Stacked => 1,
        Arrangement::SideBySide => figure.panels.len(),
    };
    // Ticks need a window, and the window needs the width of the tick labels.
    let y_axis = || Axis::over([view.low[1], view.high[1]], Scale::Linear, 5);
    let left = MARGIN + left_margin(&y_axis(), "y [m]");
    let free = WIDTH - left - MARGIN - GAP * (columns - 1) as f64;
    // Whole units, so that the pictures' pixels meet those of the PNG.
    let tallest = TALLEST[usize::from(figure.panels.len() > 1)];
    let width = (free / columns as f64).min(tallest / view.aspect()).floor().max(20.0);
    let height = (width * view.aspect()).round().max(20.0);
    let left = (left + 0.5 * (free + GAP - (width + GAP) * columns as f64).max(0.0)).round();
    let ticks = if width < 300.0 { 4 } else { 6 };
    for row in figure.panels.chunks(columns) {
        let mut below_titles = top;
        for (column, panel) in row.iter().enumerate() {
            let left = left + column as f64 * (width + GAP);
            // A narrow panel on its own has room for its title to the right.
            let room = if columns == 1 { WIDTH - MARGIN - left } else { width };
            let end = draw_title(&mut canvas, &panel.title, left, top, room);
            below_titles = below_titles.max(end);
        }
        for (column, panel) in row.iter().enumerate() {
            let left = left + column as f64 * (width + GAP);
            let frame = Frame {
                window: Rect { left, top: below_titles.ceil() + 2.0, width, height },
                x: Axis::over([view.low[0], view.high[0]], Scale::Linear, ticks),
                y: y_axis(),
            };
            draw_panel(&mut canvas, panel, &frame)
                .map_err(|reason| FigureError::Render { stem: stem.into(), reason })?;
            frame.draw_axes(&mut canvas, "x [m]", (column == 0).then_some("y [m]"));
        }
        top = below_titles.ceil() + 2.0 + height + bottom_margin("x [m]") + 8.0;
    }
    let mut caption = figure.caption.clone();
    caption.extend(left_out(&figure.panels));
    let bottom = draw_caption(&mut canvas, &caption, top);
    save(stem, &canvas.into_page(WIDTH, bottom + MARGIN))
}

fn draw_panel(canvas: &mut Canvas, panel: &CloudPanel, frame: &Frame) -> Result<(), String> {
    let window = frame.window;
    let place = |points: &[Point<2>]| -> Vec<Position> {
        let places = points.iter().filter(|point| drawable(point)).map(|point| {
            let [x, y] = frame.place(point[0], point[1]);
            [x - window.left, y - window.top]
        });
        places.collect()
    };
    let points = place(panel.points);
    if points.is_empty() {
        frame.draw_remark(canvas, "no points");
    }
    let mut raster = Raster::new(window.width, window.height).ok_or("its panels are too large")?;
    raster.draw_points(&points);
    for path in &panel.paths {
        raster.draw_path(&place(path.points), path.style);
    }
    canvas.picture(&raster.into_png()?, window);
    Ok(())
}

fn left_out(panels: &[CloudPanel]) -> Option<String> {
    let all = panels.iter().flat_map(|panel| {
        panel.points.iter().chain(panel.paths.iter().flat_map(|path| path.points))
    });
    let count = all.filter(|point| !drawable(point)).count();
    let s = if count == 1 { "" } else { "s" };
    (count > 0).then(|| format!("Left out: {count} point{s} without finite coordinates."))
}
