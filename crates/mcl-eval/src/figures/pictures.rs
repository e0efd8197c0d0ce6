//! Maps, and paths of the robot on them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::text::thousands;
use mcl_core::{Point, PointMap, Trajectory};
use mcl_figures::{
    Arrangement, AxisSpec, CloudFigure, CloudLabels, CloudPanel, CloudPath, Curve, CurveFigure,
    CurvePanel, CurvePoint, CurveStyle, Dash, draw_clouds, draw_curves,
};
use mcl_maps::files::read_map;
use mcl_metrics::tum::{NonPlanar, TumError, read_file};
use mcl_metrics::{PoseError, WeightedPoseError, pose_errors};
use mcl_study::recipe::split::Split;
use mcl_study::store::results::{Pictured, Results};
use mcl_study::study::views::Picture;

use super::space::View;

/// Name of the chart of a picture's errors over time.
fn error_name(picture: &Picture) -> String {
    format!("{}-error", picture.name)
}

/// Draws a picture, and the errors of its run over time. `view` is that of data in space.
///
/// # Errors
/// When a map or path cannot be read, or a file cannot be made.
pub fn draw(
    results: &Results,
    folder: &Path,
    picture: &Picture,
    maps: &[&Pictured],
    view: Option<&View>,
) -> Result<Vec<PathBuf>> {
    let stem = folder.join(&picture.name);
    let Some(view) = view else {
        let mut drawn = planar(results, &stem, picture, maps)?.to_vec();
        if picture.run.is_some() {
            drawn.extend(errors(results, &folder.join(error_name(picture)), maps)?);
        }
        return Ok(drawn);
    };
    let seen = maps.iter().map(|shown| Ok(view.seen(&read_map(&shown.map)?)));
    let seen = seen.collect::<Result<Vec<_>>>()?;
    let panels = maps.iter().zip(&seen).map(|(shown, seen)| CloudPanel {
        title: title(shown, true),
        points: &seen.points,
        shades: &seen.shades,
        paths: Vec::new(),
    });
    let figure = CloudFigure {
        panels: panels.collect(),
        arrangement: Arrangement::Stacked,
        labels: CloudLabels { x: "across the view [m]", y: "up the view [m]" },
        caption: caption(results, picture, maps, Some(view)),
    };
    Ok(draw_clouds(&stem, &figure)?.to_vec())
}

fn planar(
    results: &Results,
    stem: &Path,
    picture: &Picture,
    maps: &[&Pictured],
) -> Result<[PathBuf; 2]> {
    let points = maps.iter().map(|shown| Ok(read_map::<2>(&shown.map)?));
    let points: Vec<PointMap<2>> = points.collect::<Result<_>>()?;
    let positions = |file: &PathBuf| {
        let trajectory = read(file)?;
        Ok(trajectory.poses().iter().map(|pose| [pose.x, pose.y]).collect())
    };
    let paths = maps.iter().map(|shown| shown.paths.iter().flatten().map(positions).collect());
    let paths: Vec<Vec<Vec<Point<2>>>> = paths.collect::<Result<_>>()?;
    let panels = maps.iter().zip(&points).zip(&paths).map(|((shown, points), paths)| {
        // On its own, all data is shown for its extent.
        let title = match (maps, name(shown)) {
            ([_], "all") if paths.is_empty() => extent(results, points),
            _ => title(shown, paths.is_empty()),
        };
        let drawn = [("reference", 2, Dash::Solid), ("estimate", 1, Dash::Dashed)];
        let paths = paths.iter().zip(drawn).map(|(points, (label, color, dash))| CloudPath {
            label: label.to_owned(),
            style: CurveStyle { dash, ..CurveStyle::line(color) },
            points,
        });
        CloudPanel { title, points: points.points(), shades: &[], paths: paths.collect() }
    });
    let is_wide = points.iter().any(|map| {
        let bounds = map.bounds();
        bounds.extent(0) > 1.5 * bounds.extent(1)
    });
    let panels: Vec<CloudPanel<'_>> = panels.collect();
    let arrangement = match panels.len() {
        2 if !is_wide => Arrangement::SideBySide,
        _ => Arrangement::Stacked,
    };
    let caption = caption(results, picture, maps, None);
    let figure = CloudFigure { panels, arrangement, labels: CloudLabels::PLANE, caption };
    Ok(draw_clouds(stem, &figure)?)
}

/// Errors of the run, scan by scan.
fn errors(results: &Results, stem: &Path, maps: &[&Pictured]) -> Result<[PathBuf; 2]> {
    let mut curves: Vec<(String, Vec<PoseError>)> = Vec::new();
    for shown in maps {
        let [reference, estimate] =
            shown.paths.as_ref().context("a run has paths")?.each_ref().map(|file| read(file));
        let (reference, estimate) = (reference?, estimate?);
        let errors = match estimate.is_empty() {
            true => Vec::new(),
            false => pose_errors(reference.poses(), estimate.poses())?,
        };
        curves.push((described(shown), errors));
    }
    let weighted = WeightedPoseError::default();
    let panel = |title: &str, unit: &str, value: &dyn Fn(&PoseError) -> f64| CurvePanel {
        title: title.to_owned(),
        x: AxisSpec::linear("scan"),
        y: AxisSpec::linear(unit),
        curves: curves
            .iter()
            .enumerate()
            .map(|(place, (label, errors))| {
                let of_scans = (0..).zip(errors);
                let points =
                    of_scans.map(|(scan, e)| CurvePoint::bare(f64::from(scan), value(e))).collect();
                Curve { label: label.clone(), style: CurveStyle::line(1 + place), points }
            })
            .collect(),
    };
    let figure = CurveFigure {
        columns: 1,
        panels: vec![
            panel("translation", "error [m]", &PoseError::translation),
            panel("heading", "error [°]", &|error| error.heading().to_degrees()),
            panel("weighted, ξ = 0.8", "error d [–]", &|error| weighted.of(error)),
        ],
        caption: vec![format!("{}. {}.", results.facts.describe(), run_of(maps))],
    };
    Ok(draw_curves(stem, &figure)?)
}

fn caption(
    results: &Results,
    picture: &Picture,
    maps: &[&Pictured],
    view: Option<&View>,
) -> Vec<String> {
    let mut sentences = vec![results.facts.describe()];
    let of_maps = |column: &str, is_told: &dyn Fn(&Pictured) -> bool| {
        let told = maps.iter().filter(|shown| is_told(shown));
        let mut values: Vec<f64> = told.filter_map(|shown| shown.cell(column).number()).collect();
        values.dedup();
        values
    };
    let cells = of_maps("cell_m", &|_| true);
    if !cells.is_empty() {
        let cells: Vec<String> = cells.iter().map(|cell| format!("{cell:.3} m")).collect();
        sentences.push(format!("Grid-based sampling with cells of {}", cells.join(", ")));
    }
    if let [sigma] = of_maps("sigma_m", &|shown| name(shown).contains('+'))[..] {
        sentences.push(format!("Fuzzy k-means with σ = {sigma} m"));
    }
    if picture.run.is_some() {
        sentences.push(run_of(maps));
    }
    sentences.extend(view.map(View::describe));
    let told: String = sentences.iter().map(|sentence| format!("{sentence}. ")).collect();
    let own = (!picture.caption.is_empty()).then(|| picture.caption.clone());
    own.into_iter().chain([told.trim_end().to_owned()]).collect()
}

/// "Run 0 with 500 particles. Map and runs use the same scans, as in the paper".
fn run_of(maps: &[&Pictured]) -> String {
    let Some(first) = maps.first() else { return String::new() };
    let text = format!("Run {} with {} particles", first.cell("run"), first.cell("particles"));
    let split = first.cell("split").text();
    match Split::ALL.into_iter().find(|known| Some(known.name()) == split) {
        Some(split) => format!("{text}. {}", split.describe()),
        None => text,
    }
}

/// "grid-based map (gbs): 1,245 points (0.80 %), −11.20 nats per point".
fn title(shown: &Pictured, with_likelihood: bool) -> String {
    let points = shown.cell("map_points").number().unwrap_or(0.0) as usize;
    let mut title = format!("{}: {} points", described(shown), thousands(points));
    if name(shown) == "all" {
        return title;
    }
    if let Some(percent) = shown.cell("real_percent").number() {
        title += &format!(" ({percent:.2} %)");
    }
    if let (Some(likelihood), true) = (shown.cell("log_likelihood").number(), with_likelihood) {
        title += &format!(", {likelihood:.2} nats per point").replace('-', "−");
    }
    title
}

/// "Intel Research Lab: 155,648 points, 29.3 m × 29.2 m".
fn extent(results: &Results, map: &PointMap<2>) -> String {
    let bounds = map.bounds();
    format!(
        "{}: {} points, {:.1} m × {:.1} m",
        results.facts.title,
        thousands(map.len()),
        bounds.extent(0),
        bounds.extent(1)
    )
}

fn described(shown: &Pictured) -> String {
    let name = name(shown);
    match name {
        "all" => "all data".to_owned(),
        "gbs" => "grid-based map (gbs)".to_owned(),
        "rnd" => "random map (rnd)".to_owned(),
        _ if name.contains('+') => format!("improved map ({name})"),
        _ => name.to_owned(),
    }
}

fn name(shown: &Pictured) -> &str {
    shown.cell("map").text().unwrap_or_default()
}

fn read(path: &Path) -> Result<Trajectory> {
    match read_file(path, NonPlanar::Refuse) {
        // Of a program that has estimated nothing.
        Err(TumError::Empty { .. }) => Ok(Trajectory::default()),
        found => Ok(found?.trajectory),
    }
}
