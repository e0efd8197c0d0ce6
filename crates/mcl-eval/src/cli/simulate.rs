use std::io::Write;

use anyhow::{Context, Result};
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_core::Seed;
use mcl_datasets::carmen;
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_maps::files::write_atomically;
use serde::Serialize;

use super::Outcome;
use super::args::SimulateArgs;
use super::output::{print, thousands};

#[derive(Serialize)]
struct Simulated {
    scans: usize,
    readings: usize,
    path_length_m: f64,
}

pub fn run(args: &SimulateArgs) -> Result<Outcome> {
    let recording = simulate(&OfficeSettings::default(), Seed::new(args.seed))?;
    let comments = [
        format!("mcl-eval {}: simulated office, seed {}", env!("CARGO_PKG_VERSION"), args.seed),
        "laser poses are exact ground truth".to_owned(),
    ];
    let comments: Vec<&str> = comments.iter().map(String::as_str).collect();
    let path = &args.output;
    let mut log = Vec::new();
    carmen::write(&recording, &comments, &mut log)?;
    if path.extension().is_some_and(|extension| extension == "gz") {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&log)?;
        log = encoder.finish()?;
    }
    write_atomically(path, &log).with_context(|| format!("cannot write {}", path.display()))?;
    let simulated = Simulated {
        scans: recording.scans.len(),
        readings: recording.readings(),
        path_length_m: recording.path_length_m(),
    };
    print(args.json, &simulated, |found| {
        format!(
            "{}: {} scans, {} readings, {:.1} m",
            path.display(),
            thousands(found.scans),
            thousands(found.readings),
            found.path_length_m
        )
    })?;
    Ok(Outcome::Done)
}
