use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::{Bounds, Point, PointMap};
use mcl_maps::files::read_map;

use super::maps::{
    ALL, COMPARISON_GRID, COMPARISON_RANDOM, INDEX, MapRow, OVERVIEW, OVERVIEW_IMPROVED, file_name,
};
use super::{FIGURES, MAPS, SUMMARY};
use crate::experiment::{Builder, LikelihoodExperiment, Manifest, SummaryRow, read_rows};
use mcl_core::text::thousands;
use mcl_figures::{
    Arrangement, AxisSpec, CloudFigure, CloudLabels, CloudPanel, Curve, CurveFigure, CurvePanel,
    CurvePoint, CurveStyle, Interval, Scale, draw_clouds, draw_curves,
};

/// Draws figures 1 to 4.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let drawing = Drawing {
        maps: Maps::read(&folder.join(MAPS))?,
        summary: read_rows(&folder.join(SUMMARY))?,
        figures: folder.join(FIGURES),
        definition: manifest.definition()?,
        manifest,
    };
    if drawing.manifest.dataset.dimensions == 3 {
        return drawing.in_space();
    }
    let drawn =
        [drawing.overview()?, drawing.comparison()?, drawing.points()?, drawing.likelihood()?];
    Ok(drawn.concat())
}

/// The saved maps.
pub(super) struct Maps {
    folder: PathBuf,
    rows: Vec<MapRow>,
}

impl Maps {
    fn read(folder: &Path) -> Result<Self> {
        Ok(Maps { folder: folder.to_owned(), rows: read_rows(&folder.join(INDEX))? })
    }

    pub(super) fn row(&self, name: &str) -> Result<&MapRow> {
        self.rows.iter().find(|row| row.name == name).with_context(|| {
            format!("{} has no row for map {name}", self.folder.join(INDEX).display())
        })
    }

    pub(super) fn points<const D: usize>(&self, name: &str) -> Result<PointMap<D>> {
        Ok(read_map(self.folder.join(file_name(name)))?)
    }
}

pub(super) struct Drawing {
    pub manifest: Manifest,
    pub definition: LikelihoodExperiment,
    pub maps: Maps,
    summary: Vec<SummaryRow>,
    pub figures: PathBuf,
}

impl Drawing {
    /// Figure 1: all points, a grid-based map, and what fuzzy k-means makes of it.
    fn overview(&self) -> Result<[PathBuf; 2]> {
        let [all, initial, improved] =
            [ALL, OVERVIEW, OVERVIEW_IMPROVED].map(|name| self.maps.points(name));
        let (all, initial, improved) = (all?, initial?, improved?);
        let panels = vec![
            panel(format!("all data: {} points", thousands(all.len())), &all),
            panel(self.title("grid-based map (gbs)", OVERVIEW)?, &initial),
            panel(self.title("improved map (gbs+f-km)", OVERVIEW_IMPROVED)?, &improved),
        ];
        let caption = format!(
            "{}. Grid-based sampling with cells of {:.3} m; fuzzy k-means with σ = {} m.",
            self.manifest.dataset.describe(),
            self.maps.row(OVERVIEW)?.cell_m.unwrap_or(f64::NAN),
            self.definition.sigma
        );
        self.clouds("figure1-maps", panels, Arrangement::Stacked, caption)
    }

    /// Figure 2: a random beside a grid-based map of the same size.
    fn comparison(&self) -> Result<[PathBuf; 2]> {
        let random = self.maps.points(COMPARISON_RANDOM)?;
        let grid = self.maps.points(COMPARISON_GRID)?;
        let panels = vec![
            panel(self.title("random (rnd)", COMPARISON_RANDOM)?, &random),
            panel(self.title("grid-based (gbs)", COMPARISON_GRID)?, &grid),
        ];
        let caption = format!(
            "{}. Random sampling with seed {}; grid-based sampling with cells of {:.3} m.",
            self.manifest.dataset.describe(),
            self.maps.row(COMPARISON_RANDOM)?.seed.unwrap_or_default(),
            self.maps.row(COMPARISON_GRID)?.cell_m.unwrap_or(f64::NAN)
        );
        let arrangement = beside_when_tall(&grid.bounds());
        self.clouds("figure2-sampling", panels, arrangement, caption)
    }

    /// Figure 3: all points.
    fn points(&self) -> Result<[PathBuf; 2]> {
        let all = self.maps.points(ALL)?;
        let bounds = all.bounds();
        let title = format!(
            "{}: {} points, {:.1} m × {:.1} m",
            self.manifest.dataset.title,
            thousands(all.len()),
            bounds.extent(0),
            bounds.extent(1)
        );
        let caption =
            format!("{}. Darker where points are denser.", self.manifest.dataset.describe());
        self.clouds("figure3-points", vec![panel(title, &all)], Arrangement::Stacked, caption)
    }

    /// Figure 4: likelihood against map size, all sizes above and up to 10 % beneath as in the paper;
    /// last the sizes whose likelihoods lie too close together to be told apart there.
    pub(super) fn likelihood(&self) -> Result<[PathBuf; 2]> {
        let panel = |title: &str, sizes: RangeInclusive<f64>, x: Scale, y: Scale| {
            let axis =
                |label: &str, scale| AxisSpec { label: label.to_owned(), scale, range: None };
            CurvePanel {
                title: title.to_owned(),
                x: axis("map size [% of the data's points]", x),
                y: axis("log-likelihood [nats per point]", y),
                curves: self.curves(sizes),
            }
        };
        let symlog = Scale::Symlog { linear_below: 1.0 };
        let mut panels = vec![
            panel("all sizes", 0.0..=100.0, Scale::Log, symlog),
            panel("up to 10 %", 0.0..=10.0, Scale::Linear, symlog),
        ];
        let close_up = 3.0..=100.0;
        if self.summary.iter().any(|row| close_up.contains(&row.size_percent)) {
            panels.push(panel("from 3 %, close-up", close_up, Scale::Log, Scale::Linear));
        }
        let figure = CurveFigure {
            panels,
            interval: Interval::Bars,
            caption: vec![format!(
                "{}. Mean log-likelihood of the data under maps of different sizes, with Student's \
                 95 % intervals over {} maps; σ = {} m. The size is that of the finished map: \
                 fuzzy k-means (+f-km) moves points together, and duplicates are dropped.",
                self.manifest.dataset.describe(),
                self.map_counts(),
                self.definition.sigma
            )],
        };
        Ok(draw_curves(&self.figures.join("figure4-likelihood"), &figure)?)
    }

    /// The four curves over requested sizes in a range (percent).
    fn curves(&self, sizes: RangeInclusive<f64>) -> Vec<Curve> {
        let strategies = Builder::ALL.into_iter().flat_map(|b| [(b, false), (b, true)]);
        strategies
            .enumerate()
            .map(|(index, (builder, improved))| {
                let of_strategy = self.summary.iter().filter(|row| {
                    row.builder == builder
                        && row.improved == improved
                        && sizes.contains(&row.size_percent)
                });
                let points = of_strategy.map(|row| CurvePoint {
                    x: row.mean_real_percent,
                    mean: row.mean_log_likelihood,
                    low: row.ci95_low.unwrap_or(f64::NAN),
                    high: row.ci95_high.unwrap_or(f64::NAN),
                    mark: None,
                });
                Curve {
                    label: builder.label(improved).to_owned(),
                    style: CurveStyle::nth(index),
                    points: points.collect(),
                }
            })
            .collect()
    }

    /// "10" or "5 to 10": how many maps stand behind a point.
    fn map_counts(&self) -> String {
        let counts = self.summary.iter().map(|row| row.maps);
        match (counts.clone().min(), counts.max()) {
            (Some(least), Some(most)) if least < most => format!("{least} to {most}"),
            (least, _) => least.unwrap_or_default().to_string(),
        }
    }

    /// A map's name with its size and likelihood.
    pub(super) fn title(&self, what: &str, name: &str) -> Result<String> {
        let row = self.maps.row(name)?;
        let percent = 100.0 * row.points as f64 / self.manifest.dataset.points as f64;
        let mut title = format!("{what}: {} points ({percent:.2} %)", thousands(row.points));
        if let Some(log_likelihood) = row.log_likelihood {
            title += &format!(", {} nats per point", signed(log_likelihood));
        }
        Ok(title)
    }

    fn clouds(
        &self,
        name: &str,
        panels: Vec<CloudPanel>,
        arrangement: Arrangement,
        caption: String,
    ) -> Result<[PathBuf; 2]> {
        let figure =
            CloudFigure { panels, arrangement, labels: CloudLabels::PLANE, caption: vec![caption] };
        Ok(draw_clouds(&self.figures.join(name), &figure)?)
    }
}

fn panel(title: String, map: &PointMap<2>) -> CloudPanel<'_> {
    let points: &[Point<2>] = map.points();
    CloudPanel { title, points, shades: &[], paths: Vec::new() }
}

/// Wide buildings above each other, others beside each other.
fn beside_when_tall(bounds: &Bounds<2>) -> Arrangement {
    if bounds.extent(0) > 1.5 * bounds.extent(1) {
        Arrangement::Stacked
    } else {
        Arrangement::SideBySide
    }
}

/// Two decimals, with a minus sign that is one.
fn signed(value: f64) -> String {
    format!("{value:.2}").replace('-', "−")
}
