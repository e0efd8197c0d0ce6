//! Clouds in space, viewed obliquely from above.

use std::f64::consts::FRAC_PI_6;

use anyhow::Result;
use mcl_core::{Point, PointMap, math};
use mcl_maps::files::read_map;
use mcl_study::store::results::{Pictured, Results};

/// The viewing direction: azimuth about the vertical …
const AZIMUTH: f64 = FRAC_PI_6;
/// … and elevation above the horizon.
const ELEVATION: f64 = FRAC_PI_6 * 1.2;
/// Share of the points at either end of the heights that are drawn in the colour of the end: a few outliers
/// must not compress the colours of all others.
const CLIPPED: f64 = 0.01;

/// A parallel view from above, the same for all maps of a data set.
pub struct View {
    /// Heights (m) of the first and the last colour.
    heights: [f64; 2],
    /// Points above this height (m) are not shown.
    hide_above: Option<f64>,
}

/// Projected points, the farthest first, so that nearer ones are drawn over them.
pub struct ProjectedPoints {
    /// Coordinates across and up the view (m).
    pub points: Vec<Point<2>>,
    /// Height of each, from 0 (low) to 1 (high).
    pub shades: Vec<f64>,
}

impl View {
    /// The view of a data set in space, with colours by the largest map shown; `None` in the plane.
    ///
    /// # Errors
    /// When that map cannot be read.
    pub fn of(results: &Results) -> Result<Option<Self>> {
        if results.facts.dimensions != 3 {
            return Ok(None);
        }
        let shown = results.pictured.iter().flatten().flatten();
        let by_size =
            |a: &&Pictured, b: &&Pictured| a.cell("map_points").order(b.cell("map_points"));
        let Some(largest) = shown.max_by(by_size) else { return Ok(None) };
        let listed = results.study.listed(&results.facts.name);
        let hide_above = listed.and_then(|listed| listed.hide_above);
        Ok(Some(Self::of_map(&read_map(&largest.map)?, hide_above)))
    }

    fn of_map(map: &PointMap<3>, hide_above: Option<f64>) -> Self {
        let mut heights: Vec<f64> = map
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

    /// A map in this view.
    pub fn seen(&self, map: &PointMap<3>) -> ProjectedPoints {
        let (sin, cos) = math::sin_cos(AZIMUTH);
        let (sin_up, cos_up) = math::sin_cos(ELEVATION);
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
        ProjectedPoints {
            points: seen.iter().map(|seen| seen.1).collect(),
            shades: seen.iter().map(|seen| seen.2).collect(),
        }
    }

    /// A description of the view and its colours, for captions.
    pub fn describe(&self) -> String {
        // To decimetres; -0 becomes 0.
        let [low, high] = self.heights.map(|height| (10.0 * height).round() / 10.0 + 0.0);
        let hidden = match self.hide_above {
            Some(limit) => format!("; points above {limit} m are not shown"),
            None => String::new(),
        };
        format!(
            "Seen obliquely from above, coloured by height: dark blue at {low:.1} m and below, yellow at \
             {high:.1} m and above{hidden}"
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
        assert_eq!(View::of_map(&map, Some(2.5)).heights, [0.0, 2.0]);
    }
}
