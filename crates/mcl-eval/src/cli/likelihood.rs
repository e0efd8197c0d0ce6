use anyhow::Result;
use mcl_core::Point;
use mcl_maps::{PointSet, mixture_log_likelihood};
use serde::Serialize;

use super::Outcome;
use super::args::LikelihoodArgs;
use super::output::{open_map, print, reference_of_data, report_data_losses};
use mcl_core::text::thousands;
use mcl_study::data::cloud_source::Points;
use mcl_study::data::source::DataSource;

#[derive(Serialize)]
struct Likelihood {
    dimensions: usize,
    points: usize,
    map_points: usize,
    log_likelihood: f64,
    log_likelihood_per_point: f64,
    /// The reference that places the points of a log, and whose poses it has.
    reference: Option<String>,
}

pub fn run(args: &LikelihoodArgs) -> Result<Outcome> {
    let name = &args.data.log.log;
    let source = DataSource::open(name, &args.data.options(), false)?;
    let mut likelihood = match source.points()? {
        Points::Planar(points) => likelihood(points, args)?,
        Points::Spatial(points) => likelihood(points, args)?,
    };
    likelihood.reference = reference_of_data(&source);
    print(args.json, &likelihood, |found| {
        let reference =
            found.reference.as_ref().map(|reference| format!("\nreference: {reference}"));
        format!(
            "{} points under a map of {}, σ = {} m:\nlog-likelihood {:.6} nats per point, {:.3} in all{}",
            thousands(found.points),
            thousands(found.map_points),
            args.sigma,
            found.log_likelihood_per_point,
            found.log_likelihood,
            reference.unwrap_or_default()
        )
    })?;
    Ok(report_data_losses(name, &source))
}

fn likelihood<const D: usize>(points: Vec<Point<D>>, args: &LikelihoodArgs) -> Result<Likelihood> {
    let map = open_map::<D>(&args.map)?;
    let data = PointSet::new(points)?;
    let found = mixture_log_likelihood(&data, &map, args.sigma)?;
    Ok(Likelihood {
        dimensions: D,
        points: data.len(),
        map_points: map.len(),
        log_likelihood: found.total,
        log_likelihood_per_point: found.per_point,
        reference: None,
    })
}
