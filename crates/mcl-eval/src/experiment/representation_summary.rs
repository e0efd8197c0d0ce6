use anyhow::Result;
use serde::{Deserialize, Serialize};

use super::localization_summary::interval_of_runs;
use super::{Representation, RepresentationRow, Split};

/// Summary of the runs on one kind of map with one parameter. Means are pooled over runs and scans with
/// bootstrap intervals over runs; those named `kept` leave diverged runs out. A kilobyte is 1000 bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/representations.md.
pub struct RepresentationSummaryRow {
    pub dataset: String,
    pub split: Split,
    pub representation: Representation,
    pub parameter: f64,
    pub mean_elements: f64,
    pub kilobytes_raw: f64,
    pub kilobytes_run_length: Option<f64>,
    pub runs: usize,
    pub diverged: usize,
    pub runs_lost: usize,
    pub runs_recovered: usize,
    pub weighted: f64,
    pub weighted_low: Option<f64>,
    pub weighted_high: Option<f64>,
    pub translation: f64,
    pub heading: f64,
    pub kept_weighted: Option<f64>,
    pub kept_low: Option<f64>,
    pub kept_high: Option<f64>,
}

/// Summaries per split, kind of map and parameter, in that order.
///
/// # Errors
/// When a row holds a number that is none.
pub fn summarize_representations(
    rows: &[RepresentationRow],
) -> Result<Vec<RepresentationSummaryRow>> {
    let place = |row: &RepresentationRow| (row.split, row.representation);
    let mut sorted: Vec<&RepresentationRow> = rows.iter().collect();
    sorted.sort_by(|a, b| {
        let by_parameter = a.parameter.total_cmp(&b.parameter);
        place(a).cmp(&place(b)).then(by_parameter).then(a.run.cmp(&b.run))
    });
    sorted
        .chunk_by(|a, b| place(a) == place(b) && a.parameter == b.parameter)
        .map(summarize_cell)
        .collect()
}

fn summarize_cell(cell: &[&RepresentationRow]) -> Result<RepresentationSummaryRow> {
    let first = cell[0];
    let mean = |value: &dyn Fn(&RepresentationRow) -> f64| {
        cell.iter().map(|row| value(row)).sum::<f64>() / cell.len() as f64
    };
    let count = |condition: fn(&RepresentationRow) -> bool| {
        cell.iter().filter(|row| condition(row)).count()
    };
    let runs: Vec<f64> = cell.iter().map(|row| row.weighted).collect();
    let kept: Vec<f64> = cell.iter().filter(|row| !row.diverged).map(|row| row.weighted).collect();
    let (interval, of_kept) = (interval_of_runs(&runs)?, interval_of_runs(&kept)?);
    Ok(RepresentationSummaryRow {
        dataset: first.dataset.clone(),
        split: first.split,
        representation: first.representation,
        parameter: first.parameter,
        mean_elements: mean(&|row| row.elements as f64),
        kilobytes_raw: mean(&|row| row.bytes_raw as f64) / 1000.0,
        // The same for all runs: grids hang on the data alone.
        kilobytes_run_length: first.bytes_run_length.map(|bytes| bytes as f64 / 1000.0),
        runs: cell.len(),
        diverged: count(|row| row.diverged),
        runs_lost: count(|row| row.lost_episodes > 0),
        runs_recovered: count(|row| row.recovered_episodes > 0),
        weighted: mean(&|row| row.weighted),
        weighted_low: interval.map(|interval| interval.low),
        weighted_high: interval.map(|interval| interval.high),
        translation: mean(&|row| row.translation),
        heading: mean(&|row| row.heading),
        kept_weighted: (!kept.is_empty()).then(|| kept.iter().sum::<f64>() / kept.len() as f64),
        kept_low: of_kept.map(|interval| interval.low),
        kept_high: of_kept.map(|interval| interval.high),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(
        representation: Representation,
        parameter: f64,
        run: u32,
        weighted: f64,
    ) -> RepresentationRow {
        RepresentationRow {
            dataset: "office".into(),
            split: Split::Same,
            representation,
            parameter,
            map: 0,
            map_seed: None,
            run,
            elements: 500 + run as usize,
            bytes_raw: 4000 + 8 * run as usize,
            bytes_run_length: (representation == Representation::Occupancy).then_some(321),
            scans: 5,
            weighted,
            translation: weighted,
            heading: 0.0,
            translation_max: weighted,
            diverged: weighted > 1.0,
            lost_episodes: usize::from(weighted > 1.0),
            recovered_episodes: 0,
            mean_effective_sample_size: 250.0,
        }
    }

    #[test]
    fn maps_are_told_apart_and_sizes_averaged() {
        let rows = [
            row(Representation::Occupancy, 0.1, 0, 0.2),
            row(Representation::Random, 2.0, 0, 0.3),
            row(Representation::Random, 1.0, 1, 5.0),
            row(Representation::Random, 1.0, 0, 0.1),
        ];
        let summary = summarize_representations(&rows).unwrap();
        let places: Vec<_> = summary.iter().map(|s| (s.representation, s.parameter)).collect();
        let expected = [
            (Representation::Random, 1.0),
            (Representation::Random, 2.0),
            (Representation::Occupancy, 0.1),
        ];
        assert_eq!(places, expected);
        let first = &summary[0];
        assert_eq!((first.runs, first.diverged, first.runs_lost), (2, 1, 1));
        assert_eq!((first.kilobytes_raw, first.kilobytes_run_length), (4.004, None));
        assert!((first.weighted - 2.55).abs() < 1e-12);
        assert_eq!(first.kept_weighted, Some(0.1));
        assert_eq!(first.kept_low, None);
        assert_eq!(summary[2].kilobytes_run_length, Some(0.321));
    }
}
