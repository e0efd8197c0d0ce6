//! The module `mcl_eval._native`, which the Python package `mcl_eval` re-exports: logs and maps as arrays of NumPy, the
//! particle filter, metrics and result tables. The package is described in docs/python.md.
//!
//! Long work runs on threads of its own, without Python's lock, and Ctrl-C ends it. Keyword arguments are the options of
//! the command line and are parsed by it, so that both mean the same and refuse the same in the same words.

mod arrays;
mod error;
mod filter;
mod maps;
mod metrics;
mod options;
mod recording;
mod results;
mod work;

use pyo3::prelude::*;

/// Runs the command with its arguments, the first of which is its name, and returns its exit code.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| mcl_eval::cli::main_of(arguments))
}

/// The module.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::error::{DataWarning, Error};
    #[pymodule_export]
    use super::filter::{Localization, ParticleFilter, Run, Step, localize};
    #[pymodule_export]
    use super::main;
    #[pymodule_export]
    use super::maps::{
        LogLikelihood, Map, build_map, distances, log_likelihood, nearest, point_log_likelihoods,
    };
    #[pymodule_export]
    use super::metrics::{
        Ate, Effect, PoseErrors, Rpe, associate, ate, holm, mean_interval, paired_test,
        pose_errors, read_trajectory, rpe, summary, two_sample_test, write_trajectory,
    };
    #[pymodule_export]
    use super::recording::{Recording, Scan, read_log, read_points};
    #[pymodule_export]
    use super::results::read_results;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
