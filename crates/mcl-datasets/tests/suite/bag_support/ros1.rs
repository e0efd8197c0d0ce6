//! The same messages as a ROS 1 bag, written in code.

use std::collections::BTreeMap;
use std::io::Write;

use mcl_datasets::bag::cdr::{Value, decode};
use mcl_datasets::bag::schema::{Count, Definition, ElementType, MessageSchema, NumberType};
use mcl_datasets::bag::types;

use super::Entry;

/// How a bag is written.
#[derive(Clone, Copy)]
pub struct Ros1Options {
    pub compression: &'static str,
    /// Messages of a chunk.
    pub chunk: usize,
    /// Whether it was closed: a bag without an index says so in its header.
    pub has_index: bool,
}

pub const ROS1: Ros1Options = Ros1Options { compression: "none", chunk: 20, has_index: true };

/// A message in the encoding of ROS 1, whose headers have a number before the stamp.
pub fn encode(
    schema: &MessageSchema,
    definition: &Definition,
    value: &Value<'_>,
    out: &mut Vec<u8>,
) {
    let Value::Message(values) = value else { panic!("a message") };
    if definition.name == "std_msgs/Header" {
        out.extend(7_u32.to_le_bytes());
    }
    for (field, value) in definition.fields.iter().zip(values) {
        let items: Vec<Value> = match value {
            Value::Numbers(numbers) => numbers.to_vec().into_iter().map(Value::Number).collect(),
            Value::Bytes(bytes) => bytes.iter().map(|&b| Value::Number(f64::from(b))).collect(),
            Value::List(items) => items.clone(),
            one => vec![one.clone()],
        };
        if field.count == Count::Sequence {
            out.extend((items.len() as u32).to_le_bytes());
        }
        for item in &items {
            match (&field.element, item) {
                (ElementType::Number(kind), Value::Number(number)) => match kind {
                    NumberType::Float(4) => out.extend((*number as f32).to_le_bytes()),
                    NumberType::Float(_) => out.extend(number.to_le_bytes()),
                    _ => out.extend(&(*number as i64).to_le_bytes()[..kind.width()]),
                },
                (ElementType::Text, Value::Text(text)) => {
                    out.extend((text.len() as u32).to_le_bytes());
                    out.extend(text.as_bytes());
                }
                (ElementType::Message(index), message) => {
                    encode(schema, schema.definition(*index), message, out);
                }
                other => panic!("{other:?}"),
            }
        }
    }
}

fn blob(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend((bytes.len() as u32).to_le_bytes());
    out.extend(bytes);
}

/// A header: fields after their lengths.
pub fn header(fields: &[(&str, &[u8])]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        blob(&mut header, &[name.as_bytes(), b"=", value].concat());
    }
    header
}

pub fn record(out: &mut Vec<u8>, fields: &[(&str, &[u8])], data: &[u8]) {
    blob(out, &header(fields));
    blob(out, data);
}

/// The topics of some messages with their descriptions, in order of appearance.
fn connections(entries: &[Entry]) -> Vec<(&'static str, String, String)> {
    let mut known: Vec<(&str, String, String)> = Vec::new();
    for entry in entries {
        let name = entry.schema.0.replace("/msg/", "/");
        if !known.iter().any(|(topic, found, _)| *topic == entry.topic && *found == name) {
            let text = types::named(&name).map(|kind| kind.description_of_ros1());
            known.push((entry.topic, name, text.unwrap_or_default()));
        }
    }
    known
}

fn pack(compression: &str, records: &[u8]) -> Vec<u8> {
    match compression {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), Default::default());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        _ => records.to_vec(),
    }
}

pub fn bag_header(index_start: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let mut out = b"#ROSBAG V2.0\n".to_vec();
    record(
        &mut out,
        &[
            ("op", &[3]),
            ("index_pos", &index_start.to_le_bytes()),
            ("conn_count", &connections.to_le_bytes()),
            ("chunk_count", &chunks.to_le_bytes()),
        ],
        &[b' '; 4000],
    );
    out
}

pub fn chunk(out: &mut Vec<u8>, compression: &str, size: u32, packed: &[u8]) {
    let fields: [(&str, &[u8]); 3] =
        [("op", &[5]), ("compression", compression.as_bytes()), ("size", &size.to_le_bytes())];
    record(out, &fields, packed);
}

pub fn connection(out: &mut Vec<u8>, id: u32, topic: &str, name: &str, text: &str) {
    let described = header(&[
        ("topic", topic.as_bytes()),
        ("type", name.as_bytes()),
        ("md5sum", b"*"),
        ("message_definition", text.as_bytes()),
    ]);
    let fields: [(&str, &[u8]); 3] =
        [("op", &[7]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())];
    record(out, &fields, &described);
}

pub fn message(out: &mut Vec<u8>, id: u32, log_time: u64, data: &[u8]) {
    let time = time(log_time);
    record(out, &[("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &time)], data);
}

fn time(log_time: u64) -> Vec<u8> {
    let time = [(log_time / 1_000_000_000) as u32, (log_time % 1_000_000_000) as u32];
    time.map(u32::to_le_bytes).concat()
}

/// A bag of these messages, whose data is in CDR, in this order.
pub fn ros1_bag(entries: &[Entry], options: Ros1Options) -> Vec<u8> {
    let connections = connections(entries);
    let mut body = Vec::new();
    let mut seen = Vec::new();
    let mut infos = Vec::new();
    for part in entries.chunks(options.chunk) {
        let mut records = Vec::new();
        let mut index: BTreeMap<u32, Vec<u8>> = BTreeMap::new();
        for entry in part {
            let name = entry.schema.0.replace("/msg/", "/");
            let is_of = |(topic, found, _): &(&str, String, String)| {
                *topic == entry.topic && *found == name
            };
            let id = connections.iter().position(is_of).unwrap();
            if !seen.contains(&id) {
                seen.push(id);
                let (topic, name, text) = &connections[id];
                connection(&mut records, id as u32, topic, name, text);
            }
            let schema = MessageSchema::parse(&entry.schema.0, "ros2msg", &entry.schema.2).unwrap();
            let mut data = Vec::new();
            match decode(&schema, &entry.data) {
                Ok(value) => encode(&schema, schema.root(), &value, &mut data),
                Err(_) => data.push(1),
            }
            let offset = (records.len() as u32).to_le_bytes();
            index
                .entry(id as u32)
                .or_default()
                .extend([&time(entry.log_time)[..], &offset].concat());
            message(&mut records, id as u32, entry.log_time, &data);
        }
        let at = (bag_header(0, 0, 0).len() + body.len()) as u64;
        let packed = pack(options.compression, &records);
        chunk(&mut body, options.compression, records.len() as u32, &packed);
        let mut counts = Vec::new();
        for (id, entries) in &index {
            let (id, count) = (id.to_le_bytes(), (entries.len() as u32 / 12).to_le_bytes());
            counts.extend([id, count].concat());
            let fields: [(&str, &[u8]); 4] =
                [("op", &[4]), ("ver", &1_u32.to_le_bytes()), ("conn", &id), ("count", &count)];
            record(&mut body, &fields, entries);
        }
        let times = || part.iter().map(|entry| entry.log_time);
        let [first, last] = [times().min(), times().max()].map(|at| time(at.unwrap()));
        let count = (index.len() as u32).to_le_bytes();
        let mut info = Vec::new();
        let fields: [(&str, &[u8]); 6] = [
            ("op", &[6]),
            ("ver", &1_u32.to_le_bytes()),
            ("chunk_pos", &at.to_le_bytes()),
            ("start_time", &first),
            ("end_time", &last),
            ("count", &count),
        ];
        record(&mut info, &fields, &counts);
        infos.push(info);
    }
    let start = bag_header(0, 0, 0).len() + body.len();
    if !options.has_index {
        return [bag_header(0, 0, 0), body].concat();
    }
    let mut out = bag_header(start as u64, connections.len() as u32, infos.len() as u32);
    out.extend(body);
    for (id, (topic, name, text)) in connections.iter().enumerate() {
        connection(&mut out, id as u32, topic, name, text);
    }
    out.extend(infos.concat());
    out
}
