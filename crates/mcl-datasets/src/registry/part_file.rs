use std::fs::TryLockError;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mcl_core::files::OwnFile;

use super::FetchError;

/// The bytes of a file received so far, as sent by the server. Locked, so that two programs never write the
/// same one.
pub(super) struct PartFile {
    file: OwnFile,
    len: u64,
}

impl PartFile {
    pub(super) fn open(path: PathBuf) -> Result<PartFile, FetchError> {
        let error = |source| FetchError::file("write", &path, source);
        loop {
            let file = OwnFile::open_or_create(&path).map_err(error)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(FetchError::Busy { path }),
                // Some network file systems have no locks; the digest still guards the content.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(source)) => return Err(error(source)),
            }
            // The previous owner of the lock may have finished, and removed the file, since it was opened.
            if file.is_in_place().map_err(error)? {
                let len = file.length().map_err(error)?;
                return Ok(PartFile { file, len });
            }
        }
    }

    pub(super) fn path(&self) -> &Path {
        self.file.path()
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// The file from its beginning.
    pub(super) fn reader(&mut self) -> Result<impl Read, FetchError> {
        self.file
            .seek(SeekFrom::Start(0))
            .map_err(|source| FetchError::file("read", self.file.path(), source))?;
        Ok(&mut self.file)
    }

    /// Discards what was received.
    pub(super) fn clear(&mut self) -> Result<(), FetchError> {
        self.len = 0;
        self.file.set_length(0).map_err(|source| FetchError::file("write", self.path(), source))
    }

    pub(super) fn append(&mut self, bytes: &[u8]) -> Result<(), FetchError> {
        self.file
            .seek(SeekFrom::Start(self.len))
            .and_then(|_| self.file.write_all(bytes))
            .map_err(|source| FetchError::file("write", self.path(), source))?;
        self.len += bytes.len() as u64;
        Ok(())
    }

    pub(super) fn remove(self) -> Result<(), FetchError> {
        let path = self.path().to_owned();
        self.file.remove().map_err(|source| FetchError::file("remove", &path, source))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_file_is_written_by_one_program_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.part");
        let mut first = PartFile::open(path.clone()).unwrap();
        first.append(b"abc").unwrap();
        assert!(matches!(PartFile::open(path.clone()), Err(FetchError::Busy { .. })));
        drop(first);
        let mut again = PartFile::open(path.clone()).unwrap();
        assert_eq!(again.len(), 3);
        again.append(b"de").unwrap();
        let mut text = String::new();
        again.reader().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "abcde");
        again.clear().unwrap();
        again.append(b"f").unwrap();
        again.remove().unwrap();
        assert!(!path.exists());
    }
}
