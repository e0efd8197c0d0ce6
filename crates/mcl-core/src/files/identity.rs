use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

/// Identifies a file regardless of its names: device and inode number on Unix, the canonical path elsewhere.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Identity {
    #[cfg(unix)]
    device_and_number: (u64, u64),
    #[cfg(not(unix))]
    path: std::path::PathBuf,
}

impl Identity {
    /// The identity of the file at a path, following links.
    pub(crate) fn of_path(path: &Path) -> io::Result<Self> {
        Self::of(&std::fs::metadata(path)?, path)
    }

    /// The identity of an open file that was opened at `path`.
    pub(crate) fn of_open(file: &File, path: &Path) -> io::Result<Self> {
        Self::of(&file.metadata()?, path)
    }

    #[cfg(unix)]
    fn of(metadata: &Metadata, _: &Path) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt;
        Ok(Identity { device_and_number: (metadata.dev(), metadata.ino()) })
    }

    #[cfg(not(unix))]
    fn of(_: &Metadata, path: &Path) -> io::Result<Self> {
        Ok(Identity { path: std::fs::canonicalize(path)? })
    }
}
