//! The data that maps are built from: logs and point clouds, opened by path or by name.

pub mod cloud_source;
pub mod facts;
pub mod options;
pub mod reference;
pub mod source;
