//! The file layer: every file that the suite writes goes through this module.
//!
//! - **Atomic writes.** A file is written under a temporary name in the same folder ([`Output`],
//!   [`write_atomically`], [`write_with`]) and renamed in one step once it is complete.
//! - **No writing through links, no replacing of anything but files.** If the output path is a link, folder, FIFO,
//!   socket or device, writing fails with an error that says which.
//! - **No overwriting of inputs.** [`prepare`] compares files, not names, before anything is computed.
//! - **Rows** go into a [`Journal`], a file that a single process appends to. Other processes only read it
//!   ([`journal_lines`]), so no lock is needed.
//! - **Leftovers** of killed processes are recognized by their names and removed ([`remove_leftovers`]) once no
//!   process writes them any more.
//! - **Fault injection.** With the feature `fault-injection`, tests can make every operation fail, stop partway or
//!   be the last one (the module `fault`).
//!
//! # Example
//! ```
//! use mcl_core::files::{Journal, JournalLine, journal_lines, prepare, write_atomically};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! let (log, map) = (folder.join("office.log"), folder.join("map.csv"));
//! std::fs::write(&log, "...")?;
//! assert!(prepare(&[&log], &[&log]).is_err()); // An output must not be an input.
//! prepare(&[&map], &[&log])?;
//! write_atomically(&map, b"x,y\n0,1\n")?;
//!
//! let mut journal = Journal::create(folder, "rows")?;
//! journal.append(br#"{"trial":1}"#)?;
//! let lines = journal_lines(journal.path(), 1 << 20)?.collect::<Result<Vec<_>, _>>()?;
//! assert_eq!(lines, [JournalLine::Whole(br#"{"trial":1}"#.to_vec())]);
//! # Ok(())
//! # }
//! ```

#[cfg(feature = "fault-injection")]
pub mod fault;
#[cfg(not(feature = "fault-injection"))]
mod fault {
    //! No fault injection: every operation is carried out unchanged.
    use std::io;
    use std::path::Path;

    pub(super) use super::operation::Operation;

    pub(super) fn next(_: Operation, _: &Path, bytes: usize) -> io::Result<usize> {
        Ok(bytes)
    }
}
mod folder;
mod hold;
mod identity;
mod journal;
mod operation;
mod output;
mod own_file;
mod prepare;
mod temporary;

pub use folder::{create_folder, remove, remove_folder, sync_folder};
pub use hold::{Held, hold};
pub use journal::{Journal, JournalLine, JournalLines, journal_lines, journals};
pub use output::{Output, write_atomically, write_with};
pub use own_file::{OwnFile, open};
pub use prepare::{Unwritable, prepare};
pub use temporary::remove_leftovers;
