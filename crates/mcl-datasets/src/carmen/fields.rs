//! The whitespace-separated fields of one record, read in order, each with its name.

use std::fmt;
use std::str::SplitAsciiWhitespace;

use mcl_core::{ParseStampError, Pose2, Stamp};

use crate::log::report::{RecordPlace, SkippedRecord};

/// Largest pose component accepted (metres, radians). Beyond any place on Earth, and small enough that
/// composed poses stay finite.
pub(super) const MAX_POSE_COMPONENT: f64 = 1e9;
/// Characters of a field quoted in a message.
const QUOTED_CHARS: usize = 40;

/// Name of a field as written in the format's definition; formatted only when something is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// A field that occurs once.
    Named(&'static str),
    /// Reading of a beam: r1 is the reading of beam 0.
    Reading(usize),
    /// The number of fields of the whole record, including its kind.
    Total,
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Field::Named(name) => f.write_str(name),
            Field::Reading(index) => write!(f, "r{}", index + 1),
            Field::Total => f.write_str("number of fields"),
        }
    }
}

/// What is wrong with a record of a known kind.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{record}: {field} is {found}, expected {expected}")]
pub struct Malformed {
    /// Kind of the record.
    pub record: &'static str,
    /// The field at fault.
    pub field: Field,
    /// What was found, shortened to a readable length.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

impl Malformed {
    /// Adds the line in the log (from 1).
    pub fn at_line(self, line: usize) -> SkippedRecord {
        SkippedRecord {
            place: RecordPlace::Line(line),
            record: self.record.to_owned(),
            field: self.field.to_string(),
            found: self.found,
            expected: self.expected,
        }
    }
}

/// The fields of a record after its kind, read one by one.
#[derive(Clone)]
pub(crate) struct RecordFields<'a> {
    record: &'static str,
    tokens: SplitAsciiWhitespace<'a>,
}

impl<'a> RecordFields<'a> {
    /// Fields of `line` after its first one, the kind.
    pub fn of(record: &'static str, line: &'a str) -> Self {
        let mut tokens = line.split_ascii_whitespace();
        tokens.next();
        RecordFields { record, tokens }
    }

    pub fn malformed(&self, field: Field, found: &str, expected: impl Into<String>) -> Malformed {
        let mut quoted: String = found.chars().take(QUOTED_CHARS).collect();
        if quoted.len() < found.len() {
            quoted.push('…');
        }
        Malformed { record: self.record, field, found: quoted, expected: expected.into() }
    }

    pub fn text(&mut self, field: Field, expected: &str) -> Result<&'a str, Malformed> {
        match self.tokens.next() {
            Some(text) => Ok(text),
            None => Err(self.malformed(field, "missing", expected)),
        }
    }

    /// Skips fields that are not used.
    pub fn pass(&mut self, count: usize) {
        if count > 0 {
            self.tokens.nth(count - 1);
        }
    }

    /// Number of fields not read yet.
    pub fn remaining(&self) -> usize {
        self.tokens.clone().count()
    }

    pub fn count(&mut self, field: Field) -> Result<usize, Malformed> {
        const EXPECTED: &str = "a count (0, 1, 2, …)";
        let text = self.text(field, EXPECTED)?;
        text.parse().map_err(|_| self.malformed(field, text, EXPECTED))
    }

    /// Any number, including `nan` and `inf`, also as printed by programs on Windows.
    pub fn number(&mut self, field: Field) -> Result<f64, Malformed> {
        let text = self.text(field, "a number")?;
        let value = text.parse().ok().or_else(|| no_number(text));
        value.ok_or_else(|| self.malformed(field, text, "a number"))
    }

    pub fn finite(&mut self, field: Field) -> Result<f64, Malformed> {
        const EXPECTED: &str = "a finite number of at most 1e9";
        let text = self.text(field, EXPECTED)?;
        match text.parse::<f64>() {
            Ok(value) if value.abs() <= MAX_POSE_COMPONENT => Ok(value),
            _ => Err(self.malformed(field, text, EXPECTED)),
        }
    }

    pub fn pose(&mut self, [x, y, theta]: [&'static str; 3]) -> Result<Pose2, Malformed> {
        Ok(Pose2::new(
            self.finite(Field::Named(x))?,
            self.finite(Field::Named(y))?,
            self.finite(Field::Named(theta))?,
        ))
    }

    /// [`RecordFields::stamp`]; `None` as well where the record ends before it.
    pub fn stamp_if_any(&mut self, field: Field) -> Result<Option<Stamp>, Malformed> {
        if self.remaining() == 0 { Ok(None) } else { self.stamp(field) }
    }

    /// A stamp; `None` for a number that is not a valid time (uninitialised memory) or is negative.
    pub fn stamp(&mut self, field: Field) -> Result<Option<Stamp>, Malformed> {
        const EXPECTED: &str = "a decimal number of seconds";
        let text = self.text(field, EXPECTED)?;
        match Stamp::parse_seconds(text) {
            Ok(stamp) => Ok((stamp.nanoseconds() >= 0).then_some(stamp)),
            Err(ParseStampError::Unusable) => Ok(None),
            Err(ParseStampError::NotANumber) => Err(self.malformed(field, text, EXPECTED)),
        }
    }
}

/// The value of `1.#INF`, `-1.#IND`, `1.#QNAN` or `-nan(ind)`.
fn no_number(text: &str) -> Option<f64> {
    let text = text.to_ascii_lowercase();
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text.strip_prefix('+').unwrap_or(&text)),
    };
    let kind = rest.strip_prefix("1.#").or_else(|| rest.strip_prefix("nan("))?;
    // The print format cuts off or pads the digits.
    if kind.starts_with("inf") {
        Some(sign * f64::INFINITY)
    } else {
        ["ind", "qnan", "snan"].iter().any(|name| kind.starts_with(name)).then_some(f64::NAN)
    }
}
