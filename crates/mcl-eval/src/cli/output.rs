//! The output of commands: results on stdout, losses on stderr, files.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap::error::ErrorKind;
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_core::files::{self, Unwritable, write_with};
use mcl_core::text::printable;
use mcl_core::{PointMap, Recording};
use mcl_datasets::carmen;
use mcl_datasets::log::ReadReport;
use mcl_datasets::registry::Registry;
use mcl_filter::Bridge;
use mcl_maps::files::{image_in_place, read_map};
use serde::Serialize;
use terminal_size::terminal_size_of;

use super::Outcome;
use super::args::Cli;
use crate::progress::{tell, wrapped};
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::store::results::save;

/// Prints a result as one JSON object, or as lines of text in which control characters of names are escaped.
///
/// # Errors
/// When stdout cannot be written.
pub fn print<T: Serialize>(json: bool, value: &T, text: impl FnOnce(&T) -> String) -> Result<()> {
    let mut stdout = io::stdout().lock();
    let text = match (json, terminal_size_of(&stdout)) {
        (true, _) => serde_json::to_string(value)?,
        (false, Some((width, _))) => wrapped(&lines(&text(value)), width.0.into()),
        (false, None) => lines(&text(value)),
    };
    writeln!(stdout, "{}", text.trim_end())
        .and_then(|()| stdout.flush())
        .context("cannot write to standard output")
}

/// Lines of text with escapes for control characters.
fn lines(text: &str) -> String {
    text.split('\n').map(printable).collect::<Vec<_>>().join("\n")
}

/// Writes rows as CSV with a header, atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write_rows<R: Serialize>(path: &Path, rows: &[R]) -> Result<()> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    rows.iter().try_for_each(|row| writer.serialize(row))?;
    save(path, &writer.into_inner()?)
}

/// Writes a CARMEN log atomically, compressed with gzip if its name ends with `.gz`.
///
/// # Errors
/// When the recording is not one that a log can hold, or the file cannot be written.
pub fn write_carmen(path: &Path, recording: &Recording, comments: &[&str]) -> Result<()> {
    let is_packed = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"));
    write_with(path, |file| {
        if is_packed {
            let mut encoder = GzEncoder::new(file, Compression::default());
            carmen::write(recording, comments, &mut encoder)?;
            encoder.finish()?;
        } else {
            carmen::write(recording, comments, file)?;
        }
        Ok(())
    })
}

/// The files of inputs given as paths and data sets.
pub fn input_files<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<PathBuf> {
    let of_dataset = |name: &str| {
        let registry = Registry::from_environment().ok()?;
        registry.locate(registry.get(name).ok()?).ok()
    };
    let mut files = Vec::new();
    for name in names {
        let path = PathBuf::from(name);
        files.extend(if path.is_file() { None } else { of_dataset(name) });
        files.push(path);
    }
    files
}

/// [`files::prepare`]: outputs that would replace an input are refused before anything is computed.
///
/// # Errors
/// The reason why an output cannot be written.
pub fn prepare<P: AsRef<Path>>(
    outputs: impl IntoIterator<Item = P>,
    inputs: &[PathBuf],
) -> Result<(), Unwritable> {
    let outputs: Vec<P> = outputs.into_iter().collect();
    let outputs: Vec<&Path> = outputs.iter().map(AsRef::as_ref).collect();
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    files::prepare(&outputs, &inputs)
}

/// Prints the text of `--help` or `--version`, in colours if stdout is a terminal.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_styled(text: &clap::Error) -> Result<Outcome> {
    text.print().and_then(|()| io::stdout().flush()).context("cannot write to standard output")?;
    Ok(Outcome::Done)
}

/// Reports on stderr what a log left open and what was lost of it, and returns whether anything was.
pub fn report_losses(name: &str, source: &LogSource) -> Outcome {
    report_reading(name, &source.assumptions, &source.report)
}

/// [`report_losses`] for a log or a point cloud.
pub fn report_data_losses(name: &str, source: &DataSource) -> Outcome {
    match source {
        DataSource::Log(log) => report_losses(name, log),
        DataSource::Cloud(cloud) => report_reading(name, &cloud.assumptions, &cloud.report),
    }
}

fn report_reading(name: &str, assumptions: &[String], report: &ReadReport) -> Outcome {
    for assumption in assumptions {
        tell!("warning: {name}: {assumption}");
    }
    if report.is_complete() {
        return Outcome::Done;
    }
    tell!("warning: {name}: {report}");
    Outcome::Incomplete
}

/// Reads a map, and reports on stderr where its image was found if its description gives another path.
///
/// # Errors
/// As [`read_map`].
pub fn open_map<const D: usize>(path: &Path) -> Result<PointMap<D>> {
    let map = read_map(path)?;
    report_image_in_place(path);
    Ok(map)
}

/// Reports that the image of a grid was read from elsewhere than its description says.
pub fn report_image_in_place(path: &Path) {
    if let Some((elsewhere, beside)) = image_in_place(path) {
        tell!(
            "note: {}: its image is given as {elsewhere:?}; {}, beside it, is used instead",
            path.display(),
            beside.display()
        );
    }
}

/// Reports on stderr which steps have unknown odometry, and how the filter bridges them.
pub fn report_bridged(name: &str, bridge: &Bridge) -> Outcome {
    let Bridge { scans, steps, reach } = bridge;
    let Some(first) = scans.first() else { return Outcome::Done };
    tell!(
        "warning: {name}: the odometry is missing for {} of {steps} steps (the first leads to scan \
         {first}); there the robot is searched for by its scan around its last pose (standard deviations \
         {reach:.2} m and 60°)",
        scans.len()
    );
    Outcome::Incomplete
}

/// The reference of a log, and whose poses it has.
pub fn reference_of(source: &LogSource) -> &str {
    source.reference.as_deref().unwrap_or("none")
}

/// [`reference_of`], for JSON: null without one, and for a point cloud.
pub fn reference_of_data(source: &DataSource) -> Option<String> {
    match source {
        DataSource::Log(log) => log.reference.clone(),
        DataSource::Cloud(_) => None,
    }
}

/// A usage error that the argument parser cannot detect.
///
/// # Errors
/// Always: the usage error, on which the program ends with exit code 2.
pub fn refuse<T>(message: &str) -> Result<T> {
    Err(Cli::command().error(ErrorKind::ArgumentConflict, message).into())
}

/// Whether the error is that the reader of our output has closed it.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fault: names of topics, trials and files reached the terminal unescaped.
    #[test]
    fn control_characters_are_escaped() {
        let text = "a\u{1b}[2Jb\r\n  c\u{202e}d\u{7}é <script>\n";
        assert_eq!(lines(text), "a\\u{1b}[2Jb\\u{d}\n  c\\u{202e}d\\u{7}é <script>\n");
    }
}
