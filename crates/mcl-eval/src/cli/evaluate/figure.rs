//! Figures of errors over time, and of their spread over the runs of groups.

use std::path::Path;

use anyhow::Result;
use mcl_core::Stamp;
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Dash, Marker, Scale,
    draw_curve_file,
};
use mcl_metrics::Summary;

use super::row::Sampled;
use crate::pose_errors::ErrorSamples;

/// Columns to which a long run is thinned, and moments at which runs of a group are compared.
const COLUMNS: usize = 1500;
const MOMENTS: usize = 80;
/// If the largest error is more than this many times the median, errors are shown on a logarithmic axis.
const FAR_APART: f64 = 30.0;
/// Half the width of a box, in places.
const HALF: f64 = 0.28;

/// An estimate to draw: its name, and its errors.
pub type NamedErrors<'a> = (String, &'a Sampled);

/// A group of runs: its name, those with figures, and the total number.
pub struct DrawnGroup<'a> {
    pub name: &'a str,
    pub runs: Vec<&'a Sampled>,
    pub asked: usize,
}

type Samples = fn(&ErrorSamples) -> &[f64];
/// The measures that are drawn: label, unit (heading in degrees), samples.
const MEASURES: [(&str, f64, Samples); 2] = [
    ("translation error [m]", 1.0, |samples| &samples.translation),
    ("heading error [°]", 180.0 / std::f64::consts::PI, |samples| &samples.heading),
];

/// Draws translation and heading errors of all estimates over the time since the reference's first pose; of groups
/// also a box each. At least one estimate, or a run of a group.
pub fn draw(
    path: &Path,
    reference: &str,
    estimates: &[NamedErrors<'_>],
    groups: &[DrawnGroup<'_>],
) -> Result<()> {
    let all = || {
        let of_groups = groups.iter().flat_map(|group| group.runs.iter().copied());
        estimates.iter().map(|(_, found)| *found).chain(of_groups)
    };
    let has_headings = all().all(|found| found.has_headings);
    let measures = &MEASURES[..if has_headings { 2 } else { 1 }];
    let mut panels = Vec::new();
    if !groups.is_empty() {
        panels.push(boxes(groups));
    }
    for &(label, unit, samples) in measures {
        let of_estimates = estimates.iter().enumerate().map(|(index, (name, found))| Curve {
            label: name.clone(),
            style: style(index),
            points: thinned(over_time(found, unit, samples)),
        });
        let of_groups = groups
            .iter()
            .enumerate()
            .flat_map(|(index, group)| band(group, style(estimates.len() + index), unit, samples));
        let curves: Vec<Curve> = of_estimates.chain(of_groups).collect();
        panels.push(CurvePanel {
            title: String::new(),
            x: AxisSpec::linear("time since the first pose of the reference [s]"),
            y: axis(label, &curves),
            curves,
        });
    }
    let mut caption = vec![format!("Error against {reference}.")];
    if !groups.is_empty() {
        caption.push(
            "Boxes: quartiles, median and extremes of the runs' mean errors, a symbol per run. Over time: solid the \
             median over runs, dotted the smallest and the largest."
                .to_owned(),
        );
        let missing = groups.iter().filter(|group| group.runs.len() < group.asked);
        let missing: Vec<String> = missing
            .map(|group| {
                format!("{} of {} of {}", group.asked - group.runs.len(), group.asked, group.name)
            })
            .collect();
        if !missing.is_empty() {
            caption.push(format!(
                "Runs without figures, which are not drawn: {}.",
                missing.join(", ")
            ));
        }
    }
    draw_curve_file(path, &CurveFigure { columns: 1, panels, caption })?;
    Ok(())
}

/// Logarithmic, where small errors would not be visible beside large ones.
fn axis(label: &str, curves: &[Curve]) -> AxisSpec {
    let errors = curves.iter().flat_map(|curve| &curve.points).map(|point| point.mean);
    let errors: Vec<f64> = errors.collect();
    let is_wide = Summary::of(&errors)
        .is_ok_and(|summary| summary.min > 0.0 && summary.max > FAR_APART * summary.median);
    let scale = if is_wide { Scale::Log } else { Scale::Linear };
    AxisSpec { scale, ..AxisSpec::linear(label) }
}

/// Colours first, then dashes.
fn style(index: usize) -> CurveStyle {
    let dash = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDot][(index / 7) % 4];
    CurveStyle { dash, ..CurveStyle::line(index) }
}

/// In order of time, which may differ from that of the log.
fn over_time(found: &Sampled, unit: f64, samples: Samples) -> Vec<CurvePoint> {
    let mut points: Vec<CurvePoint> = places(found)
        .zip(samples(&found.samples))
        .map(|(x, &error)| CurvePoint::bare(x, error * unit))
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    points
}

fn places(found: &Sampled) -> impl Iterator<Item = f64> + '_ {
    found.stamps.iter().map(|stamp: &Stamp| stamp.seconds_since(found.begins))
}

/// Thins points in order of x to as many as a figure can show: the lowest and the highest of each narrow
/// column.
fn thinned(points: Vec<CurvePoint>) -> Vec<CurvePoint> {
    if points.len() <= 2 * COLUMNS {
        return points;
    }
    let (first, last) = (points[0].x, points[points.len() - 1].x);
    let column = |point: &CurvePoint| {
        let share = (point.x - first) / (last - first);
        ((share * COLUMNS as f64) as usize).min(COLUMNS - 1)
    };
    let mut kept = Vec::with_capacity(2 * COLUMNS);
    for column in points.chunk_by(|a, b| column(a) == column(b)) {
        let by_error = |a: &&CurvePoint, b: &&CurvePoint| a.mean.total_cmp(&b.mean);
        let ends = [column.iter().min_by(by_error), column.iter().max_by(by_error)];
        let mut ends: Vec<&CurvePoint> = ends.into_iter().flatten().collect();
        ends.sort_by(|a, b| a.x.total_cmp(&b.x));
        ends.dedup_by(|a, b| std::ptr::eq(*a, *b));
        kept.extend(ends.into_iter().cloned());
    }
    kept
}

/// Median, smallest and largest over the runs of a group, each of the mean error of a run around a moment.
fn band(
    group: &DrawnGroup<'_>,
    style: CurveStyle,
    unit: f64,
    samples: Samples,
) -> impl Iterator<Item = Curve> {
    let ends = group.runs.iter().flat_map(|run| places(run)).fold(0.0, f64::max);
    let mut moments: Vec<Vec<f64>> = vec![Vec::new(); MOMENTS];
    for run in &group.runs {
        let mut sums = vec![(0.0, 0.0); MOMENTS];
        for (at, error) in places(run).zip(samples(&run.samples)) {
            let moment = (at / ends * MOMENTS as f64) as usize;
            let (sum, count) = &mut sums[moment.min(MOMENTS - 1)];
            *sum += error * unit;
            *count += 1.0;
        }
        for (moment, (sum, count)) in moments.iter_mut().zip(sums) {
            if count > 0.0 {
                moment.push(sum / count);
            }
        }
    }
    let summaries: Vec<(f64, Summary)> = moments
        .iter()
        .enumerate()
        .filter_map(|(moment, errors)| {
            let at = (moment as f64 + 0.5) / MOMENTS as f64 * ends;
            Summary::of(errors).ok().map(|summary| (at, summary))
        })
        .collect();
    let curve = |label: String, style: CurveStyle, of: fn(&Summary) -> f64| Curve {
        label,
        style,
        points: summaries.iter().map(|(at, summary)| CurvePoint::bare(*at, of(summary))).collect(),
    };
    let faint = CurveStyle { dash: Dash::Dotted, ..style };
    let extremes = format!("{}, extremes", group.name);
    [
        curve(group.name.to_owned(), style, |summary| summary.median),
        curve(extremes.clone(), faint, |summary| summary.min),
        curve(extremes, faint, |summary| summary.max),
    ]
    .into_iter()
}

/// A box per group, of the mean translation errors of its runs.
fn boxes(groups: &[DrawnGroup<'_>]) -> CurvePanel {
    let mut curves = Vec::new();
    for (place, group) in groups.iter().enumerate() {
        let mut means: Vec<f64> = Vec::new();
        for run in &group.runs {
            means.extend(Summary::of(&run.samples.translation).ok().map(|summary| summary.mean));
        }
        let Ok(Summary { min, p25, median, p75, max, .. }) = Summary::of(&means) else { continue };
        let at = place as f64;
        let mut line = |points: &[(f64, f64)], marker: Option<Marker>| {
            curves.push(Curve {
                label: String::new(),
                style: CurveStyle { marker, ..style(place) },
                points: points.iter().map(|&(x, y)| CurvePoint::bare(x, y)).collect(),
            });
        };
        let (left, right) = (at - HALF, at + HALF);
        line(&[(left, p25), (right, p25), (right, p75), (left, p75), (left, p25)], None);
        line(&[(left, median), (right, median)], None);
        line(&[(at, min), (at, p25)], None);
        line(&[(at, p75), (at, max)], None);
        let count = means.len() as f64;
        for (number, mean) in means.iter().enumerate() {
            // Side by side, so that equal ones are visible.
            let beside = HALF * 1.4 * ((number as f64 + 0.5) / count - 0.5);
            line(&[(at + beside, *mean)], Some(Marker::Circle));
        }
    }
    CurvePanel {
        title: String::new(),
        x: AxisSpec::named(groups.iter().map(|group| group.name.to_owned()).collect()),
        y: axis("mean of a run [m]", &curves),
        curves,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_keeps_its_peaks() {
        let error = |k: usize| if k == 70_001 { 5.0 } else { 0.1 + (k % 7) as f64 * 0.01 };
        let points: Vec<CurvePoint> =
            (0..400_000).map(|k| CurvePoint::bare(k as f64 * 0.01, error(k))).collect();
        let kept = thinned(points);
        assert!(kept.len() <= 2 * COLUMNS, "{}", kept.len());
        assert!(kept.is_sorted_by(|a, b| a.x <= b.x));
        let highest = kept.iter().max_by(|a, b| a.mean.total_cmp(&b.mean)).unwrap();
        assert_eq!((highest.x, highest.mean), (700.01, 5.0));
        assert!(kept.iter().any(|point| point.mean == 0.1));
    }
}
