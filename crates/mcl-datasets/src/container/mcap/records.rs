//! The content of a chunk of an MCAP file: decompressed, with its length and checksum checked.

use std::borrow::Cow;

use super::fields::BinaryFields;
use crate::container::chunk::{Compression, MAX_CHUNK_BYTES, unpack};
use crate::container::problem::{BadRecord, StreamProblem};

/// The records of a chunk, back to back. Of a truncated chunk (`is_cut`), as much as can be read.
pub(super) fn of(body: &[u8], is_cut: bool) -> Result<Cow<'_, [u8]>, StreamProblem> {
    let mut fields = BinaryFields::new("Chunk", body);
    fields.bytes("message_start_time, message_end_time", 16)?;
    let size = fields.u64("uncompressed_size")?;
    let crc = fields.u32("uncompressed_crc")?;
    let compression = fields.text("compression")?;
    let packed_size = fields.u64("records")?;
    if size > MAX_CHUNK_BYTES {
        return Err(StreamProblem::ChunkTooLarge { size, limit: MAX_CHUNK_BYTES });
    }
    let rest = fields.rest();
    let packed = match usize::try_from(packed_size).ok().and_then(|length| rest.get(..length)) {
        Some(packed) => packed,
        None if is_cut => rest,
        None => return Err(StreamProblem::ChunkLength { size: packed_size, there: rest.len() }),
    };
    let compression = match compression {
        "" => Compression::None,
        "zstd" => Compression::Zstd,
        "lz4" => Compression::Lz4,
        other => {
            let (found, expected) = (other.to_owned(), "none, zstd or lz4");
            return Err(StreamProblem::UnknownCompression { found, expected });
        }
    };
    let records = unpack(compression, packed, size, is_cut)?;
    let found = crc32fast::hash(&records);
    if !is_cut && crc != 0 && crc != found {
        return Err(StreamProblem::ChunkCrc { declared: crc, found });
    }
    Ok(records)
}

/// Log times of the first and the last message of a chunk, in nanoseconds, and the offset of the records in
/// its body, if they are not compressed.
pub(super) fn head(body: &[u8]) -> Result<((u64, u64), Option<u64>), BadRecord> {
    let mut fields = BinaryFields::new("Chunk", body);
    let log_times = (fields.u64("message_start_time")?, fields.u64("message_end_time")?);
    fields.u64("uncompressed_size")?;
    fields.u32("uncompressed_crc")?;
    let is_plain = fields.text("compression")?.is_empty();
    fields.u64("records")?;
    let start = body.len() - fields.rest().len();
    Ok((log_times, is_plain.then_some(start as u64)))
}
