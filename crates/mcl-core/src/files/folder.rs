use std::fs;
use std::io;
use std::path::Path;

use crate::files::fault;
use crate::files::operation::Operation;

/// Creates a folder and its parents; does nothing if it exists.
///
/// # Errors
/// The system's error.
pub fn create_folder(path: &Path) -> io::Result<()> {
    fault::next(Operation::Create, path, 0)?;
    fs::create_dir_all(path)
}

/// Removes a file, or a link without its target; does nothing if the path does not exist.
///
/// # Errors
/// The system's error.
pub fn remove(path: &Path) -> io::Result<()> {
    fault::next(Operation::Remove, path, 0)?;
    absent_is_fine(fs::remove_file(path))
}

/// Removes a folder and its content without following links; does nothing if the path does not exist.
///
/// # Errors
/// The system's error; part of the content may already be removed.
pub fn remove_folder(path: &Path) -> io::Result<()> {
    fault::next(Operation::Remove, path, 0)?;
    absent_is_fine(fs::remove_dir_all(path))
}

fn absent_is_fine(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        result => result,
    }
}

/// Waits until the entries of a folder are on the disk. Without this, a power cut could leave a synced file
/// without its name. Does nothing where folders cannot be synced.
///
/// # Errors
/// The system's error.
pub fn sync_folder(path: &Path) -> io::Result<()> {
    fault::next(Operation::Sync, path, 0)?;
    #[cfg(unix)]
    match fs::File::open(path).and_then(|folder| folder.sync_all()) {
        Err(error)
            if !matches!(
                error.kind(),
                io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported
            ) =>
        {
            return Err(error);
        }
        _ => {}
    }
    Ok(())
}

/// Returns the folder that contains a path.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
