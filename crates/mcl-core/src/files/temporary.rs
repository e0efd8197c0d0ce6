//! Temporary files `.<name>.mcl-eval-<host>-<process>-<random>.tmp` in the folder of their output. On Unix, the
//! process that writes one keeps it locked; the lock ends with the process, however it ends.

use std::fs;
#[cfg(unix)]
use std::fs::TryLockError;
use std::io;
use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

use crate::files::folder::{folder_of, remove};
use crate::files::own_file::OwnFile;

const MARK: &str = ".mcl-eval-";
const ENDING: &str = ".tmp";
const RANDOM: usize = 8;
/// A temporary name is no longer than the larger of this and the length of the final name, so that every file system
/// that accepts the final name accepts the temporary one.
const SHORT: usize = 64;
/// Extensions up to this length are kept when requested.
const LONGEST_ENDING: usize = 8;
/// An unlocked file that was not written to for this long counts as abandoned.
const ABANDONED_AFTER: Duration = Duration::from_secs(6 * 3600);

/// Six hexadecimal digits that identify this host, because locks and process ids of other hosts mean nothing here.
static HOST: LazyLock<String> = LazyLock::new(|| {
    #[cfg(unix)]
    {
        use sha2::{Digest, Sha256};
        let digest = Sha256::digest(rustix::system::uname().nodename().to_bytes());
        digest.iter().take(3).map(|byte| format!("{byte:02x}")).collect()
    }
    #[cfg(not(unix))]
    "000000".to_owned()
});

/// Creates a temporary file in the folder of `path`; with `keep_ending` it keeps the extension of `path`.
pub(crate) fn create_beside(path: &Path, keep_ending: bool) -> io::Result<OwnFile> {
    let name = path.file_name().ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidInput, "the path does not end in a file name")
    })?;
    let ending = match path.extension().and_then(|ending| ending.to_str()) {
        Some(ending) if keep_ending && ending.len() <= LONGEST_ENDING => {
            format!("{ENDING}.{ending}")
        }
        _ => ENDING.to_owned(),
    };
    let owner = format!("{MARK}{}-{}-", *HOST, std::process::id());
    let room = SHORT.max(name.len()) - 1 - owner.len() - RANDOM - ending.len();
    // The start of the name shows which output a leftover belongs to.
    let name = name.to_string_lossy();
    let ends = name.char_indices().map(|(at, letter)| at + letter.len_utf8());
    let cut = ends.take_while(|&end| end <= room).last().unwrap_or(0);
    let prefix = format!(".{}{owner}", &name[..cut]);
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(&ending).rand_bytes(RANDOM);
    let made = builder.make_in(folder_of(path), |path| {
        let file = OwnFile::create_new(path)?;
        // A process that removes leftovers may have removed the file before it was locked.
        match is_ours(&file)? {
            true => Ok(file),
            false => Err(io::ErrorKind::AlreadyExists.into()),
        }
    })?;
    Ok(made.keep().map_err(|error| error.error)?.0)
}

/// Locks a new file where the file system has locks; returns whether the file still belongs to this process.
#[cfg(unix)]
fn is_ours(file: &OwnFile) -> io::Result<bool> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Ok(false),
        Ok(()) | Err(TryLockError::Error(_)) => file.is_in_place(),
    }
}

/// On other systems a lock would block readers.
#[cfg(not(unix))]
fn is_ours(_: &OwnFile) -> io::Result<bool> {
    Ok(true)
}

/// Extracts the host from the name of a temporary file.
fn host_in(name: &str) -> Option<&str> {
    let (rest, ending) = name.strip_prefix('.')?.rsplit_once(ENDING)?;
    let is_ending = |ending: &str| ending.strip_prefix('.').is_some_and(|rest| !rest.contains('.'));
    if !ending.is_empty() && !is_ending(ending) {
        return None;
    }
    let (_, owner) = rest.rsplit_once(MARK)?;
    let mut parts = owner.split('-');
    let (host, process, random) = (parts.next()?, parts.next()?, parts.next()?);
    let all = |text: &str, what: fn(&u8) -> bool| text.bytes().all(|byte| what(&byte));
    let is_ours = parts.next().is_none()
        && host.len() == 6
        && all(host, u8::is_ascii_hexdigit)
        && !process.is_empty()
        && all(process, u8::is_ascii_digit)
        && random.len() == RANDOM
        && all(random, u8::is_ascii_alphanumeric);
    is_ours.then_some(host)
}

/// Whether a file is a temporary file that no process writes any more.
fn is_leftover(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let Some(host) = host_in(&name) else { return false };
    let Ok(metadata) = fs::symlink_metadata(path) else { return false };
    if !metadata.is_file() {
        return false;
    }
    match is_locked(path) {
        Some(true) => return false,
        Some(false) if host == *HOST => return true,
        _ => {}
    }
    let age = metadata.modified().ok().and_then(|time| time.elapsed().ok());
    age.is_some_and(|age| age > ABANDONED_AFTER)
}

/// Whether a process has locked a file; `None` if that cannot be determined.
#[cfg(unix)]
fn is_locked(path: &Path) -> Option<bool> {
    // Some file systems lock only files that are open for writing.
    let file = fs::OpenOptions::new().read(true).write(true).open(path).ok()?;
    match file.try_lock() {
        Ok(()) => Some(false),
        Err(TryLockError::WouldBlock) => Some(true),
        Err(TryLockError::Error(_)) => None,
    }
}

#[cfg(not(unix))]
fn is_locked(_: &Path) -> Option<bool> {
    None
}

/// Removes the temporary files in a folder whose processes were killed. Where that cannot be determined (another
/// host, or no locks), a file is removed if it was not written to for six hours. A file that cannot be removed is
/// left in place; it does no harm.
pub fn remove_leftovers(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| is_leftover(path)) {
        drop(remove(&path));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_layer_are_recognized() {
        for name in [
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd1234.tmp",
            "..mcl-eval-0a1b2c-1-AbCd1234.tmp",
            ".x.log.mcl-eval-0a1b2c-1-AbCd1234.tmp.log",
            ".a.tmp.b.mcl-eval-0a1b2c-1-AbCd1234.tmp",
        ] {
            assert_eq!(host_in(name), Some("0a1b2c"), "{name}");
        }
        for name in [
            "",
            ".tmp",
            "map.csv",
            "map.csv.mcl-eval-0a1b2c-4711-AbCd1234.tmp",
            ".map.csv.tmp",
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd1234",
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd1234.tmp.log.gz",
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd1234.tmpx",
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd123.tmp",
            ".map.csv.mcl-eval-0a1b2c--AbCd1234.tmp",
            ".map.csv.mcl-eval-0a1b2c-47b1-AbCd1234.tmp",
            ".map.csv.mcl-eval-0a1b2-4711-AbCd1234.tmp",
            ".map.csv.mcl-eval-0a1b2c-4711-AbCd1234-x.tmp",
            ".map.csv.4711-AbCd1234.tmp",
        ] {
            assert_eq!(host_in(name), None, "{name}");
        }
    }

    #[test]
    fn a_temporary_name_is_as_short_as_the_file_system_asks() {
        let folder = tempfile::tempdir().unwrap();
        for length in 1..=255 {
            let mut names = vec!["x".repeat(length)];
            if length > 8 {
                names.push("é".repeat(length / 2 - 2) + ".csv");
                names.push(format!("{}.metadata", "x".repeat(length - 9)));
            }
            for name in names {
                for keep_ending in [false, true] {
                    let file = create_beside(&folder.path().join(&name), keep_ending).unwrap();
                    let temporary = file.path().file_name().unwrap().to_str().unwrap();
                    assert!(temporary.len() <= name.len().max(SHORT), "{temporary}");
                    assert_eq!(host_in(temporary), Some(HOST.as_str()), "{temporary}");
                    let is_kept = temporary.ends_with(".csv");
                    assert_eq!(is_kept, keep_ending && name.ends_with(".csv"), "{temporary}");
                    file.remove().unwrap();
                }
            }
        }
    }
}
