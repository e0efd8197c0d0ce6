//! Laser logs in and out: readers and writers of log formats (CARMEN, ROS 2 bags), the simulated office, and the registry
//! of public data sets.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod bag;
pub mod carmen;
pub mod container;
pub mod log;
mod mount;
mod packed;
pub mod registry;
mod room;
pub mod simulator;
