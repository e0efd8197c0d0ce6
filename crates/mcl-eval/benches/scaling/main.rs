//! How time grows: with the points, the components and the particles, on one thread and on two.
//!
//! `cargo bench -p mcl-eval --bench scaling [-- --csv FILE] [-- --quick]`. Prints a table for each
//! inner loop with the exponent fitted to it, and writes every measured time to FILE. Data is
//! synthetic; the sizes of a table are measured in turns, round after round, and the smallest time of
//! each counts. `--quick` stops at a tenth of the largest size and takes two rounds: to see whether it
//! runs.

mod filter;
mod maps;
#[path = "../../../mcl-filter/benches/office/mod.rs"]
mod office;
mod table;

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use table::{Report, Scale};

fn main() -> Result<()> {
    let mut csv = None;
    let mut scale = Scale { rounds: 9, largest: 1.0 };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            // `cargo bench` says this to every bench.
            "--bench" => {}
            "--quick" => scale = Scale { rounds: 2, largest: 0.1 },
            "--csv" => csv = Some(PathBuf::from(arguments.next().context("--csv takes a file")?)),
            other => bail!("unknown argument {other:?}, expected --csv FILE or --quick"),
        }
    }
    let mut report = Report::new(csv.as_deref())?;
    maps::area_grows_with_the_data(&mut report, scale)?;
    maps::components(&mut report, scale)?;
    maps::grid_sampling(&mut report, scale)?;
    filter::particles(&mut report, scale)?;
    filter::map_points(&mut report, scale)?;
    report.finish()
}
