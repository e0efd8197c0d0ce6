use std::fs;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use crate::files::folder::sync_folder;
use crate::files::hold::hold;
use crate::files::own_file::{OwnFile, open};

const ENDING: &str = ".jsonl";
const RANDOM: usize = 8;

/// A file of lines that this process alone appends to. Nobody ever renames or rewrites it; other processes
/// have files of their own, and read all.
#[derive(Debug)]
pub struct Journal {
    file: OwnFile,
    /// Bytes of whole lines.
    length: u64,
    /// Whether a part of a line could not be taken back.
    is_torn: bool,
}

impl Journal {
    /// Creates a new, empty file `<prefix>-<process>-<random>.jsonl` in a folder that is there.
    ///
    /// # Errors
    /// The system's error.
    pub fn create(folder: &Path, prefix: &str) -> io::Result<Self> {
        let prefix = format!("{prefix}-{}-", std::process::id());
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(ENDING).rand_bytes(RANDOM);
        let made = builder.make_in(folder, OwnFile::create_new)?;
        let (file, _) = made.keep().map_err(|error| error.error)?;
        // What is in the file would otherwise be lost with its name in a power cut.
        sync_folder(folder)?;
        Ok(Journal { file, length: 0, is_torn: false })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Saves a line, given without its end: when this returns it is on the disk, in the file that has the
    /// journal's name. A line that fails is taken back.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] for a line with a line break; [`io::ErrorKind::NotFound`] when the file
    /// was removed or replaced, or a folder above it; else the system's error. If a failed line could not
    /// be taken back, all later ones fail.
    pub fn append(&mut self, line: &[u8]) -> io::Result<()> {
        if line.contains(&b'\n') {
            let message = "a line of a journal has no line break inside";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        let _held = hold();
        if self.is_torn {
            return Err(io::Error::other(
                "an earlier line was written in part and could not be taken back",
            ));
        }
        // In one piece, so that others mostly see whole lines.
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
        // What is written to a file that was removed meanwhile is lost, without an error of the system.
        match self.file.is_in_place()? {
            true => Ok(()),
            false => Err(io::Error::new(
                io::ErrorKind::NotFound,
                "the folder was removed or replaced while the run went on",
            )),
        }
    }
}

/// The journals with a prefix in a folder, those of other processes included, in the order of their names.
///
/// # Errors
/// The system's error, except that there is no such folder.
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

/// What a journal holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JournalLine {
    /// A line, without its end. That it is whole does not say that it makes sense.
    Whole(Vec<u8>),
    /// The last line has no end: its writing was cut off, or goes on.
    Torn {
        /// Its length so far.
        bytes: u64,
    },
}

/// See [`journal_lines`].
#[derive(Debug)]
pub struct JournalLines {
    reader: BufReader<fs::File>,
    limit: usize,
    /// Lines begun so far.
    number: u64,
    is_over: bool,
}

/// Reads the lines of a journal of any process, also one that is still written to, in the order they were
/// appended. A line longer than `limit` bytes is an [`io::ErrorKind::InvalidData`] error that names it; lines after
/// it are read. No more memory than that is taken.
///
/// # Errors
/// When there is no file, or something else ([`open`]).
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
