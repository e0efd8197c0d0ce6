//! The scores of a map by the criteria of an automatic size and σ.

use anyhow::Result;
use mcl_maps::size_criteria::description_length;
use mcl_maps::{MapSize, PointSet, mixture_log_likelihood};

use super::{MapContext, MapMeasure};
use crate::auto::Rating;
use crate::recipe::criterion::Criterion;
use crate::table::Value;
use crate::trial::map::sample;

/// Nats per point, smaller is better: the description length of map and points, and minus the log-likelihood
/// of blocks of time left out in turn, under maps of the same size built from the others; the latter is empty
/// for clouds and for maps that fit no fold.
pub const CRITERIA: MapMeasure =
    MapMeasure { name: "criteria", columns: &["mdl", "held_out"], planar, spatial };

fn planar(context: &MapContext<'_, 2>) -> Result<Vec<Value>> {
    let mut values = own(context)?;
    let MapContext { recipe, data, division, map } = context;
    values.push(match map.requested_points {
        // A cloud has no scans to leave out.
        Some(points) if data.log().is_ok() => {
            let build = |data: &PointSet<2>, size, sigma| sample(recipe, data, size, sigma);
            let folds = data.folds()?;
            let rating = Rating { data: &division.building, folds: &folds, build: &build };
            match points > rating.largest(Criterion::HeldOut) {
                true => Value::Empty,
                false => rating
                    .score(Criterion::HeldOut, Some(MapSize::Points(points)), map.sigma)?
                    .into(),
            }
        }
        _ => Value::Empty,
    });
    Ok(values)
}

fn spatial(context: &MapContext<'_, 3>) -> Result<Vec<Value>> {
    let mut values = own(context)?;
    values.push(Value::Empty);
    Ok(values)
}

fn own<const D: usize>(context: &MapContext<'_, D>) -> Result<Vec<Value>> {
    let MapContext { division, map, .. } = context;
    let data = &division.building;
    let Some(points) = map.points() else { return Ok(vec![Value::Empty]) };
    let found = mixture_log_likelihood(data, points, map.sigma)?;
    Ok(vec![description_length(data, points, map.sigma, found)?.into()])
}
