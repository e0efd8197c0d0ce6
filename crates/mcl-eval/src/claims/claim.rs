//! The parts of a claim.

use mcl_core::math;
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
    /// A description of the data: title, scans and points.
    pub description: String,
    /// The claims, in the paper's order.
    pub claims: Vec<Claim>,
    /// What could not be decided as a whole, a sentence each.
    pub notes: Vec<String>,
}

/// A statement of the paper with its measurement.
#[derive(Debug, Clone, Serialize)]
pub struct Claim {
    /// The conditions of the measurement.
    #[serde(flatten)]
    pub place: Conditions,
    /// Name of the claim, the same in every version of the program.
    pub id: &'static str,
    /// Section of the paper; sorts as it is written (I, IV, V, V-A, V-B).
    pub section: &'static str,
    /// The statement, paraphrased.
    pub statement: &'static str,
    /// The exact test or comparison.
    pub test: &'static str,
    /// The measurement; for a claim that is not testable, the reason.
    pub measured: String,
    /// The effect and its uncertainty.
    #[serde(flatten)]
    pub evidence: Evidence,
    /// The verdict.
    pub verdict: Verdict,
}

/// The conditions of a claim's measurement.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Conditions {
    /// Name in the registry, or of the log file.
    pub dataset: String,
    /// Name of the study; `None` for facts about the data.
    pub experiment: Option<String>,
    /// Which scans built the maps and which were localized; `None` where all of them did both.
    pub split: Option<Split>,
    /// The preset of the filter's settings; `None` where nothing is localized.
    pub preset: Option<String>,
}

/// The verdict on a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Verdict {
    /// It holds for what was measured.
    Reproduced,
    /// It does not hold, or not significantly.
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

/// An effect with its uncertainty; empty where exact numbers are compared.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Evidence {
    /// p value of the test, adjusted for the number of tests where the strongest of several counts.
    pub p: Option<f64>,
    /// The effect in the decisive comparison.
    pub effect: Option<f64>,
    /// Lower end of its 95 % confidence interval, not adjusted.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
    /// Number of independent blocks (on the smaller side).
    pub blocks: Option<usize>,
    /// The unit of the effect, and the comparison.
    pub effect_of: Option<String>,
}

/// The kind of effect of a comparison.
#[derive(Clone, Copy)]
pub(super) enum EffectKind {
    /// A difference in this unit.
    Difference(&'static str),
    /// A difference of logarithms, as a ratio of this.
    Ratio(&'static str),
}

/// A tested comparison.
#[derive(Debug, Clone)]
pub(super) struct Tested {
    pub p: f64,
    pub effect: Effect,
    /// The comparison.
    pub of: String,
}

impl Tested {
    /// Whether all comparisons are significant: decided by the largest p.
    pub fn all(tests: &[Tested], kind: EffectKind) -> (bool, Evidence) {
        let weakest = tests.iter().max_by(|a, b| a.p.total_cmp(&b.p));
        Self::decided_by(weakest.cloned(), kind)
    }

    /// Whether any comparison is significant: decided by the smallest p, adjusted by Holm's method (times the
    /// number of comparisons).
    pub fn any(tests: &[Tested], kind: EffectKind) -> (bool, Evidence) {
        let adjusted = holm(&tests.iter().map(|test| test.p).collect::<Vec<f64>>());
        let strongest = Self::strongest(tests)
            .map(|index| Tested { p: adjusted[index], ..tests[index].clone() });
        Self::decided_by(strongest, kind)
    }

    /// The index of the comparison with the smallest p.
    pub fn strongest(tests: &[Tested]) -> Option<usize> {
        (0..tests.len()).min_by(|&a, &b| tests[a].p.total_cmp(&tests[b].p))
    }

    fn decided_by(test: Option<Tested>, kind: EffectKind) -> (bool, Evidence) {
        let Some(Tested { p, effect, of }) = test else { return Default::default() };
        let (unit, value): (_, fn(f64) -> f64) = match kind {
            EffectKind::Difference(unit) => (unit, |difference| difference),
            EffectKind::Ratio(of) => (of, math::exp),
        };
        let evidence = Evidence {
            p: Some(p),
            effect: Some(value(effect.mean_difference)),
            low: Some(value(effect.interval.low)),
            high: Some(value(effect.interval.high)),
            blocks: effect.blocks.into_iter().min(),
            effect_of: Some(format!("{unit} {of}")),
        };
        (p < ALPHA, evidence)
    }
}

/// How many p values of a family are below α after Holm's adjustment.
pub(super) fn significant(p_values: impl Iterator<Item = f64>) -> usize {
    holm(&p_values.collect::<Vec<f64>>()).into_iter().filter(|&p| p < ALPHA).count()
}

/// Result of a completed test.
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

/// Outcome of the test of a statement.
pub(super) type Outcome = Result<Finding, Untestable>;

/// A statement of the paper with the function that tests it.
pub(super) struct Test<F> {
    pub id: &'static str,
    /// The statement in a few words, for lists.
    pub short: &'static str,
    pub section: &'static str,
    pub statement: &'static str,
    pub test: &'static str,
    pub decide: F,
}

impl<F> Test<F> {
    /// The claim for an outcome.
    pub fn claim(&self, place: Conditions, outcome: Outcome) -> Claim {
        let Test { id, section, statement, test, .. } = *self;
        let (verdict, measured, evidence) = match outcome {
            Ok(Finding { holds: true, measured, evidence }) => {
                (Verdict::Reproduced, measured, evidence)
            }
            Ok(Finding { measured, evidence, .. }) => (Verdict::NotReproduced, measured, evidence),
            Err(Untestable(reason)) => (Verdict::NotTestable, reason, Evidence::default()),
        };
        Claim { place, id, section, statement, test, measured, evidence, verdict }
    }
}
