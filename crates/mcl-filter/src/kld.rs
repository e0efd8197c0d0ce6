//! KLD sampling: the number of particles adapts to the spread of the posterior (Fox, *Adapting the sample size in
//! particle filters through KLD-sampling*, 2003; *Probabilistic Robotics*, table 8.4).

use std::collections::HashSet;

use mcl_core::{Pose2, math};
use serde::{Deserialize, Serialize};

use crate::FilterError;
use crate::check::{check_length, check_positive};

/// Bins and error bound of KLD sampling, used if [`particles`](crate::FilterSettings::particles) is a range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Kld {
    /// Size of a bin along x and y (m).
    pub position: f64,
    /// Size of a bin in heading (rad).
    pub heading: f64,
    /// ε: bound on the Kullback-Leibler divergence between the binned particles and the binned posterior.
    pub epsilon: f64,
    /// Quantile z of the standard normal distribution for the probability 1 − δ that the divergence is below ε; 2.326
    /// for δ = 0.01.
    pub quantile: f64,
}

impl Default for Kld {
    fn default() -> Self {
        Kld { position: 0.5, heading: 10f64.to_radians(), epsilon: 0.05, quantile: 2.326 }
    }
}

impl Kld {
    /// Returns an error unless bins and bounds are positive.
    pub(crate) fn check(&self) -> Result<(), FilterError> {
        check_length("kld.position", self.position)?;
        for (field, value) in [
            ("kld.heading", self.heading),
            ("kld.epsilon", self.epsilon),
            ("kld.quantile", self.quantile),
        ] {
            check_positive(field, value)?;
        }
        Ok(())
    }

    /// The number of particles required for `bins` occupied bins (table 8.4, line 16): the quantile of the
    /// chi-square distribution with bins − 1 degrees of freedom over 2ε, by the Wilson-Hilferty approximation. 0 for
    /// fewer than two bins.
    pub fn number(&self, bins: usize) -> usize {
        if bins < 2 {
            return 0;
        }
        let freedom = (bins - 1) as f64;
        let ninth = 2.0 / (9.0 * freedom);
        let cube = math::powi(1.0 - ninth + ninth.sqrt() * self.quantile, 3);
        (freedom / (2.0 * self.epsilon) * cube).ceil() as usize
    }

    /// The number of successively drawn poses after which their number reaches that required for their bins, within
    /// the limits, both inclusive.
    pub(crate) fn enough(
        &self,
        least: usize,
        most: usize,
        poses: impl Iterator<Item = Pose2>,
    ) -> usize {
        let mut occupied = HashSet::new();
        let mut wanted = least;
        let mut drawn = 0;
        for pose in poses.take(most) {
            if drawn >= wanted {
                break;
            }
            drawn += 1;
            let bin = [pose.x / self.position, pose.y / self.position, pose.theta / self.heading];
            if occupied.insert(bin.map(|place| place.floor() as i64)) {
                wanted = self.number(occupied.len()).clamp(least, most);
            }
        }
        drawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles of the chi-square distribution at 0.99: 6.635 for 1 degree of freedom, 21.666 for 9, 135.81 for
    /// 99. Wilson and Hilferty's are 6.59 (0.7 % less), 21.69 and 135.8.
    #[test]
    fn numbers_are_quantiles_of_chi_square() {
        let kld = Kld { epsilon: 0.05, quantile: 2.326, ..Kld::default() };
        assert_eq!([0, 1].map(|bins| kld.number(bins)), [0, 0]);
        for (bins, quantile) in [(2, 6.635), (10, 21.666), (100, 135.807)] {
            let expected: f64 = quantile / 0.1;
            let found = kld.number(bins) as f64;
            assert!((found / expected - 1.0).abs() < 0.02, "{bins}: {found} for {expected}");
        }
        // By hand: 1/0.1·(1 − 2/9 + √(2/9)·2.326)³ = 10·(0.77778 + 1.09649)³ = 65.84.
        assert_eq!(kld.number(2), 66);
        let coarse = Kld { epsilon: 0.1, ..kld };
        assert_eq!(coarse.number(2), 33);
    }

    #[test]
    fn poses_are_drawn_until_their_bins_are_filled() {
        let kld = Kld { position: 1.0, heading: 0.5, epsilon: 0.05, quantile: 2.326 };
        let poses = |bins: usize| (0..).map(move |i| Pose2::new((i % bins) as f64 + 0.5, 0.0, 0.1));
        assert_eq!(kld.enough(20, 1000, poses(1)), 20);
        assert_eq!(kld.enough(20, 1000, poses(2)), 66);
        assert_eq!(kld.enough(20, 1000, poses(10)), kld.number(10));
        assert_eq!(kld.enough(20, 1000, poses(1000)), 1000);
        // Bins differ by heading, and on either side of 0.
        let turned = (0..).map(|i| Pose2::new(0.5, 0.5, if i % 2 == 0 { -0.1 } else { 0.1 }));
        assert_eq!(kld.enough(20, 1000, turned), 66);
    }
}
