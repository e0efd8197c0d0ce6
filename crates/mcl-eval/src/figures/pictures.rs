//! Maps, and paths of the robot on them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::text::{number, thousands};
use mcl_core::{Point, PointMap, Trajectory};
use mcl_figures::{
    AxisSpec, CloudFigure, CloudLabels, CloudPanel, CloudPath, Curve, CurveFigure, CurvePanel,
    CurvePoint, CurveStyle, Dash, Medium, draw_clouds, draw_curves,
};
use mcl_maps::files::read_map;
use mcl_metrics::tum::{NonPlanar, TumError, read_file};
use mcl_metrics::{PoseError, WeightedPoseError, pose_errors};
use mcl_study::recipe::split::Split;
use mcl_study::store::results::{Paths, Pictured, Results, save_table};
use mcl_study::study::views::Picture;
use mcl_study::table::{Table, Value};
use mcl_study::view::caption::vocabulary;

use super::space::View;

/// Name of the chart of a picture's errors over time.
fn error_name(picture: &Picture) -> String {
    format!("{}-error", picture.name)
}

/// A picture's file without its ending, and the medium it is drawn for.
struct File<'f> {
    stem: &'f Path,
    medium: Medium,
}

/// Draws a picture, and the errors of its run over time, into a folder. `view` is used for data in space. For
/// a paper, the content is also written as CSV, with the coordinates of all points.
///
/// # Errors
/// When a map or path cannot be read, or a file cannot be written.
pub fn draw(
    results: &Results,
    (folder, medium): (&Path, Medium),
    picture: &Picture,
    maps: &[&Pictured],
    view: Option<&View>,
) -> Result<Vec<PathBuf>> {
    let file = File { stem: &folder.join(&picture.name), medium };
    let Some(view) = view else {
        let mut drawn = planar(results, &file, picture, maps)?;
        if picture.run.is_some() {
            let file = File { stem: &folder.join(error_name(picture)), ..file };
            drawn.extend(errors(results, &file, maps)?);
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
        start: None,
    });
    let figure = CloudFigure {
        panels: panels.collect(),
        labels: CloudLabels { x: "across the view [m]", y: "up the view [m]" },
        caption: caption(results, picture, maps, Some(view)),
    };
    clouds(&file, &figure)
}

/// Draws maps, and for a paper writes their content.
fn clouds(file: &File<'_>, figure: &CloudFigure<'_>) -> Result<Vec<PathBuf>> {
    let mut drawn = draw_clouds(file.stem, figure, file.medium)?;
    if file.medium == Medium::Paper {
        let mut table = Table::new(["panel", "what", "x", "y"]);
        for panel in &figure.panels {
            let points = panel.points.iter().map(|point| ("point", point));
            let paths = panel.paths.iter();
            let paths =
                paths.flat_map(|path| path.points.iter().map(|at| (path.label.as_str(), at)));
            for (what, [x, y]) in points.chain(paths) {
                table.push(vec![
                    panel.title.as_str().into(),
                    what.into(),
                    (*x).into(),
                    (*y).into(),
                ]);
            }
        }
        drawn.push(save_rows(file, &table)?);
    }
    Ok(drawn)
}

/// Writes the rows of a figure beside it.
fn save_rows(file: &File<'_>, table: &Table) -> Result<PathBuf> {
    let mut path = file.stem.as_os_str().to_owned();
    path.push(".csv");
    let path = PathBuf::from(path);
    save_table(&path, table)?;
    Ok(path)
}

fn planar(
    results: &Results,
    file: &File<'_>,
    picture: &Picture,
    maps: &[&Pictured],
) -> Result<Vec<PathBuf>> {
    let points = maps.iter().map(|shown| Ok(read_map::<2>(&shown.map)?));
    let points: Vec<PointMap<2>> = points.collect::<Result<_>>()?;
    let paths = maps.iter().map(|shown| shown.paths.as_ref().map(positions).transpose());
    let paths: Vec<Option<Positions>> = paths.collect::<Result<_>>()?;
    let panels = maps.iter().zip(&points).zip(&paths).map(|((shown, points), paths)| {
        // On its own, it is shown with the extent of all data.
        let title = match (maps, name(shown)) {
            ([_], "all") if paths.is_none() => extent(results, points),
            _ => title(shown, paths.is_none()),
        };
        let drawn = [
            ("odometry", 3, Dash::Dotted),
            ("reference", 2, Dash::Solid),
            ("estimate", 1, Dash::Dashed),
        ];
        let shown = paths.iter().flatten().zip(drawn).filter(|(points, _)| !points.is_empty());
        let shown = shown.map(|(points, (label, color, dash))| CloudPath {
            label: label.to_owned(),
            style: CurveStyle { dash, ..CurveStyle::line(color) },
            points,
            is_cut: label == "odometry",
        });
        let start = paths.as_ref().and_then(|[_, reference, _]| reference.first().copied());
        CloudPanel { title, points: points.points(), shades: &[], paths: shown.collect(), start }
    });
    let panels: Vec<CloudPanel<'_>> = panels.collect();
    let caption = caption(results, picture, maps, None);
    clouds(file, &CloudFigure { panels, labels: CloudLabels::PLANE, caption })
}

/// Positions along the odometry (empty where it is missing), the reference and the estimate.
type Positions = [Vec<Point<2>>; 3];

fn positions(paths: &Paths) -> Result<Positions> {
    let of = |file: &PathBuf| -> Result<Vec<Point<2>>> {
        Ok(read(file)?.poses().iter().map(|pose| [pose.x, pose.y]).collect())
    };
    let odometry = if paths.odometry.is_file() { of(&paths.odometry)? } else { Vec::new() };
    Ok([odometry, of(&paths.reference)?, of(&paths.estimate)?])
}

/// Errors of the run, scan by scan.
fn errors(results: &Results, file: &File<'_>, maps: &[&Pictured]) -> Result<Vec<PathBuf>> {
    let mut curves: Vec<(String, Vec<PoseError>)> = Vec::new();
    for shown in maps {
        let paths = shown.paths.as_ref().context("a run has paths")?;
        let (reference, estimate) = (read(&paths.reference)?, read(&paths.estimate)?);
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
    let mut drawn = draw_curves(file.stem, &figure, file.medium)?;
    let mut table = Table::new(["map", "scan", "translation_m", "heading_rad", "weighted"]);
    for (map, errors) in &curves {
        for (scan, error) in errors.iter().enumerate() {
            let values = [error.translation(), error.heading(), weighted.of(error)];
            let cells = [map.as_str().into(), scan.into()].into_iter();
            table.push(cells.chain(values.map(Value::from)).collect());
        }
    }
    drawn.push(save_rows(file, &table)?);
    Ok(drawn)
}

fn caption(
    results: &Results,
    picture: &Picture,
    maps: &[&Pictured],
    view: Option<&View>,
) -> Vec<String> {
    let mut sentences = vec![results.facts.describe()];
    let of_maps = |column: &str, is_described: &dyn Fn(&Pictured) -> bool| {
        let described = maps.iter().filter(|shown| is_described(shown));
        let mut values: Vec<f64> =
            described.filter_map(|shown| shown.cell(column).number()).collect();
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
    if maps.iter().any(|shown| shown.paths.as_ref().is_some_and(|paths| paths.odometry.is_file())) {
        sentences.push(
            "Odometry: by the run's odometry alone, cut off where the map ends; ring: the start"
                .to_owned(),
        );
    }
    sentences.extend(view.map(View::describe));
    let text: String = sentences.iter().map(|sentence| format!("{sentence}. ")).collect();
    let text = text.trim_end().to_owned() + &vocabulary(maps.iter().map(|shown| name(shown)));
    let own = (!picture.caption.is_empty()).then(|| picture.caption.clone());
    own.into_iter().chain([text]).collect()
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

/// "grid-based map (gbs): 1,245 points (0.80 %), −11.20 nats per point", or the mean error of the run.
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
        title += &format!(", {} nats per point", number(likelihood));
    }
    if let (Some(error), false) = (shown.cell("weighted").number(), with_likelihood) {
        title += &format!(", d = {error:.4}");
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
        // From a program without any estimate.
        Err(TumError::Empty { .. }) => Ok(Trajectory::default()),
        found => Ok(found?.trajectory),
    }
}
