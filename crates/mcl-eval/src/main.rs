//! The `mcl-eval` program; see [`mcl_eval::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    mcl_eval::cli::main()
}
