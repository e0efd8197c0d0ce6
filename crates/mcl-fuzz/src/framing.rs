//! Bags around the bytes of a fuzzer, so that framing and checksums do not stop it.

use std::io::Write;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// How the records of a chunk are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// Zstandard.
    Zstd,
    /// LZ4 frames.
    Lz4,
    /// Bzip2, of ROS 1 alone.
    Bzip2,
}

/// These bytes packed, and what MCAP and ROS 1 call that.
fn packed(records: &[u8], compression: Compression) -> (&'static str, &'static str, Vec<u8>) {
    match compression {
        Compression::None => ("", "none", records.to_vec()),
        Compression::Zstd => ("zstd", "none", zstd::bulk::compress(records, 1).unwrap_or_default()),
        Compression::Lz4 => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            let packed = encoder.write_all(records).ok().and_then(|()| encoder.finish().ok());
            ("lz4", "lz4", packed.unwrap_or_default())
        }
        Compression::Bzip2 => {
            // Of the smallest blocks: unpacking takes memory, and so time, by their size.
            let level = bzip2::Compression::fast();
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), level);
            let packed = encoder.write_all(records).ok().and_then(|()| encoder.finish().ok());
            ("", "bz2", packed.unwrap_or_default())
        }
    }
}

fn record(file: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    file.push(opcode);
    file.extend((body.len() as u64).to_le_bytes());
    file.extend(body);
}

fn text(body: &mut Vec<u8>, text: &str) {
    body.extend((text.len() as u32).to_le_bytes());
    body.extend(text.as_bytes());
}

fn file_of(content: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut file = MAGIC.to_vec();
    let mut header = Vec::new();
    text(&mut header, "ros2");
    text(&mut header, "");
    record(&mut file, HEADER, &header);
    content(&mut file);
    // A checksum of 0 says that there is none.
    record(&mut file, DATA_END, &[0; 4]);
    record(&mut file, FOOTER, &[0; 20]);
    file.extend(MAGIC);
    file
}

/// A topic of a bag and its only message.
#[derive(Debug, Clone, Copy)]
pub struct OneMessage<'a> {
    pub topic: &'a str,
    pub type_name: &'a str,
    pub encoding: &'a str,
    pub description: &'a [u8],
    pub data: &'a [u8],
}

/// A bag without chunks: a topic per entry with its description and a message.
pub fn bag_of(messages: &[OneMessage<'_>]) -> Vec<u8> {
    file_of(|file| {
        for (id, message) in (1_u16..).zip(messages) {
            let mut schema = id.to_le_bytes().to_vec();
            text(&mut schema, message.type_name);
            text(&mut schema, message.encoding);
            schema.extend((message.description.len() as u32).to_le_bytes());
            schema.extend(message.description);
            record(file, SCHEMA, &schema);
            let mut channel = [id.to_le_bytes(), id.to_le_bytes()].concat();
            text(&mut channel, message.topic);
            text(&mut channel, "cdr");
            channel.extend([0; 4]);
            record(file, CHANNEL, &channel);
            let mut body = id.to_le_bytes().to_vec();
            // Sequence, then the times of logging and publishing: 1 s.
            body.extend([0; 4]);
            body.extend(1_000_000_000_u64.to_le_bytes());
            body.extend(1_000_000_000_u64.to_le_bytes());
            body.extend(message.data);
            record(file, MESSAGE, &body);
        }
    })
}

/// A bag without chunks: one topic with one message, described in `ros2msg`.
pub fn bag_of_one_message(topic: &str, type_name: &str, description: &str, data: &[u8]) -> Vec<u8> {
    let description = description.as_bytes();
    bag_of(&[OneMessage { topic, type_name, encoding: "ros2msg", description, data }])
}

/// A bag of one chunk with these records.
pub fn chunked(records: &[u8], compression: Compression) -> Vec<u8> {
    let (name, _, packed) = packed(records, compression);
    file_of(|file| {
        let mut chunk = vec![0; 16];
        chunk.extend((records.len() as u64).to_le_bytes());
        chunk.extend(crc32fast::hash(records).to_le_bytes());
        text(&mut chunk, name);
        chunk.extend((packed.len() as u64).to_le_bytes());
        chunk.extend(&packed);
        record(file, CHUNK, &chunk);
    })
}

/// A bag of ROS 1 of one chunk with these records, and without an index.
pub fn ros1_chunked(records: &[u8], compression: Compression) -> Vec<u8> {
    let (_, name, packed) = packed(records, compression);
    let blob = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    let header = |fields: &[(&str, &[u8])]| {
        let field = |(name, value): &(&str, &[u8])| blob(&[name.as_bytes(), b"=", value].concat());
        blob(&fields.iter().flat_map(field).collect::<Vec<u8>>())
    };
    let mut file = b"#ROSBAG V2.0\n".to_vec();
    file.extend(header(&[
        ("op", &[3]),
        ("index_pos", &[0; 8]),
        ("conn_count", &[0; 4]),
        ("chunk_count", &[0; 4]),
    ]));
    file.extend(blob(b" "));
    let size = (records.len() as u32).to_le_bytes();
    file.extend(header(&[("op", &[5]), ("compression", name.as_bytes()), ("size", &size)]));
    file.extend(blob(&packed));
    file
}
