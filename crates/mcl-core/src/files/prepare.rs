use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::files::folder::folder_of;
use crate::files::identity::Identity;
use crate::files::output::check_replaceable;
use crate::files::temporary::remove_leftovers;

/// A file that cannot be written where it is asked for.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct Unwritable {
    /// Where.
    pub path: PathBuf,
    /// What stands in the way.
    pub source: io::Error,
}

/// Checks before anything is computed that files can be written at the paths `outputs`, and removes what killed
/// processes left beside them. Refused are: an output that is an input, under whatever name (a hard link, a
/// path through links, a file in an input that is a folder); two outputs that are one file; a folder that is not
/// there; and a link, folder, FIFO, socket or device where the file is to be. Inputs that are not there are
/// left to whoever reads them.
///
/// # Errors
/// The first reason.
pub fn prepare(outputs: &[&Path], inputs: &[&Path]) -> Result<(), Unwritable> {
    let inputs: Vec<Input> = inputs.iter().flat_map(|path| Input::all_of(path)).collect();
    let mut places: Vec<Place<'_>> = Vec::new();
    for output in outputs {
        let unwritable = |source| Unwritable { path: output.to_path_buf(), source };
        let place = Place::of(output).map_err(unwritable)?;
        place.check(&inputs, &places).map_err(unwritable)?;
        places.push(place);
    }
    for place in &places {
        remove_leftovers(folder_of(place.path));
    }
    Ok(())
}

/// A file that is read.
struct Input {
    path: PathBuf,
    identity: Identity,
}

impl Input {
    /// The file, or the files of a folder, such as that of a split bag.
    fn all_of(path: &Path) -> Vec<Input> {
        let mut paths = vec![path.to_owned()];
        if path.is_dir()
            && let Ok(entries) = fs::read_dir(path)
        {
            paths.extend(entries.flatten().map(|entry| entry.path()));
        }
        let known = |path: PathBuf| Some(Input { identity: Identity::of_path(&path).ok()?, path });
        paths.into_iter().filter_map(known).collect()
    }
}

/// Where a file is to be written.
struct Place<'a> {
    path: &'a Path,
    folder: Identity,
    name: &'a OsStr,
    /// Of what stands there.
    identity: Option<Identity>,
}

impl<'a> Place<'a> {
    fn of(path: &'a Path) -> io::Result<Self> {
        let invalid = |message| io::Error::new(io::ErrorKind::InvalidInput, message);
        let name = path
            .file_name()
            .ok_or_else(|| invalid("expected a path that ends in a file name".to_owned()))?;
        let folder = folder_of(path);
        if !folder.is_dir() {
            let message = format!("there is no folder {}", folder.display());
            return Err(io::Error::new(io::ErrorKind::NotFound, message));
        }
        let identity = match Identity::of_path(path) {
            Ok(identity) => Some(identity),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        Ok(Place { path, folder: Identity::of_path(folder)?, name, identity })
    }

    fn check(&self, inputs: &[Input], others: &[Place<'_>]) -> io::Result<()> {
        let refused = |message| Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        let stands_there = |identity: &Identity| self.identity.as_ref() == Some(identity);
        if let Some(input) = inputs.iter().find(|input| stands_there(&input.identity)) {
            let input = match input.path == self.path {
                true => "an input".to_owned(),
                false => format!("the input {} under another name", input.path.display()),
            };
            return refused(format!("it is {input}; give the output another name"));
        }
        let is_here = |other: &&Place<'_>| {
            other.identity.as_ref().is_some_and(stands_there)
                || (other.folder == self.folder && other.name == self.name)
        };
        if let Some(other) = others.iter().find(is_here) {
            let other = other.path.display();
            return refused(format!("{other} would be written there, too; give it another name"));
        }
        check_replaceable(self.path)
    }
}
