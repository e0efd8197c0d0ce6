//! Trials: a map and the runs on it.

pub mod cost;
pub mod course;
pub mod division;
pub mod map;
pub mod maps;
pub mod pace;
mod people;
pub mod run;
pub mod scheduler;
pub mod stopwatch;
pub mod tracking;
