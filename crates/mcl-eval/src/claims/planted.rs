//! Rows in which tests plant a truth.

use mcl_core::Seed;
use rand::RngExt;

use super::Place;
use super::claim::Untestable;
use super::saved::{LikelihoodResults, LocalizationResults};
use crate::experiment::{Builder, LikelihoodRow, LocalizationRow, MapStrategy, Split};

/// Five maps per initialization and size, with likelihoods (initial, improved) chosen by the truth
/// that a test plants: a function of initialization, size and a scatter of about ±1 that sums to 0.
pub(super) fn likelihood(
    sizes: &[f64],
    truth: impl Fn(Builder, f64, f64) -> (f64, f64),
) -> LikelihoodResults {
    let scatter = [-1.0, 0.6, 0.1, -0.5, 0.8];
    let mut rows = Vec::new();
    for builder in Builder::ALL {
        for &size_percent in sizes {
            for (repeat, &scatter) in scatter.iter().enumerate() {
                let (initial, improved) = truth(builder, size_percent, scatter);
                rows.push(LikelihoodRow {
                    dataset: "office".into(),
                    builder,
                    size_percent,
                    repeat: repeat as u32,
                    seed: 1,
                    data_points: 10_000,
                    requested_points: (100.0 * size_percent) as usize,
                    cell_m: None,
                    offset_x_m: None,
                    offset_y_m: None,
                    initial_points: (100.0 * size_percent) as usize,
                    initial_log_likelihood: initial,
                    iterations: 10,
                    converged: true,
                    fitted_log_likelihood: improved,
                    improved_points: (100.0 * size_percent) as usize,
                    improved_log_likelihood: improved,
                });
            }
        }
    }
    LikelihoodResults {
        place: Place {
            dataset: "office".into(),
            experiment: Some("likelihood".into()),
            split: None,
        },
        planned_sizes: sizes.to_vec(),
        rows: Ok(rows),
        maps: Err(Untestable("no maps".into())),
    }
}

const RUNS: u32 = 8;
const MAPS: u32 = 4;

/// Eight runs on four maps of every strategy and size, with errors chosen by the truth that a test
/// plants: a function of strategy, size, run, and a random scatter of up to 1 % about 1. Errors
/// above 1 are divergences.
pub(super) fn localization(
    sizes: &[f64],
    truth: impl Fn(MapStrategy, f64, u32, f64) -> f64,
) -> LocalizationResults {
    let mut rows = Vec::new();
    let mut rng = Seed::new(1).derive("scatter").rng();
    for strategy in MapStrategy::SAMPLED {
        for &size_percent in sizes {
            for run in 0..RUNS {
                let scatter = rng.random_range(0.99..1.01);
                let weighted = truth(strategy, size_percent, run, scatter);
                rows.push(LocalizationRow {
                    dataset: "office".into(),
                    split: Split::Same,
                    strategy,
                    size_percent,
                    map: run % MAPS,
                    map_seed: 1,
                    run,
                    data_points: 10_000,
                    map_points: 100,
                    scans: 50,
                    used_beams: 9000,
                    weighted,
                    translation: weighted,
                    heading: 0.0,
                    translation_max: weighted,
                    diverged: weighted > 1.0,
                    lost_episodes: 0,
                    recovered_episodes: 0,
                    mean_effective_sample_size: 250.0,
                    resamplings: 2,
                });
            }
        }
    }
    let place = Place {
        dataset: "office".into(),
        experiment: Some("localization".into()),
        split: Some(Split::Same),
    };
    LocalizationResults { place, planned_sizes: sizes.to_vec(), rows: Ok(rows) }
}
