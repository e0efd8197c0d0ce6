//! Arrays of NumPy in and out.

use mcl_core::Pose2;
use mcl_study::data::cloud_source::Points;
use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArrayLikeDyn, PyArrayMethods,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::error::Error;

/// Two columns of one length.
pub type Columns<'py, A, B> = (Bound<'py, PyArray1<A>>, Bound<'py, PyArray1<B>>);

/// An array of doubles: the one given, or a converted copy of what can be one.
fn doubles<'py>(
    what: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<PyArrayLikeDyn<'py, f64, AllowTypeChange>> {
    value.extract().map_err(|error: PyErr| {
        let error = error.value(value.py()).to_string();
        Error::new_err(format!("{what}: expected an array of numbers ({error})"))
    })
}

/// The values of an array in row-major order, whatever its strides, copied once.
fn values(array: &PyArrayLikeDyn<'_, f64, AllowTypeChange>) -> Vec<f64> {
    match array.as_slice() {
        Ok(slice) if array.is_c_contiguous() => slice.to_vec(),
        _ => array.as_array().iter().copied().collect(),
    }
}

/// The rows of values that are known to be `D` in each.
fn rows<const D: usize>(array: &PyArrayLikeDyn<'_, f64, AllowTypeChange>) -> Vec<[f64; D]> {
    match array.as_slice() {
        Ok(slice) if array.is_c_contiguous() => slice.as_chunks().0.to_vec(),
        _ => values(array).as_chunks().0.to_vec(),
    }
}

fn wrong_shape(what: &str, shape: &[usize], expected: &str) -> PyErr {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    Error::new_err(format!("{what}: an array of shape ({}), expected {expected}", shape.join(", ")))
}

/// Points of an array of shape (N, 2) or (N, 3).
pub fn points(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Points> {
    let array = doubles(what, value)?;
    match array.shape() {
        [_, 2] => Ok(Points::Planar(rows(&array))),
        [_, 3] => Ok(Points::Spatial(rows(&array))),
        shape => Err(wrong_shape(what, shape, "(N, 2) or (N, 3)")),
    }
}

/// Poses of an array of shape (n, 3): x, y, θ. Headings are taken as they are.
pub fn poses(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Pose2>> {
    let array = doubles(what, value)?;
    match array.shape() {
        [_, 3] => {
            Ok(rows(&array).into_iter().map(|[x, y, theta]| Pose2::new(x, y, theta)).collect())
        }
        shape => Err(wrong_shape(what, shape, "(n, 3): x, y, theta")),
    }
}

/// A pose of three numbers: x, y, θ.
pub fn pose(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Pose2> {
    let array = doubles(what, value)?;
    match (array.shape(), &values(&array)[..]) {
        ([3], &[x, y, theta]) => Ok(Pose2::new(x, y, theta)),
        (shape, _) => Err(wrong_shape(what, shape, "(3): x, y, theta")),
    }
}

/// The numbers of an array of one dimension.
pub fn numbers(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let array = doubles(what, value)?;
    match array.shape() {
        [_] => Ok(values(&array)),
        shape => Err(wrong_shape(what, shape, "one dimension")),
    }
}

/// An array of shape (N, D) that takes the memory of the rows.
pub fn table<const D: usize>(
    py: Python<'_>,
    rows: Vec<[f64; D]>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, D])
}

/// An array of shape (n, 3) of poses; a pose that is absent is NaN.
pub fn pose_table(
    py: Python<'_>,
    poses: impl IntoIterator<Item = Option<Pose2>>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let row = |pose: Option<Pose2>| pose.map_or([f64::NAN; 3], triple);
    table(py, poses.into_iter().map(row).collect())
}

/// x, y, θ.
pub fn triple(pose: Pose2) -> [f64; 3] {
    [pose.x, pose.y, pose.theta]
}

/// An array that takes the memory of the numbers.
pub fn column<T: Element>(py: Python<'_>, numbers: Vec<T>) -> Bound<'_, PyArray1<T>> {
    PyArray1::from_vec(py, numbers)
}
