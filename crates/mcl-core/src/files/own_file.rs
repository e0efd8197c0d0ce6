use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::files::fault;
use crate::files::identity::Identity;
use crate::files::operation::Operation;

/// An open file that this process writes under its final name, for files that grow and are read before they are
/// complete. For atomic writes use an [`Output`](crate::files::Output), for rows a
/// [`Journal`](crate::files::Journal).
#[derive(Debug)]
pub struct OwnFile {
    file: File,
    path: PathBuf,
}

impl OwnFile {
    /// Creates a new file.
    ///
    /// # Errors
    /// The system's error; [`io::ErrorKind::AlreadyExists`] if anything exists at the path, including a dangling
    /// link.
    pub(crate) fn create_new(path: &Path) -> io::Result<Self> {
        fault::next(Operation::Create, path, 0)?;
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
        Ok(OwnFile { file, path: path.to_owned() })
    }

    /// Opens an existing file for reading and writing with its content, or creates it.
    ///
    /// # Errors
    /// If the path is anything but a file; the message says what it is. Links are never followed and FIFOs never
    /// waited for. Otherwise the system's error.
    pub fn open_or_create(path: &Path) -> io::Result<Self> {
        let before = match Self::create_new(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                fs::symlink_metadata(path)?
            }
            created => return created,
        };
        check_regular(&before, path)?;
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        // The path may refer to another file by now; nothing has been written yet.
        check_regular(&fs::symlink_metadata(path)?, path)?;
        let file = OwnFile { file, path: path.to_owned() };
        match file.is_in_place()? {
            true => Ok(file),
            false => Err(io::Error::other("it was replaced while it was opened; try again")),
        }
    }

    /// The path at which the file was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The length of the file in bytes.
    ///
    /// # Errors
    /// The system's error.
    pub fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Locks the file until it is closed or the process ends. Locks are advisory, and some file systems have none
    /// ([`io::ErrorKind::Unsupported`]).
    ///
    /// # Errors
    /// [`TryLockError::WouldBlock`] if it is locked elsewhere.
    pub fn try_lock(&self) -> Result<(), TryLockError> {
        self.file.try_lock()
    }

    /// Whether the path still refers to this file: neither it nor a folder above it was removed or replaced.
    ///
    /// # Errors
    /// The system's error, except for a missing file.
    pub fn is_in_place(&self) -> io::Result<bool> {
        match Identity::of_path(&self.path) {
            Ok(found) => Ok(found == Identity::of_open(&self.file, &self.path)?),
            Err(error) => match error.kind() {
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => Ok(false),
                _ => Err(error),
            },
        }
    }

    /// Truncates the file, or extends it by zeros, and seeks to its end.
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
    /// The system's error; it is then unknown which bytes are on the disk.
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

/// Opens a regular file for reading, following links. FIFOs and devices are refused, because reading them could block
/// forever.
///
/// # Errors
/// The system's error; [`io::ErrorKind::InvalidInput`] for anything but a file, with a message that says what it is.
pub fn open(path: &Path) -> io::Result<File> {
    check_regular(&fs::metadata(path)?, path)?;
    File::open(path)
}

/// Refuses anything but a regular file, with a message that says what it is.
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
    "not a regular file"
}
