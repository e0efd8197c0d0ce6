//! Keyword arguments as options of the command line.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use crate::error::Error;

/// Options that a function has no use for: it reports by its result.
const OF_COMMANDS: [&str; 11] = [
    "ascii",
    "fit_motion",
    "help",
    "json",
    "map",
    "output",
    "quiet",
    "replay",
    "resolution",
    "threads",
    "version",
];

/// Options of the names of the keywords: `True` is an option without value, `False` and `None` are none, and several
/// numbers are separated by commas.
pub fn options(keywords: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<String>> {
    let mut options = Vec::new();
    for (name, value) in keywords.into_iter().flatten() {
        let name: String = name.extract()?;
        if OF_COMMANDS.contains(&name.as_str()) {
            return Err(Error::new_err(format!("{name} is an option of the command only")));
        }
        let option = format!("--{}", name.replace('_', "-"));
        match (value.is_none(), value.extract::<bool>()) {
            (true, _) | (_, Ok(false)) => {}
            (_, Ok(true)) => options.push(option),
            (_, Err(_)) => options.push(format!("{option}={}", text(&name, &value)?)),
        }
    }
    Ok(options)
}

/// A value as it is written on the command line; numbers with the fewest digits that read back to the same bits.
fn text(name: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    if value.is_instance_of::<PyString>() {
        return value.extract();
    }
    if value.hasattr("__fspath__")? {
        return value.call_method0("__fspath__")?.extract();
    }
    if value.hasattr("__index__")?
        && let Ok(number) = value.extract::<i128>()
    {
        return Ok(number.to_string());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(number.to_string());
    }
    let Ok(parts) = value.try_iter() else {
        let found = value.repr()?;
        return Err(Error::new_err(format!(
            "{name} is {found}, expected text, a number, several numbers, True or False"
        )));
    };
    let parts = parts.map(|part| text(name, &part?)).collect::<PyResult<Vec<_>>>()?;
    Ok(parts.join(","))
}
