//! What the image formats have in common.

use mcl_core::memory::with_room;

use crate::files::MapProblem;
use crate::occupancy::{Cell, GridError, MAX_CELLS};

/// A pixel with values from 0 (black, transparent) to `largest` (white, opaque).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pixel {
    /// Mean of the colour channels.
    pub value: f64,
    /// `None` in an image without alpha channel.
    pub alpha: Option<f64>,
    pub largest: f64,
}

impl Pixel {
    /// The mean of all channels, with alpha as one of four.
    pub(super) fn value_with_alpha(self) -> f64 {
        self.alpha.map_or(self.value, |alpha| (3.0 * self.value + alpha) / 4.0)
    }

    pub(super) fn is_transparent(self) -> bool {
        self.alpha.is_some_and(|alpha| alpha < self.largest)
    }
}

/// The cells of an image: rows from the top, each from left to right.
#[derive(Debug, PartialEq)]
pub(super) struct Cells {
    pub width: usize,
    pub cells: Vec<Cell>,
}

/// Checks the image size given in a header before memory is allocated for it.
pub(super) fn check_size(width: u64, height: u64) -> Result<(), MapProblem> {
    match width.checked_mul(height) {
        Some(1..) if width.saturating_mul(height) <= MAX_CELLS as u64 => Ok(()),
        _ => Err(MapProblem::syntax(format!(
            "the image is {width} × {height} pixels, expected at least 1 and at most {MAX_CELLS} in all"
        ))),
    }
}

/// Room for this many cells: a compressed image of a few kilobytes may contain a hundred million.
pub(super) fn room_for<T>(number: usize) -> Result<Vec<T>, MapProblem> {
    with_room(number, "cells of a grid map")
        .map_err(|error| MapProblem::Grid(GridError::Memory(error)))
}
