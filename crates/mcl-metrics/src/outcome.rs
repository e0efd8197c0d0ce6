use serde::{Deserialize, Serialize};

use crate::error::{MetricsError, check_samples};

/// Criterion for a diverged run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DivergenceSettings {
    /// Number of scans at the end of a run that are evaluated; all scans of a shorter run.
    pub last_scans: usize,
    /// A run with a mean translation error above this many metres has diverged.
    pub limit_m: f64,
}

/// The last 50 scans, 1 m.
impl Default for DivergenceSettings {
    fn default() -> Self {
        DivergenceSettings { last_scans: 50, limit_m: 1.0 }
    }
}

/// Whether a run has diverged: its mean translation error over the last scans is above the limit.
/// `translation_errors` holds one error per scan, in metres.
///
/// # Errors
/// If there is no sample, one is not finite, or a setting is not a positive number.
pub fn diverged(
    translation_errors: &[f64],
    settings: &DivergenceSettings,
) -> Result<bool, MetricsError> {
    check_samples(translation_errors, 1)?;
    check_positive("last_scans", settings.last_scans as f64)?;
    check_positive("limit_m", settings.limit_m)?;
    let first = translation_errors.len().saturating_sub(settings.last_scans);
    let last = &translation_errors[first..];
    Ok(last.iter().sum::<f64>() / last.len() as f64 > settings.limit_m)
}

/// Criteria for when the robot is lost within a run, and when it has recovered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossSettings {
    /// The robot is lost when its translation error stays above this many metres …
    pub lost_above_m: f64,
    /// … for at least this many scans in a row.
    pub min_scans: usize,
    /// A lost robot has recovered at the first scan with an error below this many metres.
    pub recovered_below_m: f64,
}

/// Lost above 1 m for 10 scans, recovered below 0.5 m.
impl Default for LossSettings {
    fn default() -> Self {
        LossSettings { lost_above_m: 1.0, min_scans: 10, recovered_below_m: 0.5 }
    }
}

/// An interval of a run in which the robot was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LostEpisode {
    /// Index of the first scan above `lost_above_m`, from 0.
    pub start: usize,
    /// Index of the scan at which the robot recovered; `None` if the run ended first.
    pub recovered: Option<usize>,
}

/// Finds the intervals in which the robot was lost, in order. `translation_errors` holds one error per scan,
/// in metres. Between `recovered_below_m` and `lost_above_m` the state does not change, so an error that fluctuates
/// around one limit gives one episode, not many.
///
/// # Errors
/// If there is no sample, one is not finite, a setting is not a positive number, or the recovery
/// limit is above the loss limit.
///
/// # Example
/// ```
/// use mcl_metrics::{LossSettings, LostEpisode, lost_episodes};
///
/// let settings = LossSettings { min_scans: 2, ..LossSettings::default() };
/// let errors = [0.1, 1.5, 0.2, 1.2, 1.4, 0.7, 1.1, 0.4, 0.1];
/// let episodes = lost_episodes(&errors, &settings)?;
/// assert_eq!(episodes, [LostEpisode { start: 3, recovered: Some(7) }]);
/// # Ok::<(), mcl_metrics::MetricsError>(())
/// ```
pub fn lost_episodes(
    translation_errors: &[f64],
    settings: &LossSettings,
) -> Result<Vec<LostEpisode>, MetricsError> {
    check_samples(translation_errors, 1)?;
    check_positive("lost_above_m", settings.lost_above_m)?;
    check_positive("min_scans", settings.min_scans as f64)?;
    check_positive("recovered_below_m", settings.recovered_below_m)?;
    if settings.recovered_below_m > settings.lost_above_m {
        return Err(MetricsError::Setting {
            name: "recovered_below_m",
            found: settings.recovered_below_m,
            expected: "at most lost_above_m",
        });
    }
    let mut episodes = Vec::new();
    let mut is_lost = false;
    let mut above = 0;
    for (scan, &error) in translation_errors.iter().enumerate() {
        if is_lost {
            if error < settings.recovered_below_m {
                if let Some(LostEpisode { recovered, .. }) = episodes.last_mut() {
                    *recovered = Some(scan);
                }
                is_lost = false;
                above = 0;
            }
            continue;
        }
        above = if error > settings.lost_above_m { above + 1 } else { 0 };
        if above == settings.min_scans {
            episodes.push(LostEpisode { start: scan + 1 - above, recovered: None });
            is_lost = true;
        }
    }
    Ok(episodes)
}

/// The first scan from which on the robot is localized: its error is below `recovered_below_m`, and no later error is
/// above `lost_above_m`, however briefly. `None` if there is no such scan. `translation_errors` holds one
/// error per scan, in metres.
///
/// # Example
/// ```
/// use mcl_metrics::{LossSettings, found_for_good};
///
/// let settings = LossSettings::default();
/// assert_eq!(found_for_good(&[7.0, 0.1, 3.0, 0.7, 0.4, 0.6], &settings), Some(4));
/// assert_eq!(found_for_good(&[0.1, 0.7, 3.0], &settings), None);
/// ```
pub fn found_for_good(translation_errors: &[f64], settings: &LossSettings) -> Option<usize> {
    let is_within = |error: &f64| *error <= settings.lost_above_m;
    let lost = translation_errors.iter().rposition(|error| !is_within(error));
    let from = lost.map_or(0, |last| last + 1);
    let is_found = |error: &f64| *error < settings.recovered_below_m;
    translation_errors[from..].iter().position(is_found).map(|place| from + place)
}

fn check_positive(name: &'static str, found: f64) -> Result<(), MetricsError> {
    if found.is_finite() && found > 0.0 {
        return Ok(());
    }
    Err(MetricsError::Setting { name, found, expected: "a positive number" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_end_of_a_run_decides_divergence() {
        let settings = DivergenceSettings::default();
        let run = |lost: usize, fine: usize| [vec![5.0; lost], vec![0.1; fine]].concat();
        assert!(!diverged(&run(900, 50), &settings).unwrap());
        // 9 of the last 50 at 5 m: mean 0.98 m; 10 of them: 1.08 m.
        assert!(!diverged(&run(900, 41), &settings).unwrap());
        assert!(diverged(&run(900, 40), &settings).unwrap());
        assert!(diverged(&[1.5], &settings).unwrap());
        assert!(!diverged(&[1.0; 60], &settings).unwrap());
    }

    #[test]
    fn episodes_need_to_last_and_end_with_hysteresis() {
        let episodes = |parts: &[(f64, usize)]| {
            let errors: Vec<f64> =
                parts.iter().flat_map(|&(error, scans)| vec![error; scans]).collect();
            lost_episodes(&errors, &LossSettings::default()).unwrap()
        };
        assert_eq!(episodes(&[(0.1, 5), (2.0, 9), (0.1, 5), (2.0, 9)]), []);
        assert_eq!(
            episodes(&[(0.1, 5), (2.0, 10), (0.7, 30), (1.5, 20), (0.4, 3), (3.0, 12)]),
            [
                LostEpisode { start: 5, recovered: Some(65) },
                LostEpisode { start: 68, recovered: None }
            ]
        );
    }

    #[test]
    fn settings_are_checked() {
        let no_scans = DivergenceSettings { last_scans: 0, ..Default::default() };
        let error = diverged(&[0.1], &no_scans).unwrap_err().to_string();
        assert_eq!(error, "last_scans is 0, expected a positive number");
        let crossed = LossSettings { recovered_below_m: 2.0, ..Default::default() };
        let error = lost_episodes(&[0.1], &crossed).unwrap_err().to_string();
        assert_eq!(error, "recovered_below_m is 2, expected at most lost_above_m");
        assert!(diverged(&[], &DivergenceSettings::default()).is_err());
        assert!(lost_episodes(&[f64::NAN], &LossSettings::default()).is_err());
    }
}
