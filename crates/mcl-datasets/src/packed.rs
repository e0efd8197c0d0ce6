//! Compressed files: gzip, bzip2, xz and zstd, recognized by their first bytes.

use std::io::{self, BufRead, BufReader, Read};

use crate::container::chunk::is_out_of_memory;
use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::GzDecoder;
use liblzma::read::XzDecoder;
use liblzma::stream::{CONCATENATED, Stream};

/// Number of bytes at the beginning of a file used to recognize its format.
pub(crate) const SNIFFED_BYTES: usize = 1 << 16;
/// Memory limit for decompressing an xz file, in bytes: `xz -9` needs 65 MiB.
const XZ_MEMORY: u64 = 256 << 20;
/// The first bytes of a zstd frame, also of a message that is compressed individually.
pub(crate) const ZSTD_MAGIC: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// The compression of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    Gzip,
    Bzip2,
    Xz,
    Zstd,
}

impl Packing {
    fn of(head: &[u8]) -> Option<Self> {
        // `BZh` and a digit are followed by the magic number of a block, or of the end of an empty file.
        let is_bzip2 = head.starts_with(b"BZh")
            && matches!(head.get(4..7), Some(b"\x31\x41\x59" | b"\x17\x72\x45"));
        match head {
            [0x1f, 0x8b, ..] => Some(Packing::Gzip),
            _ if is_bzip2 => Some(Packing::Bzip2),
            _ if head.starts_with(b"\xfd7zXZ\0") => Some(Packing::Xz),
            _ if head.starts_with(ZSTD_MAGIC) => Some(Packing::Zstd),
            _ => None,
        }
    }
}

/// The content of a file, decompressed if needed, with its first bytes for inspection.
pub(crate) struct Unpacked<'a> {
    /// The first bytes, at most [`SNIFFED_BYTES`], not all of them read yet.
    head: Vec<u8>,
    at: usize,
    /// Why no more bytes came, reported after those that did.
    error: Option<io::Error>,
    rest: Box<dyn BufRead + 'a>,
    /// Whether the file was compressed.
    pub is_packed: bool,
}

impl<'a> Unpacked<'a> {
    /// Reads the first bytes of a file.
    ///
    /// # Errors
    /// When not even these can be read.
    pub fn new(file: impl Read + 'a) -> io::Result<Self> {
        let mut file = BufReader::with_capacity(SNIFFED_BYTES, file);
        let packing = Packing::of(file.fill_buf()?);
        let mut rest: Box<dyn BufRead + 'a> = match packing {
            None => Box::new(file),
            Some(Packing::Gzip) => unpacking(Gzip(Some(GzDecoder::new(file)))),
            Some(Packing::Bzip2) => unpacking(MultiBzDecoder::new(file)),
            Some(Packing::Xz) => {
                let stream = Stream::new_stream_decoder(XZ_MEMORY, CONCATENATED)
                    .map_err(io::Error::other)?;
                unpacking(XzDecoder::new_stream(file, stream))
            }
            Some(Packing::Zstd) => unpacking(zstd::stream::read::Decoder::with_buffer(file)?),
        };
        let mut head = Vec::new();
        let error = rest.by_ref().take(SNIFFED_BYTES as u64).read_to_end(&mut head).err();
        Ok(Unpacked { head, at: 0, error, rest, is_packed: packing.is_some() })
    }

    /// The first bytes of the content.
    pub fn head(&self) -> &[u8] {
        &self.head
    }

    /// Why there is no content at all.
    pub fn take_error(&mut self) -> Option<io::Error> {
        if self.head.is_empty() { self.error.take() } else { None }
    }
}

impl Read for Unpacked<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut there = self.fill_buf()?;
        let length = there.read(buffer)?;
        self.consume(length);
        Ok(length)
    }
}

impl BufRead for Unpacked<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at < self.head.len() {
            return Ok(&self.head[self.at..]);
        }
        match self.error.take() {
            Some(error) => Err(error),
            None => self.rest.fill_buf(),
        }
    }

    fn consume(&mut self, length: usize) {
        let of_head = length.min(self.head.len() - self.at);
        self.at += of_head;
        if length > of_head {
            self.rest.consume(length - of_head);
        }
    }
}

fn unpacking<'a>(decoder: impl Read + 'a) -> Box<dyn BufRead + 'a> {
    Box::new(BufReader::with_capacity(SNIFFED_BYTES, Decoder(decoder)))
}

/// The members of a gzip file one after the other. Zeros after the last one are padding, as left by tapes and
/// block devices.
struct Gzip<R>(Option<GzDecoder<R>>);

impl<R: BufRead> Read for Gzip<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let Some(member) = &mut self.0 else { return Ok(0) };
            let length = member.read(buffer)?;
            if length > 0 || buffer.is_empty() {
                return Ok(length);
            }
            let Some(mut rest) = self.0.take().map(GzDecoder::into_inner) else { return Ok(0) };
            loop {
                let there = rest.fill_buf()?;
                let zeros = there.iter().take_while(|&&byte| byte == 0).count();
                if there.is_empty() {
                    return Ok(0);
                }
                let is_padding = zeros == there.len();
                rest.consume(zeros);
                if !is_padding {
                    break;
                }
            }
            self.0 = Some(GzDecoder::new(rest));
        }
    }
}

/// A decompressor whose errors can be distinguished from the system's: each library has its own kinds.
struct Decoder<R>(R);

impl<R: Read> Read for Decoder<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::Interrupted => error,
            _ if error.raw_os_error().is_some() => error,
            _ if is_out_of_memory(&error) => io::Error::new(io::ErrorKind::OutOfMemory, error),
            _ => io::Error::new(io::ErrorKind::InvalidData, error),
        })
    }
}

/// The description of an error in compressed data; `None` for errors of the system. Reading a plain file
/// never gives these kinds.
pub(crate) fn damage(error: &io::Error) -> Option<String> {
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Some("the compressed data is cut off".to_owned()),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
            Some(format!("the compressed data is damaged ({error})"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn packed(packing: Packing, bytes: &[u8]) -> Vec<u8> {
        match packing {
            Packing::Gzip => {
                let mut encoder = flate2::write::GzEncoder::new(Vec::new(), Default::default());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
            Packing::Bzip2 => {
                let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), Default::default());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
            Packing::Xz => liblzma::encode_all(bytes, 6).unwrap(),
            Packing::Zstd => {
                let mut encoder = zstd::Encoder::new(Vec::new(), 1).unwrap();
                // As the `zstd` program writes it.
                encoder.include_checksum(true).unwrap();
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            }
        }
    }

    /// 200 kB of incompressible bytes.
    fn noise() -> Vec<u8> {
        let mut state = 1_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..200_000).map(|_| next()).collect()
    }

    const ALL: [Packing; 4] = [Packing::Gzip, Packing::Bzip2, Packing::Xz, Packing::Zstd];

    #[test]
    fn every_packing_is_recognized_by_its_first_bytes_even_in_parts() {
        for bytes in [noise(), Vec::new(), b"FLASER".to_vec()] {
            for packing in ALL {
                // As produced by `cat a.xz b.xz`.
                let twice = [packed(packing, &bytes), packed(packing, &bytes)].concat();
                assert_eq!(Packing::of(&twice), Some(packing));
                let mut found = Vec::new();
                Unpacked::new(&*twice).unwrap().read_to_end(&mut found).unwrap();
                assert!(found == [&*bytes, &*bytes].concat(), "{packing:?}");
            }
        }
        assert_eq!(Packing::of(b"BZhora 5"), None);
        let plain = Unpacked::new(&b"BZ"[..]).unwrap();
        assert!(!plain.is_packed && plain.head() == b"BZ");
    }

    #[test]
    fn zeros_after_a_gzip_file_are_padding() {
        let whole = packed(Packing::Gzip, &noise());
        for padding in [1, 511, 200_000] {
            let mut found = Vec::new();
            let padded = [&*whole, &*vec![0; padding]].concat();
            Unpacked::new(&*padded).unwrap().read_to_end(&mut found).unwrap();
            assert!(found == noise());
        }
        let mut found = Vec::new();
        let more = [&*whole, &[0; 7], b"more"].concat();
        let error = Unpacked::new(&*more).unwrap().read_to_end(&mut found).unwrap_err();
        assert!(damage(&error).is_some() && found == noise(), "{error:?}");
    }

    #[test]
    fn cut_off_and_damaged_data_is_reported_after_the_intact_part() {
        for packing in ALL {
            let whole = packed(packing, &noise());
            let cut = &whole[..whole.len() / 2];
            let mut damaged = whole.clone();
            let middle = whole.len() / 2;
            damaged[middle..middle + 60].fill(0x55);
            for (bytes, expected) in [(cut, "cut off"), (&damaged, "damaged")] {
                let mut found = Vec::new();
                let error = Unpacked::new(bytes).unwrap().read_to_end(&mut found).unwrap_err();
                let message = damage(&error).unwrap_or_else(|| panic!("{packing:?}: {error:?}"));
                assert!(message.contains(expected), "{packing:?}: {message}");
                // A checksum detects damage only after the content.
                assert!(expected == "damaged" || noise().starts_with(&found), "{packing:?}");
            }
        }
    }
}
