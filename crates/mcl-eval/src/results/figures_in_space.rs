//! The figures of a likelihood experiment in three dimensions: the same as in the plane, maps seen obliquely
//! from above.

use std::f64::consts::FRAC_PI_6;
use std::path::PathBuf;

use anyhow::Result;
use mcl_core::{Point, PointMap};

use super::figures::Drawing;
use super::maps::{ALL, COMPARISON_GRID, COMPARISON_RANDOM, OVERVIEW, OVERVIEW_IMPROVED};
use mcl_core::text::thousands;
use mcl_figures::{Arrangement, CloudFigure, CloudLabels, CloudPanel, draw_clouds};

/// The direction looked from: turned by this about the vertical …
const AZIMUTH: f64 = FRAC_PI_6;
/// … and so high above the horizon.
const ELEVATION: f64 = FRAC_PI_6 * 1.2;
/// Share of the points at either end of the heights that are drawn in the colour of the end: a few stray
/// points must not take the colours of all others.
const CLIPPED: f64 = 0.01;

impl Drawing {
    /// Figures 1, 2 and 4.
    pub(super) fn in_space(&self) -> Result<Vec<PathBuf>> {
        let all = self.maps.points::<3>(ALL)?;
        let view = View::of(&all, self.definition.hide_above(&self.manifest.dataset.name));
        let cell = |name| self.maps.row(name).map(|row| row.cell_m.unwrap_or(f64::NAN));

        let title = format!("all data: {} points", thousands(all.len()));
        let maps = [
            (title, all),
            (self.title("grid-based map (gbs)", OVERVIEW)?, self.maps.points(OVERVIEW)?),
            (
                self.title("improved map (gbs+f-km)", OVERVIEW_IMPROVED)?,
                self.maps.points(OVERVIEW_IMPROVED)?,
            ),
        ];
        let caption = format!(
            "{}. Grid-based sampling with cells of {:.3} m; fuzzy k-means with σ = {} m. {}",
            self.manifest.dataset.describe(),
            cell(OVERVIEW)?,
            self.definition.sigma,
            view.describe()
        );
        let overview = self.draw("figure1-maps", &view, &maps, caption)?;

        let maps = [
            (self.title("random (rnd)", COMPARISON_RANDOM)?, self.maps.points(COMPARISON_RANDOM)?),
            (self.title("grid-based (gbs)", COMPARISON_GRID)?, self.maps.points(COMPARISON_GRID)?),
        ];
        let caption = format!(
            "{}. Grid-based sampling with cells of {:.3} m. {}",
            self.manifest.dataset.describe(),
            cell(COMPARISON_GRID)?,
            view.describe()
        );
        let comparison = self.draw("figure2-sampling", &view, &maps, caption)?;
        Ok([overview, comparison, self.likelihood()?].concat())
    }

    fn draw(
        &self,
        name: &str,
        view: &View,
        maps: &[(String, PointMap<3>)],
        caption: String,
    ) -> Result<[PathBuf; 2]> {
        let seen: Vec<_> = maps.iter().map(|(_, map)| view.seen(map)).collect();
        let panels = maps.iter().zip(&seen).map(|((title, _), seen)| CloudPanel {
            title: title.clone(),
            points: &seen.points,
            shades: &seen.shades,
            paths: Vec::new(),
        });
        let figure = CloudFigure {
            panels: panels.collect(),
            arrangement: Arrangement::Stacked,
            labels: CloudLabels { x: "across the view [m]", y: "up the view [m]" },
            caption: vec![caption],
        };
        Ok(draw_clouds(&self.figures.join(name), &figure)?)
    }
}

/// A parallel view from above, the same for all maps of a data set.
struct View {
    /// Heights (m) of the first and the last colour.
    heights: [f64; 2],
    /// Points above this height (m) are not shown.
    hide_above: Option<f64>,
}

/// Points as they are seen, the farthest first, so that nearer ones are drawn over them.
struct Seen {
    points: Vec<Point<2>>,
    /// Height of each, from 0 (low) to 1 (high).
    shades: Vec<f64>,
}

impl View {
    fn of(all: &PointMap<3>, hide_above: Option<f64>) -> Self {
        let mut heights: Vec<f64> = all
            .points()
            .iter()
            .map(|point| point[2])
            .filter(|height| hide_above.is_none_or(|limit| *height <= limit))
            .collect();
        heights.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * heights.len().saturating_sub(1) as f64).round() as usize;
            heights.get(index).copied().unwrap_or(0.0)
        };
        View { heights: [at(CLIPPED), at(1.0 - CLIPPED)], hide_above }
    }

    fn seen(&self, map: &PointMap<3>) -> Seen {
        let (sin, cos) = AZIMUTH.sin_cos();
        let (sin_up, cos_up) = ELEVATION.sin_cos();
        let [low, high] = self.heights;
        let mut seen: Vec<(f64, Point<2>, f64)> = map
            .points()
            .iter()
            .filter(|point| self.hide_above.is_none_or(|limit| point[2] <= limit))
            .map(|&[x, y, z]| {
                let across = x * cos + y * sin;
                let away = y * cos - x * sin;
                let up = z * cos_up + away * sin_up;
                let depth = away * cos_up - z * sin_up;
                let shade = ((z - low) / (high - low).max(1e-9)).clamp(0.0, 1.0);
                (depth, [across, up], shade)
            })
            .collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        Seen {
            points: seen.iter().map(|seen| seen.1).collect(),
            shades: seen.iter().map(|seen| seen.2).collect(),
        }
    }

    fn describe(&self) -> String {
        // To decimetres; a zero is a plain one.
        let [low, high] = self.heights.map(|height| (10.0 * height).round() / 10.0 + 0.0);
        let hidden = match self.hide_above {
            Some(limit) => format!("; points above {limit} m are not shown"),
            None => String::new(),
        };
        format!(
            "Seen obliquely from above, coloured by height: dark blue at {low:.1} m and below, yellow at {high:.1} m \
             and above{hidden}."
        )
        .replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_points_come_last_and_high_points_lie_higher() {
        let map =
            PointMap::new(vec![[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 5.0, 0.0], [0.0, 0.0, 3.0]])
                .unwrap();
        let view = View { heights: [0.0, 2.0], hide_above: Some(2.5) };
        let seen = view.seen(&map);
        // 5 m away, then the one on the floor, then the one above it, which is nearer to an eye above.
        assert_eq!(seen.shades, [0.0, 0.0, 1.0]);
        let heights: Vec<f64> = seen.points.iter().map(|point| point[1]).collect();
        assert!(heights[2] > heights[1] && heights[0] > heights[1], "{heights:?}");
        assert_eq!(View::of(&map, Some(2.5)).heights, [0.0, 2.0]);
    }
}
