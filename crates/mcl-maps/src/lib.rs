//! Sample-based maps.

pub mod files;
