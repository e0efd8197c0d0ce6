//! How well a robot was tracked.

use anyhow::Result;
use mcl_metrics::{
    DivergenceSettings, LossSettings, LostEpisode, PoseError, WeightedPoseError, diverged,
    lost_episodes,
};

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Means over the scans that have an estimate of the weighted error (equation 7, ξ = 0.8), translation (m)
/// and heading (rad); when the robot was lost, and for which share of the scans; and the filter's effective
/// sample size. `found_after_scans` is the number of scans until the error first falls below the threshold
/// for a robot that has been found again.
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
    let reports = tracked.reports();
    let covered: Vec<&PoseError> = tracked.errors.iter().flatten().collect();
    let weighted = WeightedPoseError::default();
    let translations = tracked.translations();
    let scans = translations.len();
    let loss = LossSettings::default();
    let episodes = lost_episodes(&translations, &loss)?;
    let is_in = |scan: usize, episode: &LostEpisode| {
        (episode.start..episode.recovered.unwrap_or(scans)).contains(&scan)
    };
    let is_lost = |scan: &usize| {
        tracked.errors[*scan].is_none() || episodes.iter().any(|episode| is_in(*scan, episode))
    };
    let lost = (0..scans).filter(is_lost).count();
    // Without values there is no mean, as for external programs where only the built-in filter reports them.
    let mean = |values: &mut dyn Iterator<Item = f64>, of: usize| values.sum::<f64>() / of as f64;
    let of_covered = |values: &mut dyn Iterator<Item = f64>| mean(values, covered.len());
    let sample_sizes = || reports.iter().map(|report| report.effective_sample_size);
    let of_filter = |count: usize| if reports.is_empty() { Value::Empty } else { count.into() };
    let largest = covered.iter().map(|error| error.translation()).reduce(f64::max);
    Ok(vec![
        scans.into(),
        of_filter(reports.iter().map(|report| report.used_beams).sum()),
        of_covered(&mut covered.iter().map(|error| weighted.of(error))).into(),
        of_covered(&mut covered.iter().map(|error| error.translation())).into(),
        of_covered(&mut covered.iter().map(|error| error.heading())).into(),
        largest.into(),
        has_diverged(&tracked.errors)?.into(),
        episodes.len().into(),
        episodes.iter().filter(|episode| episode.recovered.is_some()).count().into(),
        (lost as f64 / scans as f64).into(),
        translations.iter().position(|&error| error < loss.recovered_below_m).into(),
        mean(&mut sample_sizes(), reports.len()).into(),
        sample_sizes().fold(f64::INFINITY, f64::min).into(),
        of_filter(reports.iter().filter(|report| report.resampled).count()),
    ])
}

/// Whether a run ended lost. A run without estimates at half of the scans that decide did, whatever the other
/// scans say.
fn has_diverged(errors: &[Option<PoseError>]) -> Result<bool> {
    let settings = DivergenceSettings::default();
    let last = &errors[errors.len().saturating_sub(settings.last_scans)..];
    let covered: Vec<f64> = last.iter().flatten().map(PoseError::translation).collect();
    if 2 * covered.len() <= last.len() {
        return Ok(true);
    }
    Ok(diverged(&covered, &settings)?)
}
