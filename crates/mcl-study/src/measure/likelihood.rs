//! How likely the data is under a map.

use anyhow::Result;
use mcl_maps::size_criteria::bic;
use mcl_maps::{PointSet, mixture_log_likelihood};

use super::{MapContext, MapMeasure};
use crate::table::Value;
use crate::trial::map::Shape;

/// Log-likelihood in nats per point of the points that built the map, and of those held out; the Bayesian
/// information criterion (nats per point, smaller is better); and the course of a refinement.
/// `fitted_log_likelihood` is that of the means before each is replaced by its nearest data point;
/// `iterations` are updates of EM, `evaluations` all evaluations of the likelihood.
pub const LIKELIHOOD: MapMeasure = MapMeasure {
    name: "likelihood",
    columns: &[
        "log_likelihood",
        "held_out_log_likelihood",
        "bic",
        "fitted_log_likelihood",
        "iterations",
        "evaluations",
        "converged",
    ],
    planar: measure::<2>,
    spatial: measure::<3>,
};

fn measure<const D: usize>(context: &MapContext<'_, D>) -> Result<Vec<Value>> {
    let MapContext { division, map, .. } = context;
    let per_point = |data: &PointSet<D>| {
        let points = map.points();
        points.map(|points| mixture_log_likelihood(data, points, map.sigma)).transpose()
    };
    let own = per_point(&division.building)?;
    let held_out = match &division.held_out {
        Some(data) => per_point(data)?,
        None => None,
    };
    let sizes = own.zip(map.points());
    let bic = sizes.map(|(own, map)| bic(own.per_point, division.building.len(), map.len(), D));
    let report = match &map.shape {
        Shape::Points(built) => built.refinement.as_ref(),
        _ => None,
    };
    let fitted = report.and_then(|report| report.steps.last());
    Ok(vec![
        own.map(|found| found.per_point).into(),
        held_out.map(|found| found.per_point).into(),
        bic.into(),
        fitted.map(|step| step.log_likelihood).into(),
        report.map(|report| report.steps.len() - 1).into(),
        report.map(|report| report.evaluations).into(),
        report.map(|report| report.converged).into(),
    ])
}
