use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{FIGURES, SUMMARY};
use crate::experiment::{
    Manifest, Representation, RepresentationSummaryRow, RepresentationsExperiment, Split, read_rows,
};
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Dash, Interval, Marker,
    Scale, draw_curves,
};

/// Draws the error against kilobytes, a panel per split.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let definition: RepresentationsExperiment = manifest.definition()?;
    let summary: Vec<RepresentationSummaryRow> = read_rows(&folder.join(SUMMARY))?;
    let axis = |label: &str, range| AxisSpec { label: label.to_owned(), scale: Scale::Log, range };
    let kilobytes = kilobyte_range(&summary);
    let panels = definition.splits.iter().map(|&split| CurvePanel {
        title: match split {
            Split::Same => "maps and runs of the same scans".to_owned(),
            Split::HeldOut => "held out: maps of even scans, runs on odd ones".to_owned(),
        },
        x: axis("size of the map [kB]", kilobytes),
        y: axis("mean weighted error d [–]", None),
        curves: curves(&summary, split),
    });
    let filter = &definition.filter;
    let figure = CurveFigure {
        panels: panels.collect(),
        interval: Interval::Bars,
        caption: vec![format!(
            "{}. Error of equation 7 with ξ = 0.8, mean over {} runs with {} particles and 95 % \
             bootstrap intervals over runs; open symbols: diverged runs of all. Bytes: 8 a point, 1 a \
             cell of an occupancy grid or its run lengths, 24 a Gaussian{}. σ_hit = {} m, z_rand = {}, \
             noise added to the odometry {} m and {} rad.",
            manifest.dataset.describe(),
            definition.runs_for(&manifest.dataset.name),
            filter.particles,
            if definition.segments.is_empty() { "" } else { ", 16 a line segment" },
            filter.sigma_hit,
            filter.z_rand,
            definition.odometry_noise.xy,
            definition.odometry_noise.theta,
        )],
    };
    Ok(draw_curves(&folder.join(FIGURES).join("representations"), &figure)?.to_vec())
}

/// The sizes of all panels with room on both sides for the numbers of diverged runs.
fn kilobyte_range(summary: &[RepresentationSummaryRow]) -> Option<[f64; 2]> {
    let sizes = || {
        summary
            .iter()
            .flat_map(|row| row.kilobytes_run_length.into_iter().chain([row.kilobytes_raw]))
    };
    let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    (low > 0.0 && low <= high).then_some([low / 1.4, high * 1.4])
}

/// A curve per kind of map; of occupancy grids, one per way to keep them.
fn curves(summary: &[RepresentationSummaryRow], split: Split) -> Vec<Curve> {
    let curve = |label: &str, style: CurveStyle, of: Representation, run_length: bool| {
        let rows = summary.iter().filter(|row| row.split == split && row.representation == of);
        let mut points: Vec<CurvePoint> = rows
            .filter_map(|row| {
                let kilobytes = match run_length {
                    true => row.kilobytes_run_length?,
                    false => row.kilobytes_raw,
                };
                Some(CurvePoint {
                    x: kilobytes,
                    mean: row.weighted,
                    low: row.weighted_low.unwrap_or(f64::NAN),
                    high: row.weighted_high.unwrap_or(f64::NAN),
                    mark: (row.diverged > 0).then(|| format!("{}/{}", row.diverged, row.runs)),
                })
            })
            .collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        Curve { label: label.to_owned(), style, points }
    };
    let mut curves = Vec::new();
    for representation in Representation::ALL {
        let (label, style) = (representation.label(), style(representation));
        if representation == Representation::Occupancy {
            let other = CurveStyle { dash: Dash::Dotted, marker: Some(Marker::Pentagon), ..style };
            curves.push(curve("occupancy grid", style, representation, false));
            curves.push(curve("its run lengths", other, representation, true));
        } else {
            curves.push(curve(label, style, representation, false));
        }
    }
    curves.retain(|curve| !curve.points.is_empty());
    curves
}

/// One colour per family: random, grid-based, and other kinds of maps.
fn style(representation: Representation) -> CurveStyle {
    let (color, dash, marker) = match representation {
        Representation::Random => (0, Dash::Dashed, Marker::Circle),
        Representation::RandomImproved => (0, Dash::Solid, Marker::Circle),
        Representation::Grid => (1, Dash::Dashed, Marker::Square),
        Representation::GridImproved => (1, Dash::Solid, Marker::Square),
        Representation::GridBest => (4, Dash::Solid, Marker::TriangleDown),
        Representation::All => (0, Dash::Solid, Marker::Diamond),
        Representation::Occupancy => (2, Dash::Solid, Marker::Pentagon),
        Representation::Ndt => (3, Dash::Dashed, Marker::TriangleUp),
        Representation::NdtWide => (3, Dash::Solid, Marker::TriangleUp),
        Representation::Segments => (6, Dash::Solid, Marker::Diamond),
    };
    CurveStyle { color, dash, marker: Some(marker) }
}
