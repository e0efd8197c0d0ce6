//! The registry of data sets: what is known about each, where its file is, how to get it, and whether a file
//! on disk is a good copy.
//!
//! A data set is a folder `datasets/<name>/` with a `dataset.toml` ([`Dataset`]); its file lies
//! beside the definition or in `$MCL_DATA_DIR/<name>/`, under any of its known names, packed or not.
//! The definitions of this repository are also built in, so that an installed binary knows them
//! anywhere; a folder of definitions adds to them and overrides them by name.
//!
//! # Copies, digests and facts
//! Copies of one public log differ in comment and parameter lines, hence in their digests, but not
//! in their scans. So a definition holds two things:
//! - the **digests** of copies somebody has examined (`[[copy]]`): SHA-256 and size of the
//!   *unpacked* content. [`Registry::fetch`] takes nothing else from the network;
//! - the **facts** (`[facts]`): numbers of scans, readings and points that any good copy has.
//!
//! [`Registry::verify`] distinguishes the four cases: accepted digest or unknown copy, facts agree or differ.
//! An unknown copy whose facts agree is usable; adding its digest to the list makes it an accepted one.
//!
//! # Example
//! ```
//! use mcl_datasets::registry::Registry;
//!
//! let registry = Registry::built_in()?;
//! let intel = registry.get("intel-lab")?;
//! assert_eq!(intel.facts.map(|facts| facts.points), Some(155_648));
//! # Ok::<(), mcl_datasets::registry::RegistryError>(())
//! ```

mod content;
mod dataset;
mod definition;
mod digest;
#[cfg(feature = "fetch")]
mod download;
mod facts;
#[cfg(feature = "fetch")]
mod failure;
#[cfg(feature = "fetch")]
mod fetch;
mod folders;
#[cfg(feature = "fetch")]
mod part_file;
mod verify;

use std::path::{Path, PathBuf};

pub use content::Content;
pub use dataset::{DEFINITION_FILE, Dataset, DatasetKind, KnownCopy, LogFile, Origin};
pub use definition::{DefinitionError, is_plain_name};
pub use digest::{ParseDigestError, Sha256Digest};
#[cfg(feature = "fetch")]
pub use download::{FetchEvent, FetchSettings};
pub use facts::{FactMismatch, Facts};
#[cfg(feature = "fetch")]
pub use failure::UrlFailure;
#[cfg(feature = "fetch")]
pub use fetch::{FetchError, Fetched};
pub use folders::{Registry, RegistryError};
pub use verify::{FoundCopy, Verification, VerifyError};

/// Computes the facts of a file. The registry itself knows no formats.
pub type ReadLog<'a> = dyn Fn(&Path) -> Result<Facts, ReadLogError> + 'a;

/// Any error of the reader of a log.
pub type ReadLogError = Box<dyn std::error::Error + Send + Sync>;

/// `a, b, c` for error messages.
fn joined<T: ToString>(items: &[T]) -> String {
    items.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}

fn displayed(paths: &[PathBuf]) -> String {
    joined(&paths.iter().map(|path| path.display()).collect::<Vec<_>>())
}
