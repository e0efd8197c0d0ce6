//! Studies: what is compared, on what data, and how it is counted.

pub mod data;
pub mod thread_time;
