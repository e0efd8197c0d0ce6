//! What commands print: results on stdout, what was lost on stderr.

use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap::error::ErrorKind;
use mcl_core::files::write_atomically;
use mcl_datasets::log::ReadReport;
use serde::Serialize;
use terminal_size::terminal_size_of;

use super::Outcome;
use super::args::Cli;
use crate::progress::{tell, wrapped};
use mcl_study::data::source::{DataSource, LogSource};

/// Prints a result as one JSON object, or as lines of text.
///
/// # Errors
/// When stdout cannot be written.
pub fn print<T: Serialize>(json: bool, value: &T, text: impl FnOnce(&T) -> String) -> Result<()> {
    let mut stdout = io::stdout().lock();
    let text = match (json, terminal_size_of(&stdout)) {
        (true, _) => serde_json::to_string(value)?,
        (false, Some((width, _))) => wrapped(&text(value), width.0.into()),
        (false, None) => text(value),
    };
    writeln!(stdout, "{}", text.trim_end())
        .and_then(|()| stdout.flush())
        .context("cannot write to standard output")
}

/// Writes rows as CSV with a header, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_rows<R: Serialize>(path: &Path, rows: &[R]) -> Result<()> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    write_atomically(path, &writer.into_inner()?)
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Prints the text of `--help` or `--version`, in colours if stdout is a terminal.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_styled(text: &clap::Error) -> Result<Outcome> {
    text.print().and_then(|()| io::stdout().flush()).context("cannot write to standard output")?;
    Ok(Outcome::Done)
}

/// Says on stderr what a log left open and what of it was lost, and whether anything was.
pub fn tell_losses(name: &str, source: &LogSource) -> Outcome {
    tell_of(name, &source.assumptions, &source.report)
}

/// [`tell_losses`] of a log or a point cloud.
pub fn tell_data_losses(name: &str, source: &DataSource) -> Outcome {
    match source {
        DataSource::Log(log) => tell_losses(name, log),
        DataSource::Cloud(cloud) => tell_of(name, &cloud.assumptions, &cloud.report),
    }
}

fn tell_of(name: &str, assumptions: &[String], report: &ReadReport) -> Outcome {
    for assumption in assumptions {
        tell!("warning: {name}: {assumption}");
    }
    if report.is_complete() {
        return Outcome::Done;
    }
    tell!("warning: {name}: {report}");
    Outcome::Incomplete
}

/// A usage error that the parser of arguments cannot see.
pub fn refuse(message: &str) -> ! {
    Cli::command().error(ErrorKind::ArgumentConflict, message).exit()
}

/// Whether an error is that nobody reads our output any more.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

/// An error with its causes, but for causes that the message before already tells.
pub fn told_once(error: &anyhow::Error) -> String {
    let mut text = String::new();
    let mut before = String::new();
    for cause in error.chain() {
        let message = cause.to_string();
        if !before.contains(&message) {
            text += if text.is_empty() { "" } else { ": " };
            text += &message;
            before = message;
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once() {
        let error = anyhow::anyhow!("no such file")
            .context("cannot read a.csv: no such file")
            .context("in the map");
        assert_eq!(told_once(&error), "in the map: cannot read a.csv: no such file");
    }
}
