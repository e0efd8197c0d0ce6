use anyhow::{Context, Result, bail};
use serde::Serialize;

use super::Outcome;
use super::args::ClaimsArgs;
use super::output::print;
use crate::claims::{Claim, DatasetClaims, decide, render};
use crate::results;

#[derive(Serialize)]
struct Claims<'a> {
    claims: Vec<&'a Claim>,
}

/// Sets every claim of the paper beside what was measured.
pub fn run(args: &ClaimsArgs) -> Result<Outcome> {
    let datasets = decide(&results::folders(&args.root)?)?;
    if datasets.is_empty() {
        bail!(
            "{}: results of other kinds only, the claims are about likelihood and localization \
             experiments in the plane; `make experiments` runs them",
            args.root.display()
        );
    }
    if let Some(path) = &args.output {
        mcl_core::files::write_atomically(path, render::markdown(&datasets).as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let claims = datasets.iter().flat_map(|dataset: &DatasetClaims| &dataset.claims).collect();
    print(args.json, &Claims { claims }, |_| render::text(&datasets, width()))?;
    Ok(Outcome::Done)
}

/// Columns of the terminal. `COLUMNS` speaks louder, and for a file or a pipe, which have none.
fn width() -> u16 {
    const OF_A_FILE: u16 = 100;
    let asked = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    let of_terminal = || terminal_size::terminal_size().map(|(columns, _)| columns.0);
    asked.filter(|&columns| columns > 0).or_else(of_terminal).unwrap_or(OF_A_FILE)
}
