use anyhow::{Result, bail};
use mcl_core::text::{counted, printable};
use mcl_study::store::results::{FoundResults, TRIALS, read_all, save_table};

use super::Outcome;
use super::args::{Global, PlotArgs};
use crate::figures;
use crate::progress::{error_message, tell};

/// Writes the tables and draws the figures of every result folder below the root that has rows.
pub fn run(args: &PlotArgs, global: &Global) -> Result<Outcome> {
    let FoundResults { results, without_rows, damaged } = read_all(&args.root)?;
    for (folder, error) in &damaged {
        let (folder, error) = (folder.to_string_lossy(), error_message(error));
        tell!("error: leaving out {}: {}", printable(&folder), printable(&error));
    }
    if results.is_empty() {
        bail!("{}: no result folder with rows; run a study first", args.root.display());
    }
    if !without_rows.is_empty() && !global.quiet {
        let folders = counted(without_rows.len(), "result folder");
        tell!("{folders} without rows left out, such as committed results");
    }
    let mut complete = damaged.is_empty();
    let mut failed = 0;
    for results in &results {
        let folder = results.folder.to_string_lossy();
        let folder = printable(&folder);
        complete &= results.is_complete();
        if let Some(first) = results.damage.first() {
            let damaged = counted(results.damage.len(), "damaged line");
            tell!("warning: {folder}: {damaged} in the saved rows, such as {}", printable(first));
        }
        if let Some(found) = results.missing() {
            tell!("warning: {folder}: {found} have rows");
        }
        let saved = save_table(&results.folder.join(TRIALS), &results.table);
        let drawn = saved.and_then(|()| figures::draw(results, args.style.into()));
        match drawn {
            Ok(drawn) if drawn.is_empty() && !global.quiet => {
                tell!("{folder}: the study has no figures");
            }
            Ok(drawn) if !global.quiet => {
                drawn.iter().for_each(|path| tell!("{}", printable(&path.to_string_lossy())));
            }
            Ok(_) => {}
            Err(error) => {
                let error = error_message(&error);
                tell!("error: leaving out {folder}: {}", printable(&error));
                failed += 1;
            }
        }
    }
    if failed == results.len() {
        bail!("{}: the figures of no result folder could be drawn", args.root.display());
    }
    Ok(Outcome::of(complete && failed == 0))
}
