use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{FIGURES, TRIALS};
use crate::experiment::{
    Manifest, MapStrategy, SensitivityCell, SensitivityExperiment, SensitivityRow, Setting, Sweep,
    SweptMap, find_cell, read_rows, summarize_sensitivity,
};
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Interval, Scale, draw_curves,
};

/// Draws a figure per sweep. Where there are more settings than maps: error over the number with the most
/// values, a curve per value of the setting that comes next, a panel per map and value of the others.
/// Where there are more maps: error over their size, a curve per strategy and a panel per setting, like
/// figure 5.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let definition: SensitivityExperiment = manifest.definition()?;
    let rows: Vec<SensitivityRow> = read_rows(&folder.join(TRIALS))?;
    let cells = summarize_sensitivity(&rows)?;
    let mut drawn = Vec::new();
    for sweep in definition.sweeps.iter().filter(|sweep| sweep.covers(&manifest.dataset.name)) {
        let more_maps = sweep.maps.len() > sweep.settings(&definition).len();
        let mut panels = match more_maps {
            true => panels_by_setting(&definition, sweep, &cells),
            false => panels_by_map(&definition, sweep, &cells),
        };
        share_range(&mut panels);
        let caption = vec![caption(&manifest, &definition, sweep)];
        let figure = CurveFigure { panels, interval: Interval::Bars, caption };
        drawn.extend(draw_curves(&folder.join(FIGURES).join(&sweep.name), &figure)?);
    }
    Ok(drawn)
}

/// A setting that a sweep can vary.
struct Axis {
    /// Name with unit.
    name: &'static str,
    /// Its value in a setting, as text.
    text: fn(&Setting) -> String,
    /// Its value as a position, where it is one number.
    number: Option<fn(&Setting) -> f64>,
}

const AXES: [Axis; 6] = [
    Axis { name: "σ_hit [m]", text: |s| s.sigma_hit.to_string(), number: Some(|s| s.sigma_hit) },
    Axis { name: "z_rand", text: |s| s.z_rand.to_string(), number: Some(|s| s.z_rand) },
    Axis { name: "α", text: |s| s.alpha().map(|a| a.to_string()).join(", "), number: None },
    Axis {
        name: "exponent on the likelihood",
        text: |s| s.likelihood_exponent.to_string(),
        number: Some(|s| s.likelihood_exponent),
    },
    Axis { name: "proposal", text: |s| s.proposal.to_string(), number: None },
    Axis {
        name: "noise added to the odometry [m, rad]",
        text: |s| format!("{}, {}", s.noise_xy, s.noise_theta),
        number: None,
    },
];

/// Distinct values of an axis among settings, in their order.
fn values(axis: &Axis, settings: &[Setting]) -> Vec<String> {
    let mut values = Vec::new();
    for value in settings.iter().map(axis.text) {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    values
}

fn panels_by_map(
    definition: &SensitivityExperiment,
    sweep: &Sweep,
    cells: &[(Setting, SensitivityCell)],
) -> Vec<CurvePanel> {
    let settings = sweep.settings(definition);
    let mut varied: Vec<&Axis> =
        AXES.iter().filter(|axis| values(axis, &settings).len() > 1).collect();
    // The most values first, and a number in front, as it makes an axis.
    varied.sort_by_key(|axis| usize::MAX - values(axis, &settings).len());
    if let Some(number) = varied.iter().position(|axis| axis.number.is_some()) {
        varied[..=number].rotate_right(1);
    }
    let x = varied.first().copied().unwrap_or(&AXES[0]);
    let curve = varied.get(1).copied();
    let others = varied.get(2..).unwrap_or_default();
    let x_values = values(x, &settings);

    let mut panels = Vec::new();
    for map in &sweep.maps {
        let mut groups: Vec<Vec<String>> = Vec::new();
        for setting in &settings {
            let group: Vec<String> = others.iter().map(|axis| (axis.text)(setting)).collect();
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
        for group in groups {
            let fixed: Vec<String> = others
                .iter()
                .zip(&group)
                .map(|(axis, value)| format!("{} = {value}", axis.name))
                .collect();
            let of_group = |setting: &Setting| {
                others.iter().zip(&group).all(|(axis, value)| (axis.text)(setting) == *value)
            };
            let curves = curve.map_or(vec![String::new()], |axis| values(axis, &settings));
            let curves = curves.into_iter().enumerate().map(|(index, value)| Curve {
                label: curve
                    .map_or_else(|| map_name(map), |axis| format!("{} = {value}", axis.name)),
                style: CurveStyle::nth(index),
                points: settings
                    .iter()
                    .filter(|s| of_group(s) && curve.is_none_or(|axis| (axis.text)(s) == value))
                    .filter_map(|setting| point(setting, map, x, &x_values, cells))
                    .collect(),
            });
            let curves = curves.collect();
            let title = [vec![map_name(map)], fixed].concat().join(", ");
            let log = x.number.is_some_and(|number| settings.iter().all(|s| number(s) > 0.0));
            let label = match x.number {
                Some(_) => x.name.to_owned(),
                None => format!("{}: {}", x.name, numbered(&x_values)),
            };
            let scale = if log { Scale::Log } else { Scale::Linear };
            panels.push(panel(title, label, scale, curves));
        }
    }
    panels
}

fn panels_by_setting(
    definition: &SensitivityExperiment,
    sweep: &Sweep,
    cells: &[(Setting, SensitivityCell)],
) -> Vec<CurvePanel> {
    let settings = sweep.settings(definition);
    let varied: Vec<&Axis> = AXES.iter().filter(|axis| values(axis, &settings).len() > 1).collect();
    let mut strategies: Vec<MapStrategy> = Vec::new();
    for map in &sweep.maps {
        if !strategies.contains(&map.strategy) {
            strategies.push(map.strategy);
        }
    }
    let of_setting = |setting: &Setting| {
        let title = varied.iter().map(|axis| format!("{} = {}", axis.name, (axis.text)(setting)));
        let curves = strategies.iter().enumerate().map(|(index, &strategy)| Curve {
            label: strategy.label().to_owned(),
            style: CurveStyle::nth(index),
            points: sweep
                .maps
                .iter()
                .filter(|map| map.strategy == strategy)
                .filter_map(|map| Some(mark(map.percent, find_cell(cells, setting, map)?)))
                .collect(),
        });
        let label = "requested map size [% of the points]".to_owned();
        panel(title.collect::<Vec<_>>().join(", "), label, Scale::Log, curves.collect())
    };
    settings.iter().map(of_setting).collect()
}

/// Gives all panels the vertical range of all points, so that they can be compared.
fn share_range(panels: &mut [CurvePanel]) {
    let points = panels.iter().flat_map(|panel| &panel.curves).flat_map(|curve| &curve.points);
    // `min` and `max` pass over the NaN of a point without an interval.
    let (low, high) = points.fold((f64::INFINITY, 0.0f64), |(low, high), point| {
        (low.min(point.mean).min(point.low), high.max(point.mean).max(point.high))
    });
    if low > 0.0 && low < high {
        const ROOM: f64 = 1.1;
        panels.iter_mut().for_each(|panel| panel.y.range = Some([low / ROOM, high * ROOM]));
    }
}

fn panel(title: String, x: String, scale: Scale, curves: Vec<Curve>) -> CurvePanel {
    CurvePanel {
        title,
        x: AxisSpec { label: x, scale, range: None },
        y: AxisSpec {
            label: "mean weighted error d [–]".to_owned(),
            // Lost runs err by metres, tracked ones by centimetres.
            scale: Scale::Log,
            range: None,
        },
        curves,
    }
}

fn caption(manifest: &Manifest, definition: &SensitivityExperiment, sweep: &Sweep) -> String {
    let settings = sweep.settings(definition);
    let fixed: Vec<String> = AXES
        .iter()
        .filter_map(|axis| match values(axis, &settings).as_slice() {
            [only] => Some(format!("{} = {only}", axis.name)),
            _ => None,
        })
        .collect();
    format!(
        "{}. Error of equation 7 with ξ = 0.8, mean over {} runs with {} particles on as many maps, \
         and 95 % bootstrap intervals over runs; open symbols: diverged runs of all. {}.",
        manifest.dataset.describe(),
        sweep.runs.unwrap_or(definition.runs),
        definition.filter.particles,
        fixed.join("; "),
    )
}

/// "1 = (0, 0), 2 = (0.01, 0.01)": values that are no numbers stand at their places in the list.
fn numbered(values: &[String]) -> String {
    let numbered =
        values.iter().enumerate().map(|(index, value)| format!("{} = ({value})", index + 1));
    numbered.collect::<Vec<_>>().join(", ")
}

fn map_name(map: &SweptMap) -> String {
    format!("{} of {} %", map.strategy.label(), map.percent)
}

fn point(
    setting: &Setting,
    map: &SweptMap,
    x: &Axis,
    x_values: &[String],
    cells: &[(Setting, SensitivityCell)],
) -> Option<CurvePoint> {
    let place = || x_values.iter().position(|value| *value == (x.text)(setting));
    let position = match x.number {
        Some(number) => number(setting),
        None => place()? as f64 + 1.0,
    };
    Some(mark(position, find_cell(cells, setting, map)?))
}

fn mark(x: f64, cell: &SensitivityCell) -> CurvePoint {
    CurvePoint {
        x,
        mean: cell.weighted,
        low: cell.weighted_low.unwrap_or(f64::NAN),
        high: cell.weighted_high.unwrap_or(f64::NAN),
        mark: (cell.diverged > 0).then(|| format!("{}/{}", cell.diverged, cell.runs)),
    }
}
