use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::files::fault;
use crate::files::identity::Identity;
use crate::files::operation::Operation;

/// An open file that this process writes itself, and under a name that is its own: a file that grows and is
/// read again before it is whole. What is to appear whole is an [`Output`](crate::files::Output), rows are
/// a [`Journal`](crate::files::Journal).
#[derive(Debug)]
pub struct OwnFile {
    file: File,
    path: PathBuf,
}

impl OwnFile {
    /// Creates a file that is not there yet.
    ///
    /// # Errors
    /// The system's error, [`io::ErrorKind::AlreadyExists`] for whatever is there, also a link that leads
    /// nowhere.
    pub(crate) fn create_new(path: &Path) -> io::Result<Self> {
        fault::next(Operation::Create, path, 0)?;
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
        Ok(OwnFile { file, path: path.to_owned() })
    }

    /// Opens a file to read and write with what it holds, or creates it.
    ///
    /// # Errors
    /// When something else than a file stands there, such as a link, which is never followed, or a FIFO,
    /// which is never waited for; the message says what. Else the system's error.
    pub fn open_or_create(path: &Path) -> io::Result<Self> {
        let before = match Self::create_new(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                fs::symlink_metadata(path)?
            }
            created => return created,
        };
        check_regular(&before, path)?;
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        // The name may lead somewhere else by now; nothing has been written yet.
        check_regular(&fs::symlink_metadata(path)?, path)?;
        let file = OwnFile { file, path: path.to_owned() };
        match file.is_in_place()? {
            true => Ok(file),
            false => Err(io::Error::other("it was replaced while it was opened; try again")),
        }
    }

    /// Where the file was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its length in bytes.
    ///
    /// # Errors
    /// The system's error.
    pub fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Locks the file until it is closed, be it by the end of the process. Locks keep apart those who ask
    /// for them; some file systems have none ([`io::ErrorKind::Unsupported`]).
    ///
    /// # Errors
    /// [`TryLockError::WouldBlock`] when it is locked elsewhere.
    pub fn try_lock(&self) -> Result<(), TryLockError> {
        self.file.try_lock()
    }

    /// Whether the path still leads to this file: it was neither removed nor replaced, nor a folder above it.
    ///
    /// # Errors
    /// The system's error, except that nothing is there.
    pub fn is_in_place(&self) -> io::Result<bool> {
        match Identity::of_path(&self.path) {
            Ok(found) => Ok(found == Identity::of_open(&self.file, &self.path)?),
            Err(error) => match error.kind() {
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Ok(false),
                _ => Err(error),
            },
        }
    }

    /// Cuts the file, or extends it by zeros, and goes on at its end.
    ///
    /// # Errors
    /// The system's error.
    pub fn set_length(&mut self, bytes: u64) -> io::Result<()> {
        fault::next(Operation::Truncate, &self.path, 0)?;
        self.file.set_len(bytes)?;
        self.file.seek(SeekFrom::Start(bytes)).map(drop)
    }

    /// Waits until the written bytes are on the disk.
    ///
    /// # Errors
    /// The system's error; it is then unknown which of them are.
    pub fn sync(&self) -> io::Result<()> {
        fault::next(Operation::Sync, &self.path, 0)?;
        self.file.sync_data()
    }

    /// Removes the file.
    ///
    /// # Errors
    /// The system's error.
    pub fn remove(self) -> io::Result<()> {
        fault::next(Operation::Remove, &self.path, 0)?;
        fs::remove_file(&self.path)
    }
}

impl Read for OwnFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.read(buffer)
    }
}

impl Write for OwnFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = fault::next(Operation::Write, &self.path, bytes.len())?;
        self.file.write(&bytes[..room])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(()) // There is no buffer.
    }
}

impl Seek for OwnFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Opens a file to be read, also through links, but nothing else: reading a FIFO or a device could wait for
/// ever.
///
/// # Errors
/// The system's error; [`io::ErrorKind::InvalidInput`] says what else stands there.
pub fn open(path: &Path) -> io::Result<File> {
    check_regular(&fs::metadata(path)?, path)?;
    File::open(path)
}

/// Refuses what is no regular file, saying what it is.
pub(crate) fn check_regular(metadata: &Metadata, path: &Path) -> io::Result<()> {
    let kind = metadata.file_type();
    let what = if kind.is_file() {
        return Ok(());
    } else if kind.is_dir() {
        "it is a folder".to_owned()
    } else if kind.is_symlink() {
        match fs::read_link(path) {
            Ok(target) => format!(
                "it is a symbolic link to {target:?}, which is not written through; remove the link, or name \
                 the file itself"
            ),
            Err(_) => "it is a symbolic link, which is not written through".to_owned(),
        }
    } else {
        format!("it is {}, expected a file or nothing", special(kind))
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, what))
}

#[cfg(unix)]
fn special(kind: fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        kind if kind.is_fifo() => "a FIFO (named pipe)",
        kind if kind.is_socket() => "a socket",
        _ => "a device",
    }
}

#[cfg(not(unix))]
fn special(_: fs::FileType) -> &'static str {
    "no ordinary file"
}
