use anyhow::{Context, Result, bail};
use mcl_core::{PointMap, Seed};
use mcl_datasets::simulator::{LidarSettings, OfficeSettings, simulate, simulate_cloud};
use mcl_maps::files::{Encoding, check_writable, is_point_cloud, write_map};
use serde::Serialize;

use super::Outcome;
use super::args::SimulateArgs;
use super::output::{prepare, print, write_carmen};
use mcl_core::text::thousands;

#[derive(Serialize)]
struct Simulated {
    scans: usize,
    readings: usize,
    path_length_m: f64,
}

#[derive(Serialize)]
struct SimulatedCloud {
    dimensions: usize,
    points: usize,
}

pub fn run(args: &SimulateArgs) -> Result<Outcome> {
    if args.three_dimensional {
        return simulate_in_space(args);
    }
    let path = &args.output;
    prepare([path], &[])?;
    let settings = OfficeSettings { people: args.people, ..OfficeSettings::default() };
    let recording = simulate(&settings, Seed::new(args.seed))?;
    let mut comments = vec![
        format!("mcl-eval {}: simulated office, seed {}", env!("CARGO_PKG_VERSION"), args.seed),
        "laser poses are exact ground truth".to_owned(),
    ];
    if args.people > 0 {
        comments.push(format!("people who walk about: {}", args.people));
    }
    let comments: Vec<&str> = comments.iter().map(String::as_str).collect();
    write_carmen(path, &recording, &comments)
        .with_context(|| format!("cannot write {}", path.display()))?;
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

fn simulate_in_space(args: &SimulateArgs) -> Result<Outcome> {
    let path = &args.output;
    if !is_point_cloud(path) {
        bail!("{}: expected a point cloud in three dimensions: .ply, .pcd or .csv", path.display());
    }
    check_writable(path, &[])?;
    let seed = Seed::new(args.seed);
    let points = simulate_cloud(&OfficeSettings::default(), &LidarSettings::default(), seed)?;
    let simulated = SimulatedCloud { dimensions: 3, points: points.len() };
    write_map(path, &PointMap::new(points)?, Encoding::Binary)?;
    print(args.json, &simulated, |found| {
        format!("{}: {} points in three dimensions", path.display(), thousands(found.points))
    })?;
    Ok(Outcome::Done)
}
