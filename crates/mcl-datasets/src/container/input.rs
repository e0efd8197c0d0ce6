//! The bytes of a container that is read sequentially.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use super::item::Input;
use super::problem::StreamProblem;
use crate::packed::{SNIFFED_BYTES, damage};

/// A reader that tracks offset and checksum.
pub(super) struct Counted<'a> {
    source: ByteSource<'a>,
    /// Bytes read or skipped so far.
    pub offset: u64,
    /// Checksum of all of them, as long as it is needed.
    pub crc: Option<crc32fast::Hasher>,
    /// Why the compressed file ends early, if it does.
    pub damaged: Option<String>,
}

enum ByteSource<'a> {
    Stream(Box<dyn Read + 'a>),
    File { file: BufReader<File>, length: u64 },
}

impl<'a> Counted<'a> {
    pub fn new(input: Input<'a>) -> Self {
        match input.file.and_then(seekable) {
            Some(file) => Self::of(file),
            None => Self::of_stream(input.stream),
        }
    }

    pub fn of_stream(stream: impl Read + 'a) -> Self {
        Self::of(ByteSource::Stream(Box::new(stream)))
    }

    fn of(source: ByteSource<'a>) -> Self {
        Counted { source, offset: 0, crc: None, damaged: None }
    }

    /// Length of the file; `None` where the input cannot be seeked.
    pub fn length(&self) -> Option<u64> {
        match self.source {
            ByteSource::Stream(_) => None,
            ByteSource::File { length, .. } => Some(length),
        }
    }

    /// Appends up to `length` bytes to `bytes`, fewer only at the end of the file.
    pub fn read_up_to(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<(), StreamProblem> {
        let start = bytes.len();
        let outcome = match &mut self.source {
            ByteSource::Stream(stream) => stream.take(length).read_to_end(bytes),
            ByteSource::File { file, .. } => file.take(length).read_to_end(bytes),
        };
        self.offset += (bytes.len() - start) as u64;
        if let Some(crc) = &mut self.crc {
            crc.update(&bytes[start..]);
        }
        self.ended(outcome.map(|_| ()))
    }

    /// Skips up to `length` bytes, and returns how many.
    pub fn skip(&mut self, length: u64) -> Result<u64, StreamProblem> {
        if let (Some(end), None) = (self.length(), &self.crc) {
            let skipped = length.min(end.saturating_sub(self.offset));
            self.seek(self.offset + skipped)?;
            return Ok(skipped);
        }
        let mut skipped = 0;
        let mut buffer = Vec::new();
        while skipped < length {
            buffer.clear();
            self.read_up_to((length - skipped).min(1 << 16), &mut buffer)?;
            if buffer.is_empty() {
                break;
            }
            skipped += buffer.len() as u64;
        }
        Ok(skipped)
    }

    /// Seeks to an offset of a file; bytes that are not read in order have no checksum.
    pub fn seek(&mut self, offset: u64) -> Result<(), StreamProblem> {
        if let ByteSource::File { file, .. } = &mut self.source {
            file.seek_relative(offset as i64 - self.offset as i64)?;
            self.offset = offset;
            self.crc = None;
        }
        Ok(())
    }

    /// Up to `length` bytes at an offset of a file; nothing for other inputs.
    pub fn peek(&mut self, offset: u64, length: u64) -> Result<Vec<u8>, StreamProblem> {
        let mut bytes = Vec::new();
        if let ByteSource::File { file, .. } = &mut self.source {
            // Bypasses the buffer, which stays unchanged.
            let file = file.get_mut();
            let at = file.stream_position()?;
            file.seek(SeekFrom::Start(offset))?;
            file.take(length).read_to_end(&mut bytes)?;
            file.seek(SeekFrom::Start(at))?;
        }
        Ok(bytes)
    }

    /// Treats a truncated or damaged compressed file as ending there.
    fn ended(&mut self, outcome: io::Result<()>) -> Result<(), StreamProblem> {
        match outcome {
            Ok(()) => Ok(()),
            Err(error) => match damage(&error) {
                Some(reason) => {
                    self.damaged = Some(reason);
                    Ok(())
                }
                None => Err(StreamProblem::Io(error)),
            },
        }
    }
}

/// A regular file, read from its first byte on: a pipe can be read only once.
fn seekable<'a>(path: &std::path::Path) -> Option<ByteSource<'a>> {
    let is_file = path.metadata().is_ok_and(|data| data.is_file());
    let file = is_file.then(|| File::open(path).ok()).flatten()?;
    let length = file.metadata().ok()?.len();
    Some(ByteSource::File { file: BufReader::with_capacity(SNIFFED_BYTES, file), length })
}
