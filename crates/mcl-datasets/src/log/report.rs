//! What a reader did not use of a log, and where.

use std::collections::BTreeMap;
use std::fmt;

use mcl_core::text::counted;

use crate::container::position::Position;

/// Skipped records described in full in a [`ReadReport`]; further ones are only counted.
const SKIPPED_DETAILS: usize = 20;

/// What a reader did not use of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadReport {
    /// Records of kinds that are not read (CARMEN: `NEFF`, `SYNC`, `RLASER`, …; bags: messages of
    /// other types); nothing is lost.
    pub ignored: usize,
    /// Their counts by kind, for a bag by topic.
    pub ignored_kinds: BTreeMap<String, usize>,
    /// Malformed records of kinds that are read; their content is lost.
    pub skipped: usize,
    /// The first 20 skipped records.
    pub skipped_details: Vec<SkippedRecord>,
    /// Scans whose stamp is not a valid time (uninitialised, negative); they are kept without stamp.
    pub unusable_stamps: usize,
    /// Contradictions and guesses, a line each, that may make results wrong.
    pub doubts: Vec<String>,
    /// Why the log ends early, when a bag or compressed data is truncated or damaged; the part before is
    /// kept.
    pub truncated: Option<String>,
}

impl ReadReport {
    /// Whether every record of a known kind was read, with nothing skipped, truncated or in doubt.
    pub fn is_complete(&self) -> bool {
        self.skipped == 0 && self.truncated.is_none() && self.doubts.is_empty()
    }

    pub(crate) fn skip(&mut self, record: SkippedRecord) {
        self.skipped += 1;
        if self.skipped_details.len() < SKIPPED_DETAILS {
            self.skipped_details.push(record);
        }
    }
}

/// One line on the totals that are not zero, then one per described skipped record unlike those before it and
/// per doubt, then why the log ends early; empty where there is nothing to report.
impl fmt::Display for ReadReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines: Vec<String> = Vec::new();
        let totals = [
            (self.ignored, "ignored record"),
            (self.skipped, "skipped record"),
            (self.unusable_stamps, "unusable stamp"),
        ];
        let totals = totals.into_iter().filter(|(number, _)| *number > 0);
        let totals: Vec<String> = totals.map(|(number, what)| counted(number, what)).collect();
        if !totals.is_empty() {
            lines.push(totals.join(", "));
        }
        let mut unlike: Vec<&SkippedRecord> = Vec::new();
        for record in &self.skipped_details {
            if !unlike.iter().any(|earlier| earlier.is_like(record)) {
                unlike.push(record);
            }
        }
        lines.extend(unlike.iter().map(ToString::to_string));
        let more = self.skipped.saturating_sub(unlike.len());
        if more > 0 {
            lines.push(format!("… and {more} more"));
        }
        lines.extend(self.doubts.iter().map(|doubt| format!("in doubt: {doubt}")));
        lines.extend(self.truncated.iter().map(|reason| format!("the log ends early: {reason}")));
        f.write_str(&lines.join("\n"))
    }
}

/// The position of a record in its log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RecordPlace {
    /// Line of a text, from 1.
    Line(usize),
    /// Row of a table.
    At(Position),
    /// Message of a bag.
    Message {
        /// Its topic.
        topic: String,
        /// Log time, in nanoseconds.
        log_time: u64,
        /// Position in its file.
        position: Position,
    },
}

impl fmt::Display for RecordPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RecordPlace::Line(line) => write!(f, "line {line}"),
            RecordPlace::At(position) => position.fmt(f),
            RecordPlace::Message { topic, log_time, position } => {
                let (seconds, rest) = (log_time / 1_000_000_000, log_time % 1_000_000_000);
                write!(f, "{topic} at {seconds}.{rest:09} s ({position})")
            }
        }
    }
}

/// A malformed record: its position, and what is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SkippedRecord {
    /// Its position.
    pub place: RecordPlace,
    /// Kind of the record (`FLASER`), or type of the message.
    pub record: String,
    /// Name of the field at fault.
    pub field: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

impl SkippedRecord {
    /// Whether the same is wrong with another record.
    fn is_like(&self, other: &Self) -> bool {
        let SkippedRecord { place: _, record, field, found, expected } = other;
        (&self.record, &self.field, &self.found, &self.expected) == (record, field, found, expected)
    }
}

impl fmt::Display for SkippedRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SkippedRecord { place, record, field, found, expected } = self;
        write!(f, "{place}: {record} skipped: {field} is {found}, expected {expected}")
    }
}
