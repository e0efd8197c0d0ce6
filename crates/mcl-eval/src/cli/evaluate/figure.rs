//! Error over time.

use std::path::Path;

use anyhow::Result;
use mcl_core::Stamp;

use super::Evaluated;
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Dash, draw_curve_file,
};

/// Draws translation and heading errors of all estimates over the time since the first pose.
pub fn draw(path: &Path, reference: &str, estimates: &[Evaluated]) -> Result<()> {
    let stamps = estimates.iter().flat_map(|estimate| &estimate.stamps);
    let first = stamps.min().copied().unwrap_or(Stamp::from_nanoseconds(0));
    let panel = |label: &str, values: fn(&Evaluated) -> Vec<f64>| CurvePanel {
        title: String::new(),
        x: AxisSpec::linear("time since the first pose [s]"),
        y: AxisSpec::linear(label),
        curves: estimates
            .iter()
            .enumerate()
            .map(|(index, estimate)| Curve {
                label: estimate.row.of.label(),
                style: style(index),
                points: points(&estimate.stamps, first, &values(estimate)),
            })
            .collect(),
    };
    let figure = CurveFigure {
        columns: 1,
        panels: vec![
            panel("translation error [m]", |estimate| estimate.samples.translation.clone()),
            panel("heading error [°]", |estimate| {
                estimate.samples.heading.iter().map(|angle| angle.to_degrees()).collect()
            }),
        ],
        caption: vec![format!(
            "Error against {reference} of poses matched by stamp. The first pose is at {first} s."
        )],
    };
    draw_curve_file(path, &figure)?;
    Ok(())
}

/// Colours first, then dashes.
fn style(index: usize) -> CurveStyle {
    let dash = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDot][(index / 7) % 4];
    CurveStyle { dash, ..CurveStyle::line(index) }
}

/// In order of time, which is not always that of the log.
fn points(stamps: &[Stamp], first: Stamp, values: &[f64]) -> Vec<CurvePoint> {
    let places = stamps.iter().map(|stamp| stamp.seconds_since(first));
    let mut points: Vec<CurvePoint> =
        places.zip(values).map(|(x, &mean)| CurvePoint::bare(x, mean)).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}
