//! Evaluations as text: a table of all estimates, then each with its figures.

use std::fmt::Write;

use super::{AxisFigures, Row};
use crate::cli::errors::table_line;
use mcl_core::text::thousands;

pub fn text(rows: &[&Row]) -> String {
    let mut parts = Vec::new();
    if rows.len() > 1 {
        parts.push(comparison(rows));
    }
    parts.extend(rows.iter().map(|row| row_text(row)));
    parts.join("\n")
}

/// A line per estimate; rmse but for the weighted error, whose mean is the paper's.
fn comparison(rows: &[&Row]) -> String {
    let mut lines = vec![vec![
        "estimate".to_owned(),
        "pairs".to_owned(),
        "unmatched".to_owned(),
        "weighted".to_owned(),
        "ATE, m".to_owned(),
        "heading, °".to_owned(),
    ]];
    lines[0].extend(rows[0].rpe.iter().map(|rpe| format!("RPE {} m", rpe.distance_m)));
    for row in rows {
        let mut line = vec![
            row.of.label(),
            thousands(row.pairs),
            thousands(row.unmatched),
            format!("{:.4}", row.errors.weighted.mean),
            format!("{:.4}", row.ate.rmse),
            format!("{:.4}", row.errors.heading.rmse.to_degrees()),
        ];
        line.extend(row.rpe.iter().map(|rpe| match &rpe.translation {
            Some(figures) => format!("{:.4}", figures.rmse),
            None => "–".to_owned(),
        }));
        lines.push(line);
    }
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max();
    let widths: Vec<usize> = (0..lines[0].len()).map(|column| width(column).unwrap_or(0)).collect();
    let mut text = String::new();
    for line in &lines {
        for (column, (cell, width)) in line.iter().zip(&widths).enumerate() {
            match column {
                0 => write!(text, "{cell:<width$}"),
                _ => write!(text, "  {cell:>width$}"),
            }
            .expect("writing to a string does not fail");
        }
        text.push('\n');
    }
    text + "(mean weighted error; rmse of the others, RPE in m)\n"
}

fn row_text(row: &Row) -> String {
    let mut text = format!(
        "{}: {} pairs, {} poses unmatched\n",
        row.of.label(),
        thousands(row.pairs),
        thousands(row.unmatched)
    );
    if let Some(motion) = row.reference_from_estimate {
        text += &format!(
            "  aligned: moved by ({:.4}, {:.4}) m, turned by {:.3}°\n",
            motion.x,
            motion.y,
            motion.theta.to_degrees()
        );
    }
    text += &row.errors.table();
    for relative in &row.rpe {
        let distance = relative.distance_m;
        match (&relative.translation, &relative.heading) {
            (Some(translation), Some(heading)) => {
                text += &table_line(&format!("over {distance} m, m"), translation);
                text += &table_line(&format!("over {distance} m, rad"), heading);
            }
            _ => text += &format!("  over {distance} m: the path is shorter\n"),
        }
    }
    text += &format!("  {:<18}{:>10}{:>10}{:>10}{:>10}\n", "signed", "bias", "std", "rmse", "max");
    for (name, axis) in [
        ("x, m", &row.axes.x),
        ("y, m", &row.axes.y),
        ("yaw, rad", &row.axes.yaw),
        ("longitudinal, m", &row.axes.longitudinal),
        ("lateral, m", &row.axes.lateral),
    ] {
        let AxisFigures { mean, std, rmse, max } = axis;
        text += &format!("  {name:<18}{mean:>10.4}{std:>10.4}{rmse:>10.4}{max:>10.4}\n");
    }
    text
}
