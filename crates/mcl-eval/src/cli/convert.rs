use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::files::write_with;
use mcl_core::{LaserScan, PointMap};
use mcl_datasets::bag;
use mcl_maps::files::{
    Encoding, MapFileError, check_writable, is_grid, read_grid, write_grid, write_map,
};
use serde::Serialize;

use super::Outcome;
use super::args::ConvertArgs;
use super::grid::{GridFigures, check_options, grid_of};
use super::output::{
    input_files, open_map, prepare, print, reference_of, report_losses, write_carmen,
};
use crate::progress::tell;
use mcl_core::text::thousands;
use mcl_study::data::source::LogSource;

#[derive(Serialize)]
#[serde(tag = "converted", rename_all = "lowercase")]
enum Converted {
    Log {
        scans: usize,
        readings: usize,
        has_reference: bool,
        has_odometry: bool,
        reference: Option<String>,
    },
    Map {
        map_points: usize,
        grid: Option<GridFigures>,
    },
}

/// The format selected by the ending of OUT.
enum Format {
    Bag(bag::Format),
    Carmen,
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
            ("mcap", false) => Ok(Format::Bag(bag::Format::Mcap)),
            ("bag", false) => Ok(Format::Bag(bag::Format::Ros1)),
            ("db3", false) => Ok(Format::Bag(bag::Format::Database)),
            ("log" | "clf", _) => Ok(Format::Carmen),
            ("csv" | "ply" | "pcd" | "yaml" | "yml", false) => Ok(Format::Map),
            _ => bail!(
                "{}: the extension names no known format, expected .mcap or .db3 (bag of ROS 2), .bag (of \
                 ROS 1), .log or .clf (CARMEN, also with .gz), or .csv, .ply, .pcd or .yaml (maps)",
                path.display()
            ),
        }
    }
}

pub fn run(args: &ConvertArgs) -> Result<Outcome> {
    let format = Format::of(&args.output)?;
    check_options(&args.output, args.resolution, args.log.as_deref())?;
    let named = [Some(args.input.as_str()), args.log.as_deref(), args.read.reference_file()];
    let inputs = input_files(named.into_iter().flatten());
    match format {
        Format::Map => {
            check_writable(&args.output, &inputs)?;
            map(args)
        }
        Format::Bag(_) | Format::Carmen => {
            prepare([&args.output], &inputs)?;
            log(args, &format)
        }
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
    open_map(Path::new(&args.input)).map_err(|error| match error.downcast_ref() {
        Some(MapFileError::UnknownEnding { .. }) => {
            error.context(format!("{} has the extension of a map", args.output.display()))
        }
        _ => error,
    })
}

fn grid(args: &ConvertArgs) -> Result<Outcome> {
    let input = Path::new(&args.input);
    let source = args
        .log
        .as_ref()
        .map(|log| LogSource::open(log, &args.read.options(args.max_range)))
        .transpose()?;
    let grid = match (is_grid(input), args.resolution, &source) {
        // Only another file name is requested: copy the cells, including free ones.
        (true, None, None) => read_grid(input)?,
        (true, None, Some(_)) => {
            let resolution = read_grid(input)?.resolution();
            grid_of(&read_points(args)?, Some(resolution), source.as_ref())?
        }
        _ => grid_of(&read_points(args)?, args.resolution, source.as_ref())?,
    };
    write_grid(&args.output, &grid)?;
    let figures = GridFigures::of(&grid);
    let described = format!("{}: {}", args.output.display(), figures.text());
    let map_points = grid.occupied_points().len();
    print(args.json, &Converted::Map { map_points, grid: Some(figures) }, |_| described)?;
    Ok(match (&source, &args.log) {
        (Some(source), Some(log)) => report_losses(log, source),
        _ => Outcome::Done,
    })
}

fn log(args: &ConvertArgs, format: &Format) -> Result<Outcome> {
    let mut options = args.read.options(None);
    // Beams corrected for the motion of the laser are not evenly spaced any more.
    options.read.no_deskew = true;
    let source = LogSource::open_whole(&args.input, &options)?;
    // A bag can express which scans lie outside of its odometry; a CARMEN log cannot.
    let source = if matches!(format, Format::Carmen) { source.covered() } else { source };
    let recording = &source.recording;
    let path = &args.output;
    let written = match format {
        Format::Carmen => {
            let comment = format!("mcl-eval {}: from {}", env!("CARGO_PKG_VERSION"), source.name);
            write_carmen(path, recording, &[&comment])
        }
        Format::Bag(format) => {
            write_with(path, |file| Ok(bag::write_as(recording, *format, file).map(drop)?))
        }
        Format::Map => bail!("{} has the extension of a map", path.display()),
    };
    written.with_context(|| format!("cannot convert {} to {}", args.input, path.display()))?;
    let converted = Converted::Log {
        scans: recording.scans.len(),
        readings: recording.readings(),
        has_reference: recording.has_reference(),
        has_odometry: recording.has_odometry(),
        reference: source.reference.clone(),
    };
    print(args.json, &converted, |_| {
        format!(
            "{}: {} scans, {} readings\nreference: {}",
            path.display(),
            thousands(recording.scans.len()),
            thousands(recording.readings()),
            reference_of(&source)
        )
    })?;
    let is_swept = |scan: &LaserScan| scan.sweep.time_increment != 0.0;
    let is_lost = matches!(format, Format::Carmen) && recording.scans.iter().any(is_swept);
    if is_lost {
        tell!(
            "warning: {}: its scans take time, which a CARMEN log cannot say: the beams of {} count as measured at once",
            args.input,
            path.display()
        );
    }
    let outcome = report_losses(&args.input, &source);
    Ok(if is_lost { Outcome::Incomplete } else { outcome })
}
