//! Compares results with those of an earlier run.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use csv::StringRecord;
use mcl_core::files::open;

use mcl_study::localizer::program::FAILED_RUNS;
use mcl_study::measure::program::MEASURED_ANEW;
use mcl_study::store::parts::PARTS;
use mcl_study::store::results::{MANIFEST, Manifest, TIMINGS};

/// Differences described; further ones are only counted.
const DETAILS: usize = 20;

/// The result of comparing results with earlier ones.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Files that were compared.
    pub files: usize,
    /// Files that can only be compared byte by byte, and were left out because of a tolerance.
    pub left_out: usize,
    /// Number of differences.
    pub differences: usize,
    /// The first of them: file, position, values found and expected.
    pub details: Vec<String>,
}

impl Comparison {
    fn differs(&mut self, detail: impl FnOnce() -> String) {
        self.differences += 1;
        if self.details.len() < DETAILS {
            self.details.push(detail());
        }
    }
}

/// Compares a result folder with the files of an earlier one, which may hold only some: tables cell by cell,
/// numbers within a relative tolerance; with a tolerance of 0 every file byte by byte, apart from the build
/// in a manifest. Times and memory are not compared.
///
/// # Errors
/// When a file cannot be read.
pub fn compare(found: &Path, expected: &Path, tolerance: f64) -> Result<Comparison> {
    let mut comparison = Comparison::default();
    let mut files = Vec::new();
    list(expected, &mut files)?;
    files.retain(|path| path.file_name() != Some(TIMINGS.as_ref()));
    files.sort();
    if files.is_empty() {
        bail!("{}: there is no file of results to compare with", expected.display());
    }
    for path in files {
        let name = path.strip_prefix(expected).expect("the path begins with the folder");
        let again = found.join(name);
        if !again.exists() {
            comparison.differs(|| format!("{} is missing", again.display()));
            continue;
        }
        let read = |path: &Path| -> Result<Vec<u8>> {
            let mut bytes = Vec::new();
            open(path)
                .and_then(|mut file| file.read_to_end(&mut bytes))
                .with_context(|| format!("cannot read {}", path.display()))?;
            Ok(bytes)
        };
        let (found, expected) = (read(&again)?, read(&path)?);
        let table = name.extension().is_some_and(|ending| ending == "csv");
        if !table && tolerance > 0.0 {
            comparison.left_out += 1;
            continue;
        }
        comparison.files += 1;
        if found == expected || (name.ends_with(MANIFEST) && same_data(&found, &expected)) {
            continue;
        }
        if table {
            compare_tables(name, &found, &expected, tolerance, &mut comparison)
                .with_context(|| format!("in {}", name.display()))?;
        } else {
            let same = found.iter().zip(&expected).take_while(|(a, b)| a == b).count();
            comparison.differs(|| format!("{}: differs from byte {same} on", name.display()));
        }
    }
    Ok(comparison)
}

/// Whether two manifests are of the same study and data: another build shows in the rows or not at all.
fn same_data(found: &[u8], expected: &[u8]) -> bool {
    let read = |bytes: &[u8]| Manifest::parse(std::str::from_utf8(bytes).ok()?).ok();
    let known = |manifest: Manifest| (manifest.study, manifest.identity.data);
    read(found).is_some_and(|found| Some(known(found)) == read(expected).map(known))
}

/// Folders that are not results: rows as saved, in as many files as there were processes, and the stderr of
/// external programs.
const NO_RESULTS: [&str; 2] = [PARTS, FAILED_RUNS];

/// All files below a folder that are results. Links to folders are not followed: they may form a cycle.
fn list(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let cannot = || format!("cannot look for results in {}", folder.display());
    for entry in fs::read_dir(folder).with_context(cannot)? {
        let entry = entry.with_context(cannot)?;
        let kind = entry.file_type().with_context(cannot)?;
        match (kind.is_dir(), entry.path()) {
            (true, path)
                if !NO_RESULTS.map(|name| Some(name.as_ref())).contains(&path.file_name()) =>
            {
                list(&path, files)?
            }
            (false, path) if path.is_file() => files.push(path),
            _ => {}
        }
    }
    Ok(())
}

/// Whether a column holds times or memory, which differ from run to run; a summary's column has a longer
/// name.
fn is_measured_anew(column: &str) -> bool {
    let is_of = |name: &str| {
        let rest = column.strip_prefix("kept_").unwrap_or(column).strip_prefix(name);
        rest.is_some_and(|rest| matches!(rest, "" | "_sd" | "_low" | "_high"))
    };
    MEASURED_ANEW.into_iter().any(is_of)
}

fn compare_tables(
    name: &Path,
    found: &[u8],
    expected: &[u8],
    tolerance: f64,
    comparison: &mut Comparison,
) -> Result<()> {
    let read = |bytes: &[u8]| -> Result<Vec<StringRecord>> {
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(bytes);
        Ok(reader.records().collect::<Result<_, _>>()?)
    };
    let (found, expected) = (read(found)?, read(expected)?);
    if found.len() != expected.len() || found.first() != expected.first() {
        comparison.differs(|| {
            let size = |rows: &[StringRecord]| {
                (rows.len().saturating_sub(1), rows.first().map_or(0, StringRecord::len))
            };
            let ((rows, columns), (rows_before, columns_before)) = (size(&found), size(&expected));
            format!(
                "{}: {rows} rows of {columns} columns, expected {rows_before} of {columns_before} \
                 with the same names",
                name.display()
            )
        });
        return Ok(());
    }
    let Some(header) = expected.first() else { return Ok(()) };
    for (line, (found, expected)) in found.iter().zip(&expected).enumerate().skip(1) {
        for ((cell, before), column) in found.iter().zip(expected).zip(header) {
            if !is_measured_anew(column) && !agree(cell, before, tolerance) {
                comparison.differs(|| {
                    let (name, line) = (name.display(), line + 1);
                    format!("{name}, line {line}, {column}: {cell}, expected {before}")
                });
            }
        }
    }
    Ok(())
}

/// Whether two cells are the same text, or numbers that differ by no more than the tolerance.
fn agree(found: &str, expected: &str, tolerance: f64) -> bool {
    let numbers = || {
        let (found, expected) = (found.parse::<f64>().ok()?, expected.parse::<f64>().ok()?);
        Some((found - expected).abs() <= tolerance * found.abs().max(expected.abs()))
    };
    found == expected || numbers().unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    #[test]
    fn the_cell_that_differs_is_named() {
        let table = "strategy,error\ngbs,0.5\nrnd,0.25\n";
        let earlier =
            folder(&[("a/summary.csv", table), ("a/f.svg", "<svg/>"), ("a/timings.csv", "x")]);
        let same = folder(&[("a/summary.csv", table), ("a/f.svg", "<svg/>"), ("a/more.csv", "")]);
        let compared = |found: &tempfile::TempDir, tolerance| {
            compare(found.path(), earlier.path(), tolerance).unwrap()
        };
        let exact = compared(&same, 0.0);
        assert_eq!((exact.files, exact.differences), (2, 0));

        let table = table.replace("0.25", "0.26");
        let other = folder(&[("a/summary.csv", &table)]);
        let found = compared(&other, 0.0);
        assert_eq!(found.differences, 2);
        assert!(found.details[0].contains("f.svg is missing"), "{found:?}");
        let place = "summary.csv, line 3, error: 0.26, expected 0.25";
        assert!(found.details[1].ends_with(place), "{found:?}");
        assert_eq!(compared(&other, 0.03).differences, 2);
        assert_eq!(compared(&other, 0.05).differences, 1);
        assert_eq!(compared(&same, 0.05).left_out, 1);
    }
}
