use anyhow::Result;
use mcl_core::Seed;
use mcl_metrics::{Interval, bootstrap_mean, paired_t_test};
use serde::{Deserialize, Serialize};

use super::{LocalizationRow, MapStrategy, Split};

/// Resamples behind a 95 % interval.
const RESAMPLES: usize = 2000;

/// Summary of the runs of one split, strategy and size. Means are pooled over runs and scans with
/// bootstrap intervals over runs; those named `kept` leave diverged runs out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/results.md.
pub struct LocalizationSummaryRow {
    pub dataset: String,
    pub split: Split,
    pub strategy: MapStrategy,
    pub size_percent: f64,
    pub mean_map_points: f64,
    pub mean_real_percent: f64,
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
    pub kept_translation: Option<f64>,
    pub kept_heading: Option<f64>,
}

/// A paired test of the weighted errors of two strategies of one split and size: run by run, on the
/// same noise. `mean_difference` is `a` minus `b`; p is two-sided. `kept` pairs are those in which
/// neither run diverged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the columns of tests.csv, described in docs/results.md.
pub struct LocalizationTestRow {
    pub dataset: String,
    pub split: Split,
    pub size_percent: f64,
    pub a: MapStrategy,
    pub b: MapStrategy,
    pub pairs: usize,
    pub mean_difference: f64,
    pub t: f64,
    pub df: f64,
    pub p: f64,
    pub kept_pairs: usize,
    pub kept_mean_difference: Option<f64>,
    pub kept_t: Option<f64>,
    pub kept_p: Option<f64>,
}

/// Pairs of strategies that are compared: improved against initial, grid-based against random.
pub(super) const COMPARED: [(MapStrategy, MapStrategy); 6] = [
    (MapStrategy::GridImproved, MapStrategy::Grid),
    (MapStrategy::RandomImproved, MapStrategy::Random),
    (MapStrategy::Grid, MapStrategy::Random),
    (MapStrategy::GridImproved, MapStrategy::RandomImproved),
    (MapStrategy::GridBest, MapStrategy::GridImproved),
    (MapStrategy::GridBest, MapStrategy::Grid),
];

/// Summaries per split, strategy and size, in that order.
///
/// # Errors
/// When a row holds a number that is none.
pub fn summarize_localization(rows: &[LocalizationRow]) -> Result<Vec<LocalizationSummaryRow>> {
    cells(rows).into_iter().map(|cell| summarize_cell(&cell)).collect()
}

fn summarize_cell(cell: &[&LocalizationRow]) -> Result<LocalizationSummaryRow> {
    let first = cell[0];
    let kept: Vec<&LocalizationRow> = cell.iter().copied().filter(|row| !row.diverged).collect();
    let all = Some(pooled(cell)?);
    let of_kept = if kept.is_empty() { None } else { Some(pooled(&kept)?) };
    let low = |pooled: &Option<Pooled>| pooled.and_then(|p| p.interval).map(|i| i.low);
    let high = |pooled: &Option<Pooled>| pooled.and_then(|p| p.interval).map(|i| i.high);
    let count =
        |condition: fn(&LocalizationRow) -> bool| cell.iter().filter(|row| condition(row)).count();
    let mean_map_points = mean(cell, |row| row.map_points as f64);
    Ok(LocalizationSummaryRow {
        dataset: first.dataset.clone(),
        split: first.split,
        strategy: first.strategy,
        size_percent: first.size_percent,
        mean_map_points,
        mean_real_percent: 100.0 * mean_map_points / first.data_points as f64,
        runs: cell.len(),
        diverged: count(|row| row.diverged),
        runs_lost: count(|row| row.lost_episodes > 0),
        runs_recovered: count(|row| row.recovered_episodes > 0),
        weighted: mean(cell, |row| row.weighted),
        weighted_low: low(&all),
        weighted_high: high(&all),
        translation: mean(cell, |row| row.translation),
        heading: mean(cell, |row| row.heading),
        kept_weighted: of_kept.map(|pooled| pooled.weighted),
        kept_low: low(&of_kept),
        kept_high: high(&of_kept),
        kept_translation: of_kept.map(|_| mean(&kept, |row| row.translation)),
        kept_heading: of_kept.map(|_| mean(&kept, |row| row.heading)),
    })
}

#[derive(Clone, Copy)]
struct Pooled {
    weighted: f64,
    interval: Option<Interval>,
}

/// All runs of a cell have the same number of scans, so the mean over runs is that over all scans.
fn pooled(cell: &[&LocalizationRow]) -> Result<Pooled> {
    let runs: Vec<f64> = cell.iter().map(|row| row.weighted).collect();
    let interval = interval_of_runs(&runs)?;
    Ok(Pooled { weighted: mean(cell, |row| row.weighted), interval })
}

/// 95 % bootstrap interval of the mean over runs; none for a single run.
pub(super) fn interval_of_runs(runs: &[f64]) -> Result<Option<Interval>> {
    if runs.len() < 2 {
        return Ok(None);
    }
    let runs: Vec<[f64; 1]> = runs.iter().map(|&run| [run]).collect();
    Ok(Some(bootstrap_mean(&runs, RESAMPLES, Seed::new(0).derive("bootstrap"))?.interval))
}

fn mean(cell: &[&LocalizationRow], value: impl Fn(&LocalizationRow) -> f64) -> f64 {
    cell.iter().map(|row| value(row)).sum::<f64>() / cell.len() as f64
}

/// Paired tests per split and size of the strategies that are compared. Cells with fewer than two
/// common runs have no test.
///
/// # Errors
/// When a row holds a number that is none.
pub fn test_localization(rows: &[LocalizationRow]) -> Result<Vec<LocalizationTestRow>> {
    let cells = cells(rows);
    let mut tests = Vec::new();
    for (a, b) in COMPARED {
        for cell_a in cells.iter().filter(|cell| cell[0].strategy == a) {
            let first = cell_a[0];
            let same_place = |cell: &&Vec<&LocalizationRow>| {
                cell[0].strategy == b
                    && cell[0].split == first.split
                    && cell[0].size_percent == first.size_percent
            };
            let Some(cell_b) = cells.iter().find(same_place) else { continue };
            tests.extend(test_pair(cell_a, cell_b)?);
        }
    }
    Ok(tests)
}

fn test_pair(
    cell_a: &[&LocalizationRow],
    cell_b: &[&LocalizationRow],
) -> Result<Option<LocalizationTestRow>> {
    let pairs: Vec<(&LocalizationRow, &LocalizationRow)> = cell_a
        .iter()
        .filter_map(|a| Some((*a, *cell_b.iter().find(|b| b.run == a.run)?)))
        .collect();
    let test = |pairs: &[(&LocalizationRow, &LocalizationRow)]| {
        let (a, b): (Vec<f64>, Vec<f64>) =
            pairs.iter().map(|(a, b)| (a.weighted, b.weighted)).unzip();
        (pairs.len() >= 2).then(|| paired_t_test(&a, &b)).transpose()
    };
    let Some(all) = test(&pairs)? else { return Ok(None) };
    let kept: Vec<_> = pairs.iter().copied().filter(|(a, b)| !a.diverged && !b.diverged).collect();
    let of_kept = test(&kept)?;
    let (first_a, first_b) = (cell_a[0], cell_b[0]);
    Ok(Some(LocalizationTestRow {
        dataset: first_a.dataset.clone(),
        split: first_a.split,
        size_percent: first_a.size_percent,
        a: first_a.strategy,
        b: first_b.strategy,
        pairs: pairs.len(),
        mean_difference: all.mean_difference,
        t: all.t,
        df: all.degrees_of_freedom,
        p: all.p_two_sided,
        kept_pairs: kept.len(),
        kept_mean_difference: of_kept.map(|test| test.mean_difference),
        kept_t: of_kept.map(|test| test.t),
        kept_p: of_kept.map(|test| test.p_two_sided),
    }))
}

/// The rows of each split, strategy and size; sizes ascending, runs ascending.
fn cells(rows: &[LocalizationRow]) -> Vec<Vec<&LocalizationRow>> {
    let mut sorted: Vec<&LocalizationRow> = rows.iter().collect();
    sorted.sort_by(|a, b| {
        (a.split, a.strategy)
            .cmp(&(b.split, b.strategy))
            .then(a.size_percent.total_cmp(&b.size_percent))
            .then(a.run.cmp(&b.run))
    });
    sorted
        .chunk_by(|a, b| {
            (a.split, a.strategy, a.size_percent) == (b.split, b.strategy, b.size_percent)
        })
        .map(<[_]>::to_vec)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(strategy: MapStrategy, run: u32, weighted: f64, diverged: bool) -> LocalizationRow {
        LocalizationRow {
            dataset: "office".into(),
            split: Split::Same,
            strategy,
            size_percent: 1.0,
            map: 0,
            map_seed: 1,
            run,
            data_points: 1000,
            map_points: 10,
            scans: 5,
            used_beams: 900,
            weighted,
            translation: weighted,
            heading: 0.0,
            translation_max: weighted,
            diverged,
            lost_episodes: usize::from(diverged),
            recovered_episodes: 0,
            mean_effective_sample_size: 250.0,
            resamplings: 2,
        }
    }

    #[test]
    fn diverged_runs_are_counted_and_can_be_left_out() {
        let rows = [
            row(MapStrategy::Grid, 0, 0.1, false),
            row(MapStrategy::Grid, 1, 0.3, false),
            row(MapStrategy::Grid, 2, 5.0, true),
        ];
        let summary = summarize_localization(&rows).unwrap();
        assert_eq!(summary.len(), 1);
        assert_eq!((summary[0].runs, summary[0].diverged), (3, 1));
        assert!((summary[0].weighted - 1.8).abs() < 1e-12);
        assert!((summary[0].kept_weighted.unwrap() - 0.2).abs() < 1e-12);
        assert_eq!(summary[0].mean_real_percent, 1.0);
    }

    #[test]
    fn runs_are_paired_by_number_and_pairs_with_a_lost_run_can_be_left_out() {
        let rows = [
            row(MapStrategy::GridImproved, 2, 0.3, false),
            row(MapStrategy::GridImproved, 0, 0.1, false),
            row(MapStrategy::GridImproved, 1, 0.2, false),
            row(MapStrategy::Grid, 0, 0.2, false),
            row(MapStrategy::Grid, 1, 0.4, false),
            row(MapStrategy::Grid, 2, 9.3, true),
            row(MapStrategy::Grid, 7, 100.0, true),
        ];
        let tests = test_localization(&rows).unwrap();
        assert_eq!(tests.len(), 1);
        let test = &tests[0];
        assert_eq!((test.a, test.b), (MapStrategy::GridImproved, MapStrategy::Grid));
        assert_eq!((test.pairs, test.kept_pairs), (3, 2));
        // Differences −0.1, −0.2, −9.
        assert!((test.mean_difference + 3.1).abs() < 1e-12);
        assert!((test.kept_mean_difference.unwrap() + 0.15).abs() < 1e-12);
    }
}
