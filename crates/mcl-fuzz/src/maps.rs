//! Map files.

use mcl_core::PointMap;
use mcl_maps::files::{Encoding, MapProblem, PointFormat, encode_grid, parse_grid};

use crate::memory::{ANY_INPUT, bounded};

const FORMATS: [PointFormat; 3] = [PointFormat::Csv, PointFormat::Ply, PointFormat::Pcd];
/// The readers of headers keep several copies of short names; a point of two bytes takes 24.
const PER_BYTE: usize = 256;

pub fn csv(bytes: &[u8]) {
    points(PointFormat::Csv, bytes);
}

pub fn ply(bytes: &[u8]) {
    points(PointFormat::Ply, bytes);
}

pub fn pcd(bytes: &[u8]) {
    points(PointFormat::Pcd, bytes);
}

fn points(format: PointFormat, bytes: &[u8]) {
    read_as::<2>(format, bytes);
    read_as::<3>(format, bytes);
}

fn read_as<const D: usize>(format: PointFormat, bytes: &[u8]) {
    let map = bounded(bytes.len(), ANY_INPUT, PER_BYTE, || format.parse::<D>(bytes));
    match map {
        Ok(map) => through_all_formats(&map),
        Err(problem) => check_message(&problem),
    }
}

/// Every format keeps every bit.
fn through_all_formats<const D: usize>(map: &PointMap<D>) {
    let bits = |map: &PointMap<D>| -> Vec<[u64; D]> {
        map.points().iter().map(|point| point.map(f64::to_bits)).collect()
    };
    assert!(map.points().iter().flatten().all(|coordinate| coordinate.is_finite()));
    for format in FORMATS {
        for encoding in [Encoding::Binary, Encoding::Ascii] {
            let mut written = Vec::new();
            format.write(map, encoding, &mut written).expect("a map can be written");
            let again = format.parse::<D>(&written).unwrap_or_else(|problem| {
                panic!("written as {format:?} {encoding:?}, it cannot be read: {problem}")
            });
            assert_eq!(bits(&again), bits(map), "{format:?} {encoding:?}");
        }
    }
}

/// A grid map: its description up to a NUL, then its image.
pub fn grid(bytes: &[u8]) {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    let (description, image) = (&bytes[..end], bytes.get(end + 1..).unwrap_or_default());
    // Deflate packs at most 1,032 bytes into one, of eight pixels each; these are a byte each as unpacked,
    // another as cells (a growing vector), and a third when the rows are turned over.
    let grid = bounded(description.len(), ANY_INPUT + 5 * 8 * 1_032 * image.len(), 2_000, || {
        parse_grid(description, image)
    });
    let grid = match grid {
        Ok(grid) => grid,
        Err(problem) => return check_message(&problem),
    };
    assert_eq!(grid.cells().len(), grid.width() * grid.height());
    assert!(grid.resolution() > 0.0 && grid.map_from_grid().is_finite());
    let centres = grid.occupied_points();
    assert!(centres.iter().flatten().all(|coordinate| coordinate.is_finite()));
    let (description, image) = encode_grid(&grid, "map.pgm");
    let again = parse_grid(description.as_bytes(), &image).expect("a written grid can be read");
    assert_eq!(again, grid);
}

/// A message of a readable length, whatever the file holds.
fn check_message(problem: &MapProblem) {
    let length = problem.to_string().len();
    assert!((1..20_000).contains(&length), "a message of {length} bytes");
}
