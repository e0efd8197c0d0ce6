//! Point maps, and the robot's paths on them.

use std::path::{Path, PathBuf};

use mcl_core::Point;
use mcl_core::memory::with_room;
use mcl_core::text::counted;
use plotters::element::BitMapElement;

use crate::axis::{Axis, Scale};
use crate::error::FigureError;
use crate::medium::Medium;
use crate::page::{
    Chart, DrawError, Page, TITLE_GAP, along_x, along_y, bottom_room, draw_axes, draw_frame,
    draw_lines, draw_remark, height, left_room, refused, render_error,
};
use crate::raster::{Position, Raster};
use crate::style::CurveStyle;
use crate::text::{self, wrap};
use crate::units::{svg_units, units};

/// Largest height of a panel.
const TALLEST: f64 = 560.0;
const GAP: f64 = 16.0;
/// Panels narrower than this go to the next row.
const NARROWEST: f64 = 150.0;
/// Panels are no lower than this, even if they do not fit a page.
const LOWEST: f64 = 60.0;
/// Beneath a row of panels.
const BELOW: f64 = 8.0;

/// Point clouds in panels of the same bounds and scale.
#[derive(Debug, Clone)]
pub struct CloudFigure<'a> {
    /// The panels.
    pub panels: Vec<CloudPanel<'a>>,
    /// What stands at the axes.
    pub labels: CloudLabels,
    /// Paragraphs beneath: the data set, the settings.
    pub caption: Vec<String>,
}

/// The labels of the axes of a [`CloudFigure`], with their unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CloudLabels {
    /// Of the horizontal axis.
    pub x: &'static str,
    /// Of the vertical axis.
    pub y: &'static str,
}

impl CloudLabels {
    /// Of a map in the plane.
    pub const PLANE: CloudLabels = CloudLabels { x: "x [m]", y: "y [m]" };
}

/// One panel of a [`CloudFigure`].
#[derive(Debug, Clone)]
pub struct CloudPanel<'a> {
    /// Stands above the panel: "grid-based map, 1,245 points (0.8 %)".
    pub title: String,
    /// The points (m); those that are not finite are left out, and the caption says so.
    pub points: &'a [Point<2>],
    /// Of each point, from 0 (dark blue) to 1 (yellow), drawn in this order; empty: all points are black.
    pub shades: &'a [f64],
    /// Lines over the points, drawn in this order.
    pub paths: Vec<CloudPath<'a>>,
    /// Where the paths begin: marked by a ring.
    pub start: Option<Point<2>>,
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
    /// Whether it is cut off where the points and all other paths end.
    pub is_cut: bool,
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
            let paths = panel.paths.iter().filter(|path| !path.is_cut);
            let paths = paths.flat_map(|path| path.points);
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

/// Draws point clouds and writes `<stem>.svg` and `<stem>.png`, and what else the medium asks for. Panels stand side by
/// side or above each other, whichever shows them larger on one page.
///
/// One metre is as long on both axes and in every panel. Up to 50,000 points are drawn as dots, more
/// as a density, darker where there are more.
///
/// # Errors
/// [`FigureError::NothingToDraw`] when no panel has a finite point; a single empty panel says so in
/// the figure. [`FigureError::Render`] and [`FigureError::Write`] when a file cannot be made.
pub fn draw_clouds(
    stem: &Path,
    figure: &CloudFigure,
    medium: Medium,
) -> Result<Vec<PathBuf>, FigureError> {
    let view = View::of(&figure.panels).ok_or_else(|| FigureError::NothingToDraw {
        stem: stem.into(),
        found: format!(
            "{} panels with {} points",
            figure.panels.len(),
            figure.panels.iter().map(|panel| panel.points.len()).sum::<usize>()
        ),
        expected: "point",
    })?;
    draw_page(&view, figure, medium).map_err(render_error(stem))?.save(stem)
}

fn draw_page(view: &View, figure: &CloudFigure, medium: Medium) -> Result<Page, DrawError> {
    let CloudLabels { x: x_label, y: y_label } = figure.labels;
    // Maps are looked at in detail: several take the width of both columns.
    let mut page = Page::new(medium, figure.panels.len());
    let inner = page.inner;
    let paths = figure.panels.iter().flat_map(|panel| &panel.paths);
    page.legend(paths.map(|path| (path.label.as_str(), path.style)), false)?;

    let [x, y] = [0, 1].map(|axis| Axis::over([view.low[axis], view.high[axis]], Scale::Linear));
    // The most labels that the y axis could have; how high it is depends on the room they take.
    let left = left_room(&y.clone().with_ticks(TALLEST, along_y), y_label).ceil();
    let free = inner - left;
    let titles =
        |room: f64| figure.panels.iter().map(move |panel| wrap(&panel.title, &text::title(), room));
    // Width of a panel and its share of the page, where so many stand side by side.
    let of_columns = |columns: usize| {
        let widest = (free - GAP * (columns - 1) as f64) / columns as f64;
        let rows = figure.panels.len().div_ceil(columns) as f64;
        let title = titles(widest).map(|lines| height(&lines, &text::title())).fold(0.0, f64::max);
        let beside = title + TITLE_GAP + bottom_room(x_label) + BELOW;
        let tallest = (medium.tallest() / rows - beside).clamp(LOWEST, TALLEST);
        // Whole units, so that the pictures' pixels meet those of the PNG.
        (widest.min(tallest / view.aspect()).floor(), widest)
    };
    let most = ((free + GAP) / (NARROWEST + GAP)) as usize;
    // Side by side they are compared better: that is worth some of their size.
    let worth = |columns: usize| of_columns(columns).0 * (columns as f64).sqrt().sqrt();
    let columns = (1..=figure.panels.len().min(most).max(1))
        .max_by(|a, b| worth(*a).total_cmp(&worth(*b)).then(b.cmp(a)))
        .unwrap_or(1);
    let (width, widest) = of_columns(columns);
    let window = [width, (width * view.aspect()).round()];
    let x = x.with_ticks(window[0], along_x);
    let y = y.with_ticks(window[1], along_y);
    let indent = (0.5 * (widest - width) * columns as f64).round();
    for row in figure.panels.chunks(columns) {
        // A narrow panel on its own has room for its title to the right.
        let room = if columns == 1 { free - indent } else { width };
        let titles: Vec<_> =
            row.iter().map(|panel| wrap(&panel.title, &text::title(), room)).collect();
        let heights = titles.iter().map(|lines| height(lines, &text::title()));
        let above = page.take((heights.fold(0.0, f64::max) + TITLE_GAP).ceil());
        let below = page.take(window[1] + bottom_room(x_label));
        for (column, (panel, title)) in row.iter().zip(&titles).enumerate() {
            let at = left + indent + (width + GAP) * column as f64;
            draw_lines(&above.margin(0, 0, units(at), 0), title, &text::title())?;
            // The first panel of a row has labels at its y axis, the others only ticks.
            let (y, y_label, left) = match column {
                0 => (y.clone(), y_label, left),
                _ => (y.clone().without_labels(), "", GAP),
            };
            let beyond = units(inner - at - width);
            let area = below.margin(0, 0, units(at - left), beyond);
            let chart = draw_axes(&area, left, [x.clone(), y], [x_label, y_label], false)?;
            draw_panel(&chart, panel, window)?;
        }
        page.take(BELOW);
    }
    page.caption(&figure.caption)?;
    page.caption(left_out(&figure.panels).as_slice())?;
    Ok(page)
}

fn draw_panel(
    chart: &Chart,
    panel: &CloudPanel,
    [width, height]: [f64; 2],
) -> Result<(), DrawError> {
    let area = chart.plotting_area();
    let window = area.strip_coord_spec();
    let corner = window.get_base_pixel();
    let place = |points: &[Point<2>]| -> Result<Vec<Position>, DrawError> {
        let mut places = with_room(points.len(), "points of a figure").map_err(refused)?;
        places.extend(points.iter().filter(|point| drawable(point)).map(|point| {
            let (x, y) = area.map_coordinate(&(point[0], point[1]));
            [svg_units(x - corner.0), svg_units(y - corner.1)]
        }));
        Ok(places)
    };
    let points = place(panel.points)?;
    let raster = Raster::new(width, height).map_err(refused)?;
    let mut raster = raster.ok_or(DrawError::LayoutError)?;
    // Shades and points belong together only as long as no point is left out.
    match panel.shades.len() == points.len() && !points.is_empty() {
        true => raster.draw_shaded(&points, panel.shades),
        false => raster.draw_points(&points),
    }
    for path in &panel.paths {
        raster.draw_path(&place(path.points)?, path.style);
    }
    if let Some(start) = panel.start.filter(drawable) {
        place(&[start])?.into_iter().for_each(|at| raster.draw_ring(at));
    }
    let (size, pixels) = raster.into_rgb();
    let picture = BitMapElement::with_owned_buffer((0, 0), size, pixels);
    window.draw(&picture.ok_or(DrawError::LayoutError)?)?;
    if points.is_empty() {
        draw_remark(chart, "no points")?;
    }
    draw_frame(chart)
}

fn left_out(panels: &[CloudPanel]) -> Option<String> {
    let all = panels.iter().flat_map(|panel| {
        panel.points.iter().chain(panel.paths.iter().flat_map(|path| path.points))
    });
    let count = all.filter(|point| !drawable(point)).count();
    let points = || counted(count, "point");
    (count > 0).then(|| format!("Left out: {} without finite coordinates.", points()))
}
