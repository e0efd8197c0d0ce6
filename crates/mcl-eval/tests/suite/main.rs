//! The tests of the crate as one program: each further one would be linked on its own.

mod called;
mod claims;
mod cli;
mod cli_auto;
mod cli_bags;
mod cli_clouds;
mod cli_evaluate;
mod cli_files;
mod cli_localize;
mod cli_reading;
mod cli_replay;
mod evaluate_field_cases;
mod experiments;
mod golden;
mod hard_use;
mod interrupted_everywhere;
mod interruption;
#[cfg(unix)]
mod localizers;
mod office;
mod olin;
mod parts;
#[cfg(all(target_os = "linux", target_env = "gnu", target_arch = "x86_64"))]
mod processors;
mod report;
mod report_watch;
mod results_faults;
mod studies;
