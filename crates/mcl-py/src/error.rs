//! Errors as Python exceptions, in the words of the command line.

use std::ffi::CString;
use std::io;

use mcl_datasets::log::LogError;
use mcl_eval::library::words;
use pyo3::create_exception;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

create_exception!(
    mcl_eval,
    Error,
    PyValueError,
    "What is wrong with data or arguments, in the words of the command line."
);
create_exception!(
    mcl_eval,
    DataWarning,
    PyUserWarning,
    "What a log left open and how that was settled, or what of it was lost."
);

/// The exception of an error: an `OSError` where a file could not be read or written, else [`Error`].
pub fn exception(error: anyhow::Error) -> PyErr {
    let text = words(&error);
    let mut kinds = error.chain().filter_map(|cause| {
        let of_system = cause.downcast_ref::<io::Error>().map(io::Error::kind);
        let is_missing = matches!(cause.downcast_ref(), Some(LogError::NotFound { .. }));
        of_system.or(is_missing.then_some(io::ErrorKind::NotFound))
    });
    match kinds.next() {
        Some(io::ErrorKind::NotFound) => PyFileNotFoundError::new_err(text),
        // These are of what is in a file, not of the system.
        Some(io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof) | None => {
            Error::new_err(text)
        }
        Some(_) => PyOSError::new_err(text),
    }
}

/// [`exception`] of an error of the libraries.
pub fn refused<E: Into<anyhow::Error>>(error: E) -> PyErr {
    exception(error.into())
}

/// Warns of what was found in data.
pub fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    // A name of a file or topic has no zero byte, but a damaged one may.
    let text = CString::new(text.replace('\0', "\u{fffd}"))?;
    PyErr::warn(py, &py.get_type::<DataWarning>(), &text, 1)
}
