//! Numbers of points that the paper gives.

use mcl_core::text::thousands;
use mcl_maps::MapSize;
use mcl_study::data::facts::DataFacts;

use crate::claims::claim::{Claim, Evidence, Finding, Place, Section, Statement, Untestable};

pub(super) const CLAIMS: [fn(&DataFacts) -> Claim; 3] = [figure_1_size, figure_2_size, points];

const INTEL: &str = "intel-lab";
const BUILDING_79: &str = "freiburg-079";
/// Readings beyond this do not count, in the paper (m).
const PAPER_RANGE: f64 = 10.0;
const EXACT: &str = "no test, the numbers are exact";

fn figure_1_size(facts: &DataFacts) -> Claim {
    // The caption's number; the text says 706,528.
    const POINTS: usize = 706_628;
    const MAP_POINTS: usize = 5_749;
    let statement = Statement {
        id: "figure-1-size",
        section: Section::Introduction,
        text: "The log of building 79 has 706,628 points, and the 5,749 of the maps in figure 1 \
               are less than 1 % of them",
        test: EXACT,
    };
    statement.decide(&place(facts), || {
        require(facts, BUILDING_79)?;
        let share = 100.0 * MAP_POINTS as f64 / facts.points as f64;
        Ok(Finding {
            holds: facts.points == POINTS && share < 1.0,
            evidence: Evidence::default(),
            measured: format!(
                "{} points with 0 < r ≤ {} m; 5,749 are {share:.2} % of them. The paper gives two \
                 numbers itself, 706,628 under figure 1 and 706,528 in the text, and no limit of \
                 the range",
                thousands(facts.points),
                facts.max_range.unwrap_or(f64::INFINITY)
            ),
        })
    })
}

fn figure_2_size(facts: &DataFacts) -> Claim {
    const MAP_POINTS: usize = 389;
    let statement = Statement {
        id: "figure-2-size",
        section: Section::InitialMap,
        text: "The two maps of figure 2 have 389 points each: 0.25 % of the Intel log",
        test: EXACT,
    };
    statement.decide(&place(facts), || {
        require(facts, INTEL)?;
        let found = MapSize::Percent(0.25)
            .resolve(facts.points)
            .map_err(|error| Untestable(error.to_string()))?;
        let share = 0.0025 * facts.points as f64;
        Ok(Finding {
            holds: found == MAP_POINTS,
            evidence: Evidence::default(),
            measured: format!(
                "0.25 % of {} points are {share:.2}, rounded down {found}",
                thousands(facts.points)
            ),
        })
    })
}

fn points(facts: &DataFacts) -> Claim {
    const POINTS: usize = 155_648;
    let statement = Statement {
        id: "points",
        section: Section::Results,
        text: "The Intel log has 155,648 points within 10 m",
        test: EXACT,
    };
    statement.decide(&place(facts), || {
        require(facts, INTEL)?;
        if facts.max_range != Some(PAPER_RANGE) {
            let range = facts.max_range.unwrap_or(f64::INFINITY);
            return Err(Untestable(format!("measured with a limit of {range} m, not 10 m")));
        }
        Ok(Finding {
            holds: facts.points == POINTS,
            evidence: Evidence::default(),
            measured: format!("{} points with 0 < r ≤ 10 m", thousands(facts.points)),
        })
    })
}

fn place(facts: &DataFacts) -> Place {
    Place { dataset: facts.name.clone(), experiment: None, split: None }
}

/// The statement is about one log only.
fn require(facts: &DataFacts, name: &str) -> Result<(), Untestable> {
    match facts.name == name {
        true => Ok(()),
        false => Err(Untestable(format!("a statement about {name} only"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::claim::Verdict::{self, *};

    fn verdicts(name: &str, points: usize, max_range: f64) -> [Verdict; 3] {
        let facts = DataFacts {
            name: name.into(),
            title: "A log".into(),
            sha256: "00".into(),
            dimensions: 2,
            scans: 1,
            max_range: Some(max_range),
            points,
            skipped_records: 0,
        };
        CLAIMS.map(|claim| claim(&facts).verdict)
    }

    #[test]
    fn numbers_belong_to_their_log() {
        assert_eq!(verdicts(INTEL, 155_648, 10.0), [NotTestable, Reproduced, Reproduced]);
        assert_eq!(verdicts(INTEL, 150_000, 10.0), [NotTestable, NotReproduced, NotReproduced]);
        assert_eq!(verdicts(INTEL, 160_000, 80.0), [NotTestable, NotReproduced, NotTestable]);
        assert_eq!(verdicts(BUILDING_79, 706_628, 80.0), [Reproduced, NotTestable, NotTestable]);
        assert_eq!(
            verdicts(BUILDING_79, 1_654_968, 10.0),
            [NotReproduced, NotTestable, NotTestable]
        );
        assert_eq!(verdicts("office", 155_648, 10.0), [NotTestable; 3]);
    }
}
