use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locked while a file is written or a line is appended to a journal.
static WRITING: Mutex<()> = Mutex::new(());

/// The guard returned by [`hold`].
#[must_use = "files are written again as soon as this is dropped"]
pub struct Held {
    _guard: MutexGuard<'static, ()>,
}

/// Waits until no file is being written, and blocks further writes until the returned guard is dropped. An
/// interrupted program uses it to exit between two writes. The thread that holds the guard must not write files.
pub fn hold() -> Held {
    Held { _guard: WRITING.lock().unwrap_or_else(PoisonError::into_inner) }
}
