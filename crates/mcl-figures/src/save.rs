//! From the finished page to files: the SVG as it is, rendered as a PNG, and as a PDF with its text as text.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcl_core::files::write_atomically;
use mcl_core::memory::check_room;
use mcl_core::text::printable;
use resvg::{tiny_skia, usvg};
use svg2pdf::usvg as pdf;

use crate::error::FigureError;
use crate::text::{FONTS, svg_options};
use crate::units::{PIXELS_PER_UNIT, UNITS_PER_INCH};

/// Writes `<stem>` with each of these endings, and what stands beneath as `<stem>.txt`, where it is given.
pub(crate) fn save(
    stem: &Path,
    svg: &str,
    endings: &[&str],
    captions: Option<&str>,
) -> Result<Vec<PathBuf>, FigureError> {
    // Not `with_extension`: a stem such as "map-0.8" would lose its ".8".
    let path = |ending: &str| {
        let mut path = stem.as_os_str().to_owned();
        path.push(ending);
        PathBuf::from(path)
    };
    let mut paths: Vec<PathBuf> = endings.iter().map(|ending| path(ending)).collect();
    // What cannot be rendered is not written, either.
    paths.iter().rev().try_for_each(|path| save_file(path, svg))?;
    if let Some(captions) = captions {
        let lines: Vec<_> = captions.lines().map(printable).collect();
        let path = path(".txt");
        write(&path, (lines.join("\n") + "\n").as_bytes())?;
        paths.push(path);
    }
    Ok(paths)
}

/// A format of figures.
#[derive(Clone, Copy)]
enum Format {
    Svg,
    Png,
    Pdf,
}

/// Checks that the ending of a path says a format that figures are written in.
///
/// # Errors
/// [`FigureError::Ending`] for anything but `.svg`, `.png` and `.pdf`.
pub fn check_figure_ending(path: &Path) -> Result<(), FigureError> {
    format_of(path).map(drop)
}

fn format_of(path: &Path) -> Result<Format, FigureError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("svg") => Ok(Format::Svg),
        Some("png") => Ok(Format::Png),
        Some("pdf") => Ok(Format::Pdf),
        _ => Err(FigureError::Ending { path: path.into() }),
    }
}

/// Writes one file, in the format that its ending says.
pub(crate) fn save_file(path: &Path, svg: &str) -> Result<(), FigureError> {
    let bytes = match format_of(path)? {
        Format::Svg => Ok(svg.as_bytes().to_vec()),
        Format::Png => render(svg),
        Format::Pdf => to_pdf(svg),
    };
    let bytes = bytes.map_err(|reason| FigureError::Render { stem: path.into(), reason })?;
    write(path, &bytes)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), FigureError> {
    write_atomically(path, bytes).map_err(|source| FigureError::Write { path: path.into(), source })
}

fn to_pdf(svg: &str) -> Result<Vec<u8>, String> {
    let mut fonts = pdf::fontdb::Database::new();
    FONTS.iter().for_each(|font| {
        fonts.load_font_source(pdf::fontdb::Source::Binary(Arc::new(font())));
    });
    let options = pdf::Options {
        fontdb: fonts.into(),
        font_family: "DejaVu Sans".to_owned(),
        ..pdf::Options::default()
    };
    let tree = pdf::Tree::from_str(svg, &options).map_err(|error| error.to_string())?;
    let page = svg2pdf::PageOptions { dpi: UNITS_PER_INCH };
    svg2pdf::to_pdf(&tree, svg2pdf::ConversionOptions::default(), page)
        .map_err(|error| error.to_string())
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
    encode(&pixels).map_err(|error| error.to_string())
}

/// As a PNG, of red, green and blue, as the paper is opaque. The fastest packing takes a tenth of the default's time, for
/// files of twice the size (0.4 MB); filters make those of flat areas and thin lines no smaller.
fn encode(pixels: &tiny_skia::Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    let mut rgb = vec![0; pixels.pixels().len() * 3];
    for (to, from) in rgb.chunks_exact_mut(3).zip(pixels.data().chunks_exact(4)) {
        to.copy_from_slice(&from[..3]);
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_filter(png::Filter::NoFilter);
    encoder.set_deflate_compression(png::DeflateCompression::Level(1));
    encoder.write_header()?.write_image_data(&rgb)?;
    Ok(bytes)
}
