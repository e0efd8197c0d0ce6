//! Experiments: what to run, running it, and what is kept of it.
//!
//! A definition (TOML) names data sets and map sizes; every trial becomes a row of `trials.csv` as soon
//! as it is done; summaries, tests and figures are made from saved rows only.

mod choice_summary;
mod choice_trials;
mod choices;
mod definition;
mod held_out;
mod likelihood;
mod localization;
mod localization_summary;
mod manifest;
mod refinement;
mod representation_summary;
mod representation_trials;
mod representations;
mod scheduler;
mod sensitivity;
mod sensitivity_summary;
mod sensitivity_trials;
mod store;

pub use choice_summary::{ChoiceSummaryRow, summarize_choices};
pub use choice_trials::{ChoiceData, ChoiceKey, ChoiceRow, Origin, Quantity};
pub use choices::{ChoiceTask, ChoiceTrial, ChoicesExperiment, Steps};
pub use definition::{
    Definition, Experiment, ExperimentDataset, FigureSizes, Kind, LikelihoodExperiment,
    LocalizationDataset, LocalizationExperiment, SizeGroup, Split, TrajectoryFigure,
};
pub use held_out::{BLOCK_SCANS, FOLDS, HeldOut, hold_out};
pub use likelihood::{
    Builder, LikelihoodRow, LikelihoodTrial, SummaryRow, TestRow, run_likelihood_trial, summarize,
    test_improvement, trials,
};
pub(crate) use localization::track;
pub use localization::{
    LocalizationData, LocalizationRow, LocalizationTrial, MapStrategy, TrackedRun,
    localization_trials,
};
pub use localization_summary::{
    LocalizationSummaryRow, LocalizationTestRow, summarize_localization, test_localization,
};
pub use manifest::{DatasetFacts, Manifest};
pub use refinement::{
    INITIAL, RefinementDataset, RefinementExperiment, RefinementKey, RefinementRow,
    RefinementSummaryRow, RefinementTrial, refinement_trials, summarize_refinement,
};
pub use representation_summary::{RepresentationSummaryRow, summarize_representations};
pub use representation_trials::RepresentationRow;
pub use representations::{
    PointMaps, Representation, RepresentationKey, RepresentationTrial, RepresentationsExperiment,
};
pub use scheduler::{Stopwatch, Trial, TrialOutcome, run_trials};
pub use sensitivity::{
    SensitivityDataset, SensitivityExperiment, Setting, SettingKey, Sweep, SweptMap,
};
pub use sensitivity_summary::{
    RankedSetting, SensitivityCell, StrategyComparison, compare_strategies, find_cell,
    rank_settings, summarize_sensitivity,
};
pub use sensitivity_trials::{
    SensitivityKey, SensitivityRow, SensitivityTrial, sensitivity_trials,
};
pub(crate) use store::pause_saving;
pub use store::{FailureRow, TimingRow, TrialStore, parse_rows, read_rows, write_rows};
