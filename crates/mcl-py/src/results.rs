//! The rows of studies as columns.

use std::path::PathBuf;

use anyhow::Context;
use mcl_study::store::results::Results;
use mcl_study::table::{Table, Value};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::arrays::column;
use crate::work::interruptible;

/// The rows of a result folder, `ROOT/<study>/<data set>`: a dictionary of arrays of shape (rows,), by column.
#[pyfunction]
pub fn read_results(py: Python<'_>, folder: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let table = interruptible(py, move |_| {
        std::fs::metadata(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
        let results = Results::read(&folder)?.with_context(|| {
            format!(
                "{}: no rows of a study; expected ROOT/<study>/<data set>, which `run` makes",
                folder.display()
            )
        })?;
        Ok(results.table)
    })?;
    let columns = PyDict::new(py);
    for name in table.columns() {
        columns.set_item(name, array(py, &table, name)?)?;
    }
    Ok(columns)
}

/// A column: of whole numbers, of numbers (NaN where there is none), of truth values, or of objects (None where there is
/// none).
fn array<'py>(py: Python<'py>, table: &Table, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let cells: Vec<&Value> = table.rows().map(|row| row.get(name)).collect();
    let all = |is: fn(&Value) -> bool| cells.iter().all(|cell| is(cell));
    if all(|cell| matches!(cell, Value::Count(_))) {
        let counts =
            cells.iter().map(|cell| if let Value::Count(count) = cell { *count } else { 0 });
        let counts: Vec<u64> = counts.collect();
        // Seeds may exceed what is signed.
        return Ok(match counts.iter().map(|&count| i64::try_from(count)).collect() {
            Ok(counts) => column::<i64>(py, counts).into_any(),
            Err(_) => column(py, counts).into_any(),
        });
    }
    if all(|cell| matches!(cell, Value::Bool(_))) {
        let truths = cells.iter().map(|cell| **cell == Value::Bool(true)).collect();
        return Ok(column::<bool>(py, truths).into_any());
    }
    let is_number =
        |cell: &Value| matches!(cell, Value::Count(_) | Value::Number(_) | Value::Empty);
    if all(is_number) && !all(Value::is_empty) {
        let numbers = cells.iter().map(|cell| cell.number().unwrap_or(f64::NAN)).collect();
        return Ok(column::<f64>(py, numbers).into_any());
    }
    let object = |cell: &&Value| -> PyResult<Bound<'py, PyAny>> {
        Ok(match cell {
            Value::Empty => py.None().into_bound(py),
            Value::Bool(truth) => truth.into_pyobject(py)?.to_owned().into_any(),
            Value::Count(count) => count.into_pyobject(py)?.into_any(),
            Value::Number(number) => number.into_pyobject(py)?.into_any(),
            Value::Text(text) => text.into_pyobject(py)?.into_any(),
        })
    };
    let objects = cells.iter().map(object).collect::<PyResult<Vec<_>>>()?;
    let numpy = py.import("numpy")?;
    numpy.call_method1("array", (PyList::new(py, objects)?, "object"))
}
