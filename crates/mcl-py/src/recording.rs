//! Logs as arrays.

use std::path::PathBuf;
use std::sync::Arc;

use mcl_core::{LaserScan, Pose2, ScanGeometry, Stamp, Sweep};
use mcl_datasets::log::ReadReport;
use mcl_eval::library::open;
use mcl_study::data::cloud_source::Points;
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::trial::division::StudyData;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList};

use crate::arrays::{column, numbers, pose_table, table, triple};
use crate::error::{Error, refused, warn};
use crate::options::options;
use crate::work::interruptible;

/// A laser log: scans in log order with stamps, reference poses and odometry. All poses are those of the laser, in
/// metres and radians. What the log does not have is NaN or masked, never zero.
#[pyclass(frozen, module = "mcl_eval")]
pub struct Recording {
    /// A log.
    data: Arc<StudyData>,
    points: PyOnceLock<Py<PyArray2<f64>>>,
}

impl Recording {
    /// The log, and what its scans are divided into.
    pub fn data(&self) -> &Arc<StudyData> {
        &self.data
    }

    /// The log.
    pub fn source(&self) -> PyResult<&LogSource> {
        self.data.log().map_err(refused)
    }

    fn scans(&self) -> PyResult<&[LaserScan]> {
        Ok(&self.source()?.recording.scans)
    }
}

#[pymethods]
impl Recording {
    /// Name of the data set, or of the file up to its first dot. Seeds of runs depend on it.
    #[getter]
    fn name(&self) -> PyResult<&str> {
        Ok(&self.source()?.name)
    }

    /// Largest reading that counts as a measurement, in metres, inclusive.
    #[getter]
    fn max_range(&self) -> PyResult<f64> {
        Ok(self.source()?.max_range)
    }

    /// The reference and whose poses it has; None without one.
    #[getter]
    fn reference_source(&self) -> PyResult<Option<&str>> {
        Ok(self.source()?.reference.as_deref())
    }

    /// How a bag was read, a line each.
    #[getter]
    fn notes(&self) -> PyResult<Vec<String>> {
        Ok(self.source()?.notes.clone())
    }

    /// What the log left open and how that was settled, a line each; each was a DataWarning when it was read.
    #[getter]
    fn assumptions(&self) -> PyResult<Vec<String>> {
        Ok(self.source()?.assumptions.clone())
    }

    /// Pose of the laser on the robot: x, y (m), theta (rad), shape (3,).
    #[getter]
    fn robot_from_laser<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(column(py, triple(self.source()?.recording.robot_from_laser).to_vec()))
    }

    /// The point set D, shape (N, 2), metres, read-only: endpoints of the readings with 0 < r <= max_range, placed by
    /// the reference poses, in log order. An Error where the log has no reference.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let made = self.points.get_or_try_init(py, || {
            let array = table(py, self.source()?.points().map_err(refused)?)?;
            array.readwrite().make_nonwriteable();
            Ok::<_, PyErr>(array.unbind())
        })?;
        Ok(made.bind(py).clone())
    }

    /// Stamps in nanoseconds, int64, shape (n,): a masked array, masked where the log has none.
    #[getter]
    fn stamps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let stamps = self.scans()?.iter().map(|scan| scan.stamp);
        let (values, masked): (Vec<i64>, Vec<bool>) =
            stamps.map(|stamp| (stamp.map_or(0, Stamp::nanoseconds), stamp.is_none())).unzip();
        let arguments = (column(py, values), column(py, masked));
        py.import("numpy.ma")?.call_method1("masked_array", arguments)
    }

    /// Reference poses of the laser in the map: x, y (m), theta (rad), shape (n, 3), NaN where there is none.
    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        pose_table(py, self.scans()?.iter().map(|scan| scan.map_from_laser))
    }

    /// Odometry: the pose of the laser at each scan in the frame of the laser at the scan before, shape (n, 3), NaN for
    /// the first scan and where the log has none.
    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        pose_table(py, self.scans()?.iter().map(|scan| scan.odometry))
    }

    /// The readings of each scan in metres, as logged: a list of n arrays.
    #[getter]
    fn ranges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        PyList::new(py, self.scans()?.iter().map(|scan| PyArray1::from_slice(py, &scan.ranges)))
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.scans()?.len())
    }

    fn __getitem__(&self, index: isize) -> PyResult<Scan> {
        let scans = self.scans()?;
        let from_end = if index < 0 { scans.len() as isize } else { 0 };
        let scan = usize::try_from(index + from_end).ok().and_then(|index| scans.get(index));
        let scan = scan.ok_or_else(|| {
            PyIndexError::new_err(format!("scan {index} of {} scans", scans.len()))
        })?;
        Ok(Scan { scan: scan.clone() })
    }

    fn __repr__(&self) -> PyResult<String> {
        let LogSource { name, recording, reference, .. } = self.source()?;
        let reference = reference.as_deref().unwrap_or("none");
        Ok(format!("<Recording {name}: {} scans, reference: {reference}>", recording.scans.len()))
    }
}

/// One scan of a planar laser range finder.
#[pyclass(frozen, module = "mcl_eval")]
pub struct Scan {
    /// The scan.
    pub scan: LaserScan,
}

#[pymethods]
impl Scan {
    /// A scan of readings in metres, shape (beams,), whose beam 0 points to start_angle (rad; 0 is straight ahead,
    /// counter-clockwise positive), the next one angle_step further.
    #[new]
    #[pyo3(signature = (ranges, start_angle, angle_step))]
    fn new(ranges: &Bound<'_, PyAny>, start_angle: f64, angle_step: f64) -> PyResult<Self> {
        let ranges = numbers("ranges", ranges)?;
        let geometry = ScanGeometry { start_angle, angle_step, beams: ranges.len() };
        Ok(Scan {
            scan: LaserScan {
                stamp: None,
                geometry,
                ranges,
                map_from_laser: None,
                odometry: None,
                sweep: Sweep::default(),
            },
        })
    }

    /// Readings in metres, shape (beams,), as logged.
    #[getter]
    fn ranges<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.scan.ranges)
    }

    /// Directions of the beams in radians, shape (beams,), in the frame of the laser.
    #[getter]
    fn angles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let scan = &self.scan;
        column(py, (0..scan.ranges.len()).map(|beam| scan.direction(beam)).collect())
    }

    /// Stamp in nanoseconds; None where the log has none.
    #[getter]
    fn stamp(&self) -> Option<i64> {
        self.scan.stamp.map(Stamp::nanoseconds)
    }

    /// Reference pose of the laser in the map, shape (3,); None where the log has none.
    #[getter]
    fn reference<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        array_of(py, self.scan.map_from_laser)
    }

    /// Pose of the laser in the frame of the laser at the scan before, shape (3,); None where it is not known.
    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        array_of(py, self.scan.odometry)
    }

    fn __repr__(&self) -> String {
        format!("<Scan of {} beams>", self.scan.ranges.len())
    }
}

fn array_of(py: Python<'_>, pose: Option<Pose2>) -> Option<Bound<'_, PyArray1<f64>>> {
    pose.map(|pose| column(py, triple(pose).to_vec()))
}

/// Opens a data source, and warns of what it left open and what of it was lost.
fn opened(py: Python<'_>, name: PathBuf, options: Vec<String>) -> PyResult<DataSource> {
    let name = name.into_os_string().into_string().map_err(|name| {
        Error::new_err(format!("{}: the file name is not Unicode text", name.display()))
    })?;
    let called = name.clone();
    let source = interruptible(py, move |_| open(&called, &options))?;
    let (assumptions, report): (_, &ReadReport) = match &source {
        DataSource::Log(log) => (&log.assumptions, &log.report),
        DataSource::Cloud(cloud) => (&cloud.assumptions, &cloud.report),
    };
    for assumption in assumptions {
        warn(py, &format!("{name}: {assumption}"))?;
    }
    if !report.is_complete() {
        warn(py, &format!("{name}: {report}"))?;
    }
    Ok(source)
}

/// Reads a laser log: a CARMEN log, a bag of ROS 1 or 2, or a data set by its name.
///
/// Keywords are the options of `mcl-eval inspect`: max_range (m), reference, reference_topic, reference_frame,
/// scan_topic, odom_topic, slice, base_frame, odom_frame, laser_pose, no_deskew, longest_gap. What the log left open and
/// what of it was lost is a DataWarning.
#[pyfunction]
#[pyo3(signature = (name, /, **keywords), text_signature = "(name, /, **options)")]
pub fn read_log(
    py: Python<'_>,
    name: PathBuf,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Recording> {
    let source = opened(py, name, options(keywords)?)?;
    source.log().map_err(refused)?;
    Ok(Recording { data: Arc::new(StudyData::new(source)), points: PyOnceLock::new() })
}

/// Reads the points of a log, a point cloud (.ply, .pcd, .csv), a bag of clouds or a data set: shape (N, 2) or
/// (N, 3), metres.
///
/// Keywords are those of read_log, and cloud_topic and dimensions (2 drops heights).
#[pyfunction]
#[pyo3(signature = (name, /, **keywords), text_signature = "(name, /, **options)")]
pub fn read_points<'py>(
    py: Python<'py>,
    name: PathBuf,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    match opened(py, name, options(keywords)?)?.points().map_err(refused)? {
        Points::Planar(points) => table(py, points),
        Points::Spatial(points) => table(py, points),
    }
}
