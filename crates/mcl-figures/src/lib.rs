//! Figures as SVG, PNG and PDF, drawn from plain rows.
//!
//! [`draw_curves`] draws curves with 95 % intervals over the map size, [`draw_clouds`] point maps
//! and the robot's paths on them, [`draw_heat`] values over two settings. plotters draws the charts
//! on a page that becomes the SVG. All write `<stem>.svg` and `<stem>.png`, for a paper ([`Medium`]) also
//! `<stem>.pdf`; PNG and PDF are the SVG rendered with a font that the program carries along, so it needs no display, no installed font, and gives
//! the same bytes for the same input. Point clouds stand in the SVG as pictures: files stay small, and
//! no coordinates of a data set are published with them. Names from data are safe anywhere:
//! characters that act are shown as escapes, and what is too long for its place is cut.

mod axis;
mod canvas;
mod clouds;
mod curves;
mod elements;
mod error;
mod heat;
mod marks;
mod medium;
mod page;
mod raster;
mod save;
mod style;
mod styles;
mod text;
mod units;

pub use axis::Scale;
pub use clouds::{CloudFigure, CloudLabels, CloudPanel, CloudPath, draw_clouds};
pub use curves::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, draw_curve_file, draw_curves,
};
pub use error::FigureError;
pub use heat::{HeatCell, HeatFigure, HeatPanel, draw_heat};
pub use medium::Medium;
pub use save::check_figure_ending;
pub use style::{CurveStyle, Dash, Marker};
pub use styles::styles;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
