//! Recovery from a wrong pose: augmented Monte Carlo localization (*Probabilistic Robotics*, table 8.3).

use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::check::{check_positive, check_share};

/// When and where particles are injected that do not come from others.
///
/// The likelihood of a scan, averaged over the particles, has two running averages: w_slow with a small rate and
/// w_fast with a large one. Here it is that of a beam, the geometric mean over the used ones, so that it depends
/// on neither their number nor the likelihood's exponent. When particles are resampled, each is replaced with
/// probability
/// ```text
/// max(0, 1 − ν·w_fast/w_slow)
/// ```
/// by a pose drawn from where the current scan is likely. The book has ν = 1, so that half of all steps
/// inject a few particles; a larger ν waits for a larger fall (Gutmann and Fox, *An experimental comparison of
/// localization methods continued*, 2002).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recovery {
    /// α_slow: rate of the slow average per scan.
    pub slow: f64,
    /// α_fast: rate of the fast average per scan.
    pub fast: f64,
    /// ν: how many times w_fast may fall below w_slow without consequence.
    pub tolerance: f64,
    /// The scan counts as so many independent beams when poses are drawn by it.
    pub beams: f64,
}

impl Default for Recovery {
    fn default() -> Self {
        Recovery { slow: 0.001, fast: 0.1, tolerance: 1.2, beams: 40.0 }
    }
}

impl Recovery {
    /// Refuses rates that are none.
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
    /// Takes in the likelihood of a scan's beam, averaged over the particles, and returns the share of particles to
    /// be injected.
    pub(crate) fn add(&mut self, likelihood: f64, recovery: &Recovery) -> f64 {
        let [slow, fast] = self.0.unwrap_or([likelihood; 2]);
        let slow = slow + recovery.slow * (likelihood - slow);
        let fast = fast + recovery.fast * (likelihood - fast);
        self.0 = Some([slow, fast]);
        // NaN only if all scans so far were impossible: then nothing is known of what is usual.
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
