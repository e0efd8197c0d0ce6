//! Recovery from localization failure: augmented Monte Carlo localization (*Probabilistic Robotics*, table 8.3).

use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::check::{check_positive, check_share};

/// Settings for injecting random particles.
///
/// The likelihood of a scan, averaged over the particles, is smoothed by two exponential averages: w_slow with a small
/// rate and w_fast with a large one. The likelihood per beam is used (the geometric mean over the used beams), which
/// depends neither on their number nor on the exponent of the likelihood. In resampling, each particle is replaced
/// with probability
/// ```text
/// max(0, 1 − ν·w_fast/w_slow)
/// ```
/// by a pose drawn where the current scan is likely. The book uses ν = 1, which injects a few particles in half of
/// all steps; a larger ν requires a larger fall (Gutmann and Fox, *An experimental comparison of
/// localization methods continued*, 2002).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recovery {
    /// α_slow: rate of the slow average per scan.
    pub slow: f64,
    /// α_fast: rate of the fast average per scan.
    pub fast: f64,
    /// ν: the factor by which w_fast may fall below w_slow before particles are injected.
    pub tolerance: f64,
    /// Number of independent beams that the scan counts as when poses are drawn from it.
    pub beams: f64,
}

impl Default for Recovery {
    fn default() -> Self {
        Recovery { slow: 0.001, fast: 0.1, tolerance: 1.2, beams: 40.0 }
    }
}

impl Recovery {
    /// Returns an error for settings out of range.
    pub(crate) fn check(&self) -> Result<(), FilterError> {
        check_share("recover.slow", self.slow)?;
        check_share("recover.fast", self.fast)?;
        check_positive("recover.tolerance", self.tolerance)?;
        check_positive("recover.beams", self.beams)
    }
}

/// w_slow and w_fast; `None` before the first scan.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Averages(Option<[f64; 2]>);

impl Averages {
    /// Updates the averages with the likelihood per beam of a scan, averaged over the particles, and returns the
    /// fraction of particles to inject.
    pub(crate) fn add(&mut self, likelihood: f64, recovery: &Recovery) -> f64 {
        let [slow, fast] = self.0.unwrap_or([likelihood; 2]);
        let slow = slow + recovery.slow * (likelihood - slow);
        let fast = fast + recovery.fast * (likelihood - fast);
        self.0 = Some([slow, fast]);
        // NaN only if the likelihood of all scans so far was 0: then there is no usual level to compare with.
        (1.0 - recovery.tolerance * fast / slow).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rates ¼ and ½, likelihoods 1, 1, 0.2, 0.2: w_slow 1, 1, 0.8, 0.65 and w_fast 1, 1, 0.6, 0.4.
    #[test]
    fn shares_by_hand() {
        let recovery = Recovery { slow: 0.25, fast: 0.5, tolerance: 1.0, beams: 8.0 };
        let shares = |recovery: &Recovery| {
            let mut averages = Averages::default();
            [1.0, 1.0, 0.2, 0.2].map(|likelihood| averages.add(likelihood, recovery))
        };
        let expected = [0.0, 0.0, 1.0 - 0.6 / 0.8, 1.0 - 0.4 / 0.65];
        for (found, expected) in shares(&recovery).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        }
        // 1.4·0.6/0.8 > 1: the first fall is within the tolerance.
        let tolerant = shares(&Recovery { tolerance: 1.4, ..recovery });
        assert_eq!(tolerant[2], 0.0);
        assert!((tolerant[3] - (1.0 - 1.4 * 0.4 / 0.65)).abs() < 1e-12);
    }

    #[test]
    fn better_scans_inject_nothing() {
        let mut averages = Averages::default();
        let recovery = Recovery { tolerance: 1.0, ..Recovery::default() };
        for likelihood in [0.0, 0.0, 0.1, 0.5, 0.5, 0.9] {
            assert_eq!(averages.add(likelihood, &recovery), 0.0);
        }
    }
}
