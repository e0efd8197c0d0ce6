//! Chunks: parts of a container that are compressed individually.

use std::borrow::Cow;
use std::io::{self, Read};

#[cfg(feature = "bags")]
use lz4_flex::frame::FrameDecoder;
use mcl_core::OutOfMemory;

use super::problem::StreamProblem;

/// Largest chunk accepted, in bytes, compressed or decompressed. Recorders write chunks of about 1 MB to 4
/// MB; without a limit, a few bytes of compressed zeros could fill the memory.
pub const MAX_CHUNK_BYTES: u64 = 128 << 20;

/// How a chunk is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Bzip2,
    #[cfg(feature = "bags")]
    Lz4,
    Zstd,
}

/// Decompresses a chunk with a stated size of `size` bytes. Of a truncated one (`is_cut`), as much as can be
/// decompressed.
pub(super) fn unpack(
    compression: Compression,
    packed: &[u8],
    size: u64,
    is_cut: bool,
) -> Result<Cow<'_, [u8]>, StreamProblem> {
    if size > MAX_CHUNK_BYTES {
        return Err(StreamProblem::ChunkTooLarge { size, limit: MAX_CHUNK_BYTES });
    }
    // One byte more than declared, to detect a chunk that holds more.
    let (bytes, outcome) = inflate(compression, packed, size + 1);
    if is_cut {
        // The end of the input is the truncation, which is reported elsewhere.
        return Ok(bytes);
    }
    outcome.map_err(|error: io::Error| match is_out_of_memory(&error) {
        true => OutOfMemory { what: "the content of a chunk", bytes: size as usize }.into(),
        false => StreamProblem::Decompression {
            compression: match compression {
                Compression::None => "none",
                Compression::Bzip2 => "bz2",
                #[cfg(feature = "bags")]
                Compression::Lz4 => "lz4",
                Compression::Zstd => "zstd",
            },
            reason: error.to_string(),
        },
    })?;
    if bytes.len() as u64 != size {
        return Err(StreamProblem::UnpackedLength { declared: size, found: bytes.len() as u64 });
    }
    Ok(bytes)
}

/// Whether a decompressor failed because an allocation was refused: C libraries have no error kind for it.
pub(crate) fn is_out_of_memory(error: &io::Error) -> bool {
    let message = || error.to_string().to_ascii_lowercase();
    error.kind() == io::ErrorKind::OutOfMemory
        || ["not enough memory", "out of memory"].iter().any(|part| message().contains(part))
}

/// Decompresses up to `limit` bytes; also returns what was decompressed before an error.
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
        #[cfg(feature = "bags")]
        Compression::Lz4 => FrameDecoder::new(packed).take(limit).read_to_end(&mut bytes),
        Compression::Zstd => zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|decoder| decoder.take(limit).read_to_end(&mut bytes)),
    };
    (Cow::Owned(bytes), outcome.map(|_| ()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As libraries report it; `zstd` calls it an allocation error.
    #[test]
    fn refused_memory_is_not_damage() {
        for text in ["Allocation error : not enough memory", "Out of memory"] {
            assert!(is_out_of_memory(&io::Error::other(text)), "{text}");
        }
        assert!(is_out_of_memory(&io::ErrorKind::OutOfMemory.into()));
        assert!(!is_out_of_memory(&io::Error::other("Data corruption detected")));
    }
}
