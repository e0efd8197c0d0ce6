//! A study as its file says: what is varied, what is measured, what tables and figures show.

pub mod check;
pub mod definition;
pub mod factors;
pub mod plan;
pub mod settings;
pub mod views;
