//! Numbers of points stated in the paper.

use mcl_core::text::thousands;
use mcl_maps::MapSize;
use mcl_study::data::facts::DataFacts;

use crate::claims::claim::{Evidence, Finding, Outcome, Test, Untestable};

const EXACT: &str = "no test, the numbers are exact";

/// A statement about the data.
type FactsTest = Test<fn(&DataFacts) -> Outcome>;

pub(super) const CLAIMS: [FactsTest; 3] = [
    Test {
        id: "figure-1-size",
        short: "5,749 points are below 1 % of building 79",
        section: "I",
        statement: "The log of building 79 has 706,628 points, and the 5,749 of the maps in figure 1 \
                   are less than 1 % of them",
        test: EXACT,
        decide: figure_1_size,
    },
    Test {
        id: "figure-2-size",
        short: "figure 2's maps: 389 points, 0.25 %",
        section: "IV",
        statement: "The two maps of figure 2 have 389 points each: 0.25 % of the Intel log",
        test: EXACT,
        decide: figure_2_size,
    },
    Test {
        id: "points",
        short: "Intel has 155,648 points",
        section: "V",
        statement: "The Intel log has 155,648 points within 10 m",
        test: EXACT,
        decide: points,
    },
];

const INTEL: &str = "intel-lab";
const BUILDING_79: &str = "freiburg-079";

fn figure_1_size(facts: &DataFacts) -> Outcome {
    require(facts, BUILDING_79)?;
    let share = 100.0 * 5_749.0 / facts.points as f64;
    let measured = format!(
        "{} points with 0 < r ≤ {} m; 5,749 are {share:.2} % of them. The paper gives two numbers \
         itself, 706,628 under figure 1 and 706,528 in the text, and no limit of the range",
        thousands(facts.points),
        range(facts)
    );
    Ok(exact(facts.points == 706_628 && share < 1.0, measured))
}

fn figure_2_size(facts: &DataFacts) -> Outcome {
    require(facts, INTEL)?;
    let found = MapSize::Percent(0.25).resolve(facts.points);
    let found = found.map_err(|error| Untestable(error.to_string()))?;
    let (share, points) = (0.0025 * facts.points as f64, thousands(facts.points));
    let measured = format!("0.25 % of {points} points are {share:.2}, rounded down {found}");
    Ok(exact(found == 389, measured))
}

fn points(facts: &DataFacts) -> Outcome {
    require(facts, INTEL)?;
    if facts.max_range != Some(10.0) {
        let reason = format!("measured with a limit of {} m, not 10 m", range(facts));
        return Err(Untestable(reason));
    }
    let measured = format!("{} points with 0 < r ≤ 10 m", thousands(facts.points));
    Ok(exact(facts.points == 155_648, measured))
}

fn exact(holds: bool, measured: String) -> Finding {
    Finding { holds, measured, evidence: Evidence::default() }
}

/// Readings beyond this do not count (m).
fn range(facts: &DataFacts) -> f64 {
    facts.max_range.unwrap_or(f64::INFINITY)
}

/// The statement is about a single log.
fn require(facts: &DataFacts, name: &str) -> Result<(), Untestable> {
    match facts.name == name {
        true => Ok(()),
        false => Err(Untestable(format!("a statement about {name} only"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::planted;

    /// Verdicts: Some of whether the claim holds.
    fn verdicts(name: &str, points: usize, max_range: f64) -> [Option<bool>; 3] {
        let facts = DataFacts {
            name: name.into(),
            points,
            max_range: Some(max_range),
            ..planted::office_facts()
        };
        CLAIMS.map(|test| (test.decide)(&facts).ok().map(|finding| finding.holds))
    }

    #[test]
    fn numbers_belong_to_their_log() {
        let (yes, no) = (Some(true), Some(false));
        assert_eq!(verdicts(INTEL, 155_648, 10.0), [None, yes, yes]);
        assert_eq!(verdicts(INTEL, 150_000, 10.0), [None, no, no]);
        assert_eq!(verdicts(INTEL, 160_000, 80.0), [None, no, None]);
        assert_eq!(verdicts(BUILDING_79, 706_628, 80.0), [yes, None, None]);
        assert_eq!(verdicts(BUILDING_79, 1_654_968, 10.0), [no, None, None]);
        assert_eq!(verdicts("office", 155_648, 10.0), [None; 3]);
    }
}
