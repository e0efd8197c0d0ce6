//! Maps: built, read, written, and asked for likelihoods and distances.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use anyhow::bail;
use mcl_core::{NearestNeighbors, Point, PointMap, check_finite};
use mcl_eval::library::{Folds, build_map as build, grid_map};
use mcl_filter::sensor::FreeSpace;
use mcl_maps::files::{Encoding, check_writable, is_grid, read_cloud, read_map, write_map};
use mcl_maps::mixture::point_log_likelihoods as by_point;
use mcl_maps::{PointSet, mixture_log_likelihood};
use mcl_study::data::cloud_source::Points;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use rayon::prelude::*;
use serde_json::Value;

use crate::arrays::{Columns, column, points as points_of, table};
use crate::error::{Error, refused};
use crate::options::options;
use crate::recording::Recording;
use crate::work::interruptible;

/// A map with its index of neighbours, which is made when it is first needed.
pub struct Indexed<const D: usize> {
    /// The map.
    pub map: PointMap<D>,
    index: OnceLock<NearestNeighbors<D>>,
}

impl<const D: usize> Indexed<D> {
    fn index(&self) -> anyhow::Result<&NearestNeighbors<D>> {
        if let Some(index) = self.index.get() {
            return Ok(index);
        }
        let made = NearestNeighbors::new(self.map.points())?;
        Ok(self.index.get_or_init(|| made))
    }

    /// Distances (m) from points to their nearest map points, and the places of these in the map.
    fn nearest(&self, points: &[Point<D>]) -> anyhow::Result<(Vec<f64>, Vec<i64>)> {
        check_finite(points)?;
        let index = self.index()?;
        let nearest = |point| {
            let found = index.nearest(point);
            (found.distance_squared.sqrt(), found.index as i64)
        };
        Ok(points.par_iter().map(nearest).unzip())
    }
}

/// In the plane or in space.
pub enum AnyMap {
    /// In the plane.
    Planar(Indexed<2>),
    /// In space.
    Spatial(Indexed<3>),
}

/// A sample-based map: points in two or three dimensions, in metres.
#[pyclass(frozen, module = "mcl_eval")]
pub struct Map {
    kept: Arc<AnyMap>,
    /// Where a robot may be, of a grid map.
    free: Option<FreeSpace>,
    /// What `map --json` prints of it.
    report: Option<Value>,
    points: PyOnceLock<Py<PyArray2<f64>>>,
}

impl Map {
    fn of(kept: AnyMap) -> Self {
        Map { kept: Arc::new(kept), free: None, report: None, points: PyOnceLock::new() }
    }

    fn planar(map: PointMap<2>) -> Self {
        Self::of(AnyMap::Planar(Indexed { map, index: OnceLock::new() }))
    }

    fn spatial(map: PointMap<3>) -> Self {
        Self::of(AnyMap::Spatial(Indexed { map, index: OnceLock::new() }))
    }

    /// What a filter needs: a map in the plane, and the free space if it is known.
    pub fn for_filter(&self) -> PyResult<(Arc<AnyMap>, Option<FreeSpace>)> {
        match *self.kept {
            AnyMap::Planar(_) => Ok((self.kept.clone(), self.free.clone())),
            AnyMap::Spatial(_) => Err(Error::new_err(
                "the map has three dimensions, and the filter localizes in the plane",
            )),
        }
    }
}

impl AnyMap {
    /// The map of [`Map::for_filter`].
    pub fn in_plane(&self) -> anyhow::Result<&PointMap<2>> {
        match self {
            AnyMap::Planar(kept) => Ok(&kept.map),
            AnyMap::Spatial(_) => bail!("the map has three dimensions, expected two"),
        }
    }
}

/// A map, or an array of the points of one.
fn map_of(value: &Bound<'_, PyAny>) -> PyResult<Arc<AnyMap>> {
    if let Ok(map) = value.cast::<Map>() {
        return Ok(map.get().kept.clone());
    }
    Ok(Map::new(value)?.kept)
}

#[pymethods]
impl Map {
    /// A map of an array of points, shape (K, 2) or (K, 3), metres; any filter or method may have chosen them.
    #[new]
    fn new(points: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(match points_of("points", points)? {
            Points::Planar(points) => Self::planar(PointMap::new(points).map_err(refused)?),
            Points::Spatial(points) => Self::spatial(PointMap::new(points).map_err(refused)?),
        })
    }

    /// Reads a map: .csv, .ply, .pcd, or a grid of map_server (.yaml), of which the filter gets the free space, too, and
    /// points that are the ends of beams.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        interruptible(py, move |_| {
            if is_grid(&path) {
                let (map, free) = grid_map(&path)?;
                return Ok(Map { free, ..Self::planar(map) });
            }
            Ok(match read_cloud(&path)?.dimensions() {
                3 => Self::spatial(read_map(&path)?),
                _ => Self::planar(read_map(&path)?),
            })
        })
    }

    /// Writes the points into a file: .csv, .ply or .pcd, binary unless ascii. The file is whole or not there.
    #[pyo3(signature = (path, *, ascii = false))]
    fn write(&self, py: Python<'_>, path: PathBuf, ascii: bool) -> PyResult<()> {
        if is_grid(&path) {
            return Err(Error::new_err(format!(
                "{}: a grid needs the scans, too: `mcl-eval convert` makes one; expected .csv, .ply or .pcd",
                path.display()
            )));
        }
        let kept = self.kept.clone();
        let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
        interruptible(py, move |_| {
            check_writable(&path, &[])?;
            match &*kept {
                AnyMap::Planar(kept) => write_map(&path, &kept.map, encoding)?,
                AnyMap::Spatial(kept) => write_map(&path, &kept.map, encoding)?,
            }
            Ok(())
        })
    }

    /// The points, shape (K, D), metres, read-only.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let made = self.points.get_or_try_init(py, || {
            let array = match &*self.kept {
                AnyMap::Planar(kept) => table(py, kept.map.points().to_vec())?,
                AnyMap::Spatial(kept) => table(py, kept.map.points().to_vec())?,
            };
            array.readwrite().make_nonwriteable();
            Ok::<_, PyErr>(array.unbind())
        })?;
        Ok(made.bind(py).clone())
    }

    /// 2 or 3.
    #[getter]
    fn dimensions(&self) -> usize {
        match *self.kept {
            AnyMap::Planar(_) => 2,
            AnyMap::Spatial(_) => 3,
        }
    }

    /// How the map was built: the keys of `mcl-eval map --json`, among them cell_m, iterations, converged,
    /// log_likelihood_trace and log_likelihood_per_point (nats). None for a map that was not built here.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.report.as_ref().map(|report| from_json(py, report)).transpose()
    }

    fn __len__(&self) -> usize {
        match &*self.kept {
            AnyMap::Planar(kept) => kept.map.len(),
            AnyMap::Spatial(kept) => kept.map.len(),
        }
    }

    fn __repr__(&self) -> String {
        format!("<Map of {} points in {} dimensions>", self.__len__(), self.dimensions())
    }
}

/// A value of JSON as Python's dictionaries, lists and numbers.
pub fn from_json<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (value.to_string(),))
}

/// Builds a sample-based map of points, shape (N, 2) or (N, 3) in metres, or of a Recording.
///
/// Keywords are the options of `mcl-eval map`: init ("grid", "random" or "all") with size (a number, "0.25%" or "auto")
/// or cell (m), offset, seed; refine ("fkm", "fkm-accelerated", "restarts", "annealed", "split-merge", "exchange" or
/// "best"), rounds, restarts, refine_seconds; sigma (m, or "auto"), tolerance, max_iterations, no_snap; auto_by. An
/// automatic size or sigma by "held-out", the default, leaves out scans, and so needs a Recording. The same options and
/// seed give the same map as the command, bit for bit.
#[pyfunction]
#[pyo3(signature = (points, /, **keywords), text_signature = "(points, /, **options)")]
pub fn build_map(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Map> {
    let options = options(keywords)?;
    if let Ok(recording) = points.cast::<Recording>() {
        let data = recording.get().data().clone();
        return interruptible(py, move |end| {
            let points = data.log()?.points()?;
            let folds = || data.folds();
            let (map, report) = build(points, Some(&folds as Folds<'_, 2>), &options, end)?;
            Ok(Map { report: Some(report), ..Map::planar(map) })
        });
    }
    let points = points_of("points", points)?;
    interruptible(py, move |end| {
        let (map, report) = match points {
            Points::Planar(points) => {
                let (map, report) = build(points, None, &options, end)?;
                (Map::planar(map), report)
            }
            Points::Spatial(points) => {
                let (map, report) = build(points, None, &options, end)?;
                (Map::spatial(map), report)
            }
        };
        Ok(Map { report: Some(report), ..map })
    })
}

/// How likely points are under a map.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct LogLikelihood {
    /// ln p(D) in nats: the sum over all points of the logarithm of a density per metre to the power of D.
    total: f64,
    /// The total divided by the number of points.
    per_point: f64,
}

#[pymethods]
impl LogLikelihood {
    fn __repr__(&self) -> String {
        format!("LogLikelihood(total={}, per_point={})", self.total, self.per_point)
    }
}

/// What is asked of a map about points of its dimension.
trait Question: Send + 'static {
    /// The answer.
    type Answer: Send + 'static;

    /// Answers it.
    fn answer<const D: usize>(
        self,
        map: &Indexed<D>,
        points: Vec<Point<D>>,
    ) -> anyhow::Result<Self::Answer>;
}

/// Asks a map, or an array of the points of one, about points.
fn ask<Q: Question>(
    py: Python<'_>,
    map: &Bound<'_, PyAny>,
    about: &Bound<'_, PyAny>,
    question: Q,
) -> PyResult<Q::Answer> {
    let map = map_of(map)?;
    let about = points_of("points", about)?;
    interruptible(py, move |_| match (&*map, about) {
        (AnyMap::Planar(map), Points::Planar(points)) => question.answer(map, points),
        (AnyMap::Spatial(map), Points::Spatial(points)) => question.answer(map, points),
        (AnyMap::Planar(_), _) => bail!("the map has two dimensions, and the points have three"),
        (AnyMap::Spatial(_), _) => bail!("the map has three dimensions, and the points have two"),
    })
}

struct Likelihood {
    sigma: f64,
}

impl Question for Likelihood {
    type Answer = LogLikelihood;

    fn answer<const D: usize>(
        self,
        map: &Indexed<D>,
        points: Vec<Point<D>>,
    ) -> anyhow::Result<LogLikelihood> {
        let found = mixture_log_likelihood(&PointSet::new(points)?, &map.map, self.sigma)?;
        Ok(LogLikelihood { total: found.total, per_point: found.per_point })
    }
}

struct LikelihoodByPoint {
    sigma: f64,
}

impl Question for LikelihoodByPoint {
    type Answer = Vec<f64>;

    fn answer<const D: usize>(
        self,
        map: &Indexed<D>,
        points: Vec<Point<D>>,
    ) -> anyhow::Result<Vec<f64>> {
        Ok(by_point(&points, &map.map, self.sigma)?)
    }
}

struct Nearest;

impl Question for Nearest {
    type Answer = (Vec<f64>, Vec<i64>);

    fn answer<const D: usize>(
        self,
        map: &Indexed<D>,
        points: Vec<Point<D>>,
    ) -> anyhow::Result<Self::Answer> {
        map.nearest(&points)
    }
}

/// The log-likelihood of points, shape (N, D) in metres, under a map (a Map or an array of points), with a Gaussian of
/// standard deviation sigma (m) about each map point: the digits of `mcl-eval likelihood`.
#[pyfunction]
#[pyo3(signature = (map, points, sigma = 0.05))]
pub fn log_likelihood(
    py: Python<'_>,
    map: &Bound<'_, PyAny>,
    points: &Bound<'_, PyAny>,
    sigma: f64,
) -> PyResult<LogLikelihood> {
    ask(py, map, points, Likelihood { sigma })
}

/// The log-likelihood of each point under a map, shape (N,), in nats; log_likelihood is faster where only the sum is
/// needed.
#[pyfunction]
#[pyo3(signature = (map, points, sigma = 0.05))]
pub fn point_log_likelihoods<'py>(
    py: Python<'py>,
    map: &Bound<'_, PyAny>,
    points: &Bound<'_, PyAny>,
    sigma: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(column(py, ask(py, map, points, LikelihoodByPoint { sigma })?))
}

/// The distance of each point, shape (N, D) in metres, from the nearest point of a map: shape (N,), metres, exact.
///
/// A Map keeps its index of neighbours; for an array one is built with every call.
#[pyfunction]
pub fn distances<'py>(
    py: Python<'py>,
    map: &Bound<'_, PyAny>,
    points: &Bound<'_, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(column(py, ask(py, map, points, Nearest)?.0))
}

/// The distance of each point from the nearest point of a map, and which that is: shapes (N,), metres and int64. Which of
/// equally near points is taken is not defined.
#[pyfunction]
pub fn nearest<'py>(
    py: Python<'py>,
    map: &Bound<'_, PyAny>,
    points: &Bound<'_, PyAny>,
) -> PyResult<Columns<'py, f64, i64>> {
    let (distances, places) = ask(py, map, points, Nearest)?;
    Ok((column(py, distances), column(py, places)))
}
