//! Laser logs in and out: readers and writers of log formats, the simulated office, and the registry
//! of public data sets.

pub mod carmen;
pub mod log;
pub mod registry;
pub mod simulator;
