//! Long work beside Python: without its lock, and ended by Ctrl-C.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use mcl_eval::library::End;
use pyo3::prelude::*;

use crate::error::{Error, exception};

/// How long a signal waits at most.
const POLL: Duration = Duration::from_millis(50);

/// Does work on a thread of its own while other threads of Python run. A signal handler that raises, as that of Ctrl-C,
/// ends the call at once; the work ends when it next asks, and what it gave is dropped.
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(End<'_>) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let ended = Arc::new(AtomicBool::new(false));
    let is_ended = ended.clone();
    let (sender, mut receiver) = mpsc::channel();
    let body = move || {
        let end = || match is_ended.load(Ordering::Relaxed) {
            true => bail!("interrupted"),
            false => Ok(()),
        };
        let result = catch_unwind(AssertUnwindSafe(|| work(&end)));
        // Nobody waits for it any more if the call was ended.
        drop(sender.send(result.unwrap_or_else(|unwound| Err(error_of(unwound)))));
    };
    thread::Builder::new().name("mcl_eval".into()).spawn(body)?;
    loop {
        let (back, received) = py.detach(move || {
            let received = receiver.recv_timeout(POLL);
            (receiver, received)
        });
        receiver = back;
        match received {
            Ok(result) => return result.map_err(exception),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::new_err("the work ended without a result"));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(interrupt) = py.check_signals() {
            ended.store(true, Ordering::Relaxed);
            return Err(interrupt);
        }
    }
}

/// The error with which a thread unwound, or that it panicked.
fn error_of(unwound: Box<dyn Any + Send>) -> anyhow::Error {
    let unwound = match unwound.downcast::<anyhow::Error>() {
        Ok(error) => return *error,
        Err(panic) => panic,
    };
    let text = unwound.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| unwound.downcast_ref::<&str>().copied());
    anyhow!("internal error: {}", text.unwrap_or("a panic without a message"))
}
