//! Grid maps of ROS's map_server: a YAML description and an image.
//!
//! Read as map_server of Nav2 (`map_io.cpp`) reads them. The top row of the image is the one with the
//! largest y. With the lightness s of a pixel (its channels' mean over their largest value), p = 1 − s, or
//! s with `negate`, is how occupied its cell is:
//!
//! | `mode` | occupied | free | else |
//! |---|---|---|---|
//! | `trinary` (default) | p > `occupied_thresh` | p < `free_thresh` | unknown |
//! | `scale` | the same | the same | unknown, and transparent pixels; map_server scales p to 0 … 100 |
//! | `raw` | 255·s, rounded, is the probability in percent (unknown above 100), compared with the thresholds | | |
//!
//! One thing is not as there: where an image has no values but the three that map_saver writes, its 205 is what that
//! means, unknown, although p = 0.196 is below a `free_thresh` of 0.25, which Nav2's map_saver writes beside it.
//!
//! In `trinary` mode the alpha channel counts as a channel of the mean, as there. `raw` mode ignores
//! `negate`, and there leaves the thresholds to whoever uses the map.

mod description;
mod image;
mod pgm;

use std::cell::Cell as Flag;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use mcl_core::{Pose2, wrap_angle};

use mcl_core::files::{Output, hold, remove};

use super::{MapFileError, MapProblem};
use crate::occupancy::{Cell, MAX_CELLS, OccupancyGrid};
use description::{Description, Mode};
use image::{Cells, Pixel};

/// What map_saver writes, and the thresholds that tell them apart.
const OCCUPIED: u8 = 0;
const FREE: u8 = 254;
const UNKNOWN: u8 = 205;
const OCCUPIED_THRESHOLD: f64 = 0.65;
const FREE_THRESHOLD: f64 = 0.196;

/// Largest file of an image, in bytes: as text, a pixel takes up to six.
const MAX_IMAGE_BYTES: u64 = 8 * MAX_CELLS as u64;
/// Largest description, in bytes.
const MAX_DESCRIPTION_BYTES: u64 = 1 << 20;

/// Reads a grid map; `path` is that of its `.yaml` file, beside which the image lies.
///
/// # Errors
/// [`MapFileError`] names the file (description or image), the field, what was found and what was
/// expected.
pub fn read_grid(path: impl AsRef<Path>) -> Result<OccupancyGrid, MapFileError> {
    let path = path.as_ref();
    let text = read(path, MAX_DESCRIPTION_BYTES)?;
    let content = |path: &Path, problem| MapFileError::Content { path: path.into(), problem };
    let description = Description::parse(&text).map_err(|problem| content(path, problem))?;
    let image_path = named_beside(path, &description);
    let Cells { width, cells } =
        read_image(&image_path, &description).map_err(|error| match error {
            // A missing image is more often a wrong description.
            MapFileError::Unreadable { path: image, source } => content(
                path,
                MapProblem::field(
                    "image",
                    match &description.elsewhere {
                        Some(elsewhere) => format!(
                            "{elsewhere:?}, which leads elsewhere, and of that name {:?} cannot be read: {source}",
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

/// Reads a grid map from the content of its description (`.yaml`) and of its image.
///
/// # Errors
/// [`MapProblem`] says what is wrong with one of them.
pub fn parse_grid(description: &[u8], image: &[u8]) -> Result<OccupancyGrid, MapProblem> {
    let description = Description::parse(description)?;
    let cells = description.cells(image)?;
    grid_of(&description, cells)
}

fn grid_of(description: &Description, image: Cells) -> Result<OccupancyGrid, MapProblem> {
    let Cells { width, cells } = image;
    let [x, y, yaw] = description.origin;
    let from_bottom = cells.chunks(width).rev().flatten().copied().collect();
    let map_from_grid = Pose2::new(x, y, wrap_angle(yaw));
    OccupancyGrid::new(width, description.resolution, map_from_grid, from_bottom)
        .map_err(MapProblem::Grid)
}

/// The bytes of a file of at most this many.
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
    /// The cells of an image.
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

    /// What a pixel says of its cell.
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

/// The image that [`write_grid`] writes beside a description.
pub(super) fn image_beside(path: &Path) -> PathBuf {
    path.with_extension("pgm")
}

/// The image that the description at a path names, if there is one.
pub(super) fn image_of(path: &Path) -> Option<PathBuf> {
    let text = super::is_grid(path).then(|| read(path, MAX_DESCRIPTION_BYTES).ok())??;
    Some(named_beside(path, &Description::parse(&text).ok()?))
}

/// Of a grid map whose description names an image elsewhere, that path and the image beside the description, which
/// is taken in its place.
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

/// Writes a grid map as map_saver does: the description to `path`, which ends with `.yaml` or `.yml`, and
/// beside it, with the ending `.pgm`, the image (0 occupied, 254 free, 205 unknown). Each file is
/// whole or not there, and no description is ever beside an image that is not its own: what stops between the
/// two leaves none.
///
/// # Errors
/// [`MapFileError`] for another ending, a name that is no text, or files that cannot be written.
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
    // A disk that is full is full here, with the files that were there untouched.
    let image = on_disk(&image_path, &image).map_err(unwritable(&image_path))?;
    let description = on_disk(path, description.as_bytes()).map_err(unwritable(path))?;
    let _held = hold();
    remove(path).map_err(unwritable(path))?;
    image.commit().map_err(unwritable(&image_path))?;
    description.commit().map_err(unwritable(path))
}

/// The content of the description of a grid map, whose image has this name, and of its image (PGM).
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
