//! Opening a log; its format is recognized by its first bytes.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use encoding_rs_io::DecodeReaderBytes;

use crate::bag::clouds::{self, BagCloud, CloudOptions};
use crate::bag::content::{Content, Purpose};
use crate::bag::error::BagError;
use crate::bag::poses::{self, PoseRequest, PoseTopic};
use crate::bag::recording;
use crate::bag::survey::Survey;
use crate::carmen;
use crate::carmen::ScanKind;
use crate::carmen::reader::CarmenError;
use crate::container::item::Input;
use crate::container::{self, folder};
use crate::log::content::Log;
use crate::log::error::LogError;
use crate::log::foreign;
use crate::log::options::ReadOptions;
use crate::log::reference;
use crate::packed::{Unpacked, damage};

/// Reads a log, plain or compressed, or the folder of a bag; the format depends on the first bytes, not the
/// name.
///
/// # Errors
/// [`LogError`] when the file cannot be opened or holds no scan. Malformed records and a damaged end
/// of the compressed data are no errors: the rest is read, and
/// [`ReadReport`](crate::log::ReadReport) says what was lost.
pub fn read_log(path: &Path) -> Result<Log, LogError> {
    read_log_as(path, &ReadOptions::default())
}

/// [`read_log`] with options for what the content of the log leaves open.
///
/// # Errors
/// As [`read_log`].
pub fn read_log_as(path: &Path, options: &ReadOptions) -> Result<Log, LogError> {
    // Opening a directory succeeds on Unix; reading it fails with a less helpful message.
    if path.is_dir() {
        let mut content = recording::content(options);
        add_folder(&mut content, path)?;
        return recording::assemble(content, options).map_err(at(path));
    }
    read_opened(open(path)?, path, true, options)
}

/// Reads a log from its bytes, plain or compressed, whose format depends on them. `path` stands for the file
/// in errors, and its name is used where the content is inconclusive.
///
/// # Errors
/// As [`read_log`].
pub fn read_log_from(
    input: impl Read,
    path: &Path,
    options: &ReadOptions,
) -> Result<Log, LogError> {
    let input = Unpacked::new(input).map_err(|error| io_error(path, error))?;
    read_opened(input, path, false, options)
}

/// `is_file` means that the bytes are those of the file at `path`.
fn read_opened(
    input: Unpacked<'_>,
    path: &Path,
    is_file: bool,
    options: &ReadOptions,
) -> Result<Log, LogError> {
    let input = some(input, path)?;
    if container::of(input.head()).is_some() {
        let mut content = recording::content(options);
        content.add(source(input, path, is_file), None).map_err(at(path))?;
        return recording::assemble(content, options).map_err(at(path));
    }
    let is_utf16 = matches!(input.head(), [0xff, 0xfe, ..] | [0xfe, 0xff, ..]);
    if !is_utf16 {
        refuse_foreign(&input, path)?;
    }
    let scans = options.topics.scan.as_deref();
    let kind = scans.and_then(ScanKind::named);
    let others = [&options.topics.odometry, &options.topics.reference].into_iter().flatten();
    let unknown = scans.filter(|_| kind.is_none());
    if let Some(topic) = unknown.or(others.map(String::as_str).next()) {
        return Err(LogError::NoTopics { path: path.to_owned(), topic: topic.to_owned() });
    }
    let of_bags = [
        ("--slice", options.slice.is_some()),
        ("--base-frame", options.base_frame.is_some()),
        ("--odom-frame", options.odometry_frame.is_some()),
        ("--laser-pose", options.laser_pose.is_some()),
    ];
    if let Some((option, _)) = of_bags.into_iter().find(|(_, is_asked)| *is_asked) {
        return Err(LogError::OfBags { path: path.to_owned(), option });
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let text: Box<dyn BufRead + '_> = match is_utf16 {
        true => Box::new(BufReader::new(DecodeReaderBytes::new(input))),
        false => Box::new(input),
    };
    let mut log =
        carmen::read_scans(text, &name, options.reference, kind).map_err(|error| match error {
            CarmenError::Io(error) => io_error(path, error),
            error => LogError::Carmen { path: path.to_owned(), error },
        })?;
    if let Some(track) = &options.reference_track {
        reference::replace(&mut log, track, options);
    }
    Ok(log)
}

/// Whether a path is a bag: the folder of one, or a file, plain or compressed, that begins like one.
///
/// # Errors
/// [`LogError`] when the file cannot be opened.
pub fn is_bag(path: &Path) -> Result<bool, LogError> {
    Ok(is_bag_folder(path) || !path.is_dir() && container::of(open(path)?.head()).is_some())
}

/// Reads the poses of one topic of a bag, a file or a folder: the requested topic, or the one found by its
/// type and name.
///
/// # Errors
/// [`LogError`] when it cannot be opened, is damaged, or no topic, or more than one, matches.
pub fn read_poses(path: &Path, request: &PoseRequest<'_>) -> Result<PoseTopic, LogError> {
    poses::poses(filled(Content::new(Purpose::Scans, None), path)?, request).map_err(at(path))
}

/// The contents of a bag, a file or a folder, even where it cannot be read as a log; `None` for anything
/// else. Of a damaged one, the part before the damage; [`Survey::truncated`] says what is wrong.
///
/// # Errors
/// [`LogError`] when it cannot be opened or is damaged before its first message.
pub fn survey(path: &Path, options: &ReadOptions) -> Result<Option<Survey>, LogError> {
    if !is_bag(path)? {
        return Ok(None);
    }
    let mut content = Content::new(Purpose::Topics, None);
    if let Err(error) = add(&mut content, path) {
        if content.is_empty() {
            return Err(error);
        }
        content.truncated = Some(error.to_string());
    }
    Ok(Some(Survey::of(&content, options)))
}

/// Reads the point clouds of one topic of a bag, a file or a folder.
///
/// # Errors
/// [`LogError`] when it cannot be opened or is not a bag, and as
/// [`bag::read_clouds`](crate::bag::read_clouds).
pub fn read_clouds(path: &Path, options: &CloudOptions) -> Result<BagCloud, LogError> {
    clouds::join(filled(clouds::content(options), path)?, options).map_err(at(path))
}

/// Whether a folder holds a bag: a `metadata.yaml`, or files that are named like those of bags.
pub fn is_bag_folder(path: &Path) -> bool {
    path.is_dir() && folder::is_bag(path)
}

/// Adds the content of the bag at a path, a file or a folder.
fn filled(mut content: Content, path: &Path) -> Result<Content, LogError> {
    add(&mut content, path)?;
    Ok(content)
}

fn add(content: &mut Content, path: &Path) -> Result<(), LogError> {
    if path.is_dir() {
        return add_folder(content, path);
    }
    let input = some(open(path)?, path)?;
    if container::of(input.head()).is_none() {
        refuse_foreign(&input, path)?;
    }
    content.add(source(input, path, true), None).map_err(at(path))
}

fn add_folder(content: &mut Content, folder: &Path) -> Result<(), LogError> {
    if !folder::is_bag(folder) {
        return Err(LogError::Directory { path: folder.to_owned() });
    }
    let bag = folder::open(folder).map_err(|error| at(folder)(error.into()))?;
    content.types = bag.types;
    for path in bag.files {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let input = some(open(&path)?, &path)?;
        content.add(source(input, &path, true), Some(&name)).map_err(at(&path))?;
    }
    Ok(())
}

fn source<'a>(input: Unpacked<'a>, path: &'a Path, is_file: bool) -> Input<'a> {
    let file = (is_file && !input.is_packed).then_some(path);
    Input { stream: Box::new(input), file }
}

fn at(path: &Path) -> impl FnOnce(BagError) -> LogError {
    move |error| LogError::Bag { path: path.to_owned(), error: Box::new(error) }
}

fn io_error(path: &Path, error: io::Error) -> LogError {
    LogError::Io { path: path.to_owned(), error }
}

/// Opens a file, and decompresses it if needed.
fn open(path: &Path) -> Result<Unpacked<'static>, LogError> {
    let file = File::open(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => LogError::NotFound { path: path.to_owned() },
        _ => io_error(path, error),
    })?;
    Unpacked::new(file).map_err(|error| io_error(path, error))
}

/// Refuses empty inputs.
fn some<'a>(mut input: Unpacked<'a>, path: &Path) -> Result<Unpacked<'a>, LogError> {
    match input.take_error() {
        Some(error) => Err(match damage(&error) {
            Some(reason) => LogError::Compressed { path: path.to_owned(), reason },
            None => io_error(path, error),
        }),
        None if input.head().is_empty() => Err(LogError::Empty { path: path.to_owned() }),
        None => Ok(input),
    }
}

/// Refuses an input that is neither a container nor text, naming its kind.
fn refuse_foreign(input: &Unpacked<'_>, path: &Path) -> Result<(), LogError> {
    let path = path.to_owned();
    if let Some(found) = foreign::of_head(input.head()) {
        return Err(LogError::Foreign { path, what: found.what, advice: found.advice });
    }
    match input.head().iter().position(|&byte| byte == 0) {
        Some(offset) => Err(LogError::Binary { path, offset }),
        None => Ok(()),
    }
}
