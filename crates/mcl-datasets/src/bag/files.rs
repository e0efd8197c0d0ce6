//! The files of a bag: one, or those that the `metadata.yaml` of a folder lists.

use std::fs;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;

use super::error::BagError;

const METADATA_FILE: &str = "metadata.yaml";
/// Largest such file, in bytes: far more than thousands of files and topics take.
const MAX_METADATA_BYTES: u64 = 1 << 24;

/// What is read of `metadata.yaml`.
#[derive(Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    #[serde(default)]
    compression_mode: Option<String>,
}

/// Whether a folder looks like that of a bag.
pub(crate) fn is_bag(folder: &Path) -> bool {
    folder.join(METADATA_FILE).is_file() || !bags_in(folder).is_empty()
}

/// Files in the folder whose names end with `.mcap`, in order of name.
fn bags_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut bags: Vec<PathBuf> =
        paths.filter(|path| path.extension().is_some_and(|ending| ending == "mcap")).collect();
    bags.sort();
    bags
}

/// Whether a path leads nowhere but below the folder it is joined to, on any system: a bag may come
/// from anywhere.
fn stays_in_folder(path: &str) -> bool {
    let mut parts = Path::new(path).components();
    !path.is_empty()
        && !path.contains(['\\', ':', '\0'])
        && parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// The text of the file, of at most [`MAX_METADATA_BYTES`].
fn read_metadata(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    fs::File::open(path)?.take(MAX_METADATA_BYTES + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MAX_METADATA_BYTES {
        return Err(io::Error::other(format!("it is longer than {MAX_METADATA_BYTES} bytes")));
    }
    Ok(text)
}

/// The files of the bag in this folder, in the order they were written.
pub(super) fn files_of(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let path = folder.join(METADATA_FILE);
    let text = match read_metadata(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let mut bags = bags_in(folder);
            return match bags.len() {
                1 => Ok(vec![bags.remove(0)]),
                _ => Err(BagError::Folder(format!(
                    "{} .mcap files but no {METADATA_FILE} that says which belong together; name one of them, or write the file with `ros2 bag reindex`",
                    bags.len()
                ))),
            };
        }
        Err(error) => {
            return Err(BagError::Folder(format!("{METADATA_FILE} cannot be read: {error}")));
        }
    };
    Ok(listed_files(&text)?.iter().map(|name| folder.join(name)).collect())
}

/// The files that the text of a `metadata.yaml` lists, in the order they were written.
///
/// # Errors
/// [`BagError::Folder`] for another text, and for a bag that is stored or packed in another way.
pub fn listed_files(text: &str) -> Result<Vec<String>, BagError> {
    let metadata: Metadata = serde_saphyr::from_str(text)
        .map_err(|error| BagError::Folder(format!("{METADATA_FILE}: {error}")))?;
    let Information { storage_identifier, relative_file_paths, compression_mode } =
        metadata.rosbag2_bagfile_information;
    if storage_identifier != "mcap" {
        return Err(BagError::Folder(format!(
            "{METADATA_FILE}: storage_identifier is {storage_identifier:?}, expected \"mcap\"; convert the bag with `ros2 bag convert` or `rosbags-convert`"
        )));
    }
    if let Some(mode) =
        compression_mode.filter(|mode| !matches!(mode.as_str(), "" | "NONE" | "none"))
    {
        return Err(BagError::Folder(format!(
            "{METADATA_FILE}: compression_mode is {mode:?}, expected none (MCAP compresses its own chunks); convert the bag with `ros2 bag convert`"
        )));
    }
    if relative_file_paths.is_empty() {
        return Err(BagError::Folder(format!("{METADATA_FILE}: relative_file_paths is empty")));
    }
    if let Some(path) = relative_file_paths.iter().find(|path| !stays_in_folder(path)) {
        return Err(BagError::Folder(format!(
            "{METADATA_FILE}: relative_file_paths lists {path:?}, expected paths below the folder of the bag, neither absolute nor with \"..\""
        )));
    }
    Ok(relative_file_paths)
}
