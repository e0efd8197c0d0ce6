//! Why a figure could not be drawn.

use std::io;
use std::path::PathBuf;

use mcl_core::text::printable;

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
        "{}: axis \"{}\" from {} to {}: expected two finite ends in ascending order, \
         positive ones on a logarithmic axis", stem.display(), printable(label), range[0], range[1]
    )]
    Range {
        /// The figure.
        stem: PathBuf,
        /// The label of the axis.
        label: String,
        /// Its ends.
        range: [f64; 2],
    },
    /// A panel's cells do not fit its axes.
    #[error(
        "{}: panel \"{}\" holds {found} cells: expected {} × {}, one for each pair of labels",
        stem.display(), printable(title), expected[0], expected[1]
    )]
    Cells {
        /// The figure.
        stem: PathBuf,
        /// The title of the panel.
        title: String,
        /// How many cells it has.
        found: usize,
        /// How many labels its x and its y axis have.
        expected: [usize; 2],
    },
    /// The ending of a file names no format.
    #[error("{}: the extension names no format of figures, expected .svg, .png or .pdf", path.display())]
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
