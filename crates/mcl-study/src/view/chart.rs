//! A chart as plain data, independent of how it is drawn.

use mcl_metrics::IntervalBasis;

use crate::study::views::{ChartKind, Scale};
use crate::table::{Table, Value};

/// A chart.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartData {
    /// Name of its file without the ending.
    pub name: String,
    /// How it is drawn.
    pub kind: ChartKind,
    /// Its panels; those of a part are next to each other.
    pub panels: Vec<Panel>,
    /// Number of panels side by side.
    pub columns: usize,
    /// Paragraphs of the caption.
    pub caption: Vec<String>,
}

/// A panel of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Title above it.
    pub title: String,
    /// Number of its part: panels of the same part, with the same axes, are to be compared.
    pub part: usize,
    /// The horizontal axis.
    pub x: PanelAxis,
    /// The vertical axis, or the colour.
    pub y: PanelAxis,
    /// What the rows of cells stand for; empty for curves.
    pub curves: String,
    /// Labels of the curves, or rows of cells, in their order.
    pub labels: Vec<String>,
    /// The points, sorted by curve, then from left to right.
    pub points: Vec<Point>,
}

/// An axis of a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct PanelAxis {
    /// Label with unit.
    pub label: String,
    /// The scale.
    pub scale: Scale,
    /// Labels at positions 1, 2, …; empty where values are numbers.
    pub places: Vec<String>,
}

/// A group of rows in a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Index of its curve among the labels.
    pub curve: usize,
    /// Horizontal position: a value, or a position from 1 on.
    pub x: f64,
    /// The mean.
    pub y: f64,
    /// 95 % interval, where there is one.
    pub interval: Option<[f64; 2]>,
    /// The unit that the interval of a share treats as a trial; `None` for Student's interval.
    pub basis: Option<IntervalBasis>,
    /// Text beside an open symbol.
    pub mark: Option<String>,
    /// Independent units behind the mean.
    pub blocks: usize,
    /// Rows behind the mean.
    pub rows: usize,
}

impl ChartData {
    /// The points as a table: a row each, with the title of the panel, what its vertical axis shows, and the label of
    /// the curve.
    pub fn to_table(&self) -> Table {
        const COLUMNS: [&str; 10] =
            ["panel", "measure", "curve", "x", "y", "low", "high", "blocks", "rows", "mark"];
        let mut table = Table::new(COLUMNS);
        for panel in &self.panels {
            for point in &panel.points {
                let place = (point.x as usize).checked_sub(1);
                let x = match place.and_then(|place| panel.x.places.get(place)) {
                    Some(text) => Value::from(text.as_str()),
                    None => point.x.into(),
                };
                let ends = [0, 1].map(|end| point.interval.map(|interval| interval[end]).into());
                let [low, high] = ends;
                table.push(vec![
                    panel.title.as_str().into(),
                    panel.y.label.as_str().into(),
                    panel.labels[point.curve].as_str().into(),
                    x,
                    point.y.into(),
                    low,
                    high,
                    point.blocks.into(),
                    point.rows.into(),
                    point.mark.clone().into(),
                ]);
            }
        }
        table
    }
}
