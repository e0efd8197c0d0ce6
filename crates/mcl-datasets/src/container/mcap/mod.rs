//! Reads the messages of one MCAP file, from its first byte to its last: chunked or not, with or without an
//! index, by which chunks without any wanted message are skipped.
//!
//! Records are framed here and not by the `mcap` crate, because its reader neither reports the offset of a
//! record nor keeps the readable part of a truncated chunk, and overflows on a record that is longer than its
//! uncompressed chunk (0.26).

mod fields;
mod records;
mod summary;

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::sync::Arc;

use mcap::records::op;

use crate::container::chunk::MAX_CHUNK_BYTES;
use crate::container::index::{self, Spans, Summary};
use crate::container::input::Counted;
use crate::container::item::{
    Channel, Container, Input, Item, Message, Passed, SchemaText, Visit, Wanted,
};
use crate::container::position::Position;
use crate::container::problem::{StreamError, StreamProblem};
use fields::BinaryFields;

/// MCAP, the default format of ROS 2 since 2023.
pub static CONTAINER: Container =
    Container { name: "MCAP", magic: mcap::MAGIC, ending: "mcap", storage: Some("mcap"), read };

fn read(input: Input<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    read_counted(Counted::new(input), visit)
}

/// Largest record accepted outside of chunks that is skipped unread (attachments), in bytes.
pub const MAX_SKIPPED_BYTES: u64 = 1 << 40;
/// A generous bound on the bytes of a chunk record before its content.
const CHUNK_HEADER_BYTES: u64 = 1 << 16;
/// Bytes of it that are read to skip a chunk.
const CHUNK_HEAD_BYTES: u64 = 64;
/// Opcode and length of a record.
const PREFIX_BYTES: usize = 9;

/// Reads an MCAP file and passes everything of use in it to `visit`, in the file's order.
///
/// A file that ends early is no error: everything before the cut is passed on, including that of a truncated
/// chunk, and the result says what is missing. Memory is bounded by [`MAX_CHUNK_BYTES`] for a compressed and
/// a decompressed chunk, and no length field leads to an allocation beyond the bytes that exist.
///
/// # Errors
/// [`StreamError`] with the offset, for a file that is not MCAP or is damaged; and the errors of `visit`.
pub fn read_stream(
    input: impl Read,
    mut visit: impl FnMut(Item<'_>) -> Result<(), StreamProblem>,
) -> Result<Option<String>, StreamError> {
    read_counted(Counted::of_stream(input), &mut |item| visit(item).map(|()| Wanted::Shown))
}

fn read_counted(input: Counted<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    let mut reader = Reader {
        input,
        channels: BTreeMap::new(),
        schemas: BTreeMap::new(),
        chunks: HashMap::new(),
        record_start: 0,
    };
    match reader.read(visit) {
        Ok(end) => Ok(end),
        Err(problem) => Err(StreamError { position: Position::Byte(reader.record_start), problem }),
    }
}

struct Reader<'a> {
    input: Counted<'a>,
    channels: BTreeMap<u16, (Channel, Wanted)>,
    schemas: BTreeMap<u16, Arc<SchemaText>>,
    /// The chunks by offset according to the summary of the file, where there is one and it is trusted.
    chunks: HashMap<u64, Summary>,
    /// Offset of the record being read.
    record_start: u64,
}

impl Reader<'_> {
    fn read(&mut self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamProblem> {
        let mut body = Vec::new();
        self.input.read_up_to(mcap::MAGIC.len() as u64, &mut body)?;
        if !mcap::MAGIC.starts_with(&body) {
            return Err(StreamProblem::Magic);
        }
        self.input.crc = Some(crc32fast::Hasher::new());
        self.input.crc.iter_mut().for_each(|crc| crc.update(&body));
        self.chunks = summary::read(&mut self.input)?.unwrap_or_default();
        let mut is_data_complete = false;
        loop {
            self.record_start = self.input.offset;
            let crc_before = self.input.crc.clone();
            body.clear();
            self.input.read_up_to(PREFIX_BYTES as u64, &mut body)?;
            let Some((opcode, length)) = prefix(&body) else {
                return Ok(Some(self.cut(is_data_complete, "the end of the bag is missing")));
            };
            let limit = match opcode {
                0 => return Err(StreamProblem::Opcode),
                op::CHUNK => MAX_CHUNK_BYTES + CHUNK_HEADER_BYTES,
                op::HEADER
                | op::SCHEMA
                | op::CHANNEL
                | op::MESSAGE
                | op::METADATA
                | op::DATA_END
                | op::FOOTER => MAX_CHUNK_BYTES,
                _ => MAX_SKIPPED_BYTES,
            };
            if length > limit {
                return Err(StreamProblem::RecordLength { opcode, length, limit });
            }
            if limit == MAX_SKIPPED_BYTES {
                if self.input.skip(length)? < length {
                    return Ok(Some(self.cut(is_data_complete, "it ends within a record")));
                }
                continue;
            }
            if opcode == op::CHUNK && self.pass(length, visit)? {
                continue;
            }
            body.clear();
            self.input.read_up_to(length, &mut body)?;
            let is_cut = (body.len() as u64) < length;
            if opcode == op::CHUNK {
                self.chunk(&body, is_cut, visit)?;
            }
            if is_cut {
                let what = match opcode {
                    op::CHUNK => {
                        format!("{} of the {length} bytes of its last chunk are there", body.len())
                    }
                    _ => "it ends within a record".to_owned(),
                };
                return Ok(Some(self.cut(is_data_complete, &what)));
            }
            match opcode {
                op::METADATA => {
                    let mut fields = BinaryFields::new("Metadata", &body);
                    let name = fields.text("name")?;
                    visit(Item::Metadata(name, &fields.map("metadata")?))?;
                }
                op::DATA_END => {
                    let declared = BinaryFields::new("DataEnd", &body).u32("data_section_crc")?;
                    let found = crc_before.map(|crc| crc.finalize());
                    if let Some(found) = found.filter(|found| declared != 0 && declared != *found) {
                        return Err(StreamProblem::DataCrc { declared, found });
                    }
                    is_data_complete = true;
                }
                op::FOOTER => return self.end(is_data_complete),
                op::CHUNK | op::HEADER => {}
                _ => self.record(opcode, &body, visit)?,
            }
        }
    }

    /// Schemas, channels and messages occur in chunks and outside of them.
    fn record(
        &mut self,
        opcode: u8,
        body: &[u8],
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        match opcode {
            op::SCHEMA => {
                let mut fields = BinaryFields::new("Schema", body);
                let id = fields.u16("id")?;
                let schema = SchemaText {
                    name: fields.text("name")?.to_owned(),
                    encoding: fields.text("encoding")?.to_owned(),
                    data: fields.blob("data")?.to_vec(),
                };
                match self.schemas.get(&id) {
                    Some(known) if **known != schema => {
                        return Err(StreamProblem::Conflict("Schema", u32::from(id)));
                    }
                    Some(_) => {}
                    None => drop(self.schemas.insert(id, Arc::new(schema))),
                }
            }
            op::CHANNEL => {
                let mut fields = BinaryFields::new("Channel", body);
                let id = fields.u16("id")?;
                let schema_id = fields.u16("schema_id")?;
                let topic = fields.text("topic")?.to_owned();
                let message_encoding = fields.text("message_encoding")?.to_owned();
                let schema = match schema_id {
                    0 => None,
                    _ => match self.schemas.get(&schema_id) {
                        Some(schema) => Some(schema.clone()),
                        None => {
                            return Err(StreamProblem::UnknownSchema { topic, schema: schema_id });
                        }
                    },
                };
                let channel = Channel { id: u32::from(id), topic, message_encoding, schema };
                match self.channels.get(&id) {
                    Some((known, _)) if *known != channel => {
                        return Err(StreamProblem::Conflict("Channel", u32::from(id)));
                    }
                    Some(_) => {}
                    None => {
                        let wanted = visit(Item::Channel(&channel))?;
                        self.channels.insert(id, (channel, wanted));
                    }
                }
            }
            op::MESSAGE => {
                let mut fields = BinaryFields::new("Message", body);
                let id = fields.u16("channel_id")?;
                let sequence = fields.u32("sequence")?;
                let log_time = fields.u64("log_time")?;
                let publish_time = fields.u64("publish_time")?;
                let (channel, wanted) = self
                    .channels
                    .get_mut(&id)
                    .ok_or(StreamProblem::UnknownChannel(u32::from(id)))?;
                *wanted = visit(Item::Message(Message {
                    channel,
                    sequence,
                    log_time,
                    publish_time,
                    data: fields.rest(),
                    position: Position::Byte(self.record_start),
                }))?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Skips a chunk of `length` bytes, if the summary says that nothing of it is wanted, and the records
    /// that follow the chunk agree.
    fn pass(&mut self, length: u64, visit: &mut Visit<'_>) -> Result<bool, StreamProblem> {
        let Some(summary) = self.chunks.remove(&self.record_start) else { return Ok(false) };
        let channel = |id: &u32| self.channels.get(&u16::try_from(*id).ok()?);
        let is_counted =
            |id: &u32| channel(id).is_some_and(|(_, wanted)| *wanted == Wanted::Counted);
        if summary.counts.is_empty() || !summary.counts.keys().all(is_counted) {
            return Ok(false);
        }
        let start = self.input.offset;
        let head = self.input.peek(start, CHUNK_HEAD_BYTES.min(length))?;
        let (log_times, plain) = records::head(&head).unwrap_or_default();
        // A checksum of the data would need all of it.
        self.input.crc = None;
        let is_there = self.input.skip(length)? == length;
        let spans = if is_there { self.spans()? } else { None };
        let mut agrees = log_times == summary.log_times
            && spans.as_ref().is_some_and(|spans| spans.agree(&summary));
        for (&id, span) in spans.iter().flat_map(|spans| &spans.0) {
            let Some(plain) = plain.filter(|_| agrees) else { break };
            let (offset, time) = span.sample;
            let at = start.saturating_add(plain).saturating_add(offset);
            let bytes = self.input.peek(at, summary::MESSAGE_HEAD_BYTES)?;
            agrees &= summary::message(&bytes) == Some((id, time));
        }
        let Some(spans) = spans.filter(|_| agrees) else {
            index::distrust(&mut self.input, &mut self.chunks, start, visit)?;
            return Ok(false);
        };
        for (id, span) in spans.0 {
            let known = u16::try_from(id).ok().and_then(|id| self.channels.get_mut(&id));
            let (channel, wanted) = known.ok_or(StreamProblem::UnknownChannel(id))?;
            let (count, log_times) = (span.count, span.log_times);
            *wanted = visit(Item::Passed(Passed { channel, count, log_times }))?;
        }
        Ok(true)
    }

    /// The content of a chunk according to the index records that follow it; `None` where they are damaged.
    /// The input is advanced to their end.
    fn spans(&mut self) -> Result<Option<Spans>, StreamProblem> {
        let mut spans = Spans::default();
        let mut body = Vec::new();
        loop {
            let start = self.input.offset;
            body.clear();
            self.input.read_up_to(PREFIX_BYTES as u64, &mut body)?;
            let length = match prefix(&body) {
                Some((op::MESSAGE_INDEX, length)) if length <= MAX_CHUNK_BYTES => length,
                Some((op::MESSAGE_INDEX, _)) | None => return Ok(None),
                Some(_) => {
                    self.input.seek(start)?;
                    return Ok(Some(spans));
                }
            };
            body.clear();
            self.input.read_up_to(length, &mut body)?;
            if body.len() as u64 != length || !summary::add_entries(&body, &mut spans) {
                return Ok(None);
            }
        }
    }

    fn chunk(
        &mut self,
        body: &[u8],
        is_cut: bool,
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let records = match records::of(body, is_cut) {
            // The cut is in the chunk's own fields: nothing of it can be read.
            Err(StreamProblem::Record(_)) if is_cut => return Ok(()),
            other => other?,
        };
        let mut rest = &*records;
        while let Some((opcode, length)) = prefix(rest) {
            let body = &rest[PREFIX_BYTES..];
            let Some((body, after)) =
                usize::try_from(length).ok().and_then(|length| body.split_at_checked(length))
            else {
                let there = body.len();
                return match is_cut {
                    true => Ok(()),
                    false => Err(StreamProblem::RecordInChunk { opcode, length, there }),
                };
            };
            self.record(opcode, body, visit)?;
            rest = after;
        }
        match rest.first() {
            Some(&opcode) if !is_cut => {
                Err(StreamProblem::RecordInChunk { opcode, length: 0, there: rest.len() })
            }
            _ => Ok(()),
        }
    }

    /// Handles what follows the footer.
    fn end(&mut self, is_data_complete: bool) -> Result<Option<String>, StreamProblem> {
        let mut magic = Vec::new();
        self.input.read_up_to(mcap::MAGIC.len() as u64 + 1, &mut magic)?;
        if magic.len() > mcap::MAGIC.len() && magic.starts_with(mcap::MAGIC) {
            let offset = self.input.offset - 1;
            return Ok(Some(format!(
                "the bag ends at byte {offset}, what comes after is not read"
            )));
        }
        Ok((magic != mcap::MAGIC)
            .then(|| self.cut(is_data_complete, "the magic bytes at its end are missing")))
    }

    fn cut(&self, is_data_complete: bool, what: &str) -> String {
        let offset = self.input.offset;
        let kept = match is_data_complete {
            true => "all messages come before",
            false => "the messages up to there are used",
        };
        match &self.input.damaged {
            Some(reason) => format!("{reason} after {offset} unpacked bytes; {kept}"),
            None => format!("the file ends at byte {offset}, {what}; {kept}"),
        }
    }
}

/// Opcode and length of the record at the start of `bytes`.
fn prefix(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&[opcode], rest) = bytes.split_first_chunk()?;
    let (&length, _) = rest.split_first_chunk()?;
    Some((opcode, u64::from_le_bytes(length)))
}
