//! Tables with column names.

use std::io::BufRead;
use std::path::Path;

use csv::{ErrorKind, ReaderBuilder, StringRecord, Trim};
use mcl_core::{Pose2, Stamp, wrap_angle};

use super::columns::{Columns, Heading, Time, is_number, shown};
use super::{ParsedFile, TrajectoryFileError, TrajectoryFormat};
use crate::planar::{Attitude, NonPlanar, Refused, check_height, quoted};

/// A time above this is in nanoseconds (1973 or later), because it is too large for seconds.
const NANOSECONDS_FROM: f64 = 1e17;

/// Reads a table whose columns are named in `line` (from 1).
pub(super) fn read(
    mut reader: impl BufRead,
    file: &Path,
    names: &str,
    line: usize,
    non_planar: NonPlanar,
) -> Result<ParsedFile, TrajectoryFileError> {
    let delimiter = delimiter(names);
    let names = split(names, delimiter);
    let columns = Columns::find(&names).map_err(|problem| {
        let shown: Vec<String> = names.iter().take(MAX_LISTED).map(|name| shown(name)).collect();
        let more = names.len().saturating_sub(MAX_LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let columns = shown.join(", ") + &more;
        TrajectoryFileError::Columns { file: file.to_owned(), line, problem, columns }
    })?;
    skip_lines(&mut reader, line, file)?;
    let mut rows = builder(delimiter).from_reader(reader);
    let mut row = Row { file, line: 0, names: &names, record: StringRecord::new() };
    let (mut stamps, mut poses) = (Vec::new(), Vec::new());
    let mut unit = match columns.time {
        Time::One { unit, .. } => unit,
        Time::Two { .. } => None,
    };
    loop {
        let begins = line as u64 + rows.position().line();
        match rows.read_record(&mut row.record) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => return Err(cannot_read(error, file, line as u64, begins)),
        }
        row.line = row.record.position().map_or(begins, |at| line as u64 + at.line());
        row.check_count()?;
        stamps.push(row.stamp(columns.time, &mut unit)?);
        poses.push(row.pose(&columns, non_planar)?);
    }
    if poses.is_empty() {
        return Err(TrajectoryFileError::Empty { file: file.to_owned() });
    }
    let mut notes = Vec::new();
    if columns.leaves_out_angle {
        notes
            .push("headings are those of the quaternions; the column of angles is not read".into());
    }
    Ok(ParsedFile {
        trajectory: stamps.into_iter().zip(poses).collect(),
        format: if columns.is_euroc { TrajectoryFormat::Euroc } else { TrajectoryFormat::Csv },
        has_headings: columns.heading != Heading::Absent,
        notes,
    })
}

/// Number of names listed in a message.
const MAX_LISTED: usize = 30;

fn builder(delimiter: u8) -> ReaderBuilder {
    let mut builder = ReaderBuilder::new();
    builder.has_headers(false).delimiter(delimiter).flexible(true).trim(Trim::All);
    builder.comment(Some(b'#'));
    builder
}

/// The separator that occurs most often.
fn delimiter(names: &str) -> u8 {
    let count = |&separator: &u8| names.bytes().filter(|&byte| byte == separator).count();
    [b'\t', b';', b','].into_iter().max_by_key(count).unwrap_or(b',')
}

fn split(names: &str, delimiter: u8) -> Vec<String> {
    let mut reader = builder(delimiter).comment(None).from_reader(names.as_bytes());
    let mut record = StringRecord::new();
    match reader.read_record(&mut record) {
        Ok(true) => record.iter().map(str::to_owned).collect(),
        _ => Vec::new(),
    }
}

fn skip_lines(
    reader: &mut impl BufRead,
    lines: usize,
    file: &Path,
) -> Result<(), TrajectoryFileError> {
    for line in 1..=lines as u64 {
        let mut skipped = Vec::new();
        reader.read_until(b'\n', &mut skipped).map_err(|source| TrajectoryFileError::Read {
            file: file.to_owned(),
            line,
            source,
        })?;
    }
    Ok(())
}

/// Converts an error of the row reader to line numbers of the file.
fn cannot_read(error: csv::Error, file: &Path, before: u64, begins: u64) -> TrajectoryFileError {
    let line = error.position().map_or(begins, |at| before + at.line());
    let source = match error.into_kind() {
        ErrorKind::Io(source) => source,
        _ => std::io::Error::new(std::io::ErrorKind::InvalidData, "the line is not UTF-8 text"),
    };
    TrajectoryFileError::Read { file: file.to_owned(), line, source }
}

/// A row and its position in the file.
struct Row<'a> {
    file: &'a Path,
    line: u64,
    names: &'a [String],
    record: StringRecord,
}

impl Row<'_> {
    fn check_count(&self) -> Result<(), TrajectoryFileError> {
        let (found, named) = (self.record.len(), self.names.len());
        // A separator at the end of each line adds no field.
        let ends_with_separator = found == named + 1 && self.text(named).is_empty();
        if found == named || ends_with_separator {
            return Ok(());
        }
        let expected = format!("{named}, as many as columns are named");
        let (file, line) = (self.file.to_owned(), self.line);
        Err(TrajectoryFileError::FieldCount { file, line, found, expected })
    }

    fn text(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default()
    }

    fn error(
        &self,
        column: usize,
        found: String,
        expected: impl Into<String>,
    ) -> TrajectoryFileError {
        let name = self.names.get(column).map(|name| shown(name));
        TrajectoryFileError::Field {
            file: self.file.to_owned(),
            line: self.line,
            field: name.unwrap_or_default(),
            found,
            expected: expected.into(),
        }
    }

    fn number(&self, column: usize) -> Result<f64, TrajectoryFileError> {
        let text = self.text(column);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.error(column, quoted(text), "a finite number")),
        }
    }

    fn whole(&self, column: usize) -> Result<i64, TrajectoryFileError> {
        let text = self.text(column);
        text.parse().map_err(|_| self.error(column, quoted(text), "a whole number"))
    }

    /// `unit` is that of the column name; if it has none, the first row determines the unit.
    fn stamp(&self, time: Time, unit: &mut Option<i64>) -> Result<Stamp, TrajectoryFileError> {
        let (column, nanoseconds) = match time {
            Time::Two { seconds, nanoseconds } => {
                let beyond = self.whole(nanoseconds)?;
                if !(0..1_000_000_000).contains(&beyond) {
                    let found = quoted(self.text(nanoseconds));
                    return Err(self.error(nanoseconds, found, "nanoseconds from 0 to 999999999"));
                }
                let whole = self.whole(seconds)?.checked_mul(1_000_000_000);
                (seconds, whole.and_then(|whole| whole.checked_add(beyond)))
            }
            Time::One { column, .. } => {
                let text = self.text(column);
                let large = is_number(text) && self.number(column)?.abs() > NANOSECONDS_FROM;
                let unit = *unit.get_or_insert(if large { 1 } else { 1_000_000_000 });
                if unit == 1_000_000_000 {
                    return Stamp::parse_seconds(text).map_err(|error| {
                        let advice = "the unit may stand in the column's name, as in time_ms";
                        let expected = format!("seconds; this is {error} ({advice})");
                        self.error(column, quoted(text), expected)
                    });
                }
                (column, self.in_nanoseconds(column, unit)?)
            }
        };
        nanoseconds.map(Stamp::from_nanoseconds).ok_or_else(|| {
            let expected = "a time in the years 1677 to 2262";
            self.error(column, quoted(self.text(column)), expected)
        })
    }

    /// A time in a unit of this many nanoseconds, exact if it is an integer; `None` beyond 64 bits.
    fn in_nanoseconds(&self, column: usize, unit: i64) -> Result<Option<i64>, TrajectoryFileError> {
        if let Ok(whole) = self.text(column).parse::<i64>() {
            return Ok(whole.checked_mul(unit));
        }
        let nanoseconds = (self.number(column)? * unit as f64).round();
        Ok((nanoseconds.abs() < i64::MAX as f64).then_some(nanoseconds as i64))
    }

    fn pose(&self, columns: &Columns, non_planar: NonPlanar) -> Result<Pose2, TrajectoryFileError> {
        let [x, y] = [self.number(columns.x)?, self.number(columns.y)?];
        if let Some(column) = columns.z {
            check_height(self.number(column)?, non_planar)
                .map_err(|Refused { found, expected, .. }| self.error(column, found, expected))?;
        }
        let theta = match columns.heading {
            Heading::Absent => 0.0,
            Heading::Angle { column, in_degrees } => {
                let angle = self.number(column)?;
                wrap_angle(if in_degrees { angle.to_radians() } else { angle })
            }
            Heading::Quaternion(quaternion) => {
                let [x, y, z, w] = quaternion;
                let numbers = [self.number(x)?, self.number(y)?, self.number(z)?, self.number(w)?];
                Attitude::of_quaternion(numbers)
                    .and_then(|attitude| attitude.heading(non_planar, None))
                    .map_err(|Refused { found, expected, .. }| self.error(x, found, expected))?
            }
        };
        Ok(Pose2::new(x, y, theta))
    }
}
