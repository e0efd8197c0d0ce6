//! Map files: point maps in CSV, PLY and PCD, and the grid maps of ROS's map_server.
//!
//! The extension of a file determines its format. Coordinates are metres in the map frame, stored as 64-bit
//! numbers (in text as the shortest decimals that parse to the same bits), so a map is the same bit for bit after
//! writing and reading, including signed zeros and subnormal numbers.
//!
//! | extension | written | read |
//! |---|---|---|
//! | `.csv` | header `x,y` (`x,y,z` in 3-D) | any column order, further columns, `#` comments, CRLF |
//! | `.ply` | `double x y z`, binary little-endian or ASCII | also big-endian, any scalar type, further columns and elements |
//! | `.pcd` | version 0.7, `x y z` as `SIZE 8 TYPE F`, binary or ASCII | also `binary_compressed`, any scalar type, further columns |
//! | `.yaml`, `.yml` | map_server grid beside a `.pgm` image, mode trinary | also P2 and `.png`, 16 bits, modes scale and raw, a rotated origin |
//!
//! Point-cloud tools expect three coordinates, so a planar map is written to PLY and PCD with z = 0.
//! Reading a planar map accepts a file without z or with z = 0 everywhere; any other height is an
//! error, because dropping it would silently flatten a 3-D cloud.
//!
//! A grid map is not a point map: [`read_map`] returns the centres of its occupied cells, and [`write_map`] marks
//! the cells (of [`DEFAULT_RESOLUTION`]) that contain a point. For another resolution, or with free space, build the
//! grid ([`crate::occupancy`]) and call [`write_grid`].
//!
//! A point cloud from a scanner is data, not a map: [`read_cloud`] reads both dimensions and leaves out the points of
//! missing returns.
//!
//! # Example
//! ```
//! use mcl_core::{Point, PointMap};
//! use mcl_maps::files::{Encoding, read_map, write_map};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("corridor.ply");
//! let map = PointMap::new(vec![[0.0, 1.5], [0.1, -0.0]])?;
//! write_map(&path, &map, Encoding::Ascii)?;
//! assert_eq!(read_map::<2>(&path)?, map);
//! # Ok(())
//! # }
//! ```

mod cloud;
mod columns;
mod csv_points;
mod error;
mod map_server;
mod pcd_points;
mod ply_points;
mod text_rows;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use mcl_core::files::{Unwritable, prepare, write_with};
use mcl_core::memory::check_room;
use mcl_core::{Point, PointMap};

use crate::occupancy::{Cell, DEFAULT_RESOLUTION, rasterize};
use columns::{NotFinite, Parsed};

pub use cloud::{PointCloud, is_point_cloud, read_cloud};
pub use error::{FilePosition, MapFileError, MapProblem};
pub use map_server::{encode_grid, image_in_place, parse_grid, read_grid, write_grid};

/// Encoding of numbers in PLY and PCD files. CSV is always text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// Little-endian 64-bit numbers: smaller and faster.
    #[default]
    Binary,
    /// Decimal text: readable, easy to compare and equally exact.
    Ascii,
}

/// A file format of point maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PointFormat {
    /// `.csv`
    Csv,
    /// `.ply`
    Ply,
    /// `.pcd`
    Pcd,
}

impl PointFormat {
    /// Parses the content of a file.
    ///
    /// # Errors
    /// [`MapProblem`] if the content is invalid.
    pub fn parse<const D: usize>(self, bytes: &[u8]) -> Result<PointMap<D>, MapProblem> {
        const { planar_or_spatial(D) };
        let parsed = self.parse_points(bytes, NotFinite::Refused)?;
        PointMap::new(parsed.points).map_err(MapProblem::Points)
    }

    fn parse_points<const D: usize>(
        self,
        bytes: &[u8],
        not_finite: NotFinite,
    ) -> Result<Parsed<D>, MapProblem> {
        match self {
            PointFormat::Csv => csv_points::parse(bytes, not_finite),
            PointFormat::Ply => ply_points::parse(bytes, not_finite),
            PointFormat::Pcd => pcd_points::parse(bytes, not_finite),
        }
    }

    /// Writes the file content of a map.
    ///
    /// # Errors
    /// Those of `sink` and of the formats' libraries.
    pub fn write<const D: usize>(
        self,
        map: &PointMap<D>,
        encoding: Encoding,
        sink: &mut impl Write,
    ) -> io::Result<()> {
        const { planar_or_spatial(D) };
        match self {
            PointFormat::Csv => csv_points::write(map.points(), sink),
            PointFormat::Ply => ply_points::write(map.points(), encoding, sink),
            PointFormat::Pcd => sink.write_all(&pcd_points::encode(map.points(), encoding)?),
        }
    }
}

/// A map format, from the extension of a file.
enum Format {
    Points(PointFormat),
    Grid,
}

impl Format {
    fn of(path: &Path) -> Result<Self, MapFileError> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            "csv" => Ok(Format::Points(PointFormat::Csv)),
            "ply" => Ok(Format::Points(PointFormat::Ply)),
            "pcd" => Ok(Format::Points(PointFormat::Pcd)),
            "yaml" | "yml" => Ok(Format::Grid),
            "pgm" | "png" => Err(MapFileError::BareImage { path: path.into() }),
            _ => Err(MapFileError::UnknownEnding { path: path.into(), ending }),
        }
    }
}

/// Whether a path has the extension of a grid map (`.yaml`, `.yml`).
pub fn is_grid(path: impl AsRef<Path>) -> bool {
    matches!(Format::of(path.as_ref()), Ok(Format::Grid))
}

/// Checks before a long computation that a map can be written to a path: the extension is known, the folder exists,
/// and the path is free or a file that is not one of `inputs` ([`prepare`]). A grid map counts as two files, also
/// among the inputs.
///
/// # Errors
/// [`MapFileError::UnknownEnding`], [`MapFileError::BareImage`] and [`MapFileError::Unwritable`].
pub fn check_writable(path: impl AsRef<Path>, inputs: &[PathBuf]) -> Result<(), MapFileError> {
    let path = path.as_ref();
    let mut outputs = vec![path.to_owned()];
    if let Format::Grid = Format::of(path)? {
        outputs.push(map_server::image_beside(path));
    }
    let images = inputs.iter().filter_map(|input| map_server::image_of(input));
    let inputs: Vec<PathBuf> = inputs.iter().cloned().chain(images).collect();
    let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    prepare(&outputs, &inputs)
        .map_err(|Unwritable { path, source }| MapFileError::Unwritable { path, source })
}

/// Fails to compile unless point maps have two or three dimensions.
const fn planar_or_spatial(dimensions: usize) {
    assert!(dimensions == 2 || dimensions == 3, "map files hold points in 2 or 3 dimensions");
}

/// Reads a point map; the extension of `path` determines the format, and the points keep the file order.
///
/// # Errors
/// [`MapFileError`] with the file and the reason: an unknown extension, an unreadable file, or the
/// [`MapProblem`] of its content with line or point, column, what was found and what was expected.
pub fn read_map<const D: usize>(path: impl AsRef<Path>) -> Result<PointMap<D>, MapFileError> {
    const { planar_or_spatial(D) };
    let path = path.as_ref();
    let Format::Points(format) = Format::of(path)? else { return read_grid_points(path) };
    let bytes = std::fs::read(path)
        .map_err(|source| MapFileError::Unreadable { path: path.into(), source })?;
    format.parse(&bytes).map_err(|problem| MapFileError::Content { path: path.into(), problem })
}

/// Reads the centres of the occupied cells of a grid map.
fn read_grid_points<const D: usize>(path: &Path) -> Result<PointMap<D>, MapFileError> {
    if D != 2 {
        return Err(MapFileError::PlanarFormat { path: path.into() });
    }
    let grid = read_grid(path)?;
    let content = |problem| MapFileError::Content { path: path.into(), problem };
    // A compressed image of a few kilobytes may contain a hundred million of them.
    check_room(grid.count(Cell::Occupied), 4 * size_of::<Point<D>>(), "points of a grid map")
        .map_err(|error| content(MapProblem::Points(error.into())))?;
    let centres = grid.occupied_points();
    if centres.is_empty() {
        let (width, height) = (grid.width(), grid.height());
        return Err(content(MapProblem::NothingOccupied { width, height }));
    }
    let points = centres.iter().map(|centre| std::array::from_fn(|axis| centre[axis])).collect();
    PointMap::new(points).map_err(|error| content(MapProblem::Points(error)))
}

fn write_grid_of<const D: usize>(path: &Path, map: &PointMap<D>) -> Result<(), MapFileError> {
    if D != 2 {
        return Err(MapFileError::PlanarFormat { path: path.into() });
    }
    let content = |problem| MapFileError::Content { path: path.into(), problem };
    let points = map.points().iter().map(|point| [point[0], point[1]]).collect();
    let planar = PointMap::new(points).map_err(|error| content(MapProblem::Points(error)))?;
    let grid = rasterize(&planar, DEFAULT_RESOLUTION, None)
        .map_err(|error| content(MapProblem::Grid(error)))?;
    write_grid(path, &grid)
}

/// Writes a point map; the extension of `path` determines the format.
///
/// The write is atomic: if it is interrupted, an existing file at `path` is unchanged.
///
/// # Errors
/// [`MapFileError`] for an unknown extension or a file that cannot be written.
pub fn write_map<const D: usize>(
    path: impl AsRef<Path>,
    map: &PointMap<D>,
    encoding: Encoding,
) -> Result<(), MapFileError> {
    const { planar_or_spatial(D) };
    let path = path.as_ref();
    let Format::Points(format) = Format::of(path)? else { return write_grid_of(path, map) };
    write_with(path, |file| format.write(map, encoding, file))
        .map_err(|source| MapFileError::Unwritable { path: path.into(), source })
}
