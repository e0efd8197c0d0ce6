//! The size of a map.

use anyhow::Result;

use super::{MapContext, MapMeasure};
use crate::table::Value;
use crate::trial::map::Shape;

/// Points of data and map, and for a grid cell size and offset (m). `elements` are points, cells, Gaussians
/// or segments; `used_sigma_m` is σ as given or as chosen by the data, `tried` the number of values tried for
/// a size or σ chosen by the data.
pub const SIZE: MapMeasure = MapMeasure {
    name: "size",
    columns: &[
        "data_points",
        "requested_points",
        "map_points",
        "real_percent",
        "elements",
        "cell_m",
        "offset_x_m",
        "offset_y_m",
        "used_sigma_m",
        "tried",
    ],
    planar: measure::<2>,
    spatial: measure::<3>,
};

fn measure<const D: usize>(context: &MapContext<'_, D>) -> Result<Vec<Value>> {
    let MapContext { division, map, .. } = context;
    let (data_points, map_points) = (division.building.len(), map.points().map(|map| map.len()));
    let elements = match &map.shape {
        Shape::Points(built) => built.map.len(),
        Shape::Grid(grid) => grid.cells().len(),
        Shape::Ndt { map, .. } => map.cells().len(),
        Shape::Segments(map) => map.segments().len(),
    };
    let (cell, offset) = match &map.shape {
        Shape::Points(built) => (built.cell, built.offset),
        _ => (None, None),
    };
    let axis = |axis: usize| offset.map(|offset| offset[axis]);
    Ok(vec![
        data_points.into(),
        map.requested_points.into(),
        map_points.into(),
        map_points.map(|points| 100.0 * points as f64 / data_points as f64).into(),
        elements.into(),
        cell.into(),
        axis(0).into(),
        axis(1).into(),
        map.sigma.into(),
        map.tried.into(),
    ])
}
