use anyhow::{Context, Result, bail};

use super::Outcome;
use super::args::{Global, PlotArgs};
use crate::results;

/// Draws the figures of every result folder below the root.
pub fn run(args: &PlotArgs, global: &Global) -> Result<Outcome> {
    let folders = results::folders(&args.root)
        .with_context(|| format!("cannot look for results in {}", args.root.display()))?;
    if folders.is_empty() {
        bail!(
            "{}: no results, expected <experiment>/<data set>/manifest.json below it; \
             `mcl-eval run experiments/likelihood.toml` makes some",
            args.root.display()
        );
    }
    for folder in folders {
        let drawn = results::draw_figures(&folder)
            .with_context(|| format!("cannot draw the figures of {}", folder.display()))?;
        if !global.quiet {
            for path in drawn {
                eprintln!("{}", path.display());
            }
        }
    }
    Ok(Outcome::Done)
}
