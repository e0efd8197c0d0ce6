//! Errors of trajectories, and statistics over independent blocks.

use std::path::PathBuf;

use mcl_core::{Stamp, Trajectory};
use mcl_metrics::trajectory_file::{ReadSettings, read_file};
use mcl_metrics::{
    Alignment, Blocked, DEFAULT_TOLERANCE_S, Delta, PairsFrom, RpeSettings, Summary,
    WeightedPoseError, tum,
};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Columns, column, numbers, pose_table, poses, table, triple};
use crate::error::{Error, refused, warn};
use crate::work::interruptible;

/// Stamped poses: stamps in nanoseconds, int64, shape (n,), and x, y (m), theta (rad), shape (n, 3).
fn trajectory(stamps: &Bound<'_, PyAny>, rows: &Bound<'_, PyAny>) -> PyResult<Trajectory> {
    let of_arrays = |error: PyErr| {
        Error::new_err(format!("stamps: expected int64 nanoseconds, shape (n,) ({error})"))
    };
    let is_whole: bool = stamps
        .py()
        .import("numpy")?
        .call_method1("asarray", (stamps,))?
        .getattr("dtype")?
        .getattr("kind")?
        .extract::<String>()
        .map(|kind| kind == "i" || kind == "u")?;
    if !is_whole {
        return Err(Error::new_err(
            "stamps: expected whole nanoseconds (int64), of seconds (stamps * 1e9).astype('int64')",
        ));
    }
    let stamps: PyArrayLike1<'_, i64, AllowTypeChange> = stamps.extract().map_err(of_arrays)?;
    let stamps = stamps.as_array().iter().map(|&stamp| Stamp::from_nanoseconds(stamp)).collect();
    Trajectory::new(stamps, poses("poses", rows)?).map_err(refused)
}

fn stamps_of<'py>(py: Python<'py>, trajectory: &Trajectory) -> Bound<'py, PyArray1<i64>> {
    column(py, trajectory.stamps().iter().map(|stamp| stamp.nanoseconds()).collect())
}

/// Stamps (int64 nanoseconds, shape (n,)) and poses (shape (n, 3)).
type StampsAndPoses<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>);

fn stamps_and_poses<'py>(
    py: Python<'py>,
    trajectory: &Trajectory,
) -> PyResult<StampsAndPoses<'py>> {
    let poses = pose_table(py, trajectory.poses().iter().copied().map(Some))?;
    Ok((stamps_of(py, trajectory), poses))
}

/// Reads a trajectory in the plane (TUM, EuRoC, KITTI or CSV): stamps in nanoseconds, int64, shape (n,), and poses x, y
/// (m), theta (rad), shape (n, 3). Stamps are read from their decimals, not through a float.
#[pyfunction]
pub fn read_trajectory(py: Python<'_>, path: PathBuf) -> PyResult<StampsAndPoses<'_>> {
    let found = interruptible(py, move |_| Ok(read_file(&path, &ReadSettings::default())?))?;
    for note in &found.notes {
        warn(py, note)?;
    }
    stamps_and_poses(py, &found.trajectory)
}

/// Writes stamps (int64 nanoseconds, shape (n,)) and poses (shape (n, 3)) as a TUM file, which evo reads.
#[pyfunction]
pub fn write_trajectory(
    path: PathBuf,
    stamps: &Bound<'_, PyAny>,
    poses: &Bound<'_, PyAny>,
) -> PyResult<()> {
    tum::write_file(&path, &trajectory(stamps, poses)?).map_err(refused)
}

/// Pairs the poses of two trajectories by their stamps, at most tolerance seconds apart, one to one: the indices of the
/// paired poses in each, int64, shape (k,).
#[pyfunction]
#[pyo3(signature = (reference_stamps, estimate_stamps, tolerance = DEFAULT_TOLERANCE_S))]
pub fn associate<'py>(
    py: Python<'py>,
    reference_stamps: &Bound<'_, PyAny>,
    estimate_stamps: &Bound<'_, PyAny>,
    tolerance: f64,
) -> PyResult<Columns<'py, i64, i64>> {
    // Where the poses are does not matter.
    let somewhere = |stamps: &Bound<'_, PyAny>| {
        trajectory(stamps, table(py, vec![[0.0; 3]; stamps.len()?])?.as_any())
    };
    let (reference, estimate) = (somewhere(reference_stamps)?, somewhere(estimate_stamps)?);
    let matched = mcl_metrics::associate(&reference, &estimate, tolerance).map_err(refused)?;
    let indices = |found: Option<Vec<usize>>| {
        column(py, found.into_iter().flatten().map(|index| index as i64).collect())
    };
    Ok((indices(matched.reference_indices), indices(matched.estimate_indices)))
}

/// Errors of poses, an entry per pose.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct PoseErrors {
    /// Distance of the positions in metres, shape (n,).
    translation: Py<PyArray1<f64>>,
    /// Absolute heading error in radians, shape (n,).
    heading: Py<PyArray1<f64>>,
    /// sqrt(xi·δθ² + (1 − xi)(δx² + δy²)), shape (n,): equation 7 of the paper.
    weighted: Py<PyArray1<f64>>,
}

/// Errors of estimated poses against the reference, both of shape (n, 3) and in the same frame.
#[pyfunction]
#[pyo3(signature = (reference, estimate, xi = mcl_metrics::DEFAULT_XI))]
pub fn pose_errors(
    py: Python<'_>,
    reference: &Bound<'_, PyAny>,
    estimate: &Bound<'_, PyAny>,
    xi: f64,
) -> PyResult<PoseErrors> {
    let metric = WeightedPoseError::new(xi).map_err(refused)?;
    let (reference, estimate) = (poses("reference", reference)?, poses("estimate", estimate)?);
    let errors = mcl_metrics::pose_errors(&reference, &estimate).map_err(refused)?;
    Ok(PoseErrors {
        translation: column(py, errors.iter().map(|error| error.translation()).collect()).unbind(),
        heading: column(py, errors.iter().map(|error| error.heading()).collect()).unbind(),
        weighted: column(py, errors.iter().map(|error| metric.of(error)).collect()).unbind(),
    })
}

/// Absolute trajectory error, an entry per pose.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct Ate {
    /// Distances of the positions in metres, shape (n,): evo's trans_part.
    translation: Py<PyArray1<f64>>,
    /// Angles in [0, π] in radians, shape (n,): evo's angle_rad.
    rotation: Py<PyArray1<f64>>,
    /// Frobenius norm of E − I, shape (n,): evo's full.
    full: Py<PyArray1<f64>>,
    /// What the estimate was moved by: x, y (m), theta (rad), shape (3,).
    reference_from_estimate: Py<PyArray1<f64>>,
}

/// Absolute trajectory error of poses against the reference, both of shape (n, 3); alignment is "none", "origin" (the
/// first poses) or "rigid" (least squares over the positions).
#[pyfunction]
#[pyo3(signature = (reference, estimate, alignment = "none"))]
pub fn ate(
    py: Python<'_>,
    reference: &Bound<'_, PyAny>,
    estimate: &Bound<'_, PyAny>,
    alignment: &str,
) -> PyResult<Ate> {
    let alignment = match alignment {
        "none" => Alignment::None,
        "origin" => Alignment::Origin,
        "rigid" => Alignment::Rigid,
        found => {
            return Err(Error::new_err(format!(
                "alignment is {found:?}, expected none, origin or rigid"
            )));
        }
    };
    let (reference, estimate) = (poses("reference", reference)?, poses("estimate", estimate)?);
    let found = mcl_metrics::ate(&reference, &estimate, alignment).map_err(refused)?;
    Ok(Ate {
        translation: column(py, found.translation).unbind(),
        rotation: column(py, found.rotation).unbind(),
        full: column(py, found.full).unbind(),
        reference_from_estimate: column(py, triple(found.reference_from_estimate).to_vec())
            .unbind(),
    })
}

/// Relative pose error, an entry per pair.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct Rpe {
    /// Indices of the poses of each pair, int64, shape (k,) each.
    first: Py<PyArray1<i64>>,
    /// See first.
    second: Py<PyArray1<i64>>,
    /// Lengths of the translation parts in metres, shape (k,).
    translation: Py<PyArray1<f64>>,
    /// Angles in [0, π] in radians, shape (k,).
    rotation: Py<PyArray1<f64>>,
}

/// Relative pose error over steps of delta in unit "m" (along the path), "frames", "s" or "rad". Stamps are int64
/// nanoseconds, shape (n,), poses of shape (n, 3); without stamps for "m", "frames" and "rad" pass None.
#[pyfunction]
#[pyo3(signature = (reference, estimate, delta, unit = "m", *, stamps = None, all_pairs = false, pairs_from = "reference"))]
#[allow(clippy::too_many_arguments)] // Of Python, where they have names.
pub fn rpe(
    py: Python<'_>,
    reference: &Bound<'_, PyAny>,
    estimate: &Bound<'_, PyAny>,
    delta: f64,
    unit: &str,
    stamps: Option<&Bound<'_, PyAny>>,
    all_pairs: bool,
    pairs_from: &str,
) -> PyResult<Rpe> {
    let delta = match unit {
        "m" => Delta::Metres(delta),
        "frames" if delta >= 1.0 && delta.fract() == 0.0 => Delta::Frames(delta as usize),
        "frames" => {
            return Err(Error::new_err(format!(
                "delta is {delta}, expected a whole number of frames"
            )));
        }
        "s" if stamps.is_none() => return Err(Error::new_err("a delta in seconds needs stamps")),
        "s" => Delta::Seconds(delta),
        "rad" => Delta::Radians(delta),
        found => {
            return Err(Error::new_err(format!("unit is {found:?}, expected m, frames, s or rad")));
        }
    };
    let pairs_from = match pairs_from {
        "reference" => PairsFrom::Reference,
        "estimate" => PairsFrom::Estimate,
        found => {
            return Err(Error::new_err(format!(
                "pairs_from is {found:?}, expected reference or estimate"
            )));
        }
    };
    let settings = RpeSettings { all_pairs, pairs_from, ..RpeSettings::new(delta) };
    let counted: Bound<'_, PyAny>;
    let stamps = match stamps {
        Some(stamps) => stamps,
        None => {
            let count = reference.len()? as i64;
            counted = column(py, (0..count).collect()).into_any();
            &counted
        }
    };
    let (reference, estimate) = (trajectory(stamps, reference)?, trajectory(stamps, estimate)?);
    let found =
        interruptible(py, move |_| Ok(mcl_metrics::rpe(&reference, &estimate, &settings)?))?;
    let (first, second): (Vec<i64>, Vec<i64>) =
        found.pairs.iter().map(|&(first, second)| (first as i64, second as i64)).unzip();
    Ok(Rpe {
        first: column(py, first).unbind(),
        second: column(py, second).unbind(),
        translation: column(py, found.translation).unbind(),
        rotation: column(py, found.rotation).unbind(),
    })
}

/// Summarizes samples, shape (n,): a dictionary of count, mean, std (divided by n), rmse, sse, min, p05, p25, median, p75,
/// p95 and max, in the unit of the samples.
#[pyfunction]
pub fn summary<'py>(py: Python<'py>, samples: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let found = Summary::of(&numbers("samples", samples)?).map_err(refused)?;
    let summary = PyDict::new(py);
    summary.set_item("count", found.count)?;
    for (name, value) in [
        ("mean", found.mean),
        ("std", found.std),
        ("rmse", found.rmse),
        ("sse", found.sse),
        ("min", found.min),
        ("p05", found.p05),
        ("p25", found.p25),
        ("median", found.median),
        ("p75", found.p75),
        ("p95", found.p95),
        ("max", found.max),
    ] {
        summary.set_item(name, value)?;
    }
    Ok(summary)
}

/// Values by block. A block is what is independent of others: a map with all runs on it, never a run or a scan.
fn blocked(
    what: &str,
    values: &Bound<'_, PyAny>,
    blocks: Option<&Bound<'_, PyAny>>,
) -> PyResult<Blocked> {
    let values = numbers(what, values)?;
    let blocks: Vec<u64> = match blocks {
        None => (0..values.len() as u64).collect(),
        Some(blocks) => {
            let blocks: Vec<i64> = blocks
                .try_iter()?
                .map(|block| block?.extract())
                .collect::<PyResult<_>>()
                .map_err(|error: PyErr| {
                    Error::new_err(format!("blocks: expected whole numbers, shape (n,) ({error})"))
                })?;
            // Numbers of blocks are names.
            blocks.into_iter().map(|block| block as u64).collect()
        }
    };
    if blocks.len() != values.len() {
        let (blocks, values) = (blocks.len(), values.len());
        return Err(Error::new_err(format!(
            "{what}: {values} values in {blocks} blocks, expected as many"
        )));
    }
    Blocked::new(blocks.into_iter().zip(values)).map_err(refused)
}

/// The mean of the block means with its 95 % interval by Student's t: (mean, low, high), in the unit of the values.
///
/// values has shape (n,); blocks gives the block of each, whole numbers, shape (n,). Without blocks every value is one of
/// its own.
#[pyfunction]
#[pyo3(signature = (values, blocks = None))]
pub fn mean_interval(
    values: &Bound<'_, PyAny>,
    blocks: Option<&Bound<'_, PyAny>>,
) -> PyResult<(f64, f64, f64)> {
    let found = blocked("values", values, blocks)?.mean_interval().map_err(refused)?;
    Ok((found.mean, found.interval.low, found.interval.high))
}

/// A difference of means and its test.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct Effect {
    /// Mean of a minus mean of b, in the unit of the values.
    mean_difference: f64,
    /// Its standard error.
    standard_error: f64,
    /// The test statistic.
    t: f64,
    /// Degrees of freedom.
    degrees_of_freedom: f64,
    /// Probability of a |t| at least this large if the means are the same.
    p_two_sided: f64,
    /// Lower end of the 95 % interval of the difference.
    low: f64,
    /// Upper end.
    high: f64,
    /// Number of blocks of a and of b.
    blocks: (usize, usize),
}

impl From<mcl_metrics::Effect> for Effect {
    fn from(found: mcl_metrics::Effect) -> Self {
        let [of_a, of_b] = found.blocks;
        Effect {
            mean_difference: found.mean_difference,
            standard_error: found.standard_error,
            t: found.t,
            degrees_of_freedom: found.degrees_of_freedom,
            p_two_sided: found.p_two_sided,
            low: found.interval.low,
            high: found.interval.high,
            blocks: (of_a, of_b),
        }
    }
}

#[pymethods]
impl Effect {
    fn __repr__(&self) -> String {
        format!(
            "Effect(mean_difference={}, interval=({}, {}), p_two_sided={})",
            self.mean_difference, self.low, self.high, self.p_two_sided
        )
    }
}

/// Paired t test over the blocks that a and b share; values have shape (n,). Each side has its blocks, whole numbers of
/// shape (n,); without them, the k-th value of a belongs to the k-th of b.
#[pyfunction]
#[pyo3(signature = (a, b, blocks_a = None, blocks_b = None))]
pub fn paired_test(
    a: &Bound<'_, PyAny>,
    b: &Bound<'_, PyAny>,
    blocks_a: Option<&Bound<'_, PyAny>>,
    blocks_b: Option<&Bound<'_, PyAny>>,
) -> PyResult<Effect> {
    let (a, b) = (blocked("a", a, blocks_a)?, blocked("b", b, blocks_b)?);
    Ok(mcl_metrics::paired(&a, &b).map_err(refused)?.into())
}

/// Welch's t test over blocks of a and b that are independent of each other.
#[pyfunction]
#[pyo3(signature = (a, b, blocks_a = None, blocks_b = None))]
pub fn two_sample_test(
    a: &Bound<'_, PyAny>,
    b: &Bound<'_, PyAny>,
    blocks_a: Option<&Bound<'_, PyAny>>,
    blocks_b: Option<&Bound<'_, PyAny>>,
) -> PyResult<Effect> {
    let (a, b) = (blocked("a", a, blocks_a)?, blocked("b", b, blocks_b)?);
    Ok(mcl_metrics::two_sample(&a, &b).map_err(refused)?.into())
}

/// The p values of a family of tests, shape (m,), adjusted by Holm's method, in the same order.
#[pyfunction]
pub fn holm<'py>(
    py: Python<'py>,
    p_values: &Bound<'_, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(column(py, mcl_metrics::holm(&numbers("p_values", p_values)?)))
}
