use std::io::{Cursor, Write};
use std::path::Path;

use anyhow::{Context, Result, bail};
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_datasets::{bag, carmen};
use mcl_maps::files::{Encoding, read_map, write_atomically, write_map};
use serde::Serialize;

use super::Outcome;
use super::args::ConvertArgs;
use super::output::{print, tell_losses, thousands};
use crate::source::{LogSource, SourceOptions};

#[derive(Serialize)]
#[serde(tag = "converted", rename_all = "lowercase")]
enum Converted {
    Log { scans: usize, readings: usize, has_reference: bool, has_odometry: bool },
    Map { map_points: usize },
}

/// What the ending of OUT asks for.
enum Format {
    Bag,
    Carmen { is_packed: bool },
    Map,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let (name, is_packed) = match name.strip_suffix(".gz") {
            Some(name) => (name.to_owned(), true),
            None => (name, false),
        };
        let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
        match (ending, is_packed) {
            ("mcap", false) => Ok(Format::Bag),
            ("log" | "clf", _) => Ok(Format::Carmen { is_packed }),
            ("csv" | "ply" | "pcd", false) => Ok(Format::Map),
            _ => bail!(
                "{}: the ending says no format, expected .mcap (ROS 2 bag), .log or .clf (CARMEN, also \
                 with .gz), or .csv, .ply or .pcd (maps)",
                path.display()
            ),
        }
    }
}

pub fn run(args: &ConvertArgs) -> Result<Outcome> {
    let format = Format::of(&args.output)?;
    if let Some(folder) = args.output.parent().filter(|folder| !folder.as_os_str().is_empty())
        && !folder.is_dir()
    {
        bail!("cannot write {}: there is no folder {}", args.output.display(), folder.display());
    }
    match format {
        Format::Map => map(args),
        Format::Bag | Format::Carmen { .. } => log(args, &format),
    }
}

fn map(args: &ConvertArgs) -> Result<Outcome> {
    let map = read_map::<2>(&args.input)
        .with_context(|| format!("{} is the ending of a map", args.output.display()))?;
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::Binary };
    write_map(&args.output, &map, encoding)?;
    print(args.json, &Converted::Map { map_points: map.len() }, |_| {
        format!("{}: {} points", args.output.display(), thousands(map.len()))
    })?;
    Ok(Outcome::Done)
}

fn log(args: &ConvertArgs, format: &Format) -> Result<Outcome> {
    let options =
        SourceOptions { max_range: None, reference: args.reference, topics: args.topics.choice() };
    let source = LogSource::open_whole(&args.input, &options)?;
    // A bag says by their absence which scans lie outside of its odometry; a CARMEN log cannot.
    let source = if matches!(format, Format::Carmen { .. }) { source.covered() } else { source };
    let recording = &source.recording;
    let path = &args.output;
    let failed = || format!("cannot convert {} to {}", args.input, path.display());
    let bytes = match format {
        Format::Carmen { is_packed } => {
            let comment = format!("mcl-eval {}: from {}", env!("CARGO_PKG_VERSION"), source.name);
            let mut text = Vec::new();
            carmen::write(recording, &[&comment], &mut text).with_context(failed)?;
            if *is_packed {
                let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
                encoder.write_all(&text)?;
                encoder.finish()?
            } else {
                text
            }
        }
        _ => bag::write(recording, Cursor::new(Vec::new())).with_context(failed)?.into_inner(),
    };
    write_atomically(path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
    let converted = Converted::Log {
        scans: recording.scans.len(),
        readings: recording.readings(),
        has_reference: recording.has_reference(),
        has_odometry: recording.has_odometry(),
    };
    print(args.json, &converted, |_| {
        format!(
            "{}: {} scans, {} readings",
            path.display(),
            thousands(recording.scans.len()),
            thousands(recording.readings())
        )
    })?;
    Ok(tell_losses(&args.input, &source))
}
