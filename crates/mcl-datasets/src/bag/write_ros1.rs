//! Writes bags of ROS 1, version 2.0: uncompressed chunks with an index.

use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};

use super::cdr::{self, Value};
use super::encode::Encoder;
use super::layout::{Count, Definition, ElementType, NumberType, plain_name};
use super::schema::MessageSchema;
use super::sink::{Delivery, Sink, TopicId, WriteBagError};
use super::types::MessageType;
use crate::container::ros1::{BAG_HEADER, CHUNK, CHUNK_INFO, CONNECTION, INDEX, MAGIC, MESSAGE};

/// Size in bytes of the first record with its lengths, which is rewritten at the end.
const BAG_HEADER_BYTES: usize = 4096;
/// A chunk is written when its records reach this size in bytes.
const CHUNK_BYTES: usize = 768 << 10;
const VERSION: [u8; 4] = 1_u32.to_le_bytes();

/// Digests of the definitions, by which ROS 1 checks that two programs mean the same type.
fn digest(plain_name: &str) -> &'static str {
    match plain_name {
        "sensor_msgs/LaserScan" => "90c7ef2dc6895d81024acba2ac42f369",
        "nav_msgs/Odometry" => "cd5e73d190d741a2f92e81eda573aca7",
        "geometry_msgs/PoseStamped" => "d3812c3cbc69362b77dc0b19b345f8f5",
        "std_msgs/String" => "992ce8a1687cec8c8bd883ec73ca41d1",
        "tf2_msgs/TFMessage" => "94810edda583a504dfda3829e70d7eec",
        _ => "*",
    }
}

struct Connection {
    schema: MessageSchema,
    topic: String,
    /// Its header, without the connection's index.
    described: Vec<u8>,
}

/// A chunk in the index at the end.
struct ChunkInfo {
    position: u64,
    start: u64,
    end: u64,
    counts: BTreeMap<u16, u32>,
}

pub(super) struct Ros1Writer<W> {
    sink: W,
    connections: Vec<Connection>,
    /// Records of the chunk being filled, with the messages of each connection in it: time and offset.
    chunk: Vec<u8>,
    in_chunk: BTreeMap<u16, Vec<(u64, u32)>>,
    chunks: Vec<ChunkInfo>,
}

impl<W: Write + Seek> Ros1Writer<W> {
    pub fn new(mut sink: W) -> Result<Self, WriteBagError> {
        sink.write_all(MAGIC)?;
        sink.write_all(&bag_header(0, 0, 0))?;
        let (chunk, in_chunk) = (Vec::new(), BTreeMap::new());
        Ok(Ros1Writer { sink, connections: Vec::new(), chunk, in_chunk, chunks: Vec::new() })
    }

    fn end_chunk(&mut self) -> Result<(), WriteBagError> {
        if self.chunk.is_empty() {
            return Ok(());
        }
        let position = self.sink.stream_position()?;
        let size = (self.chunk.len() as u32).to_le_bytes();
        let mut out = Vec::new();
        let fields: [Field<'_>; 3] = [("op", &[CHUNK]), ("compression", b"none"), ("size", &size)];
        record(&mut out, &fields, &self.chunk);
        let messages = std::mem::take(&mut self.in_chunk);
        for (id, entries) in &messages {
            let mut index = Vec::new();
            for &(log_time, offset) in entries {
                index.extend(time(log_time));
                index.extend(offset.to_le_bytes());
            }
            let count = (entries.len() as u32).to_le_bytes();
            let id = u32::from(*id).to_le_bytes();
            let fields: [Field<'_>; 4] =
                [("op", &[INDEX]), ("ver", &VERSION), ("conn", &id), ("count", &count)];
            record(&mut out, &fields, &index);
        }
        self.sink.write_all(&out)?;
        self.chunk.clear();
        let times = || messages.values().flatten().map(|&(log_time, _)| log_time);
        self.chunks.push(ChunkInfo {
            position,
            start: times().min().unwrap_or_default(),
            end: times().max().unwrap_or_default(),
            counts: messages.iter().map(|(&id, found)| (id, found.len() as u32)).collect(),
        });
        Ok(())
    }

    /// Finishes the bag, and returns the sink.
    pub fn finish(mut self) -> Result<W, WriteBagError> {
        self.end_chunk()?;
        let index_start = self.sink.stream_position()?;
        let mut out = Vec::new();
        for (id, connection) in self.connections.iter().enumerate() {
            connection.write(id as u32, &mut out);
        }
        for ChunkInfo { position, start, end, counts } in &self.chunks {
            let mut data = Vec::new();
            for (&id, count) in counts {
                data.extend(u32::from(id).to_le_bytes());
                data.extend(count.to_le_bytes());
            }
            let (position, count) = (position.to_le_bytes(), (counts.len() as u32).to_le_bytes());
            let (start, end) = (time(*start), time(*end));
            let fields: [Field<'_>; 6] = [
                ("op", &[CHUNK_INFO]),
                ("ver", &VERSION),
                ("chunk_pos", &position),
                ("start_time", &start),
                ("end_time", &end),
                ("count", &count),
            ];
            record(&mut out, &fields, &data);
        }
        self.sink.write_all(&out)?;
        self.sink.seek(SeekFrom::Start(MAGIC.len() as u64))?;
        let (connections, chunks) = (self.connections.len() as u32, self.chunks.len() as u32);
        self.sink.write_all(&bag_header(index_start, connections, chunks))?;
        self.sink.seek(SeekFrom::End(0))?;
        self.sink.flush()?;
        Ok(self.sink)
    }
}

impl<W: Write + Seek> Sink for Ros1Writer<W> {
    fn topic(
        &mut self,
        name: &str,
        message: &MessageType,
        delivery: Delivery,
    ) -> Result<TopicId, WriteBagError> {
        let plain = plain_name(message.name);
        let text = message.description_of_ros1();
        let schema = MessageSchema::parse(&plain, "ros2msg", message.description().as_bytes())
            .map_err(|error| std::io::Error::other(error.to_string()))?;
        let mut fields: Vec<Field<'_>> = vec![
            ("topic", name.as_bytes()),
            ("type", plain.as_bytes()),
            ("md5sum", digest(&plain).as_bytes()),
            ("message_definition", text.as_bytes()),
        ];
        if delivery == Delivery::Latched {
            fields.push(("latching", b"1"));
        }
        let described = header(&fields);
        let connection = Connection { schema, topic: name.to_owned(), described };
        let id = self.connections.len() as u16;
        connection.write(u32::from(id), &mut self.chunk);
        self.connections.push(connection);
        Ok(TopicId(id))
    }

    fn message(
        &mut self,
        topic: TopicId,
        log_time: u64,
        message: Encoder,
    ) -> Result<(), WriteBagError> {
        let schema = &self.connections[usize::from(topic.0)].schema;
        let bytes = message.into_bytes();
        let value = cdr::decode(schema, &bytes)
            .map_err(|error| std::io::Error::other(error.to_string()))?;
        let mut data = Vec::new();
        encode(schema, schema.root(), &value, &mut data);
        let offset = self.chunk.len() as u32;
        self.in_chunk.entry(topic.0).or_default().push((log_time, offset));
        let (id, at) = (u32::from(topic.0).to_le_bytes(), time(log_time));
        let fields: [Field<'_>; 3] = [("op", &[MESSAGE]), ("conn", &id), ("time", &at)];
        record(&mut self.chunk, &fields, &data);
        if self.chunk.len() >= CHUNK_BYTES {
            self.end_chunk()?;
        }
        Ok(())
    }
}

impl Connection {
    fn write(&self, id: u32, out: &mut Vec<u8>) {
        let id = id.to_le_bytes();
        let fields: [Field<'_>; 3] =
            [("op", &[CONNECTION]), ("conn", &id), ("topic", self.topic.as_bytes())];
        record(out, &fields, &self.described);
    }
}

/// Seconds and nanoseconds.
fn time(log_time: u64) -> [u8; 8] {
    const NANOSECONDS: u64 = 1_000_000_000;
    let parts = [log_time / NANOSECONDS, log_time % NANOSECONDS];
    let [[a, b, c, d], [e, f, g, h]] = parts.map(|part| (part as u32).to_le_bytes());
    [a, b, c, d, e, f, g, h]
}

type Field<'a> = (&'a str, &'a [u8]);

fn blob(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
}

fn header(fields: &[Field<'_>]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        blob(&mut header, &[name.as_bytes(), b"=", value].concat());
    }
    header
}

fn record(out: &mut Vec<u8>, fields: &[Field<'_>], data: &[u8]) {
    blob(out, &header(fields));
    blob(out, data);
}

fn bag_header(index_start: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let (index, connections) = (index_start.to_le_bytes(), connections.to_le_bytes());
    let chunks = chunks.to_le_bytes();
    let fields: [Field<'_>; 4] = [
        ("op", &[BAG_HEADER]),
        ("index_pos", &index),
        ("conn_count", &connections),
        ("chunk_count", &chunks),
    ];
    let mut out = Vec::new();
    record(&mut out, &fields, &vec![b' '; BAG_HEADER_BYTES - 8 - header(&fields).len()]);
    out
}

/// A message in the encoding of ROS 1, whose headers have a sequence number before the stamp.
fn encode(schema: &MessageSchema, definition: &Definition, value: &Value<'_>, out: &mut Vec<u8>) {
    let Value::Message(values) = value else { return };
    if definition.name == "std_msgs/Header" {
        out.extend(0_u32.to_le_bytes());
    }
    for (field, value) in definition.fields.iter().zip(values) {
        let mut length = |count: usize| {
            if field.count == Count::Sequence {
                out.extend((count as u32).to_le_bytes());
            }
        };
        match value {
            Value::Numbers(numbers) => {
                let numbers = numbers.to_vec();
                length(numbers.len());
                numbers.iter().for_each(|number| {
                    element(schema, &field.element, &Value::Number(*number), out)
                });
            }
            Value::Bytes(bytes) => {
                length(bytes.len());
                out.extend_from_slice(bytes);
            }
            Value::List(items) => {
                length(items.len());
                items.iter().for_each(|item| element(schema, &field.element, item, out));
            }
            one => element(schema, &field.element, one, out),
        }
    }
}

fn element(
    schema: &MessageSchema,
    kind: &ElementType<usize>,
    value: &Value<'_>,
    out: &mut Vec<u8>,
) {
    match (kind, value) {
        (ElementType::Number(NumberType::Float(4)), Value::Number(number)) => {
            out.extend((*number as f32).to_le_bytes());
        }
        (ElementType::Number(NumberType::Float(_)), Value::Number(number)) => {
            out.extend(number.to_le_bytes());
        }
        (ElementType::Number(kind), Value::Number(number)) => {
            out.extend(&(*number as i64).to_le_bytes()[..kind.width()]);
        }
        (_, Value::Text(text)) => blob(out, text.as_bytes()),
        (ElementType::Message(index), message) => {
            encode(schema, schema.definition(*index), message, out);
        }
        _ => {}
    }
}
