//! Curves with intervals: likelihood or error over the map size.

use std::path::{Path, PathBuf};

use mcl_core::text::counted;
use plotters::element::{EmptyElement, PathElement, Rectangle, Text};
use plotters::series::LineSeries;
use plotters::style::{Color, FontStyle, WHITE};

use crate::axis::{Axis, Scale};
use crate::elements::{Clipped, symbol};
use crate::error::FigureError;
use crate::marks::{OccupiedAreas, TextBox};
use crate::medium::Medium;
use crate::page::{
    Area, Chart, DrawError, Page, TITLE_GAP, along_x, along_y, bottom_room, draw_axes, draw_frame,
    draw_lines, draw_remark, height, left_room, render_error,
};
use crate::save::save_file;
use crate::style::{CurveStyle, Dash, LINE, Marker, stroke};
use crate::text::{self, TEXT, fitted, wrap};
use crate::units::{svg_units, units};

/// Height of a panel on a screen and in a paper.
const PANEL_HEIGHT: [f64; 2] = [235.0, 185.0];
/// Between panels side by side.
const COLUMN_GAP: f64 = 10.0;
/// Right of a panel, for half of its last tick label.
const OVERHANG: f64 = 8.0;

/// Curves in one or more panels.
#[derive(Debug, Clone)]
pub struct CurveFigure {
    /// The panels, row by row.
    pub panels: Vec<CurvePanel>,
    /// How many panels stand side by side; at least 1.
    pub columns: usize,
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
    /// What stands at the places 0, 1, … in place of numbers; empty for numbers.
    pub names: Vec<String>,
}

/// One curve.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name in the legend; without one it is not in it.
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
    /// Ends of the interval, drawn as an error bar; without finite ends there is none.
    pub interval: Option<[f64; 2]>,
    /// Draws the point as an open symbol (a circle on curves without symbols) with this text beside it
    /// ("3/20"), which may be empty, and is left out where it has no room.
    pub mark: Option<String>,
}

impl CurvePoint {
    /// A point without interval and mark.
    pub fn bare(x: f64, mean: f64) -> Self {
        CurvePoint { x, mean, interval: None, mark: None }
    }
}

impl AxisSpec {
    /// An axis on which values are laid out evenly, as long as its data needs.
    pub fn linear(label: &str) -> Self {
        AxisSpec { label: label.to_owned(), scale: Scale::Linear, range: None, names: Vec::new() }
    }

    /// An axis with a place for each of these names, in this order.
    pub fn named(names: Vec<String>) -> Self {
        let range = Some([-0.5, names.len().max(1) as f64 - 0.5]);
        AxisSpec { label: String::new(), scale: Scale::Linear, range, names }
    }
}

impl CurvePanel {
    fn holds(&self, point: &CurvePoint) -> bool {
        self.x.scale.holds(point.x) && self.y.scale.holds(point.mean)
    }

    /// The points that the scales can show.
    fn drawable<'a>(&'a self, curve: &'a Curve) -> impl Iterator<Item = &'a CurvePoint> {
        curve.points.iter().filter(|point| self.holds(point))
    }

    /// The points inside of the chart.
    fn seen<'a>(
        &'a self,
        curve: &'a Curve,
        chart: &Chart,
    ) -> impl Iterator<Item = &'a CurvePoint> + use<'a> {
        let axes = chart.plotting_area().as_coord_spec();
        let (x, y) = (axes.x_spec().clone(), axes.y_spec().clone());
        self.drawable(curve).filter(move |point| x.contains(point.x) && y.contains(point.mean))
    }

    fn interval(&self, point: &CurvePoint) -> Option<[f64; 2]> {
        point.interval.filter(|ends| ends.iter().all(|&end| self.y.scale.holds(end)))
    }

    /// The axes of a panel of this height; `None` when no point can be seen.
    fn axes(&self, height: f64) -> Option<[Axis; 2]> {
        let points = || self.curves.iter().flat_map(|curve| self.drawable(curve));
        let x = match self.x.range {
            Some(range) => Axis::over(range, self.x.scale),
            None => Axis::around(points().map(|point| point.x), self.x.scale)?,
        };
        let seen = || points().filter(|point| x.contains(point.x));
        seen().next()?;
        let y = match self.y.range {
            Some(range) => Axis::over(range, self.y.scale),
            None => {
                let ends = seen().flat_map(|point| {
                    let [low, high] = self.interval(point).unwrap_or([point.mean; 2]);
                    [low, point.mean, high]
                });
                Axis::around(ends, self.y.scale)?
            }
        };
        Some([x, y.with_ticks(height, along_y)])
    }
}

/// Draws curves and writes `<stem>.svg` and `<stem>.png`, and what else the medium asks for.
///
/// # Errors
/// [`FigureError::Range`] for an axis with impossible ends; [`FigureError::NothingToDraw`] when no
/// panel has a point that its axes can show; a single empty panel says so in the figure.
/// [`FigureError::Render`] and [`FigureError::Write`] when a file cannot be made.
pub fn draw_curves(
    stem: &Path,
    figure: &CurveFigure,
    medium: Medium,
) -> Result<Vec<PathBuf>, FigureError> {
    page_of(stem, figure, medium)?.save(stem)
}

/// Draws curves and writes them as one file, `.svg`, `.png` or `.pdf`.
///
/// # Errors
/// As [`draw_curves`], and [`FigureError::Ending`] for a path with another ending.
pub fn draw_curve_file(path: &Path, figure: &CurveFigure) -> Result<(), FigureError> {
    save_file(path, &page_of(path, figure, Medium::Screen)?.into_svg())
}

fn page_of(stem: &Path, figure: &CurveFigure, medium: Medium) -> Result<Page, FigureError> {
    for axis in figure.panels.iter().flat_map(|panel| [&panel.x, &panel.y]) {
        if let Some(range) = axis.range
            && !(range[0] < range[1] && range.iter().all(|&end| axis.scale.holds(end)))
        {
            let label = axis.label.clone();
            return Err(FigureError::Range { stem: stem.into(), label, range });
        }
    }
    let points = || figure.panels.iter().flat_map(|panel| &panel.curves).flat_map(|c| &c.points);
    if figure.panels.iter().all(|panel| panel.axes(panel_height(medium)).is_none()) {
        return Err(FigureError::NothingToDraw {
            stem: stem.into(),
            found: format!("{} panels with {} points", figure.panels.len(), points().count()),
            expected: "point within the axes",
        });
    }
    draw_page(figure, medium).map_err(render_error(stem))
}

fn panel_height(medium: Medium) -> f64 {
    let [screen, paper] = PANEL_HEIGHT;
    match medium {
        Medium::Screen => screen,
        Medium::Paper => paper,
    }
}

fn draw_page(figure: &CurveFigure, medium: Medium) -> Result<Page, DrawError> {
    let columns = figure.columns.clamp(1, figure.panels.len());
    let panel_height = panel_height(medium);
    let mut page = Page::new(medium, columns);
    let inner = page.inner;
    let curves = figure.panels.iter().flat_map(|panel| &panel.curves);
    page.legend(curves.map(|curve| (curve.label.as_str(), curve.style)), true)?;
    // Charts of all panels begin at the same place, so that x axes can be compared.
    let axes: Vec<_> = figure.panels.iter().map(|panel| panel.axes(panel_height)).collect();
    let rooms = figure
        .panels
        .iter()
        .zip(&axes)
        .filter_map(|(panel, axes)| axes.as_ref().map(|[_, y]| left_room(y, &panel.y.label)));
    let left = rooms.fold(0.0, f64::max);
    let width = (inner + COLUMN_GAP) / columns as f64 - COLUMN_GAP;
    let plot = width - left - OVERHANG;
    let panels: Vec<_> = figure.panels.iter().zip(axes).collect();
    let mut without_room = 0;
    for row in panels.chunks(columns) {
        let titles: Vec<_> =
            row.iter().map(|(panel, _)| wrap(&panel.title, &text::title(), plot)).collect();
        let tallest = |heights: &mut dyn Iterator<Item = f64>| heights.fold(0.0, f64::max);
        let above = tallest(&mut titles.iter().map(|title| height(title, &text::title())));
        let below = tallest(&mut row.iter().map(|(panel, _)| bottom_room(&panel.x.label)));
        let (above, area) = (page.take(above + TITLE_GAP), page.take(panel_height + below));
        for (column, ((panel, axes), title)) in row.iter().zip(titles).enumerate() {
            let from = column as f64 * (width + COLUMN_GAP);
            let beyond = inner - from - width;
            draw_lines(&above.margin(0, 0, units(from + left), 0), &title, &text::title())?;
            let area = area.margin(0, 0, units(from), units(beyond + OVERHANG));
            let size = [left, plot, panel_height];
            without_room += draw_panel(&page, &area, panel, axes.clone(), size)?;
        }
        page.take(10.0);
    }
    page.caption(&figure.caption)?;
    page.caption(left_out(figure).as_slice())?;
    if without_room > 0 {
        let labels = counted(without_room, "label");
        page.caption(&[format!("Left out: {labels} of open symbols, which have no room.")])?;
    }
    Ok(page)
}

/// Says how many points no panel can show.
fn left_out(figure: &CurveFigure) -> Option<String> {
    let count: usize = figure
        .panels
        .iter()
        .flat_map(|panel| panel.curves.iter().map(move |curve| (panel, curve)))
        .map(|(panel, curve)| curve.points.len() - panel.drawable(curve).count())
        .sum();
    (count > 0).then(|| {
        let points = counted(count, "point");
        format!("Left out: {points} without a finite value that the axes can show.")
    })
}

/// Draws a panel; `left` of its plot of this `width` and `tall` stand the labels.
fn draw_panel(
    page: &Page,
    area: &Area,
    panel: &CurvePanel,
    axes: Option<[Axis; 2]>,
    [left, width, tall]: [f64; 3],
) -> Result<usize, DrawError> {
    let empty = axes.is_none();
    let [x, y] = axes.unwrap_or_else(|| {
        [&panel.x, &panel.y]
            .map(|axis| Axis::over(axis.range.unwrap_or([1.0, 10.0]), axis.scale))
            .map(|axis| axis.with_ticks(tall, along_y))
    });
    let x = match panel.x.names.as_slice() {
        [] => x.with_ticks(width, along_x),
        names => {
            let each = width / names.len() as f64 - along_x("");
            x.with_names(names.iter().map(|name| fitted(name, &text::plain(), each).into_owned()))
        }
    };
    let axes = [x, y];
    let mut chart = draw_axes(area, left, axes, [&panel.x.label, &panel.y.label], true)?;
    if empty {
        draw_frame(&chart)?;
        draw_remark(&chart, "no data here")?;
        return Ok(0);
    }
    page.canvas.borrow_mut().clip(chart.plotting_area().get_pixel_range());
    for curve in &panel.curves {
        draw_bars(&mut chart, panel, curve)?;
    }
    for curve in &panel.curves {
        let places = panel.drawable(curve).map(|point| (point.x, point.mean));
        let line = LineSeries::new(places, stroke(curve.style.rgb(), LINE));
        chart.draw_series(line.map(|line| Clipped(line, curve.style.dash)))?;
    }
    page.canvas.borrow_mut().unclip();
    draw_frame(&chart)?;
    // Symbols last, and not clipped: one on the frame stays whole.
    for curve in &panel.curves {
        let symbols = panel.seen(curve, &chart).filter_map(|point| {
            let marker = curve.style.marker.or(point.mark.as_ref().map(|_| Marker::Circle));
            let style = CurveStyle { marker, ..curve.style };
            symbol((point.x, point.mean), style, point.mark.is_some())
        });
        chart.draw_series(symbols)?;
    }
    draw_marks(&chart, panel)
}

/// Error bars. plotters' `ErrorBar` puts a circle on the mean, which would show under our symbols.
fn draw_bars(chart: &mut Chart, panel: &CurvePanel, curve: &Curve) -> Result<(), DrawError> {
    let style = stroke(curve.style.rgb(), 1.0);
    let bars = || {
        let points = panel.drawable(curve);
        points.filter_map(|point| panel.interval(point).map(|ends| (point.x, ends)))
    };
    chart.draw_series(bars().map(|(x, ends)| {
        Clipped(PathElement::new(ends.map(|end| (x, end)), style), Dash::Solid)
    }))?;
    chart.draw_series(bars().flat_map(|(x, ends)| ends.map(|end| (x, end))).map(|end| {
        let cap = PathElement::new([(units(-3.0), 0), (units(3.0), 0)], style);
        Clipped(EmptyElement::at(end) + cap, Dash::Solid)
    }))?;
    Ok(())
}

/// Draws the texts beside marked points, and returns how many have no room.
fn draw_marks(chart: &Chart, panel: &CurvePanel) -> Result<usize, DrawError> {
    let mut without_room = 0;
    let window = chart.plotting_area();
    let (x, y) = window.get_pixel_range();
    let mut taken =
        OccupiedAreas::new(TextBox { left: x.start, top: y.start, right: x.end, bottom: y.end });
    let place = |point: &CurvePoint, y: f64| window.map_coordinate(&(point.x, y));
    for curve in &panel.curves {
        let points: Vec<_> = panel.drawable(curve).collect();
        for pair in points.windows(2) {
            taken.add_line(place(pair[0], pair[0].mean), place(pair[1], pair[1].mean));
        }
        for point in points {
            taken.add_symbol(place(point, point.mean));
            if let Some([low, high]) = panel.interval(point) {
                taken.add_line(place(point, low), place(point, high));
            }
        }
    }
    let page = window.use_screen_coord();
    for curve in &panel.curves {
        let style = text::style(TEXT - 2.0, FontStyle::Normal, &curve.style.rgb());
        for point in panel.seen(curve, chart) {
            let Some(mark) = &point.mark else { continue };
            let mark = fitted(mark, &style, 0.25 * svg_units(x.end - x.start));
            let (width, height) = page.estimate_text_size(&mark, &style)?;
            if mark.is_empty() {
                continue;
            }
            let size = (width as i32, height as i32);
            let Some(text) = taken.place(place(point, point.mean), size) else {
                without_room += 1;
                continue;
            };
            // Where it must stand on a line, it is still legible.
            let corners = [(text.left, text.top), (text.right, text.bottom)];
            page.draw(&Rectangle::new(corners, WHITE.mix(0.7).filled()))?;
            page.draw(&Text::new(&*mark, corners[0], style.clone()))?;
        }
    }
    Ok(without_room)
}
