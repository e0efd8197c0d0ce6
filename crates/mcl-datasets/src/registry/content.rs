//! What a file holds once unpacked: copies of a log are told apart by it, not by how they are packed.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

use super::Sha256Digest;

const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Digest and size of a file's unpacked content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Content {
    /// SHA-256 of the unpacked bytes.
    pub sha256: Sha256Digest,
    /// Number of unpacked bytes.
    pub bytes: u64,
}

impl Content {
    /// Reads a file, unpacking it when it begins like a gzip file, whatever its name.
    ///
    /// # Errors
    /// As the file system or the decompressor says; a gzip file that is cut off is
    /// [`io::ErrorKind::UnexpectedEof`].
    pub fn of_file(path: &Path) -> io::Result<Content> {
        match unpack(File::open(path)?, &mut io::sink(), u64::MAX) {
            Ok(content) => Ok(content),
            Err(UnpackError::Input(error) | UnpackError::Output(error)) => Err(error),
            Err(UnpackError::TooLarge) => Err(io::ErrorKind::FileTooLarge.into()),
        }
    }
}

/// Why content could not be unpacked.
#[derive(Debug)]
pub(super) enum UnpackError {
    /// The input cannot be read or is no valid gzip stream.
    Input(io::Error),
    /// The output cannot be written.
    Output(io::Error),
    /// The unpacked content is larger than the limit.
    TooLarge,
}

/// Copies `input` to `output`, unpacking gzip, and digests what it writes; stops beyond `limit`
/// bytes of output.
pub(super) fn unpack(
    input: impl Read,
    output: &mut impl Write,
    limit: u64,
) -> Result<Content, UnpackError> {
    let mut input = BufReader::new(input);
    let packed = input.fill_buf().map_err(UnpackError::Input)?.starts_with(&GZIP_MAGIC);
    if packed {
        copy(MultiGzDecoder::new(input), output, limit)
    } else {
        copy(input, output, limit)
    }
}

fn copy(mut input: impl Read, output: &mut impl Write, limit: u64) -> Result<Content, UnpackError> {
    let mut hash = Sha256::new();
    let mut bytes = 0_u64;
    let mut buffer = vec![0; 64 * 1024];
    loop {
        let read = match input.read(&mut buffer) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(UnpackError::Input(error)),
        };
        bytes += read as u64;
        if bytes > limit {
            return Err(UnpackError::TooLarge);
        }
        hash.update(&buffer[..read]);
        output.write_all(&buffer[..read]).map_err(UnpackError::Output)?;
    }
    Ok(Content { sha256: Sha256Digest(hash.finalize().into()), bytes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::GzEncoder};

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn packed_and_plain_files_have_the_same_content() {
        // FIPS 180-2, appendix B.1.
        let sha256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let expected = Content { sha256: sha256.parse().unwrap(), bytes: 3 };
        let members = [gzip(b"a"), gzip(b"bc")].concat();
        for packed in [b"abc".to_vec(), gzip(b"abc"), members] {
            let mut written = Vec::new();
            assert_eq!(unpack(packed.as_slice(), &mut written, 3).unwrap(), expected);
            assert_eq!(written, b"abc");
        }
    }

    #[test]
    fn a_small_file_that_unpacks_to_a_large_one_is_stopped_at_the_limit() {
        let bomb = gzip(&vec![0; 10_000_000]);
        assert!(bomb.len() < 20_000);
        let mut written = Vec::new();
        let result = unpack(bomb.as_slice(), &mut written, 100_000);
        assert!(matches!(result, Err(UnpackError::TooLarge)), "{result:?}");
        assert!(written.len() <= 100_000);
    }

    #[test]
    fn a_gzip_file_that_is_cut_off_is_an_error() {
        let packed = gzip(b"FLASER 2 1.0 2.0");
        for length in 2..packed.len() {
            let result = unpack(&packed[..length], &mut io::sink(), 1000);
            let Err(UnpackError::Input(error)) = result else { panic!("{length}: {result:?}") };
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof, "{length}");
        }
    }
}
