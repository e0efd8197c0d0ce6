//! The library behind the `mcl-eval` program: glue from log to figure. It opens logs and data sets
//! (`mcl-study`), runs experiments ([`experiment`]), draws what came out (`mcl-figures`) and holds it
//! against the paper ([`claims`]), and offers all of it on the command line ([`cli`]). The work itself
//! is done by the crates below it: `mcl-datasets`, `mcl-maps`, `mcl-filter` and `mcl-metrics`.

// Both end the program when nobody can be told; see `progress::tell` and `cli::output::print`.
#![cfg_attr(not(test), warn(clippy::print_stderr, clippy::print_stdout))]

pub mod claims;
pub mod cli;
pub mod compare;
pub mod figures;
pub mod progress;
