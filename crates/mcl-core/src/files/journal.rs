use std::fs;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use crate::files::folder::sync_folder;
use crate::files::hold::hold;
use crate::files::own_file::{OwnFile, open};

const ENDING: &str = ".jsonl";
const RANDOM: usize = 8;

/// An append-only file of lines, written by this process alone. It is never renamed or rewritten. Other processes
/// write journals of their own and may read all of them.
#[derive(Debug)]
pub struct Journal {
    file: OwnFile,
    /// Length of the complete lines in bytes.
    length: u64,
    /// Whether a partly written line could not be removed.
    is_torn: bool,
}

impl Journal {
    /// Creates a new, empty file `<prefix>-<process>-<random>.jsonl` in an existing folder.
    ///
    /// # Errors
    /// The system's error.
    pub fn create(folder: &Path, prefix: &str) -> io::Result<Self> {
        let prefix = format!("{prefix}-{}-", std::process::id());
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(ENDING).rand_bytes(RANDOM);
        let made = builder.make_in(folder, OwnFile::create_new)?;
        let (file, _) = made.keep().map_err(|error| error.error)?;
        // Otherwise a power cut could lose the file's name, and with it the content.
        sync_folder(folder)?;
        Ok(Journal { file, length: 0, is_torn: false })
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Appends a line, given without its line break. When this returns, the line is on the disk, in the file at the
    /// journal's path. If appending fails, the partly written line is removed.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] for a line that contains a line break; [`io::ErrorKind::NotFound`] if the file
    /// or a folder above it was removed or replaced; otherwise the system's error. If a partly written line could
    /// not be removed, all later calls fail.
    pub fn append(&mut self, line: &[u8]) -> io::Result<()> {
        if line.contains(&b'\n') {
            let message = "a line of a journal has no line break inside";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        let _held = hold();
        if self.is_torn {
            return Err(io::Error::other(
                "an earlier line was written only in part and could not be removed",
            ));
        }
        // A single write, so that readers mostly see complete lines.
        let bytes = [line, b"\n"].concat();
        match self.write(&bytes) {
            Ok(()) => self.length += bytes.len() as u64,
            Err(error) => {
                self.is_torn = self.file.set_length(self.length).is_err();
                return Err(error);
            }
        }
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.file.sync()?;
        // The system reports no error for writes to a file that was removed meanwhile; they are lost.
        match self.file.is_in_place()? {
            true => Ok(()),
            false => Err(io::Error::new(
                io::ErrorKind::NotFound,
                "the folder was removed or replaced while the run went on",
            )),
        }
    }
}

/// Lists the journals with a prefix in a folder, including those of other processes, sorted by name. A missing
/// folder has none.
///
/// # Errors
/// The system's error, except for a missing folder.
pub fn journals(folder: &Path, prefix: &str) -> io::Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut paths = Vec::new();
    for entry in entries {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(|name| is_journal(name, prefix)) {
            paths.push(entry.path());
        }
    }
    paths.sort();
    Ok(paths)
}

fn is_journal(name: &str, prefix: &str) -> bool {
    let parts = name
        .strip_prefix(prefix)
        .and_then(|rest| rest.strip_prefix('-')?.strip_suffix(ENDING)?.split_once('-'));
    parts.is_some_and(|(process, random)| {
        !process.is_empty()
            && process.bytes().all(|byte| byte.is_ascii_digit())
            && random.len() == RANDOM
            && random.bytes().all(|byte| byte.is_ascii_alphanumeric())
    })
}

/// A line read from a journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JournalLine {
    /// A complete line without its line break; its content is not checked.
    Whole(Vec<u8>),
    /// The last line has no line break: writing it was interrupted, or is still in progress.
    Torn {
        /// Its length so far, in bytes.
        bytes: u64,
    },
}

/// The iterator returned by [`journal_lines`].
#[derive(Debug)]
pub struct JournalLines {
    reader: BufReader<fs::File>,
    limit: usize,
    /// Number of lines started so far.
    number: u64,
    is_over: bool,
}

/// Reads the lines of any process's journal in the order they were appended, even while it is being written. A line
/// longer than `limit` bytes gives an [`io::ErrorKind::InvalidData`] error with its number; reading continues after
/// it. At most `limit` bytes are kept in memory.
///
/// # Errors
/// Those of [`open`].
pub fn journal_lines(path: &Path, limit: usize) -> io::Result<JournalLines> {
    Ok(JournalLines { reader: BufReader::new(open(path)?), limit, number: 0, is_over: false })
}

impl Iterator for JournalLines {
    type Item = io::Result<JournalLine>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        self.number += 1;
        let (mut line, mut bytes) = (Vec::new(), 0);
        loop {
            let read = match self.reader.fill_buf() {
                Ok(read) => read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => {
                    self.is_over = true;
                    return Some(Err(error));
                }
            };
            if read.is_empty() {
                self.is_over = true;
                return (bytes > 0).then_some(Ok(JournalLine::Torn { bytes }));
            }
            let end = read.iter().position(|&byte| byte == b'\n');
            let part = &read[..end.unwrap_or(read.len())];
            bytes += part.len() as u64;
            if bytes <= self.limit as u64 {
                line.extend_from_slice(part);
            }
            let used = part.len() + usize::from(end.is_some());
            self.reader.consume(used);
            if end.is_none() {
                continue;
            }
            if bytes <= self.limit as u64 {
                return Some(Ok(JournalLine::Whole(line)));
            }
            let (number, limit) = (self.number, self.limit);
            let message = format!("line {number} has {bytes} bytes, expected at most {limit}");
            return Some(Err(io::Error::new(io::ErrorKind::InvalidData, message)));
        }
    }
}
