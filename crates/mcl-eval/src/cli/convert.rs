use std::io::{Cursor, Write};
use std::path::Path;

use anyhow::{Context, Result, bail};
use flate2::Compression;
use flate2::write::GzEncoder;
use mcl_core::PointMap;
use mcl_core::files::write_atomically;
use mcl_datasets::{bag, carmen};
use mcl_maps::files::{Encoding, is_grid, read_grid, read_map, write_grid, write_map};
use serde::Serialize;

use super::Outcome;
use super::args::ConvertArgs;
use super::grid::{GridFigures, check_options, grid_of};
use super::output::{print, tell_losses};
use mcl_core::text::thousands;
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::LogSource;

#[derive(Serialize)]
#[serde(tag = "converted", rename_all = "lowercase")]
enum Converted {
    Log { scans: usize, readings: usize, has_reference: bool, has_odometry: bool },
    Map { map_points: usize, grid: Option<GridFigures> },
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
            ("csv" | "ply" | "pcd" | "yaml" | "yml", false) => Ok(Format::Map),
            _ => bail!(
                "{}: the ending says no format, expected .mcap (ROS 2 bag), .log or .clf (CARMEN, also \
                 with .gz), or .csv, .ply, .pcd or .yaml (maps)",
                path.display()
            ),
        }
    }
}

pub fn run(args: &ConvertArgs) -> Result<Outcome> {
    let format = Format::of(&args.output)?;
    check_options(&args.output, args.resolution, args.log.as_deref());
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
    if is_grid(&args.output) {
        return grid(args);
    }
    let map = read_points(args)?;
    let encoding = if args.ascii { Encoding::Ascii } else { Encoding::Binary };
    write_map(&args.output, &map, encoding)?;
    print(args.json, &Converted::Map { map_points: map.len(), grid: None }, |_| {
        format!("{}: {} points", args.output.display(), thousands(map.len()))
    })?;
    Ok(Outcome::Done)
}

fn read_points(args: &ConvertArgs) -> Result<PointMap<2>> {
    read_map(&args.input)
        .with_context(|| format!("{} is the ending of a map", args.output.display()))
}

fn grid(args: &ConvertArgs) -> Result<Outcome> {
    let input = Path::new(&args.input);
    let source = args
        .log
        .as_ref()
        .map(|log| LogSource::open(log, &options(args, args.max_range)))
        .transpose()?;
    let grid = match (is_grid(input), args.resolution, &source) {
        // Nothing is asked for but another name: the same cells, free ones, too.
        (true, None, None) => read_grid(input)?,
        (true, None, Some(_)) => {
            let resolution = read_grid(input)?.resolution();
            grid_of(&read_points(args)?, Some(resolution), source.as_ref())?
        }
        _ => grid_of(&read_points(args)?, args.resolution, source.as_ref())?,
    };
    write_grid(&args.output, &grid)?;
    let figures = GridFigures::of(&grid);
    let told = format!("{}: {}", args.output.display(), figures.text());
    let map_points = grid.occupied_points().len();
    print(args.json, &Converted::Map { map_points, grid: Some(figures) }, |_| told)?;
    Ok(match (&source, &args.log) {
        (Some(source), Some(log)) => tell_losses(log, source),
        _ => Outcome::Done,
    })
}

fn options(args: &ConvertArgs, max_range: Option<f64>) -> SourceOptions {
    SourceOptions {
        max_range,
        reference: args.reference,
        topics: args.topics.choice(),
        ..SourceOptions::default()
    }
}

fn log(args: &ConvertArgs, format: &Format) -> Result<Outcome> {
    let source = LogSource::open_whole(&args.input, &options(args, None))?;
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
