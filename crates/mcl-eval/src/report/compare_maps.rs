//! Two maps of one size, overlaid, with the likelihood of the data's points: it shows where each map explains
//! them badly.

use anyhow::{Context, Result};
use mcl_core::text::number;
use mcl_core::{Bounds, Point, PointMap};
use mcl_maps::mixture::point_log_likelihoods;
use mcl_maps::mixture_log_likelihood;
use mcl_study::measure::{MapContext, Measures, OfDimension};
use mcl_study::recipe::map::{MapRecipe, Size};
use mcl_study::store::results::Results;
use mcl_study::study::plan::Plan;
use mcl_study::table::Cells;
use mcl_study::trial::division::StudyData;
use mcl_study::trial::maps::Maps;
use serde::Serialize;

use crate::report::pack::{Packer, Steps, thinned};
use crate::report::record::MOST_MAP_POINTS;
use crate::report::watch::{check_same, distance_from_shown, row_of};

/// Largest number of data points shown.
pub const MOST_POINTS: usize = 6_000;
/// The share of the points whose likelihood is below the range of the colours.
const BELOW: f64 = 0.02;
/// Shades of likelihood.
const SHADES: f64 = 255.0;

/// Two maps of one size, and how likely the data is under each.
///
/// `data` holds, by [`Packer`]: x, y of the data's points (`i16`), their log-likelihood under the first map and under
/// the second (`u8`, from `low` at 0 to `high` at 255), then x, y of the first map's points and of the second's
/// (`i16`).
#[derive(Debug, Serialize)]
pub struct MapPair {
    /// A description of the maps.
    pub title: String,
    /// How they were chosen, in a sentence.
    pub rule: String,
    /// σ of the mixture (m).
    pub sigma_m: f64,
    /// Points of the data that are shown, of `all_points`.
    pub points: usize,
    /// Points that built the maps.
    pub all_points: usize,
    /// Log-likelihood (nats per point) of the darkest and of the lightest colour.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// The origin of the coordinates (m).
    pub origin: [f64; 2],
    /// Unit of the coordinates (m).
    pub step_m: f64,
    /// The maps.
    pub maps: [PairedMap; 2],
    /// The packed arrays.
    pub data: String,
}

/// A map of a pair.
#[derive(Debug, Serialize)]
pub struct PairedMap {
    /// The map in words.
    pub label: String,
    /// Number of its points that are shown, of `size`.
    pub points: usize,
    /// Number of its points.
    pub size: usize,
    /// Log-likelihood of all points that built it (nats per point).
    pub log_likelihood: f64,
    /// Share of the shown points that are less likely than `low`.
    pub below: f64,
}

/// The maps of a study to compare.
#[derive(Debug)]
pub struct ChosenMaps {
    /// How they were chosen, in a sentence.
    pub rule: String,
    /// The initial map, and the refined one.
    pub recipes: [MapRecipe; 2],
    /// The measurements of each, from their rows.
    rows: [Cells; 2],
}

/// Chooses the maps of a study to compare: an initial map and its refinement, of the builder and the size
/// nearest to [`distance_from_shown`], of the first draw. `None` where a study has no such two.
///
/// # Errors
/// When its recipes cannot be made, or their rows are missing.
pub fn choose(results: &Results, plan: &Plan) -> Result<Option<ChosenMaps>> {
    if results.facts.dimensions != 2 {
        return Ok(None);
    }
    let mut nearest: Option<((u8, f64), [MapRecipe; 2])> = None;
    for refined in plan.trials.iter().map(|trial| &trial.map) {
        let distance = distance_from_shown(refined);
        let is_nearer = nearest.as_ref().is_none_or(|(best, _)| {
            distance.0.cmp(&best.0).then(distance.1.total_cmp(&best.1)).is_lt()
        });
        let is_sized = matches!(refined.size, Some(Size::Percent(_) | Size::Points(_)));
        let initial = refined.initial();
        if is_nearer && is_sized && initial.kind != refined.kind {
            let identity = initial.identity()?;
            // The same map may have another draw number where nothing is drawn.
            let is_it = |other: &&MapRecipe| {
                other.kind == initial.kind
                    && other.size == initial.size
                    && other.identity().is_ok_and(|found| found == identity)
            };
            let found = plan.trials.iter().map(|trial| &trial.map).find(is_it);
            nearest = found.map(|found| (distance, [found.clone(), refined.clone()])).or(nearest);
        }
    }
    let Some((_, recipes)) = nearest else { return Ok(None) };
    let columns = results.study.measures.of_maps.iter().flat_map(|measure| measure.columns);
    let columns: Vec<&str> = columns.copied().collect();
    let measured = |recipe: &MapRecipe| -> Result<Cells> {
        let row = row_of(results, &recipe.cells()).context("its rows are missing")?;
        Ok(columns.iter().map(|&name| (name.to_owned(), row.get(name).clone())).collect())
    };
    let rows = [measured(&recipes[0])?, measured(&recipes[1])?];
    let [initial, refined] = &recipes;
    let rule = format!(
        "{} and what its refinement makes of it, {}: the size nearest to 1 % that study {} has, draw {}.",
        label_of(initial),
        refined.kind,
        results.name,
        initial.draw
    );
    Ok(Some(ChosenMaps { rule, recipes, rows }))
}

/// Builds the two maps again, and computes the measures of their study.
///
/// # Errors
/// When one cannot be built, or differs from its row.
pub fn repeat(
    title: String,
    chosen: &ChosenMaps,
    measures: &Measures,
    data: &StudyData,
) -> Result<MapPair> {
    let ChosenMaps { rule, recipes, rows } = chosen;
    let maps = Maps::<2>::new(data, recipes)?;
    let division = maps.division(&recipes[0])?;
    let built = [maps.get(&recipes[0])?, maps.get(&recipes[1])?];
    for ((recipe, map), row) in recipes.iter().zip(&built).zip(rows) {
        let context = MapContext { recipe, division: &division, map, data };
        let mut found = Cells::new();
        for measure in &measures.of_maps {
            found.extend(measure.take(&context)?);
        }
        check_same(&found, row).with_context(|| recipe.to_string())?;
    }
    let building = &division.building;
    let shown: Vec<Point<2>> = thinned(building.points(), MOST_POINTS).collect();
    let points = |place: usize| built[place].points().context("compared maps consist of points");
    let points: [&PointMap<2>; 2] = [points(0)?, points(1)?];
    let sigma = built[1].sigma;
    let of_each = |map| point_log_likelihoods(&shown, map, sigma);
    let likelihoods = [of_each(points[0])?, of_each(points[1])?];
    let mut sorted = likelihoods.concat();
    sorted.sort_by(f64::total_cmp);
    let low = sorted[(BELOW * sorted.len() as f64) as usize];
    let high = sorted.last().copied().unwrap_or(low).max(low + f64::EPSILON);
    let drawn = points.map(|map| thinned(map.points(), MOST_MAP_POINTS).collect::<Vec<_>>());
    let places = drawn.iter().flatten().chain(&shown).copied();
    let steps = Steps::over(&Bounds::around(places).context("there are no points")?);
    let mut packer = Packer::default();
    let put = |packer: &mut Packer, points: &[Point<2>]| {
        for axis in 0..2 {
            packer.put(points.iter().map(|point| steps.place(axis, point[axis]).to_le_bytes()));
        }
    };
    put(&mut packer, &shown);
    for of_map in &likelihoods {
        // Saturates at both ends.
        let shade = |value: &f64| [((value - low) / (high - low) * SHADES).round() as u8];
        packer.put(of_map.iter().map(shade));
    }
    drawn.iter().for_each(|points| put(&mut packer, points));
    let paired = |place: usize| -> Result<PairedMap> {
        let below = likelihoods[place].iter().filter(|value| **value < low).count();
        Ok(PairedMap {
            label: label_of(&recipes[place]),
            points: drawn[place].len(),
            size: points[place].len(),
            log_likelihood: mixture_log_likelihood(building, points[place], sigma)?.per_point,
            below: below as f64 / shown.len() as f64,
        })
    };
    Ok(MapPair {
        title,
        rule: rule.clone(),
        sigma_m: sigma,
        points: shown.len(),
        all_points: building.len(),
        low,
        high,
        origin: steps.origin,
        step_m: steps.step,
        maps: [paired(0)?, paired(1)?],
        data: packer.finish()?,
    })
}

/// "gbs 1 %".
fn label_of(recipe: &MapRecipe) -> String {
    match recipe.size {
        Some(size) => format!("{} {size}", recipe.kind),
        None => recipe.kind.to_string(),
    }
}

impl MapPair {
    /// A text description for readers who cannot see it.
    pub fn describe(&self) -> String {
        let of_map = |map: &PairedMap| {
            format!(
                "{}: {} nats per point, {} % of the shown points below {} nats",
                map.label,
                number(map.log_likelihood),
                number(100.0 * map.below),
                number(self.low)
            )
        };
        format!("{} {}; {}.", self.rule, of_map(&self.maps[0]), of_map(&self.maps[1]))
    }
}
