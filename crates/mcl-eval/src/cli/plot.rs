use anyhow::{Context, Result};

use super::Outcome;
use super::args::{Global, PlotArgs};
use crate::results;

/// Draws the figures of every result folder below the root.
pub fn run(args: &PlotArgs, global: &Global) -> Result<Outcome> {
    for folder in results::folders(&args.root)? {
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
