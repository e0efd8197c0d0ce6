use mcl_core::memory::with_room;
use mcl_core::{Bounds, Point, PointMap, Pose2, Recording, is_usable_range};

use super::beam::cells_before_end;
use super::{Cell, GridError, OccupancyGrid, check_resolution, check_size};

/// The source of a grid's free space.
#[derive(Debug, Clone, Copy)]
pub struct FreeSpace<'a> {
    /// The log whose beams, from its reference poses, mark free cells.
    pub recording: &'a Recording,
    /// Largest reading that is used, in metres.
    pub max_range: f64,
}

/// Rasterizes a point map to a grid with cells of `resolution` metres, whose borders are multiples of it.
///
/// A cell is occupied if it contains a point of the map. With a log, a cell is free if it is not occupied,
/// a usable beam crossed it and none ended in it. A cell in which a beam ended but the map has no point is therefore
/// unknown. Beams without a usable reading (0 < r ≤ `max_range`) mark no cells, because a missing return may mean
/// glass as well as free space. All other cells are unknown. The grid contains all points and beams, with a margin
/// of one cell.
///
/// # Errors
/// [`GridError`] for a resolution that is not positive or too fine for the extent of the map, and for a
/// log without reference poses.
pub fn rasterize(
    map: &PointMap<2>,
    resolution: f64,
    free_space: Option<FreeSpace<'_>>,
) -> Result<OccupancyGrid, GridError> {
    check_resolution(resolution)?;
    let beams = match free_space {
        Some(free_space) => beams(free_space)?,
        None => Vec::new(),
    };
    let ends = beams.iter().flatten().copied();
    let mut all: Vec<Point<2>> = with_room(map.len() + 2 * beams.len(), BEAMS)?;
    all.extend(map.points().iter().copied().chain(ends));
    let bounds = Bounds::of(&all).unwrap_or_else(|| map.bounds());
    let raster = Raster::around(&bounds, resolution)?;

    drop(all);
    let mut cells = with_room(raster.width * raster.height, "cells of a grid map")?;
    cells.resize(raster.width * raster.height, Cell::Unknown);
    for [start, end] in &beams {
        for (column, row) in cells_before_end(raster.position(start), raster.position(end)) {
            cells[raster.index_of(column, row)] = Cell::Free;
        }
    }
    for [_, end] in &beams {
        cells[raster.index(end)] = Cell::Unknown;
    }
    for point in map.points() {
        cells[raster.index(point)] = Cell::Occupied;
    }
    OccupancyGrid::new(raster.width, resolution, raster.map_from_grid(), cells)
}

/// What out-of-memory errors call this memory.
const BEAMS: &str = "beams across a grid map";

/// Start and end of each usable beam, in the map frame.
fn beams(free_space: FreeSpace<'_>) -> Result<Vec<[Point<2>; 2]>, GridError> {
    let FreeSpace { recording, max_range } = free_space;
    let ends = recording.points(max_range)?;
    let starts = recording.scans.iter().flat_map(|scan| {
        // Every scan has a reference pose, otherwise computing the points above had failed.
        let start = scan.map_from_laser.map_or([f64::NAN; 2], |pose| [pose.x, pose.y]);
        let usable = scan.ranges.iter().filter(|&&range| is_usable_range(range, max_range));
        usable.map(move |_| start)
    });
    let mut beams = with_room(ends.len(), BEAMS)?;
    beams.extend(starts.zip(ends).map(|(start, end)| [start, end]));
    Ok(beams)
}

/// Conversion from positions to cells.
struct Raster {
    resolution: f64,
    /// Index of the first column and row, relative to the origin of the map.
    first: [f64; 2],
    width: usize,
    height: usize,
}

impl Raster {
    /// The raster of the cells that cover these bounds, and one more on each side.
    fn around(bounds: &Bounds<2>, resolution: f64) -> Result<Self, GridError> {
        let first = bounds.min.map(|value| (value / resolution).floor() - 1.0);
        let last = bounds.max.map(|value| (value / resolution).floor() + 1.0);
        let [width, height] = [0, 1].map(|axis| last[axis] - first[axis] + 1.0);
        check_size(width, height, resolution)?;
        Ok(Raster { resolution, first, width: width as usize, height: height as usize })
    }

    fn map_from_grid(&self) -> Pose2 {
        let [x, y] = self.first.map(|index| index * self.resolution);
        Pose2::new(x, y, 0.0)
    }

    /// A position in cells, relative to the lower left corner.
    fn position(&self, point: &Point<2>) -> [f64; 2] {
        [0, 1].map(|axis| point[axis] / self.resolution - self.first[axis])
    }

    fn index(&self, point: &Point<2>) -> usize {
        let [column, row] = self.position(point).map(|value| value.floor() as i64);
        self.index_of(column, row)
    }

    /// The margin keeps positions inside despite rounding.
    fn index_of(&self, column: i64, row: i64) -> usize {
        row as usize * self.width + column as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::{CoreError, LaserScan, ScanGeometry};

    fn scan(pose: Option<Pose2>, ranges: &[f64]) -> LaserScan {
        LaserScan {
            stamp: None,
            geometry: ScanGeometry {
                start_angle: 0.0,
                angle_step: std::f64::consts::FRAC_PI_2,
                beams: ranges.len(),
            },
            ranges: ranges.to_vec(),
            map_from_laser: pose,
            odometry: None,
            sweep: Default::default(),
        }
    }

    fn log(scans: Vec<LaserScan>) -> Recording {
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    /// The grid as text, the top row first: `#` occupied, `.` free, `?` unknown.
    fn drawn(grid: &OccupancyGrid) -> Vec<String> {
        let letter = |cell: &Cell| match cell {
            Cell::Occupied => '#',
            Cell::Free => '.',
            Cell::Unknown => '?',
        };
        grid.cells()
            .chunks(grid.width())
            .rev()
            .map(|row| row.iter().map(letter).collect())
            .collect()
    }

    #[test]
    fn beams_free_the_cells_before_their_end() {
        // From (0.5, 0.5): a wall 3 m to the right, one 2 m up that is not in the map, no return from the left, and a
        // reading beyond the maximum range.
        let recording =
            log(vec![scan(Some(Pose2::new(0.5, 0.5, 0.0)), &[3.0, 2.0, f64::INFINITY, 11.0])]);
        let map = PointMap::new(vec![[3.5, 0.5]]).unwrap();
        let free = FreeSpace { recording: &recording, max_range: 10.0 };
        let grid = rasterize(&map, 1.0, Some(free)).unwrap();
        assert_eq!(drawn(&grid), ["??????", "??????", "?.????", "?...#?", "??????"]);
        assert_eq!(grid.map_from_grid(), Pose2::new(-1.0, -1.0, 0.0));
        let without = rasterize(&map, 1.0, None).unwrap();
        assert_eq!(drawn(&without), ["???", "?#?", "???"]);
        assert_eq!(without.occupied_points(), [[3.5, 0.5]]);
    }

    #[test]
    fn a_crossed_cell_where_a_beam_ended_is_not_free() {
        let pose = Some(Pose2::new(0.5, 0.5, 0.0));
        let recording = log(vec![scan(pose, &[3.0]), scan(pose, &[1.0])]);
        let map = PointMap::new(vec![[3.5, 0.5]]).unwrap();
        let free = FreeSpace { recording: &recording, max_range: 10.0 };
        let grid = rasterize(&map, 1.0, Some(free)).unwrap();
        assert_eq!(drawn(&grid), ["??????", "?.?.#?", "??????"]);
    }

    #[test]
    fn settings_that_make_no_grid_are_refused() {
        let map = PointMap::new(vec![[0.0, 0.0], [1e9, 1e9]]).unwrap();
        assert_eq!(rasterize(&map, 0.0, None), Err(GridError::Resolution(0.0)));
        let message = rasterize(&map, 0.05, None).unwrap_err().to_string();
        assert!(message.contains("use a larger resolution"), "{message}");
        let recording = log(vec![scan(None, &[1.0])]);
        let free = FreeSpace { recording: &recording, max_range: 10.0 };
        assert_eq!(
            rasterize(&map, 1e6, Some(free)),
            Err(GridError::Log(CoreError::NoReference { scan: 0 }))
        );
    }
}
