use std::collections::BTreeMap;

use anyhow::Result;
use mcl_metrics::paired_t_test;
use serde::Serialize;

use super::localization_summary::{COMPARED, interval_of_runs};
use super::{MapStrategy, SensitivityExperiment, SensitivityRow, Setting, Sweep, SweptMap};

/// The runs of one setting, strategy and size. `weighted` is the mean of equation 7 over runs and scans
/// with a 95 % bootstrap interval over runs, diverged runs included.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // The names are the columns of summary.csv, described in docs/results.md.
pub struct SensitivityCell {
    pub strategy: MapStrategy,
    pub size_percent: f64,
    pub mean_map_points: f64,
    pub runs: usize,
    pub diverged: usize,
    pub weighted: f64,
    pub weighted_low: Option<f64>,
    pub weighted_high: Option<f64>,
    pub translation: f64,
    pub heading: f64,
    pub mean_effective_sample_size: f64,
}

/// Two strategies under one setting and size, run by run on the same noise. `ratio` is the geometric
/// mean over runs of the error on `a` by that on `b`, so that a lost run counts as one and does not
/// decide alone; `t` and the two-sided `p` are of the logarithms.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // The names are the columns of tests.csv, described in docs/results.md.
pub struct StrategyComparison {
    pub size_percent: f64,
    pub a: MapStrategy,
    pub b: MapStrategy,
    pub pairs: usize,
    pub diverged_a: usize,
    pub diverged_b: usize,
    pub ratio: f64,
    pub t: f64,
    pub p: f64,
}

/// The rows of each setting, strategy and size; settings by their values, runs ascending.
fn cells(rows: &[SensitivityRow]) -> Vec<(Setting, Vec<&SensitivityRow>)> {
    let mut cells: BTreeMap<_, Vec<&SensitivityRow>> = BTreeMap::new();
    for row in rows {
        let (setting, strategy, size, _) = row.key();
        cells.entry((setting, strategy, size)).or_default().push(row);
    }
    let mut cells: Vec<_> = cells.into_values().map(|cell| (cell[0].setting(), cell)).collect();
    for (_, cell) in &mut cells {
        cell.sort_by_key(|row| row.run);
    }
    cells
}

/// Summaries per setting, strategy and size.
///
/// # Errors
/// When a row holds a number that is none.
pub fn summarize_sensitivity(rows: &[SensitivityRow]) -> Result<Vec<(Setting, SensitivityCell)>> {
    let summarize = |(setting, cell): (Setting, Vec<&SensitivityRow>)| {
        let mean = |value: &dyn Fn(&SensitivityRow) -> f64| {
            cell.iter().map(|row| value(row)).sum::<f64>() / cell.len() as f64
        };
        let runs: Vec<f64> = cell.iter().map(|row| row.weighted).collect();
        let interval = interval_of_runs(&runs)?;
        let cell = SensitivityCell {
            strategy: cell[0].strategy,
            size_percent: cell[0].size_percent,
            mean_map_points: mean(&|row| row.map_points as f64),
            runs: cell.len(),
            diverged: cell.iter().filter(|row| row.diverged).count(),
            weighted: mean(&|row| row.weighted),
            weighted_low: interval.map(|interval| interval.low),
            weighted_high: interval.map(|interval| interval.high),
            translation: mean(&|row| row.translation),
            heading: mean(&|row| row.heading),
            mean_effective_sample_size: mean(&|row| row.mean_effective_sample_size),
        };
        Ok((setting, cell))
    };
    cells(rows).into_iter().map(summarize).collect()
}

/// Improved against initial maps and grid-based against random ones, per setting and size. Cells with
/// fewer than two common runs, or an error of zero, have no test.
///
/// # Errors
/// When a row holds a number that is none.
pub fn compare_strategies(rows: &[SensitivityRow]) -> Result<Vec<(Setting, StrategyComparison)>> {
    let cells = cells(rows);
    let mut comparisons = Vec::new();
    for (setting, cell_a) in &cells {
        for (a, b) in COMPARED.into_iter().filter(|(a, _)| *a == cell_a[0].strategy) {
            let size_percent = cell_a[0].size_percent;
            let same_place = |(other, cell): &&(Setting, Vec<&SensitivityRow>)| {
                other == setting && cell[0].strategy == b && cell[0].size_percent == size_percent
            };
            let Some((_, cell_b)) = cells.iter().find(same_place) else { continue };
            let pairs: Vec<(&SensitivityRow, &SensitivityRow)> = cell_a
                .iter()
                .filter_map(|a| Some((*a, *cell_b.iter().find(|b| b.run == a.run)?)))
                .filter(|(a, b)| a.weighted > 0.0 && b.weighted > 0.0)
                .collect();
            if pairs.len() < 2 {
                continue;
            }
            let (of_a, of_b): (Vec<f64>, Vec<f64>) =
                pairs.iter().map(|(a, b)| (a.weighted.ln(), b.weighted.ln())).unzip();
            let test = paired_t_test(&of_a, &of_b)?;
            let comparison = StrategyComparison {
                size_percent,
                a,
                b,
                pairs: pairs.len(),
                diverged_a: pairs.iter().filter(|(a, _)| a.diverged).count(),
                diverged_b: pairs.iter().filter(|(_, b)| b.diverged).count(),
                ratio: test.mean_difference.exp(),
                t: test.t,
                p: test.p_two_sided,
            };
            comparisons.push((*setting, comparison));
        }
    }
    Ok(comparisons)
}

/// The summary of the runs of a setting on a map, if there are any.
pub fn find_cell<'a>(
    cells: &'a [(Setting, SensitivityCell)],
    setting: &Setting,
    map: &SweptMap,
) -> Option<&'a SensitivityCell> {
    let found = cells.iter().find(|(other, cell)| {
        other == setting && cell.strategy == map.strategy && cell.size_percent == map.percent
    });
    found.map(|(_, cell)| cell)
}

/// How well a setting tracks over several data sets.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedSetting {
    /// The setting.
    pub setting: Setting,
    /// Geometric mean over data sets of `errors`, which lets every log count the same, whatever its
    /// scale.
    pub score: f64,
    /// Per data set, in the order given: the geometric mean over the sweep's maps of the weighted
    /// error, a mean over runs.
    pub errors: Vec<f64>,
    /// Diverged runs over all data sets and maps.
    pub diverged: usize,
    /// Runs over all data sets and maps.
    pub runs: usize,
}

/// The settings of a sweep by their error over several data sets, the best first. Settings that lack a
/// map on one of them are left out.
pub fn rank_settings(
    experiment: &SensitivityExperiment,
    sweep: &Sweep,
    datasets: &[Vec<(Setting, SensitivityCell)>],
) -> Vec<RankedSetting> {
    let geometric_mean =
        |values: &[f64]| (values.iter().map(|v| v.ln()).sum::<f64>() / values.len() as f64).exp();
    let rank = |setting: Setting| {
        let (mut errors, mut diverged, mut runs) = (Vec::new(), 0, 0);
        for cells in datasets {
            let mut of_maps = Vec::new();
            for map in &sweep.maps {
                let cell = find_cell(cells, &setting, map)?;
                of_maps.push(cell.weighted);
                diverged += cell.diverged;
                runs += cell.runs;
            }
            errors.push(geometric_mean(&of_maps));
        }
        Some(RankedSetting { setting, score: geometric_mean(&errors), errors, diverged, runs })
    };
    let mut ranked: Vec<RankedSetting> =
        sweep.settings(experiment).into_iter().filter_map(rank).collect();
    ranked.sort_by(|a, b| a.score.total_cmp(&b.score));
    ranked
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::Experiment;

    const STUDY: &str = r#"
        kind = "sensitivity"
        seed = 1
        runs = 2
        odometry_noise = { xy = 0.0, theta = 0.0 }
        sigma = 0.05
        tolerance = 1e-4
        max_iterations = 100
        [[sweep]]
        name = "sensor"
        maps = [{ strategy = "gbs", percent = 1 }, { strategy = "gbs+f-km", percent = 1 }]
        sigma_hit = [0.1, 0.2]
    "#;

    fn study() -> SensitivityExperiment {
        match Experiment::parse(STUDY).unwrap() {
            Experiment::Sensitivity(study) => study,
            _ => panic!("of another kind"),
        }
    }

    fn row(setting: &Setting, strategy: MapStrategy, run: u32, weighted: f64) -> SensitivityRow {
        let [alpha1, alpha2, alpha3, alpha4] = setting.alpha();
        SensitivityRow {
            dataset: "office".into(),
            sigma_hit: setting.sigma_hit,
            z_rand: setting.z_rand,
            alpha1,
            alpha2,
            alpha3,
            alpha4,
            likelihood_exponent: setting.likelihood_exponent,
            proposal: setting.proposal,
            noise_xy: setting.noise_xy,
            noise_theta: setting.noise_theta,
            strategy,
            size_percent: 1.0,
            run,
            map_seed: 1,
            map_points: 10,
            scans: 5,
            weighted,
            translation: weighted,
            heading: 0.0,
            diverged: weighted > 1.0,
            mean_effective_sample_size: 100.0,
        }
    }

    /// Errors by setting (0.1 m, 0.2 m), strategy and run.
    fn rows(errors: [[[f64; 2]; 2]; 2]) -> Vec<SensitivityRow> {
        let study = study();
        let mut rows = Vec::new();
        for (setting, of_setting) in study.sweeps[0].settings(&study).iter().zip(errors) {
            for (map, of_map) in study.sweeps[0].maps.iter().zip(of_setting) {
                for (run, error) in (0..).zip(of_map) {
                    rows.push(row(setting, map.strategy, run, error));
                }
            }
        }
        rows
    }

    #[test]
    fn settings_are_ranked_by_geometric_means() {
        let study = study();
        // Means 0.02 and 0.08, so 0.04; 0.04 and 0.36, so 0.12. On the other log the second is better.
        let one = rows([[[0.01, 0.03], [0.08, 0.08]], [[0.04, 0.04], [0.36, 0.36]]]);
        let two = rows([[[0.04, 0.04], [0.04, 0.04]], [[0.01, 0.01], [1.0, 3.0]]]);
        let cells = [&one, &two].map(|rows| summarize_sensitivity(rows).unwrap());
        let ranked = rank_settings(&study, &study.sweeps[0], &cells);
        assert_eq!(ranked.len(), 2);
        assert_eq!(ranked[0].setting.sigma_hit, 0.1);
        assert!((ranked[0].score - 0.04).abs() < 1e-12);
        assert!((ranked[1].errors[0] - 0.12).abs() < 1e-12);
        assert!((ranked[1].errors[1] - 0.02f64.sqrt()).abs() < 1e-12);
        assert_eq!((ranked[1].diverged, ranked[1].runs), (1, 8));
        // A setting that was not run on every map has no rank.
        let ranked = rank_settings(&study, &study.sweeps[0], &[cells[0][..3].to_vec()]);
        assert_eq!(ranked.len(), 1);
    }

    #[test]
    fn strategies_are_compared_run_by_run() {
        let rows = rows([[[0.1, 0.4], [0.05, 0.1]], [[0.1, 0.1], [0.2, 2.0]]]);
        let compared = compare_strategies(&rows).unwrap();
        assert_eq!(compared.len(), 2);
        // Improved by initial: ½ and ¼.
        let (setting, first) = &compared[0];
        assert_eq!((setting.sigma_hit, first.a), (0.1, MapStrategy::GridImproved));
        assert!((first.ratio - 0.125f64.sqrt()).abs() < 1e-12);
        assert_eq!((compared[1].1.diverged_a, compared[1].1.diverged_b), (1, 0));
    }
}
