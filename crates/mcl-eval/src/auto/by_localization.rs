use anyhow::{Result, bail};
use mcl_filter::CheckedSettings;
use mcl_maps::MapSize;

use super::racing::{Lane, Race, RaceSettings, Verdict, race};
use super::{Build, Chosen, Criterion, Try};
use crate::experiment::LocalizationData;

/// Sizes of the race: each is so many times the one before.
const RACE_FACTOR: f64 = 1.25;
/// The smallest size of the race.
const SMALLEST_RACED: f64 = 50.0;

/// The sizes that a choice by localization is made from: numbers of points, each a quarter more than the one
/// before, fewer than all.
pub fn race_sizes(points: usize) -> Vec<usize> {
    let mut sizes = vec![SMALLEST_RACED.min(points as f64)];
    while sizes[sizes.len() - 1] * RACE_FACTOR < points as f64 {
        sizes.push((sizes[sizes.len() - 1] * RACE_FACTOR).round());
    }
    sizes.into_iter().map(|size| size as usize).collect()
}

/// The smallest size on which the weighted error is within 5 % of that on all points, with 95 %
/// confidence: bisection over [`race_sizes`], each decided by a race. `observe` is told of every race.
///
/// # Errors
/// When no size was shown to do, a map cannot be built or the filter cannot run.
pub fn size_by_localization(
    data: &LocalizationData<'_>,
    filter: &CheckedSettings,
    settings: &RaceSettings,
    sigma: f64,
    build: Build<2>,
    observe: impl Fn(&Race),
) -> Result<Chosen> {
    let mut reference = Lane::new(data, &data.all_points()?, filter)?;
    let sizes = race_sizes(data.points.len());
    // Each size that is decided has its share of the risk.
    let decisions = (sizes.len() as f64).log2().ceil().max(1.0);
    let settings = RaceSettings { risk: settings.risk / decisions, ..*settings };
    let mut races: Vec<Race> = Vec::new();
    let mut tried = Vec::new();
    let (mut below, mut within) = (0, sizes.len());
    let mut value = None;
    while below < within {
        let middle = (below + within) / 2;
        let map = build(&data.points, Some(MapSize::Points(sizes[middle])), sigma)?;
        let race = race(&mut Lane::new(data, &map, filter)?, &mut reference, &settings)?;
        observe(&race);
        match race.verdict {
            Verdict::Within => (within, value) = (middle, Some(sizes[middle] as f64)),
            Verdict::Beyond | Verdict::Open => below = middle + 1,
        }
        tried.push(Try { value: sizes[middle] as f64, score: race.weighted / race.reference });
        races.push(race);
    }
    let Some(value) = value else {
        bail!(
            "no map smaller than all points was shown to localize within 5 % of them; the largest tried has {} points",
            races.iter().map(|race| race.map_points).max().unwrap_or(0)
        );
    };
    tried.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(Chosen { by: Criterion::Localization, value, tried, races })
}
