//! Section V-B: when the filter loses the robot for good.

use mcl_metrics::{Rate, fisher_exact_greater};

use super::ALPHA;
use super::claim::{Claim, Finding, Section, Statement, Untestable};
use super::paired::{Cell, Sizes};
use super::saved::LocalizationResults;
use mcl_core::text::list;

pub(super) const CLAIMS: [fn(&LocalizationResults) -> Claim; 2] = [recovers, diverges_below];

pub(super) fn recovers(data: &LocalizationResults) -> Claim {
    let statement = Statement {
        id: "localization-recovers",
        section: Section::Localization,
        text: "From 0.25 % of the points on, the filter is never lost for good",
        test: "no test: holds if no run diverged (ended more than 1 m off)",
    };
    statement.decide(&data.place, || {
        let cells = data.sampled()?.all_cells(&Sizes::NOT_TINY)?;
        let rate = divergence(&cells)?;
        let bound = rate.upper_bound(1.0 - ALPHA)?;
        let mut told = format!("{} of {} runs diverged", rate.hits(), rate.trials());
        let diverged: Vec<String> = cells
            .iter()
            .filter(|cell| cell.diverged() > 0)
            .map(|cell| format!("{} of {} on {}", cell.diverged(), cell.runs.len(), cell.name()))
            .collect();
        if !diverged.is_empty() {
            told += &format!(" ({})", list(&diverged));
        }
        Ok(Finding {
            holds: rate.hits() == 0,
            p: None,
            measured: format!(
                "{told}; the rate is below {:.1} % with 99 % confidence if runs are independent",
                100.0 * bound
            ),
        })
    })
}

pub(super) fn diverges_below(data: &LocalizationResults) -> Claim {
    let statement = Statement {
        id: "localization-diverges-below",
        section: Section::Localization,
        text: "Below 0.25 % of the points the filter diverges in some runs",
        test: "holds if a run diverged; p: Fisher's exact test, more often below 0.25 % than from \
               there on, if runs are independent",
    };
    statement.decide(&data.place, || {
        let runs = data.sampled()?;
        let below = runs.all_cells(&Sizes::TINY)?;
        let rate = divergence(&below)?;
        // Without larger maps there is nothing to compare with, but runs have diverged or not.
        let above = runs.all_cells(&Sizes::NOT_TINY).and_then(|cells| divergence(&cells)).ok();
        let told = match above {
            Some(above) => format!(", from 0.25 % on {} of {}", above.hits(), above.trials()),
            None => String::new(),
        };
        Ok(Finding {
            holds: rate.hits() > 0,
            p: above.map(|above| fisher_exact_greater(rate, above)),
            measured: format!("{} of {} runs diverged{told}", rate.hits(), rate.trials()),
        })
    })
}

/// How often runs diverged.
fn divergence(cells: &[Cell]) -> Result<Rate, Untestable> {
    let diverged = cells.iter().map(Cell::diverged).sum();
    let runs = cells.iter().map(|cell| cell.runs.len()).sum();
    Ok(Rate::new(diverged, runs)?)
}
