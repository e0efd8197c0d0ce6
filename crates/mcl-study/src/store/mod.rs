//! The stored rows: written as trials end, read by tables, figures and claims.

pub mod identity;
pub mod parts;
pub mod results;
