//! Draws charts from their data.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use mcl_core::text::number;
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, HeatCell, HeatFigure,
    HeatPanel, Medium, Scale, draw_curves, draw_heat, styles,
};
use mcl_study::study::views::{self, ChartKind};
use mcl_study::view::chart::{ChartData, Panel, PanelAxis, Point};

/// Curves with more points are drawn without symbols.
const MOST_SYMBOLS: usize = 20;

/// Draws a chart.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(stem: &Path, chart: &ChartData, medium: Medium) -> Result<Vec<PathBuf>> {
    Ok(match chart.kind {
        ChartKind::Curves => draw_curves(stem, &curve_figure(chart), medium)?,
        ChartKind::Heat => draw_heat(stem, &heat_figure(chart), medium)?,
    })
}

fn curve_figure(chart: &ChartData) -> CurveFigure {
    let labels: Vec<&String> = chart.panels.iter().flat_map(|panel| &panel.labels).collect();
    let styles: HashMap<&String, CurveStyle> =
        labels.iter().copied().zip(styles(&labels)).collect();
    let mut is_cut = false;
    let panels = chart.panels.iter().map(|panel| {
        let [x, y] = ranges(chart, panel);
        let lowest = y.map(|[low, _]| low);
        let curves = panel.labels.iter().enumerate().map(|(place, label)| {
            let of_curve = || panel.points.iter().filter(|point| point.curve == place);
            let points = of_curve().map(|point| {
                let mut interval = point.interval;
                if let (true, Some(lowest), Some([low, _])) =
                    (is_below(panel, point), lowest, &mut interval)
                {
                    // Beyond the frame, which clips it.
                    *low = if lowest > 0.0 { 0.5 * lowest } else { -1.0 };
                    is_cut = true;
                }
                CurvePoint { x: point.x, mean: point.y, interval, mark: point.mark.clone() }
            });
            let points = points.collect();
            let mut style = styles[label];
            if of_curve().count() > MOST_SYMBOLS {
                style.marker = None;
            }
            Curve { label: label.clone(), style, points }
        });
        let curves = curves.collect();
        CurvePanel {
            title: panel.title.clone(),
            x: AxisSpec {
                label: label_with_scale(&panel.x, label_with_places(&panel.x)),
                scale: scale(&panel.x),
                range: x,
                names: Vec::new(),
            },
            y: AxisSpec {
                label: label_with_scale(&panel.y, panel.y.label.clone()),
                scale: scale(&panel.y),
                range: y,
                names: Vec::new(),
            },
            curves,
        }
    });
    let panels = panels.collect();
    let mut caption = chart.caption.clone();
    let is_symlog = |axis: &PanelAxis| matches!(scale(axis), Scale::Symlog { .. });
    if let (true, Some(last)) =
        (chart.panels.iter().any(|p| is_symlog(&p.x) || is_symlog(&p.y)), caption.last_mut())
    {
        *last +=
            " Axes marked log. are logarithmic for negative values, too, and even around zero.";
    }
    if is_cut && let Some(last) = caption.last_mut() {
        *last += " Intervals that the lower edge cuts off reach down to zero or below.";
    }
    CurveFigure { panels, columns: chart.columns, caption }
}

/// Whether an axis shows shares, which are never negative.
fn is_share(axis: &PanelAxis) -> bool {
    axis.label.starts_with("share") && scale(axis) == Scale::Linear
}

/// Whether an interval extends below the range of the axis.
fn is_below(panel: &Panel, point: &Point) -> bool {
    let Some([low, _]) = point.interval else { return false };
    match scale(&panel.y) {
        Scale::Log => low <= 0.0,
        _ => is_share(&panel.y) && low < 0.0,
    }
}

fn scale(axis: &PanelAxis) -> Scale {
    match axis.scale {
        views::Scale::Linear => Scale::Linear,
        views::Scale::Places => Scale::Places,
        views::Scale::Log => Scale::Log,
        views::Scale::Symlog => Scale::Symlog { linear_below: 1.0 },
        views::Scale::SymlogFine => Scale::Symlog { linear_below: 0.1 },
    }
}

/// The label names a scale that is logarithmic on both sides of zero, as it is not recognizable where all
/// values are negative.
fn label_with_scale(axis: &PanelAxis, label: String) -> String {
    match scale(axis) {
        Scale::Symlog { .. } => format!("{label}, log."),
        _ => label,
    }
}

/// "α: 1 = (0.1, 0.2), 2 = (0.3, 0.4)": values that are not numbers are shown at their positions in the list.
fn label_with_places(axis: &PanelAxis) -> String {
    if axis.places.is_empty() {
        return axis.label.clone();
    }
    let places =
        axis.places.iter().enumerate().map(|(place, text)| format!("{} = {text}", place + 1));
    format!("{}: {}", axis.label, places.collect::<Vec<_>>().join(", "))
}

/// Ranges of the axes of a panel, where they differ from those of its own points: panels of a part with the
/// same axes share them, marked points need room for the text beside them, and an interval may have an end
/// that a logarithmic axis cannot show.
fn ranges(chart: &ChartData, panel: &Panel) -> [Option<[f64; 2]>; 2] {
    let is_alike =
        |other: &&Panel| (other.part, &other.x, &other.y) == (panel.part, &panel.x, &panel.y);
    let alike: Vec<&Panel> = chart.panels.iter().filter(is_alike).collect();
    let points = || alike.iter().flat_map(|panel| &panel.points);
    let is_shared = alike.len() > 1;
    // Other panels over the same axis, above or below.
    let is_over = |other: &&Panel| other.x == panel.x && other.y.label != panel.y.label;
    let over: Vec<&Panel> =
        chart.panels.iter().filter(|other| is_alike(other) || is_over(other)).collect();
    let over_points = || over.iter().flat_map(|panel| &panel.points);
    let x = if panel.x.scale == views::Scale::Places {
        Some([0.5, panel.x.places.len() as f64 + 0.5])
    } else if over.len() > 1 || points().any(|point| point.mark.is_some()) {
        around(over_points().map(|point| point.x), scale(&panel.x), 0.4)
    } else {
        None
    };
    let y = if is_shared || points().any(|point| is_below(panel, point)) {
        let ends = points().flat_map(|point| {
            let [low, high] = point.interval.unwrap_or([point.y; 2]);
            [low, point.y, high]
        });
        around(ends, scale(&panel.y), 0.2)
    } else {
        None
    };
    // Intervals of means may extend below zero, those of shares do not.
    let y = match y {
        Some([low, high]) if is_share(&panel.y) && low < 0.0 => Some([0.0, high]),
        None if is_share(&panel.y) && points().all(|point| point.y == 0.0) => Some([0.0, 0.1]),
        y => y,
    };
    [x, y]
}

/// Range around the values that a scale can show, with a margin: on a logarithmic scale a share of the
/// values, else of their extent.
fn around(values: impl Iterator<Item = f64>, scale: Scale, room: f64) -> Option<[f64; 2]> {
    let is_held = |value: &f64| value.is_finite() && (scale != Scale::Log || *value > 0.0);
    let (low, high) = values
        .filter(is_held)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let range = match scale {
        Scale::Log => [low / (1.0 + room), high * (1.0 + room)],
        Scale::Linear | Scale::Places => {
            let room = 0.2 * room * (high - low);
            // Values that are never negative need no negative part of the axis.
            let least = if low >= 0.0 { (low - room).max(0.0) } else { low - room };
            [least, high + room]
        }
        Scale::Symlog { linear_below } => {
            [low - room * low.abs().max(linear_below), high + room * high.abs().max(linear_below)]
        }
    };
    (range[0] < range[1] && range.iter().all(|end| end.is_finite())).then_some(range)
}

fn heat_figure(chart: &ChartData) -> HeatFigure {
    let panels = chart.panels.iter().map(|panel| {
        let (width, height) = (panel.x.places.len(), panel.labels.len());
        let mut cells = vec![None; width * height];
        for point in &panel.points {
            let place = (point.x as usize).saturating_sub(1);
            let text = match &point.mark {
                Some(mark) => format!("{} ({mark})", number(point.y)),
                None => number(point.y),
            };
            if let Some(cell) = cells.get_mut(point.curve * width + place) {
                *cell = Some(HeatCell { value: point.y, text });
            }
        }
        HeatPanel {
            title: panel.title.clone(),
            x_label: panel.x.label.clone(),
            y_label: panel.curves.clone(),
            x: panel.x.places.clone(),
            y: panel.labels.clone(),
            cells,
        }
    });
    let y = chart.panels.first().map(|panel| &panel.y);
    HeatFigure {
        panels: panels.collect(),
        log: y.is_some_and(|y| y.scale == views::Scale::Log),
        label: y.map_or(String::new(), |y| y.label.clone()),
        key: Vec::new(),
        caption: chart.caption.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(scale: views::Scale) -> PanelAxis {
        PanelAxis { label: "axis".to_owned(), scale, places: Vec::new() }
    }

    fn point(x: f64, y: f64, interval: Option<[f64; 2]>) -> Point {
        Point { curve: 0, x, y, interval, basis: None, mark: None, blocks: 2, rows: 2 }
    }

    fn chart(kind: ChartKind, scale: views::Scale, points: Vec<Vec<Point>>) -> ChartData {
        let panels = points.into_iter().map(|points| Panel {
            title: String::new(),
            part: 0,
            x: PanelAxis {
                places: vec!["low".to_owned(), "high".to_owned()],
                ..axis(views::Scale::Places)
            },
            y: axis(scale),
            curves: "rows".to_owned(),
            labels: vec!["gbs".to_owned()],
            points,
        });
        ChartData {
            columns: 1,
            name: "chart".to_owned(),
            kind,
            panels: panels.collect(),
            caption: vec!["C.".into()],
        }
    }

    /// Fault: Student's interval of an error may extend below zero, which a logarithmic axis cannot show; the
    /// bar was left out, exactly where some runs were lost.
    #[test]
    fn intervals_beyond_a_logarithmic_axis_are_cut_off_and_not_left_out() {
        let points = vec![point(1.0, 2.0, Some([-1.0, 5.0])), point(2.0, 0.1, Some([0.05, 0.2]))];
        let figure = curve_figure(&chart(ChartKind::Curves, views::Scale::Log, vec![points]));
        let [low, high] = figure.panels[0].y.range.unwrap();
        assert!(0.0 < low && low < 0.05 && high > 5.0);
        let drawn = &figure.panels[0].curves[0].points;
        let [below, above] = drawn[0].interval.unwrap();
        assert!(0.0 < below && below < low, "{drawn:?}");
        assert_eq!((above, drawn[1].interval), (5.0, Some([0.05, 0.2])));
        assert!(
            figure.caption[0].ends_with("reach down to zero or below."),
            "{:?}",
            figure.caption
        );
        // Otherwise they are unchanged.
        let points = vec![point(1.0, 2.0, Some([-1.0, 5.0]))];
        let figure = curve_figure(&chart(ChartKind::Curves, views::Scale::Linear, vec![points]));
        assert_eq!(figure.panels[0].curves[0].points[0].interval, Some([-1.0, 5.0]));
        assert_eq!((figure.panels[0].y.range, &*figure.caption[0]), (None, "C."));
    }

    /// Fault: panels above one another had the sizes of their own points only, so that curves could not be
    /// followed down.
    #[test]
    fn what_is_shown_of_the_same_sizes_shares_them_and_shares_are_not_negative() {
        let log = |label: &str| PanelAxis { label: label.to_owned(), ..axis(views::Scale::Log) };
        let panel = |part: usize, y: PanelAxis, points: Vec<Point>| Panel {
            title: String::new(),
            part,
            x: log("map size"),
            y,
            curves: String::new(),
            labels: vec!["gbs".to_owned()],
            points,
        };
        let share = PanelAxis { label: "share of time lost".into(), ..axis(views::Scale::Linear) };
        let points = vec![point(0.1, 0.2, Some([-0.1, 0.5])), point(10.0, 0.0, Some([0.0, 0.2]))];
        let mut chart = chart(ChartKind::Curves, views::Scale::Log, Vec::new());
        chart.panels = vec![
            panel(0, log("error"), vec![point(1.0, 0.1, None), point(10.0, 0.02, None)]),
            panel(1, share, points),
        ];
        let figure = curve_figure(&chart);
        let [error, lost] = &figure.panels[..] else { panic!("{figure:?}") };
        assert_eq!(error.x.range, lost.x.range);
        assert!(error.x.range.is_some_and(|[low, high]| low < 0.1 && high > 10.0));
        assert!(lost.y.range.is_some_and(|[low, high]| low == 0.0 && high > 0.5), "{lost:?}");
        let drawn = &lost.curves[0].points;
        assert!(drawn[0].interval.is_some_and(|[low, _]| low < 0.0));
        assert_eq!(drawn[1].interval, Some([0.0, 0.2]));
        chart.panels[1].points = vec![point(0.1, 0.0, None), point(10.0, 0.0, None)];
        assert_eq!(curve_figure(&chart).panels[1].y.range, Some([0.0, 0.1]), "nothing lost");
    }

    #[test]
    fn panels_that_are_to_be_compared_share_their_axes() {
        let panels = vec![vec![point(1.0, 2.0, None)], vec![point(2.0, 10.0, None)]];
        let figure = curve_figure(&chart(ChartKind::Curves, views::Scale::Linear, panels));
        assert_eq!(figure.panels[0].y.range, figure.panels[1].y.range);
        let [low, high] = figure.panels[0].y.range.unwrap();
        assert!(low < 2.0 && high > 10.0);
        assert_eq!(figure.panels[0].x.label, "axis: 1 = low, 2 = high");
        assert_eq!(figure.panels[0].x.range, Some([0.5, 2.5]));
    }

    #[test]
    fn cells_stand_at_their_places() {
        let mut marked = point(2.0, 0.25, None);
        marked.mark = Some("1/2".to_owned());
        let figure = heat_figure(&chart(ChartKind::Heat, views::Scale::Log, vec![vec![marked]]));
        let panel = &figure.panels[0];
        assert!(figure.log);
        assert_eq!((panel.x.len(), panel.y_label.as_str()), (2, "rows"));
        let cell = HeatCell { value: 0.25, text: "0.250 (1/2)".to_owned() };
        assert_eq!(panel.cells, [None, Some(cell)]);
    }
}
