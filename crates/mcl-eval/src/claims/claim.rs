use mcl_metrics::MetricsError;
use serde::Serialize;

use crate::experiment::Split;

/// A statement of the paper beside what was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Claim {
    /// What it was measured on.
    #[serde(flatten)]
    pub place: Place,
    /// What is claimed and how it is tested.
    #[serde(flatten)]
    pub statement: Statement,
    /// What was measured; of a claim that is not testable, why.
    pub measured: String,
    /// p value of the test; `None` where exact numbers are compared, or nothing could be tested.
    pub p: Option<f64>,
    /// What comes of it.
    pub verdict: Verdict,
}

/// What a claim was measured on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Place {
    /// Name in the registry, or of the log file.
    pub dataset: String,
    /// Name of the experiment; `None` when there is none to measure the claim on.
    pub experiment: Option<String>,
    /// Which scans built the maps and which were localized; `None` where that is no question.
    pub split: Option<Split>,
}

/// A statement of the paper, in other words, and the test of it.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Statement {
    /// Name of the claim, the same in every version of the program.
    pub id: &'static str,
    /// Where the paper says it.
    pub section: Section,
    /// What it says.
    #[serde(rename = "statement")]
    pub text: &'static str,
    /// What exactly is tested or compared.
    pub test: &'static str,
}

/// Section of the paper, in its order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Section {
    /// Introduction.
    #[serde(rename = "I")]
    Introduction,
    /// Generating the initial map.
    #[serde(rename = "IV")]
    InitialMap,
    /// Experimental results.
    #[serde(rename = "V")]
    Results,
    /// Likelihood maximization.
    #[serde(rename = "V-A")]
    Likelihood,
    /// Localization using sample-based maps.
    #[serde(rename = "V-B")]
    Localization,
}

impl Section {
    /// Its number in the paper.
    pub fn number(self) -> &'static str {
        match self {
            Section::Introduction => "I",
            Section::InitialMap => "IV",
            Section::Results => "V",
            Section::Likelihood => "V-A",
            Section::Localization => "V-B",
        }
    }
}

/// What comes of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Verdict {
    /// It holds for what was measured.
    #[serde(rename = "reproduced")]
    Reproduced,
    /// It does not, or not surely enough.
    #[serde(rename = "not reproduced")]
    NotReproduced,
    /// The saved results cannot tell.
    #[serde(rename = "not testable")]
    NotTestable,
}

impl Verdict {
    /// Its name, also in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::NotTestable => "not testable",
        }
    }
}

/// Outcome of a test that could be made.
pub(super) struct Finding {
    /// Whether the claim holds.
    pub holds: bool,
    pub p: Option<f64>,
    pub measured: String,
}

/// Why the saved results cannot tell whether a claim holds.
#[derive(Debug, Clone)]
pub(super) struct Untestable(pub String);

impl From<MetricsError> for Untestable {
    fn from(error: MetricsError) -> Self {
        Untestable(error.to_string())
    }
}

impl Statement {
    /// The claim, decided by a test where one can be made.
    pub(super) fn decide(
        self,
        place: &Place,
        test: impl FnOnce() -> Result<Finding, Untestable>,
    ) -> Claim {
        let (verdict, p, measured) = match test() {
            Ok(Finding { holds: true, p, measured }) => (Verdict::Reproduced, p, measured),
            Ok(Finding { holds: false, p, measured }) => (Verdict::NotReproduced, p, measured),
            Err(Untestable(reason)) => (Verdict::NotTestable, None, reason),
        };
        Claim { place: place.clone(), statement: self, measured, p, verdict }
    }
}
