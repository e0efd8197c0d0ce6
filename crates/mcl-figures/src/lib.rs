//! Figures as SVG and PNG, drawn from plain rows.
//!
//! [`draw_curves`] draws curves with 95 % intervals over the map size, [`draw_clouds`] point maps
//! and the robot's paths on them. plotters draws the charts on a page that becomes the SVG. Both
//! write `<stem>.svg` and `<stem>.png`; the PNG is the SVG rendered with a font that the program
//! carries along, so it needs no display, no installed font, and gives the same bytes for the same
//! input. Point clouds stand in the SVG as pictures: files stay small, and no coordinates of a data
//! set are published with them.

mod axis;
mod canvas;
mod clouds;
mod curves;
mod elements;
mod marks;
mod page;
mod raster;
mod style;
mod text;

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

use mcl_core::memory::check_room;
use resvg::{tiny_skia, usvg};

pub use axis::Scale;
pub use clouds::{Arrangement, CloudFigure, CloudLabels, CloudPanel, CloudPath, draw_clouds};
pub use curves::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, Interval, draw_curve_file, draw_curves,
};
pub use style::{CurveStyle, Dash, Marker};

/// Width of a figure (SVG user units): at a text width of 160 mm, letters of 12 units are 2.5 mm.
const WIDTH: f64 = 760.0;
/// Pixels of the PNG, and of embedded pictures, per SVG unit: about 360 dpi at 160 mm.
const PIXELS_PER_UNIT: f32 = 3.0;

/// Why a figure could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// Not one value of the figure can be drawn.
    #[error("{}: nothing to draw: found {found}, expected at least one finite {expected}", stem.display())]
    NothingToDraw {
        /// The figure.
        stem: PathBuf,
        /// What the figure was made of.
        found: String,
        /// What is missing.
        expected: &'static str,
    },
    /// An axis was given ends that its scale cannot show.
    #[error(
        "{}: axis \"{label}\" from {} to {}: expected two finite ends in ascending order, \
         positive ones on a logarithmic axis", stem.display(), range[0], range[1]
    )]
    Range {
        /// The figure.
        stem: PathBuf,
        /// The label of the axis.
        label: String,
        /// Its ends.
        range: [f64; 2],
    },
    /// The ending of a file names no format.
    #[error("{}: the ending says no format of figures, expected .svg or .png", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
    },
    /// The figure could not be rendered as a picture.
    #[error("{}: cannot render the figure: {reason}", stem.display())]
    Render {
        /// The figure.
        stem: PathBuf,
        /// The renderer's reason.
        reason: String,
    },
    /// A file could not be written; what was there before is untouched.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

/// What to say of a figure that plotters could not draw.
fn render_error(stem: &Path) -> impl Fn(page::DrawError) -> FigureError {
    |error| FigureError::Render { stem: stem.into(), reason: page::reason(&error) }
}

/// Writes `<stem>.svg` and `<stem>.png`.
fn save(stem: &Path, svg: &str) -> Result<[PathBuf; 2], FigureError> {
    let png = render(svg).map_err(|reason| FigureError::Render { stem: stem.into(), reason })?;
    let write = |ending: &str, bytes: &[u8]| {
        // Not `with_extension`: a stem such as "map-0.8" would lose its ".8".
        let mut path = OsString::from(stem);
        path.push(ending);
        let path = PathBuf::from(path);
        match mcl_core::files::write_atomically(&path, bytes) {
            Ok(()) => Ok(path),
            Err(source) => Err(FigureError::Write { path, source }),
        }
    };
    Ok([write(".svg", svg.as_bytes())?, write(".png", &png)?])
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
fn save_file(path: &Path, svg: &str) -> Result<(), FigureError> {
    let bytes = match is_png(path)? {
        true => render(svg).map_err(|reason| FigureError::Render { stem: path.into(), reason })?,
        false => svg.as_bytes().to_vec(),
    };
    mcl_core::files::write_atomically(path, &bytes)
        .map_err(|source| FigureError::Write { path: path.into(), source })
}

fn render(svg: &str) -> Result<Vec<u8>, String> {
    let tree =
        usvg::Tree::from_str(svg, &text::svg_options()).map_err(|error| error.to_string())?;
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
