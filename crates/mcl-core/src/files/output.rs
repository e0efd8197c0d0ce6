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

/// Bytes that [`write_with`] collects before it writes them.
const BUFFER: usize = 1 << 17;

/// A file on its way: written beside `path` under a temporary name, it takes the name when it is whole
/// ([`Output::commit`]). Until then, and for good when it is dropped before, the name stands for what it stood
/// for. It does not buffer.
#[derive(Debug)]
pub struct Output {
    /// `None` once the temporary name is gone.
    file: Option<OwnFile>,
    path: PathBuf,
    is_synced: bool,
}

impl Output {
    /// Begins a file. What stands at `path` may be a file, which will be replaced, or nothing.
    ///
    /// # Errors
    /// When something else stands there, such as a link; the message says what. Else the system's error.
    pub fn create(path: &Path) -> io::Result<Self> {
        Self::begin(path, false)
    }

    /// [`Output::create`] with a temporary name that ends as `path`, for readers that tell formats by it.
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

    /// Where the bytes are until they are whole.
    pub fn temporary_path(&self) -> &Path {
        self.file.as_ref().map_or(&self.path, OwnFile::path)
    }

    /// Waits until the bytes are on the disk: then little is left that [`Output::commit`] could fail at.
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

    /// Gives the file its name, replacing the file that was there.
    ///
    /// # Errors
    /// The system's error, or what else stands there by now; it is untouched then.
    pub fn commit(self) -> io::Result<()> {
        self.finish(|from, to| {
            // A rename would not follow a link, but replace it.
            check_replaceable(to)?;
            fault::next(Operation::Rename, to, 0)?;
            fs::rename(from, to)
        })
    }

    /// Gives the file its name unless something stands there.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if something does, or the system's error.
    pub fn commit_new(self) -> io::Result<()> {
        self.finish(|from, to| {
            fault::next(Operation::Rename, to, 0)?;
            TempPath::try_from_path(from)?.persist_noclobber(to).map_err(|failed| {
                // Removed as every other output that was not finished.
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
            // Nobody can be told; it is a leftover then.
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

/// Checks that a file can take the place of what stands at a path: a file, or nothing.
pub(crate) fn check_replaceable(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(metadata) => check_regular(&metadata, path),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

/// Writes a file that is whole or not there, replacing what was there; see [`Output`].
///
/// # Errors
/// As [`Output::create`]; `path` is then as it was before.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// [`write_atomically`] of what `write` writes piece by piece; it must not write other files.
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
