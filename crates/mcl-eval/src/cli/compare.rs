use anyhow::{Result, bail};

use super::Outcome;
use super::args::CompareArgs;
use super::output::print;
use crate::compare::compare;
use crate::progress::tell;

/// Compares results with those of an earlier run, and fails where they differ.
pub fn run(args: &CompareArgs) -> Result<Outcome> {
    if !(args.tolerance >= 0.0 && args.tolerance.is_finite()) {
        bail!("--tolerance {}: expected a number that is not negative", args.tolerance);
    }
    let comparison = compare(&args.found, &args.expected, args.tolerance)?;
    for detail in &comparison.details {
        tell!("{detail}");
    }
    if comparison.differences > 0 {
        bail!(
            "{} differences between {} and {}",
            comparison.differences,
            args.found.display(),
            args.expected.display()
        );
    }
    print(false, &(), |()| {
        let mut text = format!("{} files agree", comparison.files);
        if comparison.left_out > 0 {
            text += &format!("; {} others need a tolerance of 0", comparison.left_out);
        }
        text
    })?;
    Ok(Outcome::Done)
}
