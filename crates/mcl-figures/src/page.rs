//! The page of a figure, filled from its top: legend, titles, charts, caption.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use mcl_core::memory::OutOfMemory;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{BitMapElement, PathElement, Rectangle};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, RGBColor, TextStyle};
use plotters_backend::DrawingErrorKind;

use crate::axis::{Axis, Scale};
use crate::canvas::{Canvas, CanvasError};
use crate::elements::{Clipped, symbol};
use crate::error::FigureError;
use crate::medium::Medium;
use crate::save::save;
use crate::style::{CurveStyle, FAINT_GRID, FRAME, GRID, HATCH, LINE, shade_color, stroke};
use crate::text::{self, LINE_HEIGHT, TEXT, fitted, text_size, wrap};
use crate::units::{PIXELS_PER_UNIT, svg_units, units};

/// Around a page on the screen (SVG units).
const MARGIN: f64 = 12.0;
/// Between a title and its chart; its last line has room of its own below.
pub(crate) const TITLE_GAP: f64 = 2.0;
/// Largest width, and height, of the scale of colours.
pub(crate) const COLOR_SCALE: [f64; 2] = [300.0, 12.0];
const TICK: f64 = 4.0;

/// Why plotters could not draw.
pub(crate) type DrawError = DrawingAreaErrorKind<CanvasError>;

/// That there is no memory for a picture.
pub(crate) fn refused(error: OutOfMemory) -> DrawError {
    DrawError::BackendError(DrawingErrorKind::DrawingError(CanvasError(error.to_string())))
}

/// The error of a figure that plotters could not draw, with the reason alone: plotters would say that
/// it is an error of its backend, twice.
pub(crate) fn render_error(stem: &Path) -> impl Fn(DrawError) -> FigureError {
    |error| {
        let reason = match &error {
            DrawError::BackendError(DrawingErrorKind::DrawingError(error)) => error.to_string(),
            other => other.to_string(),
        };
        FigureError::Render { stem: stem.into(), reason }
    }
}

/// A part of the page.
pub(crate) type Area = DrawingArea<Canvas, Shift>;
/// Axes to draw data on.
pub(crate) type Chart = ChartContext<'static, Canvas, Cartesian2d<Axis, Axis>>;

pub(crate) struct Page {
    pub(crate) canvas: Rc<RefCell<Canvas>>,
    free: Area,
    /// Width within the margins (SVG units).
    pub(crate) inner: f64,
    medium: Medium,
    /// The paragraphs beneath.
    captions: Vec<String>,
}

impl Page {
    /// An empty page with room for so many panels side by side.
    pub(crate) fn new(medium: Medium, columns: usize) -> Self {
        let width = medium.width(columns);
        let canvas = Rc::new(RefCell::new(Canvas::new(width)));
        let margin = margin(medium);
        let units = units(margin);
        let free = Area::from(&canvas).margin(units, 0, units, units);
        Page { canvas, free, inner: width - 2.0 * margin, medium, captions: Vec::new() }
    }

    /// The next part of the page (SVG units).
    pub(crate) fn take(&mut self, height: f64) -> Area {
        let (next, free) = self.free.split_vertically(units(height));
        self.free = free;
        next
    }

    /// Draws each different entry once, in order of appearance, in rows. plotters' own legend would
    /// be a column within the chart, over its curves.
    pub(crate) fn legend<'a>(
        &mut self,
        entries: impl Iterator<Item = (&'a str, CurveStyle)>,
        with_symbols: bool,
    ) -> Result<(), DrawError> {
        const SAMPLE: f64 = 38.0;
        const LABEL: f64 = SAMPLE + 6.0;
        const GAP: f64 = 22.0;
        let mut seen: Vec<(&str, CurveStyle)> = Vec::new();
        let mut row = None;
        let mut left = 0.0;
        for entry in entries {
            if entry.0.is_empty() || seen.contains(&entry) {
                continue;
            }
            seen.push(entry);
            let (label, style) = entry;
            let label = fitted(label, &text::plain(), self.inner - LABEL);
            let width = LABEL + text_size(&label, &text::plain())[0];
            if left + width > self.inner {
                row = None;
            }
            let row = row.get_or_insert_with(|| {
                left = 0.0;
                self.take(19.0)
            });
            let at = |x: f64| (units(left + x), units(9.5));
            let line = PathElement::new(vec![at(0.0), at(SAMPLE)], stroke(style.rgb(), LINE));
            row.draw(&Clipped(line, style.dash))?;
            if let Some(symbol) = symbol(at(0.5 * SAMPLE), style, false).filter(|_| with_symbols) {
                row.draw(&symbol)?;
            }
            let middle = Pos::new(HPos::Left, VPos::Center);
            row.draw_text(&label, &text::plain().pos(middle), at(LABEL))?;
            left += width + GAP;
        }
        if !seen.is_empty() {
            self.take(5.0);
        }
        Ok(())
    }

    /// Draws colours, or hatching, with their names.
    pub(crate) fn key<'a>(
        &mut self,
        entries: impl Iterator<Item = (Option<RGBColor>, &'a str)>,
    ) -> Result<(), DrawError> {
        let row = self.take(4.0 + COLOR_SCALE[1] + 14.0).margin(units(4.0), 0, 0, 0);
        let mut left = 0.0;
        for (color, name) in entries {
            left += draw_sample(&row, [left, self.inner], color, name)? + 22.0;
        }
        Ok(())
    }

    /// Draws the scale of colours and, if wanted, what hatched cells mean.
    pub(crate) fn color_scale(
        &mut self,
        label: &str,
        colors: &Axis,
        with_hatching: bool,
    ) -> Result<(), DrawError> {
        let [width, height] = self.color_size();
        let row = self.take(4.0 + height + bottom_room(label)).margin(units(4.0), 0, 0, 0);
        self.take(8.0);
        let indent = 0.5 * (self.inner - width);
        let area = row.margin(0, 0, units(indent), units(indent));
        let flat = Axis::over([0.0, 1.0], Scale::Linear);
        let chart = draw_axes(&area, 0.0, [colors.clone(), flat], [label, ""], false)?;
        let size = [width, height].map(|length| (length * f64::from(PIXELS_PER_UNIT)) as u32);
        let line = (0..size[0]).flat_map(|x| {
            let color = shade_color((f64::from(x) + 0.5) / f64::from(size[0]));
            [color.0, color.1, color.2]
        });
        let pixels = line.collect::<Vec<u8>>().repeat(size[1] as usize);
        let picture = BitMapElement::with_owned_buffer((0, 0), size.into(), pixels);
        area.draw(&picture.ok_or(DrawError::LayoutError)?)?;
        draw_frame(&chart)?;
        if with_hatching {
            draw_sample(&row, [indent + width + 24.0, self.inner], None, "no value")?;
        }
        Ok(())
    }

    /// Width and height of the scale of colours.
    pub(crate) fn color_size(&self) -> [f64; 2] {
        let [width, height] = COLOR_SCALE;
        [width.min(0.7 * self.inner), height]
    }

    /// Draws the caption, each of its paragraphs wrapped; for a paper it is kept beside the figure.
    pub(crate) fn caption(&mut self, paragraphs: &[String]) -> Result<(), DrawError> {
        self.captions.extend_from_slice(paragraphs);
        if self.medium == Medium::Paper {
            return Ok(());
        }
        let (style, inner) = (text::caption(), self.inner);
        let lines: Vec<_> = paragraphs.iter().flat_map(|text| wrap(text, &style, inner)).collect();
        draw_lines(&self.take(height(&lines, &style)), &lines, &style)
    }

    /// Cuts the page here, and writes the files of its medium.
    pub(crate) fn save(self, stem: &Path) -> Result<Vec<PathBuf>, FigureError> {
        let medium = self.medium;
        let captions = (medium == Medium::Paper).then(|| self.captions.join("\n") + "\n");
        save(stem, &self.into_svg(), medium.endings(), captions.as_deref())
    }

    /// Cuts the page here.
    pub(crate) fn into_svg(self) -> String {
        let bottom = svg_units(self.free.get_base_pixel().1);
        let canvas = self.canvas.replace(Canvas::new(0.0));
        canvas.into_svg(bottom + margin(self.medium))
    }
}

/// Around the page (SVG units); a paper has margins of its own.
fn margin(medium: Medium) -> f64 {
    match medium {
        Medium::Screen => MARGIN,
        Medium::Paper => 0.25 * MARGIN,
    }
}

/// Height of lines of text.
pub(crate) fn height(lines: &[String], style: &TextStyle) -> f64 {
    lines.len() as f64 * LINE_HEIGHT * svg_units(style.font.get_size())
}

/// Draws lines of text beneath each other.
pub(crate) fn draw_lines(
    area: &Area,
    lines: &[String],
    style: &TextStyle,
) -> Result<(), DrawError> {
    for (index, line) in lines.iter().enumerate() {
        area.draw_text(line, style, (0, units(height(&lines[..index], style))))?;
    }
    Ok(())
}

/// Fills a box (left, top, right, bottom in SVG units), or hatches it.
pub(crate) fn fill(
    area: &Area,
    [left, top, right, bottom]: [f64; 4],
    color: Option<RGBColor>,
) -> Result<(), DrawError> {
    const STEP: f64 = 6.0;
    let corners = [(units(left), units(top)), (units(right), units(bottom))];
    area.draw(&Rectangle::new(corners, color.unwrap_or(FAINT_GRID).filled()))?;
    if color.is_none() {
        // Lines of the same x + y in all boxes, so that they go on in the next.
        let ends = [left + top, right + bottom].map(|sum| (sum / STEP).ceil() as i32);
        for sum in (ends[0]..ends[1]).map(|line| f64::from(line) * STEP) {
            let line = [left.max(sum - bottom), right.min(sum - top)];
            let line = line.map(|x| (units(x), units(sum - x)));
            area.draw(&PathElement::new(line.to_vec(), stroke(HATCH, 0.8)))?;
        }
    }
    Ok(())
}

/// Draws a colour, or hatching, with its name, from `left` on in a row of this width, and returns their width (SVG
/// units).
fn draw_sample(
    row: &Area,
    [left, width]: [f64; 2],
    color: Option<RGBColor>,
    name: &str,
) -> Result<f64, DrawError> {
    const LABEL: f64 = 30.0;
    let height = COLOR_SCALE[1];
    fill(row, [left, 0.0, left + 24.0, height], color)?;
    let style = text::plain().pos(Pos::new(HPos::Left, VPos::Center));
    let name = fitted(name, &style, (width - left - LABEL).max(0.0));
    row.draw_text(&name, &style, (units(left + LABEL), units(0.5 * height)))?;
    Ok(LABEL + text_size(&name, &style)[0])
}

/// Room left of a chart for the tick labels and the label of the y axis.
pub(crate) fn left_room(axis: &Axis, label: &str) -> f64 {
    let widths = axis.labels().map(|label| text_size(label, &text::plain())[0]);
    let title = if label.is_empty() { 0.0 } else { 1.5 * TEXT };
    widths.fold(0.0, f64::max) + title + 2.0 * TICK
}

/// Room below a chart for the tick labels and the label of the x axis.
pub(crate) fn bottom_room(label: &str) -> f64 {
    if label.is_empty() { 1.7 * TEXT } else { 3.0 * TEXT }
}

/// What a label takes up along a horizontal and along a vertical axis.
pub(crate) fn along_x(label: &str) -> f64 {
    text_size(label, &text::plain())[0] + 14.0
}

/// See [`along_x`].
pub(crate) fn along_y(_: &str) -> f64 {
    1.5 * TEXT
}

/// Draws axes with ticks, labels and, if wanted, grid lines; the chart takes up the area except
/// `left` and [`bottom_room`].
pub(crate) fn draw_axes(
    area: &Area,
    left: f64,
    [x, y]: [Axis; 2],
    [x_label, y_label]: [&str; 2],
    grid: bool,
) -> Result<Chart, DrawError> {
    let room = area.dim_in_pixel();
    let x_label = fitted(x_label, &text::plain(), svg_units(room.0) - left);
    let y_label = fitted(y_label, &text::plain(), svg_units(room.1) - bottom_room(&x_label));
    let mut chart = ChartBuilder::on(area)
        .x_label_area_size(units(bottom_room(&x_label)))
        .y_label_area_size(units(left))
        .build_cartesian_2d(x, y)?;
    let mut mesh = chart.configure_mesh();
    mesh.axis_style(stroke(FRAME, 1.0))
        .bold_line_style(stroke(GRID, 1.0))
        .light_line_style(stroke(FAINT_GRID, 1.0))
        .set_all_tick_mark_size(units(TICK))
        .label_style(text::plain())
        .x_desc(&*x_label)
        .y_desc(&*y_label);
    if !grid {
        mesh.disable_mesh();
    }
    mesh.draw()?;
    Ok(chart)
}

/// Draws the frame around a chart, over its data.
pub(crate) fn draw_frame(chart: &Chart) -> Result<(), DrawError> {
    let window = chart.plotting_area().strip_coord_spec();
    let (width, height) = window.dim_in_pixel();
    let corners = [(0, 0), (width as i32, height as i32)];
    window.draw(&Rectangle::new(corners, stroke(FRAME, 1.0)))
}

/// Draws a remark in place of data.
pub(crate) fn draw_remark(chart: &Chart, remark: &str) -> Result<(), DrawError> {
    let window = chart.plotting_area().strip_coord_spec();
    let (width, height) = window.dim_in_pixel();
    let style = text::caption().pos(Pos::new(HPos::Center, VPos::Center));
    window.draw_text(remark, &style, (width as i32 / 2, height as i32 / 2))
}
