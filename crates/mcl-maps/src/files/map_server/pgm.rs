//! Portable graymaps: P2 (text) and P5 (binary).

use super::pixels::{Cells, Pixel, check_size, room_for};
use crate::files::MapProblem;
use crate::occupancy::Cell;

/// Reads the first image of a file.
pub(super) fn cells(bytes: &[u8], cell: impl Fn(Pixel) -> Cell) -> Result<Cells, MapProblem> {
    let is_text = bytes.starts_with(b"P2");
    let mut tokens = Tokens { bytes, position: 2 };
    let width = tokens.number("the width")?;
    let height = tokens.number("the height")?;
    let largest = tokens.number("the largest value")?;
    if !(1..=65535).contains(&largest) {
        return Err(MapProblem::syntax(format!(
            "PGM: the largest value is {largest}, expected 1 to 65535"
        )));
    }
    check_size(width, height)?;
    let pixels = (width * height) as usize;
    // No pixel takes less than a byte.
    let mut cells = room_for(pixels.min(bytes.len()))?;
    let mut add = |value: u64| {
        if value > largest {
            let (column, row) = (cells.len() as u64 % width, cells.len() as u64 / width);
            return Err(MapProblem::syntax(format!(
                "PGM: pixel (column {column}, row {row}) is {value}, expected at most {largest}"
            )));
        }
        cells.push(cell(Pixel { value: value as f64, alpha: None, largest: largest as f64 }));
        Ok(())
    };
    if is_text {
        for found in 0..pixels {
            if tokens.is_at_end() {
                return Err(short(pixels, found));
            }
            add(tokens.number("a pixel")?)?;
        }
    } else {
        // One whitespace character ends the header.
        let raster = bytes.get(tokens.position + 1..).unwrap_or_default();
        let size = if largest > 255 { 2 } else { 1 };
        if raster.len() / size < pixels {
            return Err(short(pixels, raster.len() / size));
        }
        for value in raster.chunks_exact(size).take(pixels) {
            add(value.iter().fold(0, |value, &byte| value << 8 | u64::from(byte)))?;
        }
    }
    Ok(Cells { width: width as usize, cells })
}

fn short(announced: usize, found: usize) -> MapProblem {
    MapProblem::count("pixels", announced as u64, found.to_string())
}

/// Numbers separated by whitespace and `#` comments.
struct Tokens<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl Tokens<'_> {
    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.position).copied()
    }

    fn skip_while(&mut self, skipped: impl Fn(u8) -> bool) {
        while self.peek().is_some_and(&skipped) {
            self.position += 1;
        }
    }

    /// Skips to the next token; returns whether there is none.
    fn is_at_end(&mut self) -> bool {
        loop {
            self.skip_while(|byte| byte.is_ascii_whitespace());
            match self.peek() {
                Some(b'#') => self.skip_while(|byte| byte != b'\n' && byte != b'\r'),
                next => return next.is_none(),
            }
        }
    }

    fn number(&mut self, what: &str) -> Result<u64, MapProblem> {
        let is_at_end = self.is_at_end();
        let start = self.position;
        self.skip_while(|byte| !byte.is_ascii_whitespace() && byte != b'#');
        let token = &self.bytes[start..self.position];
        std::str::from_utf8(token).ok().and_then(|digits| digits.parse().ok()).ok_or_else(|| {
            let found = match is_at_end {
                true => "the end of the file".to_owned(),
                false => format!("\"{}\"", token[..token.len().min(20)].escape_ascii()),
            };
            MapProblem::syntax(format!(
                "PGM: byte {start}: found {found}, expected {what} as a decimal number"
            ))
        })
    }
}

/// Encodes a binary image from bytes, row by row from the top.
pub(super) fn encode(width: usize, height: usize, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = format!("P5\n{width} {height}\n255\n").into_bytes();
    bytes.extend(pixels);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pixel values divided by the largest value.
    fn values(bytes: &[u8]) -> Result<(usize, Vec<f64>), MapProblem> {
        let values = std::cell::RefCell::new(Vec::new());
        let read = cells(bytes, |pixel| {
            values.borrow_mut().push(pixel.value / pixel.largest);
            Cell::Free
        })?;
        Ok((read.width, values.into_inner()))
    }

    #[test]
    fn text_and_bytes_of_one_and_two() {
        let plain =
            b"P2 # made by hand\n# two lines\n3 2# width, height\n10\n0 5 10\n1 2 # half\n3\n";
        assert_eq!(values(plain).unwrap(), (3, vec![0.0, 0.5, 1.0, 0.1, 0.2, 0.3]));
        let bytes = b"P5\n#c\n2 1\n255\n\x00\xff";
        assert_eq!(values(bytes).unwrap(), (2, vec![0.0, 1.0]));
        // The first pixel is a line break.
        assert_eq!(values(b"P5 1 1 10 \n").unwrap(), (1, vec![1.0]));
        let wide = b"P5 2 1 1000 \x01\xf4\x03\xe8";
        assert_eq!(values(wide).unwrap(), (2, vec![0.5, 1.0]));
        assert_eq!(values(b"P2 1 1 65535 65535").unwrap(), (1, vec![1.0]));
    }

    #[test]
    fn damage_is_reported() {
        for (bytes, expected) in [
            (&b"P5"[..], "byte 2: found the end of the file, expected the width"),
            (b"P5 2", "expected the height"),
            (b"P5 -2 1 255 ", "found \"-2\", expected the width as a decimal number"),
            (b"P5 2 1 0 ", "the largest value is 0, expected 1 to 65535"),
            (b"P5 2 1 70000 ", "the largest value is 70000"),
            (b"P5 0 1 255 ", "the image is 0 × 1 pixels, expected at least 1"),
            (b"P5 99999 99999 255 ", "99999 × 99999 pixels"),
            (b"P5 18446744073709551615 2 255 ", "pixels"),
            (b"P5 2 2 255 \x00\x00\x00", "announces 4 pixels, the file holds 3"),
            (b"P5 1 1 255", "announces 1 pixels, the file holds 0"),
            (b"P5 1 2 1000 \x00\x01\x00", "announces 2 pixels, the file holds 1"),
            (b"P2 2 2 255 1 2 3 #4", "announces 4 pixels, the file holds 3"),
            (b"P2 2 2 255 1 2 3 x", "found \"x\", expected a pixel"),
            (b"P2 2 2 9 1 2 10 1", "pixel (column 0, row 1) is 10, expected at most 9"),
        ] {
            let message = values(bytes).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
