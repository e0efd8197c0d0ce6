//! The share of a study's trials that a process runs, so that several processes, on one machine or many,
//! divide the work.
//!
//! Trials are assigned by their estimated costs and identities alone, whatever is done already: every process
//! computes the same parts whenever it starts.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fmt;

/// The share of a study that a process runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// Every trial without rows, and then the tables.
    Whole {
        /// Remove the rows of earlier runs first.
        fresh: bool,
    },
    /// The trials of one part of several without rows, and no tables.
    Part(Part),
    /// No trial: only the tables of the existing rows.
    Merge,
}

/// One part of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    number: usize,
    of: usize,
}

impl Part {
    /// Part `number`, from 1, of `of`.
    ///
    /// # Errors
    /// When there is no such part.
    pub fn new(number: usize, of: usize) -> Result<Self, String> {
        match (1..=of).contains(&number) {
            true => Ok(Part { number, of }),
            false => Err(format!("part {number} of {of}: expected a part from 1 to {of}")),
        }
    }

    /// Its number, from 1.
    pub const fn number(self) -> usize {
        self.number
    }

    /// How many parts there are.
    pub const fn of(self) -> usize {
        self.of
    }
}

/// "part 3 of 8".
impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "part {} of {}", self.number, self.of)
    }
}

/// The part (from 1) of each trial, given by cost (in any unit) and identity: longest first, each to the part
/// with the least work. Trials of equal cost, such as the draws of one kind of map, go to different parts, in
/// the order of their identities, so that losing a part does not empty a cell of a table.
pub fn deal(trials: &[(f64, &str)], parts: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| {
        let ((cost_a, identity_a), (cost_b, identity_b)) = (trials[a], trials[b]);
        cost_b.total_cmp(&cost_a).then_with(|| identity_a.cmp(identity_b))
    });
    let mut loads: BinaryHeap<Reverse<(Load, usize)>> =
        (1..=parts.max(1)).map(|part| Reverse((Load(0.0), part))).collect();
    let mut dealt = vec![0; trials.len()];
    for trial in order {
        let Some(Reverse((Load(load), part))) = loads.pop() else { break };
        dealt[trial] = part;
        loads.push(Reverse((Load(load + trials[trial].0), part)));
    }
    dealt
}

/// A sum of costs, with an order.
#[derive(PartialEq)]
struct Load(f64);

impl Eq for Load {}

impl PartialOrd for Load {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Load {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_part_is_one_of_its_number() {
        assert_eq!(Part::new(3, 8).unwrap().to_string(), "part 3 of 8");
        for (number, of) in [(0, 8), (9, 8), (1, 0)] {
            assert!(Part::new(number, of).is_err(), "{number} of {of}");
        }
    }

    #[test]
    fn draws_of_one_cell_go_to_several_parts() {
        let names: Vec<String> = (0..40).map(|draw| format!("{:02}", (draw * 7) % 40)).collect();
        let trials: Vec<(f64, &str)> = names
            .iter()
            .enumerate()
            .map(|(k, name)| (if k < 20 { 9.0 } else { 1.0 }, &**name))
            .collect();
        let dealt = deal(&trials, 8);
        for cell in [0..20, 20..40] {
            for part in 1..=8 {
                let of_part = dealt[cell.clone()].iter().filter(|of| **of == part).count();
                // Of the long ones some parts have three and some two; the short ones go to the latter.
                assert!(of_part <= 5, "part {part} has {of_part} of {cell:?}");
            }
        }
    }

    proptest! {
        /// Longest first is at most 4/3 of the optimum (Graham 1969), and no part is empty without a reason.
        #[test]
        fn every_trial_has_a_part_and_loads_are_even(
            costs in prop::collection::vec(0.1..10.0f64, 1..200),
            parts in 1..20usize,
        ) {
            let names: Vec<String> = (0..costs.len()).map(|k| format!("{k:04}")).collect();
            let trials: Vec<(f64, &str)> = costs.iter().copied().zip(names.iter().map(|name| &**name)).collect();
            let dealt = deal(&trials, parts);
            prop_assert!(dealt.iter().all(|part| (1..=parts).contains(part)));
            let load = |part: usize| -> f64 {
                dealt.iter().zip(&costs).filter(|(of, _)| **of == part).map(|(_, cost)| cost).sum()
            };
            let most = (1..=parts).map(load).fold(0.0, f64::max);
            let least_possible = (costs.iter().sum::<f64>() / parts as f64)
                .max(costs.iter().copied().fold(0.0, f64::max));
            prop_assert!(most <= least_possible * 4.0 / 3.0 + 1e-9 + costs.iter().copied().fold(0.0, f64::max) / 3.0);
            // The order of the input does not matter.
            let mut reversed = trials.clone();
            reversed.reverse();
            let mut again = deal(&reversed, parts);
            again.reverse();
            prop_assert_eq!(again, dealt);
        }
    }
}
