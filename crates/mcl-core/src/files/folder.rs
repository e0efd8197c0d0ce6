use std::fs;
use std::io;
use std::path::Path;

use crate::files::fault;
use crate::files::operation::Operation;

/// Creates a folder and those above it; it may be there already.
///
/// # Errors
/// The system's error.
pub fn create_folder(path: &Path) -> io::Result<()> {
    fault::next(Operation::Create, path, 0)?;
    fs::create_dir_all(path)
}

/// Removes a file, or a link and not what it leads to; nothing need be there.
///
/// # Errors
/// The system's error.
pub fn remove(path: &Path) -> io::Result<()> {
    fault::next(Operation::Remove, path, 0)?;
    absent_is_fine(fs::remove_file(path))
}

/// Removes a folder with all that is in it, following no links; nothing need be there.
///
/// # Errors
/// The system's error; a part of it may be removed then.
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

/// Waits until the names in a folder are on the disk: a power cut could otherwise leave a synced file
/// without its name. Where folders cannot be synced, nothing is done.
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

/// The folder that a path is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
