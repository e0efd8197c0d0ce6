//! CSV: header `x,y` or `x,y,z`, one point per line.

use std::io::{self, Write};

use csv::{ErrorKind, Position, ReaderBuilder, StringRecord, Trim, Writer};
use mcl_core::Point;

use super::columns::{AXES, Axes, NotFinite, Parsed, parse_number};
use super::{FilePosition, MapProblem};

pub(super) fn write<const D: usize>(points: &[Point<D>], sink: impl Write) -> io::Result<()> {
    let mut writer = Writer::from_writer(sink);
    writer.write_record(&AXES[..D])?;
    for point in points {
        // `Display` writes the shortest decimal that parses to the same bits.
        writer.write_record(point.map(|coordinate| coordinate.to_string()))?;
    }
    writer.flush()
}

pub(super) fn parse<const D: usize>(
    bytes: &[u8],
    not_finite: NotFinite,
) -> Result<Parsed<D>, MapProblem> {
    let mut reader = ReaderBuilder::new().trim(Trim::All).comment(Some(b'#')).from_reader(bytes);
    let header: Vec<String> =
        reader.headers().map_err(|error| problem(bytes, &error))?.iter().map(Into::into).collect();
    let axes = Axes::find(&header, not_finite).map_err(|missing| match missing {
        MapProblem::MissingColumn { column, found }
            if header.iter().any(|name| is_number(name)) =>
        {
            MapProblem::MissingColumn {
                column,
                found: format!("{found} (a line of numbers: the header line is missing)"),
            }
        }
        other => other,
    })?;
    let mut points = Parsed::new();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(|error| problem(bytes, &error))? {
        let place = FilePosition::Line(line_of(bytes, record.position()));
        points.push(axes.point(place, |index, column| {
            // The reader has checked that rows have the length of the header.
            parse_number(record.get(index).unwrap_or_default(), place, column)
        })?);
    }
    Ok(points)
}

fn is_number(text: &str) -> bool {
    text.parse::<f64>().is_ok()
}

/// The line number of a record, from 1. The library reports the position where it started to look for the record,
/// which is before any blank lines and comments.
fn line_of(bytes: &[u8], position: Option<&Position>) -> u64 {
    let Some(position) = position else { return 0 };
    let rest = bytes.get(position.byte() as usize..).unwrap_or_default();
    let passed_over = rest
        .split(|&byte| byte == b'\n')
        .take_while(|line| line.trim_ascii().is_empty() || line.starts_with(b"#"));
    position.line() + passed_over.count() as u64
}

fn problem(bytes: &[u8], error: &csv::Error) -> MapProblem {
    let line = line_of(bytes, error.position());
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => MapProblem::RowLength {
            place: FilePosition::Line(line),
            found: *len,
            expected: *expected_len,
        },
        ErrorKind::Utf8 { .. } => MapProblem::syntax(format!("line {line}: not UTF-8 text")),
        _ => MapProblem::syntax(error.to_string()),
    }
}
