//! Programs of others that localize a robot: what they are given of a run, how they are run, and what is made of what
//! they write.
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
