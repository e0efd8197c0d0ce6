//! The index of an MCAP file: the summary at its end, and the records that follow each chunk.

use std::collections::HashMap;

use mcap::records::op;

use super::fields::BinaryFields;
use super::{PREFIX_BYTES, prefix};
use crate::container::index::{Spans, Summary};
use crate::container::input::Counted;
use crate::container::problem::{BadRecord, StreamProblem};

/// Longest summary accepted, in bytes: that of a bag of some terabytes.
const MAX_SUMMARY_BYTES: u64 = 256 << 20;
/// The footer with its opcode and length, and the magic bytes after it.
const END_BYTES: u64 = PREFIX_BYTES as u64 + 20 + mcap::MAGIC.len() as u64;

/// Opcode and length of a message record, and its fields before the message.
pub(super) const MESSAGE_HEAD_BYTES: u64 = PREFIX_BYTES as u64 + 22;

/// The chunks of a file by offset; `None` where it has no summary, or an incomplete one.
pub(super) fn read(
    input: &mut Counted<'_>,
) -> Result<Option<HashMap<u64, Summary>>, StreamProblem> {
    let Some(end) = input.length().and_then(|length| length.checked_sub(END_BYTES)) else {
        return Ok(None);
    };
    let footer = input.peek(end, END_BYTES)?;
    let Some((op::FOOTER, 20)) = prefix(&footer) else { return Ok(None) };
    let start = BinaryFields::new("Footer", &footer[PREFIX_BYTES..]).u64("summary_start")?;
    let length = end.saturating_sub(start);
    if start == 0 || length > MAX_SUMMARY_BYTES {
        return Ok(None);
    }
    let bytes = input.peek(start, length)?;
    let mut rest = bytes.as_slice();
    let (mut chunks, mut expected) = (HashMap::new(), None);
    while let Some((opcode, length)) = prefix(rest) {
        let whole = usize::try_from(length).ok();
        let Some((body, after)) =
            whole.and_then(|length| rest[PREFIX_BYTES..].split_at_checked(length))
        else {
            return Ok(None);
        };
        match opcode {
            op::CHUNK_INDEX => match chunk(body) {
                Ok((at, summary)) => drop(chunks.insert(at, summary)),
                Err(_) => return Ok(None),
            },
            op::STATISTICS => expected = statistics(body).ok(),
            _ => {}
        }
        rest = after;
    }
    let is_whole = rest.is_empty() && expected.is_none_or(|count| count as usize == chunks.len());
    Ok(is_whole.then_some(chunks))
}

fn chunk(body: &[u8]) -> Result<(u64, Summary), BadRecord> {
    let mut fields = BinaryFields::new("ChunkIndex", body);
    let log_times = (fields.u64("message_start_time")?, fields.u64("message_end_time")?);
    let at = fields.u64("chunk_start_offset")?;
    fields.u64("chunk_length")?;
    let (offsets, _) = fields.blob("message_index_offsets")?.as_chunks::<10>();
    let channel = |offset: &[u8; 10]| (u32::from(u16::from_le_bytes([offset[0], offset[1]])), None);
    Ok((at, Summary { log_times, counts: offsets.iter().map(channel).collect() }))
}

/// Number of chunks.
fn statistics(body: &[u8]) -> Result<u32, BadRecord> {
    let mut fields = BinaryFields::new("Statistics", body);
    fields.u64("message_count")?;
    fields.u16("schema_count")?;
    for field in ["channel_count", "attachment_count", "metadata_count"] {
        fields.u32(field)?;
    }
    fields.u32("chunk_count")
}

/// Adds the entries of a message index record; returns whether it is one.
pub(super) fn add_entries(body: &[u8], spans: &mut Spans) -> bool {
    let mut fields = BinaryFields::new("MessageIndex", body);
    let (Ok(id), Ok(entries)) = (fields.u16("channel_id"), fields.blob("records")) else {
        return false;
    };
    let (entries, rest) = entries.as_chunks::<16>();
    let number = |bytes: &[u8]| bytes.first_chunk().map_or(0, |&bytes| u64::from_le_bytes(bytes));
    spans.add(u32::from(id), entries.iter().map(|entry| (number(entry), number(&entry[8..]))));
    rest.is_empty()
}

/// Channel and log time of the message at the start of `bytes`.
pub(super) fn message(bytes: &[u8]) -> Option<(u32, u64)> {
    let (op::MESSAGE, _) = prefix(bytes)? else { return None };
    let mut fields = BinaryFields::new("Message", &bytes[PREFIX_BYTES..]);
    let id = fields.u16("channel_id").ok()?;
    fields.u32("sequence").ok()?;
    Some((u32::from(id), fields.u64("log_time").ok()?))
}
