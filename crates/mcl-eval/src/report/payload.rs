//! The data for the page's script, as compressed JSON: points of charts, rows of tables.

use std::io::Write;

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_core::text::printable;
use mcl_figures::{CurveStyle, Dash, Marker, styles};
use mcl_study::study::views::{ChartKind, Scale};
use mcl_study::table::{Table, Value};
use mcl_study::view::chart::{ChartData, Panel, PanelAxis, Point};
use mcl_study::view::labels::name_and_unit;
use serde::Serialize;

use crate::report::text::shown;

/// Bytes, compressed, as base64.
///
/// # Errors
/// When memory is exhausted.
pub fn pack(bytes: &[u8]) -> Result<String> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    Ok(STANDARD.encode(encoder.finish()?))
}

/// Charts and tables of a result folder.
#[derive(Serialize)]
pub struct Payload {
    /// Its charts.
    pub charts: Vec<Chart>,
    /// Its tables.
    pub tables: Vec<TableData>,
}

/// A chart.
#[derive(Serialize)]
pub struct Chart {
    name: String,
    /// Whether values are shown as colours.
    heat: bool,
    panels: Vec<PanelData>,
}

#[derive(Serialize)]
struct PanelData {
    title: String,
    x: Axis,
    y: Axis,
    labels: Vec<String>,
    styles: Vec<Style>,
    /// Panels with the same number share their axes.
    part: usize,
    points: Vec<DrawnPoint>,
}

/// Curve, x, y, low, high, blocks, rows, mark.
type DrawnPoint = (usize, f64, f64, Option<f64>, Option<f64>, usize, usize, Option<String>);

#[derive(Serialize)]
struct Axis {
    label: String,
    scale: Scale,
    places: Vec<String>,
}

/// The style of a curve.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Style {
    /// Index in the palette.
    pub color: usize,
    /// Name of the dash pattern in plotly.
    pub dash: &'static str,
    /// Name of the symbol in plotly.
    pub marker: &'static str,
}

/// A table, with all digits.
#[derive(Serialize)]
pub struct TableData {
    /// Its title.
    pub title: String,
    columns: Vec<Column>,
    rows: Vec<Vec<Value>>,
}

#[derive(Serialize)]
struct Column {
    name: String,
    label: String,
}

impl Style {
    fn of(style: CurveStyle) -> Self {
        let dash = match style.dash {
            Dash::Solid => "solid",
            Dash::Dashed => "dash",
            Dash::Dotted => "dot",
            Dash::DashDot => "dashdot",
        };
        let marker = match style.marker {
            None => "",
            Some(Marker::Circle) => "circle",
            Some(Marker::Square) => "square",
            Some(Marker::TriangleUp) => "triangle-up",
            Some(Marker::Diamond) => "diamond",
            Some(Marker::TriangleDown) => "triangle-down",
            Some(Marker::Pentagon) => "pentagon",
        };
        Style { color: style.color, dash, marker }
    }
}

/// The curves of a chart, each once, with the same style as in the figures for print.
pub fn curves(chart: &ChartData) -> Vec<(String, Style)> {
    let labels: Vec<&String> = chart.panels.iter().flat_map(|panel| &panel.labels).collect();
    let mut curves: Vec<(String, Style)> = Vec::new();
    for (label, style) in labels.iter().zip(styles(&labels)) {
        let label = shown(label);
        if !curves.iter().any(|(known, _)| *known == label) {
            curves.push((label, Style::of(style)));
        }
    }
    curves
}

/// A chart for the script.
pub fn chart(chart: &ChartData) -> Chart {
    let curves = curves(chart);
    let axis = |axis: &PanelAxis| Axis {
        label: shown(&axis.label),
        scale: axis.scale,
        places: axis.places.iter().map(|place| shown(place)).collect(),
    };
    let point = |point: &Point| -> DrawnPoint {
        let Point { curve, x, y, interval, mark, blocks, rows, .. } = point;
        let [low, high] = [0, 1].map(|end| interval.map(|interval| on_screen(interval[end])));
        let mark = mark.as_deref().map(shown);
        (*curve, on_screen(*x), on_screen(*y), low, high, *blocks, *rows, mark)
    };
    let panel = |panel: &Panel| {
        let labels: Vec<String> = panel.labels.iter().map(|label| shown(label)).collect();
        let style = |label: &String| curves.iter().find(|(known, _)| known == label).map(|c| c.1);
        PanelData {
            title: shown(&panel.title),
            x: axis(&panel.x),
            y: axis(&panel.y),
            styles: labels.iter().filter_map(style).collect(),
            labels,
            part: panel.part,
            points: panel.points.iter().map(point).collect(),
        }
    };
    Chart {
        name: shown(&chart.name),
        heat: chart.kind == ChartKind::Heat,
        panels: chart.panels.iter().map(panel).collect(),
    }
}

/// A number rounded to seven digits, more than a screen shows, in half the bytes; the tables have all digits.
fn on_screen(number: f64) -> f64 {
    format!("{number:.6e}").parse().unwrap_or(number)
}

/// A table for the script.
pub fn listed(title: &str, table: &Table) -> TableData {
    let column = |name: &String| Column { name: shown(name), label: shown(&name_and_unit(name).0) };
    let cell = |value: &Value| match value {
        Value::Text(text) => Value::Text(printable(text).into_owned()),
        other => other.clone(),
    };
    let columns: Vec<Column> = table.columns().iter().map(column).collect();
    let names = table.columns();
    let rows = table.rows().map(|row| names.iter().map(|name| cell(row.get(name))).collect());
    TableData { title: title.to_owned(), columns, rows: rows.collect() }
}
