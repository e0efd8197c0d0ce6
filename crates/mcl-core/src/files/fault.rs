//! Fault injection: tests can stop, truncate or fail any operation of the file layer.
//!
//! Available only with the feature `fault-injection`, because code that loses data on purpose must not be part of
//! the program that users build. Crates whose tests need it enable it in their development dependencies; then
//! `cargo test` builds the binary with it, while `cargo build` and `cargo install` do not:
//!
//! ```toml
//! [dev-dependencies]
//! mcl-core = { workspace = true, features = ["fault-injection"] }
//! ```
//!
//! Operations are counted from 0. Inside a test, [`during`] counts the operations of the calling thread and injects
//! the fault:
//!
//! ```
//! use mcl_core::files::fault::{Fault, during};
//! use mcl_core::files::write_atomically;
//!
//! # fn main() -> std::io::Result<()> {
//! # let folder = tempfile::tempdir()?;
//! let path = folder.path().join("map.csv");
//! let (_, operations) = during(Fault::None, || write_atomically(&path, b"old"));
//! assert_eq!(operations.len(), 4); // create, write, sync, rename
//! for at in 0..operations.len() {
//!     let (result, _) = during(Fault::Stop { at, bytes: 1 }, || write_atomically(&path, b"new"));
//!     assert!(result.is_err());
//!     assert_eq!(std::fs::read(&path)?, b"old");
//! }
//! # Ok(())
//! # }
//! ```
//!
//! For a whole program, the environment variable `MCL_FILE_FAULT` sets the fault. It counts the operations of all
//! threads, and a stop really kills the process: `MCL_FILE_FAULT="stop 7"`, `"stop 7 13"`, `"fail 7"`, `"full 7 13"`.
//! `MCL_FILE_TRACE=FILE` appends a line per operation to FILE: its kind, its bytes and its path.

use std::cell::RefCell;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

pub use super::operation::Operation;

/// The fault to inject.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No fault; operations are only counted.
    None,
    /// One operation fails with the error of a full disk.
    Fail {
        /// Index of the operation, from 0.
        at: usize,
    },
    /// The disk fills up: from one operation on, creating, writing and syncing fail.
    Full {
        /// Index of the operation, from 0.
        at: usize,
        /// If that operation is a write, the number of its bytes that still fit.
        bytes: usize,
    },
    /// The process is killed before an operation. Under [`during`] the thread survives, but every further
    /// operation fails without being carried out.
    Stop {
        /// Index of the operation, from 0.
        at: usize,
        /// If that operation is a write, the number of its bytes written first.
        bytes: usize,
    },
}

/// An operation that was carried out or failed: its kind, the number of bytes to write, and the path.
pub type Step = (Operation, usize, PathBuf);

/// The fault to inject, and the operations counted so far.
struct Plan {
    fault: Fault,
    steps: Vec<Step>,
}

thread_local! {
    static OF_THREAD: RefCell<Option<Plan>> = const { RefCell::new(None) };
}

/// Runs `work` with an injected fault; returns its result and all operations of this thread.
pub fn during<T>(fault: Fault, work: impl FnOnce() -> T) -> (T, Vec<Step>) {
    let outer = OF_THREAD.replace(Some(Plan { fault, steps: Vec::new() }));
    let done = work();
    let plan = OF_THREAD.replace(outer);
    (done, plan.map_or(Vec::new(), |plan| plan.steps))
}

/// The plan for the whole program, read from its environment.
static OF_PROGRAM: LazyLock<Option<(Fault, Mutex<usize>)>> = LazyLock::new(|| {
    let fault = std::env::var("MCL_FILE_FAULT").ok();
    let is_traced = std::env::var_os("MCL_FILE_TRACE").is_some();
    let fault = match fault {
        Some(text) => Fault::parse(&text).unwrap_or_else(|| {
            panic!("MCL_FILE_FAULT={text:?}: expected \"stop N [BYTES]\", \"fail N\" or \"full N [BYTES]\"")
        }),
        None if is_traced => Fault::None,
        None => return None,
    };
    Some((fault, Mutex::new(0)))
});

impl Fault {
    fn parse(text: &str) -> Option<Fault> {
        let mut words = text.split(' ');
        let kind = words.next()?;
        let at = words.next()?.parse().ok()?;
        let bytes = words.next().map_or(Some(0), |word| word.parse().ok())?;
        match (kind, words.next()) {
            ("stop", None) => Some(Fault::Stop { at, bytes }),
            ("fail", None) => Some(Fault::Fail { at }),
            ("full", None) => Some(Fault::Full { at, bytes }),
            _ => None,
        }
    }

    /// The number of bytes, at most `bytes`, that operation `number` may write; `Err(true)` if the process ends there.
    fn allows(self, number: usize, operation: Operation, bytes: usize) -> Result<usize, bool> {
        use Operation::{Create, Sync, Write};
        let part = |at: usize, part: usize| match number {
            number if number < at => Some(bytes),
            number if number == at && operation == Write && part > 0 => Some(part.min(bytes)),
            _ => None,
        };
        match self {
            Fault::Fail { at } if number == at => Err(false),
            Fault::None | Fault::Fail { .. } => Ok(bytes),
            Fault::Full { at, bytes: room } => match part(at, room) {
                None if matches!(operation, Create | Write | Sync) => Err(false),
                room => Ok(room.unwrap_or(bytes)),
            },
            Fault::Stop { at, bytes: written } => part(at, written).ok_or(true),
        }
    }
}

/// Counts an operation that is about to happen; returns how many of `bytes` it may write.
pub(super) fn next(operation: Operation, path: &Path, bytes: usize) -> io::Result<usize> {
    let failed = |ends: bool| match ends {
        true => io::Error::other("the process ended here"),
        false => io::ErrorKind::StorageFull.into(),
    };
    let of_thread = OF_THREAD.with_borrow_mut(|plan| {
        let plan = plan.as_mut()?;
        let number = plan.steps.len();
        plan.steps.push((operation, bytes, path.to_owned()));
        Some(plan.fault.allows(number, operation, bytes).map_err(failed))
    });
    if let Some(answer) = of_thread {
        return answer;
    }
    let Some((fault, count)) = &*OF_PROGRAM else { return Ok(bytes) };
    // The lock is held until the process ends, so that no other thread acts after the last operation.
    let mut count = count.lock().unwrap_or_else(PoisonError::into_inner);
    let number = *count;
    *count += 1;
    trace(operation, path, bytes)?;
    match fault.allows(number, operation, bytes) {
        Err(true) => std::process::abort(),
        answer => answer.map_err(failed),
    }
}

fn trace(operation: Operation, path: &Path, bytes: usize) -> io::Result<()> {
    let Some(file) = std::env::var_os("MCL_FILE_TRACE") else { return Ok(()) };
    let mut file = std::fs::OpenOptions::new().append(true).create(true).open(file)?;
    writeln!(file, "{operation:?} {bytes} {}", path.display())
}
