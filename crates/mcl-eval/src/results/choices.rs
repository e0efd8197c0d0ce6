use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{FIGURES, RunOptions, SUMMARY, SWEEPS, TRIALS, Trials, draw_figures, prepare};
use crate::auto::Criterion;
use crate::experiment::{
    ChoiceData, ChoiceRow, ChoiceSummaryRow, ChoiceTrial, ChoicesExperiment, DatasetFacts, Kind,
    Manifest, Origin, Quantity, TrialOutcome, TrialStore, read_rows, summarize_choices, write_rows,
};
use mcl_core::text::thousands;
use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, CurveStyle, Interval, Scale, draw_curves,
};
use mcl_study::data::source::LogSource;

/// Runs an experiment on automatic sizes and σ on one log; see [`super::run_experiment`].
pub(super) fn run(
    experiment: &ChoicesExperiment,
    name: &str,
    source: &LogSource,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialOutcome> {
    let data = ChoiceData::new(experiment, source)?;
    let facts = DatasetFacts::of(source, data.points().len());
    let manifest = Manifest::new(name, Kind::Choices, experiment, facts)?;
    let _prepared = prepare(folder, &manifest, options.fresh)?;
    let mut store: TrialStore<ChoiceRow> = TrialStore::open(&folder.join(TRIALS))?;
    let trials = Trials::divide(
        &source.name,
        folder,
        experiment.trials(data.points().len()),
        &mut store,
        ChoiceRow::key,
        ChoiceTrial::keys,
    )?;
    let outcome = trials
        .run(&mut store, options, |trial, watch| experiment.run_trial(&data, trial, watch))?;
    let rows = store.finish(ChoiceRow::key)?;
    write_rows(&folder.join(SUMMARY), &summarize_choices(&rows))?;
    let swept: Vec<&ChoiceRow> = rows.iter().filter(|row| row.origin == Origin::Swept).collect();
    write_rows(&folder.join(SWEEPS), &swept)?;
    draw_figures(folder)?;
    Ok(outcome)
}

/// Colours after those of the likelihoods that decide sizes.
const LOCALIZATION: usize = 3;
const FIRST_SIZE: usize = 4;

/// What a criterion thinks of the values of the sweep, and which it chooses: a panel for the likelihoods that
/// decide sizes, one for localization, and one for each likelihood that decides σ.
pub(super) fn draw(folder: &Path, manifest: Manifest) -> Result<Vec<PathBuf>> {
    let definition: ChoicesExperiment = manifest.definition()?;
    let choices: Vec<ChoiceSummaryRow> = read_rows(&folder.join(SUMMARY))?;
    let sweeps: Vec<ChoiceRow> = read_rows(&folder.join(SWEEPS))?;
    let drawing = Drawing { choices: &choices, sweeps: &sweeps };
    let axis = |label: &str, scale| AxisSpec { label: label.to_owned(), scale, range: None };
    // Scores are nats apart on one side of the best, hundredths on the other.
    let nats = Scale::Symlog { linear_below: 0.1 };
    let points = "points of the map";
    let above = "above the smallest [nats per point]";
    let mut panels = Vec::new();
    let by_likelihood: Vec<Curve> = definition
        .size_likelihoods()
        .iter()
        .enumerate()
        .flat_map(|(index, &by)| drawing.curve(Quantity::Size, None, by, by.name(), index))
        .collect();
    if !by_likelihood.is_empty() {
        panels.push(CurvePanel {
            title: "size by likelihood".to_owned(),
            x: axis(points, Scale::Log),
            y: axis(above, nats),
            curves: by_likelihood,
        });
    }
    let by = Criterion::Localization;
    if let Some(raced) = drawing.curve(Quantity::Size, None, by, "localization", LOCALIZATION) {
        panels.push(CurvePanel {
            title: "size by localization".to_owned(),
            x: axis(points, Scale::Log),
            y: axis("weighted error over that on all points", Scale::Log),
            curves: vec![raced],
        });
    }
    for &by in &definition.sigma_by {
        let sizes = definition.sigma_sizes.iter().enumerate();
        let of_size = |(index, &percent): (usize, &f64)| {
            let label = format!("at {percent} %");
            drawing.curve(Quantity::Sigma, Some(percent), by, &label, FIRST_SIZE + index)
        };
        let curves: Vec<Curve> = sizes.flat_map(of_size).collect();
        if !curves.is_empty() {
            panels.push(CurvePanel {
                title: format!(
                    "σ by {}",
                    match by {
                        Criterion::HeldOut => "the likelihood of other scans",
                        _ => "the likelihood of the points that the map is built from",
                    }
                ),
                x: axis("σ [m]", Scale::Log),
                y: axis(above, nats),
                curves,
            });
        }
    }
    let maps = match &definition.refine {
        Some(method) => format!("grid-based maps improved by {}", method.name()),
        None => "grid-based maps".to_owned(),
    };
    let figure = CurveFigure {
        panels,
        interval: Interval::Bars,
        caption: vec![format!(
            "{}. Lines: exhaustive sweep over {maps}; open symbols: what the search chose. Smaller is better. \
             Errors of localization are means over {} runs.",
            manifest.dataset.describe(),
            definition.runs,
        )],
    };
    Ok(draw_curves(&folder.join(FIGURES).join("choices"), &figure)?.to_vec())
}

/// The saved rows.
struct Drawing<'a> {
    choices: &'a [ChoiceSummaryRow],
    sweeps: &'a [ChoiceRow],
}

impl Drawing<'_> {
    /// The curve of a sweep, with the choice as one of its points.
    fn curve(
        &self,
        quantity: Quantity,
        size_percent: Option<f64>,
        by: Criterion,
        label: &str,
        index: usize,
    ) -> Option<Curve> {
        let swept = self
            .sweeps
            .iter()
            .filter(|row| (row.quantity, row.size_percent, row.by) == (quantity, size_percent, by))
            .filter_map(|row| Some((row.value, row.score?, None)));
        let chosen = self
            .choices
            .iter()
            .filter(|row| (row.quantity, row.size_percent, row.by) == (quantity, size_percent, by))
            .filter(|row| row.origin == Origin::Chosen)
            .filter_map(|row| Some((row.value, row.score?, Some(named(quantity, row.value)))));
        let mut points: Vec<(f64, f64, Option<String>)> = swept.chain(chosen).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let smallest = points.iter().map(|point| point.1).reduce(f64::min)?;
        // A ratio of errors is shown as it is.
        let from = if by == Criterion::Localization { 0.0 } else { smallest };
        let point = |(x, score, mark): (f64, f64, Option<String>)| CurvePoint {
            x,
            mean: score - from,
            low: f64::NAN,
            high: f64::NAN,
            mark,
        };
        let points = points.into_iter().map(point).collect();
        Some(Curve { label: label.to_owned(), style: CurveStyle::line(index), points })
    }
}

fn named(quantity: Quantity, value: f64) -> String {
    match quantity {
        Quantity::Size => thousands(value as usize),
        Quantity::Sigma => format!("{value:.3} m"),
    }
}
