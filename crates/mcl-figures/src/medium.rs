//! What a figure is made for.

use crate::units::{COLUMN, WIDTH};

/// What a figure is made for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Medium {
    /// To be looked at on its own: 760 units wide, with its caption; `.svg` and `.png`.
    #[default]
    Screen,
    /// A paper, which sets captions itself: 3.5 inches wide, a column of common two-column layouts, or twice that where
    /// panels stand side by side, with letters of 8 points; `.pdf` beside `.svg` and `.png`, and the caption as `.txt`.
    Paper,
}

impl Medium {
    /// Width of the page (SVG units) with so many panels side by side.
    pub(crate) fn width(self, columns: usize) -> f64 {
        match self {
            Medium::Paper if columns <= 1 => COLUMN,
            Medium::Screen | Medium::Paper => WIDTH,
        }
    }

    /// Largest height of all panels together (SVG units), so that figure and caption fit a page.
    pub(crate) fn tallest(self) -> f64 {
        match self {
            Medium::Screen => 900.0,
            Medium::Paper => 640.0,
        }
    }

    /// Endings of the files, the last to be written first.
    pub(crate) fn endings(self) -> &'static [&'static str] {
        match self {
            Medium::Screen => &[".svg", ".png"],
            Medium::Paper => &[".svg", ".png", ".pdf"],
        }
    }
}
