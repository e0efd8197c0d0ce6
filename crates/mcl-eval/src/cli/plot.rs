use anyhow::{Context, Result};

use super::Outcome;
use super::args::{Global, PlotArgs};
use crate::progress::tell;
use crate::results;

/// Draws the figures of every result folder below the root that has rows.
pub fn run(args: &PlotArgs, global: &Global) -> Result<Outcome> {
    let (folders, without_rows): (Vec<_>, Vec<_>) =
        results::folders(&args.root)?.into_iter().partition(|folder| results::has_rows(folder));
    for folder in without_rows {
        tell!("leaving out {}: it has no rows; run its experiment first", folder.display());
    }
    for folder in folders {
        let drawn = results::draw_figures(&folder)
            .with_context(|| format!("cannot draw the figures of {}", folder.display()))?;
        if !global.quiet {
            for path in drawn {
                tell!("{}", path.display());
            }
        }
    }
    Ok(Outcome::Done)
}
