//! A study as defined by its file: what is varied, what is measured, what tables and figures show.

pub mod check;
pub mod definition;
pub mod factors;
pub mod plan;
pub mod settings;
pub mod views;
