use std::path::PathBuf;

use anyhow::Result;
use mcl_core::text::{counted, printable};
use mcl_study::store::parts::PARTS;
use mcl_study::store::results::{FIGURES, SHOWN, save};
use serde::Serialize;

use super::Outcome;
use super::args::{Global, ReportArgs};
use super::output::{prepare, print};
use crate::progress::tell;
use crate::report::exhibits::recorded_folders;
use crate::report::folder::Rows;
use crate::report::gather::{gather, result_folders};
use crate::report::page::page;
use crate::report::text::bytes;
use crate::report::watch::recorded_runs;

#[derive(Serialize)]
struct WrittenReport {
    page: String,
    bytes: usize,
    studies: usize,
    folders: usize,
    /// Folders with tables but no rows.
    without_rows: usize,
    /// Folders with fewer trials than asked for.
    incomplete: usize,
    /// Folders that could not be read.
    damaged: usize,
    /// Folders with runs recorded by `localize`.
    localized: usize,
}

/// Writes the page for everything below the roots. Folders that could not be read or lack trials are reported
/// on the page and on stderr, and do not stop the others.
pub fn run(args: &ReportArgs, global: &Global) -> Result<Outcome> {
    let mut inputs: Vec<PathBuf> = args.logs.iter().map(PathBuf::from).collect();
    for root in &args.roots {
        let recorded = recorded_folders(root);
        for folder in result_folders(root, &recorded)? {
            inputs.extend([FIGURES, PARTS, SHOWN].map(|below| folder.join(below)));
            inputs.push(folder);
        }
        inputs.extend(recorded.iter().flat_map(|folder| recorded_runs(folder).unwrap_or_default()));
    }
    prepare([&args.output], &inputs)?;
    let report = gather(&args.roots, &args.logs, global.quiet)?;
    for (folder, why) in &report.damaged {
        tell!("warning: leaving out {}: {why}", folder.display());
    }
    let all = || report.studies.values().flatten();
    for folder in all() {
        if let Some(Rows { done, asked, .. }) = folder.rows.filter(|rows| rows.done < rows.asked) {
            let path = folder.path.to_string_lossy();
            tell!("warning: {}: {done} of {asked} trials have rows", printable(&path));
        }
    }
    for (folder, shown) in &report.localized {
        if let Err(why) = shown {
            tell!("warning: no runs are shown of {}: {why}", folder.display());
        }
    }
    let page = page(&report)?;
    save(&args.output, page.as_bytes())?;
    let rows = || all().filter_map(|folder| folder.rows);
    let written = WrittenReport {
        page: args.output.display().to_string(),
        bytes: page.len(),
        studies: report.studies.len(),
        folders: all().count(),
        without_rows: all().filter(|folder| folder.rows.is_none()).count(),
        incomplete: rows().filter(|rows| rows.done < rows.asked).count(),
        damaged: report.damaged.len(),
        localized: report.localized.len(),
    };
    if written.without_rows > 0 && !global.quiet {
        let folders = counted(written.without_rows, "result folder");
        tell!("{folders} without rows: shown from the tables beside them");
    }
    let is_whole = written.incomplete == 0 && written.damaged == 0;
    print(args.json, &written, |written| {
        let counts = [(written.folders, "result folder"), (written.localized, "folder of runs")];
        let counts = counts.iter().filter(|(count, _)| *count > 0);
        let counts: Vec<String> = counts.map(|(count, what)| counted(*count, what)).collect();
        format!("{}, {}\n{}", counts.join(", "), bytes(written.bytes), written.page)
    })?;
    Ok(Outcome::of(is_whole))
}
