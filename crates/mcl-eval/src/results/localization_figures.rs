use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::Result;
use mcl_core::{Point, Trajectory};
use mcl_maps::files::read_map;
use mcl_metrics::tum::{NonPlanar, read_file};
use mcl_metrics::{PoseError, WeightedPoseError, pose_errors};

use super::localization::{ESTIMATE_FILE, MAP_FILE, REFERENCE_FILE, TRAJECTORY};
use super::{FIGURES, SUMMARY};
use crate::experiment::{
    LocalizationExperiment, LocalizationSummaryRow, Manifest, MapStrategy, Split, read_rows,
};
use mcl_core::text::thousands;
use mcl_figures::{
    Arrangement, AxisSpec, CloudFigure, CloudLabels, CloudPanel, CloudPath, Curve, CurveFigure,
    CurvePanel, CurvePoint, CurveStyle, Interval, Scale, draw_clouds, draw_curves,
};

/// Draws figure 5 of each split, and the trajectory figures.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let drawing = Drawing {
        definition: manifest.definition()?,
        manifest,
        summary: read_rows(&folder.join(SUMMARY))?,
        figures: folder.join(FIGURES),
        trajectory: folder.join(TRAJECTORY),
    };
    let mut drawn = Vec::new();
    for &split in &drawing.definition.splits {
        drawn.extend(drawing.errors(split)?);
    }
    drawn.extend(drawing.paths()?);
    drawn.extend(drawing.error_over_time()?);
    Ok(drawn)
}

struct Drawing {
    manifest: Manifest,
    definition: LocalizationExperiment,
    summary: Vec<LocalizationSummaryRow>,
    figures: PathBuf,
    trajectory: PathBuf,
}

impl Drawing {
    /// Figure 5: localization error against map size, all sizes above, up to 1 % beneath.
    fn errors(&self, split: Split) -> Result<[PathBuf; 2]> {
        let panel = |title: &str, sizes: RangeInclusive<f64>, scale: Scale| {
            let curves = self.curves(split, sizes);
            CurvePanel {
                title: title.to_owned(),
                x: AxisSpec {
                    range: size_range(&curves, scale),
                    ..axis("map size [% of the points that build the map]", scale)
                },
                // Lost runs err by metres, tracked ones by centimetres.
                y: axis("mean weighted error d [–]", Scale::Log),
                curves,
            }
        };
        let all = self
            .rows(split, MapStrategy::All)
            .next()
            .map_or(String::new(), |row| format!(" On all points d is {:.4}.", row.weighted));
        let filter = &self.definition.filter;
        let figure = CurveFigure {
            panels: vec![
                panel("all sizes", 0.0..=100.0, Scale::Log),
                panel("up to 1 %", 0.0..=1.0, Scale::Linear),
            ],
            interval: Interval::Bars,
            caption: vec![format!(
                "{}. {}. Error of equation 7 with ξ = 0.8, mean over {} runs with {} particles \
                 and 95 % bootstrap intervals over runs; open symbols: diverged runs of all. σ_hit = {} \
                 m, z_rand = {}, α = {:?}, noise added to the odometry {} m and {} rad.{all}",
                self.manifest.dataset.describe(),
                scans_of(split),
                self.definition.runs_for(&self.manifest.dataset.name),
                filter.particles,
                filter.sigma_hit,
                filter.z_rand,
                filter.alpha,
                self.definition.odometry_noise.xy,
                self.definition.odometry_noise.theta,
            )],
        };
        let name = format!("figure5-localization-{}", split.name());
        Ok(draw_curves(&self.figures.join(name), &figure)?)
    }

    fn rows(
        &self,
        split: Split,
        strategy: MapStrategy,
    ) -> impl Iterator<Item = &LocalizationSummaryRow> {
        self.summary.iter().filter(move |row| row.split == split && row.strategy == strategy)
    }

    fn curves(&self, split: Split, sizes: RangeInclusive<f64>) -> Vec<Curve> {
        let curve = |(index, strategy): (usize, MapStrategy)| Curve {
            label: strategy.label().to_owned(),
            style: CurveStyle::nth(index),
            points: self
                .rows(split, strategy)
                .filter(|row| sizes.contains(&row.size_percent))
                .map(|row| CurvePoint {
                    x: row.mean_real_percent,
                    mean: row.weighted,
                    low: row.weighted_low.unwrap_or(f64::NAN),
                    high: row.weighted_high.unwrap_or(f64::NAN),
                    mark: (row.diverged > 0).then(|| format!("{}/{}", row.diverged, row.runs)),
                })
                .collect(),
        };
        MapStrategy::DRAWN
            .into_iter()
            .enumerate()
            .map(curve)
            .filter(|curve| !curve.points.is_empty())
            .collect()
    }

    /// Map, true and estimated path of one run.
    fn paths(&self) -> Result<[PathBuf; 2]> {
        let map = read_map(self.trajectory.join(MAP_FILE))?;
        let reference = positions(&self.read(REFERENCE_FILE)?);
        let estimate = positions(&self.read(ESTIMATE_FILE)?);
        let path = |label: &str, index: usize, points| CloudPath {
            label: label.to_owned(),
            style: CurveStyle::nth(index),
            points,
        };
        let figure = CloudFigure {
            panels: vec![CloudPanel {
                title: format!("map of {} points (gbs+f-km)", thousands(map.len())),
                points: map.points(),
                shades: &[],
                paths: vec![path("reference", 2, &reference), path("estimate", 1, &estimate)],
            }],
            arrangement: Arrangement::Stacked,
            labels: CloudLabels::PLANE,
            caption: vec![format!(
                "{}. Run 0 with {} particles. {}.",
                self.manifest.dataset.describe(),
                self.definition.filter.particles,
                scans_of(self.definition.splits[0])
            )],
        };
        Ok(draw_clouds(&self.figures.join("trajectory"), &figure)?)
    }

    /// Errors of the same run, scan by scan.
    fn error_over_time(&self) -> Result<[PathBuf; 2]> {
        let errors =
            pose_errors(self.read(REFERENCE_FILE)?.poses(), self.read(ESTIMATE_FILE)?.poses())?;
        let weighted = WeightedPoseError::default();
        let panel = |title: &str, unit: &str, value: &dyn Fn(&PoseError) -> f64| CurvePanel {
            title: title.to_owned(),
            x: axis("scan", Scale::Linear),
            y: axis(unit, Scale::Linear),
            curves: vec![Curve {
                label: "estimate".to_owned(),
                style: CurveStyle::line(1),
                points: errors
                    .iter()
                    .enumerate()
                    .map(|(scan, error)| CurvePoint {
                        x: scan as f64,
                        mean: value(error),
                        low: f64::NAN,
                        high: f64::NAN,
                        mark: None,
                    })
                    .collect(),
            }],
        };
        let figure = CurveFigure {
            panels: vec![
                panel("translation", "error [m]", &PoseError::translation),
                panel("heading", "error [°]", &|error| error.heading().to_degrees()),
                panel("weighted, ξ = 0.8", "error d [–]", &|error| weighted.of(error)),
            ],
            interval: Interval::Bars,
            caption: vec![format!(
                "{}. The run of the trajectory figure.",
                self.manifest.dataset.describe()
            )],
        };
        Ok(draw_curves(&self.figures.join("trajectory-error"), &figure)?)
    }

    fn read(&self, name: &str) -> Result<Trajectory> {
        Ok(read_file(self.trajectory.join(name), NonPlanar::Refuse)?.trajectory)
    }
}

/// The sizes of the curves with room on both sides for the numbers of diverged runs.
fn size_range(curves: &[Curve], scale: Scale) -> Option<[f64; 2]> {
    let sizes = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.x);
    let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    let range = match scale {
        Scale::Log => [low / 1.4, high * 1.4],
        Scale::Linear | Scale::Symlog { .. } => [0.0, high * 1.08],
    };
    (low > 0.0 && low <= high).then_some(range)
}

fn scans_of(split: Split) -> &'static str {
    match split {
        Split::Same => "Map and runs use the same scans, as in the paper",
        Split::HeldOut => "Maps are built from even scans, the runs are on odd ones",
    }
}

fn axis(label: &str, scale: Scale) -> AxisSpec {
    AxisSpec { label: label.to_owned(), scale, range: None }
}

fn positions(trajectory: &Trajectory) -> Vec<Point<2>> {
    trajectory.poses().iter().map(|pose| [pose.x, pose.y]).collect()
}
