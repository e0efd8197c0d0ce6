//! From the finished page to files: the SVG as it is, and rendered as a PNG.

use std::path::{Path, PathBuf};

use mcl_core::files::write_atomically;
use mcl_core::memory::check_room;
use resvg::{tiny_skia, usvg};

use crate::error::FigureError;
use crate::text::svg_options;
use crate::units::PIXELS_PER_UNIT;

/// Writes `<stem>.svg` and `<stem>.png`.
pub(crate) fn save(stem: &Path, svg: &str) -> Result<[PathBuf; 2], FigureError> {
    // Not `with_extension`: a stem such as "map-0.8" would lose its ".8".
    let paths = [".svg", ".png"].map(|ending| {
        let mut path = stem.as_os_str().to_owned();
        path.push(ending);
        PathBuf::from(path)
    });
    // What cannot be rendered is not written, either.
    paths.iter().rev().try_for_each(|path| save_file(path, svg))?;
    Ok(paths)
}

/// Checks that the ending of a path says a format that figures are written in.
///
/// # Errors
/// [`FigureError::Ending`] for anything but `.svg` and `.png`.
pub fn check_figure_ending(path: &Path) -> Result<(), FigureError> {
    is_png(path).map(drop)
}

fn is_png(path: &Path) -> Result<bool, FigureError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("svg") => Ok(false),
        Some("png") => Ok(true),
        _ => Err(FigureError::Ending { path: path.into() }),
    }
}

/// Writes one file, in the format that its ending says.
pub(crate) fn save_file(path: &Path, svg: &str) -> Result<(), FigureError> {
    let bytes = match is_png(path)? {
        true => render(svg).map_err(|reason| FigureError::Render { stem: path.into(), reason })?,
        false => svg.as_bytes().to_vec(),
    };
    write_atomically(path, &bytes)
        .map_err(|source| FigureError::Write { path: path.into(), source })
}

fn render(svg: &str) -> Result<Vec<u8>, String> {
    let tree = usvg::Tree::from_str(svg, &svg_options()).map_err(|error| error.to_string())?;
    let size = tree.size().to_int_size().scale_by(PIXELS_PER_UNIT).ok_or("its size is zero")?;
    // The picture, a layer of it, and what is written.
    let number = size.width() as usize * size.height() as usize;
    check_room(number, 3 * 4, "pixels of a figure").map_err(|error| error.to_string())?;
    let mut pixels =
        tiny_skia::Pixmap::new(size.width(), size.height()).ok_or("it is too large")?;
    let scale = tiny_skia::Transform::from_scale(PIXELS_PER_UNIT, PIXELS_PER_UNIT);
    resvg::render(&tree, scale, &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| error.to_string())
}
