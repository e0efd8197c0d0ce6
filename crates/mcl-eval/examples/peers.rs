//! This program's side of `benches/peers`: prepares what all programs work on, and times one piece of
//! work per call. Prints one JSON object.
//!
//! Points are files of little-endian doubles, x and y in turns.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use mcl_core::{NearestNeighbors, Point, PointMap, Pose2, Seed};
use mcl_filter::sensor::DistanceField;
use mcl_maps::sampling::{GridOffset, sample_grid};
use mcl_maps::{FkmSettings, PointSet, fuzzy_k_means};
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::LogSource;
use rand::RngExt;
use rand_distr::{Distribution, Normal};
use serde_json::{Value, json};

const USAGE: &str = "export LOG FOLDER | em POINTS MEANS SIGMA | sample POINTS CELL \
    | field MAP QUERIES MAX_DISTANCE ANSWERS | kiddo MAP QUERIES MAX_DISTANCE ANSWERS";
const QUERIES: usize = 100_000;
/// Work is repeated until this much processor time has been measured.
const MEASURED: Duration = Duration::from_millis(300);
/// The first call is not measured, unless it takes longer than this; then it is the only one.
const LONG: Duration = Duration::from_secs(2);

fn main() -> Result<()> {
    // Side by side on one thread each.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let answer = match arguments[..] {
        ["export", log, folder] => export(log, Path::new(folder))?,
        ["em", points, means, sigma] => em(points, means, sigma.parse()?)?,
        ["sample", points, cell] => sample(points, cell.parse()?)?,
        ["field", map, queries, max_distance, answers] => {
            let max_distance: f64 = max_distance.parse()?;
            let field = DistanceField::build(&PointMap::new(read(map)?)?, max_distance)?;
            let queries = read(queries)?;
            let mut squared = Vec::new();
            let seconds = timed(|| field.distances_squared(&queries, &mut squared));
            nearest(seconds, squared, max_distance, answers)?
        }
        ["kiddo", map, queries, max_distance, answers] => {
            let neighbors = NearestNeighbors::new(&read(map)?)?;
            let queries = read(queries)?;
            let mut squared = vec![0.0; queries.len()];
            let seconds = timed(|| {
                for (squared, query) in squared.iter_mut().zip(&queries) {
                    *squared = neighbors.nearest(query).distance_squared;
                }
            });
            nearest(seconds, squared, max_distance.parse()?, answers)?
        }
        _ => bail!("usage: {USAGE}"),
    };
    println!("{answer}");
    Ok(())
}

/// The processor's time of this process, on which other load on the machine has little influence.
#[cfg(unix)]
fn now() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// Where there is no such clock to be had: ordinary time.
#[cfg(not(unix))]
fn now() -> Duration {
    std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default()
}

/// The median processor time of one call, in seconds.
fn timed(mut work: impl FnMut()) -> f64 {
    let start = now();
    work();
    let first = now() - start;
    if first > LONG {
        return first.as_secs_f64();
    }
    let mut times = Vec::new();
    let start = now();
    while times.is_empty() || now() - start < MEASURED {
        let start = now();
        work();
        times.push((now() - start).as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Writes `points.f64`, `queries.f64` and `scans.jsonl` (per scan the directions of its beams, its
/// readings, its reference pose, and its pose by raw odometry from the origin).
fn export(log: &str, folder: &Path) -> Result<Value> {
    let source = LogSource::open(log, &SourceOptions::default())?;
    let points = source.points()?;
    write(&folder.join("points.f64"), &points)?;
    write(&folder.join("queries.f64"), &queries(&source)?)?;

    let mut file = BufWriter::new(File::create(folder.join("scans.jsonl"))?);
    let mut odometry = Pose2::IDENTITY;
    let pose = |pose: &Pose2| [pose.x, pose.y, pose.theta];
    for scan in &source.recording.scans {
        odometry = odometry.compose(&scan.odometry.unwrap_or(Pose2::IDENTITY));
        let line = json!({
            "start_angle": scan.geometry.start_angle,
            "angle_step": scan.geometry.angle_step,
            "ranges": scan.ranges,
            "reference": scan.map_from_laser.as_ref().map(pose),
            "odometry": pose(&odometry),
        });
        writeln!(file, "{line}")?;
    }
    file.flush()?;
    let scans = source.recording.scans.len();
    Ok(json!({ "points": points.len(), "scans": scans, "max_range": source.max_range }))
}

/// What a particle filter asks for: endpoints of scans, seen from poses about the reference.
fn queries(source: &LogSource) -> Result<Vec<Point<2>>> {
    let mut rng = Seed::new(1).derive("peers-queries").rng();
    let (shift, turn) = (Normal::new(0.0, 0.1)?, Normal::new(0.0, 0.05)?);
    let mut queries = Vec::with_capacity(QUERIES);
    while queries.len() < QUERIES {
        let scan = &source.recording.scans[rng.random_range(0..source.recording.scans.len())];
        let pose = scan.map_from_laser.context("a scan has no reference pose")?;
        let pose = Pose2::new(
            pose.x + shift.sample(&mut rng),
            pose.y + shift.sample(&mut rng),
            pose.theta + turn.sample(&mut rng),
        );
        queries.extend(scan.endpoints(pose, source.max_range));
    }
    queries.truncate(QUERIES);
    Ok(queries)
}

/// The E step and the means' displacements of the M step. Arranging the data, once for all the maps
/// that are built of it, is not timed.
fn em(points: &str, means: &str, sigma: f64) -> Result<Value> {
    let data = PointSet::new(read(points)?)?;
    let means = PointMap::new(read(means)?)?;
    let settings = FkmSettings { sigma, max_iterations: 0, ..FkmSettings::default() };
    fuzzy_k_means(&data, &means, &settings, |_, _| {})?;
    let mut per_point = f64::NAN;
    let seconds = timed(|| {
        let fitted = fuzzy_k_means(&data, &means, &settings, |_, value| per_point = value);
        std::hint::black_box(fitted.expect("the settings were good a moment ago"));
    });
    Ok(json!({ "seconds": seconds, "log_likelihood_per_point": per_point }))
}

fn sample(points: &str, cell: f64) -> Result<Value> {
    let points = read(points)?;
    let mut kept = sample_grid(&points, cell, GridOffset::ORIGIN)?.indices.len();
    let seconds = timed(|| {
        let sample = sample_grid(std::hint::black_box(&points), cell, GridOffset::ORIGIN);
        kept = sample.expect("the cell was good a moment ago").indices.len();
    });
    Ok(json!({ "seconds": seconds, "points": kept }))
}

/// Writes the distances, cut like those of the likelihood field.
fn nearest(seconds: f64, squared: Vec<f64>, max_distance: f64, answers: &str) -> Result<Value> {
    let mut file = BufWriter::new(File::create(answers)?);
    for squared in squared {
        file.write_all(&squared.sqrt().min(max_distance).to_le_bytes())?;
    }
    file.flush()?;
    Ok(json!({ "seconds": seconds }))
}

fn read(path: &str) -> Result<Vec<Point<2>>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {path}"))?;
    let (pairs, []) = bytes.as_chunks::<16>() else {
        bail!("{path} has {} bytes, expected 16 per point", bytes.len())
    };
    let number = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().expect("eight bytes"));
    Ok(pairs.iter().map(|pair| [number(&pair[..8]), number(&pair[8..])]).collect())
}

fn write(path: &Path, points: &[Point<2>]) -> Result<()> {
    let mut file = BufWriter::new(
        File::create(path).with_context(|| format!("cannot write {}", path.display()))?,
    );
    for coordinate in points.as_flattened() {
        file.write_all(&coordinate.to_le_bytes())?;
    }
    Ok(file.flush()?)
}
