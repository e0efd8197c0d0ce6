use std::sync::{Mutex, MutexGuard, PoisonError};

/// Held while a file is written whole or a journal grows by a line.
static WRITING: Mutex<()> = Mutex::new(());

/// See [`hold`].
#[must_use = "files are written again as soon as this is dropped"]
pub struct Held {
    _guard: MutexGuard<'static, ()>,
}

/// Waits until no file is being written, and lets none be written as long as the answer lives: a program
/// that is interrupted may end then, between two writes. The thread that holds must not write files itself.
pub fn hold() -> Held {
    Held { _guard: WRITING.lock().unwrap_or_else(PoisonError::into_inner) }
}
