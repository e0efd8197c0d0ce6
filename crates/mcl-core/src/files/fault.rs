//! Tests end, tear and fail every operation of the file layer.
//!
//! Only with the feature `fault-injection`: what can lose data on purpose is no part of the program that users
//! build. Crates whose tests need it name it among their development dependencies, by which `cargo test`
//! builds also the binary with it, and `cargo build` and `cargo install` do not:
//!
//! ```toml
//! [dev-dependencies]
//! mcl-core = { workspace = true, features = ["fault-injection"] }
//! ```
//!
//! Operations are counted from 0. Inside a test, [`during`] counts and disturbs those of the thread that calls it:
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
//! A program is disturbed by the environment variable `MCL_FILE_FAULT`, all its threads together, and is really
//! killed: `MCL_FILE_FAULT="stop 7"`, `"stop 7 13"`, `"fail 7"`, `"full 7 13"`. `MCL_FILE_TRACE=FILE` appends a line per
//! operation to FILE: its kind, its bytes and its path.

use std::cell::RefCell;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

pub use super::operation::Operation;

/// What is to happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Nothing; operations are only counted.
    None,
    /// One operation fails as on a full disk.
    Fail {
        /// Which, from 0.
        at: usize,
    },
    /// The disk fills up: from one operation on, creating, writing and syncing fails.
    Full {
        /// Which, from 0.
        at: usize,
        /// If that is a write, so many bytes of it still find room.
        bytes: usize,
    },
    /// The process is killed before an operation. [`during`] lets the thread live, but carries out nothing
    /// more: every further operation fails.
    Stop {
        /// Which, from 0.
        at: usize,
        /// If that is a write, so many bytes of it are written first.
        bytes: usize,
    },
}

/// An operation that was carried out or failed, with the bytes asked to be written and the path.
pub type Step = (Operation, usize, PathBuf);

/// What happens while somebody counts.
struct Plan {
    fault: Fault,
    steps: Vec<Step>,
}

thread_local! {
    static OF_THREAD: RefCell<Option<Plan>> = const { RefCell::new(None) };
}

/// Does some work with a fault in it, and returns what came of it with all operations of this thread.
pub fn during<T>(fault: Fault, work: impl FnOnce() -> T) -> (T, Vec<Step>) {
    let outer = OF_THREAD.replace(Some(Plan { fault, steps: Vec::new() }));
    let done = work();
    let plan = OF_THREAD.replace(outer);
    (done, plan.map_or(Vec::new(), |plan| plan.steps))
}

/// The plan of the program, from its environment.
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

    /// How many of `bytes` operation `number` may write; `Err(true)` when the process ends there.
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

/// Counts an operation that is about to happen; how many of `bytes` it may write.
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
    // Held to the end, so that no other thread acts after the last operation.
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
