//! The digest of a file's decompressed content: copies of a log are compared by it, not by how they are
//! compressed.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};

use super::Sha256Digest;

const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Digest and size of a file's decompressed content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Content {
    /// SHA-256 of the decompressed bytes.
    pub sha256: Sha256Digest,
    /// Number of decompressed bytes.
    pub bytes: u64,
}

impl Content {
    /// Reads a file, decompressing it when it begins like a gzip file, whatever its name.
    ///
    /// # Errors
    /// Those of the file system or the decompressor; a truncated gzip file is
    /// [`io::ErrorKind::UnexpectedEof`].
    pub fn of_file(path: &Path) -> io::Result<Content> {
        match unpack(File::open(path)?, &mut io::sink(), u64::MAX) {
            Ok(content) => Ok(content),
            Err(UnpackError::Input(error) | UnpackError::Output(error)) => Err(error),
            Err(UnpackError::TooLarge) => Err(io::ErrorKind::FileTooLarge.into()),
            #[cfg(feature = "fetch")]
            Err(UnpackError::NoMember) => Err(io::ErrorKind::NotFound.into()),
        }
    }
}

/// Why content could not be decompressed.
#[derive(Debug)]
pub(super) enum UnpackError {
    /// The input cannot be read or is no valid gzip stream.
    Input(io::Error),
    /// The output cannot be written.
    Output(io::Error),
    /// The decompressed content is larger than the limit.
    TooLarge,
    /// The archive has no file of this path.
    #[cfg(feature = "fetch")]
    NoMember,
}

/// An archive is read up to this many decompressed bytes.
#[cfg(feature = "fetch")]
const ARCHIVE_LIMIT: u64 = 1 << 30;

/// Copies `input` to `output`, decompressing gzip, and computes the digest of the output; stops beyond
/// `limit` bytes of output.
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

/// [`unpack`] of the file with this path in a tar archive, plain or compressed with gzip. Nothing else of the
/// archive is written, and its path is not used as a file name on disk.
#[cfg(feature = "fetch")]
pub(super) fn unpack_member(
    input: impl Read,
    member: &str,
    output: &mut impl Write,
    limit: u64,
) -> Result<Content, UnpackError> {
    let mut input = BufReader::new(input);
    let packed = input.fill_buf().map_err(UnpackError::Input)?.starts_with(&GZIP_MAGIC);
    let plain: Box<dyn Read + '_> =
        if packed { Box::new(MultiGzDecoder::new(input)) } else { Box::new(input) };
    let broken = |error: io::Error| match error.kind() {
        io::ErrorKind::UnexpectedEof => UnpackError::Input(error),
        _ => UnpackError::Input(io::Error::new(io::ErrorKind::InvalidData, error)),
    };
    let mut archive = tar::Archive::new(plain.take(ARCHIVE_LIMIT));
    for entry in archive.entries().map_err(broken)? {
        let entry = entry.map_err(broken)?;
        if entry.header().entry_type().is_file() && *entry.path_bytes() == *member.as_bytes() {
            return copy(entry, output, limit);
        }
    }
    Err(UnpackError::NoMember)
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

    fn tar(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut archive = tar::Builder::new(Vec::new());
        for (path, bytes) in files {
            let mut header = tar::Header::new_gnu();
            header.set_size(bytes.len() as u64);
            header.set_mode(0o644);
            archive.append_data(&mut header, path, *bytes).unwrap();
        }
        archive.into_inner().unwrap()
    }

    #[test]
    fn one_file_of_an_archive_is_taken_and_no_other() {
        let plain = tar(&[("a/data/other.ply", b"xyz"), ("a/data/scan.ply", b"abc")]);
        for archive in [plain.clone(), gzip(&plain)] {
            let mut written = Vec::new();
            let member = |path: &str, written: &mut Vec<u8>, limit| {
                unpack_member(archive.as_slice(), path, written, limit)
            };
            let content = member("a/data/scan.ply", &mut written, 3).unwrap();
            assert_eq!((written.as_slice(), content.bytes), (&b"abc"[..], 3));
            let large = member("a/data/scan.ply", &mut Vec::new(), 2);
            assert!(matches!(large, Err(UnpackError::TooLarge)), "{large:?}");
            for path in ["scan.ply", "a/data", "../a/data/scan.ply", ""] {
                let missing = member(path, &mut Vec::new(), 3);
                assert!(matches!(missing, Err(UnpackError::NoMember)), "{path}: {missing:?}");
            }
        }
        let broken = unpack_member(&b"no archive at all, ".repeat(60)[..], "a", &mut io::sink(), 9);
        assert!(matches!(broken, Err(UnpackError::Input(_))), "{broken:?}");
        let packed = gzip(&plain);
        for length in (2..packed.len()).step_by(7) {
            let cut = unpack_member(&packed[..length], "a/data/scan.ply", &mut io::sink(), 9);
            assert!(!matches!(cut, Err(UnpackError::NoMember | UnpackError::TooLarge)), "{cut:?}");
        }
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
