//! External programs that localize a robot: their input for a run, how they are run, and how their output is
//! read.
//!
//! ```text
//! course of a run, map ─► input: a folder with log, map, start, run.json ─► process ─► output ─► estimates
//! ```
//!
//! The contract with a program is in docs/localizers.md.

pub mod input;
#[cfg(target_os = "linux")]
mod members;
pub mod output;
pub mod process;
pub mod program;
pub mod stamps;
#[cfg(unix)]
mod tail;
