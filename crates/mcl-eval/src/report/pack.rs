//! Encoding of numbers on a page: integers, in planes of bytes, compressed, as base64.

use std::io::Read;

use anyhow::{Context, Result, bail};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::read::GzDecoder;
use mcl_core::{Bounds, Point};

use crate::report::payload;

/// Resolution of positions (m), unless their extent would exceed 16 bits.
const FINEST_STEP: f64 = 0.01;
/// Largest extent of all positions, in steps: differences of positions fit into 16 bits, too.
const STEPS: f64 = 32_000.0;
/// Stands for an unknown pose.
pub const ABSENT: i16 = i16::MIN;

/// Quantization of positions: steps from an origin.
#[derive(Debug, Clone, Copy)]
pub struct Steps {
    /// The middle of all positions (m).
    pub origin: Point<2>,
    /// Length of a step (m).
    pub step: f64,
}

impl Steps {
    /// For positions within these bounds.
    pub fn over(bounds: &Bounds<2>) -> Self {
        let extent = bounds.extent(0).max(bounds.extent(1));
        Steps { origin: bounds.center(), step: FINEST_STEP.max(extent / STEPS) }
    }

    /// A position along an axis (m), in steps.
    pub fn place(&self, axis: usize, metres: f64) -> i16 {
        self.length(metres - self.origin[axis])
    }

    /// A length (m), in steps.
    pub fn length(&self, metres: f64) -> i16 {
        // Saturates; values within the bounds do not reach the limit.
        (metres / self.step).round().clamp(-32_767.0, 32_767.0) as i16
    }
}

/// An angle (rad) in 16 bits: 32,767 is half a turn.
pub fn angle(radians: f64) -> i16 {
    (mcl_core::wrap_angle(radians) / std::f64::consts::PI * 32_767.0).round() as i16
}

/// An angle (rad) in 8 bits: 128 is half a turn.
pub fn coarse_angle(radians: f64) -> u8 {
    ((radians / std::f64::consts::PI * 128.0).round() as i64).rem_euclid(256) as u8
}

/// Arrays of numbers one after the other, little-endian; of each array first all first bytes, then all second
/// bytes, which compresses well.
#[derive(Default)]
pub struct Packer {
    bytes: Vec<u8>,
}

impl Packer {
    /// Adds an array of numbers of `N` bytes each.
    pub fn put<const N: usize>(&mut self, numbers: impl Iterator<Item = [u8; N]> + Clone) {
        for byte in 0..N {
            self.bytes.extend(numbers.clone().map(|number| number[byte]));
        }
    }

    /// The arrays, compressed, as base64.
    ///
    /// # Errors
    /// When memory is exhausted.
    pub fn finish(self) -> Result<String> {
        payload::pack(&self.bytes)
    }
}

/// Checks that a text contains arrays of this many bytes, with memory limited to that size.
///
/// # Errors
/// What it contains instead.
pub fn check(text: &str, bytes: usize) -> Result<()> {
    let packed = STANDARD.decode(text).context("data is not base64")?;
    let mut found = Vec::new();
    GzDecoder::new(&packed[..])
        .take(bytes as u64 + 1)
        .read_to_end(&mut found)
        .context("data is not compressed by gzip")?;
    if found.len() != bytes {
        let more = if found.len() > bytes { " or more" } else { "" };
        bail!("data holds {}{more} bytes, expected {bytes}", found.len());
    }
    Ok(())
}

/// At most `most` of these, evenly spaced from the first to the last.
pub fn thinned<T: Copy>(all: &[T], most: usize) -> impl Iterator<Item = T> + '_ {
    let kept = all.len().min(most);
    (0..kept).map(move |k| all[k * all.len() / kept.max(1)])
}
