//! ROS 1 bags, version 2.0: chunked or not, compressed or not, with or without an index, by which chunks
//! without any wanted message are skipped.
//!
//! A record is a header (fields `name=value`) and data, each after its length. Chunks hold records of
//! connections (topics, with the description of their messages) and messages; index records follow each chunk
//! and also come at the end. A recorder that is stopped leaves a last chunk without its length, and no index.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use super::chunk::{Compression, MAX_CHUNK_BYTES, unpack};
use super::index::{self, Spans, Summary};
use super::input::Counted;
use super::item::{Channel, Container, Input, Item, Message, Passed, SchemaText, Visit, Wanted};
use super::position::Position;
use super::problem::{BadRecord, StreamError, StreamProblem};

/// Bags of ROS 1.
pub static CONTAINER: Container =
    Container { name: "ROS 1 bag", magic: MAGIC, ending: "bag", storage: None, read };

/// The first bytes of a bag of version 2.0.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Longest header of a record accepted, in bytes; real ones take about a hundred.
const MAX_HEADER_BYTES: u64 = 1 << 20;
/// Longest data accepted of records that are skipped unread: the index of a chunk.
const MAX_SKIPPED_BYTES: u64 = u32::MAX as u64;
/// Longest index accepted, in bytes: that of a bag of some terabytes.
const MAX_INDEX_BYTES: u64 = 256 << 20;

// Kinds of records, the field `op` of their headers.
pub(crate) const MESSAGE: u8 = 2;
pub(crate) const BAG_HEADER: u8 = 3;
pub(crate) const INDEX: u8 = 4;
pub(crate) const CHUNK: u8 = 5;
pub(crate) const CHUNK_INFO: u8 = 6;
pub(crate) const CONNECTION: u8 = 7;

fn read(input: Input<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    let mut reader = Reader {
        input: Counted::new(input),
        connections: BTreeMap::new(),
        chunks: HashMap::new(),
        has_counted: false,
        index_start: 0,
        expected_chunks: 0,
        expected_in_index: 0,
        found_in_index: 0,
        chunks_seen: BTreeSet::new(),
        tail: Tail::default(),
        misplaced: None,
        has_open_chunk: false,
        record_start: 0,
    };
    reader
        .read(visit)
        .map_err(|problem| StreamError { position: Position::Byte(reader.record_start), problem })
}

/// A topic of one publisher, and the number of messages so far.
struct Connection {
    channel: Channel,
    messages: u32,
    wanted: Wanted,
}

impl Connection {
    /// Passes on how many messages were skipped.
    fn pass(
        &mut self,
        count: usize,
        log_times: (u64, u64),
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        self.messages = self.messages.wrapping_add(count as u32);
        let channel = &self.channel;
        self.wanted = visit(Item::Passed(Passed { channel, count, log_times }))?;
        Ok(())
    }
}

struct Reader<'a> {
    input: Counted<'a>,
    connections: BTreeMap<u32, Connection>,
    /// The chunks by offset according to the index at the end, where it can be read and is trusted.
    chunks: HashMap<u64, Summary>,
    /// Whether there are messages that are not wanted.
    has_counted: bool,
    /// Offset of the index at the end; 0 if the bag was never closed.
    index_start: u64,
    expected_chunks: u64,
    expected_in_index: u64,
    found_in_index: u64,
    /// Offsets of the chunks.
    chunks_seen: BTreeSet<u64>,
    tail: Tail,
    /// An offset at which the index has a chunk and the file has none.
    misplaced: Option<u64>,
    /// Whether a chunk without a length was seen, whose records follow uncompressed.
    has_open_chunk: bool,
    /// Offset of the record being read.
    record_start: u64,
}

/// The index records that follow the last chunk.
#[derive(Default)]
struct Tail {
    start: u64,
    connections: u64,
    chunks: u64,
}

/// What a piece of a file is read up to.
enum Piece {
    Whole,
    Cut,
}

impl Reader<'_> {
    /// Reads the file to its end; where only the index behind all chunks is damaged, nothing is lost.
    fn read(&mut self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamProblem> {
        match self.records(visit) {
            Err(StreamProblem::RecordLength { .. } | StreamProblem::Record(_))
                if self.is_in_index()
                    && self.expected_chunks > 0
                    && self.chunks_seen.len() as u64 == self.expected_chunks =>
            {
                let place = self.record_start;
                visit(Item::Note(&format!(
                    "the index of the bag is damaged at byte {place}; all messages come before"
                )))?;
                Ok(None)
            }
            outcome => outcome,
        }
    }

    fn records(&mut self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamProblem> {
        let mut magic = Vec::new();
        self.input.read_up_to(MAGIC.len() as u64, &mut magic)?;
        if !MAGIC.starts_with(&magic) {
            return Err(StreamProblem::Magic);
        }
        let (mut header, mut data) = (Vec::new(), Vec::new());
        loop {
            self.record_start = self.input.offset;
            let length = match self.length()? {
                Some(length) => length,
                None if self.input.offset == self.record_start => return self.end(visit),
                None => return Ok(Some(self.cut("it ends within a record"))),
            };
            if length > MAX_HEADER_BYTES {
                if self.has_open_chunk {
                    return Ok(Some(self.cut("its last chunk was never finished")));
                }
                let limit = MAX_HEADER_BYTES;
                return Err(StreamProblem::RecordLength { opcode: 0, length, limit });
            }
            if let Piece::Cut = self.piece(length, &mut header)? {
                return Ok(Some(self.cut("it ends within a record")));
            }
            let Some(length) = self.length()? else {
                return Ok(Some(self.cut("it ends within a record")));
            };
            let opcode = match fields(&header).and_then(|fields| fields.opcode()) {
                Ok(opcode) => opcode,
                Err(_) if self.has_open_chunk => {
                    return Ok(Some(self.cut("its last chunk was never finished")));
                }
                Err(error) => return Err(error.into()),
            };
            let is_skipped = matches!(opcode, BAG_HEADER | INDEX | CHUNK_INFO);
            let limit = if is_skipped { MAX_SKIPPED_BYTES } else { MAX_CHUNK_BYTES };
            if length > limit {
                return Err(StreamProblem::RecordLength { opcode, length, limit });
            }
            if opcode == CHUNK {
                self.has_open_chunk = length == 0;
                self.chunks_seen.insert(self.record_start);
                self.tail = Tail::default();
                let passed = match self.is_plain(&fields(&header)?, length) {
                    true => {
                        self.plain_chunk(length, visit)?;
                        true
                    }
                    false => self.pass(length, visit)?,
                };
                if passed {
                    continue;
                }
            }
            let piece = match is_skipped {
                true => match self.input.skip(length)? < length {
                    true => Piece::Cut,
                    false => Piece::Whole,
                },
                false => self.piece(length, &mut data)?,
            };
            let is_cut = matches!(piece, Piece::Cut);
            let fields = fields(&header)?;
            match opcode {
                BAG_HEADER => self.bag_header(&fields)?,
                CHUNK => self.chunk(&fields, &data, is_cut, visit)?,
                CONNECTION | MESSAGE if !is_cut => self.record(opcode, &fields, &data, visit)?,
                _ => {}
            }
            if is_cut {
                let what = match opcode {
                    CHUNK => {
                        format!("{} of the {length} bytes of its last chunk are there", data.len())
                    }
                    _ => "it ends within a record".to_owned(),
                };
                return Ok(Some(self.cut(&what)));
            }
            if matches!(opcode, CONNECTION | CHUNK_INFO) {
                self.found_in_index += u64::from(self.is_in_index());
                if self.tail.connections + self.tail.chunks == 0 {
                    self.tail.start = self.record_start;
                }
                self.tail.connections += u64::from(opcode == CONNECTION);
            }
            if opcode == CHUNK_INFO {
                self.tail.chunks += 1;
                let place = fields.array("chunk_pos").map(u64::from_le_bytes).ok();
                let is_lost = |place: &u64| !self.chunks_seen.contains(place);
                self.misplaced = self.misplaced.or(place.filter(is_lost));
            }
        }
    }

    fn is_in_index(&self) -> bool {
        self.index_start > 0 && self.record_start >= self.index_start
    }

    /// The length of what follows; `None` where the file ends.
    fn length(&mut self) -> Result<Option<u64>, StreamProblem> {
        let mut bytes = Vec::new();
        self.input.read_up_to(4, &mut bytes)?;
        Ok(bytes.first_chunk().map(|&bytes| u64::from(u32::from_le_bytes(bytes))))
    }

    fn piece(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<Piece, StreamProblem> {
        bytes.clear();
        self.input.read_up_to(length, bytes)?;
        Ok(if (bytes.len() as u64) < length { Piece::Cut } else { Piece::Whole })
    }

    fn bag_header(&mut self, fields: &HeaderFields<'_>) -> Result<(), StreamProblem> {
        if let Some(encryptor) = fields.find("encryptor").filter(|name| !name.is_empty())
            && encryptor != b"rosbag/NoEncryptor"
        {
            return Err(StreamProblem::Encrypted(String::from_utf8_lossy(encryptor).into_owned()));
        }
        self.index_start = u64::from_le_bytes(fields.array("index_pos")?);
        let count = |name| fields.u32(name).map(u64::from);
        self.expected_chunks = count("chunk_count")?;
        self.expected_in_index = count("conn_count")? + self.expected_chunks;
        if self.record_start == MAGIC.len() as u64 {
            self.chunks = self.summaries(self.expected_chunks)?.unwrap_or_default();
        }
        Ok(())
    }

    /// The chunks according to the index at the end of the file; `None` where it cannot be read or is
    /// incomplete.
    fn summaries(&mut self, count: u64) -> Result<Option<HashMap<u64, Summary>>, StreamProblem> {
        let length = self.input.length().unwrap_or(0).saturating_sub(self.index_start);
        if self.index_start == 0 || length > MAX_INDEX_BYTES {
            return Ok(None);
        }
        let bytes = self.input.peek(self.index_start, length)?;
        let mut rest = bytes.as_slice();
        let mut chunks = HashMap::new();
        while let Some((header, data, after)) = record(rest) {
            rest = after;
            let Some((at, summary)) = fields(header).ok().and_then(|info| summary(&info, data))
            else {
                continue;
            };
            chunks.insert(at, summary);
        }
        Ok((rest.is_empty() && chunks.len() as u64 == count).then_some(chunks))
    }

    /// Skips a compressed chunk, if the index says that nothing of it is wanted, and the records that follow
    /// the chunk agree.
    fn pass(&mut self, length: u64, visit: &mut Visit<'_>) -> Result<bool, StreamProblem> {
        let Some(summary) = self.chunks.remove(&self.record_start) else { return Ok(false) };
        let is_counted = |id: &u32| {
            self.connections.get(id).is_some_and(|known| known.wanted == Wanted::Counted)
        };
        if summary.counts.is_empty() || !summary.counts.keys().all(is_counted) {
            return Ok(false);
        }
        let start = self.input.offset;
        let is_there = self.input.skip(length)? == length;
        let spans = if is_there { self.spans()? } else { None };
        let agrees = spans.as_ref().is_some_and(|spans| spans.agree(&summary));
        let Some(spans) = spans.filter(|_| agrees) else {
            index::distrust(&mut self.input, &mut self.chunks, start, visit)?;
            return Ok(false);
        };
        for (id, span) in spans.0 {
            let connection =
                self.connections.get_mut(&id).ok_or(StreamProblem::UnknownChannel(id))?;
            connection.pass(span.count, span.log_times, visit)?;
        }
        Ok(true)
    }

    /// Whether a chunk is uncompressed, complete, and in a file of which not everything is wanted.
    fn is_plain(&self, chunk: &HeaderFields<'_>, length: u64) -> bool {
        let end = self.input.offset.saturating_add(length);
        chunk.find("compression") == Some(b"none")
            && chunk.u32("size").map(u64::from) == Ok(length)
            && self.input.length().is_some_and(|there| end <= there)
            && self.has_counted
    }

    /// Reads the records of such a chunk, skipping the messages that are not wanted.
    fn plain_chunk(&mut self, length: u64, visit: &mut Visit<'_>) -> Result<(), StreamProblem> {
        let end = self.input.offset + length;
        let (mut header, mut data) = (Vec::new(), Vec::new());
        while self.input.offset < end {
            let there = end - self.input.offset;
            let cut = StreamProblem::CutInChunk { there: there as usize };
            // Each part is preceded by its length.
            let Some(header_length) = self.length()?.filter(|length| length + 8 <= there) else {
                return Err(cut);
            };
            self.piece(header_length, &mut header)?;
            let whole = |length: &u64| header_length + length + 8 <= there;
            let Some(length) = self.length()?.filter(whole) else { return Err(cut) };
            let fields = chunk_fields(&header)?;
            let counted = fields.message().and_then(|(id, log_time)| {
                let known = self.connections.get_mut(&id)?;
                (known.wanted == Wanted::Counted).then_some((known, log_time))
            });
            match counted {
                Some((known, log_time)) => {
                    self.input.skip(length)?;
                    known.pass(1, (log_time, log_time), visit)?;
                }
                None => {
                    self.piece(length, &mut data)?;
                    self.record(fields.opcode()?, &fields, &data, visit)?;
                }
            }
        }
        Ok(())
    }

    /// The content of a chunk according to the index records that follow it; `None` where they are damaged.
    /// The input is advanced to their end.
    fn spans(&mut self) -> Result<Option<Spans>, StreamProblem> {
        let mut spans = Spans::default();
        let (mut header, mut data) = (Vec::new(), Vec::new());
        loop {
            let start = self.input.offset;
            match self.length()? {
                Some(length) if length <= MAX_HEADER_BYTES => self.piece(length, &mut header)?,
                _ => return Ok(None),
            };
            let Ok(fields) = fields(&header) else { return Ok(None) };
            if fields.opcode() != Ok(INDEX) {
                self.input.seek(start)?;
                return Ok(Some(spans));
            }
            match self.length()? {
                Some(length) if length <= MAX_CHUNK_BYTES => self.piece(length, &mut data)?,
                _ => return Ok(None),
            };
            let (entries, rest) = data.as_chunks::<12>();
            let Ok(id) = fields.u32("conn") else { return Ok(None) };
            if !rest.is_empty() || fields.u32("count") != Ok(entries.len() as u32) {
                return Ok(None);
            }
            spans.add(
                id,
                entries.iter().filter_map(|entry| {
                    let (&time, offset) = entry.split_first_chunk()?;
                    Some((nanoseconds(time), u64::from(u32::from_le_bytes(*offset.first_chunk()?))))
                }),
            );
        }
    }

    fn chunk(
        &mut self,
        fields: &HeaderFields<'_>,
        packed: &[u8],
        is_cut: bool,
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let size = u64::from(fields.u32("size")?);
        let compression = match fields.text("compression")? {
            "none" => Compression::None,
            "bz2" => Compression::Bzip2,
            "lz4" => Compression::Lz4,
            other => {
                let (found, expected) = (other.to_owned(), "none, bz2 or lz4");
                return Err(StreamProblem::UnknownCompression { found, expected });
            }
        };
        if packed.is_empty() {
            return Ok(());
        }
        let records = unpack(compression, packed, size, is_cut)?;
        let mut rest = &*records;
        while !rest.is_empty() {
            let Some((header, data, after)) = record(rest) else {
                let there = rest.len();
                return match is_cut {
                    true => Ok(()),
                    false => Err(StreamProblem::CutInChunk { there }),
                };
            };
            let fields = chunk_fields(header)?;
            self.record(fields.opcode()?, &fields, data, visit)?;
            rest = after;
        }
        Ok(())
    }

    fn record(
        &mut self,
        opcode: u8,
        fields: &HeaderFields<'_>,
        data: &[u8],
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let id = fields.u32("conn")?;
        if opcode == CONNECTION {
            let topic = fields.text("topic")?.to_owned();
            // The publisher's own header, laid out like that of a record.
            let described = self::fields(data)?;
            let schema = SchemaText {
                name: described.text("type")?.to_owned(),
                encoding: "ros1msg".to_owned(),
                data: described.find("message_definition").unwrap_or_default().to_vec(),
            };
            let message_encoding = "ros1".to_owned();
            let channel = Channel { id, topic, message_encoding, schema: Some(Arc::new(schema)) };
            match self.connections.get(&id) {
                Some(known) if known.channel != channel => {
                    return Err(StreamProblem::Conflict("Connection", id));
                }
                Some(_) => {}
                None => {
                    let wanted = visit(Item::Channel(&channel))?;
                    self.has_counted |= wanted == Wanted::Counted;
                    self.connections.insert(id, Connection { channel, messages: 0, wanted });
                }
            }
            return Ok(());
        }
        let log_time = nanoseconds(fields.array("time")?);
        let connection = self.connections.get_mut(&id).ok_or(StreamProblem::UnknownChannel(id))?;
        let sequence = connection.messages;
        connection.messages = sequence.wrapping_add(1);
        connection.wanted = visit(Item::Message(Message {
            channel: &connection.channel,
            sequence,
            log_time,
            publish_time: log_time,
            data,
            position: Position::Byte(self.record_start),
        }))?;
        self.has_counted |= connection.wanted == Wanted::Counted;
        Ok(())
    }

    /// At the end of the file, where no record is truncated.
    fn end(&self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamProblem> {
        let Tail { start, connections, chunks } = self.tail;
        let is_whole = chunks > 0
            && chunks >= self.expected_chunks
            && connections + chunks >= self.expected_in_index;
        if self.input.damaged.is_some() || !is_whole {
            return Ok(self.missing());
        }
        let misplaced = self.misplaced.map(|place| ("a chunk", place));
        let index = Some(("the index", self.index_start)).filter(|&(_, place)| place != start);
        if let Some((what, place)) = misplaced.or(index) {
            let is_beyond = place >= self.input.offset;
            let reason =
                if is_beyond { "beyond the end of the file" } else { "where there is none" };
            visit(Item::Note(&format!(
                "the index of the bag is damaged: {what} is said to be at byte {place}, {reason}; the bag was read record by record"
            )))?;
        }
        Ok(None)
    }

    /// Why the bag ends early, where not all of its index is behind its chunks.
    fn missing(&self) -> Option<String> {
        if self.input.damaged.is_none() && self.found_in_index >= self.expected_in_index {
            match self.index_start {
                0 if self.input.offset == MAGIC.len() as u64 => {}
                0 => {
                    let offset = self.input.offset;
                    return Some(format!(
                        "the bag was never closed: it has no index, and ends at byte {offset}; the messages up to there are used"
                    ));
                }
                start if self.record_start >= start => return None,
                _ => {}
            }
        }
        Some(self.cut("the end of the bag is missing"))
    }

    fn cut(&self, what: &str) -> String {
        let offset = self.input.offset;
        let kept = match self.is_in_index() {
            true => "all messages come before",
            false => "the messages up to there are used",
        };
        match &self.input.damaged {
            Some(reason) => format!("{reason} after {offset} unpacked bytes; {kept}"),
            None => format!("the file ends at byte {offset}, {what}; {kept}"),
        }
    }
}

/// The fields of a header: its bytes, checked to be well formed.
struct HeaderFields<'a>(&'a [u8]);

/// Fields `name=value`, each after its length.
fn fields(header: &[u8]) -> Result<HeaderFields<'_>, BadRecord> {
    let mut rest = header;
    while !rest.is_empty() {
        let (field, after) = blob(rest).ok_or(BadRecord::new(
            "Header",
            "length of a field",
            "longer than the header",
        ))?;
        if !field.contains(&b'=') {
            return Err(BadRecord::new("Header", "field", "without \"=\""));
        }
        rest = after;
    }
    Ok(HeaderFields(header))
}

/// The fields of a record in a chunk.
fn chunk_fields(header: &[u8]) -> Result<HeaderFields<'_>, BadRecord> {
    let fields = fields(header)?;
    match fields.opcode()? {
        CONNECTION | MESSAGE => Ok(fields),
        _ => Err(BadRecord::new("Chunk", "op", "neither a connection nor a message")),
    }
}

impl<'a> HeaderFields<'a> {
    fn find(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while let Some((field, after)) = blob(rest) {
            if let Some(value) =
                field.strip_prefix(name.as_bytes()).and_then(|end| end.strip_prefix(b"="))
            {
                return Some(value);
            }
            rest = after;
        }
        None
    }

    fn array<const N: usize>(&self, name: &'static str) -> Result<[u8; N], BadRecord> {
        let value = self.find(name).ok_or(BadRecord::new("Header", name, "missing"))?;
        value.try_into().map_err(|_| BadRecord::new("Header", name, "of another length"))
    }

    fn text(&self, name: &'static str) -> Result<&'a str, BadRecord> {
        let value = self.find(name).ok_or(BadRecord::new("Header", name, "missing"))?;
        std::str::from_utf8(value).map_err(|_| BadRecord::new("Header", name, "not UTF-8"))
    }

    fn opcode(&self) -> Result<u8, BadRecord> {
        self.array("op").map(|[opcode]| opcode)
    }

    fn u32(&self, name: &'static str) -> Result<u32, BadRecord> {
        self.array(name).map(u32::from_le_bytes)
    }

    /// Connection and time of a message; `None` for other records.
    fn message(&self) -> Option<(u32, u64)> {
        let time = nanoseconds(self.array("time").ok()?);
        (self.opcode() == Ok(MESSAGE)).then_some((self.u32("conn").ok()?, time))
    }
}

/// A chunk of the index at the end of a file, with its offset.
fn summary(info: &HeaderFields<'_>, data: &[u8]) -> Option<(u64, Summary)> {
    if info.opcode() != Ok(CHUNK_INFO) {
        return None;
    }
    let at = u64::from_le_bytes(info.array("chunk_pos").ok()?);
    let [first, last] = ["start_time", "end_time"].map(|name| info.array(name).ok());
    let (counts, _) = data.as_chunks::<8>();
    let count = |&[a, b, c, d, e, f, g, h]: &[u8; 8]| {
        let count = u32::from_le_bytes([e, f, g, h]) as usize;
        (u32::from_le_bytes([a, b, c, d]), Some(count))
    };
    let log_times = (nanoseconds(first?), nanoseconds(last?));
    Some((at, Summary { log_times, counts: counts.iter().map(count).collect() }))
}

/// Seconds and nanoseconds of ROS 1 as nanoseconds.
fn nanoseconds([a, b, c, d, e, f, g, h]: [u8; 8]) -> u64 {
    let [seconds, rest] = [[a, b, c, d], [e, f, g, h]].map(u32::from_le_bytes);
    u64::from(seconds) * 1_000_000_000 + u64::from(rest)
}

/// Bytes after their length, and what follows them.
fn blob(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (&length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(length) as usize)
}

/// Header and data of the record at the start of `bytes`, and what follows it.
fn record(bytes: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let (header, rest) = blob(bytes)?;
    let (data, rest) = blob(rest)?;
    Some((header, data, rest))
}
