use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::files::folder::folder_of;
use crate::files::identity::Identity;
use crate::files::output::check_replaceable;
use crate::files::temporary::remove_leftovers;

/// An output path at which no file can be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct Unwritable {
    /// The output path.
    pub path: PathBuf,
    /// The reason.
    pub source: io::Error,
}

/// Checks before anything is computed that files can be written at the paths `outputs`, and removes temporary files
/// that killed processes left beside them. These are errors: an output that is an input under any name (a hard link,
/// a path through links, a file in an input folder); two outputs that are the same file; a missing folder; and an
/// output path that is a link, folder, FIFO, socket or device. Missing inputs are not checked here; opening them
/// reports the error.
///
/// # Errors
/// [`Unwritable`] for the first output that fails a check.
pub fn prepare(outputs: &[&Path], inputs: &[&Path]) -> Result<(), Unwritable> {
    let inputs: HashMap<Identity, PathBuf> =
        inputs.iter().flat_map(|path| files_of(path)).collect();
    let mut places = CheckedOutputs::default();
    for output in outputs {
        let unwritable = |source| Unwritable { path: output.to_path_buf(), source };
        check(output, &inputs, &mut places).map_err(unwritable)?;
    }
    for folder in places.folders.values() {
        remove_leftovers(folder);
    }
    Ok(())
}

/// The files of an input: the file itself, or a folder (such as that of a split bag) and the files in it.
fn files_of(path: &Path) -> Vec<(Identity, PathBuf)> {
    let mut paths = vec![path.to_owned()];
    if path.is_dir()
        && let Ok(entries) = fs::read_dir(path)
    {
        paths.extend(entries.flatten().map(|entry| entry.path()));
    }
    let known = |path: PathBuf| Some((Identity::of_path(&path).ok()?, path));
    paths.into_iter().filter_map(known).collect()
}

/// The outputs checked so far.
#[derive(Default)]
struct CheckedOutputs<'a> {
    folders: HashMap<Identity, &'a Path>,
    /// By folder and name, because most do not exist yet.
    names: HashMap<(Identity, &'a OsStr), &'a Path>,
    /// Those that already exist.
    files: HashMap<Identity, &'a Path>,
}

fn check<'a>(
    path: &'a Path,
    inputs: &HashMap<Identity, PathBuf>,
    places: &mut CheckedOutputs<'a>,
) -> io::Result<()> {
    let refused = |message: String| Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    let Some(name) = path.file_name() else {
        return refused("expected a path that ends in a file name".to_owned());
    };
    let folder = folder_of(path);
    if !folder.is_dir() {
        let message = format!("there is no folder {}", folder.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, message));
    }
    let file = match Identity::of_path(path) {
        Ok(identity) => Some(identity),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    if let Some(input) = file.as_ref().and_then(|file| inputs.get(file)) {
        let input = match input == path {
            true => "an input".to_owned(),
            false => format!("the input {} under another name", input.display()),
        };
        return refused(format!("it is {input}; give the output another name"));
    }
    let folder_identity = Identity::of_path(folder)?;
    places.folders.insert(folder_identity.clone(), folder);
    let same_name = places.names.insert((folder_identity, name), path);
    let same_file = file.and_then(|file| places.files.insert(file, path));
    if let Some(other) = same_name.or(same_file) {
        let other = other.display();
        return refused(format!("{other} would be written there, too; give it another name"));
    }
    check_replaceable(path)
}
