//! The folder of a rosbag2 bag: its files, as `metadata.yaml` lists them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;

use super::CONTAINERS;

const METADATA_FILE: &str = "metadata.yaml";
/// Largest such file, in bytes: far more than thousands of files and topics need.
const MAX_METADATA_BYTES: u64 = 1 << 24;
/// Endings appended to the names of compressed files.
const PACKED: [&str; 6] = [".zstd", ".zst", ".gz", ".bz2", ".xz", ""];

/// Why a folder is not a bag.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FolderError(String);

/// The bag in a folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Folder {
    /// Its files in the order of writing.
    pub files: Vec<PathBuf>,
    /// Types of the messages by topic, as far as `metadata.yaml` states them.
    pub types: BTreeMap<String, String>,
}

/// The part of `metadata.yaml` that is read.
#[derive(Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    relative_file_paths: Vec<String>,
    #[serde(default)]
    compression_mode: Option<String>,
    #[serde(default)]
    compression_format: Option<String>,
    #[serde(default)]
    topics_with_message_count: Vec<TopicCount>,
}

#[derive(Deserialize)]
struct TopicCount {
    topic_metadata: TopicMetadata,
}

#[derive(Deserialize)]
struct TopicMetadata {
    name: String,
    #[serde(rename = "type")]
    type_name: String,
}

/// Whether a folder looks like a bag.
pub fn is_bag(folder: &Path) -> bool {
    folder.join(METADATA_FILE).is_file() || !bags_in(folder).is_empty()
}

/// Files in the folder that are named like bags, sorted by name.
fn bags_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let is_bag = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let storages = CONTAINERS.iter().filter(|container| container.storage.is_some());
        let mut endings = storages.flat_map(|container| {
            PACKED.iter().map(move |packed| format!(".{}{packed}", container.ending))
        });
        endings.any(|ending| name.ends_with(&ending))
    };
    let mut bags: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_bag).collect();
    bags.sort();
    bags
}

/// Whether a path stays below the folder it is joined to, on any system: a bag may come from anywhere.
fn stays_in_folder(path: &str) -> bool {
    let mut parts = Path::new(path).components();
    !path.is_empty()
        && !path.contains(['\\', ':', '\0'])
        && parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// The text of the file, at most [`MAX_METADATA_BYTES`].
fn read_metadata(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    fs::File::open(path)?.take(MAX_METADATA_BYTES + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MAX_METADATA_BYTES {
        return Err(io::Error::other(format!("it is longer than {MAX_METADATA_BYTES} bytes")));
    }
    Ok(text)
}

/// The bag in this folder.
///
/// # Errors
/// [`FolderError`] says what is wrong with its `metadata.yaml`, or that it is not known which of its files
/// belong together.
pub fn open(folder: &Path) -> Result<Folder, FolderError> {
    let path = folder.join(METADATA_FILE);
    let text = match read_metadata(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let files = bags_in(folder);
            return match files.len() {
                1 => Ok(Folder { files, ..Folder::default() }),
                count => Err(FolderError(format!(
                    "{count} files of bags but no {METADATA_FILE} that says which belong together; name one of them, or write the file with `ros2 bag reindex`"
                ))),
            };
        }
        Err(error) => return Err(FolderError(format!("{METADATA_FILE} cannot be read: {error}"))),
    };
    let information = parse(&text)?;
    let files = information.relative_file_paths.iter().map(|name| found(folder, name)).collect();
    let topics = information.topics_with_message_count.into_iter();
    let types = topics.map(|TopicCount { topic_metadata: topic }| (topic.name, topic.type_name));
    Ok(Folder { files, types: types.collect() })
}

/// The path of a listed file. Old recorders write the folder's own name before it, and those that compress
/// files afterwards leave out the ending that this appends.
fn found(folder: &Path, name: &str) -> PathBuf {
    let listed = folder.join(name);
    let beside = folder.join(listed.file_name().unwrap_or_default());
    let packed = |path: &Path| {
        ["", ".zstd", ".zst"].map(|ending| {
            let mut name = path.as_os_str().to_owned();
            name.push(ending);
            PathBuf::from(name)
        })
    };
    let candidates = [packed(&listed), packed(&beside)];
    candidates.into_iter().flatten().find(|path| path.is_file()).unwrap_or(listed)
}

/// The files listed in the text of a `metadata.yaml`, in the order of writing.
///
/// # Errors
/// [`FolderError`] for other texts, for files that lie elsewhere or are listed twice, and for an unknown
/// compression.
pub fn listed_files(text: &str) -> Result<Vec<String>, FolderError> {
    parse(text).map(|information| information.relative_file_paths)
}

#[cfg(feature = "bags")]
fn metadata(text: &str) -> Result<Metadata, FolderError> {
    serde_saphyr::from_str(text).map_err(|error| FolderError(format!("{METADATA_FILE}: {error}")))
}

#[cfg(not(feature = "bags"))]
fn metadata(_: &str) -> Result<Metadata, FolderError> {
    let (format, feature) = ("folders of bags", "bags");
    Err(FolderError(super::problem::StreamProblem::LeftOut { format, feature }.to_string()))
}

fn parse(text: &str) -> Result<Information, FolderError> {
    let information = metadata(text)?.rosbag2_bagfile_information;
    let is_said = |text: &Option<String>| {
        text.as_deref().is_some_and(|text| !matches!(text, "" | "NONE" | "none"))
    };
    if is_said(&information.compression_mode)
        && let Some(format) = information.compression_format.as_deref().filter(|f| *f != "zstd")
    {
        return Err(FolderError(format!(
            "{METADATA_FILE}: compression_format is {format:?}, expected \"zstd\"; unpack the bag with `ros2 bag convert`"
        )));
    }
    let files = &information.relative_file_paths;
    if files.is_empty() {
        return Err(FolderError(format!("{METADATA_FILE}: relative_file_paths is empty")));
    }
    if let Some(path) = files.iter().find(|path| !stays_in_folder(path)) {
        return Err(FolderError(format!(
            "{METADATA_FILE}: relative_file_paths lists {path:?}, expected paths below the folder of the bag, neither absolute nor with \"..\""
        )));
    }
    let mut seen = BTreeSet::new();
    let parts = |path: &str| -> PathBuf {
        Path::new(path).components().filter(|part| *part != Component::CurDir).collect()
    };
    if let Some(path) = files.iter().find(|path| !seen.insert(parts(path))) {
        return Err(FolderError(format!(
            "{METADATA_FILE}: relative_file_paths lists {path:?} twice, expected each file once"
        )));
    }
    Ok(information)
}
