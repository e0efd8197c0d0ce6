//! Error over time.

use std::path::Path;

use anyhow::Result;
use mcl_core::Stamp;

use super::Evaluated;
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Dash, Interval, Scale,
    draw_curve_file,
};

/// Draws translation and heading errors of all estimates over the time since the first pose.
pub fn draw(path: &Path, reference: &str, estimates: &[Evaluated]) -> Result<()> {
    let stamps = estimates.iter().flat_map(|estimate| &estimate.stamps);
    let first = stamps.min().copied().unwrap_or(Stamp::from_nanoseconds(0));
    let panel = |label: &str, values: fn(&Evaluated) -> Vec<f64>| CurvePanel {
        title: String::new(),
        x: axis("time since the first pose [s]"),
        y: axis(label),
        curves: estimates
            .iter()
            .enumerate()
            .map(|(index, estimate)| Curve {
                label: estimate.row.label(),
                style: style(index),
                points: points(&estimate.stamps, first, &values(estimate)),
            })
            .collect(),
    };
    let figure = CurveFigure {
        panels: vec![
            panel("translation error [m]", |estimate| estimate.samples.translation.clone()),
            panel("heading error [°]", |estimate| {
                estimate.samples.heading.iter().map(|angle| angle.to_degrees()).collect()
            }),
        ],
        interval: Interval::Bars,
        caption: vec![format!(
            "Error against {reference} of poses matched by stamp. The first pose is at {first} s."
        )],
    };
    draw_curve_file(path, &figure)?;
    Ok(())
}

fn axis(label: &str) -> AxisSpec {
    AxisSpec { label: label.to_owned(), scale: Scale::Linear, range: None }
}

/// Colours first, then dashes.
fn style(index: usize) -> CurveStyle {
    let dash = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDot][(index / 7) % 4];
    CurveStyle { dash, ..CurveStyle::line(index) }
}

/// In order of time, which is not always that of the log.
fn points(stamps: &[Stamp], first: Stamp, values: &[f64]) -> Vec<CurvePoint> {
    let mut points: Vec<CurvePoint> = stamps
        .iter()
        .zip(values)
        .map(|(stamp, &mean)| CurvePoint {
            x: stamp.seconds_since(first),
            mean,
            low: f64::NAN,
            high: f64::NAN,
            mark: None,
        })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}
