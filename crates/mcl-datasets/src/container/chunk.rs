//! Chunks: parts of a container that are compressed on their own.

use std::borrow::Cow;
use std::io::{self, Read};

use lz4_flex::frame::FrameDecoder;

use super::problem::StreamProblem;

/// Largest chunk accepted, in bytes, packed or unpacked. Recorders write chunks of about 1 MB to 4 MB;
/// without a limit, a few bytes of compressed zeros could fill the memory.
pub const MAX_CHUNK_BYTES: u64 = 128 << 20;

/// How a chunk is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Bzip2,
    Lz4,
    Zstd,
}

/// Unpacks a chunk that says that it unpacks to `size` bytes. Of one that is cut off (`is_cut`), as much
/// as can be unpacked.
pub(super) fn unpack(
    compression: Compression,
    packed: &[u8],
    size: u64,
    is_cut: bool,
) -> Result<Cow<'_, [u8]>, StreamProblem> {
    if size > MAX_CHUNK_BYTES {
        return Err(StreamProblem::ChunkTooLarge { size, limit: MAX_CHUNK_BYTES });
    }
    // One byte more than declared, to tell a chunk that holds more.
    let (bytes, outcome) = inflate(compression, packed, size + 1);
    if is_cut {
        // The end of the input is the cut, and that is told elsewhere.
        return Ok(bytes);
    }
    outcome.map_err(|error: io::Error| StreamProblem::Decompression {
        compression: match compression {
            Compression::None => "none",
            Compression::Bzip2 => "bz2",
            Compression::Lz4 => "lz4",
            Compression::Zstd => "zstd",
        },
        reason: error.to_string(),
    })?;
    if bytes.len() as u64 != size {
        return Err(StreamProblem::UnpackedLength { declared: size, found: bytes.len() as u64 });
    }
    Ok(bytes)
}

/// Unpacks up to `limit` bytes; what could be unpacked before an error, too.
pub(crate) fn inflate(
    compression: Compression,
    packed: &[u8],
    limit: u64,
) -> (Cow<'_, [u8]>, io::Result<()>) {
    let mut bytes = Vec::new();
    let outcome = match compression {
        Compression::None => {
            let length = usize::try_from(limit).unwrap_or(usize::MAX).min(packed.len());
            return (Cow::Borrowed(&packed[..length]), Ok(()));
        }
        Compression::Bzip2 => {
            bzip2::bufread::MultiBzDecoder::new(packed).take(limit).read_to_end(&mut bytes)
        }
        Compression::Lz4 => FrameDecoder::new(packed).take(limit).read_to_end(&mut bytes),
        Compression::Zstd => zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|decoder| decoder.take(limit).read_to_end(&mut bytes)),
    };
    (Cow::Owned(bytes), outcome.map(|_| ()))
}
