//! Whether, and how soon, a robot was found.

use anyhow::Result;
use mcl_metrics::{LossSettings, found_for_good};

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// A robot should be found within this number of scans after the start …
const AFTER_START: usize = 30;
/// … and within this number after it was kidnapped.
const AFTER_CARRYING: usize = 50;

/// Whether the robot was found (an error below 0.5 m, and none above 1 m after it), whether within 30 scans,
/// and after how many: all scans where it was not found, so that a mean includes every run. For a run with a
/// kidnapping, of the scans before it; and the same of the scans after it, within 50 scans. The latter are
/// empty for other runs.
pub const FINDING: RunMeasure = RunMeasure {
    name: "finding",
    columns: &[
        "found",
        "found_within_30",
        "scans_until_found",
        "found_again",
        "found_again_within_50",
        "scans_until_found_again",
    ],
    measure,
};

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let tracked = context.tracked;
    let errors = tracked.translations();
    let (before, after) = match tracked.carried_off {
        Some(scan) => (&errors[..scan], Some(&errors[scan..])),
        None => (&errors[..], None),
    };
    let mut values = found(before, AFTER_START);
    values.extend(after.map_or(vec![Value::Empty; 3], |after| found(after, AFTER_CARRYING)));
    Ok(values)
}

fn found(errors: &[f64], within: usize) -> Vec<Value> {
    let after = found_for_good(errors, &LossSettings::default());
    let soon = after.is_some_and(|scans| scans < within);
    vec![after.is_some().into(), soon.into(), after.unwrap_or(errors.len()).into()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robots_that_are_not_found_count_with_all_of_their_scans() {
        let run = |lost: usize, found: usize| [vec![5.0; lost], vec![0.1; found]].concat();
        let of = |lost, known| found(&run(lost, known), 30);
        assert_eq!(of(29, 5), [true.into(), true.into(), 29u32.into()]);
        assert_eq!(of(30, 5), [true.into(), false.into(), 30u32.into()]);
        assert_eq!(of(40, 0), [false.into(), false.into(), 40u32.into()]);
    }
}
