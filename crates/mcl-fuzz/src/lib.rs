//! Fuzz targets: one function per reader, which takes bytes and asserts what the reader promises.
//!
//! Beside "it never panics": what was read is finite where it says so, is written and read back the
//! same, and took memory in proportion to the input (`memory.rs`). The same functions run under libFuzzer
//! (`fuzz/`, nightly) and on stable over the saved corpus and mutations of it (`tests/corpus.rs`).

mod definitions;
mod framing;
mod logs;
mod maps;
mod memory;
mod recording;
mod results;
mod trajectories;

pub use framing::{Compression, bag_of_one_message, chunked, ros1_chunked};

/// A reader under test.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name of the target, of its libFuzzer binary and of its folder in the corpus.
    pub name: &'static str,
    /// Reads the bytes and checks what came out; panics where a law is broken.
    pub run: fn(&[u8]),
}

/// All targets.
pub const TARGETS: [Target; 19] = [
    Target { name: "carmen", run: logs::carmen },
    Target { name: "log", run: logs::any_log },
    Target { name: "mcap", run: logs::mcap },
    Target { name: "mcap_chunk", run: logs::mcap_chunk },
    Target { name: "ros1_bag", run: logs::ros1_bag },
    Target { name: "ros1_chunk", run: logs::ros1_chunk },
    Target { name: "database", run: logs::database },
    Target { name: "cdr", run: logs::cdr },
    Target { name: "bag_metadata", run: logs::bag_metadata },
    Target { name: "tum", run: trajectories::tum },
    Target { name: "trajectory", run: trajectories::any_format },
    Target { name: "map_csv", run: maps::csv },
    Target { name: "map_ply", run: maps::ply },
    Target { name: "map_pcd", run: maps::pcd },
    Target { name: "map_grid", run: maps::grid },
    Target { name: "dataset", run: definitions::dataset },
    Target { name: "study", run: definitions::study },
    Target { name: "parts", run: results::parts },
    Target { name: "results", run: results::folder },
];

/// Runs the target of this name.
///
/// # Panics
/// When there is no such target, or a law is broken.
pub fn run(name: &str, bytes: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name);
    (target.unwrap_or_else(|| panic!("no target {name:?}")).run)(bytes);
}
