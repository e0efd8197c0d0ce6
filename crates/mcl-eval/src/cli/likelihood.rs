use anyhow::Result;
use mcl_maps::{PointSet, mixture_log_likelihood};
use serde::Serialize;

use super::Outcome;
use super::args::LikelihoodArgs;
use super::output::{print, tell_losses, thousands};
use crate::source::LogSource;

#[derive(Serialize)]
struct Likelihood {
    points: usize,
    map_points: usize,
    log_likelihood: f64,
    log_likelihood_per_point: f64,
}

pub fn run(args: &LikelihoodArgs) -> Result<Outcome> {
    let map = mcl_maps::files::read_map(&args.map)?;
    let source = LogSource::open(&args.log.log, &args.log.options())?;
    let data = PointSet::new(source.points()?)?;
    let found = mixture_log_likelihood(&data, &map, args.sigma)?;
    let likelihood = Likelihood {
        points: data.len(),
        map_points: map.len(),
        log_likelihood: found.total,
        log_likelihood_per_point: found.per_point,
    };
    print(args.json, &likelihood, |found| {
        format!(
            "{} points under a map of {}, σ = {} m:\nlog-likelihood {:.6} nats per point, {:.3} in all",
            thousands(found.points),
            thousands(found.map_points),
            args.sigma,
            found.log_likelihood_per_point,
            found.log_likelihood
        )
    })?;
    Ok(tell_losses(&args.log.log, &source))
}
