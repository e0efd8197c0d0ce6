//! Placeholder.

pub mod figures;
