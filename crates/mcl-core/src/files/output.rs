use std::fs;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

use crate::files::fault;
use crate::files::folder::remove;
use crate::files::hold::hold;
use crate::files::operation::Operation;
use crate::files::own_file::{OwnFile, check_regular};
use crate::files::temporary::create_beside;

/// Buffer size of [`write_with`] in bytes.
const BUFFER: usize = 1 << 17;

/// A file that is being written under a temporary name in the folder of `path`. [`Output::commit`] renames it to
/// `path` once it is complete. Until then, or if it is dropped before, whatever was at `path` is unchanged. Writes
/// are not buffered.
#[derive(Debug)]
pub struct Output {
    /// `None` once the temporary name no longer exists.
    file: Option<OwnFile>,
    path: PathBuf,
    is_synced: bool,
}

impl Output {
    /// Starts writing a file. An existing file at `path` will be replaced.
    ///
    /// # Errors
    /// If `path` is anything but a file, such as a link; the message says what it is. Otherwise the system's error.
    pub fn create(path: &Path) -> io::Result<Self> {
        Self::begin(path, false)
    }

    /// [`Output::create`] with a temporary name that keeps the extension of `path`, for readers that take the format
    /// from it.
    ///
    /// # Errors
    /// As [`Output::create`].
    pub fn create_readable(path: &Path) -> io::Result<Self> {
        Self::begin(path, true)
    }

    fn begin(path: &Path, keep_ending: bool) -> io::Result<Self> {
        check_replaceable(path)?;
        let file = create_beside(path, keep_ending)?;
        Ok(Output { file: Some(file), path: path.to_owned(), is_synced: false })
    }

    /// The temporary path that the bytes are written to.
    pub fn temporary_path(&self) -> &Path {
        self.file.as_ref().map_or(&self.path, OwnFile::path)
    }

    /// Waits until the bytes are on the disk, which leaves little that [`Output::commit`] could fail at.
    ///
    /// # Errors
    /// The system's error.
    pub fn sync(&mut self) -> io::Result<()> {
        if !self.is_synced {
            self.file_mut()?.sync()?;
        }
        self.is_synced = true;
        Ok(())
    }

    /// Renames the file to its path and replaces the file that was there.
    ///
    /// # Errors
    /// The system's error, or that something else than a file has appeared at the path, which is left unchanged.
    pub fn commit(self) -> io::Result<()> {
        self.finish(|from, to| {
            // A rename would replace a link, not follow it.
            check_replaceable(to)?;
            fault::next(Operation::Rename, to, 0)?;
            fs::rename(from, to)
        })
    }

    /// Renames the file to its path unless the path exists.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if the path exists, or the system's error.
    pub fn commit_new(self) -> io::Result<()> {
        self.finish(|from, to| {
            fault::next(Operation::Rename, to, 0)?;
            TempPath::try_from_path(from)?.persist_noclobber(to).map_err(|failed| {
                // Removed when dropped, like every unfinished output.
                drop(failed.path.keep());
                failed.error
            })
        })
    }

    fn finish(mut self, name: impl FnOnce(&Path, &Path) -> io::Result<()>) -> io::Result<()> {
        // Otherwise a power cut could leave the name without the bytes.
        self.sync()?;
        name(self.temporary_path(), &self.path)?;
        self.file = None;
        Ok(())
    }

    fn file_mut(&mut self) -> io::Result<&mut OwnFile> {
        self.file.as_mut().ok_or_else(|| io::Error::other("the file has its name already"))
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // A destructor cannot report an error; a file that stays is a leftover.
            drop(remove(file.path()));
        }
    }
}

impl Read for Output {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file_mut()?.read(buffer)
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.is_synced = false;
        self.file_mut()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Output {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file_mut()?.seek(to)
    }
}

/// Checks that a file can be written at a path: the path is a file or does not exist.
pub(crate) fn check_replaceable(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(metadata) => check_regular(&metadata, path),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

/// Writes a file atomically, replacing an existing one; see [`Output`].
///
/// # Errors
/// As [`Output::create`]; `path` is then as it was before.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// [`write_atomically`] for content that `write` produces piece by piece; `write` must not write other files.
///
/// # Errors
/// As [`write_atomically`], and those of `write`.
pub fn write_with<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<Output>) -> Result<(), E>,
) -> Result<(), E> {
    let _held = hold();
    let mut file = BufWriter::with_capacity(BUFFER, Output::create(path)?);
    write(&mut file)?;
    let output = file.into_inner().map_err(|error| error.into_error())?;
    Ok(output.commit()?)
}
