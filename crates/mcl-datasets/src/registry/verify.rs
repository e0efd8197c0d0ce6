use std::io;
use std::path::PathBuf;

use super::{Content, Dataset, FactMismatch, ReadLog, ReadLogError, Registry, RegistryError};

/// The result of [`Registry::verify`] for a data set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verification {
    /// A simulated data set: there is no file to verify.
    Simulated,
    /// A file was found.
    Found(FoundCopy),
}

/// The file of a data set, compared with the registry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundCopy {
    /// The file.
    pub path: PathBuf,
    /// Digest and size of its decompressed content.
    pub content: Content,
    /// Whether the digest is on the list of known copies.
    pub accepted: bool,
    /// The facts that differ; `None` when none are recorded.
    pub mismatches: Option<Vec<FactMismatch>>,
}

impl FoundCopy {
    /// Whether the file is good: it is a known copy or agrees with recorded facts, and no fact differs.
    pub fn is_good(&self) -> bool {
        match &self.mismatches {
            Some(mismatches) => mismatches.is_empty(),
            None => self.accepted,
        }
    }

    /// The result in a few words.
    pub fn status(&self) -> &'static str {
        match (self.accepted, self.mismatches.as_deref()) {
            (true, None) => "known copy, no facts recorded",
            (true, Some([])) => "known copy, facts agree",
            (true, Some(_)) => "known copy, facts differ",
            (false, None) => "unknown copy, no facts recorded",
            (false, Some([])) => "unknown copy, facts agree",
            (false, Some(_)) => "unknown copy, facts differ",
        }
    }
}

/// Why a data set could not be verified.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VerifyError {
    /// Its file is not on disk.
    #[error(transparent)]
    Locate(#[from] RegistryError),
    /// Its file cannot be read or decompressed.
    #[error("cannot read {}: {source}; remove it and fetch it again", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The system's or the decompressor's reason.
        source: io::Error,
    },
    /// Its file is not a log of the expected format.
    #[error("{} (sha256 {}) cannot be read as a log: {source}", path.display(), content.sha256)]
    Log {
        /// The file.
        path: PathBuf,
        /// Digest and size of its decompressed content.
        content: Content,
        /// The reader's reason.
        source: ReadLogError,
    },
}

impl Registry {
    /// Compares the file of a data set with the known copies and the recorded facts; `read` reads
    /// it for the facts.
    ///
    /// # Errors
    /// [`VerifyError`] when there is no file or it cannot be read. A file that differs from the registry is
    /// not an error, but reported in [`FoundCopy`].
    pub fn verify(
        &self,
        dataset: &Dataset,
        read: &ReadLog<'_>,
    ) -> Result<Verification, VerifyError> {
        let Some(file) = dataset.log_file() else {
            return Ok(Verification::Simulated);
        };
        let path = self.locate(dataset)?;
        let content = Content::of_file(&path)
            .map_err(|source| VerifyError::Content { path: path.clone(), source })?;
        let mismatches = match dataset.facts {
            None => None,
            Some(facts) => match read(&path) {
                Ok(found) => Some(facts.check(&found)),
                Err(source) => return Err(VerifyError::Log { path, content, source }),
            },
        };
        Ok(Verification::Found(FoundCopy {
            path,
            accepted: file.accepts(&content),
            content,
            mismatches,
        }))
    }
}
