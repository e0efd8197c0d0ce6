//! The storage size of a map (docs/representations.md defines how bytes are counted).

use anyhow::Result;
use mcl_maps::bytes::{grid_bytes, grid_run_lengths, ndt_bytes, point_bytes, segment_bytes};

use super::{MapContext, MapMeasure};
use crate::table::Value;
use crate::trial::map::Shape;

/// Kilobytes (1,000 bytes) uncompressed, and for grids with run-length encoding.
pub const BYTES: MapMeasure = MapMeasure {
    name: "bytes",
    columns: &["kilobytes", "run_length_kilobytes"],
    planar: measure::<2>,
    spatial: measure::<3>,
};

fn measure<const D: usize>(context: &MapContext<'_, D>) -> Result<Vec<Value>> {
    let (raw, run_length) = match &context.map.shape {
        Shape::Points(built) => (point_bytes(&built.map), None),
        Shape::Grid(grid) => (grid_bytes(grid), Some(grid_run_lengths(grid).len())),
        Shape::Ndt { map, .. } => (ndt_bytes(map), None),
        Shape::Segments(map) => (segment_bytes(map), None),
    };
    let kilobytes = |bytes: usize| bytes as f64 / 1000.0;
    Ok(vec![kilobytes(raw).into(), run_length.map(kilobytes).into()])
}
