//! The paper's claims as a table: a row per claim, a column per data set.

use mcl_core::text::{counted, number, p_value};

use crate::claims::claim::{Claim, DatasetClaims, Verdict};
use crate::report::text::{shown, shown_long};

/// The claims of all data sets.
#[derive(Debug, Default)]
pub struct Matrix {
    /// Names of the data sets.
    pub datasets: Vec<String>,
    /// Claims decided on some data set.
    pub decided: Vec<ClaimRow>,
    /// Claims decided on none.
    pub undecided: Vec<ClaimRow>,
    /// What could not be decided as a whole, a sentence each, after its data sets.
    pub notes: Vec<String>,
    /// How many claims hold, do not hold, or cannot be tested.
    pub counts: [usize; 3],
}

/// A claim.
#[derive(Debug)]
pub struct ClaimRow {
    /// Its name.
    pub id: &'static str,
    /// Section of the paper.
    pub section: &'static str,
    /// The statement.
    pub statement: &'static str,
    /// The test.
    pub test: &'static str,
    /// By data set: the verdicts, under each split, preset and study.
    pub cells: Vec<Vec<Decided>>,
}

/// The verdict on a claim under one condition.
#[derive(Debug)]
pub struct Decided {
    /// Study, split and preset.
    pub place: String,
    /// The measurement, or why nothing could be tested.
    pub measured: String,
    /// Effect, interval and p value.
    pub evidence: String,
    /// The verdict.
    pub verdict: Verdict,
}

impl Decided {
    /// A symbol, so that nothing depends on colour alone.
    pub fn symbol(&self) -> &'static str {
        ["✓", "✗", "–"][self.verdict as usize]
    }

    /// Name of its style.
    pub fn class(&self) -> &'static str {
        ["holds", "fails", "none"][self.verdict as usize]
    }

    /// The verdict in words.
    pub fn word(&self) -> &'static str {
        self.verdict.into()
    }

    fn of(claim: &Claim) -> Self {
        let place = &claim.place;
        let split = place.split.map(|split| split.name().to_owned());
        let parts = [place.experiment.clone(), place.preset.clone(), split];
        let place: Vec<String> = parts.into_iter().flatten().map(|part| shown(&part)).collect();
        Decided {
            place: if place.is_empty() { "the data".to_owned() } else { place.join(", ") },
            measured: shown_long(claim.measured.trim_end_matches('.')),
            evidence: evidence(claim),
            verdict: claim.verdict,
        }
    }
}

/// "error ratio gbs+f-km over gbs: 0.87 (0.80 to 0.95), 10 blocks, p = 3.1e-5"
fn evidence(claim: &Claim) -> String {
    let found = &claim.evidence;
    let effect = found.effect.zip(found.low.zip(found.high)).zip(found.effect_of.as_ref());
    let effect = effect.map(|((effect, (low, high)), of)| {
        format!("{}: {} ({} to {})", shown(of), number(effect), number(low), number(high))
    });
    let blocks = found.blocks.map(|blocks| counted(blocks, "block"));
    [effect, blocks, found.p.map(p_value)].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Claims by data set.
pub fn matrix(datasets: &[DatasetClaims]) -> Matrix {
    let mut matrix = Matrix::default();
    let mut rows: Vec<ClaimRow> = Vec::new();
    let mut notes: Vec<(&String, Vec<String>)> = Vec::new();
    for (column, dataset) in datasets.iter().enumerate() {
        matrix.datasets.push(shown(&dataset.name));
        for note in &dataset.notes {
            match notes.iter_mut().find(|(known, _)| *known == note) {
                Some((_, names)) => names.push(shown(&dataset.name)),
                None => notes.push((note, vec![shown(&dataset.name)])),
            }
        }
        for claim in &dataset.claims {
            matrix.counts[claim.verdict as usize] += 1;
            let place = rows.iter().position(|row| row.id == claim.id).unwrap_or_else(|| {
                let Claim { id, section, statement, test, .. } = *claim;
                let cells = datasets.iter().map(|_| Vec::new()).collect();
                rows.push(ClaimRow { id, section, statement, test, cells });
                rows.len() - 1
            });
            rows[place].cells[column].push(Decided::of(claim));
        }
    }
    let note = |(note, names): (&String, Vec<String>)| {
        format!("{}: {}", names.join(", "), shown_long(note))
    };
    matrix.notes = notes.into_iter().map(note).collect();
    // A stable sort: within a section claims keep the paper's order.
    rows.sort_by_key(|row| row.section);
    let is_decided = |row: &ClaimRow| {
        row.cells.iter().flatten().any(|decided| decided.verdict != Verdict::NotTestable)
    };
    (matrix.decided, matrix.undecided) = rows.into_iter().partition(is_decided);
    matrix
}

/// A group of claims.
pub struct Part<'a> {
    /// Its caption.
    pub caption: &'static str,
    /// Whether they are collapsed at first.
    pub is_folded: bool,
    /// The claims.
    pub rows: &'a [ClaimRow],
}

impl Matrix {
    /// The claims that are decided somewhere, then those that are not.
    pub fn parts(&self) -> Vec<Part<'_>> {
        let decided = (
            "Claims by data set; each symbol opens to its study and settings, measurement and test",
            false,
            &self.decided,
        );
        let undecided =
            ("Claims that cannot be tested here, with the reasons", true, &self.undecided);
        let parts = [decided, undecided].into_iter().filter(|(_, _, rows)| !rows.is_empty());
        parts.map(|(caption, is_folded, rows)| Part { caption, is_folded, rows }).collect()
    }
}
