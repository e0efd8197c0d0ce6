use serde::{Deserialize, Serialize};

use super::choice_trials::{ChoiceRow, Origin, Quantity};
use crate::auto::{Criterion, Verdict};

/// A choice beside the best of the sweep, or (`given`) the σ that the experiment has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/results.md.
pub struct ChoiceSummaryRow {
    pub dataset: String,
    pub quantity: Quantity,
    pub size_percent: Option<f64>,
    pub by: Criterion,
    pub origin: Origin,
    pub value: f64,
    pub score: Option<f64>,
    pub tried: Option<usize>,
    pub swept: Option<usize>,
    pub best_swept: Option<f64>,
    pub best_swept_score: Option<f64>,
    /// Score of the choice less that of the best of the sweep.
    pub excess: Option<f64>,
    pub map_points: Option<usize>,
    pub log_likelihood: Option<f64>,
    pub held_out_log_likelihood: Option<f64>,
    pub runs: Option<usize>,
    pub diverged: Option<usize>,
    pub weighted: Option<f64>,
    pub weighted_all: Option<f64>,
}

/// Every choice with the best of the sweep by the same criterion: the value with the smallest score, or by
/// localization the smallest size that was shown to be within reach of all points.
pub fn summarize_choices(rows: &[ChoiceRow]) -> Vec<ChoiceSummaryRow> {
    let choices = rows.iter().filter(|row| row.origin != Origin::Swept);
    choices
        .map(|row| {
            let sweep: Vec<&ChoiceRow> = rows
                .iter()
                .filter(|other| {
                    row.origin == Origin::Chosen
                        && other.origin == Origin::Swept
                        && (other.quantity, other.by) == (row.quantity, row.by)
                        && other.size_percent == row.size_percent
                })
                .collect();
            let best = best_of(row.by, &sweep);
            let best_score = best.and_then(|best| best.score);
            ChoiceSummaryRow {
                dataset: row.dataset.clone(),
                quantity: row.quantity,
                size_percent: row.size_percent,
                by: row.by,
                origin: row.origin,
                value: row.value,
                score: row.score,
                tried: row.tried,
                swept: (!sweep.is_empty()).then_some(sweep.len()),
                best_swept: best.map(|best| best.value),
                best_swept_score: best_score,
                excess: row.score.zip(best_score).map(|(score, best)| score - best),
                map_points: row.map_points,
                log_likelihood: row.log_likelihood,
                held_out_log_likelihood: row.held_out_log_likelihood,
                runs: row.runs,
                diverged: row.diverged,
                weighted: row.weighted,
                weighted_all: row.weighted_all,
            }
        })
        .collect()
}

fn best_of<'a>(by: Criterion, sweep: &[&'a ChoiceRow]) -> Option<&'a ChoiceRow> {
    let rows = sweep.iter().copied();
    if by == Criterion::Localization {
        let within = rows.filter(|row| row.verdict == Some(Verdict::Within));
        return within.min_by(|a, b| a.value.total_cmp(&b.value));
    }
    let scored = rows.filter_map(|row| Some((row, row.score?)));
    scored.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(row, _)| row)
}
