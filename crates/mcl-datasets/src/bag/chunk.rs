//! What a chunk holds: its compression undone, its length and checksum checked.

use std::io::{self, Read};

use lz4_flex::frame::FrameDecoder;

use super::bytes::Fields;
use super::error::StreamProblem;

/// Largest chunk accepted, in bytes, packed or unpacked. Recorders write chunks of about 1 MB to 4 MB;
/// without a limit, a few bytes of compressed zeros could fill the memory.
pub const MAX_CHUNK_BYTES: u64 = 128 << 20;

/// The records of a chunk, back to back. Of a chunk whose file is cut off (`is_cut`), as much as can
/// be told of it.
pub(super) fn unpack(body: &[u8], is_cut: bool) -> Result<Vec<u8>, StreamProblem> {
    let mut fields = Fields::new("Chunk", body);
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
    // One byte more than declared, to tell a chunk that holds more.
    let mut records = Vec::new();
    let outcome = match compression {
        "" => packed.take(size + 1).read_to_end(&mut records),
        "zstd" => zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|decoder| decoder.take(size + 1).read_to_end(&mut records)),
        "lz4" => FrameDecoder::new(packed).take(size + 1).read_to_end(&mut records),
        other => return Err(StreamProblem::UnknownCompression(other.to_owned())),
    };
    if is_cut {
        // The end of the input is the cut, and that is told elsewhere.
        return Ok(records);
    }
    outcome.map_err(|error: io::Error| StreamProblem::Decompression {
        compression: compression.to_owned(),
        reason: error.to_string(),
    })?;
    if records.len() as u64 != size {
        return Err(StreamProblem::UnpackedLength { declared: size, found: records.len() as u64 });
    }
    let found = crc32fast::hash(&records);
    if crc != 0 && crc != found {
        return Err(StreamProblem::ChunkCrc { declared: crc, found });
    }
    Ok(records)
}
