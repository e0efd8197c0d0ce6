//! Reading images, pixel by pixel.

use std::io::Cursor;

use png::{ColorType, Decoder, DecodingError, Limits, Transformations};

use super::pgm;
use super::pixels::{Cells, Pixel, check_size, room_for};
use crate::files::MapProblem;
use crate::occupancy::Cell;

const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Memory that the PNG decoder may use besides the image, in bytes.
const MAX_DECODER_BYTES: usize = 1 << 26;

/// Reads a PGM (P2, P5) or PNG image; the first bytes determine the format.
pub(super) fn cells(bytes: &[u8], cell: impl Fn(Pixel) -> Cell) -> Result<Cells, MapProblem> {
    if bytes.starts_with(PNG_MAGIC) {
        return png_cells(bytes, cell);
    }
    if bytes.starts_with(b"P2") || bytes.starts_with(b"P5") {
        return pgm::cells(bytes, cell);
    }
    let start: String =
        bytes.iter().take(8).flat_map(|&byte| byte.escape_ascii()).map(char::from).collect();
    Err(MapProblem::syntax(format!(
        "the image begins with \"{start}\", expected PGM (P2, P5) or PNG"
    )))
}

fn png_cells(bytes: &[u8], cell: impl Fn(Pixel) -> Cell) -> Result<Cells, MapProblem> {
    let mut decoder =
        Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: MAX_DECODER_BYTES });
    // Expands palettes to colours, transparent colours to an alpha channel, and low bit depths to eight.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width, reader.info().height);
    check_size(width.into(), height.into())?;
    // Deflate compresses by at most 1,032 to 1, and an interlaced image is allocated at once.
    let needed = u64::from(width) * u64::from(height) * reader.info().bits_per_pixel() as u64 / 8;
    if needed > 1032 * bytes.len() as u64 {
        return Err(MapProblem::syntax(format!(
            "the PNG image says {width} × {height} pixels, which its {} bytes cannot hold: it is damaged or cut short",
            bytes.len()
        )));
    }
    let (color, depth) = reader.output_color_type();
    let bytes_per_sample = if depth == png::BitDepth::Sixteen { 2 } else { 1 };
    let largest = if bytes_per_sample == 2 { 65535.0 } else { 255.0 };
    let channels = color.samples();
    let has_alpha = matches!(color, ColorType::GrayscaleAlpha | ColorType::Rgba);
    let sample = |bytes: &[u8]| match *bytes {
        [high, low] => f64::from(u16::from_be_bytes([high, low])),
        _ => f64::from(bytes[0]),
    };
    let row_of = |row: &[u8], cells: &mut Vec<Cell>| {
        for pixel in row.chunks_exact(channels * bytes_per_sample) {
            let mut samples = [0.0; 4];
            for (value, bytes) in samples.iter_mut().zip(pixel.chunks_exact(bytes_per_sample)) {
                *value = sample(bytes);
            }
            let colors = channels - usize::from(has_alpha);
            cells.push(cell(Pixel {
                value: samples[..colors].iter().sum::<f64>() / colors as f64,
                alpha: has_alpha.then(|| samples[colors]),
                largest,
            }));
        }
    };
    let mut cells = room_for(width as usize * height as usize)?;
    if reader.info().interlaced {
        let size = reader
            .output_buffer_size()
            .ok_or_else(|| MapProblem::syntax("the PNG image is too large"))?;
        let mut pixels = room_for(size)?;
        pixels.resize(size, 0);
        let frame = reader.next_frame(&mut pixels).map_err(damaged)?;
        row_of(&pixels[..frame.buffer_size()], &mut cells);
    } else {
        while let Some(row) = reader.next_row().map_err(damaged)? {
            row_of(row.data(), &mut cells);
        }
    }
    // Verifies the checksums and the end of the file.
    reader.finish().map_err(damaged)?;
    Ok(Cells { width: width as usize, cells })
}

fn damaged(error: DecodingError) -> MapProblem {
    MapProblem::syntax(format!("the PNG image cannot be read: {error}"))
}
