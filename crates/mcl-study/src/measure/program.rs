//! The outcome of a localizer, built-in or external.

use anyhow::Result;

use super::{RunContext, RunMeasure};
use crate::table::Value;

/// Always computed in studies with external programs: how the localizer ended, the share of the scans at
/// which it has an estimate, processor time (s) and peak memory of a program (MB). The last two differ from
/// run to run.
pub const PROGRAM: RunMeasure = RunMeasure {
    name: "localizer",
    columns: &[ENDED, "coverage", MEASURED_ANEW[0], MEASURED_ANEW[1]],
    measure,
};

/// The column with the way in which a localizer ended.
pub const ENDED: &str = "ended";

/// The columns that differ whenever a row is computed.
pub const MEASURED_ANEW: [&str; 2] = ["processor_s", "peak_memory_mb"];

fn measure(context: &RunContext<'_>) -> Result<Vec<Value>> {
    let tracked = context.tracked;
    let covered = tracked.errors.iter().flatten().count();
    Ok(vec![
        tracked.ended.to_string().into(),
        (covered as f64 / tracked.errors.len() as f64).into(),
        tracked.processor_s.into(),
        tracked.peak_memory_mb.into(),
    ])
}
