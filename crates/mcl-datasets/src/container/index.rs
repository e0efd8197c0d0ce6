//! The index of a file, by which chunks without any wanted message are skipped. It is trusted only where two
//! places of the file agree: its summary, and the records that follow each chunk.

use std::collections::{BTreeMap, HashMap};

use super::input::Counted;
use super::item::{Item, Visit};
use super::problem::StreamProblem;

/// The note where the index is wrong.
const NOTE: &str = "the index of the bag does not say what is in it, so all of it is read";

/// Seeks back to the chunk that begins at `start`, where the index turned out wrong, and stops trusting the
/// index.
pub(super) fn distrust(
    input: &mut Counted<'_>,
    chunks: &mut HashMap<u64, Summary>,
    start: u64,
    visit: &mut Visit<'_>,
) -> Result<(), StreamProblem> {
    input.seek(start)?;
    chunks.clear();
    visit(Item::Note(NOTE)).map(|_| ())
}

/// Messages of one channel in a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Span {
    pub count: usize,
    /// Log times of the first and the last of them, in nanoseconds.
    pub log_times: (u64, u64),
    /// Offset of one of them in the decompressed chunk, and its log time.
    pub sample: (u64, u64),
}

/// A chunk in the summary of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Summary {
    /// Log times of the first and the last of its messages, in nanoseconds.
    pub log_times: (u64, u64),
    /// Its channels with the number of messages, where it is stated.
    pub counts: BTreeMap<u32, Option<usize>>,
}

/// The messages of a chunk by channel, according to the records that follow it.
#[derive(Debug, Default)]
pub(super) struct Spans(pub BTreeMap<u32, Span>);

impl Spans {
    /// Adds entries of a channel: log time and offset of each message.
    pub fn add(&mut self, channel: u32, entries: impl Iterator<Item = (u64, u64)>) {
        for (time, offset) in entries {
            let one = Span { count: 0, log_times: (time, time), sample: (offset, time) };
            let span = self.0.entry(channel).or_insert(one);
            span.count += 1;
            let (first, last) = span.log_times;
            span.log_times = (first.min(time), last.max(time));
        }
    }

    /// Whether the summary agrees.
    pub fn agree(&self, summary: &Summary) -> bool {
        let first = self.0.values().map(|span| span.log_times.0).min();
        let last = self.0.values().map(|span| span.log_times.1).max();
        let is_counted = |(channel, count): (&u32, &Option<usize>)| {
            let found = self.0.get(channel);
            found.is_some_and(|span| count.is_none_or(|count| span.count == count))
        };
        first.zip(last) == Some(summary.log_times)
            && self.0.len() == summary.counts.len()
            && summary.counts.iter().all(is_counted)
    }
}
