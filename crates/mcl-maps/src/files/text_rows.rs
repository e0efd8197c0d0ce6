//! Rows of ASCII PLY and PCD files.
//!
//! The libraries' own row readers are not used: `ply-rs-bw` refuses numbers such as `.5`, `5.` and
//! `nan`, and `pcd-rs` does not say which line or column an error comes from.

use super::columns::{Axes, Parsed, parse_number};
use super::{FilePosition, MapProblem};

/// The values that one column takes in a row of text.
pub(super) enum TextColumn {
    /// This many values.
    Values(u64),
    /// A number n, then n values.
    List,
}

/// Lines of text after a header, without blank lines and `#` comments.
pub(super) struct TextRows<'a> {
    lines: std::str::Lines<'a>,
    line: u64,
}

impl<'a> TextRows<'a> {
    /// The rows of `file` from byte `start` on.
    pub(super) fn after_header(file: &'a [u8], start: usize) -> Result<Self, MapProblem> {
        let lines_of = |bytes: &[u8]| bytes.iter().filter(|&&byte| byte == b'\n').count() as u64;
        let line = lines_of(&file[..start]);
        let text = std::str::from_utf8(&file[start..]).map_err(|error| {
            let line = line + lines_of(&file[start..][..error.valid_up_to()]) + 1;
            MapProblem::syntax(format!("line {line}: not text, but the header announces ASCII"))
        })?;
        Ok(TextRows { lines: text.lines(), line })
    }

    pub(super) fn next_row(&mut self) -> Option<(FilePosition, &'a str)> {
        for row in self.lines.by_ref() {
            self.line += 1;
            let row = row.trim();
            if !row.is_empty() && !row.starts_with('#') {
                return Some((FilePosition::Line(self.line), row));
            }
        }
        None
    }

    /// Reads `count` points, one per row of the given columns.
    pub(super) fn points<const D: usize>(
        &mut self,
        count: u64,
        columns: &[TextColumn],
        axes: &Axes<D>,
    ) -> Result<Parsed<D>, MapProblem> {
        let mut points = Parsed::new();
        let mut firsts = Vec::new();
        while (points.count() as u64) < count {
            let Some((place, row)) = self.next_row() else {
                return Err(MapProblem::count("points", count, points.count().to_string()));
            };
            split_row(row, place, columns, &mut firsts)?;
            points.push(
                axes.point(place, |index, column| parse_number(firsts[index], place, column))?,
            );
        }
        Ok(points)
    }
}

/// Puts the first value of every column into `firsts`, and checks the length of the row.
fn split_row<'a>(
    row: &'a str,
    place: FilePosition,
    columns: &[TextColumn],
    firsts: &mut Vec<&'a str>,
) -> Result<(), MapProblem> {
    firsts.clear();
    let found = row.split_ascii_whitespace().count() as u64;
    let mut values = row.split_ascii_whitespace();
    let mut expected = 0_u64;
    for column in columns {
        let first = values.next();
        let length = match column {
            TextColumn::Values(count) => *count,
            TextColumn::List => {
                let count = first.unwrap_or_default();
                count.parse::<u64>().ok().and_then(|count| count.checked_add(1)).ok_or_else(
                    || MapProblem::syntax(format!("{place}: {count:?} is not a list length")),
                )?
            }
        };
        expected = expected.saturating_add(length);
        if expected > found {
            break;
        }
        firsts.extend(first);
        for _ in 1..length {
            values.next();
        }
    }
    if found == expected { Ok(()) } else { Err(MapProblem::RowLength { place, found, expected }) }
}
