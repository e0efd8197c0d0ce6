//! What a claim consists of.

use mcl_metrics::{Effect, MetricsError, TooFew, holm};
use mcl_study::recipe::split::Split;
use serde::Serialize;

/// Level of every test, as in the paper.
pub const ALPHA: f64 = 0.01;

/// All claims about one data set.
#[derive(Debug, Clone, Serialize)]
pub struct DatasetClaims {
    /// Name in the registry, or of the log file.
    pub name: String,
    /// The data in words: title, scans and points.
    pub description: String,
    /// The claims, in the paper's order.
    pub claims: Vec<Claim>,
    /// What could not be decided as a whole, a sentence each.
    pub notes: Vec<String>,
}

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
    /// How large the effect is, and how sure.
    #[serde(flatten)]
    pub evidence: Evidence,
    /// What comes of it.
    pub verdict: Verdict,
}

/// What a claim was measured on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Place {
    /// Name in the registry, or of the log file.
    pub dataset: String,
    /// Name of the study; `None` for facts about the data.
    pub experiment: Option<String>,
    /// Which scans built the maps and which were localized; `None` where all of them did both.
    pub split: Option<Split>,
}

/// A statement of the paper, in other words, and the test of it.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Statement {
    /// Name of the claim, the same in every version of the program.
    pub id: &'static str,
    /// Section of the paper; sorts as it is written (I, IV, V, V-A, V-B).
    pub section: &'static str,
    /// What it says.
    #[serde(rename = "statement")]
    pub text: &'static str,
    /// What exactly is tested or compared.
    pub test: &'static str,
}

/// What comes of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Verdict {
    /// It holds for what was measured.
    Reproduced,
    /// It does not, or not surely enough.
    NotReproduced,
    /// The saved results cannot decide it.
    NotTestable,
}

impl Verdict {
    /// All of them.
    pub const ALL: [Verdict; 3] =
        [Verdict::Reproduced, Verdict::NotReproduced, Verdict::NotTestable];
}

/// The name, also in JSON.
impl From<Verdict> for &'static str {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::NotTestable => "not testable",
        }
    }
}

/// How large an effect is, and how sure; nothing where exact numbers are compared.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Evidence {
    /// p value of the test, adjusted for the number of tests where the strongest of several counts.
    pub p: Option<f64>,
    /// The effect in the comparison that decides.
    pub effect: Option<f64>,
    /// Lower end of its 95 % confidence interval, not adjusted.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
    /// Number of independent blocks (of the smaller side) behind it.
    pub blocks: Option<usize>,
    /// What the effect is: its unit, and which comparison.
    pub effect_of: Option<String>,
}

/// A comparison that was tested.
#[derive(Debug, Clone)]
pub(super) struct Tested {
    pub p: f64,
    pub effect: Effect,
    /// Which comparison.
    pub of: String,
}

impl Tested {
    /// The comparison with the largest p: a claim about all of them is as sure as that one is.
    pub fn weakest(tests: &[Tested]) -> Option<&Tested> {
        tests.iter().max_by(|a, b| a.p.total_cmp(&b.p))
    }

    /// The comparison with the smallest p, adjusted after Holm (times the number of comparisons): a claim
    /// about any of them is as sure as that one is.
    pub fn strongest(tests: &[Tested]) -> Option<Tested> {
        let adjusted = holm(&tests.iter().map(|test| test.p).collect::<Vec<f64>>());
        let tests = tests.iter().zip(adjusted);
        let (test, p) = tests.min_by(|a, b| a.0.p.total_cmp(&b.0.p))?;
        Some(Tested { p, ..test.clone() })
    }

    /// The evidence of a difference in this unit.
    pub fn difference(&self, unit: &str) -> Evidence {
        self.evidence(unit, |difference| difference)
    }

    /// The evidence of a difference of logarithms, as a ratio of this.
    pub fn ratio(&self, of: &str) -> Evidence {
        self.evidence(of, f64::exp)
    }

    fn evidence(&self, unit: &str, shown: fn(f64) -> f64) -> Evidence {
        let Tested { p, effect, of } = self;
        Evidence {
            p: Some(*p),
            effect: Some(shown(effect.mean_difference)),
            low: Some(shown(effect.interval.low)),
            high: Some(shown(effect.interval.high)),
            blocks: effect.blocks.into_iter().min(),
            effect_of: Some(format!("{unit} {of}")),
        }
    }
}

/// How many of the p values of a family are below α after Holm.
pub(super) fn significant(p_values: impl Iterator<Item = f64>) -> usize {
    holm(&p_values.collect::<Vec<f64>>()).into_iter().filter(|&p| p < ALPHA).count()
}

/// Outcome of a test that could be made.
pub(super) struct Finding {
    /// Whether the claim holds.
    pub holds: bool,
    pub measured: String,
    pub evidence: Evidence,
}

/// Why the saved results cannot decide a claim.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Untestable(pub String);

impl From<MetricsError> for Untestable {
    fn from(error: MetricsError) -> Self {
        Untestable(error.to_string())
    }
}

impl From<TooFew> for Untestable {
    fn from(error: TooFew) -> Self {
        Untestable(error.to_string())
    }
}

/// What comes of the test of a statement.
pub(super) type Outcome = Result<Finding, Untestable>;

impl Claim {
    pub(super) fn new(place: Place, statement: Statement, outcome: Outcome) -> Self {
        let (verdict, measured, evidence) = match outcome {
            Ok(Finding { holds: true, measured, evidence }) => {
                (Verdict::Reproduced, measured, evidence)
            }
            Ok(Finding { measured, evidence, .. }) => (Verdict::NotReproduced, measured, evidence),
            Err(Untestable(reason)) => (Verdict::NotTestable, reason, Evidence::default()),
        };
        Claim { place, statement, measured, evidence, verdict }
    }
}
