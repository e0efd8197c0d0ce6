//! The library behind the `mcl-eval` program: the commands ([`cli`]), the claims of the paper ([`claims`]),
//! and the way from the rows of a study to its tables and figures ([`figures`]) and to the page that shows
//! them ([`report`]), the figures of runs of the filter ([`localization`]), and the commands as functions
//! ([`library`]). The work itself is done by the crates that it depends on.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
// Both panic when the output is closed; see `progress::tell` and `cli::output::print`.
#![cfg_attr(not(test), warn(clippy::print_stderr, clippy::print_stdout))]

pub mod claims;
pub mod cli;
pub mod compare;
pub mod figures;
pub mod library;
pub mod localization;
pub mod pose_errors;
pub mod progress;
pub mod report;
pub mod studies;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
