use std::io;
use std::path::{Path, PathBuf};

use mcl_core::files::{Output, Unwritable, create_folder, prepare, remove_leftovers, sync_folder};

use super::content::{UnpackError, unpack, unpack_member};
use super::download::{agent, receive};
use super::failure::Stop;
use super::part_file::PartFile;
use super::{
    Content, Dataset, FactMismatch, FetchEvent, FetchSettings, LogFile, ReadLog, ReadLogError,
    Registry, UrlFailure, joined,
};

/// A download is stopped when the file is larger than this many times the largest known copy: copies differ
/// in a few header lines.
const SIZE_FACTOR: u64 = 4;

/// Files up to this size are always read to the end, so that a small wrong one is reported with its digest.
const SIZE_FLOOR: u64 = 1 << 20;

/// Download limit for an archive, of which the wanted file may be a small part.
const ARCHIVE_DOWNLOAD_LIMIT: u64 = 256 << 20;

/// The result of a fetch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fetched {
    /// A simulated data set: there is nothing to fetch.
    Simulated,
    /// A known copy was on disk already; no request was made.
    AlreadyPresent {
        /// The file.
        path: PathBuf,
        /// Digest and size of its decompressed content.
        content: Content,
    },
    /// The file was downloaded, decompressed and checked.
    Downloaded {
        /// The file, decompressed.
        path: PathBuf,
        /// Where it came from.
        url: String,
        /// Digest and size of its decompressed content.
        content: Content,
    },
}

/// Why a data set could not be fetched. In no case is there a file under the final name that was not
/// completely received and checked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FetchError {
    /// The definition names no address.
    #[error(
        "data set `{name}` names no address to fetch it from; put its file into {}",
        folder.display()
    )]
    NoUrl {
        /// Name of the data set.
        name: String,
        /// Where its file is looked for.
        folder: PathBuf,
    },
    /// A file that is not a known copy lies where the data set is looked for.
    #[error(
        "{} is there already, but is not a known copy of data set `{name}`: sha256 {} of {} bytes \
         (unpacked); move it away to fetch a known copy, or, if it is good \
         (`mcl-eval datasets verify {name}` compares scans and points), {}",
        path.display(),
        found.sha256,
        found.bytes,
        how_to_accept(name, found)
    )]
    UnknownFile {
        /// Name of the data set.
        name: String,
        /// The file.
        path: PathBuf,
        /// Digest and size of its decompressed content.
        found: Content,
    },
    /// A file that cannot be read or decompressed lies where the data set is looked for.
    #[error("{} is there already, but cannot be read: {source}; move it away to fetch", path.display())]
    UnreadableFile {
        /// The file.
        path: PathBuf,
        /// The system's or the decompressor's reason.
        source: io::Error,
    },
    /// Another program is downloading the same file.
    #[error("{} is locked: another program is fetching the same data set", path.display())]
    Busy {
        /// The part file.
        path: PathBuf,
    },
    /// A file or folder cannot be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    File {
        /// What was attempted.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// No address yielded a known copy.
    #[error(
        "data set `{name}` could not be fetched{}{}{}",
        listed(failures),
        kept_hint(kept),
        accept_hint(name, failures)
    )]
    AllFailed {
        /// Name of the data set.
        name: String,
        /// The last failure of each address.
        failures: Vec<(String, UrlFailure)>,
        /// The part file and its size in bytes, if there is something to resume.
        kept: Option<(PathBuf, u64)>,
    },
    /// A known copy cannot be read as a log.
    #[error(
        "the file from {url} is a known copy of data set `{name}`, but is not a readable log: {source}"
    )]
    Log {
        /// Name of the data set.
        name: String,
        /// Where it came from.
        url: String,
        /// The reader's reason.
        source: ReadLogError,
    },
    /// A known copy disagrees with the recorded facts: the definition contradicts itself.
    #[error(
        "the file from {url} is a known copy of data set `{name}`, but disagrees with the recorded \
         facts ({}); correct `[facts]` or `[[copy]]` of its dataset.toml",
        joined(mismatches)
    )]
    Facts {
        /// Name of the data set.
        name: String,
        /// Where it came from.
        url: String,
        /// The facts that differ.
        mismatches: Vec<FactMismatch>,
    },
}

impl FetchError {
    pub(super) fn file(action: &'static str, path: &Path, source: io::Error) -> FetchError {
        FetchError::File { action, path: path.to_owned(), source }
    }
}

fn listed(failures: &[(String, UrlFailure)]) -> String {
    failures.iter().map(|(url, failure)| format!("\n  {url}: {failure}")).collect()
}

fn kept_hint(kept: &Option<(PathBuf, u64)>) -> String {
    kept.as_ref().map_or(String::new(), |(path, bytes)| {
        format!(
            "\n{bytes} bytes are kept in {}; fetch again to continue from there",
            path.display()
        )
    })
}

fn accept_hint(name: &str, failures: &[(String, UrlFailure)]) -> String {
    let unknown = failures.iter().find_map(|(_, failure)| match failure {
        UrlFailure::UnknownCopy { found, .. } => Some(found),
        _ => None,
    });
    unknown.map_or(String::new(), |found| {
        format!(
            "\nIf that copy is good (download it yourself into datasets/{name}/, and \
             `mcl-eval datasets verify {name}` compares scans and points), {}",
            how_to_accept(name, found)
        )
    })
}

fn how_to_accept(name: &str, Content { sha256, bytes }: &Content) -> String {
    format!(
        "add to datasets/{name}/dataset.toml:\n[[copy]]\nsha256 = \"{sha256}\"\nbytes = {bytes}"
    )
}

impl Registry {
    /// Fetches the file of a data set, unless a known copy is on disk: requests its addresses in turn,
    /// resumes an earlier attempt, decompresses, and checks digest and facts (`read` reads the file for
    /// them). Only then does the file get its final name, atomically.
    ///
    /// The part received is kept as `<file>.part` when the transfer broke off, and removed when it turned out
    /// wrong. Progress is passed to `report`; the library prints nothing.
    ///
    /// # Errors
    /// [`FetchError`]; an existing file is never overwritten.
    pub fn fetch(
        &self,
        dataset: &Dataset,
        settings: &FetchSettings,
        read: &ReadLog<'_>,
        report: &mut dyn FnMut(FetchEvent<'_>),
    ) -> Result<Fetched, FetchError> {
        let Some(file) = dataset.log_file() else {
            return Ok(Fetched::Simulated);
        };
        let folder = self.fetch_folder(dataset);
        let part_path = folder.join(format!("{}.part", file.name));
        remove_leftovers(&folder);
        for (is_later, path) in self.present_files(dataset, file) {
            let content = Content::of_file(&path)
                .map_err(|source| FetchError::UnreadableFile { path: path.clone(), source })?;
            if file.accepts(&content) {
                // Left by a fetch that was killed at its very end.
                if part_path.exists()
                    && let Ok(part) = PartFile::open(part_path)
                {
                    drop(part.remove());
                }
                return Ok(Fetched::AlreadyPresent { path, content });
            }
            // A later one would no longer be found once the file is fetched, so it does no harm.
            if !is_later {
                let name = dataset.name.clone();
                return Err(FetchError::UnknownFile { name, path, found: content });
            }
        }
        if file.urls.is_empty() {
            return Err(FetchError::NoUrl { name: dataset.name.clone(), folder });
        }
        create_folder(&folder).map_err(|source| FetchError::file("create", &folder, source))?;
        prepare(&[&folder.join(&file.name)], &[])
            .map_err(|Unwritable { path, source }| FetchError::file("write", &path, source))?;
        let part = PartFile::open(part_path)?;
        let agent = agent(settings);
        Fetch { dataset, file, folder, settings, read, agent, part }.run(report)
    }
}

/// A fetch in progress.
struct Fetch<'a> {
    dataset: &'a Dataset,
    file: &'a LogFile,
    folder: PathBuf,
    settings: &'a FetchSettings,
    read: &'a ReadLog<'a>,
    agent: ureq::Agent,
    part: PartFile,
}

impl Fetch<'_> {
    fn run(mut self, report: &mut dyn FnMut(FetchEvent<'_>)) -> Result<Fetched, FetchError> {
        let result = self.try_urls(report);
        let is_useless = result.is_ok() || self.part.len() == 0;
        let removed = if is_useless { self.part.remove() } else { Ok(()) };
        let fetched = result?;
        removed?;
        Ok(fetched)
    }

    fn try_urls(&mut self, report: &mut dyn FnMut(FetchEvent<'_>)) -> Result<Fetched, FetchError> {
        let mut failures = Vec::new();
        for url in &self.file.urls {
            match self.try_url(url, report) {
                Ok((path, content)) => {
                    return Ok(Fetched::Downloaded { path, url: url.clone(), content });
                }
                Err(Stop::Url(failure)) => failures.push((url.clone(), failure)),
                Err(Stop::Fetch(error)) => return Err(error),
            }
        }
        let bytes = self.part.len();
        let kept = (bytes > 0).then(|| (self.part.path().to_owned(), bytes));
        Err(FetchError::AllFailed { name: self.dataset.name.clone(), failures, kept })
    }

    fn try_url(
        &mut self,
        url: &str,
        report: &mut dyn FnMut(FetchEvent<'_>),
    ) -> Result<(PathBuf, Content), Stop> {
        let mut attempt = 1;
        loop {
            let failure = match self.attempt(url, report) {
                Err(Stop::Url(failure)) => failure,
                done_or_stopped => return done_or_stopped,
            };
            let retrying = failure.is_worth_retrying() && attempt < self.settings.attempts;
            report(FetchEvent::Failed { url, failure: &failure, retrying });
            if !retrying {
                return Err(failure.into());
            }
            attempt += 1;
            std::thread::sleep(self.settings.retry_wait);
        }
    }

    fn attempt(
        &mut self,
        url: &str,
        report: &mut dyn FnMut(FetchEvent<'_>),
    ) -> Result<(PathBuf, Content), Stop> {
        let largest = self.file.copies.iter().map(|copy| copy.bytes).max().unwrap_or(0);
        let limit = largest.saturating_mul(SIZE_FACTOR).max(SIZE_FLOOR);
        let receive_limit = if self.file.member.is_some() { ARCHIVE_DOWNLOAD_LIMIT } else { limit };
        let received = receive(&self.agent, url, &mut self.part, receive_limit, largest, report)?;

        let path = self.folder.join(&self.file.name);
        // In the final folder, so that giving it the final name is one step.
        let mut unpacked = Output::create_readable(&path)
            .map_err(|source| FetchError::file("create", &path, source))?;
        let input = self.part.reader()?;
        let content = match &self.file.member {
            Some(member) => unpack_member(input, member, &mut unpacked, limit),
            None => unpack(input, &mut unpacked, limit),
        };
        let failure = match content {
            Ok(content) if self.file.accepts(&content) => {
                return self.finish(url, unpacked, content);
            }
            Ok(found) => {
                let expected = self.file.copies.iter().map(|copy| copy.sha256).collect();
                UrlFailure::UnknownCopy { found, expected }
            }
            Err(UnpackError::TooLarge) => UrlFailure::TooLarge { limit, largest },
            Err(UnpackError::NoMember) => {
                UrlFailure::NoMember { member: self.file.member.clone().unwrap_or_default() }
            }
            Err(UnpackError::Output(source)) => {
                return Err(FetchError::file("write", &path, source).into());
            }
            Err(UnpackError::Input(error)) => match error.kind() {
                io::ErrorKind::UnexpectedEof if !received.end_is_known => {
                    return Err(UrlFailure::CutOff { received: self.part.len() }.into());
                }
                io::ErrorKind::UnexpectedEof
                | io::ErrorKind::InvalidInput
                | io::ErrorKind::InvalidData => UrlFailure::Gzip(error),
                _ => return Err(FetchError::file("read", self.part.path(), error).into()),
            },
        };
        self.part.clear()?;
        // The server's file may have changed since the part was received, or another address may have another
        // file: only a file received in one piece is known to be consistent.
        Err(if received.resumed { UrlFailure::Unfit } else { failure }.into())
    }

    /// Checks the facts of a known copy, and gives it its final name.
    fn finish(
        &mut self,
        url: &str,
        unpacked: Output,
        content: Content,
    ) -> Result<(PathBuf, Content), Stop> {
        if let Err(error) = self.check_facts(url, unpacked.temporary_path()) {
            self.part.clear()?;
            return Err(error.into());
        }
        let path = self.folder.join(&self.file.name);
        unpacked.commit_new().map_err(|source| FetchError::file("create", &path, source))?;
        // The part file, which is removed next, was the other copy.
        sync_folder(&self.folder)
            .map_err(|source| FetchError::file("write", &self.folder, source))?;
        Ok((path, content))
    }

    fn check_facts(&self, url: &str, path: &Path) -> Result<(), FetchError> {
        let Some(facts) = self.dataset.facts else {
            return Ok(());
        };
        let (name, url) = (self.dataset.name.clone(), url.to_owned());
        match (self.read)(path) {
            Err(source) => Err(FetchError::Log { name, url, source }),
            Ok(found) => match facts.check(&found) {
                mismatches if mismatches.is_empty() => Ok(()),
                mismatches => Err(FetchError::Facts { name, url, mismatches }),
            },
        }
    }
}
