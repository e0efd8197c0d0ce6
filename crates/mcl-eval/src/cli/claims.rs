use anyhow::{Result, bail};
use mcl_core::text::{counted, printable};
use mcl_study::store::results::{read_all, save};
use serde::Serialize;

use super::Outcome;
use super::args::{ClaimsArgs, Global};
use super::output::print;
use crate::claims::claim::{Claim, DatasetClaims};
use crate::claims::{brief, compared, decide, render, without_results};
use crate::progress::{error_message, tell};

#[derive(Serialize)]
struct Claims<'a> {
    claims: Vec<&'a Claim>,
}

/// Prints every claim of the paper next to what was measured. A result folder that is damaged or lacks trials is
/// reported on stderr and does not stop the others.
pub fn run(args: &ClaimsArgs, global: &Global) -> Result<Outcome> {
    let found = read_all(&args.root)?;
    let mut is_whole = found.damaged.is_empty();
    for (folder, error) in &found.damaged {
        let (folder, error) = (folder.to_string_lossy(), error_message(error));
        tell!("warning: {}: {}", printable(&folder), printable(&error));
    }
    for damage in found.results.iter().flat_map(|results| &results.damage) {
        tell!("warning: {}", printable(damage));
        is_whole = false;
    }
    if !found.without_rows.is_empty() && !global.quiet {
        let folders = counted(found.without_rows.len(), "result folder");
        tell!("{folders} without rows left out, such as committed results");
    }
    let datasets = decide(&found.results);
    if datasets.is_empty() {
        bail!(
            "{}: no rows that the claims are about: likelihood or localization experiments in the plane, \
             on maps gbs, gbs+f-km, rnd and rnd+f-km; `make experiments` runs them",
            args.root.display()
        );
    }
    for results in compared(&found.results, &datasets) {
        let Some(found) = results.missing() else { continue };
        tell!("warning: {}: {found} have rows", printable(&results.folder.to_string_lossy()));
        is_whole = false;
    }
    let missing = without_results(&found.results, &datasets);
    if let Some(path) = &args.output {
        let document = render::markdown(&datasets, &missing);
        save(path, document.as_bytes())?;
    }
    let claims = datasets.iter().flat_map(|dataset: &DatasetClaims| &dataset.claims).collect();
    print(args.json, &Claims { claims }, |_| match args.verbose {
        true => render::text(&datasets, &missing, width()),
        false => brief::text(&datasets, &missing, &found.results, &args.root, width()),
    })?;
    Ok(Outcome::of(is_whole))
}

/// Width of the terminal in columns. `COLUMNS` takes precedence; a file or a pipe has no width.
fn width() -> u16 {
    const OF_A_FILE: u16 = 100;
    let asked = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    let of_terminal = || terminal_size::terminal_size().map(|(columns, _)| columns.0);
    asked.filter(|&columns| columns > 0).or_else(of_terminal).unwrap_or(OF_A_FILE)
}
