//! Heat maps: values over two settings, as coloured cells with texts in them.

use std::path::{Path, PathBuf};

use mcl_core::text::counted;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, FontTransform, RGBColor};

use crate::axis::{Axis, Scale};
use crate::error::FigureError;
use crate::medium::Medium;
use crate::page::{
    Area, DrawError, Page, TITLE_GAP, along_x, draw_lines, fill, height, render_error,
};
use crate::style::{GRID, readable_on, shade_color};
use crate::text::{self, TEXT, fitted, text_size, wrap};
use crate::units::units;

/// Smallest and largest letters in cells.
const LETTERS: [f64; 2] = [7.0, TEXT - 1.0];
/// Narrowest and widest cells where there is room, and their height.
const CELL: [f64; 3] = [40.0, 110.0, 26.0];
/// Least width, and largest height, of a panel's cells.
const PANEL: [f64; 2] = [130.0, 700.0];
/// The longest labels of rows, and of columns where they are turned.
const LONGEST: f64 = 190.0;
/// From one label to the next where they stand close.
const LINE: f64 = 13.0;
/// Around texts.
const PAD: f64 = 4.0;

/// Heat maps that share one scale of colours.
#[derive(Debug, Clone)]
pub struct HeatFigure {
    /// The panels, with cells of the same size, beside each other where there is room.
    pub panels: Vec<HeatPanel>,
    /// Whether colours follow the logarithm of the values.
    pub log: bool,
    /// What the colours show, with its unit.
    pub label: String,
    /// Where values are classes: what each of them, and a hatched cell (`None`), stands for, as a key in
    /// place of a scale. Empty: a scale.
    pub key: Vec<(Option<f64>, String)>,
    /// Paragraphs beneath: the data set, the settings.
    pub caption: Vec<String>,
}

/// One panel of a [`HeatFigure`].
#[derive(Debug, Clone)]
pub struct HeatPanel {
    /// Stands above the panel; may be empty.
    pub title: String,
    /// What the columns are, with its unit; may be empty.
    pub x_label: String,
    /// What the rows are, with its unit; may be empty.
    pub y_label: String,
    /// The columns, from the left.
    pub x: Vec<String>,
    /// The rows, from the bottom: like numbers on an axis.
    pub y: Vec<String>,
    /// The cells, row by row: of `x[i]` and `y[j]`, `cells[j * x.len() + i]`. `None` is hatched.
    pub cells: Vec<Option<HeatCell>>,
}

/// One cell of a [`HeatPanel`].
#[derive(Debug, Clone, PartialEq)]
pub struct HeatCell {
    /// What the colour shows. A cell whose value is not finite or, with `log`, not positive is grey,
    /// and hatched if it has no text.
    pub value: f64,
    /// Stands in the cell: the value, a verdict. What has no room is left out, and the caption says so.
    pub text: String,
}

impl HeatCell {
    /// `None` of a cell that is hatched.
    fn color(&self, colors: &Axis) -> Option<RGBColor> {
        match colors.contains(self.value) {
            true => Some(shade_color(colors.fraction(self.value))),
            false => (!self.text.is_empty()).then_some(GRID),
        }
    }
}

/// Draws heat maps and writes `<stem>.svg` and `<stem>.png`, and what else the medium asks for.
///
/// # Errors
/// [`FigureError::Cells`] for a panel without exactly one cell per row and column;
/// [`FigureError::NothingToDraw`] when the colours can show no value of any panel.
/// [`FigureError::Render`] and [`FigureError::Write`] when a file cannot be made.
pub fn draw_heat(
    stem: &Path,
    figure: &HeatFigure,
    medium: Medium,
) -> Result<Vec<PathBuf>, FigureError> {
    for panel in &figure.panels {
        let (found, expected) = (panel.cells.len(), [panel.x.len(), panel.y.len()]);
        if expected[0].checked_mul(expected[1]) != Some(found) {
            let (stem, title) = (stem.into(), panel.title.clone());
            return Err(FigureError::Cells { stem, title, found, expected });
        }
    }
    let scale = if figure.log { Scale::Log } else { Scale::Linear };
    let cells = || figure.panels.iter().flat_map(|panel| &panel.cells);
    let of_key = || figure.key.iter().filter_map(|(value, _)| *value);
    let values = || cells().flatten().map(|cell| cell.value).chain(of_key());
    let values = || values().filter(|&value| scale.holds(value));
    let ends = values().reduce(f64::min).zip(values().reduce(f64::max));
    let Some((low, high)) = ends.filter(|_| cells().next().is_some()) else {
        let (stem, found) = (stem.into(), counted(cells().count(), "cell"));
        let expected = if figure.log { "positive value" } else { "value" };
        return Err(FigureError::NothingToDraw { stem, found, expected });
    };
    // A heat map of one panel fits a column.
    let page = Page::new(medium, figure.panels.len());
    let colors = Axis::over([low, high], scale).with_ticks(page.color_size()[0], along_x);
    draw_page(page, figure, &colors).map_err(render_error(stem))?.save(stem)
}

fn draw_page(mut page: Page, figure: &HeatFigure, colors: &Axis) -> Result<Page, DrawError> {
    const GAP: f64 = 24.0;
    let inner = page.inner;
    let cells = || figure.panels.iter().flat_map(|panel| &panel.cells);
    let hatched = |cell: &Option<HeatCell>| cell.as_ref().is_none_or(|c| c.color(colors).is_none());
    match figure.key.is_empty() {
        true => page.color_scale(&figure.label, colors, cells().any(hatched))?,
        false => page.key(figure.key.iter().map(|(value, name)| {
            (value.map(|value| shade_color(colors.fraction(value))), name.as_str())
        }))?,
    }
    let layout = Layout::of(&figure.panels, inner);
    let slot = layout.left + layout.width + GAP;
    let columns = (((inner + GAP) / slot) as usize).clamp(1, figure.panels.len());
    let indent = 0.5 * (inner + GAP - columns as f64 * slot);
    let room = if columns == 1 { inner - indent - layout.left } else { layout.width };
    let mut without_room = 0;
    for row in figure.panels.chunks(columns) {
        let titles: Vec<_> =
            row.iter().map(|panel| wrap(&panel.title, &text::title(), room)).collect();
        let heights = titles.iter().map(|lines| height(lines, &text::title()));
        let above = page.take(heights.fold(0.0, f64::max) + TITLE_GAP);
        let rows = row.iter().map(|panel| panel.y.len()).max().unwrap_or(0);
        let below = page.take(rows as f64 * layout.cell[1] + layout.bottom);
        for (index, (panel, title)) in row.iter().zip(&titles).enumerate() {
            let at = indent + index as f64 * slot;
            draw_lines(&above.margin(0, 0, units(at + layout.left), 0), title, &text::title())?;
            let area = below.margin(0, 0, units(at), 0);
            layout.draw_labels(&area, panel)?;
            without_room += layout.draw_map(&area, panel, colors)?;
        }
        page.take(10.0);
    }
    let mut caption = figure.caption.clone();
    let beyond = cells().flatten().filter(|cell| !colors.contains(cell.value)).count();
    if beyond > 0 {
        caption.push(format!("Without a colour: {} not on its scale.", counted(beyond, "value")));
    }
    if without_room > 0 {
        caption.push(format!("Left out: {} too large for a cell.", counted(without_room, "text")));
    }
    page.caption(&caption)?;
    Ok(page)
}

/// How every panel is laid out (SVG units).
struct Layout {
    /// Width and height of a cell.
    cell: [f64; 2],
    /// Width of the cells of the widest panel.
    width: f64,
    /// Room for the labels of the rows.
    left: f64,
    /// Room for the labels of the columns.
    bottom: f64,
    /// Whether these are turned.
    turned: bool,
}

impl Layout {
    /// Of panels on a page of this inner width (SVG units).
    fn of(panels: &[HeatPanel], inner: f64) -> Self {
        fn widest<'a>(texts: impl Iterator<Item = &'a String>) -> f64 {
            texts.map(|text| text_size(text, &text::plain())[0]).fold(0.0, f64::max) + 2.0 * PAD
        }
        let most = |of: fn(&HeatPanel) -> usize| panels.iter().map(of).fold(1, usize::max) as f64;
        let columns = most(|panel| panel.x.len());
        let title = |label: fn(&HeatPanel) -> &String| {
            if panels.iter().all(|panel| label(panel).is_empty()) { 0.0 } else { 1.4 * TEXT }
        };
        let rows = widest(panels.iter().flat_map(|panel| &panel.y)).min(LONGEST);
        let left = rows + title(|panel| &panel.y_label);
        let labels = widest(panels.iter().flat_map(|panel| &panel.x));
        let cells = panels.iter().flat_map(|panel| panel.cells.iter().flatten());
        let texts = widest(cells.map(|cell| &cell.text));
        let room = ((inner - left) / columns).min(CELL[1]);
        let turned = labels > room;
        let wanted = if turned { texts } else { texts.max(labels) };
        let width = wanted.max(CELL[0]).max(PANEL[0] / columns).min(room);
        let cell = [width, (PANEL[1] / most(|panel| panel.y.len())).min(CELL[2])];
        let below = if turned { labels.min(LONGEST) } else { LINE + PAD };
        let bottom = below + title(|panel| &panel.x_label);
        Layout { cell, width: columns * width, left, bottom, turned }
    }

    fn draw_labels(&self, area: &Area, panel: &HeatPanel) -> Result<(), DrawError> {
        let draw = |text: &str, room: f64, turned: bool, [x, y]: [f64; 2], at: (HPos, VPos)| {
            let turn = if turned { FontTransform::Rotate270 } else { FontTransform::None };
            let style = text::plain().pos(Pos::new(at.0, at.1)).transform(turn);
            area.draw_text(&fitted(text, &style, room), &style, (units(x), units(y)))
        };
        let [width, height] = [panel.x.len(), panel.y.len()].map(|count| count as f64);
        let [width, height] = [width * self.cell[0], height * self.cell[1]];
        if panel.cells.is_empty() {
            return draw(
                "no data here",
                f64::INFINITY,
                false,
                [self.left, 0.0],
                (HPos::Left, VPos::Top),
            );
        }
        // Where cells are smaller than labels, only some have one.
        let steps = self.cell.map(|length| (LINE / length).ceil() as usize);
        for (row, label) in panel.y.iter().enumerate().step_by(steps[1]) {
            let at = [self.left - PAD, height - (row as f64 + 0.5) * self.cell[1]];
            draw(label, LONGEST - 2.0 * PAD, false, at, (HPos::Right, VPos::Center))?;
        }
        for (column, label) in panel.x.iter().enumerate().step_by(steps[0]) {
            let at = [self.left + (column as f64 + 0.5) * self.cell[0], height + PAD];
            match self.turned {
                true => draw(label, LONGEST - 2.0 * PAD, true, at, (HPos::Right, VPos::Center))?,
                false => draw(label, self.cell[0], false, at, (HPos::Center, VPos::Top))?,
            }
        }
        let at = [self.left + 0.5 * width, height + self.bottom];
        draw(&panel.x_label, self.width, false, at, (HPos::Center, VPos::Bottom))?;
        let beyond = text_size(&panel.y_label, &text::plain())[0] > height;
        let room = if beyond { height + self.bottom } else { height };
        draw(&panel.y_label, room, true, [0.0, 0.5 * room], (HPos::Center, VPos::Top))
    }

    /// Returns how many texts have no room.
    fn draw_map(&self, area: &Area, panel: &HeatPanel, colors: &Axis) -> Result<usize, DrawError> {
        let [width, height] = self.cell;
        let edge = if width.min(height) > 6.0 { 0.5 } else { 0.0 };
        let room = if height < LINE { 0.0 } else { (width - 2.0 * PAD).max(0.0) };
        // Widths in letter sizes; the widest text that has room at all says how large letters are.
        let measure = |cell: &HeatCell| text_size(&cell.text, &text::plain())[0] / TEXT;
        let cells = panel.cells.iter().map(|cell| cell.as_ref().map(|cell| (cell, measure(cell))));
        let cells: Vec<_> = cells.collect();
        let fitting = cells.iter().flatten().filter(|(_, wide)| wide * LETTERS[0] <= room);
        let widest = fitting.map(|&(_, wide)| wide).fold(f64::MIN_POSITIVE, f64::max);
        let size = (room / widest).clamp(LETTERS[0], LETTERS[1]);
        let mut without_room = 0;
        for (index, &cell) in cells.iter().enumerate() {
            let left = self.left + (index % panel.x.len()) as f64 * width;
            let top = (panel.y.len() - 1 - index / panel.x.len()) as f64 * height;
            let sides = [left + edge, top + edge, left + width - edge, top + height - edge];
            let color = cell.and_then(|(cell, _)| cell.color(colors));
            fill(area, sides, color)?;
            let (Some((cell, wide)), Some(color)) = (cell, color) else { continue };
            if wide * size > room + 1e-9 {
                without_room += 1;
                continue;
            }
            let style = text::style(size, FontStyle::Normal, &readable_on(color));
            let style = style.pos(Pos::new(HPos::Center, VPos::Center));
            let middle = (units(left + 0.5 * width), units(top + 0.5 * height));
            area.draw_text(&cell.text, &style, middle)?;
        }
        Ok(without_room)
    }
}
