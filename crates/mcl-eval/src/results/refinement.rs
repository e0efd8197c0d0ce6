use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::Point;
use mcl_maps::{PointSet, Refinement};

use super::{FIGURES, RunOptions, SUMMARY, TRIALS, Trials, draw_figures, prepare};
use crate::experiment::{
    DatasetFacts, HeldOut, INITIAL, Kind, Manifest, RefinementExperiment, RefinementRow,
    RefinementSummaryRow, RefinementTrial, Split, TrialOutcome, TrialStore, hold_out, read_rows,
    refinement_trials, summarize_refinement, write_rows,
};
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Interval, Scale, draw_curves,
};
use mcl_study::data::cloud_source::{Points, refuse_cloud};
use mcl_study::data::source::DataSource;

/// Runs a comparison of refinements on one log or point cloud; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &RefinementExperiment,
    name: &str,
    source: &DataSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    if experiment.splits.contains(&Split::HeldOut) {
        source.log().context("splits = [\"same\"] needs no scans to hold out")?;
    }
    let manifest =
        Manifest::new(name, Kind::Refinement, experiment, DatasetFacts::of_data(source)?)?;
    match source.points()? {
        Points::Planar(points) => {
            let divide = |fold| {
                let log = source.log()?;
                hold_out(&log.recording, log.max_range, fold)
            };
            run_on(points, divide, experiment, &manifest, folder, options)
        }
        Points::Spatial(points) => {
            let divide = |_| refuse_cloud(source.name());
            run_on(points, divide, experiment, &manifest, folder, options)
        }
    }
}

fn run_on<const D: usize>(
    points: Vec<Point<D>>,
    divide: impl Fn(usize) -> Result<HeldOut<D>> + Sync,
    experiment: &RefinementExperiment,
    manifest: &Manifest,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let dataset = manifest.dataset.name.as_str();
    let _prepared = prepare(folder, manifest, options.fresh)?;
    let all = PointSet::new(points)?;
    let mut store: TrialStore<RefinementRow> = TrialStore::open(&folder.join(TRIALS))?;
    let trials = Trials::divide(
        dataset,
        folder,
        refinement_trials(experiment, dataset),
        &mut store,
        RefinementRow::key,
        RefinementTrial::keys,
    )?;
    let outcome = trials.run(&mut store, options, |trial, watch| {
        if trial.split == Split::Same {
            return experiment.run_trial(dataset, &all, None, trial, watch);
        }
        let HeldOut { building, held_out } = divide(trial.repeat as usize)?;
        experiment.run_trial(dataset, &building, Some(&held_out), trial, watch)
    })?;
    let rows = store.finish(RefinementRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize_refinement(&rows, D)?)?;
    draw_figures(folder)?;
    Ok(outcome)
}

/// Likelihood over size per method, of the points that built the map and of those held out, and how many
/// times as large maps of plain fuzzy k-means have to be.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let definition: RefinementExperiment = manifest.definition()?;
    let summary: Vec<RefinementSummaryRow> = read_rows(&folder.join(SUMMARY))?;
    let methods: Vec<&str> = [INITIAL]
        .into_iter()
        .chain(definition.methods_for(&manifest.dataset.name).iter().map(Refinement::name))
        .collect();
    let curves =
        |split: Split, value: &dyn Fn(&RefinementSummaryRow) -> Option<f64>, bars: bool| {
            let curve = |(index, &method): (usize, &&str)| Curve {
                label: method.to_owned(),
                style: CurveStyle::nth(index),
                points: summary
                    .iter()
                    .filter(|row| row.split == split && row.method == method)
                    .filter_map(|row| {
                        let (low, high) =
                            if bars { (row.ci95_low, row.ci95_high) } else { (None, None) };
                        Some(CurvePoint {
                            x: row.mean_real_percent,
                            mean: value(row)?,
                            low: low.unwrap_or(f64::NAN),
                            high: high.unwrap_or(f64::NAN),
                            mark: None,
                        })
                    })
                    .collect(),
            };
            let curves = methods.iter().enumerate().map(curve);
            curves.filter(|curve| !curve.points.is_empty()).collect::<Vec<_>>()
        };
    let panel = |title: &str, label: &str, scale: Scale, curves: Vec<Curve>| CurvePanel {
        title: title.to_owned(),
        x: AxisSpec {
            label: "map size [% of the points that build the map]".to_owned(),
            scale: Scale::Log,
            range: None,
        },
        y: AxisSpec { label: label.to_owned(), scale, range: None },
        curves,
    };
    let likelihood = "log-likelihood [nats per point]";
    // From −0.1 nats down the axis is logarithmic: small maps are tens of nats worse than large ones.
    let scale = Scale::Symlog { linear_below: 5.0 };
    let mut panels = Vec::new();
    let same = curves(Split::Same, &|row| Some(row.log_likelihood), true);
    if !same.is_empty() {
        panels.push(panel("the points that the map is built from", likelihood, scale, same));
    }
    let held_out = curves(Split::HeldOut, &|row| row.held_out_log_likelihood, false);
    if !held_out.is_empty() {
        panels.push(panel("points of other scans", likelihood, scale, held_out));
    }
    for split in [Split::Same, Split::HeldOut] {
        let factors = curves(split, &|row| row.plain_size_factor, false);
        let is_worth_it = |curve: &Curve| curve.label != INITIAL && curve.label != "fkm";
        let factors: Vec<Curve> = factors.into_iter().filter(is_worth_it).collect();
        if !factors.is_empty() {
            let title = match split {
                Split::Same => "size of an equally likely map of plain fuzzy k-means",
                Split::HeldOut => "the same by points of other scans",
            };
            panels.push(panel(title, "times as many points", Scale::Linear, factors));
        }
    }
    let figure = CurveFigure {
        panels,
        interval: Interval::Bars,
        caption: vec![format!(
            "{}. Grid-based maps (gbs) and what each refinement makes of them, σ = {} m; means over {} maps with \
             Student's 95 % intervals. The other scans are blocks of time.",
            manifest.dataset.describe(),
            definition.sigma,
            summary.first().map_or(0, |row| row.maps),
        )],
    };
    Ok(draw_curves(&folder.join(FIGURES).join("refinement"), &figure)?.to_vec())
}
