//! Grid maps of ROS's map_server: a YAML description and an image.
//!
//! They are read like Nav2's map_server (`map_io.cpp`) reads them. The top row of the image has the largest y.
//! With the lightness s of a pixel (mean of its channels over their largest value), the occupancy of its cell is
//! p = 1 − s, or s with `negate`:
//!
//! | `mode` | occupied | free | else |
//! |---|---|---|---|
//! | `trinary` (default) | p > `occupied_thresh` | p < `free_thresh` | unknown |
//! | `scale` | the same | the same | unknown, and transparent pixels; map_server scales p to 0 … 100 |
//! | `raw` | 255·s, rounded, is the probability in percent (unknown above 100), compared with the thresholds | | |
//!
//! There is one difference: if an image has only the three values that map_saver writes, 205 is read as unknown,
//! which is what map_saver means by it, although p = 0.196 is below the `free_thresh` of 0.25 that Nav2's map_saver
//! writes.
//!
//! In `trinary` mode the alpha channel counts as a channel of the mean, as in map_server. `raw` mode ignores
//! `negate`; map_server does not apply the thresholds in it.

mod description;
mod image;
mod pgm;
mod pixels;

use std::cell::Cell as Flag;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use mcl_core::{Pose2, wrap_angle};

use mcl_core::files::{Output, hold, remove};

use super::{MapFileError, MapProblem};
use crate::occupancy::{Cell, MAX_CELLS, OccupancyGrid};
use description::{Description, Mode};
use pixels::{Cells, Pixel};

/// The pixel values that map_saver writes, and thresholds that separate them.
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;
const OCCUPIED_THRESHOLD: f64 = 0.65;
const FREE_THRESHOLD: f64 = 0.196;

/// Largest image file in bytes: in text form, a pixel takes up to six.
const MAX_IMAGE_BYTES: u64 = 8 * MAX_CELLS as u64;
/// Largest description in bytes.
const MAX_DESCRIPTION_BYTES: u64 = 1 << 20;

/// Reads a grid map from its `.yaml` file and the image in the same folder.
///
/// # Errors
/// [`MapFileError`] with the file (description or image), the field, what was found and what was expected.
pub fn read_grid(path: impl AsRef<Path>) -> Result<OccupancyGrid, MapFileError> {
    let path = path.as_ref();
    let text = read(path, MAX_DESCRIPTION_BYTES)?;
    let content = |path: &Path, problem| MapFileError::Content { path: path.into(), problem };
    let description = Description::parse(&text).map_err(|problem| content(path, problem))?;
    let image_path = named_beside(path, &description);
    let Cells { width, cells } =
        read_image(&image_path, &description).map_err(|error| match error {
            // If the image is missing, the description is usually wrong.
            MapFileError::Unreadable { path: image, source } => content(
                path,
                MapProblem::field(
                    "image",
                    match &description.elsewhere {
                        Some(elsewhere) => format!(
                            "{elsewhere:?}, which leads elsewhere, and {:?} beside the .yaml file cannot be read: {source}",
                            image.display().to_string()
                        ),
                        None => {
                            format!("{:?}, which cannot be read: {source}", image.display().to_string())
                        }
                    },
                    "the name of the image file in the folder of the .yaml file",
                ),
            ),
            other => other,
        })?;
    grid_of(&description, Cells { width, cells }).map_err(|problem| content(path, problem))
}

/// Parses a grid map from the content of its description (`.yaml`) and of its image.
///
/// # Errors
/// [`MapProblem`] if either is invalid.
pub fn parse_grid(description: &[u8], image: &[u8]) -> Result<OccupancyGrid, MapProblem> {
    let description = Description::parse(description)?;
    let cells = description.cells(image)?;
    grid_of(&description, cells)
}

fn grid_of(description: &Description, image: Cells) -> Result<OccupancyGrid, MapProblem> {
    let Cells { width, mut cells } = image;
    let [x, y, yaw] = description.origin;
    // From the bottom, in place.
    cells.reverse();
    cells.chunks_mut(width).for_each(<[Cell]>::reverse);
    let map_from_grid = Pose2::new(x, y, wrap_angle(yaw));
    OccupancyGrid::new(width, description.resolution, map_from_grid, cells)
        .map_err(MapProblem::Grid)
}

/// Reads a file of at most `limit` bytes.
fn read(path: &Path, limit: u64) -> Result<Vec<u8>, MapFileError> {
    let unreadable = |source| MapFileError::Unreadable { path: path.into(), source };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(unreadable)?;
    file.take(limit + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > limit {
        let problem = MapProblem::syntax(format!("the file is longer than {limit} bytes"));
        return Err(MapFileError::Content { path: path.into(), problem });
    }
    Ok(bytes)
}

fn read_image(path: &Path, description: &Description) -> Result<Cells, MapFileError> {
    description
        .cells(&read(path, MAX_IMAGE_BYTES)?)
        .map_err(|problem| MapFileError::Content { path: path.into(), problem })
}

impl Description {
    /// Converts an image to cells.
    fn cells(&self, image: &[u8]) -> Result<Cells, MapProblem> {
        let is_saved = Flag::new(self.mode == Mode::Trinary && !self.negate);
        let has_unknown = Flag::new(false);
        let is = |pixel: Pixel, value: u8| {
            pixel.alpha.is_none() && pixel.largest == 255.0 && pixel.value == f64::from(value)
        };
        let cells = image::cells(image, |pixel| {
            let is_known = [OCCUPIED, FREE].into_iter().any(|value| is(pixel, value));
            is_saved.set(is_saved.get() && (is_known || is(pixel, UNKNOWN)));
            has_unknown.set(has_unknown.get() || is(pixel, UNKNOWN));
            self.cell(pixel)
        })?;
        if !(is_saved.get() && has_unknown.get()) {
            return Ok(cells);
        }
        image::cells(image, |pixel| match is(pixel, UNKNOWN) {
            true => Cell::Unknown,
            false => self.cell(pixel),
        })
    }

    /// Converts a pixel to a cell.
    fn cell(&self, pixel: Pixel) -> Cell {
        let value = match self.mode {
            Mode::Trinary => pixel.value_with_alpha(),
            Mode::Scale | Mode::Raw => pixel.value,
        };
        let occupied = match self.mode {
            Mode::Scale if pixel.is_transparent() => return Cell::Unknown,
            Mode::Raw => (255.0 * value / pixel.largest).round() / 100.0,
            _ if self.negate => value / pixel.largest,
            _ => (pixel.largest - value) / pixel.largest,
        };
        if occupied > 1.0 {
            return Cell::Unknown; // More than 100 % in raw mode.
        }
        if occupied > self.occupied_threshold {
            Cell::Occupied
        } else if occupied < self.free_threshold {
            Cell::Free
        } else {
            Cell::Unknown
        }
    }
}

/// The path of the image that [`write_grid`] writes for a description.
pub(super) fn image_beside(path: &Path) -> PathBuf {
    path.with_extension("pgm")
}

/// The path of the image named by the description at a path, if there is one.
pub(super) fn image_of(path: &Path) -> Option<PathBuf> {
    let text = super::is_grid(path).then(|| read(path, MAX_DESCRIPTION_BYTES).ok())??;
    Some(named_beside(path, &Description::parse(&text).ok()?))
}

/// If the description of a grid map names an image outside its folder, returns that path and the image beside the
/// description that is used instead.
pub fn image_in_place(path: impl AsRef<Path>) -> Option<(String, PathBuf)> {
    let path = path.as_ref();
    let text = super::is_grid(path).then(|| read(path, MAX_DESCRIPTION_BYTES).ok())??;
    let description = Description::parse(&text).ok()?;
    let beside = named_beside(path, &description);
    Some((description.elsewhere?, beside))
}

fn named_beside(path: &Path, description: &Description) -> PathBuf {
    path.with_file_name("").join(&description.image)
}

/// Writes a grid map like map_saver: the description to `path`, which ends with `.yaml` or `.yml`, and the image
/// (0 occupied, 254 free, 205 unknown) beside it with the extension `.pgm`. Each file is written atomically. A
/// description never stands beside the image of another map: an interruption between the two leaves no description.
///
/// # Errors
/// [`MapFileError`] for another extension, a file name that is not UTF-8, or files that cannot be written.
pub fn write_grid(path: impl AsRef<Path>, grid: &OccupancyGrid) -> Result<(), MapFileError> {
    let path = path.as_ref();
    if !super::is_grid(path) {
        let ending = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        return Err(MapFileError::UnknownEnding { path: path.into(), ending });
    }
    let image_path = image_beside(path);
    let unwritable = |path: &Path| {
        let path = path.to_owned();
        move |source| MapFileError::Unwritable { path, source }
    };
    let image_name = image_path.file_name().and_then(|name| name.to_str()).ok_or_else(|| {
        unwritable(&image_path)(std::io::Error::other("the name is not UTF-8 text"))
    })?;
    let (description, image) = encode_grid(grid, image_name);
    let on_disk = |path: &Path, bytes: &[u8]| {
        let mut output = Output::create(path)?;
        output.write_all(bytes)?;
        output.sync()?;
        Ok(output)
    };
    // A full disk is detected here, while the existing files are unchanged.
    let image = on_disk(&image_path, &image).map_err(unwritable(&image_path))?;
    let description = on_disk(path, description.as_bytes()).map_err(unwritable(path))?;
    let _held = hold();
    remove(path).map_err(unwritable(path))?;
    image.commit().map_err(unwritable(&image_path))?;
    description.commit().map_err(unwritable(path))
}

/// Encodes a grid map: the text of its description, which refers to `image_name`, and its image (PGM).
pub fn encode_grid(grid: &OccupancyGrid, image_name: &str) -> (String, Vec<u8>) {
    let Pose2 { x, y, theta } = grid.map_from_grid();
    let description = Description {
        image: image_name.to_owned(),
        elsewhere: None,
        resolution: grid.resolution(),
        origin: [x, y, theta],
        negate: false,
        occupied_threshold: OCCUPIED_THRESHOLD,
        free_threshold: FREE_THRESHOLD,
        mode: Mode::Trinary,
    };
    let grey = |cell: &Cell| match cell {
        Cell::Occupied => OCCUPIED,
        Cell::Free => FREE,
        Cell::Unknown => UNKNOWN,
    };
    let rows = grid.cells().chunks(grid.width()).rev();
    let pixels: Vec<u8> = rows.flatten().map(grey).collect();
    (description.text(), pgm::encode(grid.width(), grid.height(), &pixels))
}
