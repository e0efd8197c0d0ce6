//! The bytes of a container that stands in order.

use std::io::{self, Read};

use super::problem::StreamProblem;
use crate::packed::damage;

/// Counts and sums up what is read.
pub(super) struct Counted<R> {
    input: R,
    /// Bytes read so far.
    pub offset: u64,
    /// Checksum of all of them.
    pub crc: crc32fast::Hasher,
    /// Why the compressed file ends early, if it does.
    pub damaged: Option<String>,
}

impl<R: Read> Counted<R> {
    pub fn new(input: R) -> Self {
        Counted { input, offset: 0, crc: crc32fast::Hasher::new(), damaged: None }
    }

    /// Appends up to `length` bytes to `bytes`, fewer only at the end of the file.
    pub fn read_up_to(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<(), StreamProblem> {
        let start = bytes.len();
        let outcome = self.input.by_ref().take(length).read_to_end(bytes);
        self.offset += (bytes.len() - start) as u64;
        self.crc.update(&bytes[start..]);
        self.ended(outcome.map(|_| ()))
    }

    /// Passes over up to `length` bytes, and says over how many.
    pub fn skip(&mut self, length: u64) -> Result<u64, StreamProblem> {
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

    /// A compressed file that is cut or damaged ends there.
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
