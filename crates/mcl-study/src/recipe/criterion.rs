//! Criteria for a size or σ chosen by the data.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Criterion for an automatic size or σ (docs/refinement.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// The likelihood of blocks of scans left out in turn.
    HeldOut,
    /// The Bayesian information criterion (size).
    Bic,
    /// The description length of data and map (size).
    Mdl,
    /// The likelihood of the points that the map is built from, as estimated by EM (σ).
    Likelihood,
}

impl Criterion {
    /// All of them.
    pub const ALL: [Criterion; 4] =
        [Criterion::HeldOut, Criterion::Bic, Criterion::Mdl, Criterion::Likelihood];

    /// The name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Criterion::HeldOut => "held-out",
            Criterion::Bic => "bic",
            Criterion::Mdl => "mdl",
            Criterion::Likelihood => "likelihood",
        }
    }

    /// Whether it can decide a size.
    pub fn decides_size(self) -> bool {
        // The likelihood always increases with the number of points.
        self != Criterion::Likelihood
    }

    /// Whether it can decide a σ.
    pub fn decides_sigma(self) -> bool {
        matches!(self, Criterion::HeldOut | Criterion::Likelihood)
    }
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Criterion {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Criterion::ALL.map(Criterion::name).join(", ");
        Criterion::ALL
            .into_iter()
            .find(|criterion| criterion.name() == text)
            .ok_or_else(|| format!("{text:?} is not a criterion, expected one of {}", names()))
    }
}
