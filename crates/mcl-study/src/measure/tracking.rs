//! How well a robot was tracked.

use anyhow::Result;
use mcl_metrics::{
    DivergenceSettings, LossSettings, LostEpisode, PoseError, WeightedPoseError, diverged,
    lost_episodes,
};

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Means over the run's scans of the weighted error (equation 7, ξ = 0.8), translation (m) and heading
/// (rad); when the robot was lost, and for which share of the scans; and the filter's effective sample
/// size. `found_after_scans` is the number of scans before the error first was below that of a robot
/// that has been found again.
pub const TRACKING: RunMeasure = RunMeasure {
    name: "tracking",
    columns: &[
        "scans",
        "used_beams",
        "weighted",
        "translation",
        "heading",
        "translation_max",
        "diverged",
        "lost_episodes",
        "recovered_episodes",
        "lost_share",
        "found_after_scans",
        "mean_effective_sample_size",
        "smallest_effective_sample_size",
        "resamplings",
    ],
    measure,
};

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let RunContext { tracked, .. } = context;
    let (errors, reports) = (&tracked.errors, &tracked.run.reports);
    let weighted = WeightedPoseError::default();
    let translations: Vec<f64> = errors.iter().map(PoseError::translation).collect();
    let loss = LossSettings::default();
    let episodes = lost_episodes(&translations, &loss)?;
    let scans = errors.len();
    let lost_scans = |episode: &LostEpisode| episode.recovered.unwrap_or(scans) - episode.start;
    let lost: usize = episodes.iter().map(lost_scans).sum();
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / scans as f64;
    let sample_sizes = || reports.iter().map(|report| report.effective_sample_size);
    Ok(vec![
        scans.into(),
        reports.iter().map(|report| report.used_beams).sum::<usize>().into(),
        mean(&mut errors.iter().map(|error| weighted.of(error))).into(),
        mean(&mut translations.iter().copied()).into(),
        mean(&mut errors.iter().map(PoseError::heading)).into(),
        translations.iter().copied().fold(0.0, f64::max).into(),
        diverged(&translations, &DivergenceSettings::default())?.into(),
        episodes.len().into(),
        episodes.iter().filter(|episode| episode.recovered.is_some()).count().into(),
        (lost as f64 / scans as f64).into(),
        translations.iter().position(|&error| error < loss.recovered_below_m).into(),
        mean(&mut sample_sizes()).into(),
        sample_sizes().fold(f64::INFINITY, f64::min).into(),
        reports.iter().filter(|report| report.resampled).count().into(),
    ])
}
