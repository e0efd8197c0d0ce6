//! Views of a study's rows: tables, and charts as plain data.

pub mod caption;
pub mod chart;
pub mod charts;
pub mod compare;
pub mod estimate;
pub mod groups;
pub mod labels;
pub mod layout;
pub mod lost;
#[cfg(test)]
mod planted;
pub mod ranking;
pub mod summary;
