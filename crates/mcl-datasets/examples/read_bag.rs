//! What a bag of ROS or a CARMEN log holds: `cargo run --example read_bag -- my.bag`. Without an argument it writes a bag of
//! the simulated office first.

use std::fs::File;
use std::path::PathBuf;

use mcl_core::Seed;
use mcl_datasets::bag::{Format, write_as};
use mcl_datasets::log::read_log;
use mcl_datasets::simulator::{OfficeSettings, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = match std::env::args_os().nth(1) {
        Some(path) => PathBuf::from(path),
        None => {
            let path = folder.path().join("office.bag");
            let office = simulate(&OfficeSettings::default(), Seed::new(1))?;
            write_as(&office, Format::Ros1, File::create(&path)?)?;
            path
        }
    };
    let log = read_log(&path)?;
    let recording = &log.recording;
    println!("{}, {} scans of {:.0} s", log.kind, recording.scans.len(), recording.duration_s());
    if !log.report.is_complete() {
        println!("{}", log.report);
    }
    println!("odometry: {}", recording.has_odometry());
    match recording.points(10.0) {
        Ok(points) => println!("{} points of readings up to 10 m", points.len()),
        // Without reference poses there are no points; `ReadOptions::reference_track` brings them from a file of their own.
        Err(error) => println!("no points: {error}"),
    }
    Ok(())
}
