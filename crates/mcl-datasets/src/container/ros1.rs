//! ROS 1 bags, version 2.0: chunked or not, compressed or not, with or without an index, which is not
//! used.
//!
//! A record is a header (fields `name=value`) and data, each after its length. Chunks hold records of
//! connections (topics, with the description of their messages) and messages; records of the index
//! follow each chunk and stand at the end. A recorder that is stopped leaves a last chunk whose length
//! it never wrote, and no index.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

use super::chunk::{Compression, MAX_CHUNK_BYTES, unpack};
use super::input::Counted;
use super::item::{Channel, Container, Input, Item, Message, SchemaText, Visit};
use super::position::Position;
use super::problem::{BadRecord, StreamError, StreamProblem};

/// Bags of ROS 1.
pub static CONTAINER: Container =
    Container { name: "ROS 1 bag", magic: MAGIC, ending: "bag", storage: None, read };

/// What a bag of version 2.0 begins with.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Longest header of a record accepted, in bytes; real ones take about a hundred.
const MAX_HEADER_BYTES: u64 = 1 << 20;
/// Longest data accepted of records that are passed over unread: the index of a chunk.
const MAX_SKIPPED_BYTES: u64 = u32::MAX as u64;

// Kinds of records, the field `op` of their headers.
pub(crate) const MESSAGE: u8 = 2;
pub(crate) const BAG_HEADER: u8 = 3;
pub(crate) const INDEX: u8 = 4;
pub(crate) const CHUNK: u8 = 5;
pub(crate) const CHUNK_INFO: u8 = 6;
pub(crate) const CONNECTION: u8 = 7;

fn read(input: Input<'_>, visit: &mut Visit<'_>) -> Result<Option<String>, StreamError> {
    let mut reader = Reader {
        input: Counted::new(input.stream),
        connections: BTreeMap::new(),
        index_start: 0,
        expected_in_index: 0,
        found_in_index: 0,
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
}

struct Reader<R> {
    input: Counted<R>,
    connections: BTreeMap<u32, Connection>,
    /// Where the index at the end begins; 0 if the bag was never closed.
    index_start: u64,
    expected_in_index: u64,
    found_in_index: u64,
    /// Whether a chunk without a length was seen, whose records follow as they are.
    has_open_chunk: bool,
    /// Where the record being read begins.
    record_start: u64,
}

/// What a piece of a file is read up to.
enum Piece {
    Whole,
    Cut,
}

impl<R: Read> Reader<R> {
    fn read(&mut self, visit: &mut Visit<'_>) -> Result<Option<String>, StreamProblem> {
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
                None if self.input.offset == self.record_start => return Ok(self.end()),
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
                CHUNK => {
                    self.has_open_chunk = length == 0;
                    self.chunk(&fields, &data, is_cut, visit)?;
                }
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
            if self.is_in_index() && matches!(opcode, CONNECTION | CHUNK_INFO) {
                self.found_in_index += 1;
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

    fn bag_header(&mut self, fields: &Fields<'_>) -> Result<(), StreamProblem> {
        if let Some(encryptor) = fields.find("encryptor").filter(|name| !name.is_empty())
            && encryptor != b"rosbag/NoEncryptor"
        {
            return Err(StreamProblem::Encrypted(String::from_utf8_lossy(encryptor).into_owned()));
        }
        self.index_start = u64::from_le_bytes(fields.array("index_pos")?);
        let count = |name| fields.array(name).map(|bytes| u64::from(u32::from_le_bytes(bytes)));
        self.expected_in_index = count("conn_count")? + count("chunk_count")?;
        Ok(())
    }

    fn chunk(
        &mut self,
        fields: &Fields<'_>,
        packed: &[u8],
        is_cut: bool,
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let size = u64::from(u32::from_le_bytes(fields.array("size")?));
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
        let mut rest = records.as_slice();
        while !rest.is_empty() {
            let Some((header, data, after)) = record(rest) else {
                let there = rest.len();
                return match is_cut {
                    true => Ok(()),
                    false => Err(StreamProblem::CutInChunk { there }),
                };
            };
            let fields = self::fields(header)?;
            let opcode = fields.opcode()?;
            if !matches!(opcode, CONNECTION | MESSAGE) {
                return Err(
                    BadRecord::new("Chunk", "op", "neither a connection nor a message").into()
                );
            }
            self.record(opcode, &fields, data, visit)?;
            rest = after;
        }
        Ok(())
    }

    fn record(
        &mut self,
        opcode: u8,
        fields: &Fields<'_>,
        data: &[u8],
        visit: &mut Visit<'_>,
    ) -> Result<(), StreamProblem> {
        let id = u32::from_le_bytes(fields.array("conn")?);
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
                    visit(Item::Channel(&channel))?;
                    self.connections.insert(id, Connection { channel, messages: 0 });
                }
            }
            return Ok(());
        }
        let [s0, s1, s2, s3, n0, n1, n2, n3] = fields.array("time")?;
        let seconds = u64::from(u32::from_le_bytes([s0, s1, s2, s3]));
        let log_time = seconds * 1_000_000_000 + u64::from(u32::from_le_bytes([n0, n1, n2, n3]));
        let connection = self.connections.get_mut(&id).ok_or(StreamProblem::UnknownChannel(id))?;
        let sequence = connection.messages;
        connection.messages = sequence.wrapping_add(1);
        visit(Item::Message(Message {
            channel: &connection.channel,
            sequence,
            log_time,
            publish_time: log_time,
            data,
            position: Position::Byte(self.record_start),
        }))
    }

    /// At the end of the file, where no record is cut.
    fn end(&self) -> Option<String> {
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

/// The fields of a header.
struct Fields<'a>(Vec<(&'a [u8], &'a [u8])>);

/// Fields `name=value`, each after its length.
fn fields(mut header: &[u8]) -> Result<Fields<'_>, BadRecord> {
    let mut fields = Vec::new();
    while !header.is_empty() {
        let (field, rest) = blob(header).ok_or(BadRecord::new(
            "Header",
            "length of a field",
            "longer than the header",
        ))?;
        let end = field.iter().position(|&byte| byte == b'=').ok_or(BadRecord::new(
            "Header",
            "field",
            "without \"=\"",
        ))?;
        fields.push((&field[..end], &field[end + 1..]));
        header = rest;
    }
    Ok(Fields(fields))
}

impl<'a> Fields<'a> {
    fn find(&self, name: &str) -> Option<&'a [u8]> {
        self.0.iter().find(|(found, _)| *found == name.as_bytes()).map(|&(_, value)| value)
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
}

/// Bytes after their length, and what follows them.
fn blob(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (&length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(u32::from_le_bytes(length) as usize)
}

/// Header and data of the record that `bytes` begin with, and what follows it.
fn record(bytes: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let (header, rest) = blob(bytes)?;
    let (data, rest) = blob(rest)?;
    Some((header, data, rest))
}
