//! The data for the page's script, as compressed JSON: points of charts, rows of tables.

use std::io::Write;

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_core::text::{counted, printable};
use mcl_figures::{CurveStyle, Dash, Marker, styles};
use mcl_study::study::views::{ChartKind, LOST, Scale};
use mcl_study::table::{Table, Value};
use mcl_study::view::chart::{ChartData, Panel, PanelAxis, Point};
use mcl_study::view::labels::{axis_label, name_and_unit};
use mcl_study::view::summary::KEPT;
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
    let drawn = |panel: &Panel, point: &Point| -> DrawnPoint {
        let Point { curve, x, y, interval, mark, blocks, rows, .. } = point;
        let [low, high] = [0, 1].map(|end| interval.map(|interval| on_screen(interval[end])));
        let mark = mark.as_deref().map(|mark| match mark {
            "" => lost(chart, panel, point),
            mark => shown(mark),
        });
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
            points: panel.points.iter().map(|point| drawn(panel, point)).collect(),
        }
    };
    Chart {
        name: shown(&chart.name),
        heat: chart.kind == ChartKind::Heat,
        panels: chart.panels.iter().map(panel).collect(),
    }
}

/// "3 of 20 runs lost": what an open symbol without text means. The number is in another panel.
fn lost(chart: &ChartData, of: &Panel, point: &Point) -> String {
    // Titles are those of the part, then of the panel's settings.
    let settings = |panel: &Panel| panel.title.split_once(": ").map(|(_, rest)| rest.to_owned());
    let is_beside =
        |panel: &&Panel| panel.y.label == axis_label(LOST) && settings(panel) == settings(of);
    let found = chart.panels.iter().filter(is_beside).find_map(|panel| {
        panel
            .points
            .iter()
            .find(|other| other.x == point.x && panel.labels[other.curve] == of.labels[point.curve])
    });
    match found {
        Some(Point { y, rows, .. }) => {
            format!("{:.0} of {} lost", y * *rows as f64, counted(*rows, "run"))
        }
        None => "some runs were lost".to_owned(),
    }
}

/// Headings of the columns of tests, which are no measures.
const OF_TESTS: [(&str, &str); 6] = [
    ("y", "measure"),
    ("column", "compared"),
    ("a", "first"),
    ("b", "second"),
    ("kind", "effect as"),
    ("p_holm", "p after Holm"),
];

/// The heading of a column of a table with these columns.
fn heading(column: &str, columns: &[String]) -> String {
    let has = |ending: &str| columns.iter().any(|known| *known == format!("{column}{ending}"));
    // Answers of yes or no are counted in summaries; they have no standard deviation.
    if has("_low") && !has("_sd") && !column.starts_with(KEPT) {
        let (name, _) = name_and_unit(column);
        return match name.strip_prefix("share of ") {
            Some(of) => format!("number of {of}"),
            None => format!("number of runs {name}"),
        };
    }
    match OF_TESTS.iter().find(|(known, _)| *known == column) {
        Some((_, heading)) => (*heading).to_owned(),
        None => axis_label(column),
    }
}

/// A number rounded to seven digits, more than a screen shows, in half the bytes; the tables have all digits.
fn on_screen(number: f64) -> f64 {
    format!("{number:.6e}").parse().unwrap_or(number)
}

/// A table for the script.
pub fn listed(title: &str, table: &Table) -> TableData {
    let column =
        |name: &String| Column { name: shown(name), label: shown(&heading(name, table.columns())) };
    let cell = |value: &Value| match value {
        Value::Text(text) => Value::Text(printable(text).into_owned()),
        other => other.clone(),
    };
    let columns: Vec<Column> = table.columns().iter().map(column).collect();
    let names = table.columns();
    let rows = table.rows().map(|row| names.iter().map(|name| cell(row.get(name))).collect());
    TableData { title: title.to_owned(), columns, rows: rows.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(title: &str, y: &str, points: &[(usize, f64, f64, usize, Option<&str>)]) -> Panel {
        let axis = |label: String| PanelAxis { label, scale: Scale::Linear, places: Vec::new() };
        let point = |&(curve, x, y, rows, mark): &(usize, f64, f64, usize, Option<&str>)| Point {
            curve,
            x,
            y,
            interval: None,
            basis: None,
            mark: mark.map(str::to_owned),
            blocks: rows,
            rows,
        };
        Panel {
            title: title.to_owned(),
            part: 0,
            x: axis("x".to_owned()),
            y: axis(axis_label(y)),
            curves: String::new(),
            labels: vec!["gbs".to_owned(), "rnd".to_owned()],
            points: points.iter().map(point).collect(),
        }
    }

    /// Fault: the hover of a point ended in "open symbol: ", and the column of its table was empty.
    #[test]
    fn lost_runs_are_counted_at_the_points_they_are_left_out_of() {
        let panels = vec![
            panel(
                "never lost: book",
                "tracked_weighted",
                &[
                    (1, 1.0, 0.02, 17, Some("")),
                    (1, 5.0, 0.02, 20, None),
                    (0, 1.0, 0.1, 9, Some("")),
                ],
            ),
            panel("runs lost: carmen", LOST, &[(1, 1.0, 1.0, 20, None)]),
            panel("runs lost: book", LOST, &[(1, 1.0, 0.15, 20, None), (1, 5.0, 0.0, 20, None)]),
        ];
        let data = ChartData {
            name: "errors".to_owned(),
            kind: ChartKind::Curves,
            panels,
            columns: 1,
            caption: Vec::new(),
        };
        let marks: Vec<Option<String>> =
            chart(&data).panels[0].points.iter().map(|point| point.7.clone()).collect();
        let expected = [Some("3 of 20 runs lost"), None, Some("some runs were lost")];
        assert_eq!(marks, expected.map(|mark| mark.map(str::to_owned)));
    }

    /// Fault: 20 of 20 runs stood as 20.00 under "share of diverged runs".
    #[test]
    fn columns_have_units() {
        let columns = ["weighted", "weighted_sd", "weighted_low", "diverged", "diverged_low"];
        let counted =
            Table::new(columns.into_iter().chain(["found", "found_low", "kept_weighted"]));
        let labels: Vec<String> =
            listed("", &counted).columns.into_iter().map(|column| column.label).collect();
        assert_eq!(labels[0], "mean weighted error d [–]");
        assert_eq!([&labels[3], &labels[5]], ["number of diverged runs", "number of runs found"]);
        let table = Table::new(["size_percent", "size_points", "p_holm", "own_column"]);
        let labels: Vec<String> =
            listed("", &table).columns.into_iter().map(|column| column.label).collect();
        assert_eq!(
            labels,
            [
                "requested map size [% of the points that build the map]",
                "requested map size [points]",
                "p after Holm",
                "own column"
            ]
        );
    }
}
