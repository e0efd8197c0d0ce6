//! The particle filter, step by step and over a whole log.

use std::sync::mpsc::{self, Sender};
use std::sync::{Mutex, PoisonError};
use std::thread;

use anyhow::Context;
use mcl_core::{Pose2, math};
use mcl_eval::library::{FilterOptions, localize as run_localize};
use mcl_eval::localization::run_seed;
use mcl_filter::{FilterError, MapDistances, StepReport};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

use crate::arrays::{column, pose, pose_table, table, triple};
use crate::error::{Error, exception, refused, warn};
use crate::maps::{Map, from_json};
use crate::options::options;
use crate::recording::{Recording, Scan};
use crate::work::interruptible;

/// Work for the thread of a filter.
type Job = Box<dyn for<'a> FnOnce(&mut mcl_filter::ParticleFilter<'a>) + Send>;

/// What the filter found at a scan. Poses are those of the laser in the map.
#[pyclass(frozen, module = "mcl_eval")]
pub struct Step {
    report: StepReport,
    robot_from_laser: Pose2,
}

#[pymethods]
impl Step {
    /// Weighted mean of the particles before resampling: x, y (m), theta (rad), shape (3,).
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let pose = self.report.estimate.map_from_robot.compose(&self.robot_from_laser);
        column(py, triple(pose).to_vec())
    }

    /// Covariance of the pose, shape (3, 3): m², m·rad, rad².
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, covariance(&self.report, &self.robot_from_laser).to_vec())
    }

    /// Effective sample size before resampling, 1 / sum of squared weights.
    #[getter]
    fn effective_sample_size(&self) -> f64 {
        self.report.effective_sample_size
    }

    /// Whether the particles were resampled after the estimate.
    #[getter]
    fn resampled(&self) -> bool {
        self.report.resampled
    }

    /// Number of beams that were used.
    #[getter]
    fn used_beams(&self) -> usize {
        self.report.used_beams
    }

    /// Number of particles that the estimate was computed from.
    #[getter]
    fn particles(&self) -> usize {
        self.report.particles
    }

    /// Log-evidence of the scan in nats; 0 where no beam was used.
    #[getter]
    fn log_evidence(&self) -> f64 {
        self.report.log_evidence
    }

    /// Share of the beams with a usable reading that the map explains; None where no beam was used.
    #[getter]
    fn explained_beams(&self) -> Option<f64> {
        self.report.explained_beams
    }

    fn __repr__(&self) -> String {
        let Pose2 { x, y, theta } =
            self.report.estimate.map_from_robot.compose(&self.robot_from_laser);
        let used = self.report.used_beams;
        format!("<Step at ({x:.3} m, {y:.3} m, {theta:.3} rad), {used} beams used>")
    }
}

fn covariance(report: &StepReport, robot_from_laser: &Pose2) -> [[f64; 3]; 3] {
    let found = report.estimate.covariance_at(robot_from_laser);
    std::array::from_fn(|row| std::array::from_fn(|column| found[(row, column)]))
}

/// Monte Carlo localization on a map in the plane, step by step.
///
/// All poses are those of the laser, as in a Recording. Keywords are the options of `mcl-eval localize`: preset,
/// particles, seed, initial ("known", "uniform" or "scan"), initial_pose (x, y, theta: where a known start is), initial_std,
/// beams, sigma_hit, z_rand, motion, alpha, proposal, resampling, … Each random draw depends on seed, name and run
/// alone: with those of a log and its run the filter repeats that run of localize to the last digit.
#[pyclass(frozen, module = "mcl_eval")]
pub struct ParticleFilter {
    jobs: Mutex<Sender<Job>>,
    robot_from_laser: Pose2,
}

impl ParticleFilter {
    /// Does something with the filter, on its thread.
    fn with<T: Send + 'static>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut mcl_filter::ParticleFilter<'_>) -> T + Send + 'static,
    ) -> PyResult<T> {
        let (sender, receiver) = mpsc::channel();
        let job = Box::new(move |filter: &mut mcl_filter::ParticleFilter<'_>| {
            // Nobody else waits for it.
            drop(sender.send(work(filter)));
        });
        let sent = self.jobs.lock().unwrap_or_else(PoisonError::into_inner).send(job);
        let gone = || Error::new_err("the filter ended with an internal error");
        sent.map_err(|_| gone())?;
        py.detach(move || receiver.recv()).map_err(|_| gone())
    }

    /// A step of the filter, whose error is that of the filter.
    fn stepped(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut mcl_filter::ParticleFilter<'_>) -> Result<StepReport, FilterError>
        + Send
        + 'static,
    ) -> PyResult<Step> {
        let report = self.with(py, work)?.map_err(refused)?;
        Ok(Step { report, robot_from_laser: self.robot_from_laser })
    }
}

#[pymethods]
impl ParticleFilter {
    #[new]
    #[pyo3(
        signature = (map, *, name = String::new(), run = 0, robot_from_laser = None, **keywords),
        text_signature = "(map, *, name='', run=0, robot_from_laser=(0, 0, 0), **options)"
    )]
    fn new(
        py: Python<'_>,
        map: &Bound<'_, Map>,
        name: String,
        run: u32,
        robot_from_laser: Option<&Bound<'_, PyAny>>,
        keywords: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let (kept, free) = map.get().for_filter()?;
        let robot_from_laser = match robot_from_laser {
            Some(value) => pose("robot_from_laser", value)?,
            None => Pose2::IDENTITY,
        };
        let options = FilterOptions::parse(&options(keywords)?).map_err(exception)?;
        let settings = options.settings().map_err(exception)?;
        let seed = run_seed(options.seed(), &name, run);
        let start = options.initial_pose().map(|pose| pose.compose(&robot_from_laser.inverse()));
        let (jobs, queue) = mpsc::channel::<Job>();
        let (sender, receiver) = mpsc::channel();
        // The filter borrows the distances: both live on a thread, which ends with the object.
        let body = move || {
            let prepared = || {
                let distances =
                    MapDistances::grid(kept.in_plane()?, settings.values().max_distance)?;
                anyhow::Ok(distances.with_free_space(free))
            };
            let distances = match prepared() {
                Ok(distances) => distances,
                Err(error) => return drop(sender.send(Err(error))),
            };
            let filter = mcl_filter::ParticleFilter::new(
                &settings,
                &distances,
                robot_from_laser,
                start,
                seed,
            );
            match filter {
                Err(error) => drop(sender.send(Err(error.into()))),
                Ok(mut filter) => {
                    drop(sender.send(Ok(())));
                    queue.into_iter().for_each(|job| job(&mut filter));
                }
            }
        };
        thread::Builder::new().name("mcl_eval filter".into()).spawn(body)?;
        match py.detach(move || receiver.recv()) {
            Ok(started) => started.map_err(exception)?,
            Err(_) => {
                return Err(Error::new_err("the filter did not start: internal error"));
            }
        }
        Ok(ParticleFilter { jobs: Mutex::new(jobs), robot_from_laser })
    }

    /// Processes a motion and the scan at its end. The odometry is the pose of the laser in the frame of the laser at the
    /// scan before, (x, y, theta), as in Recording.odometry; for the first scan call update.
    fn step(
        &self,
        py: Python<'_>,
        odometry: &Bound<'_, PyAny>,
        scan: &Bound<'_, Scan>,
    ) -> PyResult<Step> {
        let increment = self.of_robot(&pose("odometry", odometry)?);
        let scan = scan.get().scan.clone();
        self.stepped(py, move |filter| filter.step(&increment, &scan))
    }

    /// Processes a scan without a motion before it: the first one, or another at the same place.
    fn update(&self, py: Python<'_>, scan: &Bound<'_, Scan>) -> PyResult<Step> {
        let scan = scan.get().scan.clone();
        self.stepped(py, move |filter| filter.update(&scan))
    }

    /// Processes a scan after a motion that the odometry does not know, taken as Gaussian: its standard deviations along
    /// x and y (m) and of the heading (rad). The particles are drawn where the scan is likely within that.
    #[pyo3(signature = (scan, position, heading))]
    fn bridge(
        &self,
        py: Python<'_>,
        scan: &Bound<'_, Scan>,
        position: f64,
        heading: f64,
    ) -> PyResult<Step> {
        let spread = [("position", position), ("heading", heading)];
        if let Some((name, value)) =
            spread.iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0))
        {
            return Err(Error::new_err(format!(
                "{name} is {value}, expected a number of at least 0"
            )));
        }
        let scan = scan.get().scan.clone();
        self.stepped(py, move |filter| {
            filter.bridge(&scan, position, heading)?;
            filter.update(&scan)
        })
    }

    /// The particles after the last step, resampled if it did so: poses of the laser, shape (M, 3).
    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let robot_from_laser = self.robot_from_laser;
        let poses = self.with(py, move |filter| {
            let poses = filter.particles().iter().map(|(pose, _)| pose.compose(&robot_from_laser));
            poses.map(Some).collect::<Vec<_>>()
        })?;
        pose_table(py, poses)
    }

    /// The weights of the particles, shape (M,), whose sum is 1.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(column(
            py,
            self.with(py, |filter| {
                filter.particles().iter().map(|(_, log_weight)| math::exp(log_weight)).collect()
            })?,
        ))
    }
}

impl ParticleFilter {
    /// The motion of the robot, of that of the laser.
    fn of_robot(&self, motion: &Pose2) -> Pose2 {
        self.robot_from_laser.compose(motion).compose(&self.robot_from_laser.inverse())
    }
}

/// One run of localize: an entry per scan.
#[pyclass(frozen, get_all, module = "mcl_eval")]
pub struct Run {
    /// Estimated poses of the laser in the map: x, y (m), theta (rad), shape (n, 3).
    poses: Py<PyArray2<f64>>,
    /// Covariances of the poses, shape (n, 3, 3): m², m·rad, rad².
    covariances: Py<PyArray3<f64>>,
    /// Distance from the reference position in metres, shape (n,); NaN where a scan has no reference.
    translation: Py<PyArray1<f64>>,
    /// Absolute heading error in radians, shape (n,); NaN where a scan has no reference.
    heading: Py<PyArray1<f64>>,
    /// Weighted error (equation 7 of the paper, xi = 0.8), shape (n,); NaN where a scan has no reference.
    weighted: Py<PyArray1<f64>>,
    /// Effective sample size before resampling, shape (n,).
    effective_sample_size: Py<PyArray1<f64>>,
    /// Log-evidence of each scan in nats, shape (n,).
    log_evidence: Py<PyArray1<f64>>,
    /// Number of beams used of each scan, int64, shape (n,).
    used_beams: Py<PyArray1<i64>>,
    /// Number of particles at each scan, int64, shape (n,).
    particles: Py<PyArray1<i64>>,
    /// Whether the particles were resampled after each scan, bool, shape (n,).
    resampled: Py<PyArray1<bool>>,
}

/// Runs of the filter over a log.
#[pyclass(frozen, module = "mcl_eval")]
pub struct Localization {
    runs: Vec<Py<Run>>,
    figures: Value,
}

#[pymethods]
impl Localization {
    /// The runs, a list of Run.
    #[getter]
    fn runs(&self, py: Python<'_>) -> Vec<Py<Run>> {
        self.runs.iter().map(|run| run.clone_ref(py)).collect()
    }

    /// What `mcl-eval localize --json` prints: weighted, translation and heading ({mean, median, rmse, max} pooled over
    /// runs and scans; None without a reference), diverged, lost, recovered, mean_ci95, each, …
    #[getter]
    fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.figures)
    }
}

/// Localizes the robot of a Recording on a Map in the plane.
///
/// Keywords are the options of `mcl-eval localize`: preset ("default", "book" or "carmen"), particles, runs, seed,
/// initial ("known", "uniform" or "scan"), initial_pose, initial_std, odometry_noise, beams, sigma_hit, z_rand, motion,
/// alpha, proposal, resampling, … The same options give the same digits as the command.
#[pyfunction]
#[pyo3(signature = (recording, map, /, **keywords), text_signature = "(recording, map, /, **options)")]
pub fn localize(
    py: Python<'_>,
    recording: &Bound<'_, Recording>,
    map: &Bound<'_, Map>,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<Localization> {
    let (kept, free) = map.get().for_filter()?;
    let options = FilterOptions::parse(&options(keywords)?).map_err(exception)?;
    let data = recording.get().data().clone();
    let shared = data.clone();
    let found = interruptible(py, move |end| {
        run_localize(shared.log()?, kept.in_plane()?, free, &options, end)
    })?;
    let source = recording.get().source()?;
    if !found.bridged.scans.is_empty() {
        warn(
            py,
            &format!(
                "{}: the odometry is missing for {} of {} steps; there the robot is searched for by its \
                 scan around its last pose",
                source.name,
                found.bridged.scans.len(),
                found.bridged.steps
            ),
        )?;
    }
    let scans = &source.recording.scans;
    let mount = source.recording.robot_from_laser;
    let mut runs = Vec::new();
    for (run, finished) in found.runs.into_iter().zip(&found.finished) {
        let poses = pose_table(py, run.map_from_laser.iter().copied().map(Some))?.unbind();
        let reports = &run.reports;
        let covariances: Vec<[[f64; 3]; 3]> =
            reports.iter().map(|report| covariance(report, &mount)).collect();
        let covariances = column(py, covariances.into_flattened().into_flattened())
            .reshape([reports.len(), 3, 3])?
            .unbind();
        // Errors have entries for scans with a reference only.
        let spread = |errors: Option<&Vec<f64>>| {
            let mut errors = errors.into_iter().flatten();
            let of_scan = scans.iter().map(|scan| {
                scan.map_from_laser.and_then(|_| errors.next()).copied().unwrap_or(f64::NAN)
            });
            column(py, of_scan.collect()).unbind()
        };
        let numbers =
            |of: fn(&StepReport) -> f64| column(py, reports.iter().map(of).collect()).unbind();
        let counts = |of: fn(&StepReport) -> usize| {
            column(py, reports.iter().map(|report| of(report) as i64).collect()).unbind()
        };
        let errors = finished.errors.as_ref();
        let run = Run {
            poses,
            covariances,
            translation: spread(errors.map(|errors| &errors.translation)),
            heading: spread(errors.map(|errors| &errors.heading)),
            weighted: spread(errors.map(|errors| &errors.weighted)),
            effective_sample_size: numbers(|report| report.effective_sample_size),
            log_evidence: numbers(|report| report.log_evidence),
            used_beams: counts(|report| report.used_beams),
            particles: counts(|report| report.particles),
            resampled: column(py, reports.iter().map(|report| report.resampled).collect()).unbind(),
        };
        runs.push(Py::new(py, run)?);
    }
    let figures =
        serde_json::to_value(&found.figures).context("figures as JSON").map_err(exception)?;
    Ok(Localization { runs, figures })
}
