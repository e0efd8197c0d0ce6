//! Rows that are kept: written as trials end, read by everything that shows or decides something.

pub mod identity;
pub mod parts;
pub mod results;
